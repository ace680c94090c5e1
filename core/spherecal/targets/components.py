"""Connected components of the pixels above a threshold that varies over the image; numba kernels of blobs.py.

Only active tiles are looked at. Pixels are joined along rows to runs and runs of neighbouring rows by their overlap
(4-neighbours: blurred dots that touch by a corner stay two). Of components of the size of dots the sums are kept that
their moments need.
"""

import numpy as np

from spherecal.base.kernels import BARE, KERNEL, njit

TILE_PX = 8
LONGEST_RUN = 48  # px; a component with a longer run is none of dots

# columns of the sums of a component: pixels, their x, y, xx, xy, yy; light above the threshold, its x, y moments;
# brightest pixel; threshold (of its first run)
AREA, X, Y, XX, XY, YY, LIGHT, LIGHT_X, LIGHT_Y, PEAK, THRESHOLD = range(11)
_SUMS = 11
_VAST = 1 << 28  # px: the area of a component with a longer run
_TOP_BYTE = np.uint64(56)
_PACK = np.uint64(0x0102040810204080)  # times eight bytes of 0 or 1: their bits, the first pixel the lowest, on top
# Which bit of 64 is the only one set: its product with a sequence of de Bruijn has a number of its own in its top bits.
_SEQUENCE, _TOP_SIX = 0x022FDD63CC95386D, np.uint64(58)
_WHICH = np.zeros(64, np.int64)
_WHICH[[(_SEQUENCE << bit & 2**64 - 1) >> 58 for bit in range(64)]] = np.arange(64)
_TIMES, _ONE, _LAST_BIT = np.uint64(_SEQUENCE), np.uint64(1), np.uint64(63)


@njit(**KERNEL)
def tile_extremes(image):
    """Darkest and brightest pixel of every tile, two arrays of the image's type."""
    height, width = image.shape
    rows, columns = (height + 7) // 8, (width + 7) // 8
    darkest, brightest = np.empty((rows, columns), image.dtype), np.empty((rows, columns), image.dtype)
    low, high = np.empty(columns * 8, image.dtype), np.empty(columns * 8, image.dtype)
    for row in range(rows):
        low[:width] = image[row * 8]
        high[:width] = image[row * 8]
        for y in range(row * 8 + 1, min(row * 8 + 8, height)):
            for x in range(width):
                value = image[y, x]
                low[x] = min(low[x], value)
                high[x] = max(high[x], value)
        low[width:] = low[width - 1]
        high[width:] = high[width - 1]
        for column in range(columns):
            least, most = low[column * 8], high[column * 8]
            for x in range(column * 8 + 1, column * 8 + 8):
                least, most = min(least, low[x]), max(most, high[x])
            darkest[row, column], brightest[row, column] = least, most
    return darkest, brightest


@njit(**KERNEL)
def label_components(image, dark, contrast, level, active, least, most, most_runs):
    """Components above a threshold in the active tiles: sums (n, 11), and runs (m, 4) row x0 x1 component.

    Most of a textured image is in components that are too small or too large. Of these little or nothing is kept.

    `image`: grey image, (h, w); `dark`, `contrast`, `level`: the threshold of a tile is dark + level * contrast.
    """
    height, width = image.shape
    tile_rows, columns = active.shape
    parent, areas = np.empty(most_runs, np.int32), np.empty(most_runs, np.int32)
    runs = np.empty((most_runs, 4), np.int32)  # memory that is never touched costs nothing
    levels = np.empty(most_runs, np.float32)
    of_tiles, of_row = np.empty((3, columns + 2), np.float32), np.empty(columns + 2, np.float32)
    above = np.zeros(columns * TILE_PX, np.bool_)
    words, flat = above.view(np.uint64), runs.reshape(most_runs * 4)  # a word for the row of a tile
    spans = np.empty((columns, 2), np.int64)
    previous_start, previous_end, count, labels = 0, 0, 0, 0
    for tile_row in range(tile_rows):
        many = _find_spans(active[tile_row], spans)
        if many == 0:
            continue
        _thresholds_of_tiles(dark, contrast, np.float32(level), tile_row, spans[:many], of_tiles)
        for y in range(tile_row * TILE_PX, min(tile_row * TILE_PX + TILE_PX, height)):
            start = count
            for span in range(many):
                first, end = spans[span]
                _thresholds_of_row(of_tiles, y, first, end, of_row)
                _compare(image, y, first, end, of_row, above)
                count = _append_runs(words, first, end, width, flat, count)
            for run in range(start, count):
                runs[run, 0], levels[run] = y, of_row[(runs[run, 1] >> 3) + 1]
            labels = _link_runs(runs, previous_start, previous_end, start, count, parent, areas, labels)
            previous_start, previous_end = start, count
    component, kept = _gather(parent, areas, labels, least)
    sums = np.zeros((kept, _SUMS))
    _add_runs(image, runs[:count], levels, parent, areas, component, most, sums)
    return sums, runs[:count]


