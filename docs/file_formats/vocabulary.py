"""The words of the formats that are read by hand or only written: JSON Schemas, by the kinds of `spherecal_files.codec`."""  # noqa: E501

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ParamSpec

from spherecal_files import codec, rig_file, session_file
from spherecal_files.codec import UNREAD, FileFormat, Kind, Schema

__all__ = ["FileFormat", "Schema"]
_P = ParamSpec("_P")


def _schema(make: Callable[_P, Kind[Any]]) -> Callable[_P, Schema]:
    return lambda *arguments, **named: make(*arguments, **named).schema


number, positive, integer = _schema(codec.number), _schema(codec.positive), _schema(codec.integer)
boolean, celsius, choice = _schema(codec.boolean), _schema(codec.celsius), _schema(codec.choice)
text, prose, name = _schema(codec.text), _schema(codec.prose), _schema(codec.name)
identifier, serial, digest = _schema(codec.identifier), _schema(codec.serial), _schema(codec.digest)
date, time = _schema(codec.date), _schema(codec.time)
numbers, matrix, sigmas = _schema(codec.numbers), _schema(codec.matrix), _schema(rig_file.sigmas)
path = _schema(session_file.named_file)
lens_matrix, distortion = rig_file.lens_matrix, rig_file.distortion


def _kind(schema: Schema) -> Kind[Any]:
    return Kind(schema, lambda value: value.value)


def written(
    name: str, file: str, about: str, fields: Mapping[str, Schema], rules: Sequence[str] = (), **others: Any
) -> FileFormat[Any]:
    """A format of these fields."""
    return FileFormat(f"spherecal/{name}", file, about, _kind(record("", fields)), rules, **others)


def record(about: str, fields: Mapping[str, Schema]) -> Schema:
    """An object; a field whose name ends with `?` may be absent or null. Other fields are ignored."""
    return codec.record(about, dict, *(_field(key, schema) for key, schema in fields.items())).schema


def _field(key: str, schema: Schema) -> codec.Field:
    if not key.endswith("?"):
        return codec.field(key, _kind(schema))
    if schema.get("$comment") == UNREAD:
        return codec.unread(key[:-1], schema["description"])
    return codec.optional(key[:-1], _kind(schema))


def unread(about: str) -> Schema:
    """What this program writes for people and other programs, and does not read back: any value."""
    return {"description": about, "$comment": UNREAD}


def entries(about: str, values: Schema, names: Schema | None = None) -> Schema:
    """An object whose keys are names."""
    return codec.entries(about, _kind(values), _kind(names or name(""))).schema


def items(about: str, each: Schema, least: int = 0, most: int | None = None, length: int | None = None) -> Schema:
    """A list of `least` to `most` values, or of exactly `length`."""
    return codec.items(about, _kind(each), least, most, length).schema


def one_of(about: str, *schemas: Schema) -> Schema:
    """What fits any of the schemas."""
    return codec.one_of(about, *map(_kind, schemas)).schema


SOFTWARE = codec.software().kind.schema


def finding(about: str = "A finding.") -> Schema:
    """A finding as rig.json, verification.json and check.json have it."""
    from spherecal_files.findings_file import FINDING

    return FINDING.described(about).schema
