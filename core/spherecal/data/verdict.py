"""What a calibration's findings make of it: VALID, USE WITH CARE or NOT VALID. The one table of it.

VALID: the stated uncertainties cover the errors. USE WITH CARE: they do too, widened where that is needed, but a
camera, the scale or a part of the volume is worse than it could be. NOT VALID: they do not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.data.findings import Finding, Findings, Severity
from spherecal.data.rig import Affected, Calibration

Effect = Literal["information", "care", "not-valid"]
Concerns = Literal["", "cameras", "scale", "volume"]


@dataclass(frozen=True)
class Rule:
    """What a finding means whose test has failed (severity warning): its effect, and on what.

    `widen`: by how much standard uncertainties of the cameras concerned grow in the free, soft and rigid form. `poses`:
    how much more those of single poses do, whose errors make up for each other in lengths.
    """

    effect: Effect
    concerns: Concerns = ""
    widen: tuple[float, float, float] = (1.0, 1.0, 1.0)
    poses: float = 1.0


_INFORMATION, _NOT_VALID = Rule("information"), Rule("not-valid")
# Of calibrations; findings of verify, check and cameras keep the severity that they are made with.
# A finding that its test calls "info" is information, one that it calls "error" makes the result not valid; between
# them, "warning", the table decides. Above each row is the measurement behind it. "Stated": the stated uncertainty as
# it is covers it.
RULES: dict[str, Rule] = {
    # --- nothing, or not the whole rig, was calibrated ---
    # There is no rig.
    "nothing-reconstructed": _NOT_VALID,
    # Cameras are missing or in frames of their own.
    "cameras-unlinked": _NOT_VALID,
    # No minimum: 4 to 14 px on a hall that stuck (numerics, section 1).
    "not-converged": _NOT_VALID,
    # No uncertainty can be stated, or none to first order: over a tenth.
    "degenerate-geometry": _NOT_VALID,
    # Not a real solution.
    "behind-camera": _NOT_VALID,
    # Cameras are missing: two poses fit alike, and one of them is wrong.
    "pose-ambiguous": _NOT_VALID,
    # Which of two focal lengths the cameras have now is not estimated.
    "focus-changed": _NOT_VALID,
    # A column off, a camera was 247 mm and 9.5 degrees off; what was put back is a guess.
    "misnumbered": _NOT_VALID,
    # All lengths right, all places mirrored.
    "mirrored": _NOT_VALID,
    # Its tests have not been made.
    "stopped-early": _NOT_VALID,
    # For comparison: no uncertainty, and no test, is known.
    "no-joint-adjustment": _NOT_VALID,
    # --- the recording is wrong somewhere, and was not repaired ---
    # Named from chi-square 30 on 6 degrees: the two poses are 5 standard deviations apart. A move of 30, 3, 0.3
    # mm left the camera 108, 17, 1.7 mm off at sigmas of 5.9, 1.4, 0.14 mm (ten-camera rig). By less than a sixth
    # of what lengths are uncertain by: stated, and information.
    "camera-moved": _NOT_VALID,
    # As camera-moved: a beam that sagged by 2 mm left rig B 2 mm off, 23 times U.
    "cameras-moved": _NOT_VALID,
    # The ball displaced by 0.05 mm for one late camera: it is 0.2 mm off, 15 times U. Less: as camera-moved.
    "camera-unsteady": _NOT_VALID,
    # By 0.05 mm between two trigger groups: 4 times U, with all that lens-misfit adds.
    "ball-moved": _NOT_VALID,
    # A stale image left its camera 373 to 1128 mm off in nine cases.
    "wrong-placement": _NOT_VALID,
    # As wrong-placement; reported before anything is computed.
    "image-repeated": _NOT_VALID,
    # Another region, size or camera: its lens and pose are not those before.
    "image-settings": _NOT_VALID,
    # Most of an image contradicts the rest: as camera-moved, size unknown.
    "image-contradicts": _NOT_VALID,
    # As image-contradicts; a camera keeps 96 to 100 % on clean rigs.
    "images-rejected": _NOT_VALID,
    # Widened by lens-misfit and by what parts disagree; not valid where a camera or an image would be blamed.
    # Moved by 0.2 and 1 mm between exposures: errors of lengths within U, of cameras too.
    "board-moving": Rule("care", "cameras", (10.0, 3.0, 2.0), 3.0),
    # Each camera has the other's pose: as far off as the two are apart.
    "cameras-swapped": _NOT_VALID,
    # As if the ball had changed by over 1 mm: no ball does.
    "placements-contradict": _NOT_VALID,
    # Four copies of one placement: lengths 5.4 mm off at U = 1.7 mm.
    "placements-repeated": _NOT_VALID,
    # Over 5 % outliers: no study has measured what is left (outliers.md).
    "outliers-removed": _NOT_VALID,
    # Ball moved by 1 mm between exposures: cameras 12 to 36 mm off at sigmas of 1 to 2 mm; five cameras sagged by
    # 2 mm: 16 mm. Neither lens, ball nor a camera explains it.
    "recording-contradicts": _NOT_VALID,
    # Thirty points a camera, 9 times the stated noise: a wrong minimum, 543 mm off.
    "fits-badly": _NOT_VALID,
    # Stated: widened by what other intrinsics would change; not valid where lengths change by more than U. Data-
    # sheet values 1.5 % off: lengths 3.8 to 11.8 mm, U 0.5.
    "fixed-intrinsics-contradicted": Rule("care", "cameras"),
    # --- millimetres that are not ---
    # A certificate 480 for 400 mm: all lengths 20 % off, U(500) 0.05 mm.
    "scale-conflict": _NOT_VALID,
    # Print and ball agree against the bar. From 0.5 % on not valid: certificates mistyped by 0.2 to 7 mm on 800
    # mm left lengths 3.7 to 132 U off.
    "scale-sources": Rule("care", "scale"),
    # Odd poses are left out; not valid where the rest is no majority that agrees. A mark that shifted by 0.2 to 3
    # mm in some of six poses: lengths up to 8.6 U off; by 0.5 mm from a frame of a waved bar on: 4.5 U.
    "bar-poses-disagree": Rule("care", "scale"),
    # 70 or 120 typed in Fahrenheit: lengths 8 to 17 U off.
    "bar-temperature": _NOT_VALID,
    # As scale-conflict.
    "ball-profile-scale": _NOT_VALID,
    # A pitch in metres: cameras 0.37 mm apart, all lengths 1000 times too short.
    "size-implausible": _NOT_VALID,
    # 14.0 typed for 28.28 mm: all lengths 50 % off.
    "target-distance": _NOT_VALID,
    # 0.5 to 2 % off: printers err by 0.1 to 0.5 %; the scale's uncertainty then covers the difference. Over 2 %,
    # and 1.5 U of lengths: not valid (stickers printed at 97 %: 15 mm on 500).
    "ball-diameter": Rule("care", "scale"),
    # Shapes are right, lengths arbitrary.
    "no-scale": Rule("care", "scale"),
    # Stated: 0.3 %. Printed 0.5 % too large: lengths 68 times U off where it was not.
    "print-unmeasured": Rule("care", "scale"),
    # A board 0.1 % larger than stated makes all lengths so.
    "board-shape": Rule("care", "scale"),
    # --- one lens, camera or part of the volume is worse than the others ---
    # A field of 0.03 to 0.1 px grew errors of bars 1.3 to 1.9 times beyond what sigma0 says in the rigid form,
    # 4.6 to 9.7 times in the free one (numerics, section 2, rigs A and B). A ball that moved by 0.05 and 0.2 mm
    # between exposures: errors of bars 0.5 to 0.8 of twice the stated, of cameras up to 10 times.
    "lens-misfit": Rule("care", "cameras", (10.0, 3.0, 2.0), 3.0),
    # The rigid form held against the data: errors grew 2.8 to 5.6 times beyond what sigma0 says; the soft one 2.6
    # times (numerics, section 2). Pixels skewed by 2 px, taken for a bent ball: lengths 5.7 times U off in the
    # free form, 11 times in the soft one. Flattened by its weight by 0.3 mm: lengths 14 to 17 times U, cameras 36
    # times (rig B, random). Skewed by 8 px: 5.3 times, after a widening of 2.
    "ball-shape-changed": Rule("care", "cameras", (4.0, 4.0, 5.0), 3.0),
    # Held near the nominal values: as good as these. Where three lenses of the rig are estimated, they say how
    # good these are: stated, and information.
    "intrinsics-held": Rule("care", "cameras"),
    # Of another moment; if the ball has moved since, wrong-placement says so.
    "capture-times": Rule("care", "cameras"),
    # Stated: lengths 120 to 1600 um instead of 50. But hardly any test has power.
    "few-placements": Rule("care", "cameras"),
    # Knocked for one image by 30 mm and back again, at the last that it had: 30 mm off, 323 times U. Late by 0.05
    # mm at each placement, and split as moved: 5.1 times U. Binned from its last image on, of 4 dots: all its
    # lengths wrong.
    "pose-unconfirmed": Rule("care", "cameras"),
    # Put back: with 24 placements, one camera 1 to 3 behind, errors were those of clean recordings.
    "camera-late": Rule("care", "cameras"),
    # Stated, as few-placements.
    "few-frames": Rule("care", "cameras"),
    # Stated, but one wrong camera turns half of the rig unseen.
    "linked-by-a-thread": Rule("care", "cameras"),
    # The session says what is wanted; the map of lengths what is reached.
    "accuracy-missed": Rule("care", "volume"),
    # --- information: the result is as good as it says ---
    # Stated: the free form's uncertainties hold whatever the ball does.
    "form-free": _INFORMATION,
    # Stated: studies/shape.md.
    "form-soft": _INFORMATION,
    # Put back where the names before and after are the same: right in every case.
    "swapped-back": _INFORMATION,
    # Stated by its weight: bars 48 to 50 um with a blurred camera, 46 without.
    "camera-noisy": _INFORMATION,
    # Stated: focal lengths over 1000 ppm; 60 to 420 on usual rigs.
    "weak-self-calibration": _INFORMATION,
    # Stated: the estimate counts, however far off the start value was.
    "prior-focal-length": _INFORMATION,
    # Stated: twice as uncertain outside (numerics, section 7).
    "placements-clustered": _INFORMATION,
    # Stated: three times as uncertain at the sides (numerics, section 7).
    "placements-stacked": _INFORMATION,
    # Stated, widened. Lenses beyond their model: lengths of 40 realistic recordings 99 % within U, at most 1.33.
    "rigid-form-misfit": Rule("information", "cameras", (2.0, 4.0, 5.0), 3.0),
    # Stated: 61 % of rig B's points; errors 0.96 to 1.08 of the stated.
    "two-view-points": _INFORMATION,
    # Stated: normalised errors 0.96 to 1.08, small balls included.
    "little-coverage": _INFORMATION,
    # Stated: fields are unknowns of the adjustment (studies/misfit.md).
    "lens-field": _INFORMATION,
    # Of most cameras: a ball that rolled by 0.05 degrees between exposures left a camera 4.0 U off. Of some:
    # stated by turns of images that are unknowns, and information.
    "camera-drifts": Rule("care", "cameras", poses=3.0),
    # Every calibration has it.
    "scale-uncertainty": _INFORMATION,
    # Left out: bars 40 um with 5 % wrong matches, 42 without.
    "target-contradicts": _INFORMATION,
    # Stated: widened by as much as the images' poses scatter.
    "poses-scatter": _INFORMATION,
    # Stated: widened by what it did to the cameras. Over 0.1 %: 0.5 mm on 500 mm, and no ball's warmth.
    "ball-size-changed": Rule("care", "scale"),
    # Stated, widened by the change. Stickers that shrank by 0.2 %: lengths 7.4 U off; dots blurred outward by 0.1
    # px: 4.6 U.
    "stickers-change": Rule("care", "scale"),
    # Stated, as ball-diameter. Printers differ by up to 0.3 % between directions.
    "print-stretched": Rule("care", "scale"),
    # Stated: widened by as much as leaving out single parts changes more than noise would.
    "parts-disagree": _INFORMATION,
    # Calibrated without the profile.
    "ball-profile-refused": _INFORMATION,
    # Left out.
    "not-on-board": _INFORMATION,
    # A start value: the distortion is estimated.
    "prior-assumed": _INFORMATION,
    # Stated: the uncertainty holds every expansion from none to aluminium's.
    "bar-assumed": _INFORMATION,
    # Stated: that of a rule; errors against it decide nothing.
    "length-without-uncertainty": _INFORMATION,
    # Of a rig read from a file; without quality all cameras ask for care.
    "rig-incomplete": _INFORMATION,
}
_SEVERITY: dict[Effect, Severity] = {"information": "info", "care": "warning", "not-valid": "error"}
_RANK = {"error": 0, "warning": 1, "info": 2}
_FORMS = ("free", "soft", "rigid")


def ruled(findings: Sequence[Finding]) -> Findings:
    """The findings with their effects' severities: errors first, and of equals wrong lenses, which feign others."""
    said = [replace(f, severity=_SEVERITY[effect(f)]) for f in findings]
    return tuple(sorted(said, key=lambda f: (_RANK[f.severity], f.code != "fixed-intrinsics-contradicted")))


