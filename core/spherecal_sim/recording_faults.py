"""Faults of simulated recordings: wrong matches, lenses the model cannot follow, a ball that changes its shape."""

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.data.observations import Observations
from spherecal_sim.simulated_ball import Ball, random_bumps


def lens_misfit(uv: FloatArray, size: FloatArray, phases: FloatArray, amplitude_px: float) -> FloatArray:
    """A smooth field of about one period per image, (n, 2) px, of rms `amplitude_px` per axis.

    `phases`: phases of each row's camera, (n, 4) rad.
    """
    turns = 2 * np.pi * uv / size
    du = np.sin(turns[:, 0] + phases[:, 0]) * np.cos(turns[:, 1] + phases[:, 1])
    dv = np.sin(turns[:, 1] + phases[:, 2]) * np.cos(turns[:, 0] + phases[:, 3])
    return 2 * amplitude_px * np.stack([du, dv], axis=1)  # sin cos has an rms of 1/2


def shape_changes(ball: Ball, count: int, rms_mm: float, kind: str, rng: np.random.Generator) -> FloatArray:
    """Displacements of the ball's dots in `count` placements, (count, dots, 3) mm."""
    if kind == "per-dot":
        return rng.normal(0.0, rms_mm / np.sqrt(3.0), (count, len(ball.dots_mm), 3))
    n = ball.dots_mm / np.linalg.norm(ball.dots_mm, axis=1, keepdims=True)
    change = np.array([[random_bumps(1.0, rng).height(n) for _ in range(3)] for _ in range(count)]).transpose(0, 2, 1)
    return change * (rms_mm / np.sqrt((change**2).sum(axis=2).mean(axis=1)))[:, None, None]


# Kinds of outliers: half are exchanged ids, three in ten are poor centres, the rest lie anywhere.
_EXCHANGED, _POOR = 0.5, 0.3
_POOR_PX = (0.5, 3.0)


def spoil(
    observations: Observations, sizes: FloatArray, fraction: float, rng: np.random.Generator
) -> tuple[Observations, BoolArray]:
    """Observations of which a fraction is wrong, and which are, (n,).

    Half of the wrong ones come from targets that exchanged their ids in one image (all dots of both). 30 % are 0.5 to 3
    px off in any direction, 20 % are anywhere in the frame.

    `sizes`: image sizes by camera, (cameras, 2) px.
    """
    n = len(observations)
    uv = observations.uv.copy()
    wrong = np.zeros(n, dtype=bool)
    _exchange_ids(observations, uv, wrong, round(_EXCHANGED * fraction * n), rng)
    left = rng.permutation(np.flatnonzero(~wrong))
    poor = left[: round(_POOR * fraction * n)]
    angle = rng.uniform(0.0, 2 * np.pi, len(poor))
    uv[poor] += rng.uniform(*_POOR_PX, (len(poor), 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    anywhere = left[len(poor) : len(poor) + round((1 - _EXCHANGED - _POOR) * fraction * n)]
    uv[anywhere] = rng.uniform(-0.5, sizes[observations.camera[anywhere]] - 0.5)
    wrong[poor] = wrong[anywhere] = True
    o = observations
    spoilt = Observations(o.placements, o.cameras, o.points, o.placement, o.camera, o.target, o.point, uv, o.sigma)
    return spoilt, wrong


def _exchange_ids(o: Observations, uv: FloatArray, wrong: BoolArray, goal: int, rng: np.random.Generator) -> None:
    """Exchange ids of pairs of targets within images until about `goal` observations are wrong (in place)."""
    image = o.placement * len(o.cameras) + o.camera
    for i in rng.permutation(len(o)):
        if wrong.sum() + 8 > goal:  # a pair of whole targets spoils 16
            return
        rows = np.flatnonzero((image == image[i]) & ~wrong)
        others = np.unique(o.target[rows[o.target[rows] != o.target[i]]])
        if wrong[i] or not len(others):
            continue
        other = rng.choice(others)
        a, b = rows[o.target[rows] == o.target[i]], rows[o.target[rows] == other]
        _, in_a, in_b = np.intersect1d(o.point[a], o.point[b], return_indices=True)
        a, b = a[in_a], b[in_b]
        uv[a], uv[b] = uv[b], uv[a]
        wrong[a] = wrong[b] = True
