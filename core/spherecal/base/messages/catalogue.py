"""Messages in words: templates of resources/messages, filled with the values of what happened.

A template holds fields:

- `{name}` and `{name:.2f}`: a value, by Python's format. A sequence is joined by commas.
- `{names:or}`: a sequence, joined as the table `lists` says. `{places:.0f}`: each with a format.
- `{names:count}`: how many there are.
- `{count#image|images}`: the plural form that goes with a number, or with a sequence's length.
- `{text:capital}`: with a capital letter.

In a hint `[...]` encloses what names options of the command line: it is left out where there are none, or buttons. A
field without a value takes the space before it with it.
"""

import os
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

from spherecal.base.messages.values import Phrase, Value
from spherecal.base.resources import resource_path

LANGUAGES = {"en": "English", "de": "Deutsch", "zh_CN": "简体中文"}
Part = Literal["title", "message", "hint"]
_VARIABLE = "SPHERECAL_LANGUAGE"

_ONE_OR_MORE: Callable[[float], int] = lambda n: 0 if n == 1 else 1  # noqa: E731
# The number of a language's plural forms, and which of them goes with a number (as gettext's Plural-Forms).
Plural = tuple[int, Callable[[float], int]]
PLURALS: dict[str, Plural] = {"en": (2, _ONE_OR_MORE), "de": (2, _ONE_OR_MORE), "zh_CN": (1, lambda _: 0)}

_FIELD = re.compile(r"\{(\w+)(?:([#:])([^{}]*))?\}")
_OPTIONS = re.compile(r" ?\[[^\]]*\]")


@dataclass(frozen=True)
class TemplateField:
    """A field of a template: the value's name, `:` with a format, `#` with plural forms, or neither."""

    name: str
    kind: str
    spec: str


def language() -> str:
    """The language of the command line's errors and findings: what `SPHERECAL_LANGUAGE` names, English otherwise."""
    named = os.environ.get(_VARIABLE, "")
    return named if named in LANGUAGES else "en"


@cache
def table(language: str) -> dict[str, Any]:
    """A language's table: `lists`, `phrases`, and the words of every code."""
    path = resource_path("messages", f"{language}.toml")
    return tomllib.loads(path.read_text(encoding="utf-8"))


def template(code: str, kind: str, part: Part, language: str) -> str | None:
    """The words of a code; those of a kind go before those of all its kinds. None where there are none."""
    for one in dict.fromkeys((language, "en")):
        words = table(one).get(code, {})
        found = words.get(kind, {}).get(part, words.get(part)) if kind else words.get(part)
        if isinstance(found, str):
            return found
    return None


def phrase(one: Phrase, language: str = "en") -> str:
    """A phrase in words."""
    words = table(language)["phrases"].get(one.key) or table("en")["phrases"][one.key]
    return fill(words, one.values, language)


def hint_of(one: Phrase) -> Phrase | None:
    """What to do about what a phrase says: the phrase `KEY-hint` with the same values, where the table has it."""
    key = f"{one.key}-hint"
    return Phrase(key, one.values) if key in table("en")["phrases"] else None


def fill(words: str, values: Mapping[str, Value], language: str = "en", *, with_options: bool | None = None) -> str:
    """A template with its values, in words; `with_options` None where brackets are brackets."""
    out = ""
    for piece in parsed(words, with_options):
        if isinstance(piece, str):
            out += piece
            continue
        shown = _shown(values[piece.name], piece, language)
        out = out.removesuffix(" ") if not shown else out
        out += shown
    return out.strip()


@cache
def parsed(words: str, with_options: bool | None = None) -> tuple[str | TemplateField, ...]:
    """The literal text and the fields of a template, in order; `with_options` None where brackets are brackets."""
    if with_options is not None:
        words = re.sub(r"[\[\]]", "", words) if with_options else _OPTIONS.sub("", words)
    pieces: list[str | TemplateField] = []
    end = 0
    for found in _FIELD.finditer(words):
        pieces += [words[end : found.start()], TemplateField(found[1], found[2] or "", found[3] or "")]
        end = found.end()
    return (*pieces, words[end:])


def _shown(value: Value, field: TemplateField, language: str) -> str:
    if field.kind == "#":
        forms = field.spec.split("|")
        number = len(value) if isinstance(value, (tuple, str)) else value
        if not isinstance(number, (int, float)):
            raise ValueError(f"{field.name} is no number")
        return forms[min(PLURALS[language][1](number), len(forms) - 1)]
    if value is None:
        return ""
    if isinstance(value, tuple):
        return str(len(value)) if field.spec == "count" else _joined(value, field.spec, language)
    if isinstance(value, Phrase):
        value = phrase(replace(value, key=f"{value.key}-short") if field.spec == "short" else value, language)
    if isinstance(value, str):
        if field.spec == "number" and re.fullmatch(r"P\d+", value):
            return value[1:]
        return value[:1].upper() + value[1:] if field.spec == "capital" else value
    return format(value, field.spec)


def _joined(values: tuple[Value, ...], style: str, language: str) -> str:
    """A sequence; one within it, as a group of cameras, has spaces between its names."""
    styles = table(language)["lists"]
    between = styles[style] if style in styles else styles["default"]
    inner, one = TemplateField("", "", "spaces"), TemplateField("", "", "" if style in styles else style)
    return between.join(_shown(value, inner if isinstance(value, tuple) else one, language) for value in values)