def effect(finding: Finding) -> Effect:
    """What a finding does to the result; one of an unknown code and severity warning asks for care."""
    if finding.severity == "warning":
        return RULES[finding.code].effect if finding.code in RULES else "care"
    return "not-valid" if finding.severity == "error" else "information"


def is_valid(findings: Sequence[Finding]) -> bool:
    """Whether a result with these findings may be used, be it with care."""
    return all(effect(finding) != "not-valid" for finding in findings)


def affected(
    findings: Sequence[Finding], cameras: Sequence[str], region: Affected | None = None
) -> tuple[Affected, ...]:
    """What care concerns: cameras (all where a finding names none), the scale, the weak part of the volume."""
    names: set[str] = set()
    scale = volume = False
    for finding in findings:
        if effect(finding) != "care":
            continue
        concerns = RULES[finding.code].concerns if finding.code in RULES else "cameras"
        scale |= concerns == "scale"
        volume |= concerns == "volume"
        if concerns == "cameras" or (concerns == "volume" and region is None):
            names |= _concerned(finding, cameras)
    out = [Affected(camera=name) for name in cameras if name in names]
    out += [Affected(scale=True)] if scale else []
    return (*out, *([region] if volume and region is not None else []))


def _concerned(finding: Finding, cameras: Sequence[str]) -> set[str]:
    """The cameras that a finding concerns: all where it names none, or structure in half of them bends the rest too.

    A ball that moved by 0.05 mm between exposures left two cameras that no test had named 3 and 6 sigma off.
    """
    own, rule = set(finding.where) & set(cameras), RULES.get(finding.code)
    bends = rule is not None and max(rule.widen) > 1 and 2 * len(own) >= len(cameras)
    return set(cameras) if bends or not own else own


