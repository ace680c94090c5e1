"""Reading a session folder: everything the interface says about it is checked here."""

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Observations
from spherecal.data.session import BarPose, BoardPoint, Placement, Scale, Session
from spherecal.targets.target_set import TargetSet
from spherecal_files.bundle_file import original_sha256
from spherecal_files.capture_file import last_taken, read_captured_sets
from spherecal_files.filesystem import file_sha256
from spherecal_files.json_file import JsonValue, read_json, unique
from spherecal_files.read_bars import read_bars
from spherecal_files.session_file import BAR_POSES, BOARD, CAMERAS, PLACEMENTS, SCALE, SPHERE, WANTED, board_grid
from spherecal_files.table_file import read_observations
from spherecal_files.target_set_file import read_target_set

FORMAT = "spherecal/session"
VERSION = 1
SESSION_FILE = "session.json"
OBSERVATIONS_FILE = "observations.csv"

_OPTIONAL = ("placements", "bars", "bar_poses", "scale", "board", "sphere", "target_set", "wanted_uncertainty_mm")
_MOST_BYTES = 1 << 30  # of one file; images of 150 MP with 16 bits have 300 MB


def read_session(folder: Path) -> Session:
    """The session in a folder, checked as the interface says; with observations, missing images are left out."""
    if not (folder / SESSION_FILE).exists():
        missing = "error-no-session" if folder.is_dir() else "error-no-session-folder"
        raise InputError(Phrase(missing, {"folder": folder}))
    f = read_json(folder / SESSION_FILE, FORMAT, VERSION).fields(("cameras",), _OPTIONAL)
    files = _NamedFiles(folder)
    cameras = CAMERAS.read(f["cameras"])
    camera_ids = [camera.id for camera in cameras]
    observed = (folder / OBSERVATIONS_FILE).exists()
    places = _PlaceReader(files, camera_ids, observed)
    placements = places.placements(f["placements"]) if "placements" in f else ()
    bars, registered = read_bars(f["bars"]) if "bars" in f else ((), {})
    for serial, entry in registered.items():
        files.add_entry(f"registered bar {serial}", entry)
    bar_poses = places.bar_poses(f["bar_poses"], [bar.id for bar in bars]) if "bar_poses" in f else ()
    values = [value for key in ("placements", "bar_poses") if key in f for value in f[key].items()]
    unique(values, [place.id for place in (*placements, *bar_poses)], "id")
    target_set = read_target_set(files.find(f["target_set"])) if "target_set" in f else None
    observations = None
    if observed:
        ids = [place.id for place in (*placements, *bar_poses)]
        sizes = [camera.image_size for camera in cameras]
        observations = read_observations(files.add(OBSERVATIONS_FILE), ids, camera_ids, sizes)
    scale = SCALE.read(f["scale"]) if "scale" in f else None
    if scale is not None:
        _check_bar(scale, f["scale"], {bar.id: bar.role for bar in bars})
        _check_spacing_points(f["scale"], target_set, observations)
    of_ball, captured = {placement.id for placement in placements}, read_captured_sets(folder)
    diameter, sphere_sd = SPHERE.read(f["sphere"]) if "sphere" in f else (None, None)
    return Session(
        folder=folder if folder.parts else folder.absolute(),  # Path() is that of sessions in memory
        cameras=cameras,
        placements=placements,
        bars=bars,
        bar_poses=bar_poses,
        scale=scale,
        board=_read_board(f["board"]) if "board" in f else None,
        sphere_diameter_mm=diameter,
        target_set=target_set,
        observations=observations,
        input_sha256=files.sha256(),
        sphere_sd_mm=sphere_sd,
        wanted_uncertainty_mm=WANTED.read(f["wanted_uncertainty_mm"]) if "wanted_uncertainty_mm" in f else None,
        captured=captured,
        recorded_at=last_taken([one for one in captured if one.id in of_ball]),
    )


