"""The report's language: its texts are phrases of the catalogue (resources/messages). Numbers keep their point."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import LANGUAGES, phrase
from spherecal.base.messages.values import Phrase, Value
from spherecal.data.findings import Finding
from spherecal_files.findings_file import Sentence

_now: ContextVar[str] = ContextVar("language", default="en")


@contextmanager
def speaking(language: str) -> Iterator[None]:
    """Reports made within are in this language: en, de or zh_CN."""
    if language not in LANGUAGES:
        raise InputError(Phrase("error-report-language", {"language": language, "names": list(LANGUAGES)}))
    token = _now.set(language)
    try:
        yield
    finally:
        _now.reset(token)


def language_now() -> str:
    """The language that reports are made in."""
    return _now.get()


def label(key: str, /, **values: Value) -> str:
    """A text of the report by its key in the catalogue, in the report's language."""
    return phrase(Phrase(key, values), _now.get())


def columns(keys: str, /, **values: Value) -> tuple[str, ...]:
    """Headings: of each word, the label `report-WORD` with these values; a word after `=` as it is, `_` for a blank."""
    return tuple(
        key[1:].replace("_", " ") if key[0] == "=" else label(f"report-{key}", **values) for key in keys.split()
    )


def word(keys: Mapping[str, str], name: str) -> str:
    """The word for a name that a file has, by the keys of those that are known; another name as it is."""
    return label(keys[name]) if name in keys else name


def written(sentence: Sentence) -> str:
    """A sentence of a file in the report's language; as it was written where the file has no phrase for it."""
    return sentence.text if sentence.phrase is None else phrase(sentence.phrase, _now.get())


def finding_words(finding: Finding) -> tuple[str, str]:
    """A finding's message and hint in the report's language."""
    return finding.words("message", _now.get()), finding.words("hint", _now.get())
