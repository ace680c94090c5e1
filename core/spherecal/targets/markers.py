"""ArUco and AprilTag markers in an image: decoded by OpenCV, their corners where the four edges meet.

An edge is located in profiles across it, where they rise through the mean of the black beside it and the white. A
parabola is laid through these places: a sticker on a ball, or a straight one seen through a lens with distortion, has
curved edges. A corner is where the parabolas of its two edges meet.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.targets.marker_set import BORDER_BITS, marker_dictionary
from spherecal.targets.target_set import TargetSet

_LEAST_SIDE_PX = 10.0  # OpenCV reads no smaller ones of 4 x 4 bits
_ROUNDS = 2  # of refinement: profiles of the second lie across the edges of the first
_BEYOND = 3.0  # px by which a corner may move from where OpenCV has it
_MARGIN = 0.12  # of a side: profiles nearer to a corner see the other edge
_LEAST_CELL_PX = 1.5  # narrower ones are all slope: nothing is black or white
_MOST_HALF_PX = 6.0  # of a profile; half of one reaches over a cell to either side
_STEP_PX = 0.25
_PARABOLA = 10  # profiles of an edge from which it may be curved
_OUTLIER = 3.0
# Corners in rendered images scatter by 0.01 px at least, whatever the noise of their edges says.
_LEAST_SIGMA_PX = 0.01
# Of the profiles of an edge in rendered images of 8 bits with usual noise; used to recognise damaged markers.
USUAL_RESIDUAL_PX = 0.05
_LEAST_CONTRAST = 0.25  # of an edge's step over the strongest edge's: below, something lies over the marker


class Markers(NamedTuple):
    """The markers of an image by id, n of them; `uv` and `sigma` (n, 4, 2) px are NaN where an edge is not seen well.

    `residual` (n,) px is the rms of the edges' profiles about their parabolas, `blur` (n,) px the edges' standard
    deviation.
    """

    ids: IntArray
    uv: FloatArray
    sigma: FloatArray
    residual: FloatArray
    blur: FloatArray


def find_markers(image: NDArray[np.uint8] | NDArray[np.uint16], targets: TargetSet) -> Markers:
    """The markers of a set in a grey image (h, w), by id; one that is there twice is left out: its id is in doubt."""
    assert targets.dictionary is not None
    eight_bits = image
    if image.dtype != np.uint8:  # for OpenCV's reader, whatever the significant bits are
        low, high = np.percentile(image, (0.1, 99.9))
        eight_bits = np.clip((image - low) * (255.0 / max(high - low, 1.0)), 0, 255)
    ids, corners = _decoded(np.asarray(eight_bits, np.uint8), targets)
    cells = marker_dictionary(targets.dictionary).markerSize + 2 * BORDER_BITS
    grey = image.astype(np.float64)
    sign = -1.0 if targets.polarity == "light-on-dark" else 1.0
    found = [_refined(sign * grey, square, cells) for square in corners]
    uv, sigma, residual, blur = (np.array([one[k] for one in found]) for k in range(4))
    return Markers(ids, uv.reshape(-1, 4, 2), sigma.reshape(-1, 4, 2), residual, blur)


def _decoded(image: NDArray[np.uint8], targets: TargetSet) -> tuple[IntArray, FloatArray]:
    """Ids (n,) in order and corners (n, 4, 2) px of the set's markers that are there once."""
    assert targets.dictionary is not None
    settings = cv2.aruco.DetectorParameters()
    settings.markerBorderBits = BORDER_BITS
    settings.minMarkerPerimeterRate = 4 * _LEAST_SIDE_PX / max(image.shape)
    # Stickers on a ball of ten times their width: 19 of 25 are read with OpenCV's own values, 24 with these.
    settings.perspectiveRemovePixelPerCell, settings.perspectiveRemoveIgnoredMarginPerCell = 8, 0.33
    settings.polygonalApproxAccuracyRate, settings.minCornerDistanceRate = 0.05, 0.02
    settings.minMarkerDistanceRate, settings.minGroupDistance = 0.02, 0.05
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    settings.detectInvertedMarker = targets.polarity == "light-on-dark"
    detector = cv2.aruco.ArucoDetector(marker_dictionary(targets.dictionary), settings)
    corners, ids, _ = detector.detectMarkers(image)
    if ids is None or not len(ids):
        return np.empty(0, np.int64), np.empty((0, 4, 2))
    own, first, times = np.unique(np.asarray(ids).ravel(), return_index=True, return_counts=True)
    keep = (times == 1) & np.isin(own, list(targets.layouts))
    places = np.asarray(corners, dtype=float).reshape(-1, 4, 2)[first]
    return own[keep].astype(np.int64), places[keep]


