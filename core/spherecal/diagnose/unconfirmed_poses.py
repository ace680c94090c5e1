"""Cameras whose pose at the end of the recording is not certain, and their other possible poses."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import chdtri

from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import FloatArray
from spherecal.data.findings import Finding, leave_out
from spherecal.diagnose.camera_findings import pose_scatter
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.image_findings import LEAST_POINTS, MOST_LEFT_OUT
from spherecal.diagnose.moves import LEAST_STATISTIC, raised
from spherecal.geometry.camera import project_with_point_derivatives
from spherecal.geometry.rotation import cross_matrix, exp_rotation
from spherecal.geometry.transform import Pose, pose_change

# Of moves with up to this many times the least statistic, one a third as large would not have been seen: the camera's
# other images may differ by that, and more where they scatter. A camera that saw the ball displaced by 0.05 mm, each
# time elsewhere, passed for one that was knocked by 0.086 mm (statistic 205): it was 5.1 times its U off, and the rig
# valid. Another passed for knocked by 0.098 mm (statistic 448, images scattering 1.32 times as noise): 3.8 times.
SMALL_MOVE = 9.0

# Points of a camera's last image that alone can show that it has moved: fewer say nothing about a pose. Knocked by
# 0.3 mm before an image of 5 dots, which were left out, a camera was 3.8 times its U off, and valid.
LEAST_IN_LAST = 3
# A pose explains them where they then lie as near as noise allows at this chance. Without a move four dots at the edge
# of a lens that its model does not follow (dome15, one lens for all) were left out too: no pose brings those below
# 100 times the noise.
BY_NOISE = 1e-6
ROUNDS = 6
# How far a camera may have moved: knocks tried are up to 50 mm and 3 degrees.
TURN_RAD, SHIFT_OF_DISTANCE = 0.1, 0.05


Kind = Literal["one-image", "small-move", "last-image", "unlike-any-pose", "not-seen-since"]


@dataclass(frozen=True)
class UnconfirmedPose:
    """A camera (index) that may have other poses: turn and shift to each (k,6) in mm, its centre's shift (k,3)."""

    camera: int
    kind: Kind
    image: int
    changes: FloatArray
    centre_shifts: FloatArray


def unconfirmed_poses(e: Evidence, findings: Sequence[Finding]) -> list[UnconfirmedPose]:
    """Cameras whose pose the recording does not confirm, given what was found on how much poses scatter.

    A pose after a move may rest on one image alone, or differ so little from the earlier one that the camera's images
    may differ as much. The camera's last image may show another pose with too few points, or be one that no pose
    explains. Or the camera has no image since others moved together.
    """
    counts, state, scatter = e.image_counts(e.used), e.solution.state, pose_scatter(findings)
    found = []
    for c, k in _split_cameras(e):
        images = np.flatnonzero(counts[:, c])
        if len(images) == 1 or (len(images) > 1 and _is_small_move(e, c, k, scatter.get(e.camera_ids[c], 1.0))):
            kind: Kind = "one-image" if len(images) == 1 else "small-move"
            earlier = (state.rotation[k], state.translation[k])
            found.append(_unconfirmed(e, c, kind, int(images[0]), [earlier]))
    return found + _last_images(e, {pose.camera for pose in found}) + _carried_along(e)


def unconfirmed_findings(e: Evidence, findings: Sequence[Finding]) -> list[Finding]:
    """A finding for each camera whose pose the recording does not confirm, given the findings of the diagnosis."""
    poses = [
        pose for pose in unconfirmed_poses(e, findings) if pose.kind != "not-seen-since"
    ]  # these have one in common
    return [_finding(e, pose) for pose in poses] + _not_seen_since(e)


