"""Placements and bar poses: taken, taken again, deleted, brought back."""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from PySide6.QtCore import QCoreApplication, QObject, Signal

from spherecal.base.context import Context
from spherecal_gui import project as changes
from spherecal_gui.fingerprint import fingerprint
from spherecal_gui.presenters.coverage import SetDots
from spherecal_gui.presenters.guidance import GuidanceView
from spherecal_gui.project_folder import taken_in
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.guide import plan_coarse, plan_next
from spherecal_gui.tasks.task import Runner
from spherecal_gui.wizard.tune_control import TuneControl

if TYPE_CHECKING:  # cameras, simulator and ghosts need scipy, for which the window does not wait
    from spherecal.cameras.in_process import Staged
    from spherecal.cameras.simulated.stage import Stage
    from spherecal_gui.tasks.ghost import Lying, ToGo
    from spherecal_gui.tasks.live import Sight

translate = QCoreApplication.translate

_PATIENCE_MS = 3_000  # the engine looks five times a second whether it should stop


@runtime_checkable
class Movable(Protocol):
    """A source whose ball and bars the program can move: a simulated rig."""

    @property
    def stage(self) -> "Stage":
        """Where ball and bars are."""
        ...


class SetControl(TuneControl):
    """What is done with placements and poses.

    `guidance_changed` when there is other advice for the next one, `ball_seen` when the ball was looked at again.
    """

    guidance_changed = Signal()
    ball_seen = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.planner, self.seer = Runner(self), Runner(self)
        self.lying: Lying | None = None  # where the ball stands now
        self.guidance: GuidanceView | None = None
        self.taking: str | None = None  # the set whose images are being taken
        self._planned_for: tuple[tuple[str, str], ...] | None = None
        self._asked: tuple[tuple[str, str], ...] | None = None
        self.changed.connect(self._plan_next)

    def close_project(self) -> None:
        """Let go of cameras and project; all is on disk already."""
        self.planner.abandon(_PATIENCE_MS)
        self.seer.abandon(_PATIENCE_MS)
        self.lying = None
        self.guidance, self._planned_for = None, None
        super().close_project()

    @property
    def _staged(self) -> "Staged | None":
        """The simulated or recorded source, which shows what it is asked for; None for real cameras."""
        if self.connection is None:
            return None
        from spherecal.cameras.in_process import Staged  # the window starts without the cameras' modules

        source = self.connection.source
        return source if isinstance(source, Staged) else None

    @property
    def staged_poses(self) -> tuple[str, ...]:
        """What a simulated or recorded source can show; empty for real cameras."""
        source = self._staged
        return source.poses if source is not None else ()

    def show_pose(self, pose: str) -> None:
        """Have a simulated or recorded rig show a pose: there nobody moves the ball by hand."""
        source = self._staged
        if source is None or not self.staged_poses:
            return
        if pose in self.staged_poses:
            if source.shown != pose:
                source.show(pose)
        elif isinstance(source, Movable):  # one more placement than the rig was simulated with
            placed = [one for one in self.staged_poses if one in source.stage.truth.placements]
            number = int(pose[1:]) if pose[1:].isdecimal() else 1
            source.show(placed[number % len(placed)])
            source.stage.move((40.0, -30.0, 60.0), (25.0, 40.0, 0.0))
        if self.live is not None:
            self.live.forget()

    def take(self, set_id: str, step: str) -> bool:
        """Take a set, or take it again; False where that is not possible now.

        Parameters
        ----------
        set_id
            A placement or a pose of a bar.
        step
            Id of the step that takes it, for which a failure is noted.
        """
        folder = self._folder_of(set_id)
        if self.connection is None or folder is None or self.project is None:
            return False
        self._update(changes.without_failure(self.project, step))
        connection, real = self.connection, not self.staged_poses
        warm = self.project.bar_celsius if set_id in self.project.check_poses else None

        def work(context: Context) -> jobs.Taken:
            taken = jobs.take_set(connection, set_id, context, real)
            context.report("writing the images", 0.9, set_id)
            if warm is not None:
                folder.plan_anew(set_id, warm)
            folder.add(folder.planned(set_id), taken.frames, taken.stillness)
            return taken

        begun = self.runner.start(step, work, self._set_taken, self._failed(step))
        self.taking = set_id if begun else None
        return begun

    def _work_ended(self, name: str) -> None:
        self.taking = None
        super()._work_ended(name)

    def _set_taken(self, taken: jobs.Taken) -> None:
        folder, connection = self._folder_of(taken.set_id), self.connection
        if self.project is None or folder is None or self._store is None or connection is None:
            return
        at = folder.taken_at(taken.set_id)
        self._store.save(taken.set_id, at, taken.dots)
        self._found[taken.set_id] = taken.dots
        names = connection.names
        lacking = tuple(names[one.camera] for one in taken.frames.missing)
        moving = tuple(names[serial] for serial, one in taken.stillness.items() if not one.still)
        flaws: dict[changes.FlawCode, tuple[str, ...]] = {"taken without": lacking, "taken moving": moving}
        self._update(changes.with_set(self.project, taken.set_id, at, flaws))
        self.taken.emit(taken.set_id)
        missing, moved = ", ".join(lacking), ", ".join(moving)
        if missing:
            text = translate("Placement", "{name} is captured, but without {cameras}.").format(
                name=taken.set_id, cameras=missing
            )
            self.tell("bad", text, translate("Placement", "Check these cameras, then retake it."))
        elif moved:
            text = translate("Placement", "{name} is captured, but {cameras} saw it move.").format(
                name=taken.set_id, cameras=moved
            )
            self.tell("bad", text, translate("Placement", "Let it come to rest, then retake it."))
        else:
            self.tell("good", translate("Placement", "{name} is captured.").format(name=taken.set_id))

    def delete(self, set_id: str) -> None:
        """Put a set aside."""
        folder = self._folder_of(set_id)
        if folder is None or self.project is None or self.runner.running:
            return
        if not self._try(lambda: folder.remove(set_id)):
            return
        self._found.pop(set_id, None)
        self._update(changes.without_set(self.project, set_id))

    @property
    def can_undo(self) -> str | None:
        """The set that `undo` would bring back."""
        return self._recorded.can_undo if self._recorded is not None else None

    def undo(self) -> None:
        """Bring back the set that was deleted or replaced last."""
        recorded = self._recorded
        if recorded is None or self.project is None or self.runner.running:
            return
        brought: list[str | None] = []
        if not self._try(lambda: brought.append(recorded.undo())) or brought[0] is None:
            return
        set_id = brought[0]
        self._update(replace(self.project, taken=taken_in(self.project.folder)))
        loaded = self._store.load(set_id, self.project.taken[set_id]) if self._store else None
        self._found.pop(set_id, None)
        if loaded is not None:
            self._found[set_id] = loaded
        else:
            self._find_lost_dots()

    # --- where next --------------------------------------------------------------------------------------------------

    def _plan_next(self) -> None:
        """Have the engine work out the next placement, beside everything else; the last question asked counts."""
        project = self.project
        if project is None or self._recorded is None or self.connection is None or project.purpose != "calibrate":
            return
        if project.by_board:  # advice is for the ball
            return
        known = self.dots
        dots = {name: known[name] for name in project.placements if name in project.taken and name in known}
        masks = (("masks", fingerprint(project.masks)),) if dots else ()
        key = (*((name, project.taken[name]) for name in dots), *masks)
        if key == self._planned_for:
            return
        self.guidance, self._planned_for = None, key
        self.planner.cancel()
        self.lying = None
        if dots and self.planner.running is None:
            self._asked = key
            self._ask(dots, coarse=True)
        self.guidance_changed.emit()

    def _ask(self, dots: Mapping[str, SetDots], coarse: bool) -> None:
        """Have the engine work it out: first coarsely, then well."""
        recorded, connection = self._recorded, self.connection
        if recorded is None or connection is None:  # closed between the two answers, as by a full disk
            return
        document, target_set = recorded.document(), connection.plan.target_set
        work = plan_coarse if coarse else plan_next

        def done(found: GuidanceView | None) -> None:
            if coarse and self._asked == self._planned_for:
                if found is not None:
                    self.guidance = found
                self._ask(dots, coarse=False)
                self.guidance_changed.emit()
            else:
                self._planned(found)

        def failed(error: BaseException) -> None:
            if coarse:
                done(None)
            else:
                self._not_planned(error)

        self.planner.start(
            "guidance", lambda context: work(document, target_set, dots, context), done, failed, self._plan_anew
        )

    @property
    def planning_s(self) -> float | None:
        """For how long it has been worked out; None where nothing is."""
        task = self.planner.task
        return time.perf_counter() - task.began_s if task is not None else None

    def look_at_ball(self, sights: Mapping[str, "Sight"]) -> bool:
        """Work out where the ball stands now against its ghost, beside the window; whether that was begun."""
        from spherecal_gui.tasks.ghost import lying_ball  # needs scipy

        guidance = self.guidance
        if guidance is None or guidance.ghost is None or self.seer.running is not None:
            return False
        ghost, dots = guidance.ghost, {name: sight.dots for name, sight in sights.items()}

        def seen(lying: "Lying | None") -> None:
            if self.guidance is guidance:
                self.lying = lying
                self.ball_seen.emit()

        return self.seer.start(
            "ball",
            lambda _: lying_ball(ghost.lenses, ghost.body, dots),
            seen,
            lambda error: self.note(f"ball: {error}"),
        )

    @property
    def to_go(self) -> "ToGo | None":
        """How far the ball still is from its ghost; None where either is not known."""
        from spherecal_gui.tasks.ghost import to_go  # needs scipy

        if self.guidance is None or self.guidance.ghost is None or self.lying is None:
            return None
        return to_go(self.guidance.ghost, self.lying)

    @property
    def can_put_there(self) -> bool:
        """Whether a simulated rig can have its ball where the ghost is."""
        source = self.connection.source if self.connection is not None else None
        return self.guidance is not None and self.guidance.ghost is not None and isinstance(source, Movable)

    def put_there(self) -> None:
        """Have a simulated rig move its ball to the ghost, as somebody would do by hand."""
        from spherecal_gui.tasks.ghost import stage_ball  # needs scipy

        source = self.connection.source if self.connection is not None else None
        ghost = self.guidance.ghost if self.guidance is not None else None
        if isinstance(source, Movable) and ghost is not None and self.live is not None:
            stage_ball(source.stage, ghost, self.lying)
            self.live.forget()

    @property
    def planning(self) -> bool:
        """Whether the next placement is being worked out."""
        return self.planner.running is not None

    def _planned(self, found: GuidanceView | None) -> None:
        if self._asked != self._planned_for:
            self._plan_anew()
            return
        self.guidance = found
        self.guidance_changed.emit()

    def _not_planned(self, error: BaseException) -> None:
        """Advice is a help, not a need: what went wrong stands in the log."""
        self.note(translate("Log", "no advice for the next placement: {why}").format(why=error))
        self._planned(None)

    def _plan_anew(self) -> None:
        self._planned_for = None
        self._plan_next()

    def add_placement(self) -> None:
        """Plan one more placement and go there."""
        from spherecal.cameras.plan import PlannedSet  # needs scipy

        if self.project is None or self._recorded is None:
            return
        project = changes.with_another_placement(self.project)
        self._recorded.plan_more(PlannedSet(project.placements[-1]))
        self._update(replace(project, step=f"placement:{project.placements[-1]}"))

    def drop_placement(self, set_id: str) -> None:
        """Do without a planned placement that was not taken."""
        if self.project is not None:
            self._update(changes.without_placement(self.project, set_id))
