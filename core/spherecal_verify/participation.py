"""Which cameras of a rig a session has, what each saw of the marks, and image points without what lenses do more."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.errors import InputError, Words
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.observations import Observations
from spherecal.data.rig import Rig
from spherecal.data.rig_camera import RigCamera
from spherecal.data.session import Session
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


def cameras_in_rig(session: Session, observations: Observations, rig: Rig, advice: Words) -> IntArray:
    """Index in the rig of each camera (c,) that the observations name, -1 where the rig has none of that id."""
    for spec in session.cameras:
        placed = rig.camera(spec.id)
        if placed is not None and placed.image_size != spec.image_size:
            values = {"folder": session.where, "camera": spec.id, "width": spec.image_size[0]}
            values |= {"height": spec.image_size[1], "rig_width": placed.image_size[0]}
            values |= {"rig_height": placed.image_size[1]}
            raise InputError(Phrase("error-other-image-size", values), advice)
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    in_rig = np.array([index.get(camera, -1) for camera in observations.cameras], dtype=np.int64)
    if (in_rig < 0).all():
        raise InputError(Phrase("error-cameras-not-in-rig", {"folder": session.where}))
    return in_rig


def lens_corrected(
    cameras: Sequence[RigCamera], camera: IntArray, uv: FloatArray, sigma: FloatArray, noise: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Pixels (n,2) as the lens models predict them, and sigmas (n,2), in units of `noise` px, with the fields'."""
    if all(one.field is None for one in cameras):
        return uv, sigma
    uv, sigma = uv.copy(), np.array(np.broadcast_to(sigma, uv.shape))
    for c, one in enumerate(cameras):
        rows = np.flatnonzero(camera == c)
        if one.field is not None and len(rows):
            sigma[rows] = np.hypot(sigma[rows], one.field.sd_at(uv[rows])[:, None] / noise)
            uv[rows] -= one.field.at(uv[rows])
    return uv, sigma
