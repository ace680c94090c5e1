"""The report's language: English texts are the keys of resources/translations/report_LANGUAGE.json.

All that a report prints passes `said`; a text that holds figures or names is known by its template, `{a}` and so on
standing for them. What is not known there stays English. Numbers keep their point, as in files and certificates.
"""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Any

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import LANGUAGES
from spherecal.base.resources import resource_path
from spherecal.data.findings import Finding

# Codes, hashes and names that other programs read.
_DATA = ("format", "version", "key", "severity", "code", "where", "value", "unit", "input_sha256", "software", "of")

_FEW_LETTERS = 12
_FIELD = re.compile(r"\{(\w+)\}")
_now: ContextVar[str] = ContextVar("language", default="en")


class Said(str):
    """A text in the report's language already."""

    __slots__ = ()


@contextmanager
def speaking(language: str) -> Iterator[None]:
    """Reports made within are in this language; InputError for one that is not spoken."""
    if language not in LANGUAGES:
        raise InputError(f'The report does not speak "{language}".', f"Use one of {', '.join(LANGUAGES)}.")
    token = _now.set(language)
    try:
        yield
    finally:
        _now.reset(token)


def language_now() -> str:
    """The language that reports are made in."""
    return _now.get()


def said(text: str) -> str:
    """The text in the report's language, as far as it is known there."""
    if isinstance(text, Said) or _now.get() == "en":
        return text
    return Said("\n".join(_said(line, _now.get()) for line in text.split("\n")))


@cache
def _said(text: str, language: str) -> str:
    exact, templates = _catalogue(language)
    if text in exact:
        return exact[text]
    for pattern, translated in templates:
        found = pattern.fullmatch(text)
        if found is not None:
            return translated.format(**{name: _said(value, language) for name, value in found.groupdict().items()})
    return text


def known(text: str, language: str) -> bool:
    """Whether a text has its translation, for the tests."""
    exact, templates = _catalogue(language)
    return text in exact or any(pattern.fullmatch(text) for pattern, _ in templates)


@cache
def _catalogue(language: str) -> tuple[Mapping[str, str], list[tuple[re.Pattern[str], str]]]:
    """Texts as they stand, and templates, those with most letters first."""
    path = resource_path("translations", f"report_{language}.json")
    texts: dict[str, str] = json.loads(path.read_text(encoding="utf-8"))
    templates = sorted((key for key in texts if _FIELD.search(key)), key=lambda key: -len(_FIELD.sub("", key)))
    exact = {key: text for key, text in texts.items() if not _FIELD.search(key)}
    return exact, [(_pattern(key), texts[key]) for key in templates]


def _pattern(template: str) -> re.Pattern[str]:
    """The texts that a template stands for.

    One of few letters would fit half of all sentences ("{a} to {b}"): its fields hold figures and names such as C01, no
    words, but for a field called `any`.
    """
    parts = _FIELD.split(template)
    short = sum(letter.isalpha() for part in parts[::2] for letter in part) < _FEW_LETTERS
    pieces = []
    for i, part in enumerate(parts):
        field = r"(?:(?![a-z]{3}).)+?" if short and part != "any" else ".+?"
        pieces.append(re.escape(part) if i % 2 == 0 else f"(?P<{part}>{field})")
    return re.compile("".join(pieces))


def finding_words(finding: Finding) -> tuple[str, str]:
    """A finding's message and hint in the report's language."""
    message, hint = (finding.words(part, _now.get()) for part in ("message", "hint"))
    return Said(message), Said(hint)


def said_in_data(value: Any) -> Any:
    """A JSON document with its sentences, titles and headings in the report's language; codes and names stay."""
    if isinstance(value, str):
        return str(said(value))
    if isinstance(value, dict):
        return {key: item if key in _DATA else said_in_data(item) for key, item in value.items()}
    return [said_in_data(item) for item in value] if isinstance(value, list) else value
