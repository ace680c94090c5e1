"""Real lenses: what no estimated model follows, point spreads that shift a dot's centre, focus that leaves the ball."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.camera import INTRINSIC_NAMES, N_INTRINSICS, estimated_mask, project, project_with_derivatives
from spherecal.geometry.rotation import cross_matrix

_DEGREE = 11  # of the polynomials that carry a field: r^10 times x is of degree 11
_GRID = (28, 22)
_VIEW_LIMIT_DEG = 60.0


@dataclass(frozen=True)
class TrueLens:
    """A lens and what it does to a point: Brown's or a fisheye's image, a fixed field, shifts that go with depth."""

    size: tuple[int, int]
    intrinsics: FloatArray  # (16,) OpenCV's model; with `fisheye` only f and the principal point count
    field: FloatArray  # (k, 2) px, coefficients of Chebyshev products over the region
    region: FloatArray  # (2, 2) of the normalised image
    fisheye: FloatArray | None = None  # (4,) Kannala and Brandt
    coma_px: float = 0.0  # shift of a centre away from the axis at the image's corner, away from the focus
    astigmatism_px: float = 0.0  # across it
    focus_mm: float = 1000.0
    defocus: float = 0.0  # relative growth of noise at twice the focused distance

    def image(self, x_camera: FloatArray) -> FloatArray:
        """Image points (n, 2) px of points (n, 3) mm in the camera's frame."""
        uv = self.ideal(x_camera)
        place = self.normalised(uv)
        return uv + self.field_at(place) + self._shift(place, x_camera[:, 2])

    def sees(
        self,
        pose: tuple[FloatArray, FloatArray],
        points: FloatArray,
        normals: FloatArray | None,
        through: Callable[[FloatArray], FloatArray] | None = None,
    ) -> tuple[IntArray, FloatArray]:
        """Which of the points (m, 3) mm are seen from a pose (world to camera), and where, (k,), (k, 2) px.

        `normals` None: from all around; `through`: where points in the camera's frame seem to be, as through glass.
        """
        rotation, translation = pose
        x = points @ rotation.T + translation
        x = x if through is None else through(x)
        size = np.array(self.size)
        angle = np.arctan2(np.hypot(x[:, 0], x[:, 1]), x[:, 2])
        most = np.arctan(1.3 * np.hypot(*size) / 2 / self.intrinsics[0]) if self.fisheye is None else np.deg2rad(60)
        good = (x[:, 2] > 0) & (angle < most)
        if normals is not None:
            ray = -rotation.T @ translation - points
            facing = np.cos(np.deg2rad(_VIEW_LIMIT_DEG)) * np.linalg.norm(ray, axis=1)
            good &= (ray * normals).sum(axis=1) > facing
        rows = np.flatnonzero(good)
        uv = self.image(x[rows])
        inside = ((uv > -0.5) & (uv < size - 0.5)).all(axis=1)
        return rows[inside], uv[inside]

    def ideal(self, x_camera: FloatArray) -> FloatArray:
        """Image points (n, 2) px by the lens model alone."""
        if self.fisheye is None:
            return project(x_camera, self.intrinsics)
        off_axis = np.hypot(x_camera[:, 0], x_camera[:, 1])
        angle = np.arctan2(off_axis, x_camera[:, 2])
        bent = angle * (1 + _angle_powers(self.fisheye, angle**2))
        scale = np.where(off_axis > 1e-12, bent / np.maximum(off_axis, 1e-12), 1.0 / np.maximum(x_camera[:, 2], 1e-12))
        return x_camera[:, :2] * scale[:, None] * self.intrinsics[:2] + self.intrinsics[2:4]

    def normalised(self, uv: FloatArray) -> FloatArray:
        """Image points (n, 2) with the frame at +-1."""
        return 2 * (uv + 0.5) / np.array(self.size) - 1

    def field_at(self, place: FloatArray) -> FloatArray:
        """The fixed field (n, 2) px at normalised image points (n, 2)."""
        if not len(place) or not self.field.any():
            return np.zeros_like(place)
        low, high = self.region
        return _basis(np.clip(2 * (place - low) / (high - low) - 1, -1, 1)) @ self.field

    def _shift(self, place: FloatArray, depth: FloatArray) -> FloatArray:
        """Point-spread shifts (n, 2) px: coma along the radius, astigmatism as (y, x); more out of focus."""
        out = 1 + 2 * np.abs(depth / self.focus_mm - 1)
        away = place / np.sqrt(2.0)
        across = place[:, ::-1] * place[:, :1] * place[:, 1:] / 2
        return (out * np.linalg.norm(away, axis=1) * self.coma_px)[:, None] * away + ((out - 1) * self.astigmatism_px)[
            :, None
        ] * across

    def blur(self, depth: FloatArray) -> FloatArray:
        """Factor (n,) on the noise at a depth in mm: 1 in focus."""
        return np.sqrt(1 + (self.defocus * (depth / self.focus_mm - 1)) ** 2)


