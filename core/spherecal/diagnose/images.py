"""Images that contradict all others: another camera's, another placement's, of a camera knocked far, or simply wrong.

The gate has left their points out, so the network does not know of them; what they show is compared with what the rest
of the network predicts.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherecal.adjust.problem import State
from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.diagnose.evidence import Evidence
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.rotation import log_rotation
from spherecal.network.resection import resect

# An image is wrong as a whole when most of what it shows was left out; in rigs with 5 % of wrong points the worst image
# had a quarter of them.
MOST_LEFT_OUT, LEAST_POINTS = 0.5, 12
# What makes an image another camera's or another placement's: most points where these would have them. Good points lie
# within 0.3 px; two cameras or two placements differ by hundreds.
SAME_IMAGE_PX, SAME_SHARE = 10.0, 0.7
# A camera that was knocked sees the same points from another pose.
RESECTION_PX, RESECTED_SHARE = 3.0, 0.6

Kind = Literal["other-camera", "other-placement", "moved", "unknown"]


@dataclass(frozen=True)
class WrongImage:
    """An image (camera, placement) of which `left_out` of `points` contradict the rest, and what it shows instead.

    `other`: the camera or placement whose image it is; `turn_rad`, `shift` (network units): how far the camera moved.
    """

    camera: int
    placement: int
    left_out: int
    points: int
    kind: Kind
    other: int | None = None
    turn_rad: float = 0.0
    shift: float = 0.0


def wrong_images(e: Evidence) -> list[WrongImage]:
    """All images that contradict the others as a whole, by camera and placement."""
    out, all_points = e.image_counts(e.contradicting), e.image_counts(e.candidates)
    wrong = (out >= MOST_LEFT_OUT * all_points) & (all_points >= LEAST_POINTS)
    return [
        _explain(e, int(c), int(t), int(out[t, c]), int(all_points[t, c])) for c, t in np.argwhere(wrong.T)
    ]  # fmt: skip


def _explain(e: Evidence, c: int, t: int, out: int, count: int) -> WrongImage:
    state, o = e.solution.state, e.observations
    rows = np.flatnonzero((o.camera == c) & (o.placement == t))
    points, uv = state.points[e.features.of_observation[rows]], o.uv[rows]
    known = np.isfinite(points[:, 0])
    if known.sum() < LEAST_POINTS:
        return WrongImage(c, t, out, count, "unknown")
    points, uv = points[known], uv[known]
    shares = [_share(points, uv, state, d) if d != c and e.placed[d] else 0.0 for d in range(len(o.cameras))]
    if max(shares) >= SAME_SHARE:
        return WrongImage(c, t, out, count, "other-camera", int(np.argmax(shares)))
    shares = [_share_of_placement(e, rows, t, other) for other in range(len(o.placements))]
    if max(shares) >= SAME_SHARE:
        return WrongImage(c, t, out, count, "other-placement", int(np.argmax(shares)))
    xy, usable = undistort(uv, state.intrinsics[c])
    pose = resect(points[usable], xy[usable], RESECTION_PX / state.intrinsics[c, 0])
    if pose is None or pose[2] < RESECTED_SHARE * len(points):
        return WrongImage(c, t, out, count, "unknown")
    turn = float(np.linalg.norm(log_rotation(pose[0] @ state.rotation[c].T)))
    centre, was = -pose[0].T @ pose[1], -state.rotation[c].T @ state.translation[c]
    return WrongImage(c, t, out, count, "moved", None, turn, float(np.linalg.norm(centre - was)))


def _share(points: FloatArray, uv: FloatArray, state: State, camera: int) -> float:
    """The share of image points (n,2) that lie where a camera sees the points (n,3)."""
    if not len(points):
        return 0.0
    x = points @ state.rotation[camera].T + state.translation[camera]
    with np.errstate(all="ignore"):
        off = np.linalg.norm(project(x, np.broadcast_to(state.intrinsics[camera], (len(x), 16))) - uv, axis=1)
    return float(((off <= SAME_IMAGE_PX) & (x[:, 2] > 0)).mean())


def _share_of_placement(e: Evidence, rows: IntArray, t: int, other: int) -> float:
    """The share of an image's points that lie where the same dots are at another placement."""
    if other == t:
        return 0.0
    o, f, state = e.observations, e.features, e.solution.state
    at_other = np.flatnonzero((f.placement == other) & np.isfinite(state.points[:, 0]))
    place = {(int(f.target[i]), int(f.point[i])): int(i) for i in at_other}
    found = [place.get((int(o.target[r]), int(o.point[r])), -1) for r in rows]
    known = np.array(found) >= 0
    if known.sum() < LEAST_POINTS:
        return 0.0
    points = state.points[np.array(found)[known]]
    return _share(points, o.uv[rows[known]], state, int(o.camera[rows[0]]))


def agreeing(e: Evidence, camera: int) -> BoolArray:
    """The camera's images (placements,) that have points and are not wrong as a whole."""
    counts = e.image_counts(e.used)[:, camera]
    return counts >= LEAST_POINTS
