"""Images that contradict all others: of another camera or placement, of a camera bumped far, or simply wrong.

The gate has left their points out, so the network does not know of them; what they show is compared with what the rest
of the network predicts.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.diagnose.evidence import Evidence
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.resection import resect
from spherecal.geometry.rotation import log_rotation

# An image is wrong as a whole when most of what it shows was left out; in rigs with 5 % of wrong points the worst image
# had a quarter of them.
MOST_LEFT_OUT, LEAST_POINTS = 0.5, 12
# What makes an image another camera's or another placement's: most points where these would have them. Good points lie
# within 0.3 px; two cameras or two placements differ by hundreds.
SAME_IMAGE_PX, SAME_SHARE = 10.0, 0.7
# A camera that was knocked sees the same points from another pose.
RESECTION_PX, RESECTED_SHARE = 3.0, 0.6

# Beyond so many wrong images it is no longer single ones that are wrong (explaining one takes up to 0.1 s).
MOST_EXPLAINED = 60
# Poses of one camera, resected image by image with intrinsics that may be bent; a knock of this size is large, and two
# cameras are farther apart.
SAME_TURN_RAD, SAME_SHIFT = 0.1, 0.05

Kind = Literal["other-camera", "other-placement", "moved", "unknown"]


@dataclass(frozen=True)
class WrongImage:
    """An image (camera, placement) of which `left_out` of `points` contradict the rest, and what it shows instead.

    `other`: the camera or placement whose image it is; `pose`: rotation and translation from which it shows the points.
    """

    camera: int
    placement: int
    left_out: int
    points: int
    kind: Kind
    other: int | None = None
    pose: tuple[FloatArray, FloatArray] | None = None


def wrong_images(e: Evidence) -> list[WrongImage]:
    """All images that contradict the others as a whole, by camera and placement."""
    out, all_points = e.image_counts(e.contradicting), e.image_counts(e.candidates)
    wrong = (out >= MOST_LEFT_OUT * all_points) & (all_points >= LEAST_POINTS)
    counted = [(int(c), int(t), int(out[t, c]), int(all_points[t, c])) for c, t in np.argwhere(wrong.T)]
    if len(counted) > MOST_EXPLAINED:
        return [WrongImage(*one, "unknown") for one in counted]
    return _put_right(e, [_explain(e, *one) for one in counted])


def _explain(e: Evidence, c: int, t: int, out: int, count: int) -> WrongImage:
    state, o = e.solution.state, e.observations
    rows = np.flatnonzero((o.camera == c) & (o.placement == t))
    points, uv = state.points[e.features.of_observation[rows]], o.uv[rows]
    known = np.isfinite(points[:, 0])
    if known.sum() < LEAST_POINTS:
        return WrongImage(c, t, out, count, "unknown")
    points, uv = points[known], uv[known]
    others = e.placed & [not e.is_same_camera(c, d) for d in range(len(o.cameras))]
    shares = [_share(points, uv, state, d) if other else 0.0 for d, other in enumerate(others)]
    if max(shares) >= SAME_SHARE:
        return WrongImage(c, t, out, count, "other-camera", int(np.argmax(shares)))
    shares = [_share_of_placement(e, rows, t, other) for other in range(len(o.placements))]
    if max(shares) >= SAME_SHARE:
        return WrongImage(c, t, out, count, "other-placement", int(np.argmax(shares)))
    xy, usable = undistort(uv, state.intrinsics[c])
    pose = resect(points[usable], xy[usable], RESECTION_PX / state.intrinsics[c, 0])
    if pose is None or pose[2] < RESECTED_SHARE * len(points):
        return WrongImage(c, t, out, count, "unknown")
    return WrongImage(c, t, out, count, "moved", None, pose[:2])


def _put_right(e: Evidence, wrong: list[WrongImage]) -> list[WrongImage]:
    """The images tested again where most of a camera's show another pose: exchanged, it got the other's pose."""
    state, good = e.solution.state, e.image_counts(e.used) >= LEAST_POINTS
    poses = {int(c): (state.rotation[c], state.translation[c]) for c in np.flatnonzero(e.placed)}
    turned: dict[int, list[WrongImage]] = {}
    for c in sorted({image.camera for image in wrong if image.pose is not None}):
        own = [image for image in wrong if image.camera == c and image.pose is not None]
        alike = max(([i for i in own if _near(i.pose, o.pose)] for o in own), key=len)
        if len(alike) > good[:, c].sum() and alike[0].pose is not None:
            turned[c] = alike
            poses[c] = alike[0].pose
    out = [image for image in wrong if image not in turned.get(image.camera, [])]
    for c in turned:
        given = (state.rotation[c], state.translation[c])
        count = e.image_counts(e.candidates)[:, c]
        out += [
            WrongImage(c, int(t), int(count[t]), int(count[t]), "moved", None, given)
            for t in np.flatnonzero(good[:, c])
        ]
    for i, image in enumerate(out):  # as another camera's, where it shows the points from that camera's pose
        near = (c for c, pose in poses.items() if not e.is_same_camera(c, image.camera) and _near(image.pose, pose))
        if image.kind == "moved" and (other := next(near, None)) is not None:
            out[i] = replace(image, kind="other-camera", other=other)
    return out


def _near(a: tuple[FloatArray, FloatArray] | None, b: tuple[FloatArray, FloatArray] | None) -> bool:
    """Whether two poses are the same camera's, as well as a resection can show."""
    if a is None or b is None:
        return False
    rotation = np.linalg.norm(log_rotation(a[0] @ b[0].T))
    centres = [-pose[0].T @ pose[1] for pose in (a, b)]
    return bool(
        rotation < SAME_TURN_RAD and np.linalg.norm(centres[0] - centres[1]) < SAME_SHIFT * np.linalg.norm(a[1])
    )


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
