"""Data from which findings are derived."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from spherecal.adjust.bundle import MIN_ANGLE_RAD, Adjustment
from spherecal.adjust.weights import camera_noise
from spherecal.ball.fit import BallFit
from spherecal.ball.rigid import ModelChoice
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.data.observations import Features, Observations
from spherecal.data.session import Session
from spherecal.diagnose.score import ScoreTest, make_score_test
from spherecal.initialise.local import LocalNetwork
from spherecal.scale.metric import Solution

STAGE = "diagnosis"


@dataclass(frozen=True)
class Evidence:
    """All data from which the findings are derived; `residual_px` (n,2) and `used` (n,) belong to the observations."""

    session: Session
    observations: Observations
    features: Features
    local: LocalNetwork
    placed: BoolArray
    solved: BallFit
    choice: ModelChoice
    solution: Solution
    residual_px: FloatArray
    used: BoolArray
    context: Context = field(default_factory=Context)

    @property
    def adjusted(self) -> Adjustment:
        """The last adjustment."""
        return self.solved.adjusted

    @property
    def camera_ids(self) -> tuple[str, ...]:
        """Ids of all cameras of the session."""
        return self.observations.cameras

    @cached_property
    def probe(self) -> ScoreTest | None:
        """The solved network, prepared for tests; None where it is singular."""
        a, cofactors = self.adjusted, self.solved.cofactors
        if cofactors is None or a.redundancy <= 0 or not a.variance > 0:
            return None
        return make_score_test(a.problem, a.state, cofactors, a.minimum.cost, a.redundancy)

    @property
    def has_own_scale(self) -> bool:
        """Whether millimetres are part of the adjustment, and not given to it afterwards."""
        return False

    @property
    def of_frames(self) -> bool:
        """Whether placements are frames of a board or a bar, of which there may be few."""
        return False

    @cached_property
    def is_earlier_pose(self) -> BoolArray:
        """Which of the cameras (c,) are earlier poses of others (`--split`)."""
        return np.array([camera.earlier_pose_of is not None for camera in self.session.cameras], dtype=bool)

    def is_same_camera(self, a: int, b: int) -> bool:
        """Whether two cameras are the same device, before and after it moved."""
        names = [self.session.cameras[c].earlier_pose_of or self.session.cameras[c].id for c in (a, b)]
        return names[0] == names[1]

    @property
    def ambiguous(self) -> BoolArray:
        """Cameras (c,) that have no pose because two fit equally well."""
        found = self.solved.ambiguous
        return np.zeros_like(self.placed) if found is None else found & ~self.placed

    @cached_property
    def candidates(self) -> BoolArray:
        """Observations (n,) that could be checked: of placed cameras, of features that two of them see."""
        placed = self.placed[self.observations.camera]
        return placed & (self.solved.network.views(placed) >= 2)[self.solved.network.feature]

    @cached_property
    def contradicting(self) -> BoolArray:
        """Observations (n,) that could be checked and were left out, except because of nearly parallel rays."""
        candidates, network = self.candidates, self.solved.network
        out = candidates & ~self.used
        if not out.any():
            return out
        judged = candidates & (network.views(out) > 0)[network.feature]
        return out & (network.triangulated(self.adjusted.state, judged).max_angle_rad >= MIN_ANGLE_RAD)[network.feature]

    @cached_property
    def noise_px(self) -> FloatArray:
        """Standard deviation (c,) px of one coordinate in each camera's images; NaN without observations."""
        problem, state = self.adjusted.problem, self.adjusted.state
        factor = camera_noise(problem, state)  # what the weights do not include yet
        total, count = (
            np.bincount(problem.camera, weights, problem.n_cameras)
            for weights in (1 / problem.weight.mean(axis=1), np.ones(len(problem.camera)))
        )
        with np.errstate(invalid="ignore"):
            return np.sqrt(self.adjusted.variance) * factor * total / np.where(count > 0, count, np.nan)

    def image_counts(self, rows: BoolArray) -> IntArray:
        """How many of some observations (n,) each image has, (placements, cameras)."""
        o = self.observations
        shape = (len(o.placements), len(o.cameras))
        return np.bincount(o.placement[rows] * shape[1] + o.camera[rows], minlength=shape[0] * shape[1]).reshape(shape)
