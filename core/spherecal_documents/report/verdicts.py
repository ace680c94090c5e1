"""What the first page says: the verdicts on calibration and verification, and the key figures."""

from collections.abc import Sequence

import numpy as np

from spherecal.data.rig import Affected
from spherecal_documents.report.language import finding_words, label
from spherecal_documents.report.model import KeyFigure, KeyFigures, Verdict
from spherecal_documents.report.sections_bars import doubts_in_words, verdict_word
from spherecal_documents.report.style import BAD, CAUTION, GOOD, NEUTRAL, NONE, count, number, significant, some_of
from spherecal_files.verification_file import BarReport
from spherecal_rigs.result_folder import Result
from spherecal_verify.limit import Acceptance

_WORDS = {"valid": "verdict-valid", "use-with-care": "verdict-use-with-care", "not-valid": "verdict-not-valid"}
_SOURCES = {
    "target_spacing": "report-scale-spacing",
    "bar": "report-scale-bar",
    "board": "report-scale-board",
    "ball": "report-scale-ball",
}
_TYPICAL_MM = 500.0


def calibration_verdict(result: Result) -> Verdict:
    """The verdict on the calibration."""
    rig, quality = result.rig, result.rig.quality
    title, placed, seen = label("report-calibration"), len(rig.cameras), len(result.camera_ids)
    if quality.valid and result.bars is not None and result.bars.failed:  # whatever the calibration says of itself
        override = override_words(result.bars)
        sentence = label("report-contradicted", override=override or label("report-must-not-be-put-to-use"))
        return Verdict(title, label("report-verification-failed"), BAD, sentence)
    if quality.verdict == "use-with-care":
        care = care_words(quality.affected)
        sentence = label("report-placed-with-care", placed=placed, seen=cameras_in_words(seen), affected=care)
        return Verdict(title, label(_WORDS["use-with-care"]), CAUTION, sentence)
    if quality.valid:
        values = {"placed": placed, "cameras": cameras_in_words(seen), "rms": significant(quality.rms_px)}
        key = "report-may-be-used" if quality.rms_px is None else "report-may-be-used-fit"
        return Verdict(title, label(_WORDS["valid"]), GOOD, label(key, **values))
    reason = next((finding_words(f)[0] for f in quality.findings if f.severity == "error"), "")
    if not reason:
        reason = label("report-the-findings-below-say-why") if placed else label("report-no-camera-is-placed")
    return Verdict(title, label(_WORDS["not-valid"]), BAD, label("report-must-not-be-used", reason=reason))


def override_words(bars: BarReport) -> str:
    """Who uses the rig although its verification failed, and why; empty where nobody does."""
    o = bars.override
    return (
        "" if o is None else label("report-used-all-the-same", by=o.by, date=o.at.date().isoformat(), reason=o.reason)
    )


def cameras_in_words(n: int) -> str:
    """So many cameras."""
    return label("report-n-cameras", n=n, shown=count(n))


def care_words(some: Sequence[Affected]) -> str:
    """What care concerns, short enough for the first page."""
    cameras = [one.camera for one in some if one.camera is not None]
    named = {"cameras": cameras_in_words(len(cameras)), "names": some_of(tuple(cameras))}
    parts = [label("report-n-cameras-named", **named)] if cameras else []
    parts += [label("report-the-scale")] if any(one.scale for one in some) else []
    parts += [label("report-a-part-of-the-volume")] if any(one.region_mm is not None for one in some) else []
    return ", ".join(parts)


def verification_verdict(result: Result) -> Verdict:
    """The verdict on the verification, and who uses the rig in spite of it."""
    word, level, sentence = _of_bars(result.bars)
    if result.bars is not None and result.bars.failed and (override := override_words(result.bars)):
        sentence = f"{sentence} {override}"
    return Verdict(label("report-verification-with-reference-bars"), word, level, sentence)


def _of_bars(bars: BarReport | None) -> tuple[str, str, str]:
    if bars is None:
        return label("report-not-done"), NEUTRAL, label("report-no-reference-bars-were-measured")
    largest = number(bars.max_abs_error_mm, 3)
    errors = {f.code: finding_words(f)[0] for f in bars.findings if f.severity == "error"}
    exceeded = errors.pop("limit-exceeded", "")
    acceptance = bars.procedure.acceptance if bars.procedure is not None else None
    if acceptance is not None and (acceptance.verdict == "fail" or not (errors or bars.failed)):
        word, level, sentence = _against_limit(acceptance, bars)
        return word, level, " ".join([exceeded or sentence, *errors.values()])
    if bars.verdict == "consistent" and not errors:
        key = "report-lengths-agree" if bars.coverage_factor is None else "report-lengths-agree-k"
        agree = label(key, lengths=_all_lengths(bars), k=bars.coverage_factor, largest=largest)
        return label("report-consistent"), GOOD, agree
    if bars.verdict != "inconsistent" and not errors:
        return verdict_word(bars.verdict).upper(), CAUTION, label("report-bars-not-judged")
    if errors:
        reason = " ".join(errors.values())
    elif bars.contradicting:
        reason = label("report-cameras-contradict", names=some_of(bars.contradicting))
    else:
        lengths = label("report-n-lengths", n=bars.n, shown=count(bars.n))
        reason = label("report-lengths-differ", exceeding=len(bars.exceeding), n=lengths, largest=largest)
    return label("report-inconsistent"), BAD, reason


