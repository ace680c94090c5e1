"""Sentences in files: the English words for people and older readers, and beside them the phrase they are made of."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase, Value
from spherecal_files.codec import Field, field, free, optional, prose, record


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
