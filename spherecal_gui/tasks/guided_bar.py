"""The check bars' poses on seven lines of the volume: planned, looked at as they are laid, laid on a simulated rig."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.targets.target_set import TargetSet
from spherecal_gui.coverage import Dots
from spherecal_gui.tasks.placement_advice import observations_of

if TYPE_CHECKING:
    from spherecal.data.rig import Rig
    from spherecal.data.session import Bar
    from spherecal_cameras.simulated.stage import Stage
    from spherecal_rigs.pose_plan import PlannedPose, PosePlan

# Imported inside functions: scipy, for which the window does not wait.


def plan_poses_of(result_folder: Path, rig: "Rig", bars: "Sequence[Bar]") -> "PosePlan | None":
    """The plan for the check bars among `bars`; None without a scale, a volume or such a bar."""
    from spherecal_rigs.pose_plan import BarMarks, plan_poses
    from spherecal_rigs.save_entry import points_box

    marks = [BarMarks.of(bar.id, bar.lengths) for bar in bars if bar.role == "check" and bar.lengths]
    box = points_box(result_folder / "points.csv")
    if not marks or box is None or not rig.cameras or rig.scale.source == "none":
        return None
    plan = plan_poses(rig, marks, (np.array(box[0]), np.array(box[1])))
    return plan if plan.poses else None


def lying_ends(rig: "Rig", bar: "Bar", target_set: TargetSet | None, dots: Mapping[str, Dots]) -> FloatArray | None:
    """Where the first and the last mark of a bar are, (2, 3) mm in the rig's world; None where not found."""
    from spherecal_rigs.live_pose import measured_ends

    return measured_ends(rig, bar, target_set, observations_of(["live"], list(dots), {"live": dots}, target_set))


def lay_bar(stage: "Stage", rig: "Rig", pose: "PlannedPose", bar: "Bar") -> None:
    """Lay a bar of a simulated rig as the plan asks, as somebody would do by hand."""
    from scipy.spatial.transform import Rotation

    from spherecal_rigs.pose_plan import BarMarks

    reference = rig.camera(rig.reference_camera or "")
    assert reference is not None
    true = next(camera for camera in stage.truth.cameras if camera.id == rig.reference_camera)
    start, end = (
        true.rotation.T @ (reference.rotation @ place + reference.translation_mm - true.translation_mm)
        for place in (pose.start_mm, pose.end_mm)
    )
    names, own = BarMarks.of(bar.id, bar.lengths).names, stage.truth.bar(pose.bar)
    first, last = (own.x_mm[own.marks.index(name)] for name in (names[0], names[-1]))
    along = (end - start) / np.linalg.norm(end - start) * np.sign(last - first)
    back = -true.rotation.T @ (reference.rotation @ pose.facing)  # the marks are on the side of -z
    back = back - (back @ along) * along
    back /= np.linalg.norm(back)
    wanted = np.column_stack([along, np.cross(back, along), back])
    shown = next(one for one in stage.truth.bar_poses if one.bar == pose.bar)
    stage.show(shown.id)
    turn = Rotation.from_matrix(wanted @ shown.rotation.T).as_rotvec(degrees=True)
    shift = start - first * along - shown.place_mm
    stage.move(tuple(shift.tolist()), tuple(turn.tolist()))
