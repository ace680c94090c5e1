"""The state of every step, computed from the project and from what is running; it is stored nowhere."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from spherecal_gui.project import FEW_PLACEMENTS, Project, Run, saved_inputs, usable

StepKind = Literal[
    "connect", "look", "placement", "scale", "calibrate", "results", "verify", "save", "check", "measure"
]


class Status(StrEnum):
    """What can be done with a step."""

    BLOCKED = "blocked"
    READY = "ready"
    RUNNING = "running"
    DONE = "done"
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


@dataclass(frozen=True)
class StepState:
    """A step and how it stands; `reason` is there for all but READY, RUNNING and DONE."""

    step: Step
    status: Status
    reason: Reason | None = None

    @property
    def open(self) -> bool:
        """Whether the step can be worked on."""
        return self.status is not Status.BLOCKED


@dataclass(frozen=True)
class Running:
    """What goes on at the moment and is not kept: the step whose work runs, the cameras that are open."""

    step: str | None = None
    connected: bool = False


@dataclass(frozen=True)
class WorkflowState:
    """All steps in order, and the one where the user is."""

    steps: tuple[StepState, ...]
    current: str

    def of(self, step_id: str) -> StepState:
        """The state of a step; KeyError where there is none."""
        for state in self.steps:
            if state.step.id == step_id:
                return state
        raise KeyError(step_id)

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
    """The steps of a project; a scale from a bar adds one, a check has few."""
    if project.purpose == "check":
        placed = tuple(Step(f"placement:{name}", "placement", name) for name in project.placements)
        return (Step("connect", "connect"), Step("look", "look"), *placed, Step("check", "check"))
    placements = tuple(Step(f"placement:{name}", "placement", name) for name in project.placements)
    scale = (Step("scale", "scale"),) if project.scale_poses else ()
    return (
        Step("connect", "connect"), Step("look", "look"), *placements, *scale, Step("calibrate", "calibrate"),
        Step("results", "results"), Step("verify", "verify"), Step("save", "save"), Step("measure", "measure"),
    )  # fmt: skip


def resolve(project: Project, running: Running) -> WorkflowState:
    """The state of all steps; pure: the same project and the same running work give the same answer."""
    steps = steps_of(project)
    ids = [step.id for step in steps]
    states = tuple(_state(step, project, running) for step in steps)
    return WorkflowState(states, project.step if project.step in ids else _nearest(project.step, project))


def _nearest(step_id: str, project: Project) -> str:
    """Where to be when the step is no longer there: a placement that was dropped, the scale of another bench."""
    return f"placement:{project.placements[-1]}" if step_id.startswith("placement:") and project.placements else "look"


def _state(step: Step, project: Project, running: Running) -> StepState:
    if running.step == step.id:
        return StepState(step, Status.RUNNING)
    judge = {
        "connect": _connect, "look": _look, "placement": _placement, "scale": _scale, "calibrate": _calibrate,
        "results": _results, "verify": _verify, "save": _save, "check": _check, "measure": _measure,
    }[step.kind]  # fmt: skip
    status, reason = judge(step, project, running)
    if running.step is not None and status not in (Status.BLOCKED, Status.DONE) and not _may_browse(step):
        return StepState(step, Status.BLOCKED, Reason("busy", (running.step,), running.step))
    if status in (Status.READY, Status.STALE, Status.FAILED) and step.id in project.failures:
        return StepState(step, Status.FAILED, Reason("error", (project.failures[step.id],), step.id))
    return StepState(step, status, reason)


def _may_browse(step: Step) -> bool:
    """Steps that only show something may be visited while work runs."""
    return step.kind in ("connect", "look", "results")


Judged = tuple[Status, Reason | None]


def _connect(_: Step, project: Project, running: Running) -> Judged:
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
    if not project.looked:
        return Status.READY, None
    new = tuple(sorted(set(project.cameras) - set(project.looked)))
    return (Status.STALE, Reason("cameras new", new, "look")) if new else (Status.DONE, None)


def _not_looked(project: Project, running: Running) -> Reason | None:
    reason = _not_connected(project, running)
    if reason is None and not set(project.cameras) <= set(project.looked):
        reason = Reason("look first", (), "look")
    return reason


def _placement(step: Step, project: Project, running: Running) -> Judged:
    if step.set_id in project.taken:
        return Status.DONE, None
    reason = _not_looked(project, running)
    return (Status.BLOCKED, reason) if reason else (Status.READY, None)


def _scale(_: Step, project: Project, running: Running) -> Judged:
    if all(pose in project.taken for pose in project.scale_poses):
        return Status.DONE, None
    reason = _not_looked(project, running)
    return (Status.BLOCKED, reason) if reason else (Status.READY, None)


def _calibrate(_: Step, project: Project, __: Running) -> Judged:
    placed = [name for name in project.placements if name in project.taken]
    need = min(FEW_PLACEMENTS, max(len(project.placements), 1))
    blocked = None
    if project.artefacts is None:
        blocked = Reason("confirm the bench", (), "connect")
    elif len(placed) < need:
        missing = next((name for name in project.placements if name not in project.taken), "P1")
        blocked = Reason("placements missing", (str(len(placed)), str(need)), f"placement:{missing}")
    elif project.scale_poses and not any(pose in project.taken for pose in project.scale_poses):
        blocked = Reason("scale missing", (project.artefacts.scale,), "scale")
    if blocked is not None and project.calibrated is None:
        return Status.BLOCKED, blocked
    if project.calibrated is None:
        return Status.READY, None
    changed = _changed(project.calibrated, project.calibration_inputs)
    if blocked is not None:
        return Status.STALE, blocked
    return (Status.STALE, Reason("changed", changed, "calibrate")) if changed else (Status.DONE, None)


def _changed(run: Run, inputs: tuple[tuple[str, str], ...]) -> tuple[str, ...]:
    """The names of inputs that are not as they were."""
    before, now = dict(run.inputs), dict(inputs)
    return tuple(sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name)))


def _results(step: Step, project: Project, running: Running) -> Judged:
    if project.calibrated is None:
        return Status.BLOCKED, Reason("calibrate first", (), "calibrate")
    status, reason = _calibrate(step, project, running)
    if status is Status.STALE:
        return status, reason
    if not usable(project.calibrated.verdict):
        return Status.FAILED, Reason("not valid", (), "results")
    return (Status.DONE if project.accepted == project.calibrated else Status.READY), None


def _verify(step: Step, project: Project, running: Running) -> Judged:
    if project.calibrated is None:
        return Status.BLOCKED, Reason("calibrate first", (), "calibrate")
    if not project.check_poses:
        return Status.BLOCKED, Reason("no check bar", (), "connect")
    if project.verified is None:
        reason = _not_looked(project, running)
        return (Status.BLOCKED, reason) if reason else (Status.READY, None)
    return _judge_verified(project.verified, _calibrate(step, project, running)[0], project)


def _judge_verified(verified: Run, calibration: Status, project: Project) -> Judged:
    changed = _changed(verified, project.verification_inputs)
    if calibration is Status.STALE:
        return Status.STALE, Reason("calibration stale", (), "calibrate")
    if changed:
        return Status.STALE, Reason("changed", changed, "verify")
    return (
        (Status.DONE, None)
        if verified.verdict == "consistent"
        else (Status.FAILED, Reason(verified.verdict, (), "verify"))
    )


def _measure(_: Step, project: Project, running: Running) -> Judged:
    """Measuring is never done: it is there for a calibrated rig whose cameras are connected."""
    if project.calibrated is None:
        return Status.BLOCKED, Reason("calibrate first", (), "calibrate")
    reason = _not_connected(project, running)
    return (Status.BLOCKED, reason) if reason else (Status.READY, None)


def _check(_: Step, project: Project, __: Running) -> Judged:
    if not project.check_inputs:
        return Status.BLOCKED, Reason("placement missing", (), f"placement:{project.placements[0]}")
    if project.checked is None:
        return Status.READY, None
    changed = _changed(project.checked, project.check_inputs)
    if changed:
        return Status.STALE, Reason("changed", changed, "check")
    if project.checked.verdict == "recalibrate" and not _repair_in_use(project):
        return Status.FAILED, Reason("recalibrate", (), "check")
    return Status.DONE, None


def _repair_in_use(project: Project) -> bool:
    """Whether the cameras that this check found moved were put right, and that is in use."""
    repaired, saved = project.repaired, project.saved
    made_of_it = repaired is not None and repaired.inputs == (("check", repr(project.checked)),)
    return made_of_it and saved is not None and saved.inputs == (("repair", repr(repaired)),)


def _save(step: Step, project: Project, running: Running) -> Judged:
    if project.calibrated is None:
        return Status.BLOCKED, Reason("calibrate first", (), "calibrate")
    if _calibrate(step, project, running)[0] is Status.STALE:
        return Status.STALE, Reason("calibration stale", (), "calibrate")
    if project.saved is None:
        return Status.READY, None
    changed = _changed(project.saved, saved_inputs(project))
    return (Status.STALE, Reason("changed", changed, "save")) if changed else (Status.DONE, None)
