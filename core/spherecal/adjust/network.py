"""The network an adjustment works on: who observes what, and what is known of each camera."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.problem import LengthRows, Priors, Problem, ShapePrior, State, sorted_problem
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.consensus import agreeing_views
from spherecal.geometry.triangulation import Triangulation, ray_angles, triangulate

_OF_OBSERVATIONS = ("feature", "camera", "uv", "sigma", "placement", "place")


@dataclass(frozen=True)
class Network:
    """Observation i sees feature `feature[i]` in camera `camera[i]` at `uv[i]` px.

    sigma (n,2) px or None; `free` (c,16) the intrinsics to estimate, `group` (c,) who shares them, `priors` what is
    known of them beside the observations. In the rigid form a feature is a dot of the ball, seen at several placements:
    `placement` (n,) is each observation's pose block and `free_placement` (t,) says which of them are estimated (the
    others are the world itself). `lengths` are known distances between features. `noise` (c,) multiplies the standard
    deviations of each camera's observations; `locked` (c,): cameras whose pose is known and stays. In the soft form
    `place` (n,) and `play` (f,) are those of the Problem, as is `shape`, a stored shape of the ball.
    """

    feature: IntArray
    camera: IntArray
    uv: FloatArray
    sigma: FloatArray | None
    n_features: int
    free: BoolArray
    group: IntArray
    priors: Priors | None = None
    placement: IntArray | None = None
    free_placement: BoolArray | None = None
    lengths: LengthRows | None = None
    noise: FloatArray | None = None
    locked: BoolArray | None = None
    place: IntArray | None = None
    play: FloatArray | None = None
    shape: ShapePrior | None = None

    @property
    def n_placements(self) -> int:
        """Pose blocks of the ball, 0 in the free form."""
        return 0 if self.free_placement is None else len(self.free_placement)

    def only(self, rows: IntArray | slice) -> "Network":
        """The same features and cameras with some of the observations."""
        each = {name: value[rows] for name in _OF_OBSERVATIONS if (value := getattr(self, name)) is not None}
        return replace(self, **each)

    def problem(self, used: BoolArray, free: BoolArray, placed: BoolArray, weighted: bool) -> tuple[Problem, IntArray]:
        """The bundle adjustment of the used observations, and which observation each of its rows is.

        Of the placed cameras only those that still see something have unknowns.
        """
        rows = np.flatnonzero(used)
        placed = placed & (np.bincount(self.camera[rows], minlength=len(placed)) > 0)
        sigma = self._sigma(rows) if weighted else None
        free_placement = self.free_placement
        if self.placement is not None and free_placement is not None:
            seen = np.bincount(self.placement[rows], minlength=len(free_placement)) > 0
            free_placement = free_placement & seen
        problem, order = sorted_problem(
            self.camera[rows], self.feature[rows], self.uv[rows], sigma, self.n_features,
            free_pose=placed if self.locked is None else placed & ~self.locked,
            free_intrinsics=free & placed[:, None], group=self.group, priors=self.priors,
            placement=None if self.placement is None else self.placement[rows],
            n_placements=self.n_placements, free_placement=free_placement,
            lengths=self._lengths_between(used) if weighted else None,
            place=self.place[rows] if weighted and self.place is not None else None,
            play=self.play if weighted else None, shape=self.shape if weighted else None,
        )  # fmt: skip
        return problem, rows[order]

    def _lengths_between(self, used: BoolArray) -> LengthRows | None:
        """The known distances whose points are all seen twice."""
        if self.lengths is None:
            return None
        seen = (self.views(used) >= 2)[self.lengths.points] | (self.lengths.coefficient == 0)
        keep = seen.all(axis=1)
        return self.lengths.select(keep) if keep.any() else None

    def locate(self, state: State, rows: BoolArray) -> Triangulation:
        """All features triangulated from some observations with the cameras (and placements) of `state`."""
        take = np.flatnonzero(rows)
        sigma = self._sigma(take)
        weight = np.ones((len(take), 2)) if sigma is None else 1.0 / sigma**2
        view, intrinsics, rotation, translation = self._views_of_the_ball(state, take)
        return triangulate(
            self.feature[take], view, self.uv[take], weight, self.n_features, intrinsics, rotation, translation
        )

    def angles(self, state: State, rows: BoolArray) -> FloatArray:
        """The largest angle (m,) rad between two rays of each feature, of some observations, as `locate` tells it."""
        take = np.flatnonzero(rows)
        view, intrinsics, rotation, _ = self._views_of_the_ball(state, take)
        return ray_angles(self.feature[take], view, self.uv[take], self.n_features, intrinsics, rotation)

    def agreeing(self, state: State, rows: IntArray, gate_px: FloatArray) -> BoolArray:
        """Which of some observations (k,) belong to the largest set of views that agree on a point within `gate_px`."""
        view, intrinsics, rotation, translation = self._views_of_the_ball(state, rows)
        return agreeing_views(self.feature[rows], view, self.uv[rows], gate_px, intrinsics, rotation, translation)

    def _sigma(self, rows: IntArray) -> FloatArray | None:
        """Standard deviations (n,2) of some observations by which they are weighted, None where all weigh the same."""
        sigma = None if self.sigma is None else self.sigma[rows]
        if self.noise is None:
            return sigma
        noise = self.noise[self.camera[rows], None]
        return np.broadcast_to(noise, (len(rows), 2)) if sigma is None else sigma * noise

    def _views_of_the_ball(self, state: State, rows: IntArray) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Which camera pose each row is seen from, and all of them: as if the ball stood still and cameras moved."""
        camera = self.camera[rows]
        if self.placement is None or state.placement_rotation is None or state.placement_translation is None:
            return camera, state.intrinsics, state.rotation, state.translation
        turn, shift = state.placement_rotation, state.placement_translation
        rotation = np.einsum("cij,tjk->ctik", state.rotation, turn).reshape(-1, 3, 3)
        translation = np.einsum("cij,tj->cti", state.rotation, shift) + state.translation[:, None]
        view = camera * self.n_placements + self.placement[rows]
        return view, np.repeat(state.intrinsics, self.n_placements, axis=0), rotation, translation.reshape(-1, 3)

    def world_points(self, state: State) -> FloatArray:
        """The observed point of every observation in the world frame, (n,3); NaN where it is not known."""
        points = state.points[self.feature]
        if self.placement is None or state.placement_rotation is None or state.placement_translation is None:
            return points
        turned = np.einsum("nij,nj->ni", state.placement_rotation[self.placement], points)
        carried = turned + state.placement_translation[self.placement]
        return carried if self.place is None or state.bend is None else carried + state.bend[self.place]

    def camera_points(self, state: State) -> FloatArray:
        """The observed point of every observation in its camera's frame, (n,3); NaN where it is not known."""
        turned = np.einsum("nij,nj->ni", state.rotation[self.camera], self.world_points(state))
        return turned + state.translation[self.camera]

    def views(self, used: BoolArray) -> IntArray:
        """How many used observations each feature has, (m,)."""
        return np.bincount(self.feature[used], minlength=self.n_features)

    @property
    def known(self) -> BoolArray:
        """Features (m,) whose place on the ball is known before: one view is enough of them."""
        return np.zeros(self.n_features, dtype=bool) if self.shape is None else self.shape.known
