"""One calibration in a profile: entry.json with what was known when it was saved, beside the files it vouches for."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from spherecal.base.errors import InputError
from spherecal.base.filesystem import read_below
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig, Verdict
from spherecal.files.json_file import JsonValue, finite, json_bytes, read_json, software_entry, version_of
from spherecal.files.rig_file import read_rig

FORMAT = "spherecal/profile-entry"
VERSION = 1
ENTRY_FILE = "entry.json"
RIG_FILE = "rig.json"
# What an entry may hold beside entry.json; no name out of a file is ever opened.
FILES = (RIG_FILE, "targets.json", "verification.json", "bars.csv", "covariance.npy", "points.csv")
# From version n to n + 1, by n: so that every profile that was ever written can be read.
MIGRATIONS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {}

# rig.json of 100 cameras has 0.2 MB, targets.json of 1000 targets 0.5 MB.
_MOST_BYTES = 64 << 20
_MOST_CAMERAS, _MOST_SETTINGS, _MOST_NUMBERS = 1000, 1000, 100

Setting = str | float | bool | list[float]


@dataclass(frozen=True)
class CameraEntry:
    """What is known of a camera: serial, model, optics, temperature and its settings (exposure, gain, ...) by name."""

    id: str
    serial: str | None = None
    model: str | None = None
    pixel_pitch_um: float | None = None
    focal_length_mm: float | None = None
    temperature_c: float | None = None
    settings: Mapping[str, Setting] | None = None


@dataclass(frozen=True)
class Entry:
    """A saved calibration; times are in UTC, `volume_mm` the low and high corner of its points in the rig's world.

    `care`: what it is to be used with care for, in words; empty where nothing is. `verdict` is that of the bars.
    """

    saved_at: datetime
    calibrated_at: datetime
    valid: bool
    rms_px: float | None
    sigma0: float | None
    input_sha256: str
    files: Mapping[str, str]
    cameras: tuple[CameraEntry, ...] = ()
    note: str = ""
    temperature_c: float | None = None
    sphere_diameter_mm: float | None = None
    scale_source: str = "none"
    scale_artefact: str | None = None
    scale_relative_uncertainty: float | None = None
    volume_mm: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    verdict: str | None = None
    bar_mean_error_mm: float | None = None
    bar_max_error_mm: float | None = None
    written_by: str = ""
    care: str = ""

    @property
    def calibration_verdict(self) -> Verdict:
        """One of the three words on the calibration."""
        return "not-valid" if not self.valid else "use-with-care" if self.care else "valid"


def entry_bytes(entry: Entry) -> bytes:
    """The contents of entry.json."""
    return json_bytes(
        {
            "format": FORMAT,
            "version": VERSION,
            "saved_at": entry.saved_at.isoformat(),
            "calibrated_at": entry.calibrated_at.isoformat(),
            "note": entry.note,
            "quality": {
                "valid": entry.valid,
                "verdict": entry.calibration_verdict,
                "care": entry.care,
                "rms_px": finite(entry.rms_px),
                "sigma0": finite(entry.sigma0),
            },
            "scale": {
                "source": entry.scale_source,
                "artefact": entry.scale_artefact,
                "relative_uncertainty": finite(entry.scale_relative_uncertainty),
            },
            "sphere_diameter_mm": finite(entry.sphere_diameter_mm),
            "temperature_c": finite(entry.temperature_c),
            "volume_mm": finite(entry.volume_mm),
            "verification": None
            if entry.verdict is None
            else {
                "verdict": entry.verdict,
                "mean_error_mm": finite(entry.bar_mean_error_mm),
                "max_abs_error_mm": finite(entry.bar_max_error_mm),
            },
            "cameras": [_camera_entry(camera) for camera in entry.cameras],
            "input_sha256": entry.input_sha256,
            "files_sha256": dict(entry.files),
            "software": software_entry(None),
        }
    )


def _camera_entry(camera: CameraEntry) -> dict[str, Any]:
    return {
        "id": camera.id,
        "serial": camera.serial,
        "model": camera.model,
        "pixel_pitch_um": finite(camera.pixel_pitch_um),
        "focal_length_mm": finite(camera.focal_length_mm),
        "temperature_c": finite(camera.temperature_c),
        "settings": None if camera.settings is None else dict(camera.settings),
    }


def migrated(
    path: Path, format_name: str, version: int, migrations: Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]]
) -> JsonValue:
    """A JSON file of ours, brought to `version` step by step; InputError for a later one or one without a way."""
    document = read_json(path, format_name, version, below=path.parent)
    found, minor = version_of(document)
    value = document.value
    assert isinstance(value, dict)
    for step in range(found, version):
        if step not in migrations:
            raise document.error(Phrase("problem-old-version", {"version": step}))
        value = {**migrations[step](dict(value)), "version": step + 1}
    return JsonValue(value, path, later=minor > 0)


def read_entry(folder: Path) -> Entry:
    """The entry in a folder of a profile's history; InputError where it is not as it was written."""
    f = migrated(folder / ENTRY_FILE, FORMAT, VERSION, MIGRATIONS).fields(
        ("saved_at", "calibrated_at", "quality", "scale", "cameras", "input_sha256", "files_sha256"),
        ("note", "temperature_c", "sphere_diameter_mm", "volume_mm", "verification", "software"),
    )
    quality = f["quality"].fields(("valid",), ("verdict", "care", "rms_px", "sigma0"))
    scale = f["scale"].fields(("source",), ("artefact", "relative_uncertainty"))
    bars = f["verification"].fields(("verdict",), ("mean_error_mm", "max_abs_error_mm")) if "verification" in f else {}
    software = f["software"].fields((), ("version",)) if "software" in f else {}
    cameras = f["cameras"].items()
    if len(cameras) > _MOST_CAMERAS:
        raise f["cameras"].error(Phrase("problem-many-entries", {"most": _MOST_CAMERAS}))
    return Entry(
        saved_at=f["saved_at"].time(),
        calibrated_at=f["calibrated_at"].time(),
        valid=quality["valid"].boolean(),
        rms_px=_optional(quality, "rms_px"),
        sigma0=_optional(quality, "sigma0"),
        input_sha256=f["input_sha256"].digest(),
        files=_read_files(f["files_sha256"]),
        cameras=tuple(_read_camera(camera) for camera in cameras),
        note=f["note"].text() if "note" in f else "",
        temperature_c=_temperature(f),
        sphere_diameter_mm=f["sphere_diameter_mm"].positive("mm") if "sphere_diameter_mm" in f else None,
        scale_source=scale["source"].text(),
        scale_artefact=scale["artefact"].text() if "artefact" in scale else None,
        scale_relative_uncertainty=_optional(scale, "relative_uncertainty"),
        volume_mm=_read_volume(f["volume_mm"]) if "volume_mm" in f else None,
        care=quality["care"].prose() if "care" in quality else "",
        verdict=bars["verdict"].text() if bars else None,
        bar_mean_error_mm=_optional(bars, "mean_error_mm", -1e30),
        bar_max_error_mm=_optional(bars, "max_abs_error_mm"),
        written_by=software["version"].text() if "version" in software else "",
    )


