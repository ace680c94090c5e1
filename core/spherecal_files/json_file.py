"""Strict reading of JSON files: every complaint names the file, the place in it and what was expected there."""

import difflib
import itertools
import json
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from datetime import date, datetime
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from spherecal import __version__
from spherecal.base.errors import InputError, Words, advice
from spherecal.base.file_reading import id_problem, read_file
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import LONGEST_NAME, name_problem
from spherecal_files.filesystem import read_below, shown_name

# 100 cameras times 1000 placements with an image path each are 7 MB.
_MOST_BYTES = 64 << 20
# The same has 100 000 paths; a file of 2 million values takes 3 s and 400 MB to read.
_MOST_VALUES = 2_000_000
_DEEPEST = 100  # our files need 6
MOST_CAMERAS = 1000  # the largest rigs that we know of have some hundred
_LONGEST_LINE = 10_000  # of tables; eight names of 100 characters in UTF-8 and as many numbers are 4000
_MOST_UNKNOWN = 50  # fields that are compared with known names
_LONGEST_TEXT = 1000
# "focal_lenght_mm" scores 0.93 against the right name, unrelated keys of our files at most 0.8 against each other.
_MISSPELT = 0.85
# No quantity of ours is larger, and products of a few such numbers stay finite.
_MOST = 1e30
_COLDEST_C, _HOTTEST_C = -100.0, 200.0
_REPEATED = object()
_VERSION = re.compile(r"([1-9][0-9]{0,5})(?:\.([0-9]{1,6}))?")
_MOST_VERSION = 10**6

Text = TypeVar("Text", bound=str)
read_bytes, printable = read_file, shown_name


