"""Why no camera was found, or not all: no driver, one that is not allowed, one without cameras, another subnet."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from spherecal.base.messages.values import Phrase
from spherecal_cameras.camera_network import LocalAddress, reached
from spherecal_cameras.makers import maker_of
from spherecal_cameras.network_lines import free_beside
from spherecal_cameras.protocol import CameraError, Discovery
from spherecal_cameras.usb import UsbCamera
from spherecal_gentl.gige.gvcp import NetworkCamera

if TYPE_CHECKING:  # the window's start waits for no more than it must
    from spherecal_cameras.builtin_driver import BuiltinDriver

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


@dataclass(frozen=True)
class SeenCamera:
    """A camera that no driver lists and that answers all the same: by IP address, or on USB (`place`).

    `package` is its maker's driver package, empty where the maker is not known.
    """

    maker: str
    model: str
    serial: str
    place: str
    package: str


class NoCameras(CameraError):
    """No camera was found; `troubles` say why."""

    troubles: tuple[DriverTrouble, ...] = ()


def driver_troubles(
    discovery: Discovery, answering: Iterable[NetworkCamera] = (), local: Sequence[LocalAddress] = ()
) -> tuple[DriverTrouble, ...]:
    """Why no camera was found, or not all.

    A driver without cameras is only a reason where no driver has any.
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


def seen_without_driver(
    discovery: Discovery, answering: Iterable[NetworkCamera], usb: Iterable[UsbCamera] = ()
) -> tuple[SeenCamera, ...]:
    """The cameras that answer on the wire or hang on the bus, and that no driver lists."""
    known = {camera.serial for camera in discovery.cameras}
    found = [(one.vendor, one.model, one.serial, one.address) for one in answering]
    found += [(one.maker, one.model, one.serial, "USB") for one in usb]
    return tuple(
        SeenCamera(vendor, model, serial, place, "" if (maker := maker_of(vendor)) is None else maker.driver)
        for vendor, model, serial, place in found
        if serial not in known
    )


def driver_advice(seen: Sequence[SeenCamera], builtin: "BuiltinDriver") -> tuple[Phrase, ...]:
    """What answers although no driver lists it, and what makes it usable: a maker's package or the built-in driver."""
    if not seen:
        return ()
    cameras = [Phrase("driver-camera", vars(one)) for one in seen]
    found = [Phrase("driver-answering", {"count": len(seen), "cameras": cameras})]
    packages = sorted({one.package for one in seen if one.package})
    found += [Phrase("driver-package", {"packages": packages})] if packages else []
    if builtin.kind == "can-be-built":
        found.append(Phrase("driver-builtin"))
    elif builtin.install:
        found.append(Phrase("driver-builtin-lacks", {"command": builtin.install}))
    return tuple(found)
