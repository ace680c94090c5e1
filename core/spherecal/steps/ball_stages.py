"""From the free form of a recording to its ball model in millimetres."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.bundle import Adjustment
from spherecal.adjust.network import Network, free_network
from spherecal.ball.fit import BallFit, Run, solve_free
from spherecal.ball.rigid import BallNetwork, RigidNetwork
from spherecal.ball.selection import ModelChoice, RequestedForm, RequestedModel, choose_ball_model
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.context import Context, Stopwatch
from spherecal.base.errors import InputError, PartialResultAccepted
from spherecal.base.memory import release_freed
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.lens_model import estimated_intrinsics
from spherecal.data.session import Recording
from spherecal.diagnose.anomalies import explained_by_moves
from spherecal.diagnose.ball_changes import sizes_to_fit
from spherecal.geometry.camera import estimated_mask
from spherecal.initialise.incremental import InitialPoses, grow
from spherecal.initialise.local import LocalNetwork, lasting_reference, reconstruct_locally
from spherecal.scale.metric import MetricFit, in_millimetres, metric_solution
from spherecal.scale.stored_ball import on_known_ball
from spherecal.steps.settings import CalibrationSettings


def describe_network(recording: Recording, settings: CalibrationSettings) -> Network:
    """Who observes what, and which intrinsics are to be estimated."""
    cameras, observations, features = recording.session.cameras, recording.observations, recording.features
    free = settings.intrinsics == "free"
    estimated = estimated_intrinsics(recording.session, free)
    if settings.method == "tao2021":
        estimated = np.tile(estimated_mask("tao2021") & free, (len(estimated), 1))
    names = [(c.earlier_pose_of or c.id) if settings.own_intrinsics else c.intrinsics_group for c in cameras]
    group = np.unique(names, return_inverse=True)[1].reshape(-1)
    network = free_network(
        features.of_observation, observations.camera, observations.uv, len(features), estimated, group
    ).with_sigma(observations.sigma)
    if settings.method == "tao2021":
        return network
    sizes = np.array([camera.image_size for camera in cameras], dtype=float)
    return replace(network, sizes=sizes, placement=observations.placement)


def local_network(recording: Recording, settings: CalibrationSettings, context: Context) -> LocalNetwork:
    """Two-view geometry, triples, view graph and paths of a recording, from its cameras' priors; [Tao21] (3)-(14)."""
    observations, features = recording.observations, recording.features
    local = reconstruct_locally(observations, features, recording.priors, settings.seed, context)
    release_freed()
    return lasting_reference(local, recording.session)


@dataclass(frozen=True)
class StartValues:
    """What the adjustment starts from: network, local reconstructions, poses; with `tao2021` the points too, or NaN."""

    network: Network
    local: LocalNetwork
    poses: InitialPoses

    @property
    def candidates(self) -> BoolArray:
        """The observations to start with (n,): those that the two-view gates keep, of cameras with a pose."""
        return self.local.keep & self.poses.placed[self.network.camera]


def start_values(
    recording: Recording, local: LocalNetwork, settings: CalibrationSettings, context: Context, turning: bool = False
) -> StartValues:
    """Poses chained along the paths and by resection; `turning`: whether images may turn."""
    context.report("start values", 0.0, Phrase("compiling"))
    network = replace(describe_network(recording, settings), turning=turning)
    poses = grow(local, network, recording.priors, local.keep, context)
    release_freed()
    return StartValues(network, local, poses)


def run_of(
    recording: Recording, start: StartValues, settings: CalibrationSettings, context: Context, watch: Stopwatch
) -> Run:
    """Data that the stages from the adjustment on share; the requested reference camera is first, if it has a pose."""
    cameras, placed = recording.session.cameras, start.poses.placed
    requested = [c for c, camera in enumerate(cameras) if camera.id == settings.reference and placed[c]]
    first, *others = dict.fromkeys((*requested, *start.local.graph.references))
    return Run(recording.priors, first, settings.method == "tao2021", tuple(others), context, watch)


def ball_network(recording: Recording, network: Network, local: LocalNetwork, free: BallFit) -> BallNetwork:
    """The dots of the ball in the free network; no two-view gate judges a camera that is alone."""
    candidates = local.keep | ~free.placed[network.camera]
    return BallNetwork(network, recording.features, recording.n_placements, recording.n_ball, candidates)


