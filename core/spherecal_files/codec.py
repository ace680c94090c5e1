"""What a file holds, declared once: a `FileFormat` reads its files, writes them, and gives their JSON Schema.

A format is a tree of kinds, description first: `number("Age in hours.", 0)`; `record` makes a dataclass of an object.
What no kind says is a function (`checked`). Why not a library: docs/decisions/0020-one-declaration.md.
"""

import datetime
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from dataclasses import field as dataclass_field
from operator import attrgetter
from pathlib import Path
from typing import Any, Generic, TypeVar

from spherecal.base.errors import Words
from spherecal.base.messages.values import Phrase
from spherecal_files.json_file import JsonValue, json_bytes, read_json, software_entry, unique, version_of

Schema = dict[str, Any]
"""A JSON Schema, draft 2020-12."""
T = TypeVar("T")
S = TypeVar("S")
Text = TypeVar("Text", bound=str)

DRAFT = "https://json-schema.org/draft/2020-12/schema"
UNREAD = "Written, not read."
_MOST = 1e30
_MOST_INTEGER = 2**53
_MOST_ITEMS = 2_000_000
_LINE = r"^[^\u0000-\u001f\u007f-\u009f]*$"
_NAME = r'^(?!\s)(?!\.{1,2}$)[^,"/\\\u0000-\u001f\u007f-\u009f]*[^,"/\\\s\u0000-\u001f\u007f-\u009f]$'
_ID = r"^[^\W.][\w.\-]{0,63}$|^-[\w.\-]{0,63}$"
_TIME = r"^\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}(:\d{2}(\.\d+)?)?(Z|[+-]\d{2}:?\d{2})$"
_TYPES = {"string": str, "boolean": bool, "array": list, "object": dict}
_ALWAYS = object()


def _same(value: Any) -> Any:
    return value


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


@dataclass(frozen=True)
class Kind(Generic[T]):
    """A kind of value: its schema, how it is read (InputError names place and problem), and what is written for it."""

    schema: Schema
    read: Callable[[JsonValue], T]
    entry: Callable[[Any], Any] = _same

    def checked(self, check: Callable[[T, JsonValue], object], **schema: Any) -> "Kind[T]":
        """The same kind with a check after reading."""

        def read(value: JsonValue) -> T:
            found = self.read(value)
            check(found, value)
            return found

        return Kind(self.schema | schema, read, self.entry)

    def that(self, holds: Callable[[T], object], problem: Phrase, **schema: Any) -> "Kind[T]":
        """The same kind of values for which something holds; `problem` says what is wrong with the others."""

        def check(found: T, value: JsonValue) -> None:
            if not holds(found):
                raise value.error(problem)

        return self.checked(check, **schema)

    def mapped(self, make: Callable[[T], S], back: Callable[[Any], Any] = _same) -> "Kind[S]":
        """A kind of what `make` makes of the value."""
        return Kind(self.schema, lambda value: make(self.read(value)), lambda made: self.entry(back(made)))

    def described(self, about: str) -> "Kind[T]":
        """The same kind with another description."""
        others = {key: value for key, value in self.schema.items() if key != "description"}
        return replace(self, schema={"description": about, **others})


def _kind(about: str, schema: Schema, read: Callable[[JsonValue], T], entry: Callable[[Any], Any] = _same) -> Kind[T]:
    return Kind({"description": about, **schema} if about else schema, read, entry)


def number(about: str, least: float = -_MOST, most: float = _MOST, unit: Words = "") -> Kind[float]:
    """A number from `least` to `most`; what is not finite is written as null."""
    schema = {"type": "number", "minimum": least, "maximum": most}
    if (least, most) == (-_MOST, _MOST):
        return _kind(about, schema, JsonValue.number, _finite)
    return _kind(about, schema, lambda value: value.number(least, most, unit), _finite)


def positive(about: str, unit: str = "") -> Kind[float]:
    """A number above 0."""
    schema = {"type": "number", "exclusiveMinimum": 0, "maximum": _MOST}
    return _kind(about, schema, lambda value: value.positive(unit), _finite)


def celsius(about: str) -> Kind[float]:
    """A temperature in degrees Celsius."""
    return _kind(about, {"type": "number", "minimum": -100, "maximum": 200}, JsonValue.celsius, _finite)


