"""Check bars: where the engine wants them, where they lie now; what a simulated or recorded rig is asked to show."""

from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import Signal

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal_gui import project as changes
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import error_line
from spherecal_gui.presenters.bars_presenter import BarGuide, bar_guide
from spherecal_gui.tasks.placement_advice import lay_bar, lying_ends
from spherecal_gui.tasks.task import Runner
from spherecal_verify.limit import parse_limit

if TYPE_CHECKING:  # planning, ghosts and live images need scipy, for which the window does not wait
    from spherecal.data.session import Bar
    from spherecal_cameras.simulated.stage import Stage
    from spherecal_gui.controllers.controller import Controller
    from spherecal_gui.tasks.ghost import Drawn
    from spherecal_gui.tasks.live_detection import Sight
    from spherecal_rigs.pose_plan import PlannedPose, PosePlan

_PATIENCE_MS = 5000


class BarController(ControllerPart):
    """What is done with check bars; `seen` when the bar was looked at again."""

    seen = Signal()

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.looker = Runner(self)
        self.guide: BarGuide | None = None
        self.lying_ends: FloatArray | None = None  # of the bar as it was seen last, (2, 3) mm

    def close(self) -> None:
        """Stop looking at the bar."""
        self.looker.abandon(_PATIENCE_MS)
        self.guide = self.lying_ends = None

    def take_over_plan(self) -> None:
        """Plan the check bars' poses as the new result asks; a recording has the poses that it has."""
        project, plan = self.project, self._plan
        if project is None or plan is None or project.source.startswith("replay") or project.purpose == "check":
            return
        wanted = tuple((pose.id, pose.bar) for pose in plan.poses)
        if any(pose in project.taken for pose in project.check_poses) or project.pose_bars == wanted:
            return  # poses that are being taken stay what they are
        project = changes.with_poses(project, wanted)
        self.main.recording.plan_checks(project)
        self.main.update(project)

    @property
    def _plan(self) -> "PosePlan | None":
        return self.main.outcome.plan if self.main.outcome is not None else None

    def planned_pose(self, pose: str) -> "PlannedPose | None":
        """A pose of the engine's plan; None for one that it does not know."""
        planned = self.project is not None and pose in dict(self.project.pose_bars)
        if self._plan is None or not planned:
            return None
        return next((one for one in self._plan.poses if one.id == pose), None)

    def bar(self, name: str) -> "Bar":
        """A bar on the bench."""
        return next(one for one in self.main.cameras.bars if one.id == name)

    def ghosts(self, pose: str) -> "dict[str, Drawn]":
        """The bar of a guided pose as each camera would see it where it should lie, and as it lies."""
        from spherecal_gui.tasks.ghost import Lenses, drawn_bar  # needs scipy

        planned = self.planned_pose(pose)
        if planned is None or self.main.result is None:
            return {}
        seen = self.lying_ends if self.guide is not None and self.guide.pose == pose else None
        return drawn_bar(Lenses.of(self.main.result.rig), np.stack([planned.start_mm, planned.end_mm]), seen)

    def look_at(self, pose: str, sights: "dict[str, Sight]") -> bool:
        """Work out where the bar lies now, beside the window; whether that was begun."""
        planned, outcome, connection = self.planned_pose(pose), self.main.outcome, self.main.cameras.connection
        if planned is None or outcome is None or connection is None or self.looker.running is not None:
            return False
        dots = {name: sight.dots for name, sight in sights.items()}
        bar, rig, target_set = self.bar(planned.bar), outcome.result.rig, connection.plan.target_set
        targets = {mark.target for mark in bar.marks.values()}
        seeing = [s for s in sights.values() if targets & set(s.dots.target.tolist())]
        still = all(sight.still for sight in seeing) if seeing else None

        def looked(ends: FloatArray | None) -> None:
            if self.main.outcome is outcome and outcome.planes is not None and outcome.plan is not None:
                self.lying_ends = ends
                self.guide = bar_guide(outcome.planes, planned, ends, still)
                self.seen.emit()

        def failed(error: BaseException) -> None:
            self.main.note(f"bar {planned.bar}: {error}")

        return self.looker.start("bar", lambda _: lying_ends(rig, bar, target_set, dots), looked, failed)

    def celsius(self) -> float | None:
        """The bars' temperature: as it was read, else as the bench's description has it."""
        connection = self.main.cameras.connection
        if self.project is None or self.project.bar_celsius is not None or connection is None:
            return self.project.bar_celsius if self.project is not None else None
        plan = connection.plan
        bars = {bar.id for bar in plan.bars if bar.role == "check"}
        return next((one.temperature_c for one in plan.sets if one.bar in bars and one.temperature_c is not None), None)

    def set_limit(self, limit: str) -> str:
        """Judge the errors by this limit (A+L/K, empty: none); what is wrong with it, empty where all is well."""
        try:
            if limit:
                parse_limit(limit)
        except InputError as error:
            return error_line(error)
        self.main.change(limit=limit)
        return ""


class StagingController(ControllerPart):
    """What a simulated or recorded rig is asked to show."""

    @property
    def _stage(self) -> "Stage | None":
        """Where ball and bars of a simulated rig are, which the program can move."""
        return getattr(self.main.cameras.source, "stage", None)

    def can_show(self, pose: str) -> bool:
        """Whether it can show a bar's pose: one of its own, or one that the plan describes."""
        poses = self.main.cameras.staged_poses
        return pose in poses or (bool(poses) and self.main.bars.planned_pose(pose) is not None)

    def show_pose(self, pose: str) -> None:
        """Show a pose: a guided one is laid as the plan asks, others as the rig was simulated or recorded with."""
        planned, stage, result = self.main.bars.planned_pose(pose), self._stage, self.main.result
        source, poses = self.main.cameras.staged, self.main.cameras.staged_poses
        if planned is not None and result is not None and stage is not None:
            lay_bar(stage, result.rig, planned, self.main.bars.bar(planned.bar))
        elif source is None or not poses:
            return
        elif pose in poses:
            if source.shown != pose:
                source.show(pose)
        elif stage is not None:  # one more placement than the rig was simulated with
            placed = [one for one in poses if one in stage.truth.placements]
            number = int(pose[1:]) if pose[1:].isdecimal() else 1
            source.show(placed[number % len(placed)])
            stage.move((40.0, -30.0, 60.0), (25.0, 40.0, 0.0))
        self._forget_sights()

    @property
    def can_put_there(self) -> bool:
        """Whether a simulated rig can have its ball where the ghost is."""
        guidance = self.main.advice.guidance
        return guidance is not None and guidance.ghost is not None and self._stage is not None

    def put_there(self) -> None:
        """Have a simulated rig move its ball to the ghost, as somebody would do by hand."""
        from spherecal_gui.tasks.ghost import stage_ball  # needs scipy

        stage, guidance = self._stage, self.main.advice.guidance
        ghost = guidance.ghost if guidance is not None else None
        if stage is not None and ghost is not None and self.main.cameras.live is not None:
            stage_ball(stage, ghost, self.main.advice.lying)
            self._forget_sights()

    def _forget_sights(self) -> None:
        if self.main.cameras.live is not None:
            self.main.cameras.live.forget()
