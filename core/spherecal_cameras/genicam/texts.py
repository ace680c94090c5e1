"""Drivers whose texts are not UTF-8: genicam then raises UnicodeDecodeError in the place of the error that was meant.

Hikrobot's driver answers so (public reports of 2025 and later): Harvesters, which expects `NotImplementedException` and
the like, then opens no camera at all.
"""

import functools
from collections.abc import Callable
from types import BuiltinFunctionType
from typing import Any

# The errors of GenTL by their codes, as genicam names their classes; what is not among them was never implemented.
_MEANT = {
    -1001: "Error",
    -1002: "NotInitialized",
    -1003: "NotImplemented",
    -1004: "ResourceInUse",
    -1005: "AccessDenied",
    -1006: "InvalidHandle",
    -1007: "InvalidId",
    -1008: "NoData",
    -1009: "InvalidParameter",
    -1010: "Io",
    -1011: "Timeout",
    -1012: "Abort",
    -1013: "InvalidBuffer",
    -1014: "NotAvailable",
    -1015: "InvalidAddress",
    -1016: "BufferTooSmall",
    -1017: "InvalidIndex",
    -1018: "ParsingChunkData",
    -1019: "InvalidValue",
    -1020: "ResourceExhausted",
    -1021: "OutOfMemory",
    -1022: "Busy",
}


def error_id(text: str) -> int | None:
    """The GenTL code that genicam writes into its texts, `(ID: -1010)`; None where there is none."""
    _, found, rest = text.rpartition("(ID: ")
    digits = rest.split(")", 1)[0]
    return int(digits) if found and digits.lstrip("-").isdigit() else None


def tolerate_any_text() -> None:
    """Have every call of genicam in this process raise the error that was meant; may be called again."""
    from genicam import genapi, gentl

    for module in (gentl._gentl, genapi._genapi):
        for name, call in list(vars(module).items()):
            if isinstance(call, BuiltinFunctionType):
                setattr(module, name, _tolerant(call, gentl))


def _tolerant(call: Callable[..., Any], gentl: Any) -> Callable[..., Any]:
    @functools.wraps(call)
    def tolerant(*args: Any) -> Any:
        try:
            return call(*args)
        except UnicodeDecodeError as error:
            text = readable(error.object)
            meant = _MEANT.get(error_id(text) or 0, "NotImplemented")
            raise getattr(gentl, f"{meant}Exception")(text) from None

    return tolerant


def readable(raw: bytes) -> str:
    """A driver's text as far as it can be read: UTF-8, else plain characters with ? for the others."""
    return raw.decode("utf-8", "replace").replace("\N{REPLACEMENT CHARACTER}", "?")
