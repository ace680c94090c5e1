"""How well a calibrated rig will measure a length: its cameras' covariance and the noise of the length's own images."""

from dataclasses import dataclass

import numpy as np

from spherecal.base import arrays
from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray
from spherecal.geometry.camera import is_unfolded, project_with_derivatives
from spherecal.geometry.field_table import FieldTable
from spherecal.geometry.rotation import cross_matrix
from spherecal.geometry.transform import PosedCameras


@dataclass(frozen=True)
class Cameras(PosedCameras):
    """The cameras that see a length, with image sizes (c,2) px.

    `covariance` (c*w, c*w) of turn, shift and the `columns` of the intrinsics (rig.CameraCovariance); `fields` (c,) of
    the lenses, () for none.
    """

    size: FloatArray
    covariance: FloatArray
    columns: IntArray
    fields: tuple[FieldTable | None, ...] = ()


@dataclass(frozen=True)
class PredictedLengths:
    """Variances (m,) mm^2 of lengths by cameras and by the ends' noise, NaN unless two see both; `views`: the fewer."""

    calibration: FloatArray
    own: FloatArray
    views: IntArray

    def standard_mm(self) -> FloatArray:
        """Standard uncertainties (m,) in mm."""
        return np.sqrt(self.calibration + self.own)


def predict_lengths(cameras: Cameras, ends: FloatArray, sigma_px: float) -> PredictedLengths:
    """The uncertainty of lengths between dots at ends (m,2,3) in the cameras' frame; first order (GUM 5.1).

    A dot is seen by all cameras whose image holds it: nothing hides it. See docs/formulation.md, Prediction.
    """
    at_once = max(arrays.ROWS_AT_ONCE // (2 * max(len(cameras.rotation), 1)), 1)
    parts = [_gradients(cameras, ends[k : k + at_once], sigma_px) for k in range(0, max(len(ends), 1), at_once)]
    gradient, own, views, known = (np.concatenate(part) for part in zip(*parts, strict=True))
    calibration = np.einsum("mi,mi->m", gradient @ cameras.covariance, gradient)
    return PredictedLengths(np.where(known, np.maximum(calibration, 0.0), np.nan), np.where(known, own, np.nan), views)


def length_gradients(cameras: Cameras, ends: FloatArray) -> FloatArray:
    """Derivatives (k,c*w) of lengths by the cameras, of the k of ends (m,2,3) that two cameras see both of."""
    gradient, _, _, known = _gradients(cameras, ends, 1.0)
    return gradient[known]


def _gradients(
    cameras: Cameras, ends: FloatArray, sigma_px: float
) -> tuple[FloatArray, FloatArray, IntArray, BoolArray]:
    """Lengths' derivatives (m,c*w) by the cameras, own variances (m,), views (m,), and which of them are known (m,)."""
    m, c = len(ends), len(cameras.rotation)
    points = ends.reshape(-1, 3)
    x = np.einsum("cij,pj->pci", cameras.rotation, points) + cameras.translation
    k = np.broadcast_to(cameras.intrinsics, (len(points), c, 16)).reshape(-1, 16)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        uv, by_x, by_intrinsics = project_with_derivatives(x.reshape(-1, 3), k)
    uv = uv.reshape(-1, c, 2)
    seen = (x[:, :, 2] > 0) & ((uv >= 0) & (uv <= cameras.size - 1)).all(axis=2)
    point, camera = np.nonzero(seen)
    seen[point, camera] = is_unfolded(x[point, camera], cameras.intrinsics[camera])
    sigma = _sigma(cameras, uv, sigma_px).reshape(-1, 1, 1)
    by_x = np.where(seen.reshape(-1, 1, 1), by_x / sigma, 0.0)
    by_intrinsics = np.where(seen.reshape(-1, 1, 1), by_intrinsics[:, :, cameras.columns] / sigma, 0.0)
    x_safe = np.where(seen[:, :, None], x, 0.0).reshape(-1, 3)
    by_camera = np.concatenate([-by_x @ cross_matrix(x_safe), by_x, by_intrinsics], axis=2)
    by_point = (by_x.reshape(-1, c, 2, 3) @ cameras.rotation).reshape(-1, 2 * c, 3)
    inverse, enough = _inverse(np.einsum("pki,pkj->pij", by_point, by_point), seen.sum(axis=1))

    along = ends[:, 1] - ends[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    pull = np.einsum("pij,pj->pi", inverse, np.repeat(along, 2, axis=0))
    own = np.einsum("pi,pi->p", pull, np.repeat(along, 2, axis=0)).reshape(m, 2).sum(axis=1)
    by_row = np.einsum("pki,pi->pk", by_point, pull).reshape(-1, c, 2)
    gradient = np.einsum("pck,pckw->pcw", by_row, by_camera.reshape(-1, c, 2, by_camera.shape[2]))
    gradient = gradient.reshape(m, 2, c * by_camera.shape[2])
    gradient = gradient[:, 0] - gradient[:, 1]  # dX = -N^-1 J' J_c dc, and the length is X2 - X1 along itself
    both = enough.reshape(m, 2)
    return gradient, own, seen.sum(axis=1).reshape(m, 2).min(axis=1), both[:, 0] & both[:, 1]


def _sigma(cameras: Cameras, uv: FloatArray, sigma_px: float) -> FloatArray:
    """Standard deviations (p,c) px of image points (p,c,2): their noise, and that of the lenses' fields."""
    sigma = np.full(uv.shape[:2], sigma_px)
    for c, field in enumerate(cameras.fields):
        if field is not None:
            sigma[:, c] = np.hypot(sigma_px, np.nan_to_num(field.sd_at(uv[:, c])))
    return sigma


def _inverse(normal: FloatArray, views: IntArray) -> tuple[FloatArray, BoolArray]:
    """Inverses of normal matrices (p,3,3), and which of them (p,) are of points that two cameras see well enough."""
    with np.errstate(invalid="ignore"):
        good = (views >= 2) & (np.linalg.cond(normal) < 1e10)
    inverse = np.zeros_like(normal)
    inverse[good] = np.linalg.inv(normal[good])
    return inverse, good


# --- the map of a rig's uncertainty ----------------------------------------------------------------------------------

LENGTH_MM = 500.0
COVERAGE_FACTOR = 2.0
GRID = 5
# VDI/VDE 2634 measures along the edges and the space diagonals of the volume.
_DIAGONALS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]]) / np.sqrt(3)
DIRECTIONS = np.vstack([np.eye(3), _DIAGONALS])


