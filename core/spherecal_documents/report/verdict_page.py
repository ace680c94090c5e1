"""The first page: verdicts, key figures, findings, the balls, where the result comes from."""

from collections.abc import Sequence

import numpy as np

from spherecal.data.findings import Finding
from spherecal.data.rig import Affected
from spherecal.verify.verification_file import AcceptanceReport, BarReport
from spherecal_documents.report.document import Document
from spherecal_documents.report.language import finding_words, label
from spherecal_documents.report.sections_bars import doubts_in_words, verdict_word
from spherecal_documents.report.sheet import PageBox, Sheet, leading, shortened, text_width, wrap
from spherecal_documents.report.style import (
    BAD,
    BODY_PT,
    CAUTION,
    GOOD,
    NEUTRAL,
    NONE,
    PALE,
    SEVERITY,
    SMALL_PT,
    SOFT,
    TINY_PT,
    TITLE_PT,
    count,
    number,
    significant,
    some_of,
)
from spherecal_documents.report.tables import calibrated_with, images_taken
from spherecal_rigs.result_folder import Result

_WORDS = {"valid": "verdict-valid", "use-with-care": "verdict-use-with-care", "not-valid": "verdict-not-valid"}
_SEVERITIES = {"error": "report-severity-error", "warning": "report-severity-warning", "info": "report-severity-info"}
_SOURCES = {
    "target_spacing": "report-scale-spacing",
    "bar": "report-scale-bar",
    "board": "report-scale-board",
    "ball": "report-scale-ball",
}
_TYPICAL_MM = 500.0


def add_verdict_page(document: Document, result: Result, note: str = "") -> None:
    """Begin the report: what the result is worth, in words, figures and findings."""
    document.section = label("report-summary")
    document.new_page()
    document.sheet.text(document.left, 25.0, label("report-calibration-report"), TITLE_PT, bold=True)
    rig = result.rig
    subtitle = _cameras(len(rig.cameras))
    if rig.reference_camera:
        subtitle = label("report-cameras-world", cameras=subtitle, camera=rig.reference_camera)
    document.sheet.text(document.left + document.width, 25.0, subtitle, BODY_PT, colour=SOFT, align="right")
    document.y = 31.0
    band = document.box(23.0)
    _verdict(document.sheet, band, label("report-calibration"), *calibration_verdict(result))
    document.y += 3.0
    band = document.box(17.0)
    _verdict(document.sheet, band, label("report-verification-with-reference-bars"), *verification_verdict(result))
    document.y += 4.0
    if note:
        document.paragraph(f"{label('report-note')}: {note}")
    _key_figures(document, result)
    _findings(document, result)
    _origin(document, result)


def calibration_verdict(result: Result) -> tuple[str, str, str]:
    """The verdict on the calibration: its word, its colour and a sentence."""
    rig, quality = result.rig, result.rig.quality
    placed, seen = len(rig.cameras), len(result.camera_ids)
    if quality.verdict == "use-with-care":
        care = care_words(quality.affected)
        sentence = label("report-placed-with-care", placed=placed, seen=_cameras(seen), affected=care)
        return label(_WORDS["use-with-care"]), CAUTION, sentence
    if quality.valid:
        values = {"placed": placed, "cameras": _cameras(seen), "rms": significant(quality.rms_px)}
        key = "report-may-be-used" if quality.rms_px is None else "report-may-be-used-fit"
        return label(_WORDS["valid"]), GOOD, label(key, **values)
    reason = next((finding_words(f)[0] for f in quality.findings if f.severity == "error"), "")
    if not reason:
        reason = label("report-no-camera-is-placed") if not placed else label("report-the-findings-below-say-why")
    return label(_WORDS["not-valid"]), BAD, label("report-must-not-be-used", reason=reason)


def _cameras(n: int) -> str:
    return label("report-n-cameras", n=n, shown=count(n))


def _all_lengths(bars: BarReport) -> str:
    return label("report-all-n-lengths", n=bars.n, shown=count(bars.n))