class _Edge(NamedTuple):
    """An edge from one corner to the next: p(s) = start + s along + offset(s) normal, offset of powers of s."""

    start: FloatArray
    along: FloatArray
    normal: FloatArray
    offset: FloatArray  # coefficients (3,), lowest first
    covariance: FloatArray  # (3, 3) of them
    residual: float
    step: float
    blur: float


def _refined(grey: FloatArray, square: FloatArray, cells: int) -> tuple[FloatArray, FloatArray, float, float]:
    """Corners and their standard uncertainties (4, 2) px, rms of residuals, blur; NaN where they are not seen well."""
    none = np.full((4, 2), np.nan)
    corners = square.copy()
    edges: list[_Edge] = []
    sigma = none
    for _ in range(_ROUNDS):
        found = [_edge(grey, np.roll(corners, -i, axis=0), cells) for i in range(4)]
        edges = [one for one in found if one is not None]
        if len(edges) < 4 or min(e.step for e in edges) < _LEAST_CONTRAST * max(e.step for e in edges):
            return none, none, np.nan, np.nan
        met = [_meeting(edges[i - 1], edges[i]) for i in range(4)]
        corners = np.array([one[0] for one in met])
        sigma = np.array([one[1] for one in met])
        if not np.isfinite(corners).all() or np.linalg.norm(corners - square, axis=1).max() > _BEYOND:
            return none, none, np.nan, np.nan
    residual = float(np.sqrt(np.mean([e.residual**2 for e in edges])))
    blur = float(np.median([e.blur for e in edges]))
    return corners, np.maximum(sigma, _LEAST_SIGMA_PX), residual, blur


def _edge(grey: FloatArray, corners: FloatArray, cells: int) -> _Edge | None:
    """The edge between the first two of four corners (4, 2), which go clockwise; None where it is not seen."""
    start, end = corners[:2]
    length = float(np.linalg.norm(end - start))
    if length < _LEAST_SIDE_PX / 2:
        return None
    along = (end - start) / length
    normal = np.array([along[1], -along[0]])  # outwards: to the light side
    cell = -float(((corners[2:] - start) @ normal).max()) / cells
    if cell < _LEAST_CELL_PX:
        return None
    half = min(cell, _MOST_HALF_PX)
    s = np.arange(_MARGIN * length, (1 - _MARGIN) * length, 1.0)
    t = np.linspace(-half, half, 2 * int(np.ceil(half / _STEP_PX)) + 1)
    uv = start + s[:, None, None] * along + t[None, :, None] * normal
    height, width = grey.shape
    if uv.min() < 0 or uv[..., 0].max() > width - 1 or uv[..., 1].max() > height - 1 or len(s) < 4:
        return None
    profile = ndimage.map_coordinates(grey, [uv[..., 1], uv[..., 0]], order=1)
    quarter = len(t) // 4  # the middle of the black border, and of the blank edge
    dark, light = (np.polyval(np.polyfit(s, profile[:, i], 1), s) for i in (quarter, len(t) - 1 - quarter))
    step = float(np.median(light - dark))
    if step <= 0:
        return None
    place, slope = _crossing(profile, t, (dark + light) / 2)
    good = np.isfinite(place)
    if good.sum() < len(s) / 2:
        return None
    blur = step / (float(np.median(slope[good])) * (2 * np.pi) ** 0.5)
    fit = _parabola(s[good], place[good], length)
    return None if fit is None else _Edge(start, along, normal, *fit, step, blur)


