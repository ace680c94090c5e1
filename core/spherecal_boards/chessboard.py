"""The inner corners of a chessboard in one image: OpenCV's two finders at two sizes, then a fit of each corner."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from spherecal.base.arrays import FloatArray
from spherecal_boards.board_pattern import BoardPattern

# Half a window in squares: the larger, the less noise, and beyond 0.5 is the next corner. In px: 30 leave 0.081 px
# where 20 leave 0.094 (squares of 53 to 144 px), and more costs more than it gains.
_WINDOW, _LEAST_PX, _MOST_PX = 0.42, 3, 30
_STEPS, _STILL_PX = 6, 0.003  # from starts that are off by 1.6 px: within 0.002 px of the end
_BLUR_PX = 1.2  # at the start
_MOST_STEP = np.array([1.5, 1.5, 0.2, 0.2, 0.5])  # px, px, rad, rad, px
_AT_ONCE = 16  # corners whose windows fit in the processor's cache
_PLACE, _ALL = 5, 9  # terms: x, y, two directions, blur; then mean, contrast and the fall of light along x and y


def fit_corners(image: NDArray[np.uint8], start: FloatArray, square_px: float) -> FloatArray:
    """The corners (rows, columns, 2) px near `start`; `square_px`: the shortest side of a square."""
    half = int(np.clip(_WINDOW * square_px, _LEAST_PX, _MOST_PX))
    edges = [np.gradient(start, axis=axis).reshape(-1, 2) for axis in (1, 0)]
    normals = np.column_stack([np.arctan2(edge[:, 0], -edge[:, 1]) for edge in edges])
    around = np.asarray(cv2.copyMakeBorder(image, half, half, half, half, cv2.BORDER_REPLICATE), dtype=np.uint8)
    centres = start.reshape(-1, 2)
    parts = [slice(at, at + _AT_ONCE) for at in range(0, len(centres), _AT_ONCE)]
    return np.concatenate([_fit(around, half, centres[part], normals[part]) for part in parts]).reshape(start.shape)


def _fit(around: NDArray[np.uint8], half: int, centres: FloatArray, normals: FloatArray) -> FloatArray:
    """Some corners (k, 2) px by Gauss-Newton steps; `normals`: of both edges, (k, 2) rad."""
    v, u = (axis.ravel() for axis in np.mgrid[-half : half + 1, -half : half + 1])
    inside = u**2 + v**2 <= (half + 0.5) ** 2
    u, v = u[inside], v[inside]
    root = np.exp(-(u**2 + v**2) / (4 * (half / 1.6) ** 2))  # of the weight: the middle counts most
    height, width = around.shape
    at = np.clip(np.rint(centres), 0, (width - 2 * half - 1, height - 2 * half - 1)).astype(int)
    grey = root * around[at[:, 1:] + half + v, at[:, :1] + half + u]
    x = np.column_stack([centres - at, normals, np.full(len(at), _BLUR_PX)])
    terms = np.empty((*grey.shape, _ALL))
    terms[:, :, 5], terms[:, :, 7], terms[:, :, 8] = root, u * root, v * root
    for _ in range(_STEPS):
        across, along, blur = u - x[:, :1], v - x[:, 1:2], x[:, 4:]
        cos, sin = np.cos(x[:, 2:4, None]), np.sin(x[:, 2:4, None])
        off = (across[:, None] * cos + along[:, None] * sin) / blur[:, None]  # from both edges, in blurs
        side = erf(off)
        terms[:, :, 6] = root * side[:, 0] * side[:, 1]
        levels = _solved(terms[:, :, _PLACE:], grey)
        left = grey - (terms[:, :, _PLACE:] @ levels[:, :, None])[:, :, 0]
        slope = 2 / np.sqrt(np.pi) * np.exp(-(off**2)) * side[:, ::-1] * (root * levels[:, 1:2] / blur)[:, None]
        terms[:, :, 0], terms[:, :, 1] = -(slope * cos).sum(axis=1), -(slope * sin).sum(axis=1)
        turned = slope * (along[:, None] * cos - across[:, None] * sin)
        terms[:, :, 2], terms[:, :, 3], terms[:, :, 4] = turned[:, 0], turned[:, 1], -(slope * off).sum(axis=1)
        step = _solved(terms, left)[:, :_PLACE]
        x += np.clip(step, -_MOST_STEP, _MOST_STEP)
        x[:, 4] = np.clip(x[:, 4], 0.5, half / 1.5)
        if np.abs(step[:, :2]).max() < _STILL_PX:
            break
    return np.asarray(at + x[:, :2], dtype=float)


def _solved(terms: FloatArray, values: FloatArray) -> FloatArray:
    """Least squares of values (k, n) by terms (k, n, m), slightly damped: (k, m)."""
    turned = terms.transpose(0, 2, 1)
    normal = turned @ terms
    diagonal = range(normal.shape[1])
    normal[:, diagonal, diagonal] = 1.001 * normal[:, diagonal, diagonal] + 1e-9
    return np.asarray(np.linalg.solve(normal, turned @ values[:, :, None])[:, :, 0], dtype=float)


Grey = NDArray[np.uint8]
# Longest sides at which a board is looked for: of 28 close pictures (pose2sim, 1920 px, squares of 150 to 300 px)
# `findChessboardCornersSB` finds 12 as they are and 26 at 1200; at 640 it finds none of two (ucl) and both at 500.
# Squares of 17 px in 1920 are too small at 1200: those are found in the larger image, or nowhere.
_SIDES = (1200, 2600, 500)
# Neither finder is enough, nor is one setting: normalised images lose all 95 of a bright board in a dark hall, the
# others both of ucl. In the order of their seconds at 1200 px: 0.03, 0.11, 0.12. None: the older finder.
_SETTINGS = (None, cv2.CALIB_CB_EXHAUSTIVE, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE)
_OLD = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
_SQUARE_PX = 40  # to which larger squares are made smaller for the finder of saddles: it costs by the pixel
_MARGIN = 2.0  # squares around the corners that the finder needs
# Of a square's side: a board whose corners are off a smooth grid by more (rms) is none. Right ones of 71 photographs
# are within 0.012, those of lenses of 150 degrees within 0.03.
ROUGH = 0.08
_WORSE = 1.5  # times off the grid: by 1.04 the fit left cameras alone 0.081 px, what it was fitted from 0.091
# In a larger board the finders see a smaller one, a part of it or every second row. Of the places of 49 whole boards
# on photographs 0.78 and more are corners and at most 0.11 of those beyond a side; of 13 grids of 6 x 9 seen in boards
# of 14 x 19 at most 0.08 are corners, or all beyond a side.
_CORNERS = 0.5
_UNLIKE = 0.5  # of the contrast at a corner: opposite squares of one colour differ by less, a square and paper by 1
_FAINT = 0.2  # of the contrast of the whole board: less between neighbours is no corner
_LEAST_SHOWN = 3  # places
_LEAST_CORNERS = (3, 3)  # of a board of unknown size
_ORDER = 4  # of the polynomial for lens and paper


def find_chessboard(image: Grey, pattern: BoardPattern) -> FloatArray | None:
    """The corners (rows, columns, 2) px in the board's order; None where the board is not seen whole."""
    for coarse in _coarse(image, (pattern.columns, pattern.rows)):
        saddles = _saddles(image, coarse)  # the older finder may be off by several px
        start = min([coarse] if saddles is None else [coarse, saddles], key=off_grid_px)
        fitted = fit_corners(image, start, square_px(start))
        grid = _upright(image, fitted if off_grid_px(fitted) <= _WORSE * off_grid_px(start) else start, pattern)
        if off_grid_px(grid) <= ROUGH * square_px(grid):
            return grid if is_whole_board(image, grid) else None  # another board: its size is seen once only
    return None


