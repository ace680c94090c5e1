"""The numbers and names that a message is made of."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, TypeAlias

Value: TypeAlias = "str | int | float | Phrase | tuple[Value, ...] | None"


@dataclass(frozen=True)
class Phrase:
    """A part of a message: its key in the table of phrases, and its own values."""

    key: str
    values: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", plain(self.values))


def plain(values: Mapping[str, Any]) -> dict[str, Value]:
    """The values as Python's own numbers and strings, sequences as tuples, paths as text."""
    return {name: _plain(value) for name, value in values.items()}


def _plain(value: Any) -> Value:
    if hasattr(value, "tolist"):  # numpy's, which is not loaded for this: `--version` would wait for it
        value = value.tolist()
    if isinstance(value, PurePath):
        return str(value)
    if isinstance(value, (list, tuple)):
        return tuple(_plain(item) for item in value)
    return value
