"""What to capture: placements and bar poses in order, with targets, scale and bars as session.json has them."""

import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from spherecal.base.errors import InputError, Words
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Bar, CameraSpec, Session
from spherecal.targets.target_set import TargetSet
from spherecal_files.capture_file import CAPTURE_FILE, PLANNED
from spherecal_files.capture_file import FORMAT as CAPTURE_FORMAT
from spherecal_files.capture_file import VERSION as CAPTURE_VERSION
from spherecal_files.filesystem import create
from spherecal_files.json_file import read_json
from spherecal_files.read_session import FORMAT, VERSION, read_session
from spherecal_files.session_json import assumed_prior, session_json
from spherecal_files.table_file import COLUMNS
from spherecal_files.target_set_file import read_target_set, write_target_set

_TAKEN_OVER = ("scale", "sphere", "bars", "board")


@dataclass(frozen=True)
class PlannedSet:
    """One set to take: a placement (`bar` None) or a pose of a bar."""

    id: str
    bar: str | None = None
    temperature_c: float | None = None


@dataclass(frozen=True)
class CapturePlan:
    """Sets in order, the target set, the other fields of session.json, bars with lengths, and cameras it knows."""

    sets: tuple[PlannedSet, ...]
    target_set: TargetSet | None
    fields: dict[str, Any]
    cameras: tuple[dict[str, Any], ...] = ()
    bars: tuple[Bar, ...] = ()

    def camera(self, serial: str, name: str) -> dict[str, Any] | None:
        """The plan's entry of a camera, by serial number, else by name; None where it has none."""
        by_serial = (entry for entry in self.cameras if str(entry.get("serial")) == serial)
        by_name = (entry for entry in self.cameras if entry.get("id") in (name, serial) and "serial" not in entry)
        return next(by_serial, None) or next(by_name, None)


def simple_plan(placements: int, targets: Path | None, diameter_mm: float | None) -> CapturePlan:
    """Only placements P1, P2, ...; no scale, no bars."""
    if placements < 1:
        raise InputError(Phrase("error-placements-needed", {"placements": placements}))
    width = len(str(placements))
    names = tuple(PlannedSet(f"P{i + 1:0{width}d}") for i in range(placements))
    fields = {} if diameter_mm is None else {"sphere": {"nominal_diameter_mm": diameter_mm}}
    return CapturePlan(names, None if targets is None else read_target_set(targets), fields)


def plan_of(session: Session) -> CapturePlan:
    """The plan by which a session was recorded, without its cameras."""
    document = session_json(session, session.folder)
    fields = {key: document[key] for key in _TAKEN_OVER if document.get(key)}
    return CapturePlan(_sets(session), session.target_set, fields, bars=session.bars)


def _sets(session: Session) -> tuple[PlannedSet, ...]:
    placements = tuple(PlannedSet(place.id) for place in session.placements)
    return placements + tuple(PlannedSet(pose.id, pose.bar, pose.temperature_c) for pose in session.bar_poses)


def read_plan(path: Path) -> CapturePlan:
    """The plan in a file like session.json, without images or cameras; a recorded session serves too."""
    plan = _plan_in(path / "session.json" if path.is_dir() else path)
    if not plan.sets:
        raise InputError(Phrase("error-nothing-to-capture", {"file": path}))
    return plan


def begun_plan(folder: Path) -> CapturePlan | None:
    """The plan of a capture that was begun in a folder; None where none was, or by a version that kept none."""
    if not (folder / CAPTURE_FILE).is_file():
        return None
    capture = read_json(folder / CAPTURE_FILE, CAPTURE_FORMAT, CAPTURE_VERSION).fields((), ("planned",))
    if "planned" not in capture:
        return None
    sets = tuple(PlannedSet(**one) for one in PLANNED.read(capture["planned"]))
    return replace(_plan_in(folder / "session.json"), sets=sets)


def _plan_in(path: Path) -> CapturePlan:
    f = read_json(path, FORMAT, VERSION).fields((), ("cameras", "placements", "bar_poses", "target_set", *_TAKEN_OVER))
    target_set = None
    if "target_set" in f:
        target_set = read_target_set(path.parent / f["target_set"].text())
    document = {key: f[key].value for key in (*_TAKEN_OVER, "cameras") if key in f}
    for key in ("placements", "bar_poses"):
        entries = f[key].items() if key in f else []
        document[key] = [
            {k: v for k, v in one.items() if k != "images"} if isinstance(one := entry.value, dict) else one
            for entry in entries
        ]
    session = _checked(document, target_set, path)
    fields = {key: document[key] for key in _TAKEN_OVER if key in document}
    cameras = document.get("cameras")
    known = tuple(cameras) if isinstance(cameras, list) else ()
    return CapturePlan(_sets(session), target_set, fields, known, session.bars)


def check_marks(plan: CapturePlan, path: Path) -> None:
    """Check that every bar's mark is a target of the plan's set: no live camera could find another one."""
    if plan.target_set is None:
        return
    for bar in plan.bars:
        for name, mark in bar.marks.items():
            if mark.target not in plan.target_set.layouts:
                raise InputError(
                    Phrase("error-mark-not-target", {"file": path, "mark": name, "bar": bar.id, "target": mark.target})
                )


def _checked(document: dict[str, Any], target_set: TargetSet | None, path: Path) -> Session:
    """Have the reader of sessions check the plan before hours are spent on it."""
    any_camera = {"id": "C01", "image_size": [100, 100], "pixel_pitch_um": 1.0, "focal_length_mm": 1.0}
    whole = {"format": FORMAT, "version": VERSION, "cameras": [any_camera], **document}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if target_set is not None:
            write_target_set(folder / "targets.json", target_set)
            whole["target_set"] = "targets.json"
        create(folder / "session.json", json.dumps(whole).encode())
        create(folder / "observations.csv", (",".join(COLUMNS) + "\n").encode())
        try:
            return read_session(folder)
        except InputError as error:
            raise InputError(*(_about(words, folder / "session.json", path) for words in error.parts)) from None


def _about(words: Words, read: Path, given: Path) -> Words:
    """What is said about a file that was read, said about the one that was given."""
    if not isinstance(words, Phrase):
        return words
    return replace(words, values={name: given if one == str(read) else one for name, one in words.values.items()})


def camera_spec_json(
    name: str, serial: str, model: str, size: tuple[int, int], pitch_um: float | None, focal_mm: float | None
) -> dict[str, Any]:
    """A real camera as session.json has it; without a lens its prior is one that a calibration replaces."""
    entry: dict[str, Any] = {"id": name, "serial": serial, "model": model, "image_size": list(size)}
    entry |= {} if pitch_um is None else {"pixel_pitch_um": pitch_um}
    if pitch_um is not None and focal_mm is not None:
        entry["focal_length_mm"] = focal_mm
    else:
        entry["prior"] = assumed_prior(size)
    return {**entry, "intrinsics_group": name}


def recorded_camera_json(camera: CameraSpec, session: Session, serial: str) -> dict[str, Any]:
    """A camera of a recorded or simulated session as session.json has it."""
    entries = session_json(session, session.folder)["cameras"]
    return {**next(entry for entry in entries if entry["id"] == camera.id), "serial": serial}