def json_bytes(document: Mapping[str, Any]) -> bytes:
    """A JSON document as this program prints it: UTF-8, indented by one, never NaN."""
    return (json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def finite(value: ArrayLike | None) -> Any:
    """Numbers for JSON: Python floats in (nested) lists, `None` for what is absent or not finite."""
    if value is None:
        return None
    array = np.asarray(value, dtype=float)
    if array.ndim:
        return [finite(item) for item in array]
    return float(array) if np.isfinite(array) else None


def plain(value: object) -> object:
    """Dataclasses, arrays, paths, dates as JSON knows them; a number that is not finite is null."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if is_dataclass(value) and not isinstance(value, type):
        return plain_fields(value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path | date):
        return value.isoformat() if isinstance(value, date) else str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def plain_fields(record: Any, names: str = "") -> dict[str, object]:
    """The fields of a dataclass by name, or only those of a text of names, each as `plain` makes it."""
    wanted = names.split() or [field.name for field in fields(record)]
    return {name: plain(getattr(record, name)) for name in wanted}


def software_entry(details: Mapping[str, Any] | None) -> dict[str, Any]:
    """Who wrote a file: name and version of this program, and the details given (timestamps go here alone)."""
    return {"name": "SphereCal", "version": __version__, **(details or {})}


def shown_number(value: object) -> Words:
    """A number for a message, cut short."""
    try:
        return f"{value!r:.30}"
    except ValueError:  # Python's own limit, 4300 digits
        return Phrase("json-long-number")


@dataclass(frozen=True)
class JsonValue:
    """A value out of a JSON file that knows its place there.

    Its methods return checked contents or raise InputError, which names file, place and what was expected. `null`
    counts as absent. `later`: of a file of a later minor version, in which unknown fields are no misspellings.
    """

    value: object
    file: Path
    place: str = ""
    later: bool = False

    def error(self, problem: Words, hint: Words = "") -> InputError:
        """An InputError about this value, to be raised by the caller."""
        values = {"file": self.file, "place": self.place or Phrase("the-file"), "problem": problem}
        return InputError(Phrase("error-in-file", values), hint or advice(problem))

    def at(self, key: str | int, value: object) -> "JsonValue":
        """The value of a field or list item of this one."""
        if isinstance(key, int):
            return JsonValue(value, self.file, f"{self.place}[{key}]", self.later)
        shown = key if key.isprintable() and len(key) <= LONGEST_NAME else printable(key)
        return JsonValue(value, self.file, f"{self.place}.{shown}" if self.place else shown, self.later)

    def _wrong(self, expected: Words) -> InputError:
        kinds = {dict: Phrase("json-object"), list: Phrase("json-list"), bool: Phrase("json-truth"), type(None): "null"}
        found = kinds.get(type(self.value)) or shown_number(self.value)
        if isinstance(self.value, str):
            found = printable(self.value)
        return self.error(Phrase("problem-kind", {"expected": expected, "found": found}))

    def as_object(self) -> dict[str, object]:
        """An object as it is, unchecked."""
        if not isinstance(self.value, dict):
            raise self._wrong(Phrase("json-object"))
        return self.value

    def fields(self, required: Collection[str] = (), optional: Collection[str] = ()) -> dict[str, "JsonValue"]:
        """The required fields and those optional ones that are there; others are ignored unless they look misspelt."""
        given = {key: value for key, value in self.as_object().items() if value is not None}
        for key in required:
            if key not in given:
                raise self.error(Phrase("problem-lacks", {"key": key}))
        absent = [key for key in optional if key not in given]
        known = {*required, *optional}
        unknown = () if self.later or not absent else (key for key in given if key not in known)
        for key in itertools.islice(unknown, _MOST_UNKNOWN):
            if len(key) <= LONGEST_NAME and (meant := difflib.get_close_matches(key, absent, 1, _MISSPELT)):
                raise self.error(Phrase("problem-unknown-field", {"field": printable(key), "meant": meant[0]}))
        return {key: self.at(key, given[key]) for key in (*required, *optional) if key in given}

    def entries(self) -> dict[str, "JsonValue"]:
        """An object whose keys are names, by name."""
        given = self.as_object()
        for key in given:
            if problem := name_problem(key):
                raise self.error(Phrase("problem-bad-name", {"name": printable(key), "problem": problem}))
        return {key: self.at(key, value) for key, value in given.items()}

    def items(self, length: int | None = None, least: int = 0, most: int = _MOST_VALUES) -> list["JsonValue"]:
        """The values of a list, `least` to `most` or exactly `length` of them."""
        if not isinstance(self.value, list):
            raise self._wrong(Phrase("json-list"))
        n = len(self.value)
        if n < least or length not in (None, n):
            key, wanted = ("problem-too-few", least) if length is None else ("problem-count", length)
            raise self.error(Phrase(key, {"n": wanted, "found": n}))
        if n > most:
            raise self.error(Phrase("problem-too-many", {"found": n, "most": most}))
        return [self.at(i, value) for i, value in enumerate(self.value)]

    def number(self, least: float = -_MOST, most: float = _MOST, unit: Words = "") -> float:
        """A finite number."""
        if not isinstance(self.value, (int, float)) or isinstance(self.value, bool):
            raise self._wrong(Phrase("json-number"))
        if not least <= self.value <= most:
            values = {"least": least, "most": most, "unit": unit, "found": shown_number(self.value)}
            raise self.error(Phrase("problem-least" if most == _MOST > self.value else "problem-range", values))
        return float(self.value)

    def positive(self, unit: str = "") -> float:
        """A finite number above zero."""
        number = self.number()
        if not number > 0:
            raise self.error(Phrase("problem-positive", {"unit": unit, "found": number}))
        return number

    def integer(self, least: int = -(2**53), most: int = 2**53) -> int:
        """A whole number within `least` .. `most`; 6.0 counts as 6."""
        number = self.number(least, most)
        if number != int(number):
            raise self.error(Phrase("problem-whole", {"found": number}))
        return int(number)

    def numbers(self, length: int) -> list[float]:
        """A list of `length` finite numbers."""
        found: list[Any] = self.value if isinstance(self.value, list) else []
        plain = found and all(type(one) in (float, int) and -_MOST <= one <= _MOST for one in found)
        if plain and len(found) == length:
            return [float(one) for one in found]
        return [item.number() for item in self.items(length)]

    def matrix(self, rows: int, columns: int) -> list[list[float]]:
        """A list of `rows` lists of `columns` finite numbers."""
        return [row.numbers(columns) for row in self.items(rows)]

    def text(self) -> str:
        """A text on one line, at most 1000 characters long."""
        text = self.prose()
        if not text.isprintable() or len(text) > _LONGEST_TEXT:
            raise self.error(Phrase("problem-one-line", {"most": _LONGEST_TEXT}))
        return text

    def prose(self) -> str:
        """A text of any length and form."""
        if not isinstance(self.value, str):
            raise self._wrong(Phrase("json-text"))
        return self.value

    def serial(self) -> str:
        """A serial number: a text on one line, or a whole number (6.0 counts as 6) as its digits."""
        whole = isinstance(self.value, int) or (isinstance(self.value, float) and self.value.is_integer())
        if whole and not isinstance(self.value, bool):
            return str(self.integer(0))
        return self.text()

    def name(self) -> str:
        """A name: not empty, no commas, quotation marks, slashes, line ends or control characters."""
        name = self.prose()
        if problem := name_problem(name):
            raise self.error(Phrase("problem-name", {"problem": problem, "name": printable(name)}))
        return name

    def digest(self) -> str:
        """A SHA-256 in hexadecimal digits, or an empty text."""
        text = self.prose()
        if len(text) not in (0, 64) or not set(text) <= set("0123456789abcdef"):
            raise self.error(Phrase("problem-sha256"))
        return text

    def id(self) -> str:
        """An id, which may become a file name: letters, digits, `-`, `_`, `.` (not first), at most 64 characters."""
        text = self.prose()
        if problem := id_problem(text):
            raise self.error(Phrase("problem-id", {"problem": problem, "name": printable(text)}))
        return text

    def choice(self, *options: Text) -> Text:
        """One of the given texts."""
        for option in options:
            if self.value == option:
                return option
        raise self._wrong(Phrase("one-of", {"options": [f'"{option}"' for option in options]}))

    def time(self) -> datetime:
        """A point in time with its zone."""
        try:
            time = datetime.fromisoformat(self.text())
        except ValueError:
            raise self.error(Phrase("problem-time")) from None
        if time.tzinfo is None:
            raise self.error(Phrase("problem-time-zone"))
        return time

    def date(self) -> date:
        """A day."""
        try:
            return date.fromisoformat(self.text())
        except ValueError:
            raise self.error(Phrase("problem-date")) from None

    def celsius(self) -> float:
        """A temperature in degrees Celsius."""
        return self.number(_COLDEST_C, _HOTTEST_C, "°C")

    def boolean(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self._wrong(Phrase("json-truth"))
        return self.value


def unique(values: list[JsonValue], keys: list[str], what: str) -> None:
    """Check that no two values have the same key."""
    first: dict[str, JsonValue] = {}
    for value, key in zip(values, keys, strict=True):
        if key in first:
            said = {"what": what, "name": printable(key), "other": first[key].place}
            raise value.error(Phrase("problem-same", said))
        first[key] = value


def check_lines(path: Path, data: bytes) -> None:
    """Check that no line of a table is far longer than any of ours, before it costs memory."""
    begin = 0
    while len(data) - begin > _LONGEST_LINE:
        end = data.rfind(b"\n", begin, begin + _LONGEST_LINE)
        if end < begin:
            line = data.count(b"\n", 0, begin) + 1
            raise InputError(Phrase("error-line-long", {"file": path, "line": line, "most": _LONGEST_LINE}))
        begin = end + 1


def decode(path: Path, data: bytes) -> str:
    """The text of UTF-8 data, a byte order mark dropped; no text has zeros, but UTF-16 and packed arrays do."""
    try:
        if (wrong := data.find(b"\0")) < 0:
            return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        wrong = error.start
    raise InputError(Phrase("error-not-utf8", {"file": path, "line": data.count(b"\n", 0, wrong) + 1}))


def parse_json(data: bytes) -> object:
    """What a JSON text says, unchecked; None where it is none."""
    try:
        return json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        return None


def read_json(path: Path, format_name: str, version: int, below: Path | None = None) -> JsonValue:
    """The object in a JSON file of this `format` and `version`; links are followed unless it is `below` a folder."""
    if below is None:
        data = read_bytes(path, _MOST_BYTES)
    else:
        data = read_below(below, path.relative_to(below).as_posix(), _MOST_BYTES)
    text = decode(path, data)
    if text.count(",") + text.count("[") + text.count("{") > _MOST_VALUES:
        raise InputError(Phrase("error-too-many-values", {"file": path, "most": _MOST_VALUES}))
    try:
        document = JsonValue(json.loads(text, object_pairs_hook=_object), path)
        if not _is_strict(document.value):
            _check_strict(document)  # finds the place
    except json.JSONDecodeError as error:
        values = {"file": path, "line": error.lineno, "column": error.colno, "why": error.msg}
        whole = text.rstrip().endswith("}") or text.lstrip()[:1] not in ("{", "[", "")  # or something else altogether
        raise InputError(Phrase("error-not-json" if whole else "error-json-cut-off", values)) from None
    except RecursionError:
        raise InputError(Phrase("error-nested-json", {"file": path})) from None
    except ValueError:  # Python's own limit, 4300 digits
        raise InputError(Phrase("error-digits", {"file": path})) from None
    found = document.value.get("format") if isinstance(document.value, dict) else None
    if found != format_name:
        if isinstance(found, str):
            raise document.error(Phrase("problem-other-format", {"format": format_name, "found": printable(found)}))
        raise document.error(Phrase("problem-format", {"format": format_name}))
    major, minor = version_of(document)
    if major > version:
        given = f"{major}.{minor}" if minor else major
        raise document.error(Phrase("problem-later-version", {"given": given, "known": version}))
    return replace(document, later=minor > 0)


def _object(pairs: list[tuple[str, object]]) -> dict[object, object]:
    fields: dict[object, object] = {}
    for key, value in pairs:
        if key in fields:
            fields[_REPEATED] = key
        fields[key] = value
    return fields


def _is_strict(document: object) -> bool:
    """Whether `_check_strict` will find nothing; RecursionError for a nest deeper than `_DEEPEST`."""
    level: list[Any] = [document]
    for _ in range(_DEEPEST):
        inner: list[Any] = []
        for value in level:  # of the types that Python's reader makes, and no others
            kind = type(value)
            if kind is float:
                if not math.isfinite(value):
                    return False
            elif kind is dict:
                if _REPEATED in value:
                    return False
                inner.extend(value.values())
            elif kind is list:
                inner.extend(value)
        if not inner:
            return True
        level = inner
    raise RecursionError


def _check_strict(value: JsonValue) -> None:
    """Refuse what Python's reader lets pass: repeated keys, NaN, Infinity and numbers beyond double precision."""
    inner = value.value
    if isinstance(inner, dict):
        if _REPEATED in inner:
            raise value.error(Phrase("problem-twice", {"field": printable(str(inner[_REPEATED]))}))
        for key, item in inner.items():
            _check_strict(value.at(key, item))
    elif isinstance(inner, list):
        for i, item in enumerate(inner):
            _check_strict(value.at(i, item))
    elif isinstance(inner, float) and not math.isfinite(inner):
        raise value.error(Phrase("problem-not-finite"))


def version_of(document: JsonValue) -> tuple[int, int]:
    """The major and minor version of a file, written as 1 or "1.2"; what a minor version adds may be ignored."""
    value = document.fields(["version"])["version"]
    if isinstance(value.value, str):
        if (found := _VERSION.fullmatch(value.value)) is None:
            raise value.error(Phrase("problem-version", {"found": printable(value.value)}))
        return int(found[1]), int(found[2] or 0)
    if isinstance(value.value, float) and value.value != int(value.value) and 1 <= value.value < _MOST_VERSION:
        major, minor = repr(value.value).split(".")
        return int(major), int(minor)
    return value.integer(1), 0