def care_words(some: Sequence[Affected]) -> str:
    """What care concerns, short enough for the first page."""
    cameras = [one.camera for one in some if one.camera is not None]
    named = {"cameras": _cameras(len(cameras)), "names": some_of(tuple(cameras))}
    parts = [label("report-n-cameras-named", **named)] if cameras else []
    parts += [label("report-the-scale")] if any(one.scale for one in some) else []
    parts += [label("report-a-part-of-the-volume")] if any(one.region_mm is not None for one in some) else []
    return ", ".join(parts)


def verification_verdict(result: Result) -> tuple[str, str, str]:
    """The verdict on the verification: its word, its colour and a sentence."""
    bars = result.bars
    if bars is None:
        return label("report-not-done"), NEUTRAL, label("report-no-reference-bars-were-measured")
    largest = number(bars.max_abs_error_mm, 3)
    errors = [finding_words(finding)[0] for finding in bars.findings if finding.severity == "error"]
    acceptance = bars.procedure.acceptance if bars.procedure is not None else None
    passed = acceptance is not None and acceptance.verdict == "pass"
    contradicted = bars.contradicting or (passed and bars.verdict == "inconsistent")
    if acceptance is not None and not errors and (acceptance.verdict == "fail" or not contradicted):
        return _against_limit(acceptance, bars)
    if bars.verdict == "consistent" and not errors:
        return (
            label("report-consistent"),
            GOOD,
            label(
                "report-lengths-agree" if bars.coverage_factor is None else "report-lengths-agree-k",
                lengths=_all_lengths(bars),
                k=bars.coverage_factor,
                largest=largest,
            ),
        )
    if bars.verdict == "inconsistent" or errors:
        reason = (
            errors[0]
            if errors
            else _contradicting(bars)
            if bars.contradicting
            else (
                label(
                    "report-lengths-differ",
                    exceeding=len(bars.exceeding),
                    n=label("report-n-lengths", n=bars.n, shown=count(bars.n)),
                    largest=largest,
                )
            )
        )
        return label("report-inconsistent"), BAD, reason
    return verdict_word(bars.verdict).upper(), CAUTION, label("report-bars-not-judged")


def _contradicting(bars: BarReport) -> str:
    names = some_of(bars.contradicting)
    return label("report-cameras-contradict", names=names)


def _against_limit(acceptance: AcceptanceReport, bars: BarReport) -> tuple[str, str, str]:
    """The decision after ISO 14253-1, where the user stated a limit."""
    largest = number(bars.max_abs_error_mm, 3)
    if acceptance.verdict == "pass":
        kept = label("report-limit-kept", lengths=_all_lengths(bars), limit=acceptance.words, largest=largest)
        return label("report-pass"), GOOD, kept
    if acceptance.verdict == "fail":
        failed = [x for x in acceptance.lengths if x.verdict == "fail"]
        names = ", ".join(label("report-from-to", bar=x.bar, start=x.from_mark, end=x.to_mark) for x in failed[:4])
        return (
            label("report-fail"),
            BAD,
            label("report-the-limit-is-exceeded-beyond", words=acceptance.words, names=names),
        )
    if acceptance.verdict == "cannot tell":
        key = "report-limit-open-why" if acceptance.doubts else "report-limit-open"
        doubts = doubts_in_words(acceptance)
        return label("report-cannot-tell"), CAUTION, label(key, limit=acceptance.words, doubts=doubts, largest=largest)
    return label("report-no-data"), CAUTION, label("report-bars-not-judged")


