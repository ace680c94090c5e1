"""The method on one page: images -> observations -> triples -> paths -> adjustment -> covariance and scale -> rig."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from spherecal.adjust.network import Network
from spherecal.ball.rigid import BallNetwork
from spherecal.ball.run import Run
from spherecal.ball.selection import BallFit, ModelChoice, RequestedModel, Wanted, choose_ball_model, solve_free
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.context import Context, Stopwatch
from spherecal.base.errors import InputError, PartialResultAccepted
from spherecal.base.memory import release_freed
from spherecal.base.messages.values import Phrase
from spherecal.base.threads import on_one_blas_thread
from spherecal.data.edits import Repairs, recorded, repaired
from spherecal.data.findings import Finding
from spherecal.data.lens_model import estimated_intrinsics, with_lens_model
from spherecal.data.observations import Features
from spherecal.data.recording import Recording
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.data.verdict import with_findings
from spherecal.detect.nothing_found import nothing_found
from spherecal.detect.redetection import with_missed_targets
from spherecal.detect.session_images import observed
from spherecal.diagnose.anomalies import explained_by_moves
from spherecal.diagnose.automatic_edits import edited_where_certain
from spherecal.diagnose.checks import STOPPED
from spherecal.diagnose.lens_models import best_lens_model
from spherecal.diagnose.plausibility import implausible
from spherecal.files.assumed import assumed_of_session
from spherecal.files.ball_file import BallProfile
from spherecal.geometry.camera import LensModel, estimated_mask
from spherecal.initialise.chain import chain_points
from spherecal.initialise.incremental import InitialPoses, grow
from spherecal.initialise.local import LocalNetwork, lasting_reference, reconstruct_locally
from spherecal.initialise.path import Search
from spherecal.initialise.spherical_projection import project_to_spheres
from spherecal.methods.bar import calibrate_bar
from spherecal.methods.board import calibrate_board
from spherecal.result.build import build_failed_result, build_result
from spherecal.scale.metric import MetricFit, Solution, in_millimetres, metric_solution
from spherecal.scale.stored_ball import on_known_ball

Method = Literal["auto", "tao2021", "free", "soft", "rigid", "board", "bar"]


@dataclass(frozen=True)
class CalibrationSettings:
    """How to calibrate; `auto` is `rigid` where the data carry it, else `soft` or `free`.

    `shape_sd_mm`: of the soft form, how far the ball's dots may be off its shape (standard deviation per coordinate);
    None to estimate it. `ball`: a stored shape of the recorded ball, for `auto` and `rigid`.

    `tao2021` starts from chained points and spherical projection and estimates the paper's distortion terms; `search`
    `first` is none-OPT, `spherical_projection` False none-SPO. `intrinsics` `fixed` keeps the priors,
    `own_intrinsics` disregards intrinsics groups. `lens`: the lens model of all cameras; None for the session's own,
    `auto` for the one that fits best where the session's misfits.
    `repair_by_itself`: leave out wrong images and split moved cameras
    where that is certain (diagnose/automatic_edits.py). `reference`: the camera whose frame is the world, where it can
    be placed; None for the one that belongs to most triples.
    """

    method: Method = "auto"
    search: Search = "opt"
    spherical_projection: bool = True
    intrinsics: Literal["free", "fixed"] = "free"
    own_intrinsics: bool = False
    lens: LensModel | Literal["auto"] | None = None
    seed: int = 0
    repairs: Repairs = field(default_factory=Repairs)
    shape_sd_mm: float | None = None
    ball: BallProfile | None = None
    repair_by_itself: bool = True
    reference: str | None = None


@on_one_blas_thread
def calibrate(
    session: Session, settings: CalibrationSettings | None = None, context: Context | None = None
) -> Calibration:
    """The calibrated rig of a session's images or observations, with points, residuals, spheres and findings.

    A rig that could not be calibrated, or only in part, is a result too, with `valid` False and findings that say why.
    InputError where the session has neither, or images that cannot be read.
    """
    settings, context, watch = settings or CalibrationSettings(), context or Context(), Stopwatch()
    if settings.repairs:
        mended = repaired(session, settings.repairs)
        done = calibrate(mended, replace(settings, repairs=Repairs()), context)
        return recorded(done, session, mended, settings.repairs)
    if settings.lens not in (None, "auto"):
        session = with_lens_model(session, settings.lens)
    _check_settings(session, settings)
    if settings.method in ("board", "bar"):
        return with_findings(_by_baseline(session, settings, context), tuple(assumed_of_session(session)))
    has_images_alone = session.observations is None
    if has_images_alone:
        session = observed(session, context)
        watch.lap("detection")
    missing = nothing_found(session, from_images=has_images_alone)

    def run(some: Session) -> Calibration:
        said = (*missing, *implausible(some), *assumed_of_session(some))
        if has_images_alone:
            return with_findings(_with_second_look(some, settings, context, watch), said)
        return with_findings(_calibrate(some, settings, context, watch), said)

    return edited_where_certain(session, run) if settings.repair_by_itself else run(session)


def _by_baseline(session: Session, settings: CalibrationSettings, context: Context) -> Calibration:
    own = settings.own_intrinsics
    if settings.method == "board":
        return calibrate_board(session, settings.intrinsics, own, context)
    return calibrate_bar(session, settings.intrinsics, own, settings.seed, context)


def _check_settings(session: Session, settings: CalibrationSettings) -> None:
    other = next((camera for camera in session.cameras if camera.lens_model != "brown"), None)
    if settings.method == "tao2021" and other is not None:
        raise InputError(Phrase("error-lens-of-method", {"camera": other.id, "model": other.lens_model}))
    if settings.ball is not None and settings.method not in ("auto", "rigid"):
        raise InputError(Phrase("error-profile-method", {"method": settings.method}))


def _with_second_look(
    session: Session, settings: CalibrationSettings, context: Context, watch: Stopwatch
) -> Calibration:
    """The calibration with the targets that only its predictions find in the images."""
    first = _calibrate(session, settings, context, Stopwatch())
    try:
        session = with_missed_targets(session, first, context.accepting_partial())
        watch.lap("second look")
        return _calibrate(session, settings, context.accepting_partial(), watch)
    except PartialResultAccepted:
        return stopped_early(first)


def _calibrate(session: Session, settings: CalibrationSettings, context: Context, watch: Stopwatch) -> Calibration:
    """The method from observations to the rig."""
    recording = Recording.of(session)
    network = describe_network(recording, settings)
    known = np.array([camera.prior for camera in session.cameras])

    local = local_network(recording, known, settings, context)
    watch.lap("local reconstruction")
    release_freed()
    if not local.triples:
        return build_failed_result(recording, local, settings.method, watch.seconds)

    context.report("start values", 0.0, Phrase("compiling"))
    start = grow(local, network, known, local.keep, context)
    points = None
    if settings.method == "tao2021":
        points = points_as_in_the_paper(start, local, recording.features, settings.spherical_projection)
    watch.lap("start values")
    release_freed()

    run = _run(session, settings, start, local, known, context, watch)
    free = solve_free(network, start, points, local.keep & start.placed[network.camera], run)
    watch.lap("bundle adjustment")
    if settings.lens == "auto":
        other = best_lens_model(free, context)
        watch.lap("lens models")
        if other is not None and other.model is not None:
            again = with_lens_model(session, other.model)
            done = _calibrate(again, replace(settings, lens=None), context, watch)
            return with_finding(done, other.chosen(tuple(camera.id for camera in done.rig.cameras)))

    ball = ball_network(recording, network, local, free)
    try:
        fit, stopped = fit_ball_model(recording, free, ball, settings, run.accepting_partial()), False
    except PartialResultAccepted:
        if context.has_partial_result:  # the caller's result is further on
            raise
        fit, stopped = MetricFit(*_as_stopped(recording, free, run)), True
    watch.lap("scale")
    done = build_result(recording, local, _without_ambiguous(fit, free), settings.method, run)
    return stopped_early(done) if stopped else done


def local_network(
    recording: Recording, known: FloatArray, settings: CalibrationSettings, context: Context
) -> LocalNetwork:
    """Two-view geometry, triples and paths of a recording, from its cameras' known intrinsics (c,16)."""
    observations, features = recording.observations, recording.features
    local = reconstruct_locally(observations, features, known, settings.search, settings.seed, context)
    return lasting_reference(local, recording.session)


