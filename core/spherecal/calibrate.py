"""The method on one page: images -> observations -> triples -> paths -> adjustment -> covariance and scale -> rig."""

from dataclasses import replace

import numpy as np

from spherecal.ball.fit import solve_free
from spherecal.base.context import Context, Stopwatch
from spherecal.base.errors import PartialResultAccepted
from spherecal.base.memory import release_freed
from spherecal.base.messages.values import Phrase
from spherecal.base.threads import on_one_blas_thread
from spherecal.data.edits import Repairs, recorded, repaired
from spherecal.data.findings import Finding
from spherecal.data.lens_model import with_lens_model
from spherecal.data.recording import Recording
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.data.verdict import with_findings
from spherecal.detect.nothing_found import nothing_found
from spherecal.detect.redetection import with_missed_targets
from spherecal.detect.session_images import observed
from spherecal.diagnose.automatic_edits import edited_where_certain
from spherecal.diagnose.checks import STOPPED
from spherecal.diagnose.lens_models import best_lens_model
from spherecal.diagnose.plausibility import implausible
from spherecal.files.assumed import assumed_of_session
from spherecal.initialise.incremental import grow
from spherecal.methods.ball_model import ball_network, fit_ball_model, free_as_stopped, without_ambiguous
from spherecal.methods.bar import calibrate_bar
from spherecal.methods.board import calibrate_board
from spherecal.methods.settings import CalibrationSettings, check_settings, without_effect
from spherecal.methods.sphere import describe_network, local_network, points_as_in_the_paper, run_of
from spherecal.result.build import build_failed_result, build_result


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
    check_settings(session, settings)
    if settings.method in ("board", "bar"):
        said = (*assumed_of_session(session), *without_effect(settings))
        return with_findings(_by_baseline(session, settings, context), said)
    has_images_alone = session.observations is None
    if has_images_alone:
        session = observed(session, context)
        watch.lap("detection")
    missing = nothing_found(session, from_images=has_images_alone)

    def run(some: Session) -> Calibration:
        said = (*missing, *implausible(some), *assumed_of_session(some), *without_effect(settings))
        if has_images_alone:
            return with_findings(_with_second_look(some, settings, context, watch), said)
        return with_findings(_calibrate(some, settings, context, watch), said)

    return edited_where_certain(session, run) if settings.repair_by_itself else run(session)


def _by_baseline(session: Session, settings: CalibrationSettings, context: Context) -> Calibration:
    own = settings.own_intrinsics
    if settings.method == "board":
        return calibrate_board(session, settings.intrinsics, own, context, settings.joint)
    return calibrate_bar(session, settings.intrinsics, own, settings.seed, context, settings.joint)


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

    run = run_of(session, settings, start, local, known, context, watch)
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
        fit, stopped = free_as_stopped(recording, free, run), True
    watch.lap("scale")
    done = build_result(recording, local, without_ambiguous(fit, free), settings.method, run)
    return stopped_early(done) if stopped else done


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
