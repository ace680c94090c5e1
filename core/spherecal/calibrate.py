"""The method on one page: detection, view graph, start values, adjustment, ball model, scale, diagnosis, result."""

from dataclasses import replace
from functools import partial

from spherecal.ball.fit import solve_free
from spherecal.base.context import Context, Stopwatch
from spherecal.base.threads import on_one_blas_thread
from spherecal.data.lens_model import with_lens_model
from spherecal.data.recording import Recording
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.data.verdict import with_findings
from spherecal.detect.nothing_found import nothing_found
from spherecal.detect.session_images import observed
from spherecal.diagnose.lens_models import best_lens_model
from spherecal.diagnose.plausibility import implausible
from spherecal.initialise.focal_length import with_seen_focal_lengths
from spherecal.result.build import build_failed_result, build_result
from spherecal.steps.automatic_repairs import edited_where_certain
from spherecal.steps.fit_ball import fit_ball_model
from spherecal.steps.repairs import Repairs, with_repairs
from spherecal.steps.settings import CalibrationSettings, as_stated, check_settings
from spherecal.steps.start_values import local_network, run_of, start_values
from spherecal.steps.two_passes import calibrate_twice
from spherecal_boards.bar import calibrate_bar
from spherecal_boards.board import calibrate_board

_BASELINES = {"board": calibrate_board, "bar": calibrate_bar}


@on_one_blas_thread
def calibrate(
    session: Session, settings: CalibrationSettings | None = None, context: Context | None = None
) -> Calibration:
    """The calibrated rig of a session's images or observations, with points, residuals, spheres and findings.

    A rig that could not be calibrated, or only in part, is a result too, with `valid` False and findings that say why.

    `session`, `settings`, `context` None for the defaults.
    """
    settings, context, watch = settings or CalibrationSettings(), context or Context(), Stopwatch()
    if settings.repairs:
        rest = replace(settings, repairs=Repairs())
        return with_repairs(session, settings.repairs, lambda repaired: calibrate(repaired, rest, context))
    if settings.lens not in (None, "auto"):
        session = with_lens_model(session, settings.lens)
    check_settings(session, settings)
    if (baseline := _BASELINES.get(settings.method)) is not None:
        return with_findings(baseline(session, settings, context), as_stated(session, settings))
    has_images_alone = session.observations is None
    if has_images_alone:
        session = observed(session, context)
        watch.lap("detection")
    missing = nothing_found(session, from_images=has_images_alone)
    session, seen = with_seen_focal_lengths(session)  # start values of those that nobody stated

    def run(some: Session) -> Calibration:
        once = partial(_calibrate, settings)
        done = calibrate_twice(some, once, context, watch) if has_images_alone else once(some, context, watch)
        return with_findings(done, (*missing, *implausible(some), *as_stated(some, settings, seen)))

    return edited_where_certain(session, run) if settings.repair_by_itself else run(session)


def _calibrate(settings: CalibrationSettings, session: Session, context: Context, watch: Stopwatch) -> Calibration:
    """The method from observations to the rig."""
    recording = Recording.of(session)
    local = local_network(recording, settings, context)  # two-view gate, triples, view graph, paths
    watch.lap("local reconstruction")
    if local.is_empty:
        return build_failed_result(recording, local, settings.method, watch.seconds)
    start = start_values(recording, local, settings, context)  # poses chained along the paths, resection
    watch.lap("start values")
    run = run_of(recording, start, settings, context, watch)
    free = solve_free(start.network, start.poses, start.points, start.candidates, run)  # every dot of every placement
    watch.lap("bundle adjustment")
    if settings.lens == "auto" and (better := best_lens_model(free, run)) is not None:
        return better.noted_in(_calibrate(replace(settings, lens=None), better.applied(session), context, watch))
    fit = fit_ball_model(recording, start, free, settings, run)  # rigid, deformable, stored or free; millimetres
    watch.lap("scale")
    return build_result(recording, local, fit, settings.method, run)  # with the diagnosis