@njit(**BARE)
def _add_runs(image, runs, levels, parent, areas, component, most, sums):
    """Set the runs' components, and add them up where these are not too large."""
    for run in range(len(runs)):
        label = runs[run, 3]
        number = component[label]
        runs[run, 3] = number
        if number >= 0:
            area = areas[parent[label]]
            if area > most:
                sums[number, AREA] = area
            else:
                _add_run(image, runs, run, levels[run], sums)


@njit(**BARE)
def _find_spans(active, spans):
    """First tile and end of the spans of active tiles in a row of tiles, into `spans`; returns their number."""
    count, column, columns = 0, 0, len(active)
    while column < columns:
        if not active[column]:
            column += 1
            continue
        spans[count, 0] = column
        while column < columns and active[column]:
            column += 1
        spans[count, 1] = column
        count += 1
    return count


@njit(**BARE)
def _thresholds_of_tiles(dark, contrast, level, tile_row, spans, of_tiles):
    """Thresholds of the tiles in and beside the spans: those above, of and below a row of tiles; tile k is at k + 1."""
    rows, columns = dark.shape
    for line in range(3):
        row = min(max(tile_row + line - 1, 0), rows - 1)
        for span in range(len(spans)):
            for k in range(max(spans[span, 0] - 1, 0), min(spans[span, 1] + 1, columns)):
                of_tiles[line, k + 1] = dark[row, k] + level * contrast[row, k]
        of_tiles[line, 0], of_tiles[line, columns + 1] = of_tiles[line, 1], of_tiles[line, columns]


@njit(**BARE)
def _thresholds_of_row(of_tiles, y, first, end, of_row):
    """Thresholds in row y at the middles of the tiles first - 1 to end, into `of_row`, where tile k is at k + 1."""
    part = np.float32(((y & 7) - 3.5) / 8)
    other = 2 if part > 0 else 0
    part = abs(part)
    for k in range(first, end + 2):
        of_row[k] = of_tiles[1, k] * (1 - part) + of_tiles[other, k] * part


@njit(**BARE)
def _compare(image, y, first, end, of_row, above):
    """Compare a row of pixels in some tiles with the threshold, linear between the centres of tiles."""
    whole = image.shape[1] >> 3
    for column in range(first, min(end, whole)):
        middle = of_row[column + 1]
        left, right = (middle - of_row[column]) / 8, (of_row[column + 2] - middle) / 8
        x0 = column * 8
        for k in range(4):
            above[x0 + k] = image[y, x0 + k] > middle + left * np.float32(k - 3.5)
        for k in range(4, 8):
            above[x0 + k] = image[y, x0 + k] > middle + right * np.float32(k - 3.5)
    for x in range(max(first, whole) * TILE_PX, min(end * TILE_PX, image.shape[1])):
        above[x] = image[y, x] > of_row[(x >> 3) + 1]


