"""The camera profile `cameras.json`: what the user says about cameras and drivers, kept by serial number."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from spherecal.cameras.protocol import CameraSettings, Region
from spherecal.files.atomic import write_file_whole
from spherecal.files.json_file import JsonValue, read_json, unique

FORMAT = "spherecal/cameras"
VERSION = 1
_TRIGGERS = ("software", "hardware", "free", "scheduled")
_OPTIONAL = (
    "exposure_us", "gain_db", "pixel_format", "region", "trigger", "trigger_source", "frame_rate_hz", "packet_size",
    "packet_delay", "frame_delay",
)  # fmt: skip


@dataclass(frozen=True)
class CameraDescription:
    """One camera: the name people know it by, its settings, and of its lens and sensor what a session needs."""

    serial: str
    name: str | None = None
    settings: CameraSettings = field(default_factory=CameraSettings)
    focal_length_mm: float | None = None
    pixel_pitch_um: float | None = None


@dataclass(frozen=True)
class CameraProfile:
    """All that is kept: cameras by serial, and the user's own driver files or folders."""

    cameras: dict[str, CameraDescription] = field(default_factory=dict)
    producers: tuple[str, ...] = ()

    def entry(self, serial: str) -> CameraDescription:
        """What is known of a camera; defaults for one that was never set."""
        return self.cameras.get(serial, CameraDescription(serial))

    def settings(self) -> dict[str, CameraSettings]:
        """The settings by serial."""
        return {serial: entry.settings for serial, entry in self.cameras.items()}

    def serial_of(self, name: str) -> str | None:
        """The serial number of a camera by its name."""
        return next((serial for serial, entry in self.cameras.items() if entry.name == name), None)

    def with_entry(self, entry: CameraDescription) -> "CameraProfile":
        """The profile with one camera's entry exchanged or added."""
        return replace(self, cameras={**self.cameras, entry.serial: entry})


def default_profile_path() -> Path:
    """Where the profile is kept unless the user names a file."""
    from platformdirs import user_config_path

    return user_config_path("spherecal", appauthor=False) / "cameras.json"


def read_profile(path: Path) -> CameraProfile:
    """The profile in a file, an empty one where there is no such file; InputError where it cannot be read."""
    if not path.exists():
        return CameraProfile()
    f = read_json(path, FORMAT, VERSION).fields((), ("cameras", "producers"))
    values = f["cameras"].items() if "cameras" in f else []
    entries = [_read_entry(value) for value in values]
    unique(values, [entry.serial for entry in entries], "serial")
    named = [(value, entry.name) for value, entry in zip(values, entries, strict=True) if entry.name]
    unique([value for value, _ in named], [name for _, name in named], "name")
    producers = tuple(value.text() for value in f["producers"].items()) if "producers" in f else ()
    return CameraProfile({entry.serial: entry for entry in entries}, producers)


def _read_entry(value: JsonValue) -> CameraDescription:
    f = value.fields(("serial",), ("name", "settings", "focal_length_mm", "pixel_pitch_um"))
    return CameraDescription(
        serial=f["serial"].serial(),
        name=f["name"].name() if "name" in f else None,
        settings=read_settings(f["settings"]) if "settings" in f else CameraSettings(),
        focal_length_mm=f["focal_length_mm"].positive("mm") if "focal_length_mm" in f else None,
        pixel_pitch_um=f["pixel_pitch_um"].positive("um") if "pixel_pitch_um" in f else None,
    )


def read_settings(value: JsonValue) -> CameraSettings:
    """A camera's settings; what is absent has its default."""
    f = value.fields((), _OPTIONAL)
    given: dict[str, Any] = {}
    for key in ("exposure_us", "frame_rate_hz"):
        if key in f:
            given[key] = f[key].positive()
    if "gain_db" in f:
        given["gain_db"] = f["gain_db"].number(-20, 60, "dB")
    for key in ("pixel_format", "trigger_source"):
        if key in f:
            given[key] = f[key].text()
    for key in ("packet_size", "packet_delay", "frame_delay"):
        if key in f:
            given[key] = f[key].integer(0, 10**9)
    if "trigger" in f:
        given["trigger"] = f["trigger"].choice(*_TRIGGERS)
    if "region" in f:
        x, y, width, height = (int(side.integer(0, 65536)) for side in f["region"].items(4))
        given["region"] = Region(x, y, width, height)
    return CameraSettings(**given)


def write_profile(path: Path, profile: CameraProfile) -> None:
    """Write the profile whole; OutputError if that fails."""
    document: dict[str, Any] = {"format": FORMAT, "version": VERSION}
    if profile.producers:
        document["producers"] = list(profile.producers)
    document["cameras"] = [_entry_json(entry) for _, entry in sorted(profile.cameras.items())]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file_whole(path, (json.dumps(document, indent=1) + "\n").encode())


def _entry_json(entry: CameraDescription) -> dict[str, Any]:
    known = {
        "serial": entry.serial,
        "name": entry.name,
        "focal_length_mm": entry.focal_length_mm,
        "pixel_pitch_um": entry.pixel_pitch_um,
        "settings": settings_json(entry.settings),
    }
    return {key: value for key, value in known.items() if value is not None}


def settings_json(settings: CameraSettings) -> dict[str, Any]:
    """All settings, as they stand in the profile; what is None is left out."""
    values = {key: getattr(settings, key) for key in _OPTIONAL}
    if settings.region is not None:
        r = settings.region
        values["region"] = [r.x, r.y, r.width, r.height]
    return {key: value for key, value in values.items() if value is not None}
