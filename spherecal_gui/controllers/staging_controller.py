"""A simulated or recorded rig shows poses: there nobody moves ball and bars by hand."""

from typing import TYPE_CHECKING

from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.tasks.guided_bar import lay_bar

if TYPE_CHECKING:  # the simulator needs scipy, for which the window does not wait
    from spherecal_cameras.simulated.stage import Stage


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
        """Show a pose; a guided one is laid as the plan asks."""
        planned, stage, result = self.main.bars.planned_pose(pose), self._stage, self.main.result
        if planned is None or result is None or stage is None:
            self._show_own(pose)
            return
        lay_bar(stage, result.rig, planned, self.main.bars.bar(planned.bar))
        self._forget_sights()

    def _show_own(self, pose: str) -> None:
        """Show a pose that the rig was simulated or recorded with."""
        source, poses = self.main.cameras.staged, self.main.cameras.staged_poses
        if source is None or not poses:
            return
        if pose in poses:
            if source.shown != pose:
                source.show(pose)
        elif (stage := self._stage) is not None:  # one more placement than the rig was simulated with
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
