"""Strict reading of JSON files: every complaint names the file, the place in it and what was expected there."""

import difflib
import itertools
import json
import math
import re
from collections.abc import Collection
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from spherecal.base.errors import InputError
from spherecal.base.filesystem import id_problem, read_below, read_file

# 100 cameras times 1000 placements with an image path each are 7 MB.
_MOST_BYTES = 64 << 20
# The same has 100 000 paths; a file of 2 million values takes 3 s and 400 MB to read.
_MOST_VALUES = 2_000_000
_DEEPEST = 100  # our files need 6
MOST_CAMERAS = 1000  # the largest rigs that we know of have some hundred
_LONGEST_LINE = 10_000  # of tables; eight names of 100 characters in UTF-8 and as many numbers are 4000
_MOST_UNKNOWN = 50  # fields that are compared with known names
# Names become file names and table cells: no longer than common file systems allow with a suffix.
_LONGEST_NAME = 100
_NOT_IN_NAMES = '/\\,"'
# "focal_lenght_mm" scores 0.93 against the right name, unrelated keys of our files at most 0.8 against each other.
_MISSPELT = 0.85
# No quantity of ours is larger, and products of a few such numbers stay finite.
_MOST = 1e30
_COLDEST_C, _HOTTEST_C = -100.0, 200.0
_REPEATED = object()
_VERSION = re.compile(r"([1-9][0-9]{0,5})(?:\.([0-9]{1,6}))?")
_MOST_VERSION = 10**6

Text = TypeVar("Text", bound=str)


def printable(text: str, most: int = 60) -> str:
    """The text in quotation marks, shortened and escaped, fit for a one-line message."""
    shown = text if len(text) <= most else text[: most - 1] + "…"
    return '"' + "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in shown) + '"'


def shown_number(value: object) -> str:
    """A number for a message, cut short."""
    try:
        return f"{value!r:.30}"
    except ValueError:  # Python's own limit, 4300 digits
        return "a number of thousands of digits"


def name_problem(text: str) -> str | None:
    """Why a text cannot be the name of a camera, placement, bar, mark or point; None if it can."""
    if not text:
        return "is empty"
    if len(text) > _LONGEST_NAME:
        return f"is longer than {_LONGEST_NAME} characters"
    if not text.isprintable() or any(c in text for c in _NOT_IN_NAMES):
        return "contains a comma, a quotation mark, a slash, a backslash or a control character"
    if text != text.strip() or text in (".", ".."):
        return "begins or ends with a space or is only dots"
    return None


