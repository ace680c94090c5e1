"""What `profile compare` may be given: a profile, a calibration of its history, a result folder, or a rig.json."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig
from spherecal_files.rig_file import read_rig
from spherecal_files.verification_file import Override
from spherecal_rigs.compare_rigs import ComparisonVolume, seen_volume
from spherecal_rigs.entry import ENTRY_FILE, RIG_FILE, Entry, checked_rig, read_entry
from spherecal_rigs.result_folder import refuse_failed
from spherecal_rigs.save_entry import points_box
from spherecal_rigs.store import is_profile, open_profile


@dataclass(frozen=True)
class Source:
    """A rig and the box of its points, where that is known."""

    rig: Rig
    volume: ComparisonVolume | None


def read_source(path: Path) -> Source:
    """The rig at `path`: of a profile the one in use."""
    if path.is_dir() and is_profile(path):
        profile = open_profile(path)
        rig = profile.rig()
        return Source(rig, entry_volume(profile.active))
    if path.is_dir() and (path / ENTRY_FILE).is_file():
        entry = read_entry(path)
        return Source(checked_rig(path, entry), entry_volume(entry))
    if path.is_dir():
        if not (path / RIG_FILE).is_file():
            raise InputError(Phrase("error-no-profile-or-result", {"file": path}))
        return Source(read_rig(path / RIG_FILE), _box(path))
    return Source(read_rig(path), _box(path))


def points_file(path: Path) -> Path:
    """Where the points of the rig at `path` are, if they were kept: the ball as the calibration found it."""
    if path.is_dir() and is_profile(path):
        profile = open_profile(path)
        return profile.path_of(profile.active_id) / "points.csv" if profile.active_id else path / "points.csv"
    return (path if path.is_dir() else path.parent) / "points.csv"


def refuse_failed_rig(path: Path) -> Override | None:
    """As `refuse_failed`, for a rig.json, a result folder or a profile: of that the calibration in use."""
    folder = path if path.is_dir() else path.parent
    return refuse_failed(points_file(folder).parent if is_profile(folder) else folder)


def corners_beside(path: Path) -> tuple[FloatArray, FloatArray] | None:
    """The corners (3,), mm, of the box of points beside a rig.json or in a result folder (`points_box`), or None."""
    box = points_box((path if path.is_dir() else path.parent) / "points.csv")
    return None if box is None else (np.array(box[0]), np.array(box[1]))


def _box(path: Path) -> ComparisonVolume | None:
    corners = corners_beside(path)
    return None if corners is None else ComparisonVolume(*corners)


def entry_volume(entry: Entry | None) -> ComparisonVolume | None:
    """The box of an entry's points, where it is known."""
    if entry is None or entry.volume_mm is None:
        return None
    return ComparisonVolume(*(np.array(corner) for corner in entry.volume_mm))


def volume_of(source: Source) -> ComparisonVolume:
    """The box of a source's points; where it is not known, where most cameras look."""
    return source.volume or seen_volume(source.rig)