def _coarse(image: Grey, size: tuple[int, int]) -> Iterator[FloatArray]:
    """Where OpenCV's finders see the board, (rows, columns, 2) px, the quickest first."""
    for scale in dict.fromkeys(min(1.0, side / max(image.shape)) for side in _SIDES):
        resized = image if scale == 1.0 else cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        small = np.asarray(resized, dtype=np.uint8)
        for flags in _SETTINGS:
            found, corners = (
                cv2.findChessboardCorners(small, size, flags=_OLD)
                if flags is None
                else cv2.findChessboardCornersSB(small, size, flags=flags)
            )
            if found and corners is not None:
                yield (np.asarray(corners, dtype=float).reshape(size[1], size[0], 2) + 0.5) / scale - 0.5
        # the rest takes 5 s where another large board is seen
        other = largest_chessboard(small)
        if other is not None and sorted(other.shape[:2]) != sorted(size) and is_whole_board(small, other):
            return


def largest_chessboard(image: Grey) -> FloatArray | None:
    """The corners (rows, columns, 2) px of the largest chessboard that OpenCV's finder of sectors sees in an image."""
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
    for more in (0, cv2.CALIB_CB_NORMALIZE_IMAGE):
        found, corners, meta = cv2.findChessboardCornersSBWithMeta(image, _LEAST_CORNERS, flags | more)
        if found and corners is not None:
            grid = np.asarray(corners, dtype=float).reshape(*np.asarray(meta).shape[:2], 2)
            if grid.size > 2 * np.prod(_LEAST_CORNERS) and off_grid_px(grid) <= ROUGH * square_px(grid):
                return grid
    return None


def _saddles(image: Grey, coarse: FloatArray) -> FloatArray | None:
    """The corners by OpenCV's fit of saddles near the board, made smaller if its squares are large."""
    rows, columns = coarse.shape[:2]
    square = square_px(coarse)
    low = np.maximum(np.floor(coarse.min(axis=(0, 1)) - _MARGIN * square), 0).astype(int)
    high = np.ceil(coarse.max(axis=(0, 1)) + _MARGIN * square).astype(int)
    part = image[low[1] : high[1] + 1, low[0] : high[0] + 1]
    scale = min(1.0, _SQUARE_PX / square)
    if scale < 1:
        part = cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(np.ascontiguousarray(part), (columns, rows), flags=flags)
    if not found or corners is None:
        return None
    grid = (np.asarray(corners, dtype=float).reshape(rows, columns, 2) + 0.5) / scale - 0.5 + low
    return min((grid, grid[::-1, ::-1]), key=lambda g: float(np.abs(g - coarse).max()))