def _run(
    session: Session, settings: CalibrationSettings, start: InitialPoses, local: LocalNetwork, known: FloatArray,
    context: Context, watch: Stopwatch,
) -> Run:  # fmt: skip
    """What the stages from the adjustment on share; the wanted reference camera, where it has a pose, is the first."""
    wanted = [c for c, camera in enumerate(session.cameras) if camera.id == settings.reference and start.placed[c]]
    first, *others = dict.fromkeys((*wanted, *local.graph.references))
    return Run(known, first, settings.method == "tao2021", tuple(others), context, watch)


def ball_network(recording: Recording, network: Network, local: LocalNetwork, free: BallFit) -> BallNetwork:
    """The dots of the ball in the free network; no two-view gate judges a camera that is alone."""
    candidates = local.keep | ~free.placed[network.camera]
    return BallNetwork(network, recording.features, recording.n_placements, recording.n_ball, candidates)


def fit_ball_model(
    recording: Recording, free: BallFit, ball: BallNetwork, settings: CalibrationSettings, run: Run
) -> MetricFit:
    """The network in millimetres: on a stored ball, as rigid as the data allow, or free; with the findings of that."""
    refused: tuple[Finding, ...] = ()
    if settings.ball is not None:
        stored = on_known_ball(recording, free, ball, settings.ball, run)
        run.watch.lap("known ball")
        if isinstance(stored, MetricFit):
            return stored
        refused = (stored,)
    solved, choice = free, ModelChoice("free", Phrase("form-asked-alone"))
    if settings.method in ("auto", "soft", "rigid"):
        solved, choice = select_ball_model(recording, free, ball, settings, run)
        run.watch.lap("rigid ball")
    solved, solution = in_millimetres(recording, solved, run)
    return MetricFit(solved, choice, solution, refused)


