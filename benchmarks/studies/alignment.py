"""Similarity transformations between point sets, and a true network brought to where an estimate stands."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Similarity:
    """x' = scale * rotation @ x + shift."""

    scale: float
    rotation: FloatArray
    shift: FloatArray

    def points(self, x: FloatArray) -> FloatArray:
        """Points (n, 3) transformed."""
        return self.scale * x @ self.rotation.T + self.shift

    def state(self, state: State) -> State:
        """A network (free form) transformed; every camera sees the same."""
        rotation = state.rotation @ self.rotation.T
        translation = self.scale * state.translation - rotation @ self.shift
        return replace(state, rotation=rotation, translation=translation, points=self.points(state.points))


def similarity(source: FloatArray, target: FloatArray) -> Similarity:
    """The least-squares similarity from points (n, 3) to their counterparts (B. Horn, JOSA A 4, 1987; by an SVD)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * sign) @ vt
    scale = float((b * (a @ rotation.T)).sum() / (a**2).sum())
    return Similarity(scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0))


def centres(state: State) -> FloatArray:
    """Projection centres (c, 3)."""
    return -np.einsum("cji,cj->ci", state.rotation, state.translation)


def centre_errors(estimate: State, true: State, placed: BoolArray) -> FloatArray:
    """Distances (c,) of the placed cameras' centres from the truth, in its units, after their best similarity."""
    fit = similarity(centres(estimate)[placed], centres(true)[placed])
    return np.linalg.norm(fit.points(centres(estimate)[placed]) - centres(true)[placed], axis=1)
