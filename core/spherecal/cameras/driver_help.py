"""Why no camera was found, or not all: no driver, one that is not allowed, one without cameras, another subnet."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from spherecal.cameras.gige.gvcp import NetworkCamera
from spherecal.cameras.gige.lines import free_beside
from spherecal.cameras.gige.network import LocalAddress, reached
from spherecal.cameras.protocol import CameraError, Discovery

Trouble = Literal["no-driver", "not-allowed", "not-loaded", "no-cameras", "other-subnet"]


@dataclass(frozen=True)
class DriverTrouble:
    """One reason: the driver's file with its own words, or a camera with the address that would reach it.

    `beside` is an address for this computer in the camera's network, such as 192.168.7.254/24; `local` are the
    addresses that it has.
    """

    kind: Trouble
    file: str = ""
    said: str = ""
    camera: NetworkCamera | None = None
    local: tuple[LocalAddress, ...] = ()
    beside: str = ""


class NoCameras(CameraError):
    """No camera was found; `troubles` say why."""

    troubles: tuple[DriverTrouble, ...] = ()


def driver_troubles(
    discovery: Discovery, answering: Iterable[NetworkCamera] = (), local: Sequence[LocalAddress] = ()
) -> tuple[DriverTrouble, ...]:
    """Why no camera was found, or not all.

    A driver without cameras is only a reason where no driver has any.

    Parameters
    ----------
    discovery
        What the drivers found.
    answering
        Cameras that a broadcast found (`answering_cameras`).
    local
        This computer's addresses.
    """
    found: list[DriverTrouble] = []
    if not discovery.producers:
        found.append(DriverTrouble("no-driver"))
    for one in discovery.producers:
        if not one.usable:
            kind: Trouble = "not-allowed" if one.refused else "not-loaded"
            found.append(DriverTrouble(kind, one.file, f"{one.message} {one.hint}".strip()))
    known = {camera.serial for camera in discovery.cameras}
    elsewhere = [one for one in answering if one.serial not in known and not reached(one, local)]
    found += [
        DriverTrouble("other-subnet", camera=one, local=tuple(local), beside=free_beside(one)) for one in elsewhere
    ]
    if not discovery.cameras and not elsewhere:
        found += [DriverTrouble("no-cameras", one.file, one.message) for one in discovery.producers if one.usable]
    return tuple(found)
