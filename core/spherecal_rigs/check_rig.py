"""Whether a rig is still as it was calibrated: cameras, the ball, bars."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal.base.threads import on_one_blas_thread
from spherecal.data.findings import Finding
from spherecal.data.observations import Features, Observations, find_features
from spherecal.data.rig import Rig
from spherecal.data.session import Session
from spherecal.detect.session_images import observed
from spherecal.geometry.transform import Similarity, fit_similarity
from spherecal_files.findings_file import FINDING
from spherecal_files.json_file import finite, plain, plain_fields, software_entry
from spherecal_files.write_result import POINT_COLUMNS
from spherecal_rigs.kept_checks import keep_check
from spherecal_rigs.result_folder import read_csv
from spherecal_rigs.store import is_profile, open_profile
from spherecal_verify.consistency import CameraTest, Consistency, examine_cameras, noise_alone
from spherecal_verify.limit import LengthLimit
from spherecal_verify.outlying_views import triangulate_checked
from spherecal_verify.participation import cameras_in_rig
from spherecal_verify.uncertainty import PointErrors, calibration_variance, point_errors
from spherecal_verify.verification import MeasuredLength
from spherecal_verify.verify_bars import VerifySettings, verify, views_of

LEAST_DOTS = 12
# A sticker that was replaced is off by millimetres, the reconstruction by hundredths.
_GATE_SIGMAS, _ROUNDS = 4.5, 3


@dataclass(frozen=True, eq=False, repr=False)
class BallDots(ByValue):
    """The dots of the calibration: by placement a table from (target, point name) to the place (3,) in mm."""

    placements: dict[str, dict[tuple[int, str], FloatArray]]


@dataclass(frozen=True)
class BallCheck:
    """Dots in common, size against the calibration (ppm) with its sd, shape left after it, dots that moved."""

    placement: str
    dots: int
    scale_ppm: float
    scale_sd_ppm: float
    shape_rms_mm: float
    changed: int

    @property
    def differs(self) -> bool:
        """Whether the size differs by more than chance (3.5 standard deviations, once in 2000)."""
        return abs(self.scale_ppm) > 3.5 * self.scale_sd_ppm


def read_known_ball(path: Path) -> BallDots | None:
    """The ball's dots from a points.csv; None if there is no such file."""
    if not path.is_file():
        return None
    table = read_csv(path, POINT_COLUMNS)
    places = np.column_stack([table.numbers(f"{axis}_mm") for axis in "xyz"])
    found: dict[str, dict[tuple[int, str], FloatArray]] = {}
    keys = zip(table.names("placement"), table.whole_numbers("target").tolist(), table.names("point"), strict=True)
    for (placement, target, point), place in zip(keys, places, strict=True):
        found.setdefault(placement, {})[target, point] = place
    return BallDots(found)


def check_ball(
    known: BallDots, placement: int, o: Observations, features: Features, errors: PointErrors
) -> BallCheck | None:
    """The ball at a placement against the calibration's that shares most dots; None below 12 in common or in place."""
    checked = errors.checked
    usable = np.isfinite(checked.points.points[:, 0]) & checked.points.in_front & ~checked.contradicting
    rows = np.flatnonzero(usable & (features.placement == placement))
    names = [(int(features.target[i]), o.points[features.point[i]]) for i in rows]
    best: dict[tuple[int, str], FloatArray] = max(
        known.placements.values(), key=lambda dots: sum(name in dots for name in names), default={}
    )
    common = [k for k, name in enumerate(names) if name in best]
    if len(common) < LEAST_DOTS:
        return None
    rows = rows[common]
    before = np.array([best[names[k]] for k in common])
    now = checked.points.points[rows]
    noise = np.sqrt(np.trace(errors.covariance[rows], axis1=1, axis2=2) / 3)
    keep = np.ones(len(rows), dtype=bool)
    fit, rest, ratio = _fit(before, now, noise, keep)
    for _ in range(_ROUNDS):
        keep = rest <= _GATE_SIGMAS * ratio * noise
        if keep.sum() < LEAST_DOTS:
            return None
        fit, rest, ratio = _fit(before, now, noise, keep)
    sd = _scale_sd(rows[keep], now[keep], errors, ratio)
    return BallCheck(
        o.placements[placement], int(keep.sum()), 1e6 * (fit.scale - 1), 1e6 * sd,
        float(np.sqrt((rest[keep] ** 2).mean())), int((~keep).sum()),
    )  # fmt: skip


