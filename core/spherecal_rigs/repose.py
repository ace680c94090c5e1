"""Poses of cameras that moved, estimated with the others locked."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.rig import Calibration, CameraCovariance, Rig, RigCamera
from spherecal.data.session import Session
from spherecal.data.verdict import with_findings
from spherecal.detect.session_images import observed
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.resection import resect
from spherecal.geometry.rotation import log_rotation
from spherecal_rigs import recalibrate

# A pose leaves what noise leaves: residuals as at the calibration, and no larger than with new intrinsics besides. For
# a focal length 0.3 % longer, seen on a ball that is a quarter as deep as far, they are 2 to 4 times as large.
WORSE = 1.5
# Where new intrinsics alone fit as well as a pose, it was them if they changed by so much; knocks of up to 8 px are
# taken for turns, for regions of interest move by 8 px and more.
AS_WELL, REFOCUSED, REGION_PX = 1.05, 1e-3, 8.0
# A smaller change of focus that is so many of its standard deviations may have been it, or a move: 0.26 mm towards the
# ball at 1 m and 0.03 % (2.0 of them) are alike in one placement. Repaired as a move, lengths were 1.8 U off.
SIGNIFICANT = 1.9
# Another camera's pose: nearer to it than a quarter of the way.
NEARER = 0.25
# An image of another size shows its points through a lens that many times as long.
BINNED, BINNED_WITHIN, SHARE, WITHIN_PX = (0.5, 2.0, 1 / 3, 3.0, 0.25, 4.0), 0.05, 0.7, 6.0
_LEAST = 12


@dataclass(frozen=True)
class _Fit:
    """How well a camera's points fit: rms px of those that were used, their share of all, and its intrinsics."""

    rms_px: float
    share: float
    intrinsics: FloatArray

    def is_worse(self, other: "_Fit") -> bool:
        """Whether the residuals are larger than another fit's, or fewer points were used."""
        return self.rms_px > WORSE * other.rms_px or self.share < 0.9 * other.share


def refuse_unless_moved(
    session: Session, rig: Rig, cameras: tuple[str, ...], posed: Calibration, context: Context | None
) -> tuple[str, ...]:
    """Raise where more than these poses has changed; the cameras of which a change of focus explains as much."""
    either = []
    for name in cameras:
        if (other := _in_place_of(rig, name, posed.rig, cameras)) is not None:
            raise _refused(Phrase("error-repair-exchanged", {"camera": name, "other": other}))
    for name in cameras:
        before, fit = rig.camera(name), _fit(posed, name)
        if before is None:
            continue
        binned = None if fit is not None and fit.share > SHARE else _binned(posed, name, before)
        if binned is not None:
            raise _refused(Phrase("error-repair-binned", {"camera": name, "factor": binned}))
        if fit is None:
            raise _refused(Phrase("error-repair-unknown", {"camera": name}))
    whole = recalibrate.recalibrate(session, rig, recalibrate.Selection(cameras, "all"), None, context)
    lenses = recalibrate.recalibrate(session, rig, recalibrate.Selection(cameras, "intrinsics"), None, context)
    for name in cameras:
        before, by_pose, by_both, by_lens = rig.camera(name), *(_fit(one, name) for one in (posed, whole, lenses))
        if before is None or by_pose is None:
            continue
        usual = max(before.rms_px or 0.0, 1e-6)
        unlike = by_pose.rms_px > WORSE * usual or by_pose.share < SHARE
        if by_both is not None and unlike and by_pose.is_worse(by_both):
            raise _refused(_change(before, by_both) or Phrase("error-repair-lens", {"camera": name}))
        if by_lens is not None and by_lens.rms_px <= AS_WELL * by_pose.rms_px and by_lens.share >= 0.95 * by_pose.share:
            change = _change(before, by_lens)
            if change is not None:
                raise _refused(change)
            either.append(name)
    return tuple(name for name in either if _is_refocused(rig, lenses.rig, name))


def _is_refocused(before: Rig, now: Rig, name: str) -> bool:
    """Whether a camera's focal length, all else as before, has changed by more than it is uncertain."""
    one, other = before.camera(name), now.camera(name)
    if one is None or other is None or other.sigma is None:
        return False
    change = np.abs((other.intrinsics - one.intrinsics)[:2].mean())
    return bool(change > SIGNIFICANT * other.sigma.intrinsics[:2].mean())


def _refused(why: Phrase) -> InputError:
    return InputError(why, Phrase("error-repair-hint"))


def _change(before: RigCamera, now: _Fit) -> Phrase | None:
    """What has changed of a camera's image or focal length; None for neither."""
    ratio = float((now.intrinsics[:2] / before.intrinsics[:2]).mean())
    if any(abs(ratio / factor - 1) < BINNED_WITHIN for factor in BINNED):
        return Phrase("error-repair-binned", {"camera": before.id, "factor": 1 / ratio})
    shift = float(np.abs(now.intrinsics[2:4] - before.intrinsics[2:4]).max())
    focal = float(np.abs(now.intrinsics[:2] / before.intrinsics[:2] - 1).max())
    if shift >= REGION_PX and shift > focal * float(max(before.image_size)):
        return Phrase("error-repair-region", {"camera": before.id})
    return Phrase("error-repair-focus", {"camera": before.id}) if focal > REFOCUSED else None


