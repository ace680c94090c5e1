"""A lens put into a smaller model: the nearest one there is, and what it costs in pixels."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.errors import InputError
from spherecal.data.rig_camera import RigCamera
from spherecal.geometry.camera import INTRINSIC_NAMES, N_INTRINSICS, project, undistort
from spherecal.geometry.rotation import exp_rotation

Box = tuple[FloatArray, FloatArray]  # lowest and highest corner, (3,) mm each

# Fitted on 41 x 31 points up to the image's edges, judged on others: the largest difference lies in a corner, which
# both grids have, so that 401 x 301 points find the same figure to ten digits.
_FIT_GRID, _JUDGE_GRID = (41, 31), (101, 76)
_STEPS = (4, 5, 8, 12)
# Of the grid, so that a lens is not fitted to a corner of the image.
_LEAST_SEEN = 0.05
_RATIONAL, _DENOMINATOR = 6, slice(9, 12)  # from so many coefficients on there is a denominator: k4 k5 k6
# Of their differences from the whole lens's. Without it 13 of 24 lenses with a prism, put into 8 coefficients, had a
# pole within the image (51 px off beside it); with 0.01 none has, with 0.1 the largest difference is the least as well.
_DENOMINATOR_WEIGHT_PX = 0.1
_LEVELLINGS = 10  # the demo rig's largest loss goes from 0.107 to 0.032 px in as many, and no lower in 30


@dataclass(frozen=True)
class Loss:
    """What a refit changed over the image, or the image points that see a volume, and the turn of the camera."""

    rms_px: float
    max_px: float
    turned_deg: float
    image_px: float | None = None  # the largest difference over the image where it was fitted over a volume, else None


def refit(
    intrinsics: FloatArray, image_size: tuple[int, int], coefficients: int, seeing: tuple[RigCamera, Box] | None = None
) -> tuple[FloatArray, FloatArray, Loss]:
    """The nearest lens with the first `coefficients` distortion numbers: its 16 numbers, a rotation (3, 3), the loss.

    To second order a lens with a prism looks like a turned one with tangential distortion, so that a turn may halve the
    loss; elsewhere `x_camera' = rotation @ x_camera` is the identity. `seeing` None: judged over the whole image.
    """
    rays, uv = _rays(intrinsics, image_size, _FIT_GRID)
    if len(uv) < 0.5 * _FIT_GRID[0] * _FIT_GRID[1]:
        raise InputError("The distortion folds over itself within the image, so no smaller lens model can replace it.")
    judged = image = _rays(intrinsics, image_size, _JUDGE_GRID)
    if seeing is not None:
        within = [_meets(one[0], *seeing) for one in ((rays, uv), judged)]
        if within[0].mean() < _LEAST_SEEN:
            seeing = None
        else:
            rays, uv, judged = rays[within[0]], uv[within[0]], (judged[0][within[1]], judged[1][within[1]])
    candidates = []
    for turned in (False, True):
        lens, rotation = _fit(rays, uv, intrinsics, coefficients, turned)
        if seeing is not None:
            # the fit whose largest difference is least, by weights that grow where it is large (Lawson, 1961)
            best, weights = (np.inf, lens, rotation), np.ones(len(uv))
            for _ in range(_LEVELLINGS):
                off = np.linalg.norm(project(rays @ rotation.T, lens) - uv, axis=1)
                if off.max() < best[0]:
                    best = float(off.max()), lens, rotation
                weights = weights * (off + 0.05 * off.max())
                weights /= weights.mean()
                lens, rotation = _fit(rays, uv, lens, coefficients, turned, np.sqrt(weights))
            _, lens, rotation = best
        difference = np.linalg.norm(project(judged[0] @ rotation.T, lens) - judged[1], axis=1)
        angle = float(np.rad2deg(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))
        over = None if seeing is None else np.linalg.norm(project(image[0] @ rotation.T, lens) - image[1], axis=1)
        whole = None if over is None else float(over.max())
        loss = Loss(float(np.sqrt((difference**2).mean())), float(difference.max()), angle, whole)
        candidates.append((lens, rotation, loss))
    plain, free = candidates
    return free if free[2].max_px < 0.5 * plain[2].max_px else plain


def dropped(intrinsics: FloatArray, coefficients: int) -> tuple[str, ...]:
    """The distortion numbers of a lens (16,) in use that are not among the first `coefficients`, by name."""
    return tuple(
        name for name, value in list(zip(INTRINSIC_NAMES, intrinsics, strict=True))[4 + coefficients :] if value
    )


def pixel_grid(image_size: tuple[int, int], grid: tuple[int, int]) -> FloatArray:
    """Image points (n, 2) px from edge to edge of an image (width, height), row by row; `grid`: (columns, rows)."""
    width, height = image_size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, grid[0]), np.linspace(-0.5, height - 0.5, grid[1]))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def _rays(intrinsics: FloatArray, size: tuple[int, int], grid: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """Directions (n, 3) and image points (n, 2) over the image, where the lens can be inverted."""
    uv = pixel_grid(size, grid)
    xy, good = undistort(uv, intrinsics)
    return np.column_stack([xy[good], np.ones(good.sum())]), uv[good]


def _meets(rays: FloatArray, camera: RigCamera, box: Box) -> BoolArray:
    """Which directions (n, 3) of a camera meet a box before it."""
    directions, centre = rays @ camera.rotation, camera.centre_mm
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(corner - centre) / directions for corner in box])
    near, far = np.nanmin(ends, axis=0).max(axis=1), np.nanmax(ends, axis=0).min(axis=1)
    return (near <= far) & (far > 0)


def _fit(
    rays: FloatArray,
    uv: FloatArray,
    intrinsics: FloatArray,
    coefficients: int,
    turned: bool,
    weights: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Least squares over the intrinsics that remain, and over a rotation where `turned`, from few coefficients to all.

    Started at once with all eight of a rational model, which can replace each other, the search stops early (0.30 px
    instead of 0.02 px for a lens with a prism); for the same reason the denominator's three stay near the whole lens's.
    """
    lens, rotation_vector = intrinsics.copy(), np.zeros(3)
    for count in (*(n for n in _STEPS if n < coefficients), coefficients):
        # focal lengths and centre in thousands of pixels, so that all parameters are of one size
        size = np.where(np.arange(4 + count) < 4, 1000.0, 1.0)

        def unpack(x: FloatArray, size: FloatArray = size) -> tuple[FloatArray, FloatArray]:
            new = np.zeros(N_INTRINSICS)
            new[: len(size)] = x[: len(size)] * size
            return new, exp_rotation(x[len(size) :]) if turned else np.eye(3)

        def residuals(x: FloatArray, rational: bool = count >= _RATIONAL) -> FloatArray:
            new, rotation = unpack(x)
            off = project(rays @ rotation.T, new) - uv
            off = off if weights is None else off * weights[:, None]
            stay = _DENOMINATOR_WEIGHT_PX * (new - intrinsics)[_DENOMINATOR]
            return np.concatenate([off.ravel(), stay]) if rational else off.ravel()

        start = np.concatenate([lens[: len(size)] / size, rotation_vector if turned else []])
        lens[len(size) :] = 0
        found = least_squares(residuals, start, method="lm", xtol=1e-10, ftol=1e-6, gtol=1e-12).x
        lens[: len(size)], rotation_vector = found[: len(size)] * size, found[len(size) :]
    return lens, exp_rotation(rotation_vector) if turned else np.eye(3)
