"""A board that moved between the images of one placement: told by what poses of their own do for single images.

Cameras that expose some 10 ms apart see a hand-held board in other places, each time otherwise. Each image alone fits
then, all of them together do not.
"""

from dataclasses import replace

import numpy as np

from spherecal.adjust.parameter_layout import POSE
from spherecal.data.findings import Finding
from spherecal.diagnose.moves import LEAST_POINTS
from spherecal_boards.frames_evidence import FrameEvidence

# Share of the variance that own poses take away, and the median F of these tests, on a rig of ten cameras: 0.84 and 87
# with a board that moved by 0.2 mm, 0.98 and 1000 by 1 mm; 0.53 and 10 with a beam that sagged, below 0.04 and 1 of a
# clean board, one that bends, or one camera that was knocked; 0.78 and 67, 0.79 and 98 of pixels skewed by 2 and 4 px.
LEAST_SHARE, LEAST_F = 0.8, 30.0
# What is explained by the board's motion, and would be blamed on single cameras.
INSTEAD = ("camera-moved", "cameras-moved", "camera-unsteady", "ball-moved", "recording-contradicts", "wrong-placement")


def moving_board(e: FrameEvidence, found: list[Finding]) -> list[Finding]:
    """The findings, with one on a board that moved instead of those that it explains."""
    if any(f.code in ("fixed-intrinsics-contradicted", "cameras-swapped", "image-repeated") for f in found):
        return found
    moving = _apart(e) or _between(e)
    if moving is None:
        return found
    wrong = any(f.code in INSTEAD for f in found)
    moving = replace(moving, severity="error") if wrong else moving
    return [moving, *(f for f in found if f.code not in INSTEAD)]


def _between(e: FrameEvidence) -> Finding | None:
    """The finding on images that each fit alone and do not fit together."""
    probe = e.probe
    if probe is None or e.placed.sum() < 2:
        return None
    by_pose, residual, rows = probe.by_pose(), probe.residual.reshape(-1, 2), e.adjusted.rows
    image = np.unique(np.stack([e.observations.placement, e.observations.camera])[:, rows], axis=1, return_inverse=True)
    tested = []
    label = image[1].reshape(-1)
    order = np.argsort(label, kind="stable")
    for own in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        if len(own) >= LEAST_POINTS:
            x, y = by_pose[own].reshape(-1, POSE), residual[own].reshape(-1)
            rest = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
            tested.append((y @ y / len(y), rest @ rest / (len(y) - POSE), len(y)))
    if not tested:
        return None
    before, after, count = np.array(tested).T
    share = 1 - after.sum() / before.sum()
    f = ((before - after) * count / POSE + after) / after
    if share < LEAST_SHARE or np.median(f) < LEAST_F:
        return None
    o, state, used = e.observations, e.solution.state, e.used
    camera, points = o.camera[used], state.points[e.features.of_observation[used]]
    depth = np.einsum("nj,nj->n", state.rotation[camera, 2], points) + state.translation[camera, 2]
    size_px = np.sqrt((2 * (before - after)).mean())
    size_mm = float(size_px * np.nanmedian(depth / state.intrinsics[camera, 0]))
    return Finding("board-moving", "warning", {"size_mm": size_mm, "size_px": float(size_px)}, kind="between")


def _apart(e: FrameEvidence) -> Finding | None:
    """The finding on placements of which most have no two cameras that agree."""
    seen, kept = e.image_counts(e.candidates), e.image_counts(e.used)
    shared = (seen >= LEAST_POINTS).sum(axis=1) >= 2
    agree = ((seen >= LEAST_POINTS) & (2 * kept > seen)).sum(axis=1) >= 2
    count, of = int((shared & ~agree).sum()), int(shared.sum())
    return Finding("board-moving", "error", {"count": count, "of": of}, kind="apart") if 2 * count > of else None
