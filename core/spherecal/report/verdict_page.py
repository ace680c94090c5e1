"""The first page: verdicts, key figures, findings, the balls, where the result comes from."""

from collections.abc import Sequence

import numpy as np

from spherecal.data.findings import Finding
from spherecal.data.rig import Affected
from spherecal.data.verdict import WORDS
from spherecal.report.document import Document
from spherecal.report.language import Said, finding_words, said
from spherecal.report.procedure_file import AcceptanceReport
from spherecal.report.result_folder import Result
from spherecal.report.sections_bars import doubts_in_words
from spherecal.report.sheet import Box, Sheet, leading, shortened, text_width, wrap
from spherecal.report.style import (
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
    plural,
    significant,
    some_of,
)
from spherecal.report.tables import images_taken
from spherecal.report.verification_file import BarReport

_SOURCES = {"target_spacing": " from target spacing", "bar": " from reference bar", "board": " from board"}
_TYPICAL_MM = 500.0
_SIGNED = ("Assessed by", "Date", "Signature")


def add_verdict_page(document: Document, result: Result, note: str = "") -> None:
    """Begin the report: what the result is worth, in words, figures and findings."""
    document.section = "Summary"
    document.new_page()
    document.sheet.text(document.left, 25.0, "Calibration report", TITLE_PT, bold=True)
    rig = result.rig
    subtitle = f"{plural(len(rig.cameras), 'camera')}" + (
        f", world = frame of {rig.reference_camera}" if rig.reference_camera else ""
    )
    document.sheet.text(document.left + document.width, 25.0, subtitle, BODY_PT, colour=SOFT, align="right")
    document.y = 31.0
    band = document.box(23.0)
    _verdict(document.sheet, band, "Calibration", *calibration_verdict(result))
    document.y += 3.0
    band = document.box(17.0)
    _verdict(document.sheet, band, "Verification with reference bars", *verification_verdict(result))
    document.y += 4.0
    if note:
        document.paragraph(Said(f"{said('Note')}: {note}"))
    _key_figures(document, result)
    _findings(document, result)
    _origin(document, result)


def calibration_verdict(result: Result) -> tuple[str, str, str]:
    """Word, colour and sentence about the calibration."""
    rig, quality = result.rig, result.rig.quality
    placed, seen = len(rig.cameras), len(result.camera_ids)
    if quality.verdict == "use-with-care":
        return WORDS["use-with-care"], CAUTION, (
            f"{placed} of {plural(seen, 'camera')} are placed. To be used with care: {care_words(quality.affected)}. "
            "The stated uncertainties cover it; see the findings."
        )  # fmt: skip
    if quality.valid:
        fit = "" if quality.rms_px is None else f"; the fit agrees to {significant(quality.rms_px)} px rms"
        return (
            WORDS["valid"],
            GOOD,
            f"The calibration may be used: {placed} of {plural(seen, 'camera')} are placed{fit}.",
        )
    reason = next((finding_words(f)[0] for f in quality.findings if f.severity == "error"), "")
    if not reason:
        reason = "No camera is placed." if not placed else "The findings below say why."
    return WORDS["not-valid"], BAD, f"The calibration must not be used. {reason}"


def care_words(some: Sequence[Affected]) -> str:
    """What care concerns, short enough for the first page."""
    cameras = [one.camera for one in some if one.camera is not None]
    parts = [f"{plural(len(cameras), 'camera')} ({some_of(tuple(cameras))})"] if cameras else []
    parts += ["the scale"] if any(one.scale for one in some) else []
    parts += ["a part of the volume"] if any(one.region_mm is not None for one in some) else []
    return ", ".join(said(part) for part in parts)