def widening(findings: Sequence[Finding], cameras: Sequence[str], form: str) -> tuple[FloatArray, FloatArray]:
    """By how much standard uncertainties of some cameras (c,) grow, by all findings: for lengths, of their poses."""
    factor, poses = np.ones(len(cameras)), np.ones(len(cameras))
    for finding in findings:
        if finding.code == "poses-scatter":
            scatter = dict(zip(finding.where, finding.values.get("times", ()), strict=bool(finding.values)))
            times = np.array([scatter.get(name, 1.0) for name in cameras])
            factor, poses = np.maximum(factor, times), np.maximum(poses, times)
        if finding.code == "parts-disagree" and finding.values:
            factor = np.maximum(factor, finding.values["lengths"])
            poses = np.maximum(poses, finding.values["poses"])
        if "grow_lengths" in finding.values:
            factor = np.maximum(factor, finding.values["grow_lengths"])
            poses = np.maximum(poses, finding.values["grow_poses"])
        rule = RULES.get(finding.code)
        if rule is None or effect(finding) != rule.effect or rule.effect == "not-valid":
            continue
        own = _concerned(finding, cameras)
        here = np.array([name in own for name in cameras])
        more = rule.widen[_FORMS.index(form) if form in _FORMS else 0]
        factor = np.where(here, np.maximum(factor, more), factor)
        poses = np.where(here, np.maximum(poses, more * rule.poses), poses)
    return factor, poses


def with_findings(calibration: Calibration, findings: Findings) -> Calibration:
    """A calibration with more findings, its causes, before those of the same severity; judged again."""
    if not findings:
        return calibration
    rig = calibration.rig
    all_of_them = ruled([*findings, *rig.quality.findings])
    more = affected(findings, [camera.id for camera in rig.cameras])
    valid, parts = rig.quality.valid and is_valid(findings), tuple(dict.fromkeys([*rig.quality.affected, *more]))
    quality = replace(rig.quality, findings=all_of_them, valid=valid, affected=parts)
    return replace(calibration, rig=replace(rig, quality=quality))
