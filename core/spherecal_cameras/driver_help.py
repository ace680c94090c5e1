"""Why no camera was found, or not all: no driver, one that is not allowed, one without cameras."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from spherecal.base.messages.values import Phrase
from spherecal_cameras.camera_network import WireCamera, found_on_wire
from spherecal_cameras.makers import maker_of
from spherecal_cameras.protocol import CameraError, CameraInfo, Discovery
from spherecal_cameras.usb import usb_cameras

if TYPE_CHECKING:  # the window's start waits for no more than it must
    from spherecal_cameras.builtin_driver import BuiltinDriver

Trouble = Literal["no-driver", "not-allowed", "not-loaded", "no-cameras", "wrong-driver"]


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
    """Why no camera was found, or not all. A driver without cameras is only a reason where no driver has any."""
    found: list[DriverTrouble] = []
    near = [one for one in wire if one.subnet_ok]
    makers = tuple(sorted({one.maker for one in near if one.maker}))
    if not discovery.producers:
        found.append(DriverTrouble("no-driver", makers=makers))
    for one in discovery.producers:
        if not one.usable:
            kind: Trouble = "not-allowed" if one.refused else "not-loaded"
            found.append(DriverTrouble(kind, one.file, f"{one.message} {one.hint}".strip()))
    if not discovery.cameras:
        kind = "wrong-driver" if near else "no-cameras"
        found += [DriverTrouble(kind, one.file, one.message, makers) for one in discovery.producers if one.usable]
    return tuple(found)


def answering(network: bool = True) -> tuple[WireCamera, ...]:
    """Every camera that answers without a driver, on the network or on USB (its address is `USB` then); blocking."""
    usb = (
        WireCamera("", "USB", "", one.maker, one.model, one.serial, "", "", subnet_ok=True, controlled_by_other=None)
        for one in usb_cameras()
    )
    return (*(found_on_wire() if network else ()), *usb)


def on_wire(info: CameraInfo, wire: Iterable[WireCamera]) -> WireCamera | None:
    """What a camera says of itself on the network; None where it does not answer there.

    Cameras of one serial number are told apart by what else the driver knows: address or hardware address.
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


def driver_advice(seen: Sequence[WireCamera], builtin: "BuiltinDriver") -> tuple[Phrase, ...]:
    """What answers although no driver lists it, and what makes it usable: a maker's package or the built-in driver."""
    if not seen:
        return ()
    cameras = [Phrase("driver-camera", {**vars(one), "place": one.ip_address}) for one in seen]
    found = [Phrase("driver-answering", {"count": len(seen), "cameras": cameras})]
    packages = sorted({maker.driver for one in seen if (maker := maker_of(one.maker)) is not None})
    found += [Phrase("driver-package", {"packages": packages})] if packages else []
    if builtin.kind == "can-be-built":
        found.append(Phrase("driver-builtin"))
    elif builtin.install:
        found.append(Phrase("driver-builtin-lacks", {"command": builtin.install}))
    return tuple(found)