def verification_verdict(result: Result) -> tuple[str, str, str]:
    """Word, colour and sentence about the verification."""
    bars = result.bars
    if bars is None:
        return "NOT DONE", NEUTRAL, "No reference bars were measured with this calibration."
    largest = number(bars.max_abs_error_mm, 3)
    errors = [finding_words(finding)[0] for finding in bars.findings if finding.severity == "error"]
    acceptance = bars.procedure.acceptance if bars.procedure is not None else None
    passed = acceptance is not None and acceptance.verdict == "pass"
    contradicted = bars.contradicting or (passed and bars.verdict == "inconsistent")
    if acceptance is not None and not errors and (acceptance.verdict == "fail" or not contradicted):
        return _against_limit(acceptance, bars)
    if bars.verdict == "consistent" and not errors:
        k = "" if bars.coverage_factor is None else f" (k = {bars.coverage_factor:.2f})"
        return (
            "CONSISTENT", GOOD,
            f"All {plural(bars.n, 'measured length')} agree with their certificates within their uncertainty{k}; "
            f"the largest error is {largest} mm.",
        )  # fmt: skip
    if bars.verdict == "inconsistent" or errors:
        reason = errors[0] if errors else _contradicting(bars) if bars.contradicting else (
            f"{len(bars.exceeding)} of {plural(bars.n, 'length')} differ from their certificates by more than their "
            f"uncertainty allows; the largest error is {largest} mm."
        )  # fmt: skip
        return "INCONSISTENT", BAD, reason
    return bars.verdict.upper(), CAUTION, "The bars could not be judged; the findings say why."


def _contradicting(bars: BarReport) -> str:
    names = some_of(bars.contradicting)
    return f"Cameras that do not stand where the calibration has them: {names}."


def _against_limit(acceptance: AcceptanceReport, bars: BarReport) -> tuple[str, str, str]:
    """The decision after ISO 14253-1, where the user stated a limit."""
    largest = number(bars.max_abs_error_mm, 3)
    if acceptance.verdict == "pass":
        said = f"All {plural(bars.n, 'measured length')} keep the limit {acceptance.words}, doubt included"
        return "PASS", GOOD, f"{said}; the largest error is {largest} mm."
    if acceptance.verdict == "fail":
        failed = [x for x in acceptance.lengths if x.verdict == "fail"]
        names = ", ".join(f"{x.bar} {x.start} to {x.end}" for x in failed[:4])
        return "FAIL", BAD, f"The limit {acceptance.words} is exceeded beyond doubt: {names}."
    why = f" ({doubts_in_words(acceptance)})" if acceptance.doubts else ""
    if acceptance.verdict == "cannot tell":
        said = f"The limit {acceptance.words} is neither proven nor refuted{why}"
        return "CANNOT TELL", CAUTION, f"{said}; the largest error is {largest} mm."
    return "NO DATA", CAUTION, "The bars could not be judged; the findings say why."


def _verdict(sheet: Sheet, box: Box, title: str, word: str, colour: str, sentence: str) -> None:
    """A verdict: a solid block with the word, the sentence beside it."""
    block = Box(box.x, box.y, 52.0, box.height)
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
    """Eight figures: value, unit, name, note."""
    rig, quality, residuals = result.rig, result.rig.quality, result.residuals
    used, total = int(residuals.used.sum()), len(residuals.used)
    relative = rig.scale.relative_uncertainty
    scale = None if relative is None else relative * _TYPICAL_MM
    sigmas = [camera.sigma for camera in rig.cameras if camera.sigma is not None]
    centre = max((float(np.linalg.norm(s.centre_mm)) for s in sigmas), default=None)
    turn = max((float(np.linalg.norm(s.rotation_deg)) for s in sigmas), default=None)
    left_out = f"of {count(total)}, {number(100 * (1 - used / total), 1)} % left out" if total else "none recorded"
    spheres = result.spheres
    radius = float(np.mean([s.radius_mm for s in spheres])) if spheres else None
    return [
        (str(len(rig.cameras)), f"of {len(result.camera_ids)}", "Cameras placed", "of those with observations"),
        (number(quality.rms_px, 4), "px", "Residuals, rms", f"mean length {number(quality.mean_px, 4)} px"),
        (number(quality.sigma0, 3), "", "Sigma0, a posteriori", "1 as assumed; px if none assumed"),
        (
            "none" if not result.has_scale else NONE if scale is None else f"±{significant(scale)}",
            "mm on 500 mm" if scale is not None else "", "Scale" + _SOURCES.get(rig.scale.source, ""),
            _scale_note(result),
        ),
        (count(used), "", "Observations used", left_out),
        (significant(centre), result.unit, "Camera centres, largest sd", "all three axes, k = 1"),
        (significant(turn), "deg", "Rotations, largest sd", "all three axes, k = 1"),
        (
            number(radius, 2), result.unit if spheres else "", "Ball radius, mean",
            f"of {plural(len(spheres), 'sphere')}",
        ),
    ]  # fmt: skip


