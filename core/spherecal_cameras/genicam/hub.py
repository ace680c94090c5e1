"""Producer files as loaded by one process, each in a Harvester of its own, and the devices they list."""

import logging
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from spherecal_cameras.genicam.features import FeatureError, NodeFeatures, plain
from spherecal_cameras.genicam.setup import ACTION_DEVICE_KEY, ACTION_GROUP_KEY, ACTION_GROUP_MASK
from spherecal_cameras.genicam.trust import hash_of, hold
from spherecal_cameras.genicam.words import tolerate_any_text
from spherecal_cameras.protocol import CameraInfo

# How long a producer may search its interfaces. Cameras on GigE answer a discovery within some ms on the same switch;
# other cameras are not served meanwhile, and hold 4 images (0.27 s at 15 frames/s).
SEARCH_MS = 200
# DEVICE_ACCESS_STATUS of GenTL
_PREFERRED = ("free", "unknown", "busy", "unreachable")
_MAC = re.compile(r"(?:[0-9A-Fa-f]{2}[:-]){5}[0-9A-Fa-f]{2}")
_ADDRESS = re.compile(r"(?<![\d.])(?:\d{1,3}\.){3}\d{1,3}(?![\d.])")
_ACCESS = {1: "free", 2: "busy", 3: "unreachable", 4: "busy", 5: "free", 6: "busy"}


class _Collected(logging.Handler):
    """Keeps the texts that Harvesters logs where it ought to raise."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(plain(Exception(record.getMessage())))


class Producer:
    """One loaded producer file; `problem` is what Harvesters logged of one that does not load."""

    def __init__(self, file: str, load: str = "", sha256: str = "") -> None:
        from harvesters.core import Harvester

        tolerate_any_text()
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
        """Look for plugged and unplugged cameras by interface: `Harvester.update` would end the open ones."""
        from harvesters.core import DeviceInfo

        found = []
        for interface in self._harvester._ifaces:
            interface.update_device_info_list(SEARCH_MS)
            found += [DeviceInfo(module=info, parent=interface) for info in interface.device_info_list]
        self._harvester.device_info_list[:] = found

    def devices(self) -> list[Any]:
        """What the last search listed."""
        return list(self._harvester.device_info_list)

    def find(self, serial: str, device_id: str = "") -> Any | None:
        """The listed device of this serial number, of several that of this id, or one that can be opened."""
        found = [device for device in self.devices() if serial in _names(device)]
        found = [device for device in found if _text(device, "id_") == device_id] or found
        return min(found, key=lambda device: _PREFERRED.index(access_of(device)), default=None)

    def create(self, device: Any) -> Any:
        """Open a listed device: a Harvesters image acquirer."""
        return self._harvester.create(device)

    def act(self, at_ns: int) -> None:
        """Send an action command for a moment (ns) of the cameras' common clock, by the standard's features."""
        sent = False
        for module in (*self._harvester._systems, *self._harvester._ifaces):
            features = NodeFeatures(module.node_map)
            if features.node("ActionCommand") is None:
                continue
            keys = (("ActionDeviceKey", ACTION_DEVICE_KEY), ("ActionGroupKey", ACTION_GROUP_KEY),
                    ("ActionGroupMask", ACTION_GROUP_MASK), ("ActionScheduledTime", at_ns))  # fmt: skip
            if features.node("ActionScheduledTimeEnable") is not None:
                features.write("ActionScheduledTimeEnable", True)
            for name, value in keys:
                features.write(name, value)
            features.execute("ActionCommand")
            sent = True
            if module in self._harvester._systems:  # it sends on every interface
                break
        if not sent:
            raise FeatureError("its driver sends no action commands")

    def infos(self) -> tuple[CameraInfo, ...]:
        """The listed devices in words, each once; where several have one serial number, their names have more parts."""
        alike: dict[str, list[Any]] = {}
        for device in self.devices():
            alike.setdefault(serial_of(device), []).append(device)
        found: dict[str, CameraInfo] = {}
        for devices in alike.values():
            for serial, device in _distinct(devices):
                info = replace(_info(device, self.file), serial=serial)
                held = found.get(serial)
                if held is None or _PREFERRED.index(info.access) < _PREFERRED.index(held.access):
                    found[serial] = info
        return tuple(found.values())

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
    return clean(known.get("serial_number")) or clean(known.get("id_"))


def clean(text: Any) -> str:
    """A driver's text (UTF-8, else Latin-1) on one line, without characters that cannot be printed."""
    raw = str(text or "").encode("utf-8", "surrogateescape")
    try:
        plain_text = raw.decode("utf-8")
    except UnicodeDecodeError:
        plain_text = raw.decode("latin-1")
    return " ".join("".join(c if c.isprintable() else " " for c in plain_text).split())


def _kind(device: Any) -> tuple[str, str]:
    known = device.property_dict
    return clean(known.get("vendor")).lower(), clean(known.get("model")).lower()


def _names(device: Any) -> tuple[str, ...]:
    """What a device may be called: its serial number, or with its model or its id where others have the same one."""
    serial = serial_of(device)
    return serial, *(f"{serial} ({one})" for one in (_text(device, "model"), *_apart(device)))


def _text(device: Any, key: str) -> str:
    return clean(device.property_dict.get(key))


def _apart(device: Any) -> tuple[str, str, str]:
    """What tells a device from others of its kind and serial number: MAC, network address, id; empty where unknown."""
    known = _text(device, "id_"), _text(device, "display_name")
    mac, address = (next(filter(None, map(one.search, known)), None) for one in (_MAC, _ADDRESS))
    return mac[0].replace("-", ":").lower() if mac else "", address[0] if address else "", known[0]


def _distinct(devices: Sequence[Any]) -> list[tuple[str, Any]]:
    """Names for devices of one serial number: of one kind on two interfaces they are the same camera."""
    kinds = {_kind(device) for device in devices}
    if len(kinds) > 1:
        return [(_names(device)[1], device) for device in devices]
    by_interface: dict[int, set[str]] = {}
    for device in devices:
        by_interface.setdefault(id(device.parent), set()).add(_text(device, "id_"))
    apart = any(len(ids) > 1 for ids in by_interface.values())
    ids = len({_text(device, "id_") for device in devices})
    by = next(k for k in range(3) if k == 2 or len({_apart(device)[k] for device in devices} - {""}) == ids)
    return [(_names(device)[2 + by if apart else 0], device) for device in devices]


def access_of(device: Any) -> str:
    """Whether a device can be opened now, as far as its producer says: `free`, `busy`, `unreachable` or `unknown`."""
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
        model=clean(known.get("model")),
        vendor=clean(known.get("vendor")),
        producer=file,
        transport=clean(known.get("tl_type")),
        user_name=clean(known.get("user_defined_name")),
        device_id=clean(known.get("id_")),
        address=_apart(device)[1],
        access=access if access in ("free", "busy", "unreachable") else "unknown",
    )
