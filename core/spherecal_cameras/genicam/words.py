"""What a camera's states, drivers' errors and replies are called in words."""

import functools
from collections.abc import Callable
from types import BuiltinFunctionType
from typing import Any

from spherecal_cameras.protocol import CameraState

# The errors of GenTL by their codes, as genicam names their classes; what is not among them was never implemented.
_MEANT = {
    -1001: "Error", -1002: "NotInitialized", -1003: "NotImplemented", -1004: "ResourceInUse", -1005: "AccessDenied",
    -1006: "InvalidHandle", -1007: "InvalidId", -1008: "NoData", -1009: "InvalidParameter", -1010: "Io",
    -1011: "Timeout", -1012: "Abort", -1013: "InvalidBuffer", -1014: "NotAvailable", -1015: "InvalidAddress",
    -1016: "BufferTooSmall", -1017: "InvalidIndex", -1018: "ParsingChunkData", -1019: "InvalidValue",
    -1020: "ResourceExhausted", -1021: "OutOfMemory", -1022: "Busy",
}  # fmt: skip


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


_LOST = "Check its cable, its power and the network; it is opened again by itself when it answers."
_BUSY = (
    "Close the other program that uses it (a viewer of its maker, a second SphereCal), or switch the camera off and on."
)
_UNREACHABLE = (
    "Mostly two devices share an IP address, or the camera is in another subnet than this computer's network card: "
    "give it an address with its maker's configuration program."
)
_INCOMPLETE = "Use jumbo frames (MTU 9000) and a packet size to fit, raise the packet delay, check cable and switch."
_OFF_AND_ON = "Switch it off and on; if that does not help, update its driver."
_NO_HARDWARE = "Check the trigger box, its cable and the input that `trigger source` names."
_CRASHED = "The camera's driver crashed {times} times in a row; the camera is left out."
# What happens to a camera: its state, the cause (`why` is what the driver says) and the remedy.
_STATES = {
    "lost": (CameraState.LOST, "The camera no longer answers ({why}).", _LOST),
    "not listed": (CameraState.LOST, "The camera is not found.", _LOST),
    "busy": (CameraState.BUSY, "Another program holds the camera{why}.", _BUSY),
    "unreachable": (CameraState.LOST, "The camera is seen, but cannot be reached ({why}).", _UNREACHABLE),
    "failed": (CameraState.ERROR, "The camera cannot be opened ({why}).", _OFF_AND_ON),
    "no description": (
        CameraState.ERROR,
        "The camera's description of its features cannot be read ({why}).",
        "Update its firmware, or its driver.",
    ),
    "no producer": (
        CameraState.ERROR,
        "The driver {file} could not be loaded ({why}).",
        "Run `spherecal cameras list`; install the driver again.",
    ),
    "no hardware trigger": (CameraState.NO_TRIGGER, "No hardware trigger comes.", _NO_HARDWARE),
    "no software trigger": (
        CameraState.NO_TRIGGER,
        "The camera takes software triggers but sends no images.",
        "Switch it off and on; check its cable and network load.",
    ),
    "incomplete": (CameraState.INCOMPLETE_FRAMES, "Images arrive with parts missing.", _INCOMPLETE),
    "unreadable": (
        CameraState.ERROR,
        "Images arrive, but cannot be read ({why}).",
        "Choose another pixel format: Mono8 or BayerRG8.",
    ),
    "left out": (
        CameraState.ERROR,
        _CRASHED,
        "It is tried again after a minute. Update its driver, or unplug the camera.",
    ),
}


def state_in_words(what: str, **values: object) -> tuple[CameraState, str, str]:
    """The state of a camera to which this happens, its cause and its remedy."""
    state, cause, remedy = _STATES[what]
    return state, cause.format(**values), remedy


def slow(serial: str, seconds: float) -> tuple[str, str]:
    """A camera that answers late: message and hint."""
    return (
        f"Camera {serial} took {seconds:.1f} s to answer; all cameras wait meanwhile.",
        "Check its cable and the load of its line; a camera that loses connection begins like this.",
    )