def _verdict(sheet: Sheet, box: PageBox, title: str, word: str, colour: str, sentence: str) -> None:
    """A verdict: a solid block with the word, the sentence beside it."""
    block = PageBox(box.x, box.y, 52.0, box.height)
    sheet.fill(box, PALE)
    sheet.fill(block, colour)
    size = 17.0 if box.height > 20 else 13.0
    while text_width(word, size, bold=True) > block.width - 6.0:
        size -= 0.5
    sheet.text(block.x + 4.0, block.y + 5.4, title, TINY_PT, colour="white")
    sheet.text(block.x + 4.0, block.y + box.height - 5.0, word, size, bold=True, colour="white")
    most = int((box.height - 4.0) // leading(BODY_PT))
    lines = wrap(sentence, box.width - block.width - 10.0, BODY_PT)
    lines = [*lines[: most - 1], lines[most - 1] + " …"] if len(lines) > most else lines
    top = box.y + (box.height - len(lines) * leading(BODY_PT)) / 2 + 3.0
    sheet.lines(block.x + block.width + 5.0, top, lines)


def _key_figures(document: Document, result: Result) -> None:
    figures = key_figures(result)
    tiles = document.box(36.0)
    for box, (value, unit, name, note) in zip(tiles.grid(2, 4, 3.0), figures, strict=True):
        document.sheet.rule(box.x, box.x + box.width, box.y, NEUTRAL, 0.8)
        document.sheet.text(box.x, box.y + 4.2, shortened(name, box.width, TINY_PT), TINY_PT, colour=SOFT)
        document.sheet.text(box.x, box.y + 10.2, value, 13.0, bold=True)
        width = text_width(value, 13.0, bold=True)
        document.sheet.text(box.x + width + 1.2, box.y + 10.2, unit, SMALL_PT)
        document.sheet.text(box.x, box.y + 14.0, shortened(note, box.width, TINY_PT), TINY_PT, colour=SOFT)
    document.y += 3.0


def key_figures(result: Result) -> list[tuple[str, str, str, str]]:
    """Eight figures, each with value, unit, name and note as printed."""
    rig, quality, residuals = result.rig, result.rig.quality, result.residuals
    used, total = int(residuals.used.sum()), len(residuals.used)
    relative = rig.scale.relative_uncertainty
    scale = None if relative is None else relative * _TYPICAL_MM
    sigmas = [camera.sigma for camera in rig.cameras if camera.sigma is not None]
    centre = max((float(np.linalg.norm(s.centre_mm)) for s in sigmas), default=None)
    turn = max((float(np.linalg.norm(s.rotation_deg)) for s in sigmas), default=None)
    left_out = (
        label("report-of-left-out", total=count(total), percent=number(100 * (1 - used / total), 1))
        if total
        else label("report-none-recorded")
    )
    spheres = result.spheres
    radius = float(np.mean([s.radius_mm for s in spheres])) if spheres else None
    return [
        (
            str(len(rig.cameras)),
            label("report-of-all", all=len(result.camera_ids)),
            label("report-cameras-placed"),
            label("report-of-those-with-observations"),
        ),
        (
            number(quality.rms_px, 4),
            "px",
            label("report-residuals-rms"),
            label("report-mean-length-px", mean_px=number(quality.mean_px, 4)),
        ),
        (number(quality.sigma0, 3), "", label("report-sigma0-a-posteriori"), label("report-1-as-assumed-px-if")),
        (
            label("report-no-scale") if not result.has_scale else NONE if scale is None else f"±{significant(scale)}",
            label("report-mm-on-500-mm") if scale is not None else "",
            label(_SOURCES.get(rig.scale.source, "report-scale")),
            _scale_note(result),
        ),
        (count(used), "", label("report-head-observations-used"), left_out),
        (
            significant(centre),
            result.unit,
            label("report-camera-centres-largest-sd"),
            label("report-all-three-axes-k-1"),
        ),
        (
            significant(turn),
            label("report-deg"),
            label("report-rotations-largest-sd"),
            label("report-all-three-axes-k-1"),
        ),
        (
            number(radius, 2),
            result.unit if spheres else "",
            label("report-ball-radius-mean"),
            label("report-of-spheres", n=len(spheres), shown=count(len(spheres))),
        ),
    ]


def _scale_note(result: Result) -> str:
    """What the scale's uncertainty holds: that of a print assumes a perfect one."""
    if not result.has_scale:
        return label("report-lengths-are-arbitrary-units")
    if result.rig.scale.source == "target_spacing":
        return label("report-k-1-perfect-prints-assumed")
    return label("report-standard-uncertainty-k-1")


def _findings(document: Document, result: Result) -> None:
    document.begin_section(label("report-findings"), 20.0, new_page=False)
    findings = sorted_findings(result.rig.quality.findings)
    document.y += 1.0
    if not findings:
        document.paragraph(label("report-none-there-is-nothing-to"))
    for finding in findings:
        add_finding(document, finding)


def sorted_findings(findings: tuple[Finding, ...]) -> list[Finding]:
    """Errors first, then warnings, then the rest."""
    order = ("error", "warning", "info")
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def add_finding(document: Document, finding: Finding) -> None:
    """Print a finding: severity, message, hint and the ids concerned."""
    indent = 20.0
    width = document.width - indent
    where = label("report-concerns", names=some_of(finding.where, 120)) if finding.where else ""
    message, hint = finding_words(finding)
    parts = [(message, BODY_PT, "#1a1a1a"), (hint, BODY_PT, SOFT), (where, SMALL_PT, SOFT)]
    lines = [(line, size, colour) for text, size, colour in parts for line in wrap(text, width, size)]
    document.need(min(len(lines), 4) * leading(BODY_PT) + 2.0)
    colour = SEVERITY[finding.severity]
    first = document.y + leading(BODY_PT)
    document.sheet.fill(PageBox(document.left, document.y + 0.6, 1.2, leading(BODY_PT)), colour)
    document.sheet.text(document.left + 2.6, first, severity_word(finding.severity), BODY_PT, bold=True, colour=colour)
    for line, size, ink in lines:
        document.need(leading(size))
        document.y += leading(size)
        document.sheet.text(document.left + indent, document.y, line, size, colour=ink)
    document.y += 2.2


def _origin(document: Document, result: Result) -> None:
    document.begin_section(label("report-where-this-result-comes-from"), 28.0, new_page=False)
    rows = [
        (
            label("report-head-calibrated-with"),
            calibrated_with(result),
        ),
        (label("report-head-images-taken"), images_taken(result)),
        (label("report-head-input"), result.rig.input_sha256 or label("report-not-given")),
        (
            label("report-world-frame"),
            label("report-frame-of-camera-x-right", reference_camera=result.rig.reference_camera)
            if result.rig.reference_camera
            else label("report-none-no-camera-is-placed"),
        ),
        (label("report-uncertainties"), label("report-standard-uncertainties-k-1-unless")),
    ]
    document.y += 1.0
    for name, text in rows:
        lines = wrap(text, document.width - 32.0, SMALL_PT)
        document.need(len(lines) * leading(SMALL_PT))
        document.y += leading(SMALL_PT)
        document.sheet.text(document.left, document.y, name, SMALL_PT, colour=SOFT)
        last = document.sheet.lines(document.left + 32.0, document.y, lines, SMALL_PT)
        document.y = max(document.y, last - leading(SMALL_PT)) + 0.6


def severity_word(severity: str) -> str:
    """Error, warning or note, as the report calls them."""
    return label(_SEVERITIES[severity])


def signed_by() -> tuple[str, ...]:
    """What is written under the lines to sign on."""
    return label("report-assessed-by"), label("report-date"), label("report-signature")


def add_signature(document: Document) -> None:
    """The last section: who assessed this report, with lines to sign on."""
    document.begin_section(label("report-assessment"), 34.0, new_page=False)
    document.paragraph(label("report-this-report-was-made-by"))
    document.box(18.0)
    y = document.y
    for box, name in zip(PageBox(document.left, y, document.width, 0.0).grid(1, 3, 8.0), signed_by(), strict=True):
        document.sheet.rule(box.x, box.x + box.width, y - 3.5, SOFT)
        document.sheet.text(box.x, y, name, TINY_PT, colour=SOFT)
