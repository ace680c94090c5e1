"""The built-in driver, which libaravis gives, and what makes cameras usable that no driver lists."""

import ctypes.util
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_cameras.camera_network import WireCamera, found_on_wire
from spherecal_cameras.genicam.trust import TrustStore
from spherecal_cameras.makers import ANY_MAKER, maker_of, own_folder
from spherecal_cameras.network_lines import usb_cameras
from spherecal_cameras.protocol import CameraError, CameraInfo, Discovery
from spherecal_files.filesystem import write_whole
from spherecal_gentl.producer.build_producer import ARAVIS_CTI_FILE, aravis_flags, build_producer, cxx_compiler

Lack = Literal["linux", "libaravis", "libaravis-dev", "compiler"]
_PACKAGES = {"libaravis": "libaravis-0.8-0", "libaravis-dev": "libaravis-dev pkg-config", "compiler": "g++"}


@dataclass(frozen=True)
class BuiltinDriver:
    """Whether the built-in driver can be used: its file where there is one, what it lacks where not."""

    kind: Literal["installed", "can-be-built", "lacking"]  # installed: SphereCal's, or from `prepare`
    file: Path | None = None
    lacks: tuple[Lack, ...] = ()
    install: str = ""  # the command that brings what is lacking (Debian, Ubuntu); empty where nothing can


def state() -> BuiltinDriver:
    """What there is of the built-in driver on this machine; looks only, in some milliseconds."""
    if not sys.platform.startswith("linux"):
        return BuiltinDriver("lacking", lacks=("linux",))
    shipped = [Path(folder) / ARAVIS_CTI_FILE for folder in ANY_MAKER.linux]
    file = next((file for file in (*shipped, own_folder() / ARAVIS_CTI_FILE) if file.is_file()), None)
    lacks = _lacks_to_run() if file is not None else (*_lacks_to_run(), *_lacks_to_build())
    if lacks:
        packages = " ".join(dict.fromkeys(_PACKAGES[one] for one in lacks))
        return BuiltinDriver("lacking", file, lacks=lacks, install=f"sudo apt install {packages}")
    return BuiltinDriver("can-be-built") if file is None else BuiltinDriver("installed", file)


def _lacks_to_run() -> tuple[Lack, ...]:
    return () if ctypes.util.find_library("aravis-0.8") else ("libaravis",)


def _lacks_to_build() -> tuple[Lack, ...]:
    lacks: list[Lack] = []
    try:
        aravis_flags()
    except InputError:
        lacks.append("libaravis-dev")
    try:
        cxx_compiler()
    except InputError:
        lacks.append("compiler")
    return tuple(lacks)


def prepare(context: Context | None = None) -> Path:
    """Bring the built-in driver into use, built (some seconds) where it was not shipped, and allow it; its file."""
    found = state()
    if found.kind == "lacking":
        raise InputError(Phrase("error-builtin-driver", {"packages": found.install or "Linux"}))
    if context is not None:
        context.report("building the camera driver", 0.0)
    file = found.file
    if file is None or file.parent == own_folder():  # an update of SphereCal may have brought newer sources
        file = own_folder() / ARAVIS_CTI_FILE
        if not _lacks_to_build():
            made = build_producer(aravis=True)
            file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_whole(file, made.read_bytes())
    store = TrustStore()
    driver = store.look(str(file))
    if driver.state in ("new", "changed"):
        store.allow(driver)
    return file


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
    """What a camera says of itself on the network, told by serial number and address; None where it does not answer."""
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
