"""Boards and bars as the evidence of the ball's diagnosis: frames, with unknowns of their own, for its points."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from spherecal.adjust import engine
from spherecal.adjust.bundle import Adjustment
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.levenberg import Minimum
from spherecal.adjust.linear import Linearisation
from spherecal.adjust.network import free_network
from spherecal.adjust.state import State
from spherecal.ball.fit import BallFit
from spherecal.ball.rigid import FormName, ModelChoice
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal.base.threads import one_blas_thread
from spherecal.data.rig import RigScale
from spherecal.data.session import Session
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.score import ScoreTest
from spherecal.initialise.local import LocalNetwork
from spherecal.initialise.view_graph import CameraGraph
from spherecal.scale.metric import Solution
from spherecal_boards.frame_network import FrameModel, dense_couplings
from spherecal_boards.frames_adjustment import frame_factors

if TYPE_CHECKING:
    from spherecal_boards.board_findings import Fit


@dataclass(frozen=True)
class FrameTest(ScoreTest):
    """A network over frames, prepared for tests: `part` (n,) is what each row depends on, of `parts` in a frame."""

    part: IntArray
    parts: int

    def by_own(self, linear: Linearisation, rows: slice | IntArray) -> tuple[FloatArray, IntArray]:
        """Derivatives (k,2,q) of some rows by the unknowns of their frames, and these frames (k,)."""
        values = linear.by_placement if len(linear.by_placement) else linear.by_point
        frame, part = np.divmod(self.part[rows], self.parts)
        if self.parts == 1:
            return values, frame
        k = values.shape[2]
        wide = np.zeros((len(values), 2, self.parts, k))
        wide[np.arange(len(values)), :, part] = values
        return wide.reshape(len(values), 2, -1), frame


@dataclass(frozen=True)
class ReferenceCofactors:
    """Cofactors of the cameras' columns (e,e), the reference camera's pose fixed (see `adjust.covariance`)."""

    inverse: FloatArray
    frame_unknowns: int

    def all_cameras(self) -> FloatArray:
        """Cofactors of all cameras' parameters with each other, (c*w, c*w)."""
        return self.inverse

    def by_scores(self, functional: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Linear functions (m, c*w) of the cameras' parameters as functions of the scores; no datum takes any back."""
        return self.inverse @ functional.T, np.zeros((self.frame_unknowns, 0)), np.zeros((0, len(functional)))


@dataclass(frozen=True)
class Tested:
    """An adjusted network prepared for tests, and its cofactors in the same datum."""

    test: ScoreTest
    cofactors: ReferenceCofactors | Covariance


def frame_test(model: FrameModel, state: State, minimum: Minimum, redundancy: int) -> Tested | None:
    """The tests of an adjustment over frames at its minimum; None where it is singular or has no redundancy."""
    if redundancy <= 0 or not minimum.cost > 0:
        return None
    with one_blas_thread():
        found = frame_factors(model, state)
    if found is None:
        return None
    normal, inverse = found
    linear = engine.linear_model(model.observed, state, None)
    frames, q = normal.gradient_own.shape
    shift = np.concatenate(
        [
            -(normal.inverse[first : first + len(dense)] @ dense).reshape(len(dense) * q, -1)
            for first, dense in dense_couplings(normal, model.problem.n_cameras)
        ]
    )
    system = linear, linear.residual.ravel(), inverse, sparse.csr_array(shift), normal.inverse
    test = FrameTest(model.problem, *system, 2 * minimum.cost, redundancy, model.part, model.parts)
    return Tested(test, ReferenceCofactors(inverse, frames * q))


@dataclass(frozen=True)
class FrameEvidence(Evidence):
    """The evidence of a board or a bar."""

    test: ScoreTest | None = None

    @cached_property
    def probe(self) -> ScoreTest | None:
        """The solved network, prepared for tests."""
        return self.test

    @property
    def has_own_scale(self) -> bool:
        """Lengths of the board or bar are part of the adjustment."""
        return True

    @property
    def of_frames(self) -> bool:
        """They are."""
        return True

    @cached_property
    def candidates(self) -> BoolArray:
        """Observations (n,) of placed cameras of which it is known where they should be, or that two cameras see."""
        placed = self.placed[self.observations.camera]
        seen_by_two = (self.solved.network.views(placed) >= 2)[self.solved.network.feature]
        return np.isfinite(self.residual_px[:, 0]) | (placed & seen_by_two)

    @cached_property
    def contradicting(self) -> BoolArray:
        """Observations (n,) that could be checked and were left out."""
        return self.candidates & ~self.used

    @cached_property
    def noise_px(self) -> FloatArray:
        """Standard deviation (c,) px of one coordinate in each camera's images; NaN without observations."""
        a, camera = self.adjusted, self.observations.camera[self.used]
        square = np.bincount(camera, (self.residual_px[self.used] ** 2).sum(axis=1), len(self.placed))
        count = np.bincount(camera, minlength=len(self.placed))
        fitted = 2 * len(a.rows) / max(a.redundancy, 1)
        return np.sqrt(fitted * square / np.where(count > 0, 2.0 * count, np.nan))


def frame_evidence(
    session: Session, fit: "Fit", scale: RigScale, form: FormName, context: Context
) -> FrameEvidence | None:
    """The evidence of a fit, alike to the ball's `form` (marks free, boards rigid); None where cameras were chained."""
    adjusted = fit.adjusted
    if not adjusted.joint:
        return None
    o, features = fit.observations, fit.features
    network = free_network(features.of_observation, o.camera, o.uv, len(features), fit.free, fit.group)
    tested, minimum = fit.tested, adjusted.minimum
    problem, used = adjusted.model.problem, (adjusted.rows, adjusted.used)
    fitted = Adjustment(adjusted.state, problem, *used, minimum, adjusted.redundancy)
    cofactors = None if tested is None else tested.cofactors
    solved = BallFit(network.with_sigma(o.sigma), fitted, cofactors, adjusted.has_prior, fit.placed)  # type: ignore[arg-type]
    state = replace(adjusted.state, points=fit.points)
    n = len(fit.placed)
    counts = np.zeros((n, n), dtype=np.int64)
    return FrameEvidence(
        session,
        o,
        features,
        LocalNetwork(
            np.ones(len(o), dtype=bool), counts, [], CameraGraph((), np.zeros(n, dtype=np.int64), np.zeros(n)), {}
        ),
        fit.placed,
        solved,
        ModelChoice(form, Phrase("as-asked")),
        Solution(state, None, 1.0, scale, {}),
        fit.residual,
        adjusted.used,
        context,
        None if tested is None else tested.test,
    )