def _angle_powers(coefficients: FloatArray, square: FloatArray) -> FloatArray:
    """k1 s + k2 s^2 + ... of a fisheye's squared angles (n,)."""
    return sum((k * square ** (i + 1) for i, k in enumerate(coefficients)), np.zeros_like(square))


def random_field(
    size: tuple[int, int],
    intrinsics: FloatArray,
    region: FloatArray,
    rms_px: float,
    radial_share: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Coefficients (k, 2) px of a field of the given rms per axis that Brown's model and the pose cannot follow.

    A smooth random field, decaying with the degree, and a share of higher radial orders (r^9, r^11). What the nine
    estimated intrinsics or a turn of the camera explain in the region is taken out: there the camera's true pose and
    lens stay what they are. Outside the region nothing is used and the field keeps the value of its border.

    `size`: image size (width, height), px; `intrinsics`: intrinsics of the lens, (16,); `region` (2, 2).
    """
    low, high = region
    steps = [np.linspace(-1, 1, n) for n in _GRID]
    grid = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    place = low + (grid + 1) / 2 * (high - low)
    orders = np.array([i + j for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)])
    smooth = _basis(grid) @ (rng.normal(size=(len(orders), 2)) * np.where(orders > 8, 0.0, 0.75**orders)[:, None])
    r2 = (grid**2).sum(axis=1) / 2
    radial = grid * (rng.normal() * r2**4 + rng.normal() * r2**5)[:, None]
    value = _left_by_the_model(place, smooth / _rms(smooth), size, intrinsics)
    high_orders = _left_by_the_model(place, radial / _rms(radial), size, intrinsics)
    value = value / _rms(value) * np.sqrt(1 - radial_share) + high_orders / _rms(high_orders) * np.sqrt(radial_share)
    value *= rms_px / _rms(value)
    return np.linalg.lstsq(_basis(grid), value, rcond=None)[0]


def _rms(value: FloatArray) -> float:
    return float(np.sqrt((value**2).mean()))


def _basis(place: FloatArray) -> FloatArray:
    full = chebyshev.chebvander2d(place[:, 0], place[:, 1], [_DEGREE, _DEGREE]).reshape(-1, _DEGREE + 1, _DEGREE + 1)
    return np.concatenate([full[:, i, : _DEGREE + 1 - i] for i in range(_DEGREE + 1)], axis=1).astype(float)


def _left_by_the_model(
    place: FloatArray, value: FloatArray, size: tuple[int, int], intrinsics: FloatArray
) -> FloatArray:
    """What of a field (n, 2) is left after the best change of intrinsics and rotation."""
    ray = ((place + 1) / 2 * np.array(size) - 0.5 - intrinsics[2:4]) / intrinsics[:2]
    x = np.column_stack([ray, np.ones(len(ray))])
    plain = np.zeros(N_INTRINSICS)
    plain[:4] = intrinsics[:4]
    _, by_x, by_intrinsics = project_with_derivatives(x, plain)
    columns = np.flatnonzero(estimated_mask("brown") | np.isin(INTRINSIC_NAMES, ("fu", "fv")))
    design = np.concatenate([by_intrinsics[:, :, columns], -by_x @ cross_matrix(x)], axis=2).reshape(2 * len(x), -1)
    design /= np.linalg.norm(design, axis=0)
    flat = value.reshape(-1)
    left = flat - design @ np.linalg.lstsq(design, flat, rcond=None)[0]
    return np.asarray(left, dtype=float).reshape(-1, 2)