@njit(**BARE)
def _append_runs(words, first_tile, end_tile, width, flat, count):
    """Add where the runs of pixels above the threshold in a span of tiles begin and end; 64 px at once.

    `flat`: the runs, of which each takes four places, the second and third for this.
    """
    edges, inside = 2 * count, _ONE - _ONE
    for tile in range(first_tile, end_tile, 8):
        bits = _ONE - _ONE
        for k in range(min(end_tile - tile, 8)):
            bits |= ((words[tile + k] * _PACK) >> _TOP_BYTE) << np.uint64(8 * k)
        changes = bits ^ ((bits << _ONE) | inside)
        inside = bits >> _LAST_BIT
        while changes:
            lowest = changes & (~changes + _ONE)
            changes ^= lowest
            flat[(edges >> 1) * 4 + 1 + (edges & 1)] = tile * 8 + _WHICH[(lowest * _TIMES) >> _TOP_SIX]
            edges += 1
    if edges & 1:
        flat[(edges >> 1) * 4 + 2] = min(end_tile * 8, width)
        edges += 1
    return edges >> 1


@njit(**BARE)
def _root(parent, label):
    while parent[label] != label:
        parent[label] = parent[parent[label]]
        label = parent[label]
    return label


@njit(**BARE)
def _link_runs(runs, previous, previous_end, start, end, parent, areas, labels):
    """Give the runs start..end the labels of the runs of the row before that they overlap; returns the labels used."""
    if start == end:
        return labels
    if previous < previous_end and runs[previous, 0] != runs[start, 0] - 1:
        previous = previous_end
    for run in range(start, end):
        first, last = runs[run, 1], runs[run, 2]
        label = -1
        while previous < previous_end and runs[previous, 2] <= first:
            previous += 1
        above = previous
        while above < previous_end and runs[above, 1] < last:
            root = _root(parent, runs[above, 3])
            if label < 0:
                label = root
            elif root != label:
                parent[max(root, label)] = min(root, label)
                label = min(root, label)
            above += 1
        if label < 0:
            label = labels
            parent[label], areas[label] = label, 0
            labels += 1
        runs[run, 3] = label
        areas[label] += last - first if last - first <= LONGEST_RUN else _VAST
        areas[label] = min(areas[label], _VAST)
    return labels


@njit(**BARE)
def _add_run(image, runs, run, threshold, sums):
    y, first, end, label = runs[run, 0], runs[run, 1], runs[run, 2], runs[run, 3]
    pixels = end - first
    x_sum = pixels * (first + end - 1) * 0.5
    light, light_x, peak = np.float32(0), np.float32(0), image[y, first]
    for x in range(first, end):
        excess = max(image[y, x] - threshold, np.float32(0))
        light += excess
        light_x += excess * np.float32(x - first)
        peak = max(peak, image[y, x])
    if sums[label, AREA] == 0:
        sums[label, THRESHOLD] = threshold
    sums[label, AREA] += pixels
    sums[label, X] += x_sum
    sums[label, Y] += pixels * y
    sums[label, XX] += _sum_of_squares(end) - _sum_of_squares(first)
    sums[label, XY] += x_sum * y
    sums[label, YY] += pixels * y * y
    sums[label, LIGHT] += light
    sums[label, LIGHT_X] += light_x + light * first
    sums[label, LIGHT_Y] += light * y
    sums[label, PEAK] = max(sums[label, PEAK], peak)


@njit(**BARE)
def _sum_of_squares(n):
    """0^2 + 1^2 + ... + (n - 1)^2."""
    return (n - 1) * n * (2.0 * n - 1) / 6


@njit(**KERNEL)
def _gather(parent, areas, labels, least):
    """Add every joined label to its root and flatten `parent`; components of the labels, and how many are kept."""
    for label in range(labels):
        root = _root(parent, label)
        parent[label] = root
        if root != label:
            areas[root] = min(areas[root] + areas[label], _VAST)
    component, kept = np.empty(labels, np.int32), 0
    for label in range(labels):
        root = parent[label]
        if root != label:
            component[label] = component[root]
        elif areas[label] >= least:
            component[label] = kept
            kept += 1
        else:
            component[label] = -1
    return component, kept
