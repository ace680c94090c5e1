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
_SQUARES = np.append(0.0, np.cumsum(np.arange(LONGEST_RUN) ** 2.0))  # of 0 to n - 1
_VAST = 1 << 28  # px: the area of a component with a longer run
_TOP_BYTE = np.uint64(56)
_PACK = np.uint64(0x0102040810204080)  # times eight bytes of 0 or 1: their bits, the first pixel the lowest, on top
# Which bit of 64 is the only one set: its product with a sequence of de Bruijn has a number of its own in its top bits.
_SEQUENCE, _TOP_SIX = 0x022FDD63CC95386D, np.uint64(58)
_WHICH = np.zeros(64, np.int64)
_WHICH[[(_SEQUENCE << bit & 2**64 - 1) >> 58 for bit in range(64)]] = np.arange(64)
_TIMES, _NONE, _ONE, _LAST_BIT = np.uint64(_SEQUENCE), np.uint64(0), np.uint64(1), np.uint64(63)


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
    height = len(image)
    tile_rows, columns = active.shape
    parent, areas = np.empty(most_runs, np.int32), np.empty(most_runs, np.int32)
    runs = np.empty((most_runs, 4), np.int32)  # memory that is never touched costs nothing
    flat, levels = runs.reshape(most_runs * 4), np.empty(2 * most_runs, np.float32)
    tiles, places = np.empty(columns + 2, np.int64), np.empty(columns, np.int64)
    of_tiles, of_row = np.empty((3, columns + 2), np.float32), np.empty(columns + 2, np.float32)
    above = np.empty((columns + 2) * TILE_PX, np.bool_)
    words = above.view(np.uint64)  # one for the row of a tile
    previous_start, previous_end, count, labels = 0, 0, 0, 0
    for tile_row in range(tile_rows):
        entries, many = _find_tiles(active[tile_row], tiles, places)
        if many == 0:
            continue
        _thresholds_of_tiles(dark, contrast, np.float32(level), tile_row, tiles[:entries], of_tiles)
        words[:entries] = _NONE
        for y in range(tile_row * TILE_PX, min(tile_row * TILE_PX + TILE_PX, height)):
            start = count
            _thresholds_of_row(of_tiles, y, entries, of_row)
            _compare(image[y], tiles, places[:many], of_row, above)
            count = _append_runs(words[:entries], tiles, of_row, flat, levels, count)
            for run in range(start, count):
                runs[run, 0] = y
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
                _add_run(image, runs, run, levels[2 * run], sums)


@njit(**BARE)
def _find_tiles(active, tiles, places):
    """The active tiles of a row of tiles and those beside them, into `tiles`, and which of them are active.

    Returns the numbers of both. The first and the last may be beyond the image. Rows of pixels are worked on in one go,
    not by spans of tiles: most have fewer than five tiles.
    """
    entries, many, columns = 0, 0, len(active)
    for column in range(-1, columns + 1):
        inside = 0 <= column < columns and active[column]
        if inside:
            places[many] = entries
            many += 1
        if inside or (column + 1 < columns and active[column + 1]) or (column > 0 and active[column - 1]):
            tiles[entries] = column
            entries += 1
    return entries, many


@njit(**BARE)
def _thresholds_of_tiles(dark, contrast, level, tile_row, tiles, of_tiles):
    """Thresholds of some tiles of a row of tiles, of those above and of those below them, (3, n)."""
    rows, columns = dark.shape
    for line in range(3):
        row = min(max(tile_row + line - 1, 0), rows - 1)
        for k in range(len(tiles)):
            column = min(max(tiles[k], 0), columns - 1)
            of_tiles[line, k] = dark[row, column] + level * contrast[row, column]


@njit(**BARE)
def _thresholds_of_row(of_tiles, y, entries, of_row):
    """Thresholds in row y at the middles of tiles."""
    part = np.float32(((y & 7) - 3.5) / 8)
    other = 2 if part > 0 else 0
    part = abs(part)
    for k in range(entries):
        of_row[k] = of_tiles[1, k] * (1 - part) + of_tiles[other, k] * part


@njit(**BARE)
def _compare(line, tiles, places, of_row, above):
    """Compare a row of pixels in the active tiles with the threshold, linear between the centres of tiles."""
    many, whole = len(places), len(line) >> 3
    last = places[many - 1]
    if tiles[last] == whole:  # a part of a tile
        many -= 1
        for x in range(whole * TILE_PX, len(line)):
            above[last * TILE_PX + (x & 7)] = line[x] > of_row[last]
    for n in range(many):
        k = places[n]
        middle = of_row[k]
        left, right = (middle - of_row[k - 1]) / 8, (of_row[k + 1] - middle) / 8
        pixels, out = line[tiles[k] * 8 : tiles[k] * 8 + 8], above[k * 8 : k * 8 + 8]
        for x in range(4):
            out[x] = pixels[x] > middle + left * np.float32(x - 3.5)
        for x in range(4, 8):
            out[x] = pixels[x] > middle + right * np.float32(x - 3.5)


@njit(**BARE)
def _append_runs(words, tiles, of_row, flat, levels, count):
    """Add where the runs of pixels above the threshold begin and end, and their levels; 64 px at once.

    `flat`: the runs, of which each takes four places, the second and third for this; `levels` two for each run.
    """
    edges, inside = 2 * count, _NONE
    for first in range(0, len(words), 8):
        bits = _NONE
        for k in range(first, min(first + 8, len(words))):
            bits |= ((words[k] * _PACK) >> _TOP_BYTE) << np.uint64(8 * (k - first))
        changes = bits ^ ((bits << _ONE) | inside)
        inside = bits >> _LAST_BIT
        while changes:
            lowest = changes & (~changes + _ONE)
            changes ^= lowest
            bit = _WHICH[(lowest * _TIMES) >> _TOP_SIX]
            tile = first + (bit >> 3)
            flat[(edges >> 1) * 4 + 1 + (edges & 1)], levels[edges] = tiles[tile] * 8 + (bit & 7), of_row[tile]
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
    sums[label, XX] += pixels * first * (end - 1.0) + _SQUARES[pixels]
    sums[label, XY] += x_sum * y
    sums[label, YY] += pixels * y * y
    sums[label, LIGHT] += light
    sums[label, LIGHT_X] += light_x + light * first
    sums[label, LIGHT_Y] += light * y
    sums[label, PEAK] = max(sums[label, PEAK], peak)


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
