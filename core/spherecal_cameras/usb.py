"""USB3 Vision cameras on the bus, seen without any driver (Linux; on Windows and macOS none are looked for)."""

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_DEVICES, _NODES = Path("/sys/bus/usb/devices"), Path("/dev/bus/usb")
_CLASS, _SUBCLASS = "ef", "05"  # of a USB3 Vision interface
_USB3_MBIT_S = 5000.0


@dataclass(frozen=True)
class UsbCamera:
    """A USB3 Vision camera as its plug names it.

    `mbit_s` is its bus's speed, below 5000 where it hangs on a USB 2 port or cable; None where that is not known.
    `allowed`: this user may open it, else a udev rule is missing. Cameras of one `bus` share what it carries.
    """

    vendor_id: str
    product_id: str
    maker: str
    model: str
    serial: str
    mbit_s: float | None
    allowed: bool
    bus: str = ""

    @property
    def slow(self) -> bool:
        """Whether it hangs on less than USB 3."""
        return self.mbit_s is not None and self.mbit_s < _USB3_MBIT_S


def usb_cameras(devices: Path = _DEVICES, nodes: Path = _NODES) -> tuple[UsbCamera, ...]:
    """Every USB3 Vision camera on the bus, sorted by maker, model and serial number."""
    vision = {
        interface.parent / interface.name.partition(":")[0]
        for interface in devices.glob("*:*")
        if (_said(interface, "bInterfaceClass"), _said(interface, "bInterfaceSubClass")) == (_CLASS, _SUBCLASS)
    }
    found = [_camera(device, nodes) for device in vision if device.is_dir()]
    return tuple(sorted(found, key=lambda one: (one.maker, one.model, one.serial)))


def _camera(device: Path, nodes: Path) -> UsbCamera:
    speed = None
    with suppress(ValueError):
        speed = float(_said(device, "speed"))
    node = nodes / _said(device, "busnum").zfill(3) / _said(device, "devnum").zfill(3)
    return UsbCamera(
        _said(device, "idVendor"),
        _said(device, "idProduct"),
        _said(device, "manufacturer"),
        _said(device, "product"),
        _said(device, "serial"),
        speed,
        os.access(node, os.R_OK | os.W_OK),
        _said(device, "busnum"),
    )


def _said(folder: Path, name: str) -> str:
    try:
        text = (folder / name).read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
    return "".join(c if c.isprintable() else "?" for c in text)
