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
_NONE, _ALL = np.uint64(0), np.uint64(0x0101010101010101)  # none and all of eight pixels above the threshold
_TOP_BYTE = np.uint64(56)
_PACK = np.uint64(0x0102040810204080)  # times eight bytes of 0 or 1: their bits, the first pixel the lowest, on top
# at which of a tile's eight pixels bits are set, and how many
_SET = [[k for k in range(8) if bits >> k & 1] for bits in range(256)]
_CHANGES = np.array([[*places, *[0] * (8 - len(places)), len(places)] for places in _SET], dtype=np.uint8)


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
def label_components(image, threshold, active, least, most, most_runs):
    """Components above a threshold in the active tiles: sums (n, 11), and runs (m, 4) row x0 x1 component.

    Most of a textured image is in components that are too small or too large. Of these little or nothing is kept.

    `image`: grey image, (h, w).
    """
    height, width = image.shape
    tile_rows, columns = threshold.shape
    parent, areas = np.empty(most_runs, np.int32), np.empty(most_runs, np.int32)
    runs = np.empty((most_runs, 4), np.int32)  # memory that is never touched costs nothing
    levels = np.empty(most_runs, np.float32)
    of_row = np.empty(columns + 2, np.float32)
    above = np.zeros(columns * TILE_PX, np.bool_)
    words = above.view(np.uint64)  # one for the row of a tile
    spans = np.empty((columns, 2), np.int64)
    previous_start, previous_end, count, labels = 0, 0, 0, 0
    for tile_row in range(tile_rows):
        many = _find_spans(active[tile_row], spans)
        if many == 0:
            continue
        for y in range(tile_row * TILE_PX, min(tile_row * TILE_PX + TILE_PX, height)):
            start = count
            for span in range(many):
                first, end = spans[span]
                _threshold_of_row(threshold, y, first, end, of_row)
                for column in range(first, min(end, width >> 3)):
                    _compare_tile(image, y, column, of_row, above)
                for x in range(max(first, width >> 3) * TILE_PX, min(end * TILE_PX, width)):
                    above[x] = image[y, x] > of_row[(x >> 3) + 1]
                count = _append_runs(words, y, first, end, width, runs, count)
            for run in range(start, count):
                levels[run] = of_row[(runs[run, 1] >> 3) + 1]
            labels = _link_runs(runs, previous_start, previous_end, start, count, parent, areas, labels)
            previous_start, previous_end = start, count
    component, kept = _gather(parent, areas, labels, least)
    sums = np.zeros((kept, _SUMS))
    for run in range(count):
        label = runs[run, 3]
        number = component[label]
        runs[run, 3] = number
        if number >= 0:
            area = areas[parent[label]]
            if area > most:
                sums[number, AREA] = area
            else:
                _add_run(image, runs, run, levels[run], sums)
    return sums, runs[:count]


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
def _threshold_of_row(threshold, y, first, end, of_row):
    """Thresholds in row y at the middles of the tiles first - 1 to end, into `of_row`, where tile k is at k + 1."""
    rows, columns = threshold.shape
    row = y >> 3
    part = np.float32((y - row * 8 - 3.5) / 8)
    other = min(max(row + 1 if part > 0 else row - 1, 0), rows - 1)
    part = abs(part)
    for k in range(first - 1, end + 1):
        column = min(max(k, 0), columns - 1)
        of_row[k + 1] = threshold[row, column] * (1 - part) + threshold[other, column] * part


@njit(**BARE)
def _compare_tile(image, y, column, of_row, above):
    """Compare the 8 px of a tile's row with the threshold, linear between the centres of tiles."""
    middle = of_row[column + 1]
    left, right = (middle - of_row[column]) / 8, (of_row[column + 2] - middle) / 8
    x0 = column * 8
    for k in range(4):
        above[x0 + k] = image[y, x0 + k] > middle + left * np.float32(k - 3.5)
    for k in range(4, 8):
        above[x0 + k] = image[y, x0 + k] > middle + right * np.float32(k - 3.5)


@njit(**BARE)
def _append_runs(words, y, first_tile, end_tile, width, runs, count):
    """Add the runs of pixels above the threshold in a span of tiles; tiles of one kind are passed over whole."""
    inside = 0  # whether a run is open
    for tile in range(first_tile, end_tile):
        word = words[tile]
        if word == (_ALL if inside else _NONE):
            continue
        bits = np.int64((word * _PACK) >> _TOP_BYTE)
        changes = _CHANGES[(bits ^ ((bits << 1) | inside)) & 0xFF]
        for k in range(changes[8]):
            if inside:
                runs[count, 2] = tile * 8 + changes[k]
                count += 1
            else:
                runs[count, 0], runs[count, 1] = y, tile * 8 + changes[k]
            inside = 1 - inside
    if inside:
        runs[count, 2] = min(end_tile * 8, width)
        count += 1
    return count


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