def _finding(e: Evidence, pose: UnconfirmedPose) -> Finding:
    name, place = e.camera_ids[pose.camera], e.observations.placements[pose.image]
    values: dict[str, object] = {"place": place}
    no_scale = pose.kind == "small-move" and e.solution.scale.source == "none"
    if pose.kind == "small-move":
        values["shift" if no_scale else "shift_mm"] = float(np.linalg.norm(pose.centre_shifts[0]))
    elif pose.kind in ("last-image", "unlike-any-pose"):
        values["points"] = int(e.image_counts(e.candidates)[pose.image, pose.camera])
    repairs = leave_out(f"{name}@{place}") if pose.kind == "one-image" else ()
    return Finding(
        "pose-unconfirmed", "warning", values, (name,), repairs, "small-move-no-scale" if no_scale else pose.kind
    )


def _unconfirmed(e: Evidence, c: int, kind: Kind, image: int, others: Sequence[Pose]) -> UnconfirmedPose:
    r, t = e.solution.state.rotation[c], e.solution.state.translation[c]
    changes = np.array([pose_change((r, t), other) for other in others])
    return UnconfirmedPose(c, kind, image, changes, np.array([r.T @ t - other[0].T @ other[1] for other in others]))


def _last_images(e: Evidence, known: Collection[int]) -> list[UnconfirmedPose]:
    """Cameras whose last images show other poses with few points, most of which were left out.

    An image of which every point was left out counts without a pose that explains it. A camera was binned from then on
    and 4 of its dots were left: all its lengths were wrong, and the rig was valid.
    """
    out, points = e.image_counts(e.contradicting), e.image_counts(e.candidates)
    later = np.cumsum(points[::-1], axis=0)[::-1] - points
    few = (later == 0) & (points < LEAST_POINTS) & (out >= LEAST_IN_LAST) & (out >= MOST_LEFT_OUT * points)
    few[:, e.is_earlier_pose] = False
    found = []
    for c, t in ((int(c), int(t)) for c, t in np.argwhere(few.T) if c not in known):
        poses = _poses_from_few(e, c, t)
        if poses:
            found.append(_unconfirmed(e, c, "last-image", t, poses))
        elif out[t, c] == points[t, c]:
            found.append(UnconfirmedPose(c, "unlike-any-pose", t, np.empty((0, POSE)), np.empty((0, 3))))
    return found


def _poses_from_few(e: Evidence, c: int, t: int) -> list[Pose]:
    """The nearest poses that explain what the image shows: by a turn, by a shift, by both (with over three points)."""
    o, state = e.observations, e.solution.state
    rows = np.flatnonzero((o.camera == c) & (o.placement == t) & e.candidates)
    points = state.points[e.features.of_observation[rows]]
    known = np.isfinite(points[:, 0])
    rows, points = rows[known], points[known]
    if len(rows) < LEAST_IN_LAST:
        return []
    image = _FewPoints(points, o.uv[rows], state.intrinsics[c], float(e.noise_px[c]))
    ways = [slice(0, 3), slice(3, POSE), *[slice(0, POSE)] * (len(rows) > LEAST_IN_LAST)]
    poses = (image.nearest_pose((state.rotation[c], state.translation[c]), free) for free in ways)
    return [pose for pose in poses if pose is not None]


@dataclass(frozen=True)
class _FewPoints:
    """Points (n,3) that a camera sees at uv (n,2) px."""

    points: FloatArray
    uv: FloatArray
    intrinsics: FloatArray
    noise_px: float

    def nearest_pose(self, pose: Pose, free: slice) -> Pose | None:
        """The pose near another that explains the image except for noise, by turn, shift or both; None without one."""
        start, off = pose, np.full(self.uv.size, np.inf)
        distance = np.linalg.norm(self.points @ pose[0].T + pose[1], axis=1).mean()
        stay = 1 / np.repeat([TURN_RAD, SHIFT_OF_DISTANCE * distance], 3)
        for _ in range(ROUNDS):
            x = self.points @ pose[0].T + pose[1]
            seen, by_point = project_with_point_derivatives(x, self.intrinsics)
            off = ((self.uv - seen) / self.noise_px).ravel()
            by_pose = np.concatenate([by_point @ -cross_matrix(x), by_point], axis=2).reshape(-1, POSE)
            design = np.vstack([by_pose / self.noise_px, np.diag(stay)])[:, free]
            goal = np.concatenate([off, -stay * pose_change(start, pose)])
            if not np.isfinite(design).all() or not np.isfinite(goal).all():
                return None
            step = np.zeros(POSE)
            step[free] = np.linalg.lstsq(design, goal, rcond=None)[0]
            rotation = exp_rotation(step[:3])
            pose = rotation @ pose[0], rotation @ pose[1] + step[3:]
        freedom = off.size - (free.stop - free.start)
        return pose if off @ off < chdtri(freedom, BY_NOISE) else None