def _optional(fields: Mapping[str, JsonValue], key: str, least: float = 0.0) -> float | None:
    return fields[key].number(least) if key in fields else None


def _temperature(fields: Mapping[str, JsonValue]) -> float | None:
    return fields["temperature_c"].celsius() if "temperature_c" in fields else None


def _read_files(files: JsonValue) -> dict[str, str]:
    found = files.fields((RIG_FILE,), FILES[1:])
    return {name: value.text() for name, value in found.items()}


def _read_volume(volume: JsonValue) -> tuple[tuple[float, ...], tuple[float, ...]]:
    low, high = volume.matrix(2, 3)
    if any(a > b for a, b in zip(low, high, strict=True)):
        raise volume.error(Phrase("problem-low-corner"))
    return tuple(low), tuple(high)


def _read_camera(camera: JsonValue) -> CameraEntry:
    optional = ("serial", "model", "pixel_pitch_um", "focal_length_mm", "temperature_c", "settings")
    f = camera.fields(("id",), optional)
    return CameraEntry(
        id=f["id"].id(),
        serial=f["serial"].serial() if "serial" in f else None,
        model=f["model"].text() if "model" in f else None,
        pixel_pitch_um=f["pixel_pitch_um"].positive("um") if "pixel_pitch_um" in f else None,
        focal_length_mm=f["focal_length_mm"].positive("mm") if "focal_length_mm" in f else None,
        temperature_c=_temperature(f),
        settings=read_settings(f["settings"]) if "settings" in f else None,
    )


def read_settings(settings: JsonValue) -> dict[str, Setting]:
    """A camera's settings by name: numbers, texts, true or false, or a few numbers (a region)."""
    entries = settings.entries()
    if len(entries) > _MOST_SETTINGS:
        raise settings.error(Phrase("problem-many-settings", {"most": _MOST_SETTINGS}))
    return {name: _read_setting(value) for name, value in entries.items()}


def _read_setting(value: JsonValue) -> Setting:
    if isinstance(value.value, bool):
        return value.value
    if isinstance(value.value, list):
        return [item.number() for item in value.items()[:_MOST_NUMBERS]]
    return value.text() if isinstance(value.value, str) else value.number()


def sha256(path: Path) -> str:
    """The SHA-256 of a file; InputError where it cannot be read, is a link or far too large."""
    return hashlib.sha256(read_below(path.parent, path.name, _MOST_BYTES)).hexdigest()


def checked_rig(folder: Path, entry: Entry) -> Rig:
    """The rig of an entry; InputError where its file is not the one that was saved."""
    path = folder / RIG_FILE
    if sha256(path) != entry.files[RIG_FILE]:
        raise InputError(Phrase("error-changed-since", {"file": path}))
    return read_rig(path)
