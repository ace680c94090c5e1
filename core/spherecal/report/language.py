"""The report's language: its texts are phrases of the catalogue (resources/messages). Numbers keep their point."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import LANGUAGES, Field, fill, parsed, phrase, table
from spherecal.base.messages.values import Phrase, Value
from spherecal.data.findings import Finding

# The sentences of verification.json that hold figures: the file has their English words alone.
_WRITTEN = ("departure-", "decision-", "remedy-")
_now: ContextVar[str] = ContextVar("language", default="en")


@contextmanager
def speaking(language: str) -> Iterator[None]:
    """Reports made within are in this language; InputError for one that is not available."""
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


def word(keys: Mapping[str, str], name: str) -> str:
    """The word for a name that a file has, by the keys of those that are known; another name as it is."""
    return label(keys[name]) if name in keys else name


def written(text: str) -> str:
    """A sentence of verification.json in the report's language; one of another version stays as it is."""
    for key, pattern in _patterns():
        if found := pattern.fullmatch(text):
            return fill(table(_now.get())["phrases"][key], found.groupdict(), _now.get())
    return text


@cache
def _patterns() -> tuple[tuple[str, re.Pattern[str]], ...]:
    words = table("en")["phrases"]
    return tuple((key, _pattern(words[key])) for key in words if key.startswith(_WRITTEN))


def _pattern(template: str) -> re.Pattern[str]:
    pieces = (f"(?P<{piece.name}>.+?)" if isinstance(piece, Field) else re.escape(piece) for piece in parsed(template))
    return re.compile("".join(pieces))


def finding_words(finding: Finding) -> tuple[str, str]:
    """A finding's message and hint in the report's language."""
    return finding.words("message", _now.get()), finding.words("hint", _now.get())
