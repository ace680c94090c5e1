"""findings.json: the values of the findings in the rig.json and verification.json beside it.

Those two have findings in English words. What a report or the window needs to say them in another language, and to
offer repairs, is here. A finding takes its values back where they make the very words that the file has.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from spherecal.base.messages.values import as_json, from_json
from spherecal.data.findings import AdvisedRepair, Finding
from spherecal.files.json_file import JsonValue, read_json

FINDINGS_FILE = "findings.json"
FORMAT = "spherecal/findings"
VERSION = 1


def findings_document(findings: Sequence[Finding]) -> dict[str, Any] | None:
    """The contents of findings.json, None where it would be empty: findings that came without values have no entry."""
    known = [finding for finding in findings if finding.written is None]
    if not known:
        return None
    return {"format": FORMAT, "version": VERSION, "findings": [_entry(one) for one in dict.fromkeys(known)]}


def _entry(finding: Finding) -> dict[str, Any]:
    return {
        "code": finding.code,
        "kind": finding.kind,
        "values": {name: as_json(value) for name, value in finding.values.items()},
        "where": list(finding.where),
        "repairs": [{"kind": repair.kind, "target": repair.target} for repair in finding.repairs],
    }


def read_findings(folder: Path) -> tuple[Finding, ...]:
    """The findings in a folder's findings.json, of severity info; none where there is no such file.

    InputError where it is damaged. Those that this version has no words for are left out.
    """
    path = folder / FINDINGS_FILE
    if not path.exists():
        return ()
    entries = read_json(path, FORMAT, VERSION).fields(("findings",))["findings"].items()
    return tuple(finding for entry in entries if (finding := _read(entry)) is not None)


def _read(entry: JsonValue) -> Finding | None:
    f = entry.fields(("code", "kind", "values", "where", "repairs"))
    named = f["values"].as_object()
    where = tuple(item.prose() for item in f["where"].items())
    repairs = tuple(_read_repair(item) for item in f["repairs"].items())
    try:
        values = {name: from_json(value) for name, value in named.items()}
        finding = Finding(f["code"].prose(), "info", values, where, repairs, f["kind"].prose())
        hash(finding)  # its words, which another version's values may not make
    except (KeyError, TypeError, ValueError, RecursionError):
        return None
    return finding


def _read_repair(value: JsonValue) -> AdvisedRepair:
    f = value.fields(("kind", "target"))
    return AdvisedRepair(f["kind"].choice("leave-out", "split", "swap"), f["target"].prose())


def with_values(findings: Sequence[Finding], folder: Path) -> tuple[Finding, ...]:
    """Findings of a file of this folder, with the values that its findings.json has for them."""
    known = {replace(finding, severity="info"): finding for finding in read_findings(folder)}
    found = [(finding, known.get(replace(finding, severity="info"))) for finding in findings]
    return tuple(one if same is None else replace(same, severity=one.severity) for one, same in found)