@dataclass(frozen=True)
class JsonValue:
    """A value out of a JSON file that knows where it stands; its methods return checked contents or raise InputError.

    `null` counts as absent. `later`: of a file of a later minor version, in which unknown fields are no misspellings.
    """

    value: object
    file: Path
    place: str = ""
    later: bool = False

    def error(self, problem: str, hint: str = "") -> InputError:
        """An InputError about this value, to be raised by the caller."""
        return InputError(f"{self.file}: {self.place or 'the file'} {problem}.", hint)

    def at(self, key: str | int, value: object) -> "JsonValue":
        """The value of a field or list item of this one."""
        if isinstance(key, int):
            return JsonValue(value, self.file, f"{self.place}[{key}]", self.later)
        shown = key if key.isprintable() and len(key) <= _LONGEST_NAME else printable(key)
        return JsonValue(value, self.file, f"{self.place}.{shown}" if self.place else shown, self.later)

    def _wrong(self, expected: str) -> InputError:
        kinds = {dict: "an object", list: "a list", str: "a text", bool: "true or false", type(None): "null"}
        found = kinds.get(type(self.value), "a number")
        if isinstance(self.value, str):
            found = printable(self.value)
        elif found == "a number":
            found = shown_number(self.value)
        return self.error(f"must be {expected}, but is {found}")

    def fields(self, required: Collection[str] = (), optional: Collection[str] = ()) -> dict[str, "JsonValue"]:
        """The fields of an object: all required ones and those optional ones that are there.

        Other fields are ignored, unless one looks like a misspelling of an optional field that is not there.
        """
        if not isinstance(self.value, dict):
            raise self._wrong("an object")
        given = {key: value for key, value in self.value.items() if value is not None}
        for key in required:
            if key not in given:
                raise self.error(f'lacks "{key}"')
        absent = [key for key in optional if key not in given]
        known = {*required, *optional}
        unknown = () if self.later else (key for key in given if key not in known)
        for key in itertools.islice(unknown, _MOST_UNKNOWN):
            if len(key) <= _LONGEST_NAME and (meant := difflib.get_close_matches(key, absent, 1, _MISSPELT)):
                raise self.error(f"has a field {printable(key)} that is not known", f'Is "{meant[0]}" meant?')
        return {key: self.at(key, given[key]) for key in (*required, *optional) if key in given}

    def entries(self) -> dict[str, "JsonValue"]:
        """An object whose keys are names, by name."""
        if not isinstance(self.value, dict):
            raise self._wrong("an object")
        for key in self.value:
            if problem := name_problem(key):
                raise self.error(f"has the name {printable(key)}, which {problem}")
        return {key: self.at(key, value) for key, value in self.value.items()}

    def items(self, length: int | None = None, least: int = 0, most: int = _MOST_VALUES) -> list["JsonValue"]:
        """The values of a list of exactly `length`, or of `least` to `most` values."""
        if not isinstance(self.value, list):
            raise self._wrong("a list")
        n = len(self.value)
        if n < least or length not in (None, n):
            expected = f"at least {least}" if length is None else str(length)
            raise self.error(f"must have {expected} values, but has {n}")
        if n > most:
            raise self.error(f"has {n} values, more than the {most} that such a list may have")
        return [self.at(i, value) for i, value in enumerate(self.value)]

    def number(self, least: float = -_MOST, most: float = _MOST, unit: str = "") -> float:
        """A number within `least` .. `most`; `unit` only serves the message."""
        if not isinstance(self.value, (int, float)) or isinstance(self.value, bool):
            raise self._wrong("a number")
        if not least <= self.value <= most:
            limits = f"{least:g} or more" if most == _MOST > self.value else f"from {least:g} to {most:g}"
            raise self.error(f"must be {limits} {unit}".rstrip() + f", but is {shown_number(self.value)}")
        return float(self.value)

    def positive(self, unit: str = "") -> float:
        """A finite number above zero."""
        number = self.number()
        if not number > 0:
            raise self.error(f"must be above 0 {unit}".rstrip() + f", but is {number:g}")
        return number

    def integer(self, least: int = -(2**53), most: int = 2**53) -> int:
        """A whole number within `least` .. `most`; 6.0 counts as 6."""
        number = self.number(least, most)
        if number != int(number):
            raise self.error(f"must be a whole number, but is {number:g}")
        return int(number)

    def numbers(self, length: int) -> list[float]:
        """A list of `length` finite numbers."""
        return [item.number() for item in self.items(length)]

    def matrix(self, rows: int, columns: int) -> list[list[float]]:
        """A list of `rows` lists of `columns` finite numbers."""
        return [row.numbers(columns) for row in self.items(rows)]

    def text(self) -> str:
        """A text on one line, at most 1000 characters long."""
        text = self.prose()
        if not text.isprintable() or len(text) > 1000:
            raise self.error("must be a text on one line without control characters, at most 1000 characters long")
        return text

    def prose(self) -> str:
        """A text of any length and form."""
        if not isinstance(self.value, str):
            raise self._wrong("a text")
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
            raise self.error(f"{problem}: {printable(name)}")
        return name

    def digest(self) -> str:
        """A SHA-256 in hexadecimal digits, or an empty text."""
        text = self.prose()
        if len(text) not in (0, 64) or not set(text) <= set("0123456789abcdef"):
            raise self.error("must be a SHA-256: 64 hexadecimal digits")
        return text

    def id(self) -> str:
        """An id, which may become a file name: letters, digits, `-`, `_`, `.` (not first), at most 64 characters."""
        text = self.prose()
        if problem := id_problem(text):
            raise self.error(f"{problem}: {printable(text)}", "Ids become file names.")
        return text

    def choice(self, *options: Text) -> Text:
        """One of the given texts."""
        for option in options:
            if self.value == option:
                return option
        raise self._wrong(" or ".join(f'"{option}"' for option in options))

    def time(self) -> datetime:
        """A point in time with its zone."""
        try:
            time = datetime.fromisoformat(self.text())
        except ValueError:
            raise self.error('must be a time such as "2026-11-21T09:30:00+00:00"') from None
        if time.tzinfo is None:
            raise self.error("lacks its time zone, such as +00:00")
        return time

    def celsius(self) -> float:
        """A temperature in degrees Celsius."""
        return self.number(_COLDEST_C, _HOTTEST_C, "degrees Celsius")

    def boolean(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self._wrong("true or false")
        return self.value


def unique(values: list[JsonValue], keys: list[str], what: str) -> None:
    """Raise InputError where two of the values have the same key."""
    first: dict[str, JsonValue] = {}
    for value, key in zip(values, keys, strict=True):
        if key in first:
            raise value.error(f"has the same {what} {printable(key)} as {first[key].place}")
        first[key] = value


def read_bytes(path: Path, most: int) -> bytes:
    """The contents of a regular file of at most `most` bytes; InputError where it cannot be read."""
    return read_file(path, most)


def check_lines(path: Path, data: bytes) -> None:
    """Raise InputError for a table with a line far longer than any of ours, before it costs memory."""
    begin = 0
    while len(data) - begin > _LONGEST_LINE:
        end = data.rfind(b"\n", begin, begin + _LONGEST_LINE)
        if end < begin:
            line = data.count(b"\n", 0, begin) + 1
            raise InputError(f"{path}: line {line} is longer than {_LONGEST_LINE} bytes.")
        begin = end + 1


def decode(path: Path, data: bytes) -> str:
    """The text of UTF-8 data, a byte order mark dropped; InputError with the line where it is something else."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}: line {line} is not UTF-8 text.", "Save the file with the encoding UTF-8.") from None


def parse_json(data: bytes) -> object:
    """What a JSON text says, unchecked; None where it is none."""
    try:
        return json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        return None


def read_json(path: Path, format_name: str, version: int, below: Path | None = None) -> JsonValue:
    """The object in a JSON file whose `format` and `version` are as given; InputError for anything else.

    With `below` the file lies in that folder, and no link in it is followed.
    """
    if below is None:
        data = read_bytes(path, _MOST_BYTES)
    else:
        data = read_below(below, path.relative_to(below).as_posix(), _MOST_BYTES)
    text = decode(path, data)
    if text.count(",") + text.count("[") + text.count("{") > _MOST_VALUES:
        raise InputError(f"{path}: holds more than {_MOST_VALUES} values, which no file of ours does.")
    try:
        document = JsonValue(json.loads(text, object_pairs_hook=_object), path)
        if not _is_strict(document.value):
            _check_strict(document)  # finds the place
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        hint = "" if text.rstrip().endswith("}") else "The file seems to be cut off."
        raise InputError(f"{path}: is not valid JSON ({where}: {error.msg}).", hint) from None
    except RecursionError:
        raise InputError(f"{path}: its lists and objects are nested too deeply.") from None
    except ValueError:  # Python's own limit, 4300 digits
        raise InputError(f"{path}: holds a number of too many digits.") from None
    return _check_format(document, format_name, version)


def _object(pairs: list[tuple[str, object]]) -> dict[object, object]:
    fields: dict[object, object] = {}
    for key, value in pairs:
        if key in fields:
            fields[_REPEATED] = key
        fields[key] = value
    return fields


def _is_strict(document: object) -> bool:
    """Whether `_check_strict` will find nothing; RecursionError for a nest deeper than `_DEEPEST`."""
    level: list[object] = [document]
    for _ in range(_DEEPEST):
        inner: list[object] = []
        for value in level:
            if isinstance(value, dict):
                if _REPEATED in value:
                    return False
                inner.extend(value.values())
            elif isinstance(value, list):
                inner.extend(value)
            elif isinstance(value, float) and not math.isfinite(value):
                return False
        if not inner:
            return True
        level = inner
    raise RecursionError


def _check_strict(value: JsonValue) -> None:
    """Refuse what Python's reader lets pass: repeated keys, NaN, Infinity and numbers beyond double precision."""
    inner = value.value
    if isinstance(inner, dict):
        if _REPEATED in inner:
            raise value.error(f"has the field {printable(str(inner[_REPEATED]))} twice")
        for key, item in inner.items():
            _check_strict(value.at(key, item))
    elif isinstance(inner, list):
        for i, item in enumerate(inner):
            _check_strict(value.at(i, item))
    elif isinstance(inner, float) and not math.isfinite(inner):
        raise value.error("is not a finite number", "NaN and Infinity are not allowed in JSON.")


def _check_format(document: JsonValue, format_name: str, version: int) -> JsonValue:
    """The document, knowing whether it is of a later minor version; InputError for another format or a later major."""
    found = document.value.get("format") if isinstance(document.value, dict) else None
    if found != format_name:
        named = f', its "format" is {printable(found)}' if isinstance(found, str) else ""
        raise document.error(f'is not a "{format_name}" file{named}')
    major, minor = version_of(document)
    if major > version:
        given = f"{major}.{minor}" if minor else major
        hint = "Install the newest version of SphereCal to use it."
        raise document.error(f"was written by a later program: its version is {given}, this one knows {version}", hint)
    return replace(document, later=minor > 0)


def version_of(document: JsonValue) -> tuple[int, int]:
    """The major and minor version of a file, written as 1 or "1.2"; what a minor version adds may be ignored."""
    value = document.fields(["version"])["version"]
    if isinstance(value.value, str):
        if (found := _VERSION.fullmatch(value.value)) is None:
            raise value.error(f'must be a version such as 1 or "1.2", but is {printable(value.value)}')
        return int(found[1]), int(found[2] or 0)
    if isinstance(value.value, float) and value.value != int(value.value) and 1 <= value.value < _MOST_VERSION:
        major, minor = repr(value.value).split(".")
        return int(major), int(minor)
    return value.integer(1), 0
