"""What a computation was made from, known by its content: equal content has one fingerprint in every version."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass

_DIGITS = 32  # of the SHA-256: two contents never share them by chance


def fingerprint(content: object) -> str:
    """A short text (hexadecimal) that is equal for equal content.

    Dataclasses count by the names and values of their fields. A field that has its default does not count, so that a
    field that a later version adds changes no fingerprint of what was saved before.
    """
    text = json.dumps(_plain(content), sort_keys=True, ensure_ascii=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def _plain(content: object) -> object:
    if is_dataclass(content) and not isinstance(content, type):
        values = ((one, getattr(content, one.name)) for one in fields(content))
        return {one.name: _plain(value) for one, value in values if value != _default(one)}
    if isinstance(content, Mapping):
        return {str(key): _plain(value) for key, value in content.items()}
    if isinstance(content, Sequence) and not isinstance(content, str):
        return [_plain(value) for value in content]
    return content


def _default(one: "Field[object]") -> object:
    if one.default is not MISSING:
        return one.default
    return one.default_factory() if one.default_factory is not MISSING else MISSING
