"""What goes through the pipe between the program and its camera process."""

import dataclasses
import enum
import json
import math
import os
import struct
import types
import typing
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

MOST_BYTES = 4 << 20  # the longest real message, all features of a camera, has 60 kB
_MOST_ITEMS = 20_000
_LONGEST_TEXT = 20_000
_MOST_NUMBER = 2**63
_LENGTH = struct.Struct("!i")  # how multiprocessing.Connection.send_bytes begins a message

Check = Callable[[Any], Any]


class WireError(Exception):
    """Received data are no message."""


def pack(message: Any) -> bytes:
    """A message (a dataclass) as bytes."""
    return json.dumps([type(message).__name__, _plain(message)], ensure_ascii=True).encode()


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, dict):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(one) for one in value]
    return value.item() if isinstance(value, np.generic) else value


def unpack(data: bytes, kinds: tuple[type, ...]) -> Any:
    """The message in some bytes."""
    try:
        name, fields = json.loads(data)
    except (ValueError, TypeError, RecursionError) as error:
        raise WireError(f"no message ({error})") from None
    for kind in kinds:
        if kind.__name__ == name:
            return _check_of(kind)(fields)
    raise WireError(f"an unknown message {str(name)[:40]!r}")


@cache
def _check_of(hint: Any) -> Check:
    """What makes a value of JSON one of this type, or raises WireError."""
    if dataclasses.is_dataclass(hint):
        return _dataclass_check(typing.cast(type, hint))
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        (inner,) = (one for one in arguments if one is not type(None))
        return _optional_check(_check_of(inner))
    if origin is typing.Literal:
        return lambda value: value if value in arguments else _refuse(hint, value)
    if origin in (tuple, dict):
        return _tuple_check(arguments) if origin is tuple else _dict_check(_check_of(arguments[1]))
    if not issubclass(hint, enum.Enum):
        return _PLAIN[hint]
    known = {one.value: one for one in hint}
    return lambda value: known[value] if isinstance(value, str) and value in known else _refuse(hint, value)


def _refuse(hint: Any, value: Any) -> typing.NoReturn:
    raise WireError(f"{str(value)[:40]!r} where {getattr(hint, '__name__', hint)} belongs")


def _int(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) >= _MOST_NUMBER:
        _refuse(int, value)
    return value


def _float(value: Any) -> float:
    if isinstance(value, int):
        return float(_int(value))  # a longer one would overflow
    if not isinstance(value, float) or not math.isfinite(value):
        _refuse(float, value)
    return value


def _str(value: Any) -> str:
    return value if isinstance(value, str) and len(value) <= _LONGEST_TEXT else _refuse(str, value)


def _bool(value: Any) -> bool:
    return value if isinstance(value, bool) else _refuse(bool, value)


_PLAIN: dict[type, Check] = {int: _int, float: _float, str: _str, bool: _bool}


def _optional_check(inner: Check) -> Check:
    def check(value: Any) -> Any:
        unknown = value is None or (isinstance(value, float) and not math.isfinite(value))
        return None if unknown else inner(value)

    return check


def _tuple_check(arguments: tuple[Any, ...]) -> Check:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        inner = _check_of(arguments[0])
        return lambda value: tuple(map(inner, _list(value)))
    checks = [_check_of(one) for one in arguments]

    def check(value: Any) -> Any:
        if len(_list(value)) != len(checks):
            _refuse(tuple, value)
        return tuple(one(item) for one, item in zip(checks, value, strict=True))

    return check


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) and len(value) <= _MOST_ITEMS else _refuse(list, value)


def _dict_check(inner: Check) -> Check:
    def check(value: Any) -> Any:
        if not isinstance(value, dict) or len(value) > _MOST_ITEMS:
            _refuse(dict, value)
        return {_str(key): inner(one) for key, one in value.items()}

    return check


def _dataclass_check(kind: type) -> Check:
    hints = typing.get_type_hints(kind)
    checks = {f.name: _check_of(hints[f.name]) for f in dataclasses.fields(kind)}

    def check(value: Any) -> Any:
        if not isinstance(value, dict) or value.keys() != checks.keys():
            _refuse(kind, value)
        return kind(**{name: one(value[name]) for name, one in checks.items()})

    return check


class Inbox:
    """The messages that come through a connection; a message that is cut short does not block."""

    def __init__(self, connection: Any, kinds: tuple[type, ...]) -> None:
        self._connection, self._kinds = connection, kinds
        self._waiting = bytearray()

    def messages(self) -> Iterator[Any]:
        """The whole messages that are there now, after the connection was found readable."""
        if os.name == "nt":  # pipes of Windows hand over whole messages
            yield unpack(self._connection.recv_bytes(MOST_BYTES), self._kinds)
            return
        data = os.read(self._connection.fileno(), 1 << 20)
        self._waiting += data
        while (message := self._next()) is not None:
            yield unpack(message, self._kinds)
        if not data:
            raise EOFError

    def _next(self) -> bytes | None:
        if len(self._waiting) < _LENGTH.size:
            return None
        (length,) = _LENGTH.unpack_from(self._waiting)
        if not 0 <= length <= MOST_BYTES:
            raise WireError(f"a message of {length} bytes")
        end = _LENGTH.size + length
        if len(self._waiting) < end:
            return None
        message = bytes(self._waiting[_LENGTH.size : end])
        del self._waiting[:end]
        return message
