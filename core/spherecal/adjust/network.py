"""The network an adjustment works on: which camera observes what, and what is known about each camera."""

from dataclasses import dataclass, field, replace

import numpy as np

from spherecal.adjust.ball_model import FREE, BallModel, Free, Stored, as_rigid
from spherecal.adjust.camera_effects import Corrections
from spherecal.adjust.problem import NO_LENGTHS, NO_PRIORS, LengthRows, Priors, Problem, sorted_problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.transform import PosedCameras
from spherecal.geometry.triangulation import Triangulation, agreeing_views, ray_angles, triangulate

_OF_OBSERVATIONS = ("feature", "camera", "uv", "sigma", "correction", "placement")


@dataclass(frozen=True)
class Network:
    """The network an adjustment works on.

    `feature, camera, uv, sigma`: observation i sees feature `feature[i]` in camera `camera[i]` at `uv[i]` px (n,2),
    with standard deviations `sigma[i]` (n,2) px; `n_features`: features, observed or not. On a ball that keeps its
    shape they are its dots, each seen at several placements; `free, group`: the intrinsics to estimate (c,16), and
    which cameras share them (c,); `noise`: multiplies the standard deviations of each camera's observations, (c,);
    `locked`: cameras whose pose is known and stays, (c,); `ball`: how the ball joins the observations; `priors,
    lengths`: what is known of the intrinsics, and distances between features; NO_PRIORS and NO_LENGTHS without any;
    `sizes, placement`: of the cameras' images (c,2) px, and which placement each observation is from (n,), for fields
    of lenses and motions of images; None and (0,) where neither is to be estimated; `corrections, correction`: what
    these are, and what they take from the measured image points to make `uv`, (n,2) px; None and (0,2) for nothing;
    `turning`: whether the motions are applied; `is_beyond`: whether corrections were refused, as they were too large.
    """

    feature: IntArray
    camera: IntArray
    uv: FloatArray
    sigma: FloatArray
    n_features: int
    free: BoolArray
    group: IntArray
    noise: FloatArray
    locked: BoolArray
    ball: BallModel = FREE
    priors: Priors = NO_PRIORS
    lengths: LengthRows = NO_LENGTHS
    sizes: FloatArray | None = None
    placement: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    correction: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    corrections: Corrections | None = None
    turning: bool = False
    is_beyond: bool = False

    def only(self, rows: IntArray | slice) -> "Network":
        """The same features and cameras with some of the observations."""
        each = {name: getattr(self, name) for name in _OF_OBSERVATIONS}
        some = {name: values[rows] if len(values) else values for name, values in each.items()}
        return replace(self, ball=self.ball.select(rows), **some)

    @property
    def measured(self) -> FloatArray:
        """The image points (n,2) px as they were measured."""
        return self.uv + self.correction if len(self.correction) else self.uv

    def corrected(self, corrections: Corrections | None, intrinsics: FloatArray) -> "Network":
        """The same with other corrections of the measured image points, or none, by intrinsics (c,16)."""
        measured = self.measured
        if corrections is None:
            return replace(self, uv=measured, correction=np.zeros((0, 2)), corrections=None)
        correction = corrections.of(measured, self.camera, self.placement, intrinsics)
        return replace(self, uv=measured - correction, correction=correction, corrections=corrections)

    def corrected_as(self, other: "Network") -> "Network":
        """The same with the corrections of a network of the same observations."""
        correction = other.correction
        uv = self.measured - correction if len(correction) else self.measured
        return replace(self, uv=uv, correction=correction, corrections=other.corrections)

    def with_sigma(self, sigma: FloatArray | None) -> "Network":
        """The same with standard deviations (n,2) px of the observations; unchanged where these state none."""
        return self if sigma is None else replace(self, sigma=sigma)

    def problem(self, used: BoolArray, free: BoolArray, placed: BoolArray, weighted: bool) -> tuple[Problem, IntArray]:
        """The bundle adjustment of the used observations (n,), and which observation each of its rows is.

        Of the placed cameras (c,) only those that still see something have unknowns, of these the `free` (c,16).
        """
        rows = np.flatnonzero(used)
        placed = placed & (np.bincount(self.camera[rows], minlength=len(placed)) > 0)
        ball = self.ball.select(rows)
        if not isinstance(ball, Free):
            seen = np.bincount(ball.placement, minlength=len(ball.free_placement)) > 0
            ball = replace(ball, free_placement=ball.free_placement & seen)
        problem, order = sorted_problem(
            self.camera[rows],
            self.feature[rows],
            self.uv[rows],
            self._sigma(rows) if weighted else None,
            self.n_features,
            free_pose=placed & ~self.locked,
            free_intrinsics=free & placed[:, None],
            group=self.group,
            ball=ball if weighted else as_rigid(ball),
            priors=self.priors,
            lengths=self._lengths_between(used) if weighted else NO_LENGTHS,
        )
        return problem, rows[order]

    def _lengths_between(self, used: BoolArray) -> LengthRows:
        """The known distances whose points are all seen twice."""
        seen = (self.views(used) >= 2)[self.lengths.points] | (self.lengths.coefficient == 0)
        return self.lengths.select(seen.all(axis=1))

    def triangulated(self, state: State, rows: BoolArray) -> Triangulation:
        """All features triangulated from some observations (n,) with the cameras (and placements) of `state`."""
        take = np.flatnonzero(rows)
        weight = 1.0 / self._sigma(take) ** 2
        view, cameras = self._views_of_the_ball(state, take)
        return triangulate(self.feature[take], view, self.uv[take], weight, self.n_features, cameras)

    def angles(self, state: State, rows: BoolArray) -> FloatArray:
        """The largest angle (m,) rad between two rays of each feature, as `triangulated` takes them from rows (n,)."""
        take = np.flatnonzero(rows)
        view, cameras = self._views_of_the_ball(state, take)
        return ray_angles(self.feature[take], view, self.uv[take], self.n_features, cameras)

    def agreeing(self, state: State, rows: IntArray, gate_px: FloatArray) -> BoolArray:
        """Which of some observations (k,) belong to the largest set of views that agree on a point within `gate_px`."""
        view, cameras = self._views_of_the_ball(state, rows)
        return agreeing_views(self.feature[rows], view, self.uv[rows], gate_px, cameras)

    def _sigma(self, rows: IntArray) -> FloatArray:
        """Standard deviations (n,2) of some observations by which they are weighted."""
        return self.sigma[rows] * self.noise[self.camera[rows], None]

    def _views_of_the_ball(self, state: State, rows: IntArray) -> tuple[IntArray, PosedCameras]:
        """Which camera pose each row is seen from, and all of them: as if the ball were at rest and cameras moved."""
        camera = self.camera[rows]
        if isinstance(self.ball, Free):
            return camera, state.cameras
        # of the ball, which a pose of the camera cannot have: all else is smaller
        size = np.cbrt(np.linalg.det(state.placement_rotation))
        size = np.where(np.abs(size - 1) < 1e-9, 1.0, size)
        turn = state.placement_rotation / size[:, None, None]
        rotation = np.einsum("cij,tjk->ctik", state.rotation, turn).reshape(-1, 3, 3)
        translation = np.einsum("cij,tj->cti", state.rotation, state.placement_translation) + state.translation[:, None]
        translation = translation / size[:, None]
        count = len(size)
        view = camera * count + self.ball.placement[rows]
        return view, PosedCameras(np.repeat(state.intrinsics, count, axis=0), rotation, translation.reshape(-1, 3))

    def world_points(self, state: State) -> FloatArray:
        """The observed point of every observation in the world frame, (n,3); NaN where it is not known."""
        points = state.points[self.feature]
        if isinstance(self.ball, Free):
            return points
        turned = np.einsum("nij,nj->ni", state.placement_rotation[self.ball.placement], points)
        carried = turned + state.placement_translation[self.ball.placement]
        has_noise = len(state.shape_residual) and len(self.ball.place)
        return carried + state.shape_residual[self.ball.place] if has_noise else carried

    def camera_points(self, state: State) -> FloatArray:
        """The observed point of every observation in its camera's frame, (n,3); NaN where it is not known."""
        turned = np.einsum("nij,nj->ni", state.rotation[self.camera], self.world_points(state))
        return turned + state.translation[self.camera]

    def views(self, used: BoolArray) -> IntArray:
        """How many used observations each feature has, (m,)."""
        return np.bincount(self.feature[used], minlength=self.n_features)

    @property
    def known(self) -> BoolArray:
        """Features (m,) whose place on the ball is already known: one view of them is enough."""
        return self.ball.shape.known if isinstance(self.ball, Stored) else np.zeros(self.n_features, dtype=bool)


def free_network(
    feature: IntArray, camera: IntArray, uv: FloatArray, n_features: int, free: BoolArray, group: IntArray
) -> Network:
    """The network in which every feature is a point of its own: no camera locked, all observations weigh the same."""
    noise, locked = np.ones(len(group)), np.zeros(len(group), dtype=bool)
    sigma = np.broadcast_to(1.0, uv.shape)  # one number: 16 MB less of a million observations
    return Network(feature, camera, uv, sigma, n_features, free, group, noise, locked)
