"""Bright blobs of an image: where dots may be, found by thresholds relative to the local contrast.

The image is cut in tiles of 8 x 8 px. A threshold is a fraction of the way from the darkest to the brightest pixel
around a tile, interpolated between tiles, so that nothing depends on exposure. The lowest of several thresholds is
applied wherever there is contrast, the higher ones only where components do not yet look like single dots: that
separates dots that blur joins. A copy of half the size serves large dots.
"""

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.kernels import BARE, KERNEL, njit
from spherecal.targets import components as parts
from spherecal.targets.components import TILE_PX, label_components, tile_extremes
from spherecal.targets.ignored_regions import sticker_regions
from spherecal.targets.looks import Looks, joined, looks_of

GreyImage = NDArray[np.uint8] | NDArray[np.uint16]

_AROUND = 9  # tiles: darkest and brightest of 72 px, a sticker of 3 MP images: at its rim dots still set the level

# Fractions of the local contrast. One level at 0.5 misses the dots beside a highlight and merges dots beyond 60
# degrees; six levels found as much as ten.
_LEVELS = (0.16, 0.32, 0.48, 0.64, 0.78, 0.9)
# Where texture leaves more than this part of the image's tiles for the next level, that is tried only around blobs that
# have so many others like them within a sticker's reach. The stress table's images leave less but for glaring light. If
# it were done there all the same, the last three levels would lose none of 3,300 targets, the third 14, which blur or
# grey paper separates from there on only.
_TEXTURED = 0.1
_LEAST_ALIKE = (0, 0, 1, 2, 2, 2)
_LEAST_NOISE_RATIO = 10.0  # contrast / noise: the range of 1600 px of pure noise is 6.6 standard deviations
_LEAST_WEBER = 0.25  # contrast / brightness above black: shot noise of a bright wall stays below 0.15
_LEAST_RANGE = 3.2  # the smallest range of the 64 px of a tile among 81 tiles of noise, in standard deviations

_LEAST_AREA_PX = 5
_FILL_TOLERANCE = (0.16, 0.9)  # |area / area of the ellipse with its moments - 1| < first + second / area
_LARGEST_AXIS_PX = 24.0  # three tiles: larger dots are found in the copy of half the size
_SMALLEST_COARSE_AXIS_PX = 8.0
# What looks like one dot of at most twice that size, and is not so narrow that it may be two side by side, is left to
# that copy whole: taken apart with higher levels, a dot of 30 px in uneven light leaves its bright half as a dot.
_SHORTEST_LARGE_AXIS_PX = 14.0
_LEAST_HEIGHT = 0.1  # over the threshold, as part of the local contrast: lower parts are noise
# Difference of light in 24 px, as part of the local contrast, from which on a place that lies all above a threshold is
# looked at again with the next: grey paper between white dots. The ball's own grey has less; with it in, the time goes
# up by half.
_LIVELY = 0.6
_LEAST_DOME = 0.75  # height over the threshold at the centroid / peak; two joined dots have a saddle there
# from rows u v xx xy yy area peak of the copy of half the size to those of the image
_HALF_SCALE, _HALF_SHIFT = np.array([2.0, 2.0, 4.0, 4.0, 4.0, 4.0, 1.0]), np.array([0.5, 0.5, 0, 0, 0, 0, 0])
_SMALLEST_IMAGE_PX = 2 * TILE_PX  # two tiles; no sticker fits in less

_ONE, _ALL, _EVEN = np.uint64(1), np.uint64(0xFF), np.uint64(0x55)  # pixels of a tile's row as bits

# what a component is: too low or small for anything, one dot, something that higher levels may take apart, or one dot
# that is too large for this size of the image
_NOTHING, _DOT, _COMPOUND, _LARGE = 0, 1, 2, 3


@dataclass(frozen=True)
class Blobs:
    """Elliptic blobs: `uv` (n, 2) px, `moments` (n, 3) px^2 central xx xy yy; `looks`: areas, contrasts and so on."""

    uv: FloatArray
    moments: FloatArray
    looks: Looks

    def __len__(self) -> int:
        return len(self.uv)