def _split_cameras(e: Evidence) -> list[tuple[int, int]]:
    ids = list(e.camera_ids)
    pairs = [
        (ids.index(camera.earlier_pose_of), k)
        for k, camera in enumerate(e.session.cameras)
        if camera.earlier_pose_of is not None and e.placed[k]
    ]
    latest = dict(pairs)  # of several former poses the last is that before the image
    return [(c, k) for c, k in latest.items() if e.placed[c]]


def _is_small_move(e: Evidence, now: int, before: int, scatter: float) -> bool:
    """Whether the difference of two poses is significant, but would not be at a third of its size."""
    if e.solution.cameras is None:
        return False
    joint = e.solution.cameras
    width = len(joint) // len(e.placed)
    state = e.solution.state
    change = pose_change(*((state.rotation[c], state.translation[c]) for c in (now, before)))
    rows, columns = (slice(c * width, c * width + POSE) for c in (now, before))
    of_both = joint[rows, rows] + joint[columns, columns] - joint[rows, columns] - joint[columns, rows]
    return float(change @ np.linalg.pinv(of_both) @ change) < raised(SMALL_MOVE * LEAST_STATISTIC, scatter)


def _not_seen_since(e: Evidence) -> list[Finding]:
    """The finding on cameras without an image since several others moved at once."""
    unseen, moved, first = _unseen(e)
    if not unseen:
        return []
    values = {"moved": [e.camera_ids[k] for k in moved], "place": e.observations.placements[first]}
    where = tuple(e.camera_ids[k] for k in unseen)
    return [Finding("pose-unconfirmed", "warning", values, where, kind="not-seen-since")]


def _unseen(e: Evidence) -> tuple[list[int], list[int], int]:
    """Cameras without an image since several others moved at once, those that moved, and before which placement.

    One part of the frame may carry all of them. A beam of three cameras was bent by 2 mm after the last image of one of
    them; that one was 83 U off.
    """
    images = e.image_counts(e.used) > 0
    seen = np.flatnonzero(~e.is_earlier_pose & e.placed & images.any(axis=0))
    split = {camera.earlier_pose_of for camera in e.session.cameras}
    since = {int(k): int(np.argmax(images[:, k])) for k in seen if e.camera_ids[k] in split}
    together = [t for t, count in Counter(since.values()).items() if count > 1]
    if not together:
        return [], [], 0
    first = min(together)
    last = len(images) - 1 - np.argmax(images[::-1], axis=0)
    return [int(k) for k in seen if last[k] < first], [k for k, t in since.items() if t == first], first


def _carried_along(e: Evidence) -> list[UnconfirmedPose]:
    """Cameras without an image since others moved together, with the poses that they have if they moved along."""
    unseen, moved, first = _unseen(e)
    state, earlier = e.solution.state, dict(_split_cameras(e))
    if not unseen:
        return []
    found = []
    for c in unseen:
        others = []
        for m in moved:
            if m not in earlier:
                continue
            before = earlier[m]
            # what moved the camera m in the world, in front of the former pose of c
            rotation_change = state.rotation[before].T @ state.rotation[m]
            translation = state.rotation[m].T @ (state.translation[before] - state.translation[m])
            rotation = state.rotation[c] @ rotation_change
            others.append((rotation, state.translation[c] - rotation @ translation))
        if others:
            found.append(_unconfirmed(e, c, "not-seen-since", first, others))
    return found
