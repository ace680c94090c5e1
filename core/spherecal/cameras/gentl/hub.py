"""Producer files as loaded by one process, each in a Harvester of its own, and the devices they list."""

import logging
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from spherecal.cameras.gentl.driver_copy import hash_of, hold
from spherecal.cameras.gentl.features import plain
from spherecal.cameras.protocol import CameraInfo

# How long a producer may search its interfaces. Cameras on GigE answer a discovery within some ms on the same switch;
# other cameras are not served meanwhile, and hold 4 images (0.27 s at 15 frames/s).
SEARCH_MS = 200
# DEVICE_ACCESS_STATUS of GenTL
_ACCESS = {1: "free", 2: "busy", 3: "unreachable", 4: "busy", 5: "free", 6: "busy"}


class _Collected(logging.Handler):
    """Keeps the texts that Harvesters logs where it ought to raise."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(plain(Exception(record.getMessage())))


class Producer:
    """One loaded producer file.

    Harvesters says nothing when a file does not load and lists no devices: `problem` holds what it logged.
    """

    def __init__(self, file: str, load: str = "", sha256: str = "") -> None:
        from harvesters.core import Harvester

        self.file = file
        load = load or os.path.abspath(file)  # a bare name would be searched for on the loader's own path
        if sha256 and _hash_held(load) != sha256:
            self.problem = "it is not the file that was allowed"
            self._harvester: Any = None
            return
        logger = logging.getLogger(f"spherecal.cameras.harvesters.{Path(file).stem}")
        logger.propagate = False
        collected = _Collected()
        logger.addHandler(collected)
        import harvesters.core

        own = harvesters.core._logger
        own.addHandler(collected)
        own.propagate = False
        try:
            self._harvester = Harvester()
            self._harvester.timeout_for_update = SEARCH_MS
            self._harvester.add_file(load)
            self._harvester.update()
        finally:
            own.removeHandler(collected)
        loaded = bool(self._harvester._producers) and bool(self._harvester._systems)
        self.problem = "" if loaded else "; ".join(dict.fromkeys(collected.texts)) or "it could not be initialised"

    def rescan(self) -> None:
        """Look for plugged and unplugged cameras without disturbing the open ones.

        `Harvester.update` would end them all; the lists of the interfaces can be renewed one by one.
        """
        from harvesters.core import DeviceInfo

        found = []
        for interface in self._harvester._ifaces:
            interface.update_device_info_list(SEARCH_MS)
            found += [DeviceInfo(module=info, parent=interface) for info in interface.device_info_list]
        self._harvester.device_info_list[:] = found

    def devices(self) -> list[Any]:
        """What the last search listed."""
        return list(self._harvester.device_info_list)

    def find(self, serial: str) -> Any | None:
        """The listed device of this serial number."""
        return next((device for device in self.devices() if serial_of(device) == serial), None)

    def create(self, device: Any) -> Any:
        """Open a listed device: a Harvesters image acquirer."""
        return self._harvester.create(device)

    def infos(self) -> tuple[CameraInfo, ...]:
        """The listed devices in words."""
        return tuple(_info(device, self.file) for device in self.devices())

    def close(self) -> None:
        """Unload the file; can be done once."""
        with suppress(Exception):
            self._harvester.reset()


def _hash_held(path: str) -> str:
    try:
        hold(path)
        return hash_of(path)
    except OSError:
        return ""


def serial_of(device: Any) -> str:
    """A device's serial number; its id where it has none."""
    known = device.property_dict
    return str(known.get("serial_number") or known.get("id_") or "").strip()


def access_of(device: Any) -> str:
    """Whether a device can be opened now, as far as its producer says."""
    try:
        status = device.module.access_status
    except Exception:
        status = None
    return _ACCESS.get(int(status), "unknown") if status is not None else "unknown"


def _info(device: Any, file: str) -> CameraInfo:
    known = device.property_dict
    access = access_of(device)
    return CameraInfo(
        serial=serial_of(device),
        model=str(known.get("model") or ""),
        vendor=str(known.get("vendor") or ""),
        producer=file,
        transport=str(known.get("tl_type") or ""),
        user_name=str(known.get("user_defined_name") or ""),
        device_id=str(known.get("id_") or ""),
        access=access if access in ("free", "busy", "unreachable") else "unknown",
    )
