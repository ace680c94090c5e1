"""What a calibration's findings make of it: VALID, USE WITH CARE or NOT VALID. The one table of it.

VALID: the stated uncertainties cover the errors. USE WITH CARE: they do too, widened where that is needed, but a
camera, the scale or a part of the volume is worse than it could be. NOT VALID: they do not.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, Severity
from spherecal.data.rig import Affected, Calibration, Verdict

Effect = Literal["information", "care", "not-valid"]
Concerns = Literal["", "cameras", "scale", "volume"]
# As the command line, the report and the window have them.
WORDS: dict[Verdict, str] = {"valid": "VALID", "use-with-care": "USE WITH CARE", "not-valid": "NOT VALID"}


@dataclass(frozen=True)
class Rule:
    """What a finding means whose test has failed (severity warning): its effect, on what, and the measurement behind.

    `widen`: by how much standard uncertainties of the cameras concerned grow in the free, soft and rigid form. `poses`:
    how much more those of single poses do, whose errors make up for each other in lengths.
    """

    effect: Effect
    because: str
    concerns: Concerns = ""
    widen: tuple[float, float, float] = (1.0, 1.0, 1.0)
    poses: float = 1.0


def _care(
    concerns: Concerns, because: str, widen: tuple[float, float, float] = (1.0, 1.0, 1.0), poses: float = 1.0
) -> Rule:
    return Rule("care", because, concerns, widen, poses)


# Of calibrations; findings of verify, check and cameras keep the severity that they are made with.
# A finding that its test calls "info" is information, one that it calls "error" makes the result not valid; between
# them, "warning", the table decides. "Stated": the stated uncertainty as it is covers it.
RULES: dict[str, Rule] = {
    # nothing, or not the whole rig, was calibrated
    "nothing-reconstructed": Rule("not-valid", "There is no rig."),
    "cameras-unlinked": Rule("not-valid", "Cameras are missing or in frames of their own."),
    "not-converged": Rule("not-valid", "No minimum: 4 to 14 px on a hall that stuck (numerics, section 1)."),
    "degenerate-geometry": Rule("not-valid", "No uncertainty can be stated, or none to first order: over a tenth."),
    "behind-camera": Rule("not-valid", "Not a real solution."),
    "pose-ambiguous": Rule("not-valid", "Cameras are missing: two poses fit alike, and one of them is wrong."),
    "focus-changed": Rule("not-valid", "Which of two focal lengths the cameras have now is not estimated."),
    "misnumbered": Rule(
        "not-valid", "A column off, a camera was 247 mm and 9.5 degrees off; what was put back is a guess."
    ),
    "mirrored": Rule("not-valid", "All lengths right, all places mirrored."),
    "stopped-early": Rule("not-valid", "Its tests have not been made."),
    "no-joint-adjustment": Rule("not-valid", "For comparison: no uncertainty, and no test, is known."),
    # the recording is wrong somewhere, and was not repaired
    "camera-moved": Rule(
        "not-valid",
        "Named from chi-square 30 on 6 degrees: the two poses are 5 standard deviations apart. A move of "
        "30, 3, 0.3 mm left the camera 108, 17, 1.7 mm off at sigmas of 5.9, 1.4, 0.14 mm (ten-camera rig). By less "
        "than a sixth of what lengths are uncertain by: stated, and information.",
    ),
    "cameras-moved": Rule("not-valid", "As camera-moved: a beam that sagged by 2 mm left rig B 2 mm off, 23 times U."),
    "camera-unsteady": Rule(
        "not-valid",
        "The ball displaced by 0.05 mm for one late camera: it is 0.2 mm off, 15 times U. Less: as camera-moved.",
    ),
    "ball-moved": Rule(
        "not-valid", "By 0.05 mm between two trigger groups: 4 times U, with all that lens-misfit adds."
    ),
    "wrong-placement": Rule("not-valid", "A stale image left its camera 373 to 1128 mm off in nine cases."),
    "image-repeated": Rule("not-valid", "As wrong-placement; reported before anything is computed."),
    "image-settings": Rule("not-valid", "Another region, size or camera: its lens and pose are not those before."),
    "image-contradicts": Rule("not-valid", "Most of an image contradicts the rest: as camera-moved, size unknown."),
    "images-rejected": Rule("not-valid", "As image-contradicts; a camera keeps 96 to 100 % on clean rigs."),
    "board-moving": _care(
        "cameras",
        "Widened by lens-misfit and by what parts disagree; not valid where a camera or an image would be blamed. "
        "Moved by 0.2 and 1 mm between exposures: errors of lengths within U, of cameras too.",
        (10.0, 3.0, 2.0),
        3.0,
    ),
    "cameras-swapped": Rule("not-valid", "Each camera has the other's pose: as far off as the two are apart."),
    "placements-contradict": Rule("not-valid", "As if the ball had changed by over 1 mm: no ball does."),
    "placements-repeated": Rule("not-valid", "Four copies of one placement: lengths 5.4 mm off at U = 1.7 mm."),
    "outliers-removed": Rule("not-valid", "Over 5 % outliers: no study has measured what is left (outliers.md)."),
    "recording-contradicts": Rule(
        "not-valid",
        "Ball moved by 1 mm between exposures: cameras 12 to 36 mm off at sigmas of 1 to 2 mm; five "
        "cameras sagged by 2 mm: 16 mm. Neither lens, ball nor a camera explains it.",
    ),
    "fits-badly": Rule("not-valid", "Thirty points a camera, 9 times the stated noise: a wrong minimum, 543 mm off."),
    "fixed-intrinsics-contradicted": _care(
        "cameras",
        "Stated: widened by what other intrinsics would change; not valid where lengths change by more than U. "
        "Data-sheet values 1.5 % off: lengths 3.8 to 11.8 mm, U 0.5.",
    ),
    # millimetres that are not
    "scale-conflict": Rule("not-valid", "A certificate 480 for 400 mm: all lengths 20 % off, U(500) 0.05 mm."),
    "scale-sources": _care(
        "scale",
        "Print and ball agree against the bar. From 0.5 % on not valid: certificates mistyped by 0.2 to 7 mm "
        "on 800 mm left lengths 3.7 to 132 U off.",
    ),
    "bar-poses-disagree": _care(
        "scale",
        "Odd poses are left out; not valid where the rest is no majority that agrees. A mark that shifted by "
        "0.2 to 3 mm in some of six poses: lengths up to 8.6 U off; by 0.5 mm from a frame of a waved bar on: 4.5 U.",
    ),
    "bar-temperature": Rule("not-valid", "70 or 120 typed in Fahrenheit: lengths 8 to 17 U off."),
    "ball-profile-scale": Rule("not-valid", "As scale-conflict."),
    "size-implausible": Rule(
        "not-valid", "A pitch in metres: cameras 0.37 mm apart, all lengths 1000 times too short."
    ),
    "target-distance": Rule("not-valid", "14.0 typed for 28.28 mm: all lengths 50 % off."),
    "ball-diameter": Rule(
        "care",
        "0.5 to 2 % off: printers err by 0.1 to 0.5 %; the scale's uncertainty then covers the difference. "
        "Over 2 %, and 1.5 U of lengths: not valid (stickers printed at 97 %: 15 mm on 500).",
        "scale",
    ),
    "no-scale": _care("scale", "Shapes are right, lengths arbitrary."),
    "print-unmeasured": _care(
        "scale", "Stated: 0.3 %. Printed 0.5 % too large: lengths 68 times U off where it was not."
    ),
    "board-shape": _care("scale", "A board 0.1 % larger than stated makes all lengths so."),
    # one lens, camera or part of the volume is worse than the others
    "lens-misfit": _care(
        "cameras",
        "A field of 0.03 to 0.1 px grew errors of bars 1.3 to 1.9 times beyond what sigma0 says in the "
        "rigid form, 4.6 to 9.7 times in the free one (numerics, section 2, rigs A and B). A ball that moved by 0.05 "
        "and 0.2 mm between exposures: errors of bars 0.5 to 0.8 of twice the stated, of cameras up to 10 times.",
        (10.0, 3.0, 2.0),
        3.0,
    ),
    "ball-shape-changed": _care(
        "cameras",
        "The rigid form held against the data: errors grew 2.8 to 5.6 times beyond what sigma0 says; the "
        "soft one 2.6 times (numerics, section 2). Pixels skewed by 2 px, taken for a bent ball: lengths 5.7 times U "
        "off in the free form, 11 times in the soft one. Flattened by its weight by 0.3 mm: lengths 14 to 17 times U, "
        "cameras 36 times (rig B, random). Skewed by 8 px: 5.3 times, after a widening of 2.",
        (4.0, 4.0, 5.0),
        3.0,
    ),
    "intrinsics-held": _care(
        "cameras",
        "Held near the nominal values: as good as these. Where three lenses of the rig are estimated, they say how "
        "good these are: stated, and information.",
    ),
    "capture-times": _care("cameras", "Of another moment; if the ball has moved since, wrong-placement says so."),
    "few-placements": _care("cameras", "Stated: lengths 120 to 1600 um instead of 50. But hardly any test has power."),
    "pose-unconfirmed": _care(
        "cameras",
        "Knocked for one image by 30 mm and back again, at the last that it had: 30 mm off, 323 times U. "
        "Late by 0.05 mm at each placement, and split as moved: 5.1 times U. "
        "Binned from its last image on, of 4 dots: all its lengths wrong.",
    ),
    "camera-late": _care(
        "cameras", "Put back: with 24 placements, one camera 1 to 3 behind, errors were those of clean recordings."
    ),
    "few-frames": _care("cameras", "Stated, as few-placements."),
    "linked-by-a-thread": _care("cameras", "Stated, but one wrong camera turns half of the rig unseen."),
    "accuracy-missed": _care("volume", "The session says what is wanted; the map of lengths what is reached."),
    # information: the result is as good as it says
    "form-free": Rule("information", "Stated: the free form's uncertainties hold whatever the ball does."),
    "form-soft": Rule("information", "Stated: studies/shape.md."),
    "swapped-back": Rule("information", "Put back where the names before and after are the same: right in every case."),
    "camera-noisy": Rule("information", "Stated by its weight: bars 48 to 50 um with a blurred camera, 46 without."),
    "weak-self-calibration": Rule("information", "Stated: focal lengths over 1000 ppm; 60 to 420 on usual rigs."),
    "prior-focal-length": Rule("information", "Stated: the estimate counts, however far off the start value was."),
    "placements-clustered": Rule("information", "Stated: twice as uncertain outside (numerics, section 7)."),
    "placements-stacked": Rule("information", "Stated: three times as uncertain at the sides (numerics, section 7)."),
    "rigid-form-misfit": Rule(
        "information",
        "Stated, widened. Lenses beyond their model: lengths of 40 realistic recordings 99 % within U, at most 1.33.",
        "cameras",
        (2.0, 4.0, 5.0),
        3.0,
    ),
    "two-view-points": Rule("information", "Stated: 61 % of rig B's points; errors 0.96 to 1.08 of the stated."),
    "little-coverage": Rule("information", "Stated: normalised errors 0.96 to 1.08, small balls included."),
    "lens-field": Rule("information", "Stated: fields are unknowns of the adjustment (studies/misfit.md)."),
    "camera-drifts": _care(
        "cameras",
        "Of most cameras: a ball that rolled by 0.05 degrees between exposures left a camera 4.0 U off. Of some: "
        "stated by turns of images that are unknowns, and information.",
        poses=3.0,
    ),
    "scale-uncertainty": Rule("information", "Every calibration has it."),
    "target-contradicts": Rule("information", "Left out: bars 40 um with 5 % wrong matches, 42 without."),
    "poses-scatter": Rule("information", "Stated: widened by as much as the images' poses scatter."),
    "ball-size-changed": _care(
        "scale", "Stated: widened by what it did to the cameras. Over 0.1 %: 0.5 mm on 500 mm, and no ball's warmth."
    ),
    "stickers-change": _care(
        "scale",
        "Stated, widened by the change. Stickers that shrank by 0.2 %: lengths 7.4 U off; dots blurred "
        "outward by 0.1 px: 4.6 U.",
    ),
    "print-stretched": _care("scale", "Stated, as ball-diameter. Printers differ by up to 0.3 % between directions."),
    "parts-disagree": Rule(
        "information", "Stated: widened by as much as leaving out single parts changes more than noise would."
    ),
    "ball-profile-refused": Rule("information", "Calibrated without the profile."),
    "not-on-board": Rule("information", "Left out."),
    "prior-assumed": Rule("information", "A start value: the distortion is estimated."),
    "bar-assumed": Rule("information", "Stated: the uncertainty holds every expansion from none to aluminium's."),
    "length-without-uncertainty": Rule("information", "Stated: that of a rule; errors against it decide nothing."),
    "rig-incomplete": Rule("information", "Of a rig read from a file; without quality all cameras ask for care."),
}
_SEVERITY: dict[Effect, Severity] = {"information": "info", "care": "warning", "not-valid": "error"}
_RANK = {"error": 0, "warning": 1, "info": 2}
_FORMS = ("free", "soft", "rigid")


def ruled(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings with the severities that their effects have, errors first."""
    said = [replace(f, severity=_SEVERITY[effect(f)]) for f in findings]
    return tuple(sorted(said, key=lambda finding: _RANK[finding.severity]))


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