def integer(about: str, least: int = -_MOST_INTEGER, most: int = _MOST_INTEGER) -> Kind[int]:
    """A whole number; 6.0 counts as 6."""
    schema = {"type": "integer", "minimum": least, "maximum": most}
    return _kind(about, schema, lambda value: value.integer(least, most), int)


def boolean(about: str) -> Kind[bool]:
    """True or false."""
    return _kind(about, {"type": "boolean"}, JsonValue.boolean, bool)


def text(about: str) -> Kind[str]:
    """A text on one line of at most 1000 characters."""
    return _kind(about, {"type": "string", "maxLength": 1000, "pattern": _LINE}, JsonValue.text)


def prose(about: str) -> Kind[str]:
    """A text of any length and form."""
    return _kind(about, {"type": "string"}, JsonValue.prose)


def name(about: str) -> Kind[str]:
    """A name: at most 100 characters, no comma, quotation mark, slash or control character."""
    schema = {"type": "string", "minLength": 1, "maxLength": 100, "pattern": _NAME}
    return _kind(about, schema, JsonValue.name)


def identifier(about: str) -> Kind[str]:
    """An id, which may become a file name."""
    return _kind(about, {"type": "string", "maxLength": 64, "pattern": _ID}, JsonValue.id)


def serial(about: str) -> Kind[str]:
    """A serial number: a text on one line, or a whole number."""
    return _kind(about, {"anyOf": [text("").schema, integer("", 0).schema]}, JsonValue.serial)


def digest(about: str) -> Kind[str]:
    """A SHA-256 in hexadecimal digits, or an empty text."""
    return _kind(about, {"type": "string", "pattern": "^([0-9a-f]{64})?$"}, JsonValue.digest)


def time(about: str) -> Kind[datetime.datetime]:
    """A point in time with its zone."""
    schema = {"type": "string", "format": "date-time", "pattern": _TIME}
    return _kind(about, schema, JsonValue.time, datetime.datetime.isoformat)


def date(about: str) -> Kind[datetime.date]:
    """A day."""
    schema = {"type": "string", "format": "date", "pattern": r"^\d{4}-\d{2}-\d{2}$"}
    return _kind(about, schema, JsonValue.date, datetime.date.isoformat)


def free(about: str) -> Kind[dict[str, Any]]:
    """An object as it is, unchecked."""
    return _kind(about, {"type": "object"}, JsonValue.as_object, dict)


def choice(about: str, options: Sequence[Text]) -> Kind[Text]:
    """One of some texts."""
    return _kind(about, {"enum": list(options)}, lambda value: value.choice(*options))


def items(
    about: str,
    each: Kind[T],
    least: int = 0,
    most: int | None = None,
    length: int | None = None,
    differ: str = "",
    what: str = "",
    excess: Words = "",
) -> Kind[tuple[T, ...]]:
    """A list of values of one kind: `least` to `most` (None: 2 million) of them, or exactly `length`."""
    schema: Schema = {"type": "array", "items": each.schema}
    if length is not None:
        schema |= {"minItems": length, "maxItems": length}
    else:
        schema |= ({"minItems": least} if least else {}) | ({} if most is None else {"maxItems": most})

    def read(value: JsonValue) -> tuple[T, ...]:
        values = value.items(length, least, _MOST_ITEMS if most is None or excess else most)
        if excess and most is not None and len(values) > most:
            raise value.error(excess)
        found = tuple([each.read(one) for one in values])
        if differ:
            unique(values, [str(getattr(one, differ)) for one in found], what or differ)
        return found

    return _kind(about, schema, read, lambda values: [each.entry(one) for one in values])


def numbers(about: str, length: int) -> Kind[tuple[float, ...]]:
    """A list of exactly `length` numbers."""
    return replace(items(about, number(""), length=length), read=lambda value: tuple(value.numbers(length)))


def matrix(about: str, rows: int, columns: int) -> Kind[tuple[tuple[float, ...], ...]]:
    """A matrix as a list of rows of numbers."""
    rows_of = items(about, numbers("", columns), length=rows)
    return replace(rows_of, read=lambda value: tuple(map(tuple, value.matrix(rows, columns))))