@dataclass(frozen=True, eq=False, repr=False)
class Volume(ByValue):
    """A box: its middle (3,), its axes as rows (3,3) and half its sides (3,), mm."""

    middle: FloatArray
    axes: FloatArray
    half: FloatArray

    def grid(self, count: int) -> FloatArray:
        """count^3 places (n,3) mm from corner to corner."""
        steps = np.linspace(-1, 1, count)
        box = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
        return self.middle + box * self.half @ self.axes


@dataclass(frozen=True, eq=False, repr=False)
class LengthMap(ByValue):
    """Expanded uncertainties (places, directions) in mm of a length centred at places (n,3), NaN where it is not seen.

    `sigma_px` is the noise of one dot's image that was assumed.
    """

    length_mm: float
    coverage_factor: float
    sigma_px: float
    places_mm: FloatArray
    directions: FloatArray
    expanded_mm: FloatArray

    @property
    def typical_mm(self) -> float | None:
        """The median over all places and directions where the length is seen."""
        seen = self.expanded_mm[np.isfinite(self.expanded_mm)]
        return float(np.median(seen)) if len(seen) else None

    @property
    def worst(self) -> tuple[float, FloatArray] | None:
        """The largest uncertainty and its place (3,)."""
        if not np.isfinite(self.expanded_mm).any():
            return None
        at = int(np.nanargmax(np.nanmax(np.where(np.isfinite(self.expanded_mm), self.expanded_mm, -1.0), axis=1)))
        return float(np.nanmax(self.expanded_mm[at])), self.places_mm[at]


def measured_volume(points: FloatArray, camera_centres: FloatArray) -> Volume:
    """A box about points (n,3) mm, nine tenths of their extent, its axes those of the cameras' centres (c,3) mm."""
    centred = camera_centres - camera_centres.mean(axis=0)
    axes = np.linalg.svd(centred)[2]
    axes *= np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])[:, None]  # the sign of an axis is no accident
    along = (points - points.mean(axis=0)) @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    return Volume(points.mean(axis=0) + (low + high) / 2 @ axes, axes, 0.9 * (high - low) / 2)


def length_map(cameras: Cameras, volume: Volume, sigma_px: float) -> LengthMap:
    """The map over a volume in mm."""
    places = volume.grid(GRID)
    directions = DIRECTIONS @ volume.axes
    half = LENGTH_MM / 2 * directions
    ends = np.stack([places[:, None] - half, places[:, None] + half], axis=2).reshape(-1, 2, 3)
    found = predict_lengths(cameras, ends, sigma_px)
    expanded = (COVERAGE_FACTOR * np.sqrt(found.calibration + found.own)).reshape(len(places), len(directions))
    return LengthMap(LENGTH_MM, COVERAGE_FACTOR, sigma_px, places, directions, expanded)