def _all_lengths(bars: BarReport) -> str:
    return label("report-all-n-lengths", n=bars.n, shown=count(bars.n))


def _against_limit(acceptance: Acceptance, bars: BarReport) -> tuple[str, str, str]:
    """The decision after ISO 14253-1, where the user stated a limit."""
    largest = number(bars.max_abs_error_mm, 3)
    if acceptance.verdict == "pass":
        kept = label("report-limit-kept", lengths=_all_lengths(bars), limit=acceptance.limit.words(), largest=largest)
        return label("report-pass"), GOOD, kept
    if acceptance.verdict == "fail":
        failed = [x for x in acceptance.lengths if x.verdict == "fail"]
        names = ", ".join(label("report-from-to", bar=x.bar, start=x.from_mark, end=x.to_mark) for x in failed[:4])
        exceeded = label("report-the-limit-is-exceeded-beyond", words=acceptance.limit.words(), names=names)
        return label("report-fail"), BAD, exceeded
    if acceptance.verdict == "cannot tell":
        key = "report-limit-open-why" if acceptance.doubts else "report-limit-open"
        doubts = doubts_in_words(acceptance)
        return (
            label("report-cannot-tell"),
            CAUTION,
            label(key, limit=acceptance.limit.words(), doubts=doubts, largest=largest),
        )
    return label("report-no-data"), CAUTION, label("report-bars-not-judged")


def key_figures(result: Result) -> KeyFigures:
    """The eight figures of the first page."""
    rig, quality, residuals, unit = result.rig, result.rig.quality, result.residuals, result.unit
    used, total = int(residuals.used.sum()), len(residuals.used)
    relative, spheres = rig.scale.relative_uncertainty, result.spheres
    sigmas = [camera.sigma for camera in rig.cameras if camera.sigma is not None]
    centre = max((float(np.linalg.norm(s.centre_mm)) for s in sigmas), default=None)
    turn = max((float(np.linalg.norm(s.rotation_deg)) for s in sigmas), default=None)
    percent = number(100 * (1 - used / total), 1) if total else ""
    left_out = label("report-of-left-out", total=count(total), percent=percent)
    scale = NONE if relative is None else f"±{significant(relative * _TYPICAL_MM)}"
    radius = float(np.mean([s.radius_mm for s in spheres])) if spheres else None
    three_axes, fit = label("report-all-three-axes-k-1"), number(quality.mean_px, 4)
    rows = (
        (str(len(rig.cameras)), label("report-of-all", all=len(result.camera_ids)), label("report-cameras-placed"),
         label("report-of-those-with-observations")),
        (number(quality.rms_px, 4), "px", label("report-residuals-rms"), label("report-mean-length-px", mean_px=fit)),
        (number(quality.sigma0, 3), "", label("report-sigma0-a-posteriori"), label("report-1-as-assumed-px-if")),
        (scale if result.has_scale else label("report-no-scale"),
         "" if relative is None else label("report-mm-on-500-mm"),
         label(_SOURCES.get(rig.scale.source, "report-scale")), _scale_note(result)),
        (count(used), "", label("report-head-observations-used"),
         left_out if total else label("report-none-recorded")),
        (significant(centre), unit, label("report-camera-centres-largest-sd"), three_axes),
        (significant(turn), label("report-deg"), label("report-rotations-largest-sd"), three_axes),
        (number(radius, 2), unit if spheres else "", label("report-ball-radius-mean"),
         label("report-of-spheres", n=len(spheres), shown=count(len(spheres)))),
    )  # fmt: skip
    return KeyFigures(tuple(KeyFigure(*row) for row in rows))


def _scale_note(result: Result) -> str:
    """What the scale's uncertainty holds: that of a print assumes a perfect one."""
    if not result.has_scale:
        return label("report-lengths-are-arbitrary-units")
    if result.rig.scale.source == "target_spacing":
        return label("report-k-1-perfect-prints-assumed")
    return label("report-standard-uncertainty-k-1")