def _fit(
    before: FloatArray, now: FloatArray, noise: FloatArray, keep: BoolArray
) -> tuple[Similarity, FloatArray, float]:
    """The similarity, the residual of each dot (n,) mm, and the scatter in units of the noise, at least 1."""
    fit = fit_similarity(before[keep], now[keep])
    rest = np.linalg.norm(now - (fit.scale * before @ fit.rotation.T + fit.translation), axis=1)
    return fit, rest, max(float(np.median(rest / noise)) / 1.538, 1.0)  # the median of a chi of three degrees


def _scale_sd(rows: IntArray, now: FloatArray, errors: PointErrors, ratio: float) -> float:
    """The size's standard uncertainty: noise of both measurements, and the cameras' covariance where not in common."""
    centred = now - now.mean(axis=0)
    by_point = centred / (centred**2).sum()  # d(scale) = sum of by_point . dx
    noise = float(np.einsum("ki,kij,kj->", by_point, errors.covariance[rows], by_point))
    return float(np.sqrt(2 * ratio**2 * noise + calibration_variance(rows, by_point, errors)))


Verdict = Literal["ok", "watch", "recalibrate"]
_ORDER: tuple[Verdict, ...] = ("ok", "watch", "recalibrate")
STATED_MM = 500.0
# Without a map of the rig's uncertainty: twice the noise of a good image point.
_NO_MAP_PX = 0.1
# A lens out of focus or dirty doubles a camera's residuals before it is seen by eye.
_NOISIER = 2.0
_LEAST_FOR_NOISE = 30
# A bar's single length: once in 2000 by chance.
_BAR_SIGMAS = 3.5
_LEAST_CAMERAS = 3
# A small move is computed; beyond this it is a number without meaning (941326252 deg of two cameras exchanged).
MOST_TURNED_DEG = 30.0


@dataclass(frozen=True)
class CheckedCamera:
    """One camera: its test, its verdict, its residuals at the calibration (rms px, None where unknown), and why."""

    test: CameraTest
    verdict: Verdict
    before_px: float | None
    reason: Phrase | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Check(ByValue):
    """A check: verdict, cameras worst first, those not seen, balls, bars, findings; a move's tolerance in mm."""

    verdict: Verdict
    tolerance_mm: float | None
    cameras: tuple[CheckedCamera, ...]
    untested: tuple[str, ...]
    balls: tuple[BallCheck, ...]
    lengths: tuple[MeasuredLength, ...]
    findings: tuple[Finding, ...]

    def __repr__(self) -> str:
        return f"<Check: {self.verdict}; {self.sentence}>"

    @property
    def sentence(self) -> str:
        """The verdict's reasons in one sentence, in English, as files have it."""
        return self.words("en")

    def words(self, language: str) -> str:
        """The verdict's reasons in one sentence, in a language of the catalogue."""
        if self.verdict == "ok":
            agree = Phrase("check-agree", {"cameras": len(self.cameras)})
            return phrase(agree if self.cameras else Phrase("check-bars-alone"), language)
        severity = "error" if self.verdict == "recalibrate" else "warning"
        causes = [camera_cause(one) for one in self.cameras if one.verdict == self.verdict]
        said = [f.words("message", language).rstrip(".。") for f in self.findings if f.severity == severity]
        return phrase(Phrase("sentence", {"text": Phrase("check-causes", {"causes": (*causes, *said)})}), language)

    @property
    def to_repair(self) -> tuple[str, ...]:
        """The cameras that moved."""
        return tuple(camera.test.id for camera in self.cameras if camera.test.moved)