def entries(about: str, values: Kind[T], names: Kind[str] | None = None) -> Kind[dict[str, T]]:
    """An object whose keys are names."""
    schema = {"type": "object", "additionalProperties": values.schema, "propertyNames": (names or name("")).schema}

    def read(value: JsonValue) -> dict[str, T]:
        return {key: values.read(one) for key, one in value.entries().items()}

    return _kind(about, schema, read, lambda found: {key: values.entry(one) for key, one in found.items()})


def one_of(about: str, *kinds: Kind[Any]) -> Kind[Any]:
    """What fits any of some kinds: the first one of the value's JSON type reads it, else the last."""

    def read(value: JsonValue) -> Any:
        fits = (kind for kind in kinds if isinstance(value.value, _TYPES.get(kind.schema.get("type", ""), ())))
        return next(fits, kinds[-1]).read(value)

    return _kind(about, {"anyOf": [kind.schema for kind in kinds]}, read)


@dataclass(frozen=True)
class Field:
    """A field of an object: its key, its kind, and the attribute that it fills and is written from.

    `inner`: of a group, the fields, which belong to the dataclass around it. `omit`: the value that is not written.
    """

    key: str
    kind: Kind[Any]
    get: Callable[[Any], Any]
    attribute: str = ""
    is_needed: bool = True
    is_read: bool = True
    omit: object = _ALWAYS
    inner: tuple["Field", ...] = ()

    @property
    def attributes(self) -> tuple[str, ...]:
        """The attributes that reading fills."""
        return tuple(name for one in self.inner for name in one.attributes) or (self.attribute,) * self.is_read


Source = str | Callable[[Any], Any]
"""The attribute of a field, empty where it has the field's name; a function for what follows from others.

What follows from others is written, and checked when it is read, but not kept.

A path such as `name.target` is written from there, and read as the argument `target`.
"""


def field(key: str, kind: Kind[Any], of: Source = "", attribute: str = "") -> Field:
    """A field that must be there."""
    if callable(of):
        return Field(key, kind, of, attribute)
    return Field(key, kind, attrgetter(of or key), attribute or of.rpartition(".")[2] or key)


def optional(key: str, kind: Kind[Any], of: Source = "", attribute: str = "", omit: object = _ALWAYS) -> Field:
    """A field that may be absent or null: the dataclass's default then holds, or None where it has none."""
    return replace(field(key, _nullable(kind), of, attribute), is_needed=False, omit=omit)


def unread(key: str, about: str, of: Source = "") -> Field:
    """What is written for people and other programs, and not read back: any value."""
    kind = Kind({"description": about, "$comment": UNREAD}, lambda value: value.value)
    return replace(field(key, kind, of), is_needed=False, is_read=False)


def software() -> Field:
    """A field that says who wrote the file; it is not read."""
    about = "Name and version of the program that wrote the file, and details such as the method and the seed."
    return unread("software", about, lambda _: software_entry(None))


def group(key: str, about: str, *inner: Field, is_needed: bool = True) -> Field:
    """An object whose fields belong to the dataclass around it."""
    kind = record(about, dict, *inner)
    if is_needed:
        return Field(key, kind, _same, inner=inner)
    return Field(
        key, _nullable(kind), lambda of: None if inner[0].get(of) is None else of, is_needed=False, inner=inner
    )


def _nullable(kind: Kind[T]) -> Kind[T]:
    about = {key: value for key, value in kind.schema.items() if key == "description"}
    schema = {key: value for key, value in kind.schema.items() if key != "description"}
    if "enum" in schema:
        schema["enum"] = [*schema["enum"], None]
    elif isinstance(schema.get("type"), str):
        schema["type"] = [schema["type"], "null"]
    elif schema:
        schema = {"anyOf": [schema, {"type": "null"}]}
    return replace(kind, schema=about | schema)