def fit_ball_model(
    recording: Recording, start: StartValues, free: BallFit, settings: CalibrationSettings, run: Run
) -> MetricFit:
    """The network in millimetres, in the ball model that the data support (decision 0006); free if the user stops."""
    ball = ball_network(recording, start.network, start.local, free)
    try:
        fit = _in_its_model(recording, free, ball, settings, run.accepting_partial())
    except PartialResultAccepted:
        if run.context.has_partial_result:  # the caller's result is further on
            raise
        solved, solution = in_millimetres(recording, free, run)
        fit = MetricFit(solved, ModelChoice("free", Phrase("form-stopped")), solution, stopped=True)
    # the cameras that it or the free form left out because two poses fit them equally well
    left_out = [form.ambiguous for form in (free, fit.solved) if form.ambiguous is not None]
    ambiguous = np.any(left_out, axis=0) if left_out else None
    return replace(fit, solved=replace(fit.solved, ambiguous=ambiguous))


def _in_its_model(
    recording: Recording, free: BallFit, ball: BallNetwork, settings: CalibrationSettings, run: Run
) -> MetricFit:
    """The network in millimetres: on a stored ball, as rigid as the data allow, or free; with its findings."""
    refused: tuple[Finding, ...] = ()
    if settings.ball is not None:
        stored = on_known_ball(recording, free, ball, settings.ball, run)
        run.watch.lap("known ball")
        if isinstance(stored, MetricFit):
            return stored
        refused = (stored,)
    fit, choice = free, ModelChoice("free", Phrase("form-asked-alone"))
    if settings.method in ("auto", "soft", "rigid"):
        fit, choice = select_ball_model(recording, free, ball, settings, run)
        run.watch.lap("rigid ball")
    fit, solution = in_millimetres(recording, fit, run)
    return MetricFit(fit, choice, solution, refused)


def select_ball_model(
    recording: Recording, free: BallFit, ball: BallNetwork, settings: CalibrationSettings, run: Run
) -> tuple[BallFit, ModelChoice]:
    """The rigid form if the data support it, else the soft or the free one; and the choice with its reasons."""
    wanted: RequestedForm = settings.method if settings.method in ("rigid", "soft") else "auto"

    def mm_per_unit(fit: BallFit) -> float:
        return metric_solution(recording, fit).factor

    def others(placed: BoolArray) -> list[BallFit]:
        return solve_others(recording, ball.network, placed, settings, run)

    def sizes(rigid: RigidNetwork, adjusted: Adjustment, free_variance: float | None) -> FloatArray | None:
        if settings.intrinsics == "fixed":  # a focal length that is wrong looks like other sizes
            return None
        return sizes_to_fit(rigid, adjusted, recording.observations.placement, recording.n_ball, free_variance)

    def is_moved(most: float) -> bool:
        weighted = replace(ball.network, noise=free.network.noise).corrected_as(free.network)
        found = explained_by_moves(replace(ball, network=weighted), free, run.context, most)
        return bool(found.moves) or found.group_motion is not None

    requested = RequestedModel(wanted, settings.shape_sd_mm, mm_per_unit, sizes, is_moved, others)
    fit, choice = choose_ball_model(free, ball, requested, run)
    if wanted not in ("auto", choice.form):
        raise InputError(Phrase("error-form-not-possible", {"form": wanted, "why": choice.reason}))
    return fit, choice


def solve_others(
    recording: Recording, network: Network, placed: BoolArray, settings: CalibrationSettings, run: Run
) -> list[BallFit]:
    """The free form of each group of cameras that has no common view with those placed, each in its own frame."""
    groups: list[BallFit] = []
    rest = ~placed
    observations, features = recording.observations, recording.features
    while rest.sum() >= 3:
        rows = np.flatnonzero(rest[observations.camera])
        own = observations.select(rows)
        own_features = replace(features, of_observation=features.of_observation[rows])
        local = reconstruct_locally(own, own_features, run.known, settings.seed, run.context)
        if not local.triples:
            break
        part = network.only(rows)
        start = grow(local, part, run.known, local.keep, run.context)
        candidates = local.keep & start.placed[part.camera]
        first, *others = local.graph.references
        alone = replace(run, reference=first, next_references=tuple(others))
        groups.append(solve_free(part, start, candidates, alone))
        rest &= ~start.placed
    return groups
