"""A lens described by another model: the one that comes nearest to it over given image points."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.geometry import camera as lenses
from spherecal.geometry.camera import LensModel

FIELD_GRID = (41, 31)
_STEPS = 50
_SMALLEST_CHANGE = 1e-9  # of the sum of squares
# Points farther off the axis are left out: at 80 degrees a polynomial in tan has terms of 3e4, which no start survives.
_WIDEST_TAN = 5.67


@dataclass(frozen=True)
class FittedLens:
    """Intrinsics (16,) and the rms distance in px between the projections of the two lenses."""

    intrinsics: FloatArray
    rms_px: float


def image_field(image_size: tuple[int, int]) -> FloatArray:
    """Image points (n, 2) px in columns x rows from edge to edge of the image, row by row."""
    width, height = image_size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, FIELD_GRID[0]), np.linspace(-0.5, height - 0.5, FIELD_GRID[1]))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def fit_lens(intrinsics: FloatArray, uv: FloatArray, model: LensModel) -> FittedLens | None:
    """The lens (16,) of `model` nearest to a lens at image points (n,2) px; None where too few can be inverted.

    A lens that follows the model already is returned as it is, with an rms of 0.
    """
    if (model == "fisheye") == bool(lenses.is_fisheye(intrinsics)):
        return FittedLens(intrinsics, 0.0)
    xy, good = lenses.undistort(uv, intrinsics)
    good &= np.hypot(xy[:, 0], xy[:, 1]) < _WIDEST_TAN
    if good.sum() < 12:  # as many points as the largest model has numbers: two equations each
        return None
    rays, goal = np.column_stack([xy[good], np.ones(good.sum())]), uv[good]
    lens = np.zeros(16)
    lens[:4] = intrinsics[:4]
    lens[15] = lenses.FISHEYE_MARK if model == "fisheye" else 0.0
    # the numerator first: a rational model's eight numbers can replace each other, and a search for all at once stops
    if model == "rational":
        lens, _ = _gauss_newton(lens, rays, goal, lenses.estimated_mask("brown"))
    lens, rms = _gauss_newton(lens, rays, goal, lenses.estimated_mask(model))
    return FittedLens(lens, rms)


def _gauss_newton(lens: FloatArray, rays: FloatArray, goal: FloatArray, free: BoolArray) -> tuple[FloatArray, float]:
    """The free numbers by damped least squares from a start; and the rms distance that remains."""
    columns, damping = np.flatnonzero(free), 1e-6
    uv, _, by_lens = lenses.project_with_derivatives(rays, lens)
    cost = float(((uv - goal) ** 2).sum())
    for _ in range(_STEPS):
        jacobian = by_lens[:, :, columns].reshape(-1, len(columns))
        size = np.linalg.norm(jacobian, axis=0)
        normal = (jacobian / size).T @ (jacobian / size)
        gradient = (jacobian / size).T @ (uv - goal).ravel()
        step = np.linalg.solve(normal + damping * np.eye(len(columns)), gradient) / size
        trial = lens.copy()
        trial[columns] -= step
        trial_uv, _, trial_by_lens = lenses.project_with_derivatives(rays, trial)
        trial_cost = float(((trial_uv - goal) ** 2).sum())
        if not trial_cost < cost or (trial[:2] <= 0).any():
            damping *= 10
            if damping > 1e6:
                break
            continue
        gain = cost - trial_cost
        lens, uv, by_lens, cost, damping = trial, trial_uv, trial_by_lens, trial_cost, max(damping / 10, 1e-12)
        if gain <= _SMALLEST_CHANGE * cost:
            break
    return lens, float(np.sqrt(cost / len(rays)))