def _fit(done: Calibration, name: str) -> _Fit | None:
    camera, o = done.rig.camera(name), done.observations
    own = o.camera == o.cameras.index(name)
    used = own & done.used
    if camera is None or used.sum() < _LEAST:
        return None
    rms = float(np.sqrt((done.residuals_px[used] ** 2).sum(axis=1).mean()))
    known = own & np.isfinite(done.points_mm[done.features.of_observation, 0])
    return _Fit(rms, float(used.sum() / max(known.sum(), 1)), camera.intrinsics)


def _in_place_of(rig: Rig, name: str, posed: Rig, cameras: tuple[str, ...]) -> str | None:
    """The camera of the rig whose place and direction another one now has."""
    before, after = rig.camera(name), posed.camera(name)
    # the frame moves with the reference camera: one that stayed, before and now, is what places are compared from
    both = ((c, posed.camera(c.id)) for c in rig.cameras if c.id not in cameras)
    stayed, now = next(((c, one) for c, one in both if one is not None), (None, None))
    if before is None or after is None or stayed is None or now is None:
        return None
    rotation = after.rotation @ now.rotation.T @ stayed.rotation
    centre_mm = stayed.centre_mm + stayed.rotation.T @ now.rotation @ (after.centre_mm - now.centre_mm)
    for other in rig.cameras:
        way, near = (np.linalg.norm(other.centre_mm - place) for place in (before.centre_mm, centre_mm))
        turn, alike = (np.linalg.norm(log_rotation(other.rotation @ r.T)) for r in (before.rotation, rotation))
        if other.id != name and near < NEARER * way and alike < NEARER * turn:
            return other.id
    return None


def _binned(done: Calibration, name: str, before: RigCamera) -> float | None:
    """The factor by which a camera's image is smaller or larger than it was, if that explains what it shows."""
    o = done.observations
    points = done.points_mm[done.features.of_observation]
    rows = np.flatnonzero((o.camera == o.cameras.index(name)) & np.isfinite(points[:, 0]))
    if len(rows) < _LEAST:
        return None
    for factor in BINNED:
        intrinsics = before.intrinsics.copy()
        intrinsics[:4] *= factor
        intrinsics[2:4] += (factor - 1) / 2  # pixel centres are at whole numbers
        xy, usable = undistort(o.uv[rows], intrinsics)
        pose = resect(points[rows][usable], xy[usable], WITHIN_PX / intrinsics[0])
        if pose is None:
            continue
        x = points[rows] @ pose[0].T + pose[1]
        with np.errstate(all="ignore"):
            off = np.linalg.norm(project(x, np.broadcast_to(intrinsics, (len(x), 16))) - o.uv[rows], axis=1)
        if ((off < WITHIN_PX) & (x[:, 2] > 0)).mean() > SHARE:
            return 1 / factor
    return None


# Lengths were 1.8 U off where a focus changed by 0.03 % was repaired as a move.
OR_FOCUS = 3.0


def repose(session: Session, rig: Rig, cameras: tuple[str, ...], context: Context | None = None) -> Calibration:
    """The rig with the poses of some cameras calibrated again; refused where a pose does not explain what changed.

    The others stay as they were, turned as one where the reference camera has moved; the mended ones' uncertainty holds
    that of those.
    """
    if not session.placements:
        raise InputError(Phrase("error-repair-needs-ball"))
    session = observed(session, context or Context())
    done = recalibrate.recalibrate(session, rig, recalibrate.Selection(cameras, "pose"), None, context)
    either = refuse_unless_moved(session, rig, cameras, done, context)
    if not done.rig.quality.valid or any(done.rig.camera(name) is None for name in cameras):
        return done
    missing = [c.id for c in rig.cameras if done.rig.camera(c.id) is None]
    if rig.reference_camera in cameras and missing:
        raise InputError(Phrase("error-reference-moved", {"camera": rig.reference_camera, "missing": missing}))
    merged = tuple(_merged(c, done.rig, rig.reference_camera in cameras, c.id in cameras) for c in rig.cameras)
    mended = replace(
        done.rig, cameras=merged, scale=rig.scale, covariance=None, length_map=None, earlier_poses=rig.earlier_poses,
        quality=recalibrate.without_map(done.rig.quality),
    )  # fmt: skip
    before = rig.covariance
    covariance = None if before is None else recalibrate.followed_covariance(session, mended, before, cameras, "pose")
    mended = replace(mended, covariance=None if covariance is None else _widened(covariance, rig, either))
    mended = replace(mended, cameras=tuple(recalibrate.with_sigma(mended, i, cameras) for i in range(len(merged))))
    done = replace(done, rig=replace(mended, length_map=recalibrate.map_as_before(mended, rig)))
    doubt = Finding("pose-unconfirmed", "warning", where=either, kind="or-focus")
    return with_findings(done, (doubt,) if either else ())


def _widened(covariance: CameraCovariance, rig: Rig, cameras: tuple[str, ...]) -> CameraCovariance:
    """The covariance with all that concerns some cameras so many times as uncertain."""
    by = np.array([OR_FOCUS if camera.id in cameras else 1.0 for camera in rig.cameras])
    times = np.repeat(by, len(covariance.matrix) // len(by))
    return replace(covariance, matrix=times[:, None] * covariance.matrix * times)


def _merged(before: RigCamera, done: Rig, all_turned: bool, mended: bool) -> RigCamera:
    after = done.camera(before.id)
    if after is None or not (all_turned or mended):
        return before
    kept = replace(before, rotation=after.rotation, translation_mm=after.translation_mm)
    return replace(kept, rms_px=after.rms_px, observations=after.observations) if mended else kept
