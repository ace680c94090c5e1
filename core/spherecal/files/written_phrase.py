"""Sentences in files: the English words for people and older readers, and beside them the phrase they are made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase, as_json, from_json
from spherecal.files.json_file import JsonValue


@dataclass(frozen=True)
class Sentence:
    """A sentence as a file has it, and the phrase that makes these words; None in files of other versions."""

    text: str
    phrase: Phrase | None = None


def sentence_entry(name: str, said: Phrase | None) -> dict[str, Any]:
    """The fields of a sentence: `name` with its words, empty for none, and `name`_phrase."""
    return {name: "" if said is None else phrase(said), f"{name}_phrase": None if said is None else as_json(said)}


def read_sentence(text: JsonValue, written: JsonValue | None) -> Sentence:
    """A sentence with the phrase beside it, where that makes the very words that the file has."""
    words = text.prose()
    if written is None:
        return Sentence(words)
    f = written.fields(("phrase", "values"))
    code = {"phrase": f["phrase"].prose(), "values": f["values"].as_object()}
    try:
        found = from_json(code)
        if isinstance(found, Phrase) and phrase(found) == words:
            return Sentence(words, found)
    except (KeyError, TypeError, ValueError, RecursionError):  # of another version
        pass
    return Sentence(words)


def read_sentences(texts: JsonValue, written: JsonValue | None) -> tuple[Sentence, ...]:
    """A list of sentences with the list of their phrases beside it; without them where that is not as long."""
    words = texts.items()
    beside: Sequence[JsonValue | None] = [None] * len(words) if written is None else written.items()
    if len(beside) != len(words):
        beside = [None] * len(words)
    return tuple(read_sentence(text, one) for text, one in zip(words, beside, strict=True))
