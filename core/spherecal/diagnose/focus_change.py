"""A lens that was zoomed or focused again during the recording looks like a camera that is unsteady, or moved."""

import numpy as np

from spherecal.adjust.parameter_layout import POSE
from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.group_motion import GroupMotion
from spherecal.diagnose.score import change_of

# One factor explains this much of what a pose for each of the camera's images does: all of it where a focal length
# changed by 0.1 %. A zoom of all cameras explains 0.1 to 0.5 of it, cameras on a beam that sags 0.02 to 0.1.
MOST_OF_IT = 0.8


def focus_change(e: Evidence, motion: GroupMotion) -> list[Finding]:
    """The finding on one camera's focal length that changed before a placement, where this is what seems to move."""
    probe = e.probe
    if probe is None or len(motion.cameras) != 1:
        return []
    (camera,) = motion.cameras
    rows = np.flatnonzero(probe.problem.camera == camera)
    placement, weight = e.observations.placement[e.adjusted.rows][rows], probe.problem.weight[rows]
    centred = ((probe.problem.uv[rows] - e.adjusted.state.intrinsics[camera, 2:4]) * weight)[:, :, None]
    seen, image = np.unique(placement, return_inverse=True)
    poses = np.zeros((len(rows), 2, len(seen), POSE))
    poses[np.arange(len(rows)), :, image] = probe.by_pose(rows)
    by_poses = change_of(*probe.block(rows, poses.reshape(len(rows), 2, -1)), probe.variance).statistic
    changes = {
        int(first): change_of(*probe.block(rows, centred * (placement >= first)[:, None, None]), probe.variance)
        for first in seen[1:]
    }
    if not changes:
        return []
    first, best = max(changes.items(), key=lambda one: one[1].statistic)
    if best.statistic < MOST_OF_IT * by_poses:
        return []
    name, place = e.camera_ids[camera], e.observations.placements[first]
    values = {"camera": name, "place": place, "percent": 100 * float(best.value[0]), "chi_square": best.statistic}
    return [Finding("focus-changed", "error", values, (name, place))]
