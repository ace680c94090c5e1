"""A JSON Schema validator for the words that our schemas use; any other word is an error."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

_KINDS: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "boolean": (bool,),
    "null": (type(None),),
    "number": (int, float),
    "integer": (int, float),
}
_ANNOTATIONS = {"$schema", "$id", "$defs", "$comment", "title", "description", "format"}


def problems(value: Any, schema: Mapping[str, Any], place: str = "$", closed: bool = False) -> Iterator[str]:
    """What is wrong with a document, each with its place; with `closed`, fields that are not described as well."""
    for word, wanted in schema.items():
        if word in _ANNOTATIONS:
            continue
        yield from _CHECKS[word](value, wanted, place, closed, schema)


def is_valid(value: Any, schema: Mapping[str, Any]) -> bool:
    """Whether a document is as the schema says."""
    return next(problems(value, schema), None) is None


def _is(value: Any, kind: str) -> bool:
    if isinstance(value, bool) and kind != "boolean":
        return False
    return isinstance(value, _KINDS[kind]) and (kind != "integer" or value == int(value))


def _same(value: Any, other: Any) -> bool:
    return value == other and isinstance(value, bool) == isinstance(other, bool)


def _type(value: Any, wanted: Any, place: str, *_: Any) -> Iterator[str]:
    kinds = wanted if isinstance(wanted, list) else [wanted]
    if not any(_is(value, kind) for kind in kinds):
        yield f"{place}: is no {' or '.join(kinds)}"


def _properties(value: Any, wanted: Any, place: str, closed: bool, schema: Any) -> Iterator[str]:
    if not isinstance(value, dict):
        return
    for key, own in wanted.items():
        if key in value:
            yield from problems(value[key], own, f"{place}.{key}", closed)
    if closed and "type" in schema and "additionalProperties" not in schema:
        yield from (f"{place}.{key}: is not described" for key in value if key not in wanted)


def _required(value: Any, wanted: Any, place: str, *_: Any) -> Iterator[str]:
    if isinstance(value, dict):
        yield from (f"{place}.{key}: is missing" for key in wanted if key not in value)


def _items(value: Any, wanted: Any, place: str, closed: bool, _: Any) -> Iterator[str]:
    if isinstance(value, list):
        for i, one in enumerate(value):
            yield from problems(one, wanted, f"{place}[{i}]", closed)


def _prefix_items(value: Any, wanted: Any, place: str, closed: bool, _: Any) -> Iterator[str]:
    if isinstance(value, list):
        for i, (one, own) in enumerate(zip(value, wanted, strict=False)):
            yield from problems(one, own, f"{place}[{i}]", closed)


def _additional(value: Any, wanted: Any, place: str, closed: bool, _: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, one in value.items():
            yield from problems(one, wanted, f"{place}.{key}", closed)


def _names(value: Any, wanted: Any, place: str, *_: Any) -> Iterator[str]:
    for key in value if isinstance(value, dict) else ():
        yield from problems(key, wanted, f"{place} (name {key!r})")


def _any_of(value: Any, wanted: Any, place: str, closed: bool, _: Any) -> Iterator[str]:
    if not any(next(problems(value, one, place, closed), None) is None for one in wanted):
        yield f"{place}: fits none of {len(wanted)} forms"


def _not(value: Any, wanted: Any, place: str, *_: Any) -> Iterator[str]:
    if is_valid(value, wanted):
        yield f"{place}: is what it must not be"


def _enum(value: Any, wanted: Any, place: str, *_: Any) -> Iterator[str]:
    if not any(_same(value, one) for one in wanted):
        yield f"{place}: is none of {wanted}"


def _size(value: Any, kinds: tuple[type, ...]) -> int | None:
    return len(value) if isinstance(value, kinds) else None


def _least(kinds: tuple[type, ...]) -> Any:
    def check(value: Any, wanted: int, place: str, *_: Any) -> Iterator[str]:
        if (size := _size(value, kinds)) is not None and size < wanted:
            yield f"{place}: has {size}, fewer than {wanted}"

    return check


def _most(kinds: tuple[type, ...]) -> Any:
    def check(value: Any, wanted: int, place: str, *_: Any) -> Iterator[str]:
        if (size := _size(value, kinds)) is not None and size > wanted:
            yield f"{place}: has {size}, more than {wanted}"

    return check


def _pattern(value: Any, wanted: str, place: str, *_: Any) -> Iterator[str]:
    if isinstance(value, str) and not re.search(wanted, value):
        yield f"{place}: does not match {wanted}"


def _bound(holds: Any) -> Any:
    def check(value: Any, wanted: float, place: str, *_: Any) -> Iterator[str]:
        if _is(value, "number") and not holds(value, wanted):
            yield f"{place}: {value!r:.30} is beyond {wanted}"

    return check


_CHECKS: dict[str, Any] = {
    "type": _type,
    "properties": _properties,
    "required": _required,
    "items": _items,
    "prefixItems": _prefix_items,
    "additionalProperties": _additional,
    "propertyNames": _names,
    "anyOf": _any_of,
    "not": _not,
    "enum": _enum,
    "const": lambda value, wanted, place, *_: _enum(value, [wanted], place),
    "minItems": _least((list,)),
    "maxItems": _most((list,)),
    "minLength": _least((str,)),
    "maxLength": _most((str,)),
    "minProperties": _least((dict,)),
    "maxProperties": _most((dict,)),
    "pattern": _pattern,
    "minimum": _bound(lambda a, b: a >= b),
    "maximum": _bound(lambda a, b: a <= b),
    "exclusiveMinimum": _bound(lambda a, b: a > b),
    "exclusiveMaximum": _bound(lambda a, b: a < b),
}
