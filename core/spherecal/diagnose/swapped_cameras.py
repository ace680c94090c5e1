"""Cameras, or the axes of all images, exchanged throughout: no image says so, but their known intrinsics do."""

from itertools import combinations

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.data.findings import AdvisedRepair, Finding
from spherecal.diagnose.evidence import Evidence

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
