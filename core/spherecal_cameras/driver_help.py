"""Why no camera was found, or not all: no driver, one that is not allowed, one without cameras, another subnet."""

import ipaddress
import os
import socket
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from spherecal_cameras.network_lines import free_beside, network_lines
from spherecal_cameras.protocol import CameraError, Discovery
from spherecal_gentl.gige.gvcp import NetworkCamera, search

Trouble = Literal["no-driver", "not-allowed", "not-loaded", "no-cameras", "other-subnet"]


@dataclass(frozen=True)
class LocalAddress:
    """An address of this computer and the network interface that has it (empty where the system does not name it)."""

    interface: str
    address: str


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
    """
    found: list[DriverTrouble] = []
    if not discovery.producers:
        found.append(DriverTrouble("no-driver"))
    for one in discovery.producers:
        if not one.usable:
            kind: Trouble = "not-allowed" if one.refused else "not-loaded"
            found.append(DriverTrouble(kind, one.file, f"{one.message} {one.hint}".strip()))
    known = {camera.serial for camera in discovery.cameras}
    elsewhere = [one for one in answering if one.serial not in known and not _reached(one, local)]
    found += [
        DriverTrouble("other-subnet", camera=one, local=tuple(local), beside=free_beside(one)) for one in elsewhere
    ]
    if not discovery.cameras and not elsewhere:
        found += [DriverTrouble("no-cameras", one.file, one.message) for one in discovery.producers if one.usable]
    return tuple(found)


def _reached(camera: NetworkCamera, local: Iterable[LocalAddress]) -> bool:
    """Whether this computer has an address in the camera's network, on the interface where the camera answered."""
    try:
        network = ipaddress.ip_interface(f"{camera.address}/{camera.mask}").network
        return any(
            ipaddress.ip_address(one.address) in network for one in local if one.interface in ("", camera.interface)
        )
    except ValueError:  # the camera's own word, which may be anything
        return False


def local_addresses() -> tuple[LocalAddress, ...]:
    """The IPv4 addresses of the computer, without the loopback."""
    if sys.platform.startswith("linux"):
        return tuple(LocalAddress(line.interface, line.address) for line in network_lines())
    try:
        found = socket.gethostbyname_ex(socket.gethostname())[2]
    except OSError:
        return ()
    return tuple(LocalAddress("", one) for one in found if not ipaddress.ip_address(one).is_loopback)


def answering_cameras(local: Sequence[LocalAddress], seconds: float = 0.7) -> tuple[NetworkCamera, ...]:
    """The GigE cameras that answer to a broadcast from these addresses, of whatever subnet; blocking."""
    found: dict[tuple[str, ...], NetworkCamera] = {}
    for where in {one.interface: one for one in local}.values() if os.name == "posix" else local:
        try:
            for camera in search(where.interface, seconds, where.address):
                found.setdefault((camera.mac, camera.serial, camera.model, camera.address), camera)
        except OSError:  # down, or not allowed
            continue
    return tuple(found.values())
