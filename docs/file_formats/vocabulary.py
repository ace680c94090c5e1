"""The words that the schemas are written in: the same ones as the checks of `spherecal.files.json_file.JsonValue`.

Every function returns a JSON Schema (draft 2020-12) with its description first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Schema = dict[str, Any]

DRAFT = "https://json-schema.org/draft/2020-12/schema"
UNREAD = "Written, not read."
_MOST = 1e30
_MOST_INTEGER = 2**53
_LINE = r"^[^\u0000-\u001f\u007f-\u009f]*$"
_NAME = r'^(?!\s)(?!\.{1,2}$)[^,"/\\\u0000-\u001f\u007f-\u009f]*[^,"/\\\s\u0000-\u001f\u007f-\u009f]$'
_ID = r"^[^\W.][\w.\-]{0,63}$|^-[\w.\-]{0,63}$"
_PATH = r"^(?!/)(?!\.$)(?!(.*/)?\.\.(/|$))[^\\\u0000-\u001f]+$"
_TIME = r"^\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}(:\d{2}(\.\d+)?)?(Z|[+-]\d{2}:?\d{2})$"


@dataclass(frozen=True)
class Format:
    """One format: its file, what it is for, its fields (see `record`), and what its reader checks besides.

    `rules` are sentences about what no schema can say, such as that ids differ. `is_read` is false for what is only
    written for other programs. `more` links to the page that says more. A document
    fits one of `forms`, where there are any.
    """

    name: str
    file: str
    about: str
    fields: Mapping[str, Schema]
    rules: Sequence[str] = ()
    is_read: bool = True
    more: str = ""
    forms: Sequence[Schema] = ()

    @property
    def short(self) -> str:
        """Its name."""
        return self.name

    @property
    def schema(self) -> Schema:
        """The whole schema."""
        head: Schema = {
            "$schema": DRAFT,
            "$id": f"{self.name}.schema.json",
            "title": self.file,
            "description": " ".join((self.about, *self.rules)),
        }
        own = {
            "format": {"description": "What the file is.", "const": f"spherecal/{self.name}"},
            "version": {
                "description": 'Version, as `1` or, with a minor number, `"1.2"`.',
                "anyOf": [
                    {"type": "number", "minimum": 1, "exclusiveMaximum": 2},
                    {"type": "string", "pattern": r"^1(\.[0-9]{1,6})?$"},
                ],
            },
        }
        forms: Schema = {"anyOf": list(self.forms)} if self.forms else {}
        return head | record("", {**own, **self.fields}) | forms


def _described(about: str, schema: Schema) -> Schema:
    return {"description": about, **schema} if about else schema


def record(about: str, fields: Mapping[str, Schema]) -> Schema:
    """An object; a field whose name ends with `?` may be absent or null. Other fields are ignored."""
    properties = {name.removesuffix("?"): _or_null(f) if name.endswith("?") else f for name, f in fields.items()}
    required = [name for name in fields if not name.endswith("?")]
    schema: Schema = {"type": "object", "properties": properties}
    return _described(about, schema | ({"required": required} if required else {}))


def _or_null(schema: Schema) -> Schema:
    """The schema, or null; `$comment` says that a field that is never read is not meant."""
    if schema.get("$comment") == UNREAD or not set(schema) - {"description"}:
        return schema
    if isinstance(kind := schema.get("type"), str) and "enum" not in schema:
        return {**schema, "type": [kind, "null"]}
    if "enum" in schema:
        return {**schema, "enum": [*schema["enum"], None]}
    about = {key: value for key, value in schema.items() if key == "description"}
    return {**about, "anyOf": [{k: v for k, v in schema.items() if k != "description"}, {"type": "null"}]}


def unread(about: str) -> Schema:
    """What this program writes for people and other programs, and does not read back: any value."""
    return {"description": about, "$comment": UNREAD}


def entries(about: str, values: Schema, names: Schema | None = None) -> Schema:
    """An object whose keys are names."""
    keys = {"propertyNames": names or name("")}
    return _described(about, {"type": "object", "additionalProperties": values, **keys})


def items(about: str, each: Schema, least: int = 0, most: int | None = None, length: int | None = None) -> Schema:
    """A list of `least` to `most` values, or of exactly `length`."""
    schema: Schema = {"type": "array", "items": each}
    if length is not None:
        schema |= {"minItems": length, "maxItems": length}
    else:
        schema |= ({"minItems": least} if least else {}) | ({} if most is None else {"maxItems": most})
    return _described(about, schema)


def number(about: str, least: float = -_MOST, most: float = _MOST) -> Schema:
    """A number from `least` to `most`."""
    return _described(about, {"type": "number", "minimum": least, "maximum": most})


def positive(about: str) -> Schema:
    """A number above 0."""
    return _described(about, {"type": "number", "exclusiveMinimum": 0, "maximum": _MOST})


def integer(about: str, least: int = -_MOST_INTEGER, most: int = _MOST_INTEGER) -> Schema:
    """A whole number; 6.0 counts as 6."""
    return _described(about, {"type": "integer", "minimum": least, "maximum": most})


def numbers(about: str, length: int) -> Schema:
    """So many numbers."""
    return items(about, number(""), length=length)


def matrix(about: str, rows: int, columns: int) -> Schema:
    """Rows of numbers."""
    return items(about, numbers("", columns), length=rows)


def sigmas(about: str, length: int | None = None) -> Schema:
    """Standard uncertainties; null where unknown."""
    return items(about, {"type": ["number", "null"], "minimum": 0, "maximum": _MOST}, length=length)


def lens_matrix(about: str) -> Schema:
    """A camera matrix [[fu, 0, u0], [0, fv, v0], [0, 0, 1]]."""
    zero, one = {"type": "number", "const": 0}, {"type": "number", "const": 1}
    rows = ([positive(""), zero, number("")], [zero, positive(""), number("")], [zero, zero, one])
    return _described(about, _tuple([_tuple(row) for row in rows]))


def _tuple(each: Sequence[Schema]) -> Schema:
    return {"type": "array", "prefixItems": list(each), "minItems": len(each), "maxItems": len(each)}


def distortion(about: str) -> Schema:
    """4, 5, 8 or 12 numbers in OpenCV's order."""
    lengths = [{"minItems": n, "maxItems": n} for n in (4, 5, 8, 12)]
    return _described(about, {"type": "array", "items": number(""), "anyOf": lengths})


