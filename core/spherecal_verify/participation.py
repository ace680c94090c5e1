"""Which cameras a verification has verified: how many views of marks each had, how many were used, how they fit."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherecal.data.findings import Finding
from spherecal.data.rig import Rig
from spherecal_verify.outlying_views import CheckedPoints

State = Literal["verified", "not seen", "rejected"]

# A camera most of whose views contradict the others has another pose: a stale one lost all views of 13 poses. Good ones
# lose one view in 25 000 (outlying_views.py), with wrong codes a few in a hundred.
MOSTLY, LEAST_VIEWS = 0.5, 2
# Views that the gate let pass, since all are as far off: 176 px where every camera had another's name. Cameras of a rig
# that fits are below 1 px, knocked ones below 5.
LOST_PX = 10.0
# Single outlying views beyond this share of all, or of one camera's, cast doubt.
MANY_VIEWS, MANY_OF_ONE = 0.02, 0.2


@dataclass(frozen=True)
class CameraViews:
    """One camera: views of marks seen and used, the rms of the used ones' residuals in px (None without), its state."""

    id: str
    seen: int
    used: int
    rms_px: float | None
    state: State


def participation(checked: CheckedPoints, rig: Rig) -> tuple[CameraViews, ...]:
    """What each camera of the rig saw of the marks together with another, and how much of it was used, in its order."""
    views = checked.views
    usable = (np.bincount(views.feature, minlength=views.n_features) >= 2)[views.feature]
    cameras = []
    for i, camera in enumerate(rig.cameras):
        own = usable & (views.camera == i)
        used = own & checked.kept
        size = np.linalg.norm(checked.points.residual[used], axis=1)
        seen, n = int(own.sum()), int(used.sum())
        rejected = seen >= LEAST_VIEWS and seen - n > MOSTLY * seen
        state: State = "rejected" if rejected else "verified" if n else "not seen"
        cameras.append(CameraViews(camera.id, seen, n, float(np.sqrt((size**2).mean())) if n else None, state))
    return tuple(cameras)


def participation_doubts(cameras: Sequence[CameraViews]) -> list[Finding]:
    """Findings on cameras that were not verified, or that contradict the others."""
    found = []
    rejected = [c for c in cameras if c.state == "rejected"]
    unseen = [c.id for c in cameras if c.state == "not seen"]
    for camera in rejected:
        values = {"out": camera.seen - camera.used, "views": camera.seen}
        found.append(Finding("camera-contradicts", "error", values, (camera.id,), kind="views"))
    lost = [c for c in cameras if c.state == "verified" and (c.rms_px or 0.0) > LOST_PX]
    if lost:
        worst = max(lost, key=lambda c: c.rms_px or 0.0)
        values = {"worst_px": worst.rms_px, "worst": worst.id}
        found.append(Finding("camera-contradicts", "error", values, tuple(c.id for c in lost), kind="lost"))
    if unseen:
        found.append(Finding("camera-not-verified", "warning", where=tuple(unseen)))
    return found


def many_outlying(cameras: Sequence[CameraViews]) -> bool:
    """Whether more views were left out than a few wrong codes explain."""
    cameras = [c for c in cameras if c.state != "rejected"]  # those have a finding of their own
    seen, used = sum(c.seen for c in cameras), sum(c.used for c in cameras)
    most = max((c.seen - c.used for c in cameras if c.seen - c.used > MANY_OF_ONE * c.seen), default=0)
    return seen - used > max(1, MANY_VIEWS * seen) or most >= LEAST_VIEWS