def with_findings(calibration: Calibration, findings: tuple[Finding, ...]) -> Calibration:
    """A calibration with more findings, its causes, before those of the same severity; judged again."""
    if not findings:
        return calibration
    rig = calibration.rig
    all_of_them = ruled([*findings, *rig.quality.findings])
    more = affected(findings, [camera.id for camera in rig.cameras])
    valid, parts = rig.quality.valid and is_valid(findings), tuple(dict.fromkeys([*rig.quality.affected, *more]))
    quality = replace(rig.quality, findings=all_of_them, valid=valid, affected=parts)
    return replace(calibration, rig=replace(rig, quality=quality))


def named(some: Collection[Affected]) -> str:
    """What care concerns, in words: `cameras C01, C04; the scale`."""
    return "; ".join(phrase(part) for part in care_phrases(some))


def care_phrases(some: Collection[Affected]) -> tuple[Phrase, ...]:
    """What care concerns: cameras, the scale, parts of the volume."""
    cameras = [one.camera for one in some if one.camera is not None]
    parts = [Phrase("care-cameras", {"cameras": cameras})] if cameras else []
    parts += [Phrase("care-scale")] if any(one.scale for one in some) else []
    for one in some:
        if one.region_mm is not None:
            low, high = one.region_mm
            parts.append(Phrase("care-volume", {"low": low, "high": high}))
    return tuple(parts)