@on_one_blas_thread
def check(
    session: Session,
    rig: Rig,
    known: BallDots | None = None,
    limit: LengthLimit | None = None,
    context: Context | None = None,
) -> Check:
    """Whether the rig is still as calibrated, by all data of the session (docs/verification.md)."""
    context = context or Context()
    session = observed(session, context)
    context.report("check", 0.0, Phrase("comparing"))
    o = session.observations
    assert o is not None
    in_rig = cameras_in_rig(session, o, rig, Phrase("same-settings"))
    for spec in session.cameras:
        placed = rig.camera(spec.id)
        if placed is not None and placed.serial and spec.serial and placed.serial != spec.serial:
            values = {"folder": session.where, "camera": spec.id, "serial": spec.serial, "rig_serial": placed.serial}
            raise InputError(Phrase("error-other-serial", values))
    own = o.select(in_rig[o.camera] >= 0)
    camera = in_rig[own.camera]
    features = find_features(own)
    views, expected = views_of(own, features, camera, rig)
    consistency = examine_cameras(views, rig, expected)
    lengths, findings = _measure_bars(session, rig, limit, context)
    if len(consistency.cameras) < _LEAST_CAMERAS and not lengths:
        raise InputError(Phrase("error-too-little-seen", {"folder": str(session.where)}), Phrase("error-show-more"))
    context.report("check", 0.5, Phrase("measuring"))
    balls = [] if known is None else _check_balls(session, rig, known, own, camera, consistency)
    if known is not None and not balls and not lengths:
        findings = (*findings, Finding("ball-not-known", "info"))
    tolerance = None if rig.length_map is None else rig.length_map.typical_mm
    cameras = [camera_state(test, rig, tolerance) for test in consistency.cameras]
    cameras.sort(key=lambda one: (-_ORDER.index(one.verdict), -one.test.point_mm))
    found = [*_of_the_rig(rig, consistency), *findings, *_scale_findings(balls, lengths, limit, tolerance)]
    by_severity: dict[str, Verdict] = {"error": "recalibrate", "warning": "watch", "info": "ok"}
    words = [*(one.verdict for one in cameras), *(by_severity[f.severity] for f in found)]
    worst = _ORDER[max((_ORDER.index(word) for word in words), default=0)]
    return Check(worst, tolerance, tuple(cameras), consistency.untested, tuple(balls), lengths, tuple(found))


def _check_balls(
    session: Session, rig: Rig, known: BallDots, own: Observations, camera: IntArray, consistency: Consistency
) -> list[BallCheck]:
    """The ball at each placement by cameras that have not moved: 9 px of one made it 720 ppm larger (demo rig)."""
    moved = [test.id for test in consistency.moved]
    stays = ~np.isin(np.array([c.id for c in rig.cameras])[camera], moved)
    own, camera = own.select(stays), camera[stays]
    if not len(own):
        return []
    features = find_features(own)
    views, expected = views_of(own, features, camera, rig)
    checked = triangulate_checked(views, expected)
    errors = point_errors(replace(checked, noise=noise_alone(checked, rig)), rig)
    at = [own.placements.index(p.id) for p in session.placements]
    balls = [check_ball(known, p, own, features, errors) for p in at]
    return [ball for ball in balls if ball is not None]


def _measure_bars(
    session: Session, rig: Rig, limit: LengthLimit | None, context: Context
) -> tuple[tuple[MeasuredLength, ...], tuple[Finding, ...]]:
    """All bars' lengths, also of the one that gave the scale: here it only shows whether the scale has changed."""
    if not session.bar_poses:
        return (), ()
    if rig.scale.source == "none":  # they were half a metre off, and the answer was to recalibrate
        return (), (Finding("no-scale", "info", kind="rig"),)
    asked = replace(session, bars=tuple(replace(bar, role="check") for bar in session.bars))
    done = verify(asked, rig, context, VerifySettings(limit))
    spoken = ("certificate-expired", "no-temperature", "mark-not-found", "outlying-views", "temperatures-differ",
              "camera-contradicts", "bar-assumed", "length-without-uncertainty")  # fmt: skip
    return done.measured, tuple(f for f in done.findings if f.code in spoken)


def _of_the_rig(rig: Rig, consistency: Consistency) -> list[Finding]:
    """Findings that exclude an OK: the calibration is not valid, cameras contradict all others or were not checked."""
    found = []
    if not rig.quality.valid:
        found.append(Finding("rig-not-valid", "error", kind="check"))
    if consistency.rejected:
        found.append(Finding("camera-contradicts", "error", where=consistency.rejected, kind="check"))
    rest = tuple(name for name in consistency.untested if name not in consistency.rejected)
    if rest:
        found.append(Finding("camera-not-checked", "warning", where=rest))
    return found