class _NamedFiles:
    """The files that make up a session; none may be outside its folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._real_folder = os.path.realpath(folder)
        self._files = {SESSION_FILE: folder / SESSION_FILE}
        self._entries: dict[str, str] = {}

    def find(self, named: JsonValue, may_be_missing: bool = False) -> Path:
        """The absolute path of a file named in session.json; InputError if it leaves the folder or is not there."""
        text = named.text()
        parts = PurePosixPath(text).parts
        if not parts or "\\" in text or ".." in parts or PureWindowsPath(text).anchor or len(text) > 500:
            raise named.error(Phrase("problem-path-below", {"path": text}))
        path = self._folder / text
        if not Path(os.path.realpath(path)).is_relative_to(self._real_folder):
            raise named.error(Phrase("problem-path-leaves", {"path": text}))
        if not path.is_file() and not may_be_missing:
            raise named.error(Phrase("problem-path-missing", {"path": text}))
        return self.add("/".join(parts))

    def add(self, relative: str) -> Path:
        """Count a file of the folder as part of the session; returns its absolute path."""
        return self._files.setdefault(relative, Path(os.path.abspath(self._folder)) / relative)

    def add_entry(self, name: str, contents: bytes) -> None:
        """Count what is outside the folder and was taken over, such as a bar of the registry, as part of it."""
        self._entries[name] = hashlib.sha256(contents).hexdigest()

    def sha256(self) -> str:
        """The SHA-256 of the table that `sha256sum` prints for these files, sorted by path ("missing" for a hash)."""
        hashes = {relative: _file_sha256(path) for relative, path in self._files.items()}
        if (original := original_sha256(self._folder, hashes)) is not None:
            return original
        table = hashlib.sha256()
        for relative, own in sorted((hashes | self._entries).items()):
            table.update(f"{own}  {relative}\n".encode())
        return table.hexdigest()


def _file_sha256(path: Path) -> str:
    try:
        return file_sha256(path, _MOST_BYTES)
    except FileNotFoundError:
        return "missing"


class _PlaceReader:
    """Reads placements and bar poses, and the images that they name."""

    def __init__(self, files: _NamedFiles, camera_ids: Sequence[str], observed: bool) -> None:
        self._files = files
        self._camera_ids = frozenset(camera_ids)
        self._observed = observed

    def placements(self, placements: JsonValue) -> tuple[Placement, ...]:
        found = zip(PLACEMENTS.read(placements), placements.items(), strict=True)
        return tuple(Placement(f["id"], self._images(f, value)) for f, value in found)

    def bar_poses(self, poses: JsonValue, bar_ids: Sequence[str]) -> tuple[BarPose, ...]:
        found = zip(BAR_POSES.read(poses), poses.items(), strict=True)
        return tuple(self._bar_pose(f, value, bar_ids) for f, value in found)

    def _bar_pose(self, f: Mapping[str, Any], value: JsonValue, bar_ids: Sequence[str]) -> BarPose:
        if f["bar"] not in bar_ids:
            raise value.at("bar", f["bar"]).error(Phrase("problem-unknown-bar", {"bar": f["bar"]}))
        return BarPose(f["id"], f["bar"], f.get("temperature_c"), self._images(f, value))

    def _images(self, f: Mapping[str, Any], place: JsonValue) -> dict[str, Path]:
        """The image files by camera; they may only be absent where there are observations."""
        images: dict[str, JsonValue] = f.get("images", {})
        if not images and not self._observed:
            raise place.at("id", f["id"]).error(Phrase("problem-no-images"))
        for camera, image in images.items():
            if camera not in self._camera_ids:
                raise image.error(Phrase("problem-unknown-camera", {"camera": camera}))
        paths = {camera: self._files.find(image, self._observed) for camera, image in images.items()}
        return {camera: path for camera, path in paths.items() if path.is_file()}


def _check_bar(scale: Scale, value: JsonValue, roles: Mapping[str, str]) -> None:
    if scale.bar is not None and roles.get(scale.bar) != "scale":
        problem = "problem-check-bar" if scale.bar in roles else "problem-unknown-bar"
        raise value.at("bar", scale.bar).error(Phrase(problem, {"bar": scale.bar}))


def _check_spacing_points(scale: JsonValue, target_set: TargetSet | None, observations: Observations | None) -> None:
    """Refuse a spacing between points that neither a target nor an observation has, where either is known."""
    f = scale.fields((), ("from", "to"))
    known = set(observations.points if observations is not None else ())
    known.update(*(target_set.layouts.values() if target_set is not None else ()))
    for end in f.values():
        if known and end.name() not in known:
            raise end.error(Phrase("problem-unknown-point", {"point": end.name()}))


def _read_board(board: JsonValue) -> tuple[BoardPoint, ...]:
    """The board's points; the shorthand counts them row by row from 0, x along the rows, y along the columns."""
    f = BOARD.read(board)
    if "points" in f:
        return f["points"]
    kind = f.get("kind", "circles")
    board.fields(("rows", "columns", "pitch_mm", *(("marker_mm",) if kind == "aprilgrid" else ())))
    places = board_grid(kind, f["rows"], f["columns"], f["pitch_mm"], f.get("marker_mm"))
    return tuple(BoardPoint(i, "centre", (float(x), float(y), 0.0)) for i, (x, y) in enumerate(places))