def _crossing(profile: FloatArray, t: FloatArray, level: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where each profile (n, m) over `t` (m,) rises through its level nearest to the middle, and how steeply; NaN."""
    below = profile - level[:, None]
    rises = (below[:, :-1] < 0) & (below[:, 1:] >= 0)
    middle = (t[1:] + t[:-1]) / 2
    at = np.where(rises, np.abs(middle), np.inf).argmin(axis=1)
    rows = np.arange(len(profile))
    low, high = below[rows, at], below[rows, at + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        place = t[at] - low / (high - low) * (t[1] - t[0])
    return np.where(rises.any(axis=1), place, np.nan), (high - low) / (t[1] - t[0])


def _parabola(s: FloatArray, place: FloatArray, length: float) -> tuple[FloatArray, FloatArray, float] | None:
    """Coefficients of the best parabola (a line through few places), their covariance, and the rms of residuals."""
    powers = 3 if len(s) >= _PARABOLA else 2
    if len(s) < powers + 2:
        return None
    design = np.stack([(s / length) ** k for k in range(powers)], axis=1)
    keep = np.ones(len(s), dtype=bool)
    coefficients = np.zeros(powers)
    rms = 0.0
    for _ in range(3):
        coefficients = np.linalg.lstsq(design[keep], place[keep], rcond=None)[0]
        off = place - design @ coefficients
        rms = float(np.sqrt((off[keep] ** 2).sum() / max(keep.sum() - powers, 1)))
        now = np.abs(off) <= max(_OUTLIER * rms, 1e-3)
        if now.sum() < max(powers + 2, len(s) / 2) or (now == keep).all():
            break
        keep = now
    scale = length ** -np.arange(powers, dtype=float)
    covariance = rms**2 * np.linalg.inv(design[keep].T @ design[keep]) * np.outer(scale, scale)
    out, spread = np.zeros(3), np.zeros((3, 3))
    out[:powers], spread[:powers, :powers] = coefficients * scale, covariance
    return out, spread, rms


def _meeting(before: _Edge, after: _Edge) -> tuple[FloatArray, FloatArray]:
    """Where an edge ends and the next begins (2,), and the standard uncertainties (2,) px."""
    point = after.start
    normals, variances = np.zeros((2, 2)), np.zeros(2)
    for _ in range(4):
        off = np.zeros(2)
        for i, edge in enumerate((before, after)):
            s = float((point - edge.start) @ edge.along)
            powers = np.array([1.0, s, s * s])
            slope = edge.offset[1] + 2 * edge.offset[2] * s
            normals[i] = edge.normal - slope * edge.along
            off[i] = edge.offset @ powers - (point - edge.start) @ edge.normal
            variances[i] = powers @ edge.covariance @ powers
        if abs(np.linalg.det(normals)) < 0.1:  # edges that hardly differ in direction: seen at a grazing angle
            return np.full(2, np.nan), np.full(2, np.nan)
        point = point + np.linalg.solve(normals, off)
    inverse = np.linalg.inv(normals)
    return point, np.sqrt((inverse**2) @ variances)


def tilts_deg(uv: FloatArray, matrix: FloatArray) -> FloatArray:
    """Angles (n,) in degrees between the lines of sight and the normals of markers (n, 4, 2) px; NaN if unknown."""
    square = np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    tilts = np.full(len(uv), np.nan)
    for i, corners in enumerate(uv):
        if np.isfinite(corners).all():
            solved, turn, shift = cv2.solvePnP(square, corners, matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
            if solved:
                normal = cv2.Rodrigues(turn)[0][:, 2]
                sight = shift.ravel() / np.linalg.norm(shift)
                tilts[i] = np.degrees(np.arccos(np.clip(abs(normal @ sight), 0.0, 1.0)))
    return tilts
