"""findings.json: values of the findings of rig.json and verification.json, for other languages and repairs.

A finding takes its values back where they make the very words that the file has.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase, Value
from spherecal.data.findings import AdvisedRepair, Finding, Severity
from spherecal_files.codec import Field, FileFormat, choice, field, free, items, only, optional, prose, record


@dataclass(frozen=True)
class Sentence:
    """A sentence as a file has it, and the phrase that makes these words; None in files of other versions."""

    text: str
    phrase: Phrase | None = None


def as_json(value: Value) -> Any:
    """A value as a JSON document has it; numbers that are not finite go by name."""
    if isinstance(value, Phrase):
        return {"phrase": value.key, "values": {name: as_json(item) for name, item in value.values.items()}}
    if isinstance(value, tuple):
        return [as_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {"number": str(value)}
    return value


def from_json(document: Any) -> Value:
    """The value that `as_json` wrote."""
    if isinstance(document, list):
        return tuple(from_json(item) for item in document)
    if not isinstance(document, dict):
        return document
    if set(document) == {"number"}:
        return float(str(document["number"]))
    phrase, values = document.get("phrase"), document.get("values")
    if set(document) != {"phrase", "values"} or not isinstance(phrase, str) or not isinstance(values, dict):
        raise ValueError("neither a number nor a phrase")
    return Phrase(phrase, {str(name): from_json(item) for name, item in values.items()})


PHRASE = replace(
    record(
        "The same for other languages; may be missing.",
        dict,
        field("phrase", prose("The sentence's code.")),
        field("values", free("Its values by name.")),
    ),
    entry=as_json,
)


def sentence_fields(key: str, about: str, of: Callable[[Any], Phrase | None]) -> tuple[Field, ...]:
    """The fields of a sentence: `key` with its words, empty for none, and `key`_phrase."""

    def words(one: object) -> str:
        return "" if (said := of(one)) is None else phrase(said)

    return field(key, prose(about), words, key), optional(f"{key}_phrase", PHRASE, of, f"{key}_phrase")


def sentence(words: str, written: Mapping[str, Any] | None) -> Sentence:
    """A sentence with the phrase beside it, where that makes the very words that the file has."""
    try:
        found = None if written is None else from_json(dict(written))
        if isinstance(found, Phrase) and phrase(found) == words:
            return Sentence(words, found)
    except (KeyError, TypeError, ValueError, RecursionError):  # of another version
        pass
    return Sentence(words)


def sentences(words: Sequence[str], written: Sequence[Mapping[str, Any]] | None) -> tuple[Sentence, ...]:
    """Sentences with the list of their phrases beside them, if there is one."""
    beside = written if written is not None and len(written) == len(words) else [None] * len(words)
    return tuple(sentence(*pair) for pair in zip(words, beside, strict=True))


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