def _as_stopped(recording: Recording, free: BallFit, run: Run) -> tuple[BallFit, ModelChoice, Solution]:
    """The free form where the user wanted no more."""
    solved, solution = in_millimetres(recording, free, run)
    return solved, ModelChoice("free", Phrase("form-stopped")), solution


def _without_ambiguous(fit: MetricFit, free: BallFit) -> MetricFit:
    """The fit with the cameras that it or the free form left out because two poses fit them equally well."""
    left_out = [form.ambiguous for form in (free, fit.solved) if form.ambiguous is not None]
    ambiguous = np.any(left_out, axis=0) if left_out else None
    return replace(fit, solved=replace(fit.solved, ambiguous=ambiguous))


def with_finding(done: Calibration, finding: Finding) -> Calibration:
    """A calibration with one more finding, of no consequence for its validity."""
    quality = replace(done.rig.quality, findings=(*done.rig.quality.findings, finding))
    return replace(done, rig=replace(done.rig, quality=quality))


def stopped_early(done: Calibration) -> Calibration:
    """A calibration that says that somebody stopped the work behind it, and hence is not valid."""
    quality = done.rig.quality
    if STOPPED in quality.findings:
        return done
    quality = replace(quality, valid=False, findings=(STOPPED, *quality.findings))
    return replace(done, rig=replace(done.rig, quality=quality))


def describe_network(recording: Recording, settings: CalibrationSettings) -> Network:
    """Who observes what, and which intrinsics are to be estimated."""
    cameras, observations, features = recording.session.cameras, recording.observations, recording.features
    free = settings.intrinsics == "free"
    estimated = estimated_intrinsics(recording.session, free)
    if settings.method == "tao2021":
        estimated = np.tile(estimated_mask("tao2021") & free, (len(estimated), 1))
    names = [(c.earlier_pose_of or c.id) if settings.own_intrinsics else c.intrinsics_group for c in cameras]
    group = np.unique(names, return_inverse=True)[1].reshape(-1)
    return Network(
        features.of_observation, observations.camera, observations.uv, observations.sigma, len(features),
        estimated, group,
    )  # fmt: skip


def points_as_in_the_paper(start: InitialPoses, local: LocalNetwork, features: Features, spherical: bool) -> FloatArray:
    """Points (p,3) chained through the triples and, unless none-SPO, moved onto their placements' spheres."""
    points = chain_points(
        local.paths, local.triples, local.graph.scale, start.state.rotation, start.state.translation, len(features)
    )
    return project_to_spheres(points, features.placement) if spherical else points


def select_ball_model(
    recording: Recording, free: BallFit, ball: BallNetwork, settings: CalibrationSettings, run: Run
) -> tuple[BallFit, ModelChoice]:
    """The rigid form where the data carry it, else the soft or the free one.

    InputError where the rigid or soft form is asked for and no two placements share enough dots.
    """
    wanted: Wanted = settings.method if settings.method in ("rigid", "soft") else "auto"

    def mm_per_unit(solved: BallFit) -> float:
        return metric_solution(recording, solved).factor

    def others(placed: BoolArray) -> list[BallFit]:
        return solve_others(recording, ball.network, placed, settings, run)

    def chosen(wanted: Wanted) -> tuple[BallFit, ModelChoice]:
        requested = RequestedModel(wanted, settings.shape_sd_mm, mm_per_unit)
        return choose_ball_model(free, ball, others, requested, run)

    solved, choice = chosen(wanted)
    if choice.refused and choice.limit is not None:
        most = choice.limit * free.adjusted.variance
        weighted = replace(ball.network, noise=free.network.noise)
        if explained_by_moves(weighted, ball.features, free, ball.n_ball, run.context, most):
            rigid, of_rigid = chosen("rigid")
            reason = Phrase("form-kept", {"facts": of_rigid.facts})
            return rigid, replace(of_rigid, reason=reason, asked=False)
    if wanted not in ("auto", choice.form):
        raise InputError(Phrase("error-form-not-possible", {"form": wanted, "why": choice.reason}))
    return solved, choice


def solve_others(
    recording: Recording, network: Network, placed: BoolArray, settings: CalibrationSettings, run: Run
) -> list[BallFit]:
    """The free form of each group of cameras that has no common view with those placed (c,), each in its own frame."""
    groups: list[BallFit] = []
    rest = ~placed
    observations, features = recording.observations, recording.features
    while rest.sum() >= 3:
        rows = np.flatnonzero(rest[observations.camera])
        own = observations.select(rows)
        own_features = replace(features, of_observation=features.of_observation[rows])
        local = reconstruct_locally(own, own_features, run.known, settings.search, settings.seed, run.context)
        if not local.triples:
            break
        part = network.only(rows)
        start = grow(local, part, run.known, local.keep, run.context)
        candidates = local.keep & start.placed[part.camera]
        first, *others = local.graph.references
        alone = replace(run, reference=first, next_references=tuple(others))
        groups.append(solve_free(part, start, None, candidates, alone))
        rest &= ~start.placed
    return groups