def camera_state(test: CameraTest, rig: Rig, tolerance_mm: float | None) -> CheckedCamera:
    """A camera's verdict, with the reason: moved by more than the tolerance, or residuals doubled."""
    placed = rig.camera(test.id)
    before = placed.rms_px if placed is not None else None
    if test.moved:
        large = test.move_px > _NO_MAP_PX if tolerance_mm is None else test.point_mm > tolerance_mm
        values = {
            "shift_mm": float(np.linalg.norm(test.shift_mm)),
            "rotation_deg": float(np.degrees(np.linalg.norm(test.turn_rad))),
            "move_px": test.move_px,
        }
        far = values["rotation_deg"] > MOST_TURNED_DEG or not np.isfinite(values["shift_mm"])
        reason = Phrase("check-elsewhere" if far else "check-moved", values)
        return CheckedCamera(test, "recalibrate" if large else "watch", before, reason)
    if before and test.points >= _LEAST_FOR_NOISE and test.rms_px > _NOISIER * before:
        reason = Phrase("check-noisier", {"ratio": test.rms_px / before})
        return CheckedCamera(test, "watch", before, reason)
    return CheckedCamera(test, "ok", before)


def _scale_findings(
    balls: Sequence[BallCheck], lengths: Sequence[MeasuredLength], limit: LengthLimit | None, tolerance_mm: float | None
) -> list[Finding]:
    found = []
    for ball in balls:
        effect = STATED_MM * abs(ball.scale_ppm) * 1e-6
        if ball.differs:
            large = tolerance_mm is not None and effect > tolerance_mm
            values = {"larger_ppm": ball.scale_ppm, "sd_ppm": ball.scale_sd_ppm, "effect_mm": effect}
            found.append(Finding("ball-size", "error" if large else "warning", values, (ball.placement,)))
        if ball.changed > 0.2 * ball.dots:
            values = {"changed": ball.changed, "dots": ball.changed + ball.dots}
            found.append(Finding("ball-changed", "warning", values, (ball.placement,)))
    beyond = [m for m in lengths if m.certified and abs(m.error_mm) > _bar_limit(m, limit)]
    if beyond:
        worst = max(beyond, key=lambda m: abs(m.error_mm) / _bar_limit(m, limit))
        values = {
            "beyond": len(beyond),
            "lengths": len(lengths),
            "edge": Phrase("beyond-limit" if limit else "beyond-uncertainty"),
            "bar": worst.bar,
            "first": worst.from_mark,
            "second": worst.to_mark,
            "error_mm": worst.error_mm,
        }
        where = tuple(dict.fromkeys(m.pose for m in beyond))
        found.append(Finding("bar-length", "error", values, where))
    return found


def _bar_limit(m: MeasuredLength, limit: LengthLimit | None) -> float:
    return _BAR_SIGMAS * m.budget.combined_mm if limit is None else limit.at(m.reference_mm)


def camera_cause(one: CheckedCamera) -> Phrase:
    """Which camera, and why it is to be watched or recalibrated."""
    return Phrase("check-camera", {"camera": one.test.id, "reason": one.reason})


FORMAT = "spherecal/check"
VERSION = 1


def check_json(found: Check) -> dict[str, object]:
    """The document; lengths in mm, turns in degrees."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "tolerance_mm": finite(found.tolerance_mm),
        "cameras": [camera_entry(one) for one in found.cameras],
        "untested": list(found.untested),
        "balls": plain(found.balls),
        "lengths": [
            {
                **plain_fields(m, "bar pose"),
                "from": m.from_mark,
                "to": m.to_mark,
                **plain_fields(m, "length_mm reference_mm error_mm"),
                "u_mm": finite(m.budget.combined_mm),
            }
            for m in found.lengths
        ],
        "findings": [FINDING.entry(finding) for finding in found.findings],
        "software": software_entry(None),
    }


def camera_entry(one: CheckedCamera) -> dict[str, object]:
    """One camera as the document has it."""
    return {
        "id": one.test.id,
        "verdict": one.verdict,
        "points": one.test.points,
        "rms_px": finite(one.test.rms_px),
        "calibrated_rms_px": finite(one.before_px),
        "moved": one.test.moved,
        "move_px": finite(one.test.move_px),
        "shift_mm": finite(np.linalg.norm(one.test.shift_mm)),
        "turn_deg": finite(np.degrees(np.linalg.norm(one.test.turn_rad))),
        "point_mm": finite(one.test.point_mm),
        "probability": finite(one.test.p),
        "reason": "" if one.reason is None else phrase(one.reason),
    }


def keep(profile: Path, check: Mapping[str, object], temperature_c: float | None = None) -> bool:
    """Keep a check in the profile that it was made against; False for no profile, or none in use."""
    active = open_profile(profile).active_id if profile.is_dir() and is_profile(profile) else None
    if active is None:
        return False
    keep_check(profile, active, check, temperature_c)
    return True