def record(
    about: str,
    make: Callable[..., T],
    *inner: Field,
    check: Callable[[T, Mapping[str, JsonValue]], object] | None = None,
) -> Kind[T]:
    """An object, made by a dataclass or another function of its attributes; unknown fields are ignored."""
    needed = [one.key for one in inner if one.is_needed]
    others = [one.key for one in inner if not one.is_needed]
    made: Any = make
    known = fields(made) if isinstance(made, type) and is_dataclass(made) else ()
    without_default = {one.name for one in known if one.default is one.default_factory is MISSING}
    absent = dict.fromkeys(without_default & {name for one in inner for name in one.attributes})

    def read(value: JsonValue) -> T:
        given, found = value.fields(needed, others), dict[str, Any](absent)
        for one in inner:
            if one.key not in given or not one.is_read:
                continue
            value_of = one.kind.read(given[one.key])
            if one.inner:
                found |= value_of
            elif one.attribute:
                found[one.attribute] = value_of
        made = make(**found)
        if check is not None:
            check(made, given)
        return made

    def entry(of: Any) -> dict[str, Any]:
        written = {}
        for one in inner:
            value = one.get(of)
            if value is not one.omit and not (type(value) is type(one.omit) and value == one.omit):
                written[one.key] = None if value is None else one.kind.entry(value)
        return written

    schema: Schema = {"type": "object", "properties": {one.key: one.kind.schema for one in inner}}
    return _kind(about, schema | ({"required": needed} if needed else {}), read, entry)


def only(key: str, kind: Kind[T], *others: Field) -> Kind[T]:
    """An object of which one field is everything: that field's value is read and written."""
    return record("", lambda **given: given[key], Field(key, kind, _same, key), *others)


@dataclass(frozen=True)
class FileFormat(Generic[T]):
    """One format: the name that its files have in the field `format`, its usual file, what it is for, what it holds.

    `rules` are sentences about what no schema can say, such as that ids differ. `is_read` is false for what is only
    written for other programs. `more` links to the page that says more. `lines`: the last field, where each value of
    its list is written on a line. `migrations`: from version n to n + 1, by n, so that all files can be read.
    """

    name: str
    file: str
    about: str
    kind: Kind[T]
    rules: Sequence[str] = ()
    is_read: bool = True
    more: str = ""
    version: int = 1
    lines: str = ""
    migrations: Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]] = dataclass_field(default_factory=dict)

    def read(self, path: Path, below: Path | None = None) -> T:
        """What a file holds, with files of earlier versions migrated; links are followed but for `below` a folder."""
        document = read_json(path, self.name, self.version, below)
        for step in range(version_of(document)[0], self.version):
            if step not in self.migrations:
                raise document.error(Phrase("problem-old-version", {"version": step}))
            older = document.as_object()
            document = replace(document, value={**self.migrations[step](dict(older)), "version": step + 1})
        return self.kind.read(document)

    def document(self, value: Any, **others: Any) -> dict[str, Any]:
        """The contents of a file."""
        return {"format": self.name, "version": self.version, **self.kind.entry(value), **others}

    def bytes(self, value: Any, **others: Any) -> bytes:
        """The contents of a file as it is written, JSON in UTF-8."""
        document = self.document(value, **others)
        if not self.lines:
            return json_bytes(document)
        lines = ",\n  ".join(json.dumps(one) for one in document.pop(self.lines))
        return json_bytes(document)[:-3] + f',\n "{self.lines}": [\n  {lines}\n ]\n}}\n'.encode()

    @property
    def short(self) -> str:
        """Its name alone, without whose format it is."""
        return self.name.partition("/")[2]

    @property
    def schema(self) -> Schema:
        """The JSON Schema of a whole file."""
        oldest, newest = min(self.migrations, default=self.version), self.version
        major = str(newest) if oldest == newest else f"({'|'.join(map(str, range(oldest, newest + 1)))})"
        own = {
            "format": {"description": "What the file is.", "const": self.name},
            "version": {
                "description": f'Version, as `{newest}` or, with a minor number, `"{newest}.2"`.',
                "anyOf": [
                    {"type": "number", "minimum": oldest, "exclusiveMaximum": newest + 1},
                    {"type": "string", "pattern": rf"^{major}(\.[0-9]{{1,6}})?$"},
                ],
            },
        }
        held = self.kind.schema
        return {
            "$schema": DRAFT,
            "$id": f"{self.short}.schema.json",
            "title": self.file,
            "description": " ".join((self.about, *self.rules)),
            **held,
            "properties": own | held["properties"],
            "required": [*own, *held.get("required", ())],
        }
