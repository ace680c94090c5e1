"""A result folder taken into a profile: what is known of the rig when it is saved."""

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig
from spherecal.data.session import CameraSpec, CapturedSet, Session
from spherecal.data.verdict_words import named
from spherecal_cameras.camera_settings import SETTINGS, read_profile
from spherecal_files.capture_file import last_taken, read_captured_sets
from spherecal_files.filesystem import read_below
from spherecal_files.json_file import read_bytes, read_json
from spherecal_files.read_session import FORMAT, SESSION_FILE, VERSION, read_session
from spherecal_files.rig_file import read_rig
from spherecal_files.target_set_file import TARGETS
from spherecal_files.verification_file import VERIFICATION
from spherecal_files.write_result import POINT_COLUMNS
from spherecal_rigs.entry import FILES, RIG_FILE, CameraEntry, Entry
from spherecal_rigs.result_folder import read_csv
from spherecal_rigs.store import Profile, add_entry

_MOST_BYTES = 64 << 20


@dataclass(frozen=True)
class SaveOptions:
    """What a result folder does not say: its session, the cameras.json with their settings, temperature, note, time."""

    session: Path | None = None
    settings: Path | None = None
    temperature_c: float | None = None
    note: str = ""
    calibrated_at: datetime | None = None


def save_result(profile: Profile, result: Path, options: SaveOptions | None = None) -> str:
    """Add a result folder to a profile's history; the new calibration's id."""
    return add_entry(profile, *prepare(result, options))


def prepare(result: Path, options: SaveOptions | None = None) -> tuple[Entry, dict[str, bytes]]:
    """The entry and the files of a result folder, as a profile keeps them."""
    o = options or SaveOptions()
    rig_path = result / RIG_FILE
    rig = read_rig(rig_path)
    if not rig.cameras:
        raise InputError(Phrase("error-nothing-to-save", {"file": rig_path}))
    session = _session_of(o.session, rig)
    captured = () if o.session is None else read_captured_sets(o.session)
    bars = VERIFICATION.read(result / VERIFICATION.file) if (result / VERIFICATION.file).is_file() else None
    now = datetime.now(UTC).replace(microsecond=0)
    written = datetime.fromtimestamp(rig_path.stat().st_mtime, UTC).replace(microsecond=0)
    entry = Entry(
        saved_at=now,
        calibrated_at=o.calibrated_at or rig.recorded_at or last_taken(captured) or min(now, written),
        valid=rig.quality.valid,
        care=named(rig.quality.affected),
        rms_px=rig.quality.rms_px,
        sigma0=rig.quality.sigma0,
        input_sha256=rig.input_sha256,
        files={},
        cameras=_cameras(rig, session, o.settings, _mean_temperatures(captured)),
        note=o.note,
        temperature_c=o.temperature_c if o.temperature_c is not None else _bar_temperature(session),
        sphere_diameter_mm=session.sphere_diameter_mm if session else None,
        scale_source=rig.scale.source,
        scale_artefact=_artefact(session),
        scale_relative_uncertainty=rig.scale.relative_uncertainty,
        volume_mm=points_box(result / "points.csv"),
        verdict=None if bars is None else bars.verdict,
        bar_mean_error_mm=None if bars is None else bars.mean_error_mm,
        bar_max_error_mm=None if bars is None else bars.max_abs_error_mm,
        failed=bars is not None and bars.failed,
        override=None if bars is None else bars.override,
    )
    return entry, _files(result, session)


def _session_of(folder: Path | None, rig: Rig) -> Session | None:
    if folder is None:
        return None
    session = read_session(folder)
    if session.input_sha256 != rig.input_sha256:
        raise InputError(Phrase("error-other-session", {"folder": folder}))
    return session


def _mean_temperatures(captured: Collection[CapturedSet]) -> dict[str, float]:
    warm: dict[str, list[float]] = {}
    for one in captured:
        for camera, degrees in one.temperatures_c.items():
            warm.setdefault(camera, []).append(degrees)
    return {camera: float(np.mean(values)) for camera, values in warm.items()}


def _cameras(
    rig: Rig, session: Session | None, settings: Path | None, warm: Mapping[str, float]
) -> tuple[CameraEntry, ...]:
    """Each camera as the rig, the session, the camera profile and the capture know it."""
    specs = {spec.id: spec for spec in session.cameras} if session else {}
    if settings is not None and not settings.is_file():
        raise InputError(Phrase("error-no-camera-settings", {"file": settings}))
    kept = {} if settings is None else read_profile(settings).cameras
    entries = []
    for camera in rig.cameras:
        spec = specs.get(camera.id) or CameraSpec(camera.id, camera.image_size, camera.intrinsics, False, camera.id)
        serial = camera.serial or spec.serial
        own = kept.get(serial or "")
        entries.append(
            CameraEntry(
                id=camera.id,
                serial=serial,
                model=spec.model,
                pixel_pitch_um=spec.pixel_pitch_um or (own.pixel_pitch_um if own else None),
                focal_length_mm=spec.focal_length_mm or (own.focal_length_mm if own else None),
                temperature_c=warm.get(camera.id),
                settings=SETTINGS.entry(own.settings) if own else None,
            )
        )
    return tuple(entries)


def _bar_temperature(session: Session | None) -> float | None:
    """The mean of the bar poses' temperatures."""
    found = [pose.temperature_c for pose in session.bar_poses if pose.temperature_c is not None] if session else []
    return float(np.mean(found)) if found else None


def _artefact(session: Session | None) -> str | None:
    """What gave the scale, in words."""
    scale = session.scale if session else None
    if scale is None or scale.kind == "none":
        return None
    if scale.kind == "bar":
        bar = next((bar for bar in session.bars if bar.id == scale.bar), None) if session else None
        lengths = ", ".join(f"{length.length_mm:g} mm" for length in bar.lengths) if bar else ""
        return f"bar {scale.bar}" + (f" ({lengths})" if lengths else "")
    return f"{scale.from_point} to {scale.to_point} of a target, {scale.distance_mm:g} mm ({scale.surface})"


def points_box(path: Path) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """The corners (3,), mm, of the box of 98 % of the points along each axis, so without wrong ones; or None."""
    if not path.is_file():
        return None
    table = read_csv(path, POINT_COLUMNS)
    points = np.column_stack([table.numbers(f"{axis}_mm") for axis in "xyz"])
    if not len(points):
        return None
    low, high = np.percentile(points, (1, 99), axis=0)
    return tuple(low.tolist()), tuple(high.tolist())


def _files(result: Path, session: Session | None) -> dict[str, bytes]:
    there = [name for name in FILES if os.path.lexists(result / name)]
    files = {name: read_below(result, name, _MOST_BYTES) for name in there}  # what a link leads to is not taken over
    if session is None or session.folder == Path():  # one in memory is not the one in the working folder
        return files
    if session.target_set is not None and "targets.json" not in files:
        named = read_json(session.folder / SESSION_FILE, FORMAT, VERSION).fields(("target_set",))
        path = session.folder / named["target_set"].text()
        read_json(path, TARGETS.name, TARGETS.version)
        files["targets.json"] = read_bytes(path, _MOST_BYTES)
    return files
