"""What a camera's states, drivers' errors and replies are called in words."""

import functools
from collections.abc import Callable
from types import BuiltinFunctionType
from typing import Any

from spherecal_cameras.genicam.features import TABLE
from spherecal_cameras.protocol import CameraState


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
            meant = TABLE["errors"].get(str(error_id(text)), "NotImplemented")
            raise getattr(gentl, f"{meant}Exception")(text) from None

    return tolerant


def readable(raw: bytes) -> str:
    """A driver's text as far as it can be read: UTF-8, else plain characters with ? for the others."""
    return raw.decode("utf-8", "replace").replace("\N{REPLACEMENT CHARACTER}", "?")


def state_in_words(what: str, **values: object) -> tuple[CameraState, str, str]:
    """The state of a camera to which this happens, its cause and its remedy."""
    about = TABLE["states"][what]
    return CameraState[about["state"]], about["cause"].format(**values), about["remedy"]


def slow(serial: str, seconds: float) -> tuple[str, str]:
    """A camera that answers late: message and hint."""
    return (
        f"Camera {serial} took {seconds:.1f} s to answer; all cameras wait meanwhile.",
        "Check its cable and the load of its line; a camera that loses connection begins like this.",
    )
