"""Exchanged cameras, axes or images: throughout, which their known intrinsics show, or in single images."""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.findings import AdvisedRepair, Finding
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.image_findings import WrongImage
from spherecal.geometry.camera import undistort
from spherecal.initialise.two_view import GATE_PX, epipolar_distance, robust_fundamental

# Exchanged priors must fit this much better than the session's, ...
BETTER = 5.0
# ... which must be off this many times as much as most other cameras' are, and by something to speak of (px). By their
# median instead, priors 0 to 2 % off at random named two pairs on a clean rig B: three of twelve were off by 1.4 %.
OUTSTANDING, LEAST_PX = 3.0, 5.0
MOST = 0.75


def swapped_cameras(e: Evidence) -> list[Finding]:
    """Pairs of cameras whose estimated focal lengths and principal points are each other's priors."""
    prior = np.array([camera.prior[:4] for camera in e.session.cameras])
    estimated = e.solution.state.intrinsics[:, :4]
    known = np.flatnonzero(e.placed & e.adjusted.problem.free_intrinsics[:, 0] & ~e.solved.has_prior)
    if len(known) < 2:
        return []
    own = np.linalg.norm(estimated - prior, axis=1)
    found = _exchanged_axes(e, prior[known, 2:], estimated[known, 2:])
    for a, b in combinations(known, 2):
        as_is = np.hypot(own[a], own[b])
        swapped = np.hypot(np.linalg.norm(estimated[a] - prior[b]), np.linalg.norm(estimated[b] - prior[a]))
        if as_is < max(BETTER * swapped, LEAST_PX):
            continue
        rest = np.setdiff1d(known, (a, b))
        usual = float(np.quantile(own[rest], MOST)) if len(rest) else 0.0
        if as_is < OUTSTANDING * np.sqrt(2) * usual:
            continue
        first, second = e.camera_ids[a], e.camera_ids[b]
        values = {"first": first, "second": second, "times": as_is / max(swapped, 1e-9)}
        values |= {"swapped_px": swapped, "as_is_px": as_is, "usual_px": usual}
        repairs = (AdvisedRepair("swap", f"{first},{second}"),)
        found.append(Finding("cameras-swapped", "warning", values, (first, second), repairs, "session"))
    return found


def _exchanged_axes(e: Evidence, prior: FloatArray, estimated: FloatArray) -> list[Finding]:
    """The finding on principal points (k,2) that are known ones with u and v exchanged, in most cameras."""
    as_is, back = np.linalg.norm(estimated - prior, axis=1), np.linalg.norm(estimated[:, ::-1] - prior, axis=1)
    if (as_is > np.maximum(BETTER * back, LEAST_PX)).mean() < MOST:
        return []
    return [Finding("mirrored", "error", where=tuple(np.array(e.camera_ids)[e.placed].tolist()), kind="axes")]


# --- exchanged images that distort the network itself ----------------------------------------------------------------
#
# The epipolar geometry of two cameras from all other placements must be valid at this one too. An image for which it
# is valid with no other camera is wrong. Two images of one placement for which it becomes valid when they are
# exchanged are each other's.

# Carried over from other placements, lines miss their points by up to 20 px (distortion that is not known yet); those
# of a wrong image by a hundred and more, so that some 15 % of them come this close by chance.
NEAR_PX = 30.0
LEAST_MATCHES = 12
RIGHT, WRONG = 0.7, 0.45
# Fundamental matrices to estimate (2 ms each): larger recordings are not searched.
MOST_MATRICES = 5000


@dataclass(frozen=True)
class _Matches:
    """Undistorted image points (cameras, features, 2) px, NaN where not seen, and each feature's placement (m,)."""

    flat: FloatArray
    placement: IntArray

    @cached_property
    def seen(self) -> BoolArray:
        """Which features each camera sees, (cameras, features)."""
        return np.isfinite(self.flat[:, :, 0])


def swapped_images(e: Evidence) -> list[WrongImage]:
    """Images that are each other's by the epipolar lines of the other cameras, by camera and placement."""
    matches = _matches(e)
    n, placements = len(e.camera_ids), np.unique(matches.placement)
    found = []
    if n * (n - 1) // 2 * len(placements) > MOST_MATRICES:
        return found
    for t in placements:
        lines = {
            (a, j): f for a in range(n) for j in range(n) if a < j and (f := _elsewhere(matches, a, j, t)) is not None
        }
        # or nothing known of it as it is
        suspects = [c for c in range(n) if not _share(matches, lines, c, c, t) >= WRONG]
        for a, b in permutations(suspects, 2):
            if not e.is_same_camera(a, b) and all(_share(matches, lines, *way, t) >= RIGHT for way in ((a, b), (b, a))):
                count = int((matches.seen[a] & (matches.placement == t)).sum())
                found.append(WrongImage(a, int(t), count, count, "other-camera", b))
    return found


def _matches(e: Evidence) -> _Matches:
    o = e.observations
    known = np.array([camera.prior for camera in e.session.cameras])[o.camera]
    xy, usable = undistort(o.uv, known)
    flat = np.full((len(o.cameras), len(e.features), 2), np.nan)
    rows = np.flatnonzero(usable)
    flat[o.camera[rows], e.features.of_observation[rows]] = xy[rows] * known[rows, :2] + known[rows, 2:4]
    return _Matches(flat, e.features.placement)


def _elsewhere(matches: _Matches, a: int, j: int, t: int) -> FloatArray | None:
    """The fundamental matrix of two cameras from all placements but one, None where they have too little."""
    common = matches.seen[a] & matches.seen[j] & (matches.placement != t)
    if common.sum() < 2 * LEAST_MATCHES:
        return None
    return robust_fundamental(matches.flat[a, common], matches.flat[j, common], GATE_PX, 0)


def _share(matches: _Matches, lines: dict[tuple[int, int], FloatArray], shown: int, as_if: int, t: int) -> float:
    """The share of an image's points on their lines, if `as_if` had taken it: the median over partners; NaN without."""
    here = matches.seen[shown] & (matches.placement == t)
    shares = []
    for j in range(len(matches.flat)):
        pair = (min(as_if, j), max(as_if, j))
        common = here & matches.seen[j]
        if j in (shown, as_if) or pair not in lines or common.sum() < LEAST_MATCHES:
            continue
        f = lines[pair] if as_if < j else lines[pair].T
        near = epipolar_distance(f, matches.flat[shown, common], matches.flat[j, common]) <= NEAR_PX
        shares.append(float(near.mean()))
    return float(np.median(shares)) if shares else float("nan")
