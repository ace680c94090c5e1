"""The network an adjustment works on: who observes what, and what is known of each camera."""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust.problem import Priors, Problem, State, sorted_problem
from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.triangulation import Triangulation, triangulate


@dataclass(frozen=True)
class Network:
    """Observation i sees feature `feature[i]` in camera `camera[i]` at `uv[i]` px.

    sigma (n,2) px or None; `free` (c,16) the intrinsics to estimate, `group` (c,) who shares them, `priors` what is
    known of them beside the observations.
    """

    feature: IntArray
    camera: IntArray
    uv: FloatArray
    sigma: FloatArray | None
    n_features: int
    free: BoolArray
    group: IntArray
    priors: Priors | None = None

    def problem(self, used: BoolArray, free: BoolArray, placed: BoolArray, weighted: bool) -> tuple[Problem, IntArray]:
        """The bundle adjustment of the used observations, and which observation each of its rows is.

        Of the placed cameras only those that still see something have unknowns.
        """
        rows = np.flatnonzero(used)
        placed = placed & (np.bincount(self.camera[rows], minlength=len(placed)) > 0)
        sigma = self.sigma[rows] if weighted and self.sigma is not None else None
        problem, order = sorted_problem(
            self.camera[rows], self.feature[rows], self.uv[rows], sigma, self.n_features,
            free_pose=placed, free_intrinsics=free & placed[:, None], group=self.group, priors=self.priors,
        )  # fmt: skip
        return problem, rows[order]

    def locate(self, state: State, rows: BoolArray) -> Triangulation:
        """All features triangulated from some observations with the cameras of `state`."""
        weight = np.ones(len(self.uv)) if self.sigma is None else 1.0 / self.sigma**2
        take = np.flatnonzero(rows)
        return triangulate(
            self.feature[take], self.camera[take], self.uv[take], weight[take], self.n_features,
            state.intrinsics, state.rotation, state.translation,
        )  # fmt: skip

    def views(self, used: BoolArray) -> IntArray:
        """How many used observations each feature has, (m,)."""
        return np.bincount(self.feature[used], minlength=self.n_features)
