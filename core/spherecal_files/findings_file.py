"""findings.json: values of the findings of rig.json and verification.json, for other languages and repairs.

A finding takes its values back where they make the very words that the file has.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from spherecal.data.findings import AdvisedRepair, Finding, Severity
from spherecal_files.codec import FileFormat, choice, field, free, items, only, prose, record
from spherecal_files.written_phrase import as_json, from_json

FINDINGS_FILE = "findings.json"


def _finding(values: Mapping[str, Any], **others: Any) -> Finding | None:
    try:
        finding = Finding(**others, severity="info", values={name: from_json(value) for name, value in values.items()})
        hash(finding)  # its words, which another version's values may not make
    except (KeyError, TypeError, ValueError, RecursionError):
        return None
    return finding


def as_written(severity: Severity, code: str, message: str, hint: str, where: tuple[str, ...] = ()) -> Finding:
    """A finding of a file, whose values are not known: its message and hint stay as they are."""
    return Finding(code, severity, {}, where, written=(message, hint))


FINDING = record(
    "A finding.",
    as_written,
    field("severity", choice("Its severity.", ("info", "warning", "error"))),
    field("code", prose("Its code, for programs.")),
    field("message", prose("What was found, in English.")),
    field("hint", prose("What to do.")),
    field("where", items("Ids of the cameras, placements and targets that it is about.", prose(""))),
)
"""A finding as rig.json, verification.json and check.json have it."""
_REPAIR = record(
    "",
    AdvisedRepair,
    field("kind", choice("The repair.", ("leave-out", "split", "swap"))),
    field("target", prose("What is repaired.")),
)
_VALUES = replace(free("Values by name."), entry=lambda values: {name: as_json(values[name]) for name in values})
_FINDING = record(
    "",
    _finding,
    field("code", prose("As in rig.json.")),
    field("kind", prose("Which of the sentences of this code.")),
    field("values", _VALUES),
    field("where", items("As in rig.json.", prose(""))),
    field("repairs", items("Repairs that may help.", _REPAIR)),
)
FINDINGS = FileFormat(
    "spherecal/findings",
    FINDINGS_FILE,
    "Values of the findings in rig.json and verification.json, for other languages; may be missing.",
    only("findings", items("A finding's words are made of its code, kind and values.", _FINDING)),
)


def findings_document(findings: Sequence[Finding]) -> dict[str, Any] | None:
    """The contents of findings.json, None where it would be empty: findings that came without values have no entry."""
    known = [finding for finding in findings if finding.written is None]
    return FINDINGS.document(list(dict.fromkeys(known))) if known else None


def read_findings(folder: Path) -> tuple[Finding, ...]:
    """The findings in a folder's findings.json, of severity info, for which there are words; none without a file."""
    path = folder / FINDINGS_FILE
    if not path.exists():
        return ()
    return tuple(finding for finding in FINDINGS.read(path) if finding is not None)


def with_values(findings: Sequence[Finding], folder: Path) -> tuple[Finding, ...]:
    """Findings of a file of this folder, with the values that its findings.json has for them."""
    known = {replace(finding, severity="info"): finding for finding in read_findings(folder)}
    found = [(finding, known.get(replace(finding, severity="info"))) for finding in findings]
    return tuple(one if same is None else replace(same, severity=one.severity) for one, same in found)
