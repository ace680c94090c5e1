"""Array types used throughout, arrays from outside, blocks of rows, and records of arrays: equal by value."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from itertools import islice, pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherecal.base.errors import InputError, Words
from spherecal.base.messages.values import Phrase

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# Rows that are worked on at a time where what is computed for each takes far more memory than the row itself: with 0.4
# to 1.5 KB each, 8 to 30 MB.
ROWS_AT_ONCE = 20_000

_FEW = 4  # items of a list that are printed one by one
_SMALL = 6  # numbers of an array that are printed


def float_array(values: ArrayLike, what: Words) -> FloatArray:
    """The values as an array of numbers."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(Phrase("error-of", {"what": what, "problem": Phrase("problem-not-array")})) from None


def blocks(count: int) -> Iterator[slice]:
    """All of `count` rows, `ROWS_AT_ONCE` at a time."""
    for first in range(0, count, ROWS_AT_ONCE):
        yield slice(first, min(first + ROWS_AT_ONCE, count))


def blocks_of_groups(start: IntArray) -> Iterator[tuple[int, int]]:
    """Groups of sorted rows, first to last (exclusive), of about `ROWS_AT_ONCE` rows together.

    A group is never split, so that sums over its rows are the same bits whatever the size of the blocks.
    """
    first = np.flatnonzero(np.diff(start[:-1] // ROWS_AT_ONCE, prepend=-1)).tolist()
    yield from pairwise([*first, len(start) - 1])


def sum_by(index: IntArray, values: FloatArray, count: int, before: FloatArray | None = None) -> FloatArray:
    """Sums of values (n, ...) over the rows of each index (n,), (count, ...): in a fifth of the time of `np.add.at`.

    They continue those `before`, so that they are the same bits whatever the size of blocks.
    """
    if before is not None:
        index, values = np.concatenate([np.arange(count), index]), np.concatenate([before, values])
    columns = values.reshape(len(values), int(np.prod(values.shape[1:])))
    sums = np.array([np.bincount(index, column, count) for column in columns.T], dtype=np.float64)
    # in the order of memory that products have the same bits in for any number of rows
    return np.ascontiguousarray(sums.reshape(columns.shape[1], count).T).reshape(count, *values.shape[1:])


class ByValue:
    """Base of frozen dataclasses with array fields (`eq=False, repr=False`): equal by value, with a short `repr`.

    Arrays are equal where shapes and numbers are, NaN to NaN; not hashable, as arrays are not. They cannot be written
    to: what a frozen record holds stays as it was computed.
    """

    __hash__ = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        assert is_dataclass(self)
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, np.ndarray) and value.flags.writeable:
                value = value.view()  # who made it may go on writing, into his own
                value.flags.writeable = False
                object.__setattr__(self, f.name, value)

    def __eq__(self, other: object) -> bool:
        return same_value(self, other) if type(self) is type(other) else NotImplemented

    def __repr__(self) -> str:
        assert is_dataclass(self)
        shown = (f"{f.name}={brief(getattr(self, f.name))}" for f in fields(self) if f.repr)
        return f"{type(self).__name__}({', '.join(shown)})"


def same_value(a: object, b: object) -> bool:
    """Whether two values, records, lists or mappings are equal, arrays by their shapes and numbers."""
    if a is b:
        return True
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        a, b = np.asarray(a), np.asarray(b)
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind in "fc" and b.dtype.kind in "fc"))
    if type(a) is not type(b):
        return bool(a == b)
    parts, others = _parts(a), _parts(b)
    if parts is None or others is None:
        return bool(a == b)
    return parts.keys() == others.keys() and all(same_value(parts[key], others[key]) for key in parts)


def _parts(value: object) -> Mapping | None:
    """The parts of a record, list or mapping by name or index; None for a single value or one with its own `__eq__`."""
    if is_dataclass(value):
        kind = type(value)
        if "__eq__" in vars(kind) and not kind.__dataclass_params__.eq:  # pyright: ignore[reportAttributeAccessIssue]
            return None
        return {f.name: getattr(value, f.name) for f in fields(value) if f.compare}
    if isinstance(value, tuple | list):
        return dict(enumerate(value))
    return value if isinstance(value, Mapping) else None


def brief(value: object) -> str:
    """A value in a few words: shape and type of a large array, the first and number of many items."""
    if isinstance(value, np.ndarray):
        if value.size <= _SMALL:
            return np.array2string(value, precision=6, separator=", ").replace("\n", "")
        return f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
    if isinstance(value, Mapping):
        return "{" + _items([f"{key!r}: {brief(item)}" for key, item in islice(value.items(), _FEW)], len(value)) + "}"
    if isinstance(value, tuple | list):
        return "(" + _items([brief(item) for item in value[:_FEW]], len(value)) + ")"
    return repr(value)


def _items(shown: list[str], count: int) -> str:
    return ", ".join(shown) if count <= _FEW else f"{shown[0]}, ... {count} items"
