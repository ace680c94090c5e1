"""The state of every step, computed from the project and from what is running; it is stored nowhere."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from spherecal_gui.project import (
    FEW_PLACEMENTS,
    VERIFIED,
    Computation,
    Flaw,
    Project,
    fingerprint,
    saved_inputs,
    usable,
)

StepKind = Literal[
    "connect", "look", "placement", "scale", "calibrate", "results", "verify", "save", "check", "measure"
]


class Status(StrEnum):
    """What can be done with a step; CARE is done, with something that should be known."""

    BLOCKED = "blocked"
    READY = "ready"
    RUNNING = "running"
    DONE = "done"
    CARE = "care"
    STALE = "stale"
    FAILED = "failed"


@dataclass(frozen=True)
class Step:
    """A step of the rail: `set_id` is the placement it takes, if it takes one."""

    id: str
    kind: StepKind
    set_id: str | None = None


@dataclass(frozen=True)
class Reason:
    """Why a step is as it is: a code with its values (`texts.reason_text` makes words of it), and where to mend it."""

    code: str
    values: tuple[str, ...] = ()
    go_to: str | None = None


_NOT_VALID = Reason("not valid", (), "results")


@dataclass(frozen=True)
class StepState:
    """A step and its state; `reason` is there for all but READY, RUNNING and DONE."""

    step: Step
    status: Status
    reason: Reason | None = None

    @property
    def open(self) -> bool:
        """Whether the step can be worked on."""
        return self.status is not Status.BLOCKED

    @property
    def not_begun(self) -> bool:
        """Whether nothing was done here yet and what is wrong is the calibration: that is said where it is mended."""
        uses_it = self.step.kind in ("verify", "save", "measure")
        return uses_it and self.reason == _NOT_VALID and self.status is Status.FAILED


@dataclass(frozen=True)
class Running:
    """What goes on at the moment and is not kept."""

    step: str | None = None  # whose work runs
    connected: bool = False  # the cameras are open
    lost: tuple[str, ...] = ()  # cameras that send no images
    moved: tuple[str, ...] = ()  # cameras that nobody has seen to yet
    gone: bool = False  # the project's folder is no longer there


@dataclass(frozen=True)
class WorkflowState:
    """All steps in order, and the one where the user is."""

    steps: tuple[StepState, ...]
    current: str

    def of(self, step_id: str) -> StepState:
        """The state of a step; KeyError where there is none."""
        return {state.step.id: state for state in self.steps}[step_id]

    @property
    def now(self) -> StepState:
        """The step where the user is."""
        return self.of(self.current)

    def after(self, step_id: str) -> StepState | None:
        """The step behind this one."""
        at = [state.step.id for state in self.steps].index(step_id)
        return self.steps[at + 1] if at + 1 < len(self.steps) else None

    def before(self, step_id: str) -> StepState | None:
        """The step before this one."""
        at = [state.step.id for state in self.steps].index(step_id)
        return self.steps[at - 1] if at else None


def steps_of(project: Project) -> tuple[Step, ...]:
    """The steps of a project; a scale from a bar adds one, a check and a verification have few."""
    placed = tuple(Step(f"placement:{name}", "placement", name) for name in project.placements)
    if project.purpose == "check":
        return (*_steps("connect", "look"), *placed, *_steps("check"))
    if project.purpose == "verify":
        return _steps("connect", "look", "verify", "save")
    scale = _steps("scale") if project.scale_poses else ()
    last = _steps("calibrate", "results", "verify", "save", "measure")
    return (*_steps("connect", "look"), *placed, *scale, *last)


def _steps(*kinds: StepKind) -> tuple[Step, ...]:
    return tuple(Step(kind, kind) for kind in kinds)


def resolve(project: Project, running: Running) -> WorkflowState:
    """The state of all steps; pure: the same project and the same running work give the same answer."""
    steps = steps_of(project)
    ids = [step.id for step in steps]
    states = tuple(_state(step, project, running) for step in steps)
    current = project.step
    if current not in ids:  # a placement that was dropped, the scale of another bench
        was_placement = current.startswith("placement:") and project.placements
        current = f"placement:{project.placements[-1]}" if was_placement else "look"
    return WorkflowState(states, current)


def _state(step: Step, project: Project, running: Running) -> StepState:
    if running.gone:
        return StepState(step, Status.FAILED, Reason("project gone", (project.folder.name,)))
    if running.step == step.id:
        return StepState(step, Status.RUNNING)
    rule = {
        "connect": _connect, "look": _look, "placement": _placement, "scale": _scale, "calibrate": _calibrate,
        "results": _results, "verify": _verify, "save": _save, "check": _check, "measure": _measure,
    }[step.kind]  # fmt: skip
    status, reason = rule(step, project, running)
    shows_only = step.kind in ("connect", "look", "results")  # may be visited while work runs
    if running.step is not None and status not in (Status.BLOCKED, Status.DONE, Status.CARE) and not shows_only:
        return StepState(step, Status.BLOCKED, Reason("busy", (running.step,), running.step))
    if status in (Status.READY, Status.STALE, Status.FAILED) and step.id in project.failures:
        return StepState(step, Status.FAILED, Reason("error", (project.failures[step.id],), step.id))
    return StepState(step, status, reason)


Judged = tuple[Status, Reason | None]


def _connect(_: Step, project: Project, running: Running) -> Judged:
    if running.connected and running.lost:
        return Status.FAILED, Reason("cameras lost", running.lost, "connect")
    if running.connected and project.cameras and project.artefacts is not None:
        return Status.DONE, None
    return Status.READY, None


def _not_connected(project: Project, running: Running) -> Reason | None:
    if not running.connected or not project.cameras:
        return Reason("connect first", (), "connect")
    if project.artefacts is None:
        return Reason("confirm the bench", (), "connect")
    return None


def _look(_: Step, project: Project, running: Running) -> Judged:
    reason = _not_connected(project, running)
    if reason is not None:
        return Status.BLOCKED, reason
    if running.moved:
        return Status.FAILED, Reason("moved", running.moved, "look")
    if not project.looked:
        return Status.READY, None
    new = tuple(sorted(set(project.cameras) - set(project.looked)))
    return (Status.STALE, Reason("cameras new", new, "look")) if new else (Status.DONE, None)


def _not_looked(project: Project, running: Running) -> Reason | None:
    reason = _not_connected(project, running)
    if reason is None and not set(project.cameras) <= set(project.looked):
        reason = Reason("look first", (), "look")
    return reason


def _flawed(flaws: tuple[Flaw, ...], go_to: str, one_may_miss: bool = False) -> Judged:
    """Sets that were taken, by the worst of their flaws; `one_may_miss`: not every camera has to see a bar."""
    open_ones = [f for f in flaws if not f.kept and not (one_may_miss and f.code == "taken without")]
    if not flaws:
        return Status.DONE, None
    rank = ("moved since", "taken moving", "taken without")
    worst = min(open_ones or flaws, key=lambda f: rank.index(f.code))
    cameras = sorted({camera for f in (open_ones or flaws) if f.code == worst.code for camera in f.cameras})
    return (Status.FAILED if open_ones else Status.CARE), Reason(worst.code, tuple(cameras), go_to)


def _placement(step: Step, project: Project, running: Running) -> Judged:
    if step.set_id is not None and step.set_id in project.taken:
        if running.moved and not project.flaws_of(step.set_id):
            return Status.CARE, Reason("moved", running.moved, "look")
        return _flawed(project.flaws_of(step.set_id), step.id)
    reason = _not_looked(project, running)
    return (Status.BLOCKED, reason) if reason else (Status.READY, None)


def _scale(_: Step, project: Project, running: Running) -> Judged:
    flaws = tuple(flaw for pose in project.scale_poses for flaw in project.flaws_of(pose))
    found = _flawed(flaws, "scale", one_may_miss=True)
    if all(pose in project.taken for pose in project.scale_poses) or found[0] is Status.FAILED:
        return found
    reason = _not_looked(project, running)
    return (Status.BLOCKED, reason) if reason else (Status.READY, None)


def _too_little(project: Project) -> Reason | None:
    if project.purpose == "verify":
        return None
    placed = [name for name in project.placements if name in project.taken]
    need = min(FEW_PLACEMENTS, max(len(project.placements), 1))
    if project.artefacts is None:
        return Reason("confirm the bench", (), "connect")
    if len(placed) < need:
        missing = next((name for name in project.placements if name not in project.taken), "P1")
        return Reason("placements missing", (str(len(placed)), str(need)), f"placement:{missing}")
    if project.scale_poses and not any(pose in project.taken for pose in project.scale_poses):
        return Reason("scale missing", (project.artefacts.scale,), "scale")
    return None


def _calibrate(_: Step, project: Project, __: Running) -> Judged:
    blocked = _too_little(project)
    flawed = _flawed_sets(project)
    if project.calibrated is None:
        bad = (Status.FAILED, flawed) if flawed else (Status.READY, None)
        return bad if blocked is None else (Status.BLOCKED, blocked)
    if blocked is not None:
        return Status.STALE, blocked
    changed = _changed(project.calibrated, project.calibration_inputs)
    if changed:
        return Status.STALE, flawed if flawed and "moved" in changed else Reason("changed", changed, "calibrate")
    return _judge_verdict(project.calibrated)


def _judge_verdict(calibrated: Computation) -> Judged:
    if not usable(calibrated.verdict):
        return Status.FAILED, _NOT_VALID
    return (Status.DONE, None) if calibrated.verdict == "valid" else (Status.CARE, Reason("with care", (), "results"))


def _flawed_sets(project: Project) -> Reason | None:
    """The first of the sets with something wrong that nobody has decided about."""
    for name in project.sets:
        step = f"placement:{name}" if name in project.placements else "scale"
        status, reason = _flawed(project.flaws_of(name), step, one_may_miss=name in project.scale_poses)
        if status is Status.FAILED and name in project.taken and reason is not None:
            return Reason("flawed", (name, *reason.values), step)
    return None


def _changed(run: Computation, inputs: tuple[tuple[str, str], ...]) -> tuple[str, ...]:
    before, now = dict(run.inputs), dict(inputs)
    return tuple(sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name)))


def _results(step: Step, project: Project, running: Running) -> Judged:
    if project.calibrated is None:
        return Status.BLOCKED, Reason("calibrate first", (), "calibrate")
    status, reason = _calibrate(step, project, running)
    if status in (Status.STALE, Status.FAILED):
        return status, reason
    if project.accepted != project.calibrated:
        return Status.READY, None
    return (Status.DONE, None) if project.calibrated.verdict == "valid" else (Status.CARE, Reason("with care"))


def _verify(step: Step, project: Project, running: Running) -> Judged:
    if project.calibrated is None:
        return Status.BLOCKED, Reason("calibrate first", (), "calibrate")
    if not project.check_poses:
        return Status.BLOCKED, Reason("no check bar", (), "connect")
    if project.verified is None:
        reason = _not_looked(project, running)
        return (Status.BLOCKED, reason) if reason else _begin(project.calibrated)
    return _judge_verified(project.verified, _calibrate(step, project, running)[0], project)


def _begin(calibrated: Computation) -> Judged:
    """A step that uses the calibration and has done nothing yet: no better than a calibration that is not valid."""
    judged = _judge_verdict(calibrated)
    return judged if judged[0] is Status.FAILED else (Status.READY, None)


def _judge_verified(verified: Computation, calibration: Status, project: Project) -> Judged:
    changed = _changed(verified, project.verification_inputs)
    if calibration is Status.STALE:
        return Status.STALE, Reason("calibration stale", (), "calibrate")
    if changed:
        return Status.STALE, Reason("changed", changed, "verify")
    if verified.verdict in ("undecided", "no data"):
        return Status.CARE, Reason(verified.verdict, (), "verify")
    if verified.verdict not in VERIFIED:
        return Status.FAILED, Reason(verified.verdict, (), "verify")
    return Status.DONE, None


def _measure(step: Step, project: Project, running: Running) -> Judged:
    """Measuring is never done, and never better than its calibration; the cameras must be connected."""
    if project.calibrated is None:
        return Status.BLOCKED, Reason("calibrate first", (), "calibrate")
    reason = _not_connected(project, running)
    if reason is not None:
        return Status.BLOCKED, reason
    if _calibrate(step, project, running)[0] is Status.STALE:
        return Status.STALE, Reason("calibration stale", (), "calibrate")
    judged = _judge_verdict(project.calibrated)
    return (Status.READY, None) if judged[0] is Status.DONE else judged


def _check(_: Step, project: Project, __: Running) -> Judged:
    if not project.check_inputs:
        return Status.BLOCKED, Reason("placement missing", (), f"placement:{project.placements[0]}")
    if project.checked is None:
        return Status.READY, None
    changed = _changed(project.checked, project.check_inputs)
    if changed:
        return Status.STALE, Reason("changed", changed, "check")
    by_check = (("check", fingerprint(project.checked)),)  # the cameras that this check found moved
    repaired = project.repaired if project.repaired is not None and project.repaired.inputs == by_check else None
    used = project.saved.inputs if project.saved is not None else ()
    in_use = repaired is not None and used == (("repair", fingerprint(repaired)),)
    if in_use or project.checked.verdict == "ok":
        return Status.DONE, None
    if project.checked.verdict == "watch" or (repaired is not None and usable(repaired.verdict)):
        return Status.CARE, Reason("repair not in use" if repaired is not None else "watch", (), "check")
    return Status.FAILED, Reason("recalibrate", (), "check")


def _save(step: Step, project: Project, running: Running) -> Judged:
    if project.calibrated is None:
        return Status.BLOCKED, Reason("calibrate first", (), "calibrate")
    if _calibrate(step, project, running)[0] is Status.STALE:
        return Status.STALE, Reason("calibration stale", (), "calibrate")
    if project.saved is None:
        return _begin(project.calibrated)
    changed = _changed(project.saved, saved_inputs(project))
    if changed:
        return Status.STALE, Reason("changed", changed, "save")
    verified = (Status.CARE, Reason("not verified", (), "verify"))
    if project.verified is not None:
        verified = _judge_verified(project.verified, Status.DONE, project)
    return max(verified, _judge_verdict(project.calibrated), key=lambda one: _WORSE.index(one[0]))


_WORSE = (Status.DONE, Status.CARE, Status.STALE, Status.FAILED)
