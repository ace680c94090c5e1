"""Why no camera was found, or not all: no driver, one that is not allowed, one without cameras."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from spherecal.cameras.gige.network import WireCamera
from spherecal.cameras.protocol import CameraError, CameraInfo, Discovery

Trouble = Literal["no-driver", "not-allowed", "not-loaded", "no-cameras"]


@dataclass(frozen=True)
class DriverTrouble:
    """One reason: the driver's file with its own words; where there is none, the makers of cameras that answer."""

    kind: Trouble
    file: str = ""
    said: str = ""
    makers: tuple[str, ...] = ()


class NoCameras(CameraError):
    """No camera was found; `troubles` say why, `wire` has those that answer on the network all the same."""

    troubles: tuple[DriverTrouble, ...] = ()
    wire: tuple[WireCamera, ...] = ()


def driver_troubles(discovery: Discovery, wire: Iterable[WireCamera] = ()) -> tuple[DriverTrouble, ...]:
    """Why no camera was found, or not all.

    A driver without cameras is only a reason where no driver has any.

    Parameters
    ----------
    discovery
        What the drivers found.
    wire
        Cameras that answer on the network.
    """
    found: list[DriverTrouble] = []
    if not discovery.producers:
        makers = sorted({one.maker for one in wire if one.maker})
        found.append(DriverTrouble("no-driver", makers=tuple(makers)))
    for one in discovery.producers:
        if not one.usable:
            kind: Trouble = "not-allowed" if one.refused else "not-loaded"
            found.append(DriverTrouble(kind, one.file, f"{one.message} {one.hint}".strip()))
    if not discovery.cameras:
        found += [DriverTrouble("no-cameras", one.file, one.message) for one in discovery.producers if one.usable]
    return tuple(found)


def on_wire(info: CameraInfo, wire: Iterable[WireCamera]) -> WireCamera | None:
    """What a camera says of itself on the network; None where it does not answer there.

    Cameras of one serial number are told apart by what else the driver knows: address or hardware address.

    Parameters
    ----------
    info
        The camera as a driver lists it.
    wire
        Cameras that answer on the network.
    """
    alike = [one for one in wire if one.serial and info.serial.split(" (")[0] == one.serial]
    if len(alike) > 1:
        known = f"{info.serial} {info.device_id} {info.address}".lower()
        apart = [one for one in alike if one.ip_address in known or one.mac.lower() in known]
        alike = apart or [one for one in alike if one.mac.replace(":", "").lower() in known]
    return alike[0] if len(alike) == 1 else None


def unlisted(discovery: Discovery, wire: Iterable[WireCamera]) -> tuple[WireCamera, ...]:
    """The cameras that answer on the network and that no driver lists."""
    wire = tuple(wire)
    listed = {on_wire(info, wire) for info in discovery.cameras}
    return tuple(one for one in wire if one not in listed)