def square_px(grid: FloatArray) -> float:
    """The shortest side of a square in px."""
    return float(min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)))


def off_grid_px(grid: FloatArray) -> float:
    """By how many px (rms) the corners are off a smooth grid: a plane in perspective, bent by a polynomial."""
    rows, columns = grid.shape[:2]
    y, x = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    flat, uv = np.column_stack([x.ravel(), y.ravel()]), grid.reshape(-1, 2)
    seen, _ = cv2.findHomography(flat, uv, 0)
    if seen is None:
        return float("inf")
    p = np.column_stack([flat, np.ones(len(flat))]) @ np.asarray(seen).T
    with np.errstate(divide="ignore", invalid="ignore"):
        bent = uv - p[:, :2] / p[:, 2:]
    order = min(_ORDER, rows - 1, columns - 1)
    terms = np.stack(
        [flat[:, 0] ** i * flat[:, 1] ** j for i in range(order + 1) for j in range(order + 1 - i)], axis=1
    )
    if not np.isfinite(bent).all():
        return float("inf")
    if terms.shape[1] < len(flat):
        bent = bent - terms @ np.linalg.lstsq(terms, bent, rcond=None)[0]
    return float(np.sqrt((bent**2).sum(axis=1).mean()))


def is_whole_board(image: Grey, grid: FloatArray) -> bool:
    """Whether the grid's places are corners and those one square outside of its sides are none."""
    size = max(1, int(square_px(grid) / 4))
    grey = cv2.blur(image, (size, size)).astype(np.float32)
    low, high = grid.min(axis=(0, 1)).astype(int).clip(0), grid.max(axis=(0, 1)).astype(int)
    dark, bright = np.quantile(grey[low[1] : high[1] + 1, low[0] : high[0] + 1], (0.05, 0.95))
    least = _FAINT * float(bright - dark)
    own = (grid, np.gradient(grid, axis=0) / 2, np.gradient(grid, axis=1) / 2)
    if _corners(grey, least, *(one.reshape(-1, 2) for one in own)) < _CORNERS:
        return False
    turned = grid.swapaxes(0, 1)
    beyond = [_corners_beyond(grey, least, side) for side in (grid, grid[::-1], turned, turned[::-1])]
    return max(beyond) < _CORNERS


def _corners_beyond(grey: NDArray[np.float32], least_contrast: float, grid: FloatArray) -> float:
    """The share of corners among the places before the grid's first row."""
    out = grid[0] - grid[1]
    return _corners(grey, least_contrast, grid[0] + out, out / 2, np.gradient(grid[0], axis=0) / 2)


def _corners(
    grey: NDArray[np.float32], least_contrast: float, at: FloatArray, across: FloatArray, along: FloatArray
) -> float:
    """The share of corners among places (k, 2), half a square both ways: opposite squares alike, neighbours not."""
    squares = [at + a * across + b * along for a, b in ((-1, -1), (1, 1), (-1, 1), (1, -1))]
    shown = np.all([((q >= 0) & (q <= np.array(grey.shape[::-1]) - 1)).all(axis=1) for q in squares], axis=0)
    if shown.sum() < _LEAST_SHOWN:
        return 0.0
    u, v = np.stack(squares)[:, shown].astype(np.float32).transpose(2, 0, 1)
    one, facing, other, opposite = cv2.remap(grey, u, v, cv2.INTER_LINEAR)
    contrast = np.abs(one + facing - other - opposite) / 2
    unlike = np.maximum(np.abs(one - facing), np.abs(other - opposite))
    return float(((unlike < _UNLIKE * contrast) & (contrast > least_contrast)).mean())


def _upright(image: Grey, grid: FloatArray, pattern: BoardPattern) -> FloatArray:
    """The corners in the board's order, by orientation and the first square's colour; else columns run rightwards."""
    across, along = grid[:, -1].mean(axis=0) - grid[:, 0].mean(axis=0), grid[-1].mean(axis=0) - grid[0].mean(axis=0)
    if (across[0] * along[1] - across[1] * along[0] < 0) != pattern.rows_upward:
        grid = grid[:, ::-1]
        across = -across
    turned = grid[::-1, ::-1]
    if (pattern.rows + pattern.columns) % 2 == 0:
        return grid if across[0] >= 0 else turned
    # whether the squares of the first one's colour are dark, over the whole board: light may fall off
    middles = (grid[:-1, :-1] + grid[1:, 1:] + grid[:-1, 1:] + grid[1:, :-1]) / 4
    columns, rows = np.rint(middles).astype(int).transpose(2, 0, 1)
    grey = image[rows.clip(0, image.shape[0] - 1), columns.clip(0, image.shape[1] - 1)].astype(float)
    first = np.indices(grey.shape).sum(axis=0) % 2 == 0
    return grid if bool(grey[first].mean() < grey[~first].mean()) else turned
