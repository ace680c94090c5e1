"""What the report says, apart from its layout: sections of paragraphs and tables, for PDF, HTML and JSON alike."""

from dataclasses import dataclass
from typing import Any

from spherecal.data.findings import Finding
from spherecal.files.findings_file import FINDING
from spherecal.files.json_file import software_entry
from spherecal_documents.report.language import finding_words, label
from spherecal_documents.report.sections_bars import bar_sections
from spherecal_documents.report.sections_rig import rig_sections
from spherecal_documents.report.tables import Section
from spherecal_documents.report.verdict_page import (
    calibration_verdict,
    key_figures,
    sorted_findings,
    verification_verdict,
)
from spherecal_rigs.result_folder import Result

FORMAT = "spherecal/report"
VERSION = 1


@dataclass(frozen=True)
class Verdict:
    """A verdict: what it is on, its word, colour and sentence."""

    title: str
    word: str
    colour: str
    sentence: str


@dataclass(frozen=True)
class Content:
    """The report's content, verdicts first.

    Each of the key figures has value, unit, name and note as printed. Findings are as rig.json has them, in the
    report's language.
    """

    verdicts: tuple[Verdict, ...]
    figures: tuple[tuple[str, str, str, str], ...]
    findings: tuple[dict[str, Any], ...]
    sections: tuple[Section, ...]

    def section(self, key: str) -> Section | None:
        """The section with this key, or None."""
        return next((section for section in self.sections if section.key == key), None)


def make_content(result: Result) -> Content:
    """All that the report says of a result."""
    verdicts = (
        Verdict(label("report-calibration"), *calibration_verdict(result)),
        Verdict(label("report-verification-with-reference-bars"), *verification_verdict(result)),
    )
    findings = [_entry(f) for f in sorted_findings(result.rig.quality.findings)]
    if result.bars is not None:
        findings += [{**_entry(f), "of": "verification"} for f in sorted_findings(result.bars.findings)]
    sections = (*rig_sections(result), *bar_sections(result))
    return Content(verdicts, tuple(key_figures(result)), tuple(findings), sections)


def _entry(finding: Finding) -> dict[str, Any]:
    message, hint = finding_words(finding)
    return {**FINDING.entry(finding), "message": message, "hint": hint}


def content_json(content: Content, result: Result) -> dict[str, Any]:
    """The report as data: verdicts, key figures, findings, and every table with its numbers as printed."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "verdicts": [{"of": v.title, "verdict": v.word, "sentence": v.sentence} for v in content.verdicts],
        "key_figures": [
            {"name": name, "value": value, "unit": unit, "note": note} for value, unit, name, note in content.figures
        ],
        "findings": list(content.findings),
        "sections": [
            {
                "key": section.key,
                "title": section.title,
                "paragraphs": list(section.paragraphs),
                "tables": [
                    {
                        "title": t.title,
                        "columns": [c.replace("\n", " ") for c in t.columns],
                        "rows": [list(r) for r in t.rows],
                    }
                    for t in section.tables
                ],
            }
            for section in content.sections
        ],
        "input_sha256": result.rig.input_sha256,
        "software": software_entry(None),
    }
