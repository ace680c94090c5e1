"""Cameras some frames late, mirrored, with u and v exchanged, or that number a board otherwise, before adjusting.

A lost frame stores each image one number early: two cameras then agree everywhere once shifted, and else nowhere.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.observations import Observations
from spherecal.diagnose.camera_findings import Flip, flipped

MOST_FRAMES = 3
# Two cameras in step agree within 1 px before any adjustment, with nominal lenses within 4 (bars); one frame late they
# differ by 20 to 900 px (the shared recording, hand-held boards). In slow films of 2 px a frame nothing is said.
AGREE_PX, BETTER = 5.0, 3.0
# Of a pair's frames so many must agree: some show a plane board's other pose, or are wrong for another reason.
SHARE = 0.8
PARTNERS, LEAST_FRAMES = 3, 4

# Error in px of two cameras' agreement, by how many frames the second is late at each frame (f,), and how its images
# are flipped, if they are; infinite where they have too little in common.
# Or by what (x, y in mm) its board's points are shifted.
Shift = tuple[float, float]
Compared = tuple[float, IntArray, Flip | Shift | None]


@dataclass(frozen=True)
class Link:
    """The pose of camera b in the frame of camera a: `x_b = rotation @ x_a + translation`; its weight as an edge."""

    rotation: FloatArray
    translation: FloatArray
    weight: float

    def back(self) -> "Link":
        """The pose of camera a in the frame of camera b."""
        return Link(self.rotation.T, -self.rotation.T @ self.translation, self.weight)


@dataclass(frozen=True)
class Lag:
    """A camera (index) that is `frames` (f,) frames behind another one, or flipped, or shifted."""

    camera: int
    partner: int
    frames: IntArray
    flip: Flip | Shift | None
    after_px: float


def find_lags(common: IntArray, compare: Callable[[int, int, bool], Compared]) -> list[Lag]:
    """The cameras that are out of step with most others, or the second one of two, by comparing their common frames."""
    n = len(common)
    shared = common - np.diag(common.diagonal())
    pairs = {
        (min(c, int(d)), max(c, int(d)))
        for c in range(n)
        for d in np.argsort(-shared[c], kind="stable")[:PARTNERS]
        if shared[c, d] > 0
    }
    as_is = {pair: compare(*pair, False)[0] for pair in sorted(pairs)}
    if not any(error > AGREE_PX for error in as_is.values()):
        return []
    shifted = {pair: compare(*pair, True) for pair, error in as_is.items() if error > AGREE_PX}
    late = {pair: found for pair, found in shifted.items() if found[0] < min(as_is[pair] / BETTER, AGREE_PX)}
    linked = np.zeros((n, n))
    for pair, error in as_is.items():
        linked[pair] = error <= AGREE_PX
    label = connected_components(csr_array(linked), directed=False)[1]
    group = (np.bincount(label) - np.arange(label.max() + 1) / n)[label]  # the larger is right, of equals the first
    lags: dict[int, Lag] = {}
    for (a, b), found in late.items():
        for partner, camera in ((a, b), (b, a)):
            if group[partner] > group[camera] and camera not in lags:
                after, frames, flip = found if camera == b else compare(partner, camera, True)
                lags[camera] = Lag(camera, partner, frames, flip, after)
    return list(lags.values())


def in_step(lags: list[Lag], camera: IntArray, frame: IntArray) -> tuple[IntArray, IntArray]:
    """Frames (k,) with those of late cameras put back, and which observations these are; others have no frame."""
    moved = frame.copy()
    for lag in lags:
        own = np.flatnonzero(camera == lag.camera)
        moved[own] = frame[own] - lag.frames[frame[own]]
    inside = np.flatnonzero((moved >= 0) & (moved < len(lags[0].frames)))
    return moved[inside], inside


def flipped_back(lags: list[Lag], camera: IntArray, uv: FloatArray, widths: IntArray) -> FloatArray:
    """The image points (n,2) px with those of flipped cameras put back. `widths` of the images (c,)."""
    uv = uv.copy()
    for lag in lags:
        if isinstance(lag.flip, str):
            uv[camera == lag.camera] = flipped(uv[camera == lag.camera], lag.flip, widths[lag.camera])
    return uv


def lag_findings(observations: Observations, lags: list[Lag], names: tuple[str, ...]) -> list[Finding]:
    """What was put back, camera by camera. `names` of the frames."""
    found = []
    for lag in lags:
        camera, partner = (observations.cameras[c] for c in (lag.camera, lag.partner))
        if isinstance(lag.flip, tuple):
            values = {"x_mm": -lag.flip[0], "y_mm": -lag.flip[1], "partner": partner}
            found.append(Finding("misnumbered", "error", values, (camera,)))
            continue
        if lag.flip is not None:
            kind = "axes" if lag.flip == "axes" else "camera"
            found.append(Finding("mirrored", "error", where=(camera,), kind=kind))
            continue
        number = int(lag.frames[-1])
        changed = np.flatnonzero(np.diff(lag.frames) != 0)
        by = Phrase("frames-late" if number > 0 else "frames-early", {"frames": abs(number)})
        values = {"camera": camera, "partner": partner, "by": by, "after_px": lag.after_px}
        if len(changed):
            place = names[int(changed[0]) + 1]
            found.append(
                Finding("camera-late", "warning", values | {"place": place}, (camera, partner, place), kind="from")
            )
        else:
            found.append(Finding("camera-late", "warning", values, (camera, partner), kind="throughout"))
    return found


def least_error(by_frame: dict[int, FloatArray], shifted: bool) -> Compared:
    """The best agreement of a pair from its errors (k,f) in px, for k relative poses and each lag of the second camera.

    By the second camera's frames; NaN where one is missing. `shifted`: with one lag, or with one from some frame on.
    """
    frames = next(iter(by_frame.values())).shape[1]
    nothing = np.zeros(frames, dtype=np.int64)
    if not shifted:
        return _quantile(by_frame[0]), nothing, None
    best: Compared = np.inf, nothing, None
    for lag in sorted(by_frame, key=abs):  # the larger, the fewer frames are left to contradict it
        if (error := _quantile(by_frame[lag])) < best[0]:
            best = error, np.full(frames, lag), None
        if best[0] <= AGREE_PX:
            return best
    for lag in sorted(by_frame, key=abs)[1:]:
        whole = []
        for first in range(2, frames - 2):  # a frame was lost before this one
            errors = np.concatenate([by_frame[0][:, :first], by_frame[lag][:, first:]], axis=1)
            known = ~np.isnan(errors)
            off = np.where(known, np.minimum(errors, 4 * AGREE_PX), 0.0).sum(axis=1) / known.sum(axis=1).clip(1)
            whole.append((float(off.min()), first, _quantile(errors)))
        _, first, error = min(whole, default=(np.inf, 0, np.inf))
        if error < best[0]:
            best = error, np.where(np.arange(frames) < first, 0, lag), None
        if best[0] <= AGREE_PX:
            return best
    return best


def _quantile(errors: FloatArray) -> float:
    """The error in px that most frames keep, with the best of some relative poses (k,f); infinite without any."""
    count = (~np.isnan(errors)).sum(axis=1)
    ordered = np.sort(errors, axis=1)[np.arange(len(errors)), np.maximum(np.ceil(SHARE * count).astype(int) - 1, 0)]
    return float(np.where(count >= LEAST_FRAMES, ordered, np.inf).min())


def lagged(frames: IntArray, lag: int, count: int) -> tuple[IntArray, IntArray]:
    """Frames of the first camera (k,) that a lag compares with some of the second one's (k,), of `count` in all."""
    before = frames - lag
    inside = (before >= 0) & (before < count)
    return before[inside], frames[inside]


def neighbours(points_mm: FloatArray) -> list[Shift]:
    """By what a board's points (p,3) may be numbered otherwise: one or two columns or rows, either way."""
    steps = [np.diff(np.unique(points_mm[:, i].round(3))) for i in (0, 1)]
    x, y = (float(step.min()) if len(step) else np.inf for step in steps)
    shifts = [(sign * n * a, sign * n * b) for n in (1, 2) for a, b in ((x, 0.0), (0.0, y)) for sign in (1, -1)]
    return [shift for shift in shifts if np.isfinite(shift).all()]