def find_blobs(image: GreyImage, dark: bool = False) -> Blobs:
    """All bright (or dark) blobs of about 3 to 45 px in an image, in pixels of that image.

    `image`: grey image, (h, w).
    """
    if min(image.shape) < _SMALLEST_IMAGE_PX:
        return _described(np.zeros((0, 7)), looks_of(image, np.zeros((0, 7))))
    if dark:
        image = np.bitwise_not(image)
    dots = np.zeros((2, *_tiles(image)), np.uint64)
    everywhere, taken = np.ones(_tiles(image), dtype=bool), np.zeros(_tiles(image), dtype=bool)
    found = _Found(image, np.empty((0, 7)))
    compounds = _blobs_of_one_size(found, dark, everywhere, taken, dots, 0)
    fine, looks = found.rows(), found.looks()
    # larger dots are compounds at this size; in an image of half the size they fit
    small = cv2.resize(image, (image.shape[1] // 2, image.shape[0] // 2), interpolation=cv2.INTER_AREA)
    half = cast(GreyImage, small)
    compounds, taken = _halved(compounds, _tiles(half)), _halved(taken, _tiles(half))
    found = _Found(half, (fine - _HALF_SHIFT) / _HALF_SCALE)
    _blobs_of_one_size(found, dark, compounds, taken, dots, 1)
    coarse = found.rows()[len(fine) :] * _HALF_SCALE + _HALF_SHIFT
    return _described(np.concatenate([fine, coarse]), joined([looks, looks_of(image, coarse)]))


def _described(rows: FloatArray, looks: Looks) -> Blobs:
    # contiguous: the search for groups reads them often
    uv, moments = np.ascontiguousarray(rows[:, 0:2]), np.ascontiguousarray(rows[:, 2:5])
    return Blobs(uv, moments, looks)


class _Found:
    """Rows u v xx xy yy area peak of the blobs of an image, level by level, and their looks, worked out once."""

    def __init__(self, image: GreyImage, known: FloatArray) -> None:
        self.image = image
        self._rows, self._looks = [known], list[Looks]()

    def add(self, rows: FloatArray) -> None:
        """Blobs of a further level."""
        self._rows.append(rows)

    def rows(self) -> FloatArray:
        """All rows (n, 7), those known before first."""
        return np.concatenate(self._rows)

    def looks(self) -> Looks:
        """The looks of all rows."""
        self._looks += [looks_of(self.image, rows) for rows in self._rows[len(self._looks) :]]
        return joined(self._looks)


def _digit(ranges: NDArray[Any]) -> int:
    """The step between grey values: 1, or more where the camera's digits are the high bits of the file's.

    Noise below it shows only now and then, so that a range of k steps may mean up to k + 1. Without that, a dark
    background of two or three grey values passes for contrast and takes half of the time.
    """
    bits = int(np.bitwise_or.reduce(ranges, axis=None))
    return bits & -bits or 1


def _tiles(image: GreyImage) -> tuple[int, int]:
    return -(-image.shape[0] // TILE_PX), -(-image.shape[1] // TILE_PX)


def _blobs_of_one_size(
    found: _Found, negative: bool, tiles: BoolArray, taken: BoolArray, dots: NDArray[np.uint64], halvings: int
) -> BoolArray:
    """Add to `found` the blobs in the given tiles of its image; returns those that an image of half the size is for.

    `dots` marks pixels of dots, and of large ones, known already in the image before its `halvings`, as the bits of
    their tiles: a byte for each pixel would be new memory of the image's size. `taken` marks their tiles in this image.
    Both get those of the new blobs.
    """
    image = found.image
    darkest, brightest = tile_extremes(image)
    window = np.ones((_AROUND, _AROUND), np.uint8)
    dark = cv2.erode(darkest, window).astype(np.float32)
    contrast = cv2.dilate(brightest, window).astype(np.float32) - dark
    light = float(brightest.max()) - dark if negative else dark + contrast - float(darkest.min())
    ranges = brightest - darkest
    noise = (cv2.erode(ranges, window) + np.float32(_digit(ranges))) / np.float32(_LEAST_RANGE)
    rest = tiles & (contrast > _LEAST_NOISE_RATIO * noise) & (contrast > _LEAST_WEBER * light)
    around = np.ones((3, 3), np.uint8)
    dark_near, bright_near = cv2.erode(darkest, around), cv2.dilate(brightest, around)
    lively = rest & (bright_near - dark_near > _LIVELY * contrast)
    bright_near = bright_near - _LEAST_HEIGHT * contrast
    most_area = int(_LARGEST_AXIS_PX**2) * (1 if halvings else 4)
    smallest_axis = _SMALLEST_COARSE_AXIS_PX if halvings else 0.0
    compounds = np.zeros_like(rest)
    for level, alike in zip(_LEVELS, _LEAST_ALIKE, strict=True):
        if alike and np.count_nonzero(rest) / rest.size > _TEXTURED:
            rest &= sticker_regions(found.rows(), found.looks(), rest.shape, alike)
        active = np.empty_like(rest)
        count = _activate(rest, lively, level, dark, contrast, brightest, bright_near, dark_near, active)
        sums, runs = label_components(image, dark, contrast, level, active, _LEAST_AREA_PX, most_area, 36 * count + 64)
        rows, state = _select(image, taken, dots, halvings, runs, sums, most_area, contrast, smallest_axis)
        found.add(rows)
        _mark(runs, state, rest, compounds if level == _LEVELS[0] else np.empty_like(rest), taken, dots, halvings)
    return compounds


@njit(**BARE)
def _activate(rest, lively, level, dark, contrast, brightest, bright_near, dark_near, active):
    """Find which tiles of `rest` a level's threshold may cut, and leave in `rest` the lively ones above it.

    Returns the number of active tiles. One pass over arrays of tiles in place of fifteen: a sixth of the time.
    """
    count, part = 0, np.float32(level)
    for row in range(rest.shape[0]):
        left = 0
        for column in range(rest.shape[1]):
            left += rest[row, column] | lively[row, column]
        if left == 0:
            for column in range(rest.shape[1]):
                active[row, column] = False
            continue
        for column in range(rest.shape[1]):
            at = dark[row, column] + part * contrast[row, column]
            below, cut = dark_near[row, column] <= at, rest[row, column]
            cut &= (brightest[row, column] > at) & (bright_near[row, column] > at) & below
            active[row, column] = cut
            rest[row, column] = lively[row, column] & (not below)
            count += cut
    return count


def _halved(tiles: BoolArray, shape: tuple[int, int]) -> BoolArray:
    """Tiles of the image of half the size of which any part is set, and those around them."""
    padded = np.zeros((2 * shape[0], 2 * shape[1]), np.uint8)
    rows, columns = min(tiles.shape[0], padded.shape[0]), min(tiles.shape[1], padded.shape[1])
    padded[:rows, :columns] = tiles[:rows, :columns]
    rows_halved = padded[::2] | padded[1::2]
    grown = cv2.dilate(rows_halved[:, ::2] | rows_halved[:, 1::2], np.ones((3, 3), np.uint8))
    return np.asarray(grown, dtype=bool)


@njit(**BARE)
def _mark(runs, state, rest, larger, taken, dots, halvings):
    """Mark dots' pixels, and tiles: of compounds in `rest`, of these and large dots in `larger`, of dots in `taken`."""
    for run in range(len(runs)):
        if runs[run, 3] < 0:
            continue
        row, of_run = runs[run, 0], state[runs[run, 3]]
        if of_run != _NOTHING:
            for column in range(runs[run, 1] >> 3, ((runs[run, 2] - 1) >> 3) + 1):
                if of_run == _COMPOUND:
                    rest[row >> 3, column] = True
                else:
                    taken[row >> 3, column] = True
                if of_run != _DOT:
                    larger[row >> 3, column] = True
            if of_run != _COMPOUND:
                of_kind = dots[1 if of_run == _LARGE else 0, (row << halvings) >> 3]
                for tile in range(runs[run, 1] << halvings >> 3, ((runs[run, 2] - 1) << halvings >> 3) + 1):
                    of_kind[tile] |= _bits(row, runs[run, 1], runs[run, 2], tile, halvings)


@njit(**KERNEL)
def _select(image, taken, dots, halvings, runs, sums, most_area, contrast, smallest_axis):
    """Rows u v xx xy yy area peak of the components that look like one dot, and what each component is."""
    rows = np.empty((len(sums), 7))
    state = np.full(len(sums), _COMPOUND, np.int8)
    known = _known(runs, taken, dots, halvings, len(sums))
    count = 0
    for label in range(len(sums)):
        if sums[label, parts.AREA] <= most_area:
            # what shares pixels with a dot is its top, or in the coarse image several dots in one
            state[label] = (
                _NOTHING
                if known[label]
                else _describe(image, sums[label], contrast, smallest_axis, halvings == 0, rows[count])
            )
            count += state[label] == _DOT
    return rows[:count].copy(), state


@njit(**KERNEL)
def _known(runs, taken, dots, halvings, labels):
    """Which components share pixels with a dot that a lower level, or the finer image, has found.

    Large dots of the finer image are not found yet.
    """
    known = np.zeros(labels, np.bool_)
    for run in range(len(runs)):
        if runs[run, 3] < 0:
            continue
        row, start, end = runs[run, 0], runs[run, 1], runs[run, 2]
        if not known[runs[run, 3]] and (taken[row >> 3, start >> 3] or taken[row >> 3, (end - 1) >> 3]):
            tile_row = (row << halvings) >> 3
            for tile in range(start << halvings >> 3, ((end - 1) << halvings >> 3) + 1):
                marked = dots[0, tile_row, tile] | (dots[1, tile_row, tile] if halvings == 0 else np.uint64(0))
                if marked & _bits(row, start, end, tile, halvings):
                    known[runs[run, 3]] = True
                    break
    return known


@njit(**BARE)
def _bits(row, start, end, tile, halvings):
    """The bits in a tile of the pixels of a run, of every other one where these are those of the image halved."""
    first, last = max((start << halvings) - tile * TILE_PX, 0), min((end << halvings) - tile * TILE_PX, TILE_PX)
    bits = ((_ONE << np.uint64(last)) - (_ONE << np.uint64(first))) & (_EVEN if halvings else _ALL)
    return bits << np.uint64(((row << halvings) & 7) << 3)


@njit(**BARE)
def _describe(image, part, contrast, smallest_axis, with_large, row):
    """What a component of moderate area is; fills its row if it is one dot."""
    area = part[parts.AREA]
    x, y = part[parts.X] / area, part[parts.Y] / area
    height = part[parts.PEAK] - part[parts.THRESHOLD]
    if height < _LEAST_HEIGHT * contrast[int(y) >> 3, int(x) >> 3] or part[parts.LIGHT] <= 0:
        return _NOTHING
    # the moments of pixels as squares
    xx, xy = part[parts.XX] / area - x * x + 1 / 12, part[parts.XY] / area - x * y
    yy = part[parts.YY] / area - y * y + 1 / 12
    fill = area / (4 * np.pi * np.sqrt(max(xx * yy - xy * xy, 1e-9)))
    if abs(fill - 1) > _FILL_TOLERANCE[0] + _FILL_TOLERANCE[1] / area:
        return _COMPOUND
    half, root = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    axis = 4 * np.sqrt(half + root)
    large = axis > _LARGEST_AXIS_PX
    if axis < smallest_axis or (large and not (with_large and 16 * (half - root) > _SHORTEST_LARGE_AXIS_PX**2)):
        return _COMPOUND
    x, y = part[parts.LIGHT_X] / part[parts.LIGHT], part[parts.LIGHT_Y] / part[parts.LIGHT]
    if _brightest_of_four(image, x, y) - part[parts.THRESHOLD] < _LEAST_DOME * height:
        return _COMPOUND
    if large:
        return _LARGE if axis <= 2 * _LARGEST_AXIS_PX else _COMPOUND
    row[0], row[1], row[2], row[3], row[4], row[5], row[6] = x, y, xx, xy, yy, area, part[parts.PEAK]
    return _DOT


@njit(**BARE)
def _brightest_of_four(image, x, y):
    """The brightest of the four pixels around a place."""
    column, row = min(int(x), image.shape[1] - 2), min(int(y), image.shape[0] - 2)
    best = image[row, column]
    best = max(best, image[row, column + 1])
    best = max(best, image[row + 1, column])
    return float(max(best, image[row + 1, column + 1]))
