"""The corners of an AprilGrid, with or without Kalibr's small squares; their order follows from the other tags."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.targets.marker_set import marker_dictionary
from spherecal_boards.board_pattern import KALIBR_BORDER_BITS, BoardPattern

# Squares that touch tags at their corners make one outline of all; black is thinned by this many pixels to part them.
_THINNED = (3, 5, 1)
_LEAST_TAGS = 2  # one alone does not tell its turn
# Of a tag's side: corners farther from where the plane board would have them are of other tags. A grid of 6 x 6 at its
# own width's distance is bent by up to 0.43 before a fisheye lens of 150 degrees, by 0.37 with k1 = -0.3; nearer ones
# lose their outer tags.
_OFF = 0.5
_ENOUGH = 24  # corners, for twice ten terms of a cubic
# Beyond this many medians and pixels a corner is another one: right ones scatter by 0.03 to 0.07 px in rendered images,
# wrong saddles were 3 to 7 px off.
_STRAY_SD, _STRAY_PX = 5.0, 0.5
_RIGHT = 2.0  # a wrong turn fits this many times worse at least; it is off by whole tags


def find_aprilgrid(image: NDArray[np.uint8], pattern: BoardPattern) -> tuple[IntArray, FloatArray] | None:
    """Indices (k,) and places (k, 2) px of the corners in a grey image of 8 bits; None where two tags are not found."""
    count = pattern.rows * pattern.columns
    best: tuple[dict[int, FloatArray], int] = {}, KALIBR_BORDER_BITS
    for border in (2, 1) if pattern.border_bits is None else (pattern.border_bits,):
        found: dict[int, FloatArray] = {}
        for thinned in _THINNED:
            found = _seen(image, pattern, border, thinned) | found
            if len(found) == count:
                break
        if len(found) > len(best[0]):
            best = found, border
        if len(best[0]) == count:
            break
    ids = np.array(sorted(best[0]), dtype=np.int64)
    corners = np.array([best[0][i] for i in ids]).reshape(-1, 4, 2)
    if len(ids) < _LEAST_TAGS:
        return None
    labelled = _labelled(ids, corners, pattern)
    if labelled is None:
        return None
    index, uv = labelled
    return _refined(image, index, uv, pattern, best[1])


def _seen(image: NDArray[np.uint8], pattern: BoardPattern, border: int, thinned: int) -> dict[int, FloatArray]:
    """Corners (4,2) px by id of the tags in an image whose black is thinned; those that are there once."""
    settings = cv2.aruco.DetectorParameters()
    settings.markerBorderBits = border
    seen = image if thinned == 1 else cv2.dilate(image, np.ones((thinned, thinned), np.uint8))
    corners, ids, _ = cv2.aruco.ArucoDetector(marker_dictionary(pattern.dictionary), settings).detectMarkers(seen)
    if ids is None:
        return {}
    own, at, times = np.unique(np.asarray(ids).ravel(), return_index=True, return_counts=True)
    own = own - pattern.first_id
    keep = (own >= 0) & (own < pattern.rows * pattern.columns) & (times == 1)
    places = np.asarray(corners, dtype=float).reshape(-1, 4, 2)[at]
    # thinning moved every side inwards
    outwards = places - places.mean(axis=1, keepdims=True)
    outwards /= np.maximum(np.linalg.norm(outwards, axis=2, keepdims=True), 1e-9)
    places = places + 2**0.5 * (thinned - 1) / 2 * outwards
    return {int(i): corner for i, corner, good in zip(own, places, keep, strict=True) if good}


def _labelled(ids: IntArray, corners: FloatArray, pattern: BoardPattern) -> tuple[IntArray, FloatArray] | None:
    """Index and place of each corner, by the one turn of the tags that makes the grid a plane in perspective."""
    row, column = np.divmod(ids, pattern.columns)
    # as OpenCV has them: clockwise from the top left, seen with the columns to the right
    down = np.array([1, 1, 0, 0]) if pattern.rows_upward else np.array([0, 0, 1, 1])
    index = (2 * row[:, None] + down) * 2 * pattern.columns + 2 * column[:, None] + np.array([0, 1, 1, 0])
    points = pattern.points_mm
    side = float(np.median(np.linalg.norm(np.diff(corners, axis=1), axis=2)))
    tried = []
    for rotation in range(4):
        turned = np.roll(index, rotation, axis=1).ravel()
        off = _off_plane(points[turned], corners.reshape(-1, 2), _OFF * side)
        tried.append((float(np.median(off)), rotation))
    (least, rotation), (second, _) = sorted(tried)[:2]
    if not least < _OFF * side or second < _RIGHT * least:
        return None
    turned, uv = np.roll(index, rotation, axis=1).ravel(), corners.reshape(-1, 2)
    keep = (_off_plane(points[turned], uv, _OFF * side) < _OFF * side).reshape(-1, 4).all(axis=1)
    if keep.sum() < _LEAST_TAGS:
        return None
    chosen = np.repeat(keep, 4)
    order = np.argsort(turned[chosen])
    return turned[chosen][order], uv[chosen][order]


def _off_plane(points: FloatArray, uv: FloatArray, most: float) -> FloatArray:
    """By how many px each image point is off the best perspective of a plane board, (n,)."""
    seen, _ = cv2.findHomography(points, uv, cv2.RANSAC, most)
    if seen is None:
        return np.full(len(uv), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = np.column_stack([points, np.ones(len(points))]) @ np.asarray(seen).T
        off = np.linalg.norm(p[:, :2] / p[:, 2:] - uv, axis=1)
    return np.where(np.isfinite(off), off, np.inf)


def _refined(
    image: NDArray[np.uint8], index: IntArray, uv: FloatArray, pattern: BoardPattern, border: int
) -> tuple[IntArray, FloatArray] | None:
    """The corners at the saddle of the grey values; those that leave their window are left out."""
    assert pattern.marker_mm is not None
    bits = marker_dictionary(pattern.dictionary).markerSize + 2 * border
    clear = min(border / bits, pattern.pitch_mm / pattern.marker_mm - 1)  # of a tag's side: black, and white beside it
    # the shortest side of the tag of each corner
    row, column = np.divmod(index, 2 * pattern.columns)
    tag = (row // 2) * pattern.columns + column // 2
    side = np.empty(len(uv))
    for one in np.unique(tag):
        corners = uv[tag == one]  # sorted by index: two of one row, two of the next
        side[tag == one] = min(np.linalg.norm(corners[1] - corners[0]), np.linalg.norm(corners[2] - corners[0]))
    out = np.full(uv.shape, np.nan)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    halves = np.clip(np.floor(0.6 * clear * side), 2, 12).astype(int)
    for half in np.unique(halves):
        own = halves == half
        start = uv[own].astype(np.float32).reshape(-1, 1, 2)
        fine = cv2.cornerSubPix(image, start, (int(half), int(half)), (-1, -1), criteria)
        out[own] = np.asarray(fine, dtype=float).reshape(-1, 2)
    size = np.array(image.shape[::-1])
    inside = ((out > halves[:, None]) & (out < size - 1 - halves[:, None])).all(axis=1)
    moved = np.linalg.norm(out - uv, axis=1)
    keep = inside & (moved > 0) & (moved <= 1.5 * halves)  # what finds no saddle stays, what leaves finds another
    if keep.sum() < 4 * _LEAST_TAGS - 2:
        return None
    keep[keep] = _smooth(pattern.points_mm[index[keep]], out[keep])
    return index[keep], out[keep]


def _smooth(points: FloatArray, uv: FloatArray) -> BoolArray:
    """Which image points (n, 2) lie where the others say: in perspective, with a lens that bends it smoothly."""
    keep = np.ones(len(uv), dtype=bool)
    if len(uv) < _ENOUGH:
        return keep
    seen, _ = cv2.findHomography(points, uv, cv2.LMEDS)
    if seen is None:
        return keep
    p = np.column_stack([points, np.ones(len(points))]) @ np.asarray(seen).T
    bent = uv - p[:, :2] / p[:, 2:]
    x, y = ((points - points.mean(axis=0)) / np.ptp(points, axis=0).max()).T
    terms = np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
    for _ in range(3):
        fitted = np.linalg.lstsq(terms[keep], bent[keep], rcond=None)[0]
        off = np.linalg.norm(bent - terms @ fitted, axis=1)
        keep = off <= _STRAY_SD * np.median(off[keep]) + _STRAY_PX
    return keep