def _scale_note(result: Result) -> str:
    """What the scale's uncertainty holds: that of a print assumes a perfect one."""
    if not result.has_scale:
        return "lengths are arbitrary units"
    if result.rig.scale.source == "target_spacing":
        return "k = 1; perfect prints assumed"
    return "standard uncertainty, k = 1"


def _findings(document: Document, result: Result) -> None:
    document.begin_section("Findings", 20.0, new_page=False)
    findings = sorted_findings(result.rig.quality.findings)
    document.y += 1.0
    if not findings:
        document.paragraph("None: there is nothing to remark on this calibration.")
    for finding in findings:
        add_finding(document, finding)


def sorted_findings(findings: tuple[Finding, ...]) -> list[Finding]:
    """Errors first, then warnings, then the rest."""
    order = ("error", "warning", "info")
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def add_finding(document: Document, finding: Finding) -> None:
    """A finding: severity, message, hint and the ids concerned."""
    indent = 20.0
    width = document.width - indent
    where = f"Concerns: {some_of(finding.where, 120)}." if finding.where else ""
    message, hint = finding_words(finding)
    parts = [(message, BODY_PT, "#1a1a1a"), (hint, BODY_PT, SOFT), (where, SMALL_PT, SOFT)]
    lines = [(line, size, colour) for text, size, colour in parts for line in wrap(text, width, size)]
    document.need(min(len(lines), 4) * leading(BODY_PT) + 2.0)
    colour = SEVERITY[finding.severity]
    first = document.y + leading(BODY_PT)
    document.sheet.fill(Box(document.left, document.y + 0.6, 1.2, leading(BODY_PT)), colour)
    document.sheet.text(document.left + 2.6, first, finding.severity.capitalize(), BODY_PT, bold=True, colour=colour)
    for line, size, ink in lines:
        document.need(leading(size))
        document.y += leading(size)
        document.sheet.text(document.left + indent, document.y, line, size, colour=ink)
    document.y += 2.2


def _origin(document: Document, result: Result) -> None:
    document.begin_section("Where this result comes from", 28.0, new_page=False)
    software = result.software
    details = "; ".join(f"{key} {value}" for key, value in software.details)
    rows = [
        ("Calibrated with", f"{software.name} {software.version}" + (f"; {details}" if details else "")),
        ("Images taken", images_taken(result)),
        ("Input, SHA-256", result.rig.input_sha256 or "not given"),
        ("World frame", f"frame of camera {result.rig.reference_camera}: x right, y down, z along its optical axis"
         if result.rig.reference_camera else "none, no camera is placed"),
        ("Uncertainties", "standard uncertainties (k = 1) unless a coverage factor is stated"),
    ]  # fmt: skip
    document.y += 1.0
    for name, text in rows:
        lines = wrap(text, document.width - 32.0, SMALL_PT)
        document.need(len(lines) * leading(SMALL_PT))
        document.y += leading(SMALL_PT)
        document.sheet.text(document.left, document.y, name, SMALL_PT, colour=SOFT)
        last = document.sheet.lines(document.left + 32.0, document.y, lines, SMALL_PT)
        document.y = max(document.y, last - leading(SMALL_PT)) + 0.6


def add_signature(document: Document) -> None:
    """The last section: who assessed this report, with lines to sign on."""
    document.begin_section("Assessment", 34.0, new_page=False)
    document.paragraph(
        "This report was made by the program from the files named under Software and hashes. Whoever signs has read "
        "the verdicts, the findings and the departures, and decides on the rig's use."
    )
    document.box(18.0)
    y = document.y
    for box, name in zip(Box(document.left, y, document.width, 0.0).grid(1, 3, 8.0), _SIGNED, strict=True):
        document.sheet.rule(box.x, box.x + box.width, y - 3.5, SOFT)
        document.sheet.text(box.x, y, name, TINY_PT, colour=SOFT)