def text(about: str) -> Schema:
    """A text on one line of at most 1000 characters."""
    return _described(about, {"type": "string", "maxLength": 1000, "pattern": _LINE})


def prose(about: str) -> Schema:
    """A text of any length and form."""
    return _described(about, {"type": "string"})


def name(about: str) -> Schema:
    """A name: at most 100 characters, no comma, quotation mark, slash or control character."""
    return _described(about, {"type": "string", "minLength": 1, "maxLength": 100, "pattern": _NAME})


def identifier(about: str) -> Schema:
    """An id, which may become a file name."""
    return _described(about, {"type": "string", "maxLength": 64, "pattern": _ID})


def path(about: str) -> Schema:
    """A path below the folder, with "/" between its parts."""
    return _described(about, {"type": "string", "minLength": 1, "maxLength": 500, "pattern": _PATH})


def serial(about: str) -> Schema:
    """A serial number: a text on one line, or a whole number."""
    return _described(about, {"anyOf": [text(""), integer("", 0)]})


def digest(about: str) -> Schema:
    """A SHA-256 in hexadecimal digits, or an empty text."""
    return _described(about, {"type": "string", "pattern": "^([0-9a-f]{64})?$"})


def time(about: str) -> Schema:
    """A point in time with its zone."""
    return _described(about, {"type": "string", "format": "date-time", "pattern": _TIME})


def date(about: str) -> Schema:
    """A day."""
    return _described(about, {"type": "string", "format": "date", "pattern": r"^\d{4}-\d{2}-\d{2}$"})


def celsius(about: str) -> Schema:
    """A temperature in degrees Celsius."""
    return number(about, -100, 200)


def boolean(about: str) -> Schema:
    """True or false."""
    return _described(about, {"type": "boolean"})


def choice(about: str, options: Sequence[str]) -> Schema:
    """One of some texts."""
    return _described(about, {"enum": list(options)})


def one_of(about: str, *schemas: Schema) -> Schema:
    """What fits any of the schemas."""
    return _described(about, {"anyOf": list(schemas)})


SOFTWARE = unread("Name and version of the program that wrote the file, and details such as the method and the seed.")


def finding(about: str = "A finding.") -> Schema:
    """A finding as rig.json, verification.json and check.json have it."""
    return record(
        about,
        {
            "severity": choice("How grave it is.", ("info", "warning", "error")),
            "code": prose("What it is, for programs."),
            "message": prose("What was found, in English."),
            "hint": prose("What to do."),
            "where": items("Ids of the cameras, placements and targets that it is about.", prose("")),
        },
    )
