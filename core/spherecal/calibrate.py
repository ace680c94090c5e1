"""The method on one page: detection, view graph, start values, adjustment, ball model, scale, diagnosis, result."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import get_args

from spherecal.adjust.corrections import drift_alike, drifts, one_moved
from spherecal.ball.fit import BallFit, Run, solve_free
from spherecal.base.context import Context, Stopwatch
from spherecal.base.errors import InputError, PartialResultAccepted
from spherecal.base.messages.values import Phrase
from spherecal.base.plugins import METHODS, load
from spherecal.base.threads import on_one_blas_thread
from spherecal.data.findings import Finding
from spherecal.data.lens_model import with_lens_model
from spherecal.data.rig import Calibration
from spherecal.data.session import Recording, Session
from spherecal.data.verdict import with_findings
from spherecal.detect.redetection import Located, with_missed_targets
from spherecal.detect.session_images import nothing_found, observed
from spherecal.diagnose.lens_models import LensTrial, best_lens_model, wants_another
from spherecal.diagnose.plausibility import implausible
from spherecal.initialise.focal_length import with_seen_focal_lengths
from spherecal.initialise.local import LocalNetwork
from spherecal.result.build_result import build_failed_result, build_result, cameras_of, stopped_early
from spherecal.scale.metric import MetricFit, with_uncertainty
from spherecal.steps.automatic_repairs import (
    TURNS,
    certain_repairs,
    has_fewer_faults,
    helps,
    is_credible,
    is_settled,
    moves_are_all,
)
from spherecal.steps.ball_stages import local_network, run_of, start_values
from spherecal.steps.repairs import Repairs, recorded, repaired
from spherecal.steps.selection import fit_ball_model
from spherecal.steps.settings import CalibrationSettings, Method, as_stated, check_settings
from spherecal.steps.tao2021 import calibrate_as_published


@on_one_blas_thread
def calibrate(
    session: Session, settings: CalibrationSettings | None = None, context: Context | None = None
) -> Calibration:
    """The calibrated rig of a session's images or observations, with points, residuals, spheres and findings.

    A rig that could not be calibrated, or only in part, is a result too, with `valid` False and findings that say why.

    `session`, `settings`, `context` None for the defaults.
    """
    settings, context, watch = settings or CalibrationSettings(), context or Context(), Stopwatch()
    mended = repaired(session, settings.repairs) if settings.repairs else session  # as the user asks
    start = mended if settings.lens in (None, "auto") else with_lens_model(mended, settings.lens)
    settings = replace(settings, method=method_of(start, settings.method))
    check_settings(start, settings)
    if (method := other_method(settings.method)) is not None:  # a board or a bar
        done = with_findings(method(start, settings, context), as_stated(start, settings))
    else:
        done = _calibrate_ball(start, settings, context, watch)
    return recorded(done, session, mended, settings.repairs) if settings.repairs else done


def _calibrate_ball(session: Session, settings: CalibrationSettings, context: Context, watch: Stopwatch) -> Calibration:
    """Solve, judge, repair and solve again: at most TURNS times, each time with few repairs to choose from."""
    from_images = session.observations is None
    if from_images:
        session = observed(session, context)
        watch.lap("detection")
    missing = nothing_found(session, from_images)
    session, seen = with_seen_focal_lengths(session)  # start values of those that nobody stated
    task = _Task(settings, from_images, missing, seen, context, watch)
    first = _solve(session, task)
    best = now = first.done
    done = Repairs()
    for _ in range(TURNS if settings.repair_by_itself and settings.method != "tao2021" else 0):
        if is_settled(now):
            break
        chosen: tuple[Calibration, Repairs] | None = None
        for repairs, mended in certain_repairs(session, now, done):
            try:
                again = _solve(mended, task)
            except InputError:  # too little is left
                continue
            tried = again.best if first.steady is None else again.done
            if is_credible(tried, repairs) and helps(tried, now, chosen and chosen[0]):
                chosen = recorded(tried, session, mended, repairs, automatic=True), repairs
                if tried.rig.quality.valid:
                    break
        if chosen is None:
            break
        now, done = chosen
        best = now if has_fewer_faults(now, best) else best
    return best if best.rig.quality.valid or first.steady is None else first.steady


@dataclass(frozen=True)
class _Judged:
    """A calibration with its diagnosis; `steady`: that without turns of images, where these show moved cameras.

    A rig whose cameras drift has images that are off by more (dome15, two of nine placements: 1.5 and 1.7 px). Without
    turns that is not seen, and lengths are known half as well. With turns and these images left out they are.
    """

    done: Calibration
    steady: Calibration | None = None

    @property
    def best(self) -> Calibration:
        """That which nothing is found wrong with."""
        return self.steady or self.done

    @property
    def located(self) -> Located:
        """Where cameras and points are."""
        return Located.of(self.best)

    def judged(self) -> "_Judged":
        """Itself, as its diagnosis is done."""
        return self

    def each(self, change: Callable[[Calibration], Calibration]) -> "_Judged":
        """Both calibrations changed."""
        return _Judged(change(self.done), None if self.steady is None else change(self.steady))

    def stopped(self) -> Calibration:
        """The calibration where the user wants what there is so far."""
        return stopped_early(self.best)


@dataclass(frozen=True)
class _Task:
    """What all turns share; `missing`: findings where no target was found; `seen`: focal lengths by camera, px."""

    settings: CalibrationSettings
    from_images: bool
    missing: tuple[Finding, ...]
    seen: dict[str, float]
    context: Context
    watch: Stopwatch


@dataclass(frozen=True)
class _Solved:
    """A network before its diagnosis, which a first pass over images does without."""

    recording: Recording
    local: LocalNetwork
    fit: MetricFit
    method: str
    run: Run
    lens: LensTrial | None

    @property
    def located(self) -> Located:
        """Where cameras and points are."""
        cameras = {camera.id: camera for camera in cameras_of(self.recording, self.fit)}
        return Located(cameras, self.recording.features, self.fit.solution.state.points)

    def judged(self) -> _Judged:
        """The calibration, with the diagnosis."""
        fit = with_uncertainty(self.recording, self.fit)
        done = build_result(self.recording, self.local, fit, self.method, self.run)
        return _Judged(done if self.lens is None else self.lens.noted_in(done))

    def stopped(self) -> Calibration:
        """The calibration where the user wants what there is so far: this, and all of it."""
        context = replace(self.run.context, accepts_partial=lambda: False)
        return stopped_early(replace(self, run=replace(self.run, context=context)).judged().done)


def _solve(session: Session, task: _Task) -> _Judged:
    """The rig of a session; from images in two passes, of which the first predicts where targets were missed."""
    if not task.from_images:
        judged = _solved(session, task).judged()
    else:
        first = _solved(session, replace(task, watch=Stopwatch()), True)
        rest = replace(task, context=task.context.accepting_partial())
        try:
            complete = with_missed_targets(session, first.located, rest.context)
            task.watch.lap("re-detection")
            if complete is session:  # nothing to add: the first pass is all
                judged = first.judged().each(lambda done: replace(done, seconds=task.watch.seconds | done.seconds))
            else:
                judged = _solved(complete, rest).judged()
        except PartialResultAccepted:
            judged = _Judged(first.stopped())
    more = (*task.missing, *implausible(session), *as_stated(session, task.settings, task.seen))
    return judged.each(lambda done: with_findings(done, more))


def _other_lens(free: BallFit, run: Run, settings: CalibrationSettings) -> LensTrial | None:
    """A better lens model, where nobody asked for one."""
    return best_lens_model(free, run) if settings.lens is None and wants_another(free) else None


def _spoilt(done: Calibration, sound: Calibration | None, turning: bool, has_moved: bool) -> _Judged:
    """What comes of a calibration that is not valid: turns show who moved, or a few images contradict them."""
    if sound is None or has_moved:
        return _Judged(done)
    return _Judged(done, sound) if turning and moves_are_all(done) else _Judged(sound)


def _fits_as_well(done: Calibration, other: Calibration) -> bool:
    one, two = done.rig.quality.sigma0, other.rig.quality.sigma0
    return one is not None and two is not None and one <= two


def _solved(session: Session, task: _Task, first: bool = False) -> _Judged | _Solved:
    """The method from observations to the rig; once more with another lens model, or with turns of images.

    Both are tried only where nothing is found wrong, and taken only where nothing is found wrong with them. Where
    neither will be, the `first` pass over images is spared its diagnosis.
    """
    settings, context, watch = task.settings, task.context, task.watch
    lens, turning, sound, local, begun = None, False, None, None, None
    while True:
        recording = Recording.of(session)
        if settings.method == "tao2021":  # the paper's method to the letter, with nothing of what follows
            return _Judged(calibrate_as_published(recording, settings, context, watch))
        if local is None:  # else nothing but turns of images is new
            local = local_network(recording, settings, context)  # two-view gate, triples, view graph, paths
        watch.lap("local reconstruction")
        if local.is_empty:
            return _Judged(sound or build_failed_result(recording, local, settings.method, watch.seconds))
        start = start_values(recording, local, settings, context, turning)  # poses chained along the paths, resection
        watch.lap("start values")
        run = replace(run_of(recording, start, settings, context, watch), rough=first)
        free = solve_free(start.network, start.poses, start.candidates, run, begun)  # every dot at every place
        watch.lap("bundle adjustment")
        if settings.lens == "auto" and lens is None and (lens := best_lens_model(free, run)) is not None:
            session, local = lens.applied(session), None
            continue
        fit = fit_ball_model(recording, start, free, settings, run)  # rigid, deformable, stored or free; millimetres
        watch.lap("scale")
        solved, network = _Solved(recording, local, fit, settings.method, run, lens), fit.solved.network
        if first and sound is None and not drifts(network) and _other_lens(free, run, settings) is None:
            return solved
        done = solved.judged().done
        if sound is not None and not _fits_as_well(done, sound) and not (turning and moves_are_all(done)):
            return _Judged(sound)  # rational lenses from focal lengths 30 % off: 0.22 px, 0.07 before
        if sound is None and moves_are_all(done) and drift_alike(network):
            # fields without turns: what drifts by 10 urad may look moved (seed 1212)
            sound, turning, begun = done, True, free.begun
            continue
        if not done.rig.quality.valid:
            return _spoilt(done, sound, turning, one_moved(network))
        other = None if turning else _other_lens(free, run, settings)
        if turning or (other is None and not drifts(network)):
            return _Judged(done)
        sound, turning, begun = done, True, free.begun
        if other is not None:
            lens, session, local, begun = other, other.applied(session), None, None


# --- methods other than the ball's, such as boards and bars ----------------------------------------------------------

# Methods that start from view graph and ball.
OF_THE_BALL = ("auto", "tao2021", "free", "soft", "rigid")

OtherMethod = Callable[[Session, CalibrationSettings, Context], Calibration]


def method_of(session: Session, asked: Method) -> Method:
    """The method asked for; `auto` takes the board of a session that has nothing of a ball."""
    of_ball = session.target_set is not None or session.sphere_diameter_mm is not None
    return "board" if asked == "auto" and session.board is not None and not of_ball else asked


def other_method(name: str) -> OtherMethod | None:
    """What calibrates a session by a method of this name; None for the ball's own."""
    if name in OF_THE_BALL:
        return None
    if (method := load(METHODS, name)) is None:
        raise InputError(Phrase("error-no-method", {"name": name, "names": list(get_args(Method))}))
    return method
