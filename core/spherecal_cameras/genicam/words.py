"""States of cameras in words: what the driver says, what that means, what to do.

All but `slow` return the state, its cause and its remedy.
"""

from spherecal_cameras.protocol import CameraState

_LOST = "Check its cable, its power and the network; it is opened again by itself when it answers."
_BUSY = (
    "Close the other program that uses it (a viewer of its maker, a second SphereCal), or switch the camera off and on."
)


def lost(driver_text: str) -> tuple[CameraState, str, str]:
    """A camera that stopped answering."""
    return CameraState.LOST, f"The camera no longer answers ({driver_text}).", _LOST


def not_listed() -> tuple[CameraState, str, str]:
    """A camera that no producer lists."""
    return CameraState.LOST, "The camera is not found.", _LOST


def busy(driver_text: str = "") -> tuple[CameraState, str, str]:
    """A camera that another program has open."""
    said = f" ({driver_text})" if driver_text else ""
    return CameraState.BUSY, f"Another program holds the camera{said}.", _BUSY


def unreachable(driver_text: str) -> tuple[CameraState, str, str]:
    """A camera that is listed but cannot be opened."""
    cause = f"The camera is seen, but cannot be reached ({driver_text})."
    remedy = (
        "Mostly two devices share an IP address, or the camera is in another subnet than this computer's network card: "
        "give it an address with its maker's configuration program."
    )
    return CameraState.LOST, cause, remedy


def failed(driver_text: str) -> tuple[CameraState, str, str]:
    """A camera that could not be opened for another reason."""
    return (
        CameraState.ERROR,
        f"The camera cannot be opened ({driver_text}).",
        "Switch it off and on; if that does not help, update its driver.",
    )


def no_description(problem: str) -> tuple[CameraState, str, str]:
    """A camera whose GenICam description is of no use."""
    return (
        CameraState.ERROR,
        f"The camera's description of its features cannot be read ({problem}).",
        "Update its firmware, or its driver.",
    )


def no_producer(file: str, problem: str) -> tuple[CameraState, str, str]:
    """A camera whose producer file did not load."""
    return (
        CameraState.ERROR,
        f"The driver {file} could not be loaded ({problem}).",
        "Run `spherecal cameras list`; install the driver again.",
    )


def no_trigger(hardware: bool) -> tuple[CameraState, str, str]:
    """A camera that waits for a hardware trigger, or does not answer software triggers."""
    if hardware:
        remedy = "Check the trigger box, its cable and the input that `trigger source` names."
        return CameraState.NO_TRIGGER, "No hardware trigger comes.", remedy
    cause = "The camera takes software triggers but sends no images."
    return CameraState.NO_TRIGGER, cause, "Switch it off and on; check its cable and network load."


def incomplete() -> tuple[CameraState, str, str]:
    """A camera whose images arrive with parts missing."""
    return (
        CameraState.INCOMPLETE_FRAMES,
        "Images arrive with parts missing.",
        "Use jumbo frames (MTU 9000) and a packet size to fit, raise the packet delay, check cable and switch.",
    )


def unreadable(problem: str) -> tuple[CameraState, str, str]:
    """A camera whose images arrive whole and cannot be used."""
    return (
        CameraState.ERROR,
        f"Images arrive, but cannot be read ({problem}).",
        "Choose another pixel format: Mono8 or BayerRG8.",
    )


def left_out(times: int) -> tuple[CameraState, str, str]:
    """A camera that ended the process again and again."""
    return (
        CameraState.ERROR,
        f"The camera's driver crashed {times} times in a row; the camera is left out.",
        "It is tried again after a minute. Update its driver, or unplug the camera.",
    )


def slow(serial: str, seconds: float) -> tuple[str, str]:
    """A camera that answers late: message and hint."""
    return (
        f"Camera {serial} took {seconds:.1f} s to answer; all cameras wait meanwhile.",
        "Check its cable and the load of its line; a camera that loses connection begins like this.",
    )
