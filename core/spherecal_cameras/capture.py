"""Capturing a session: a folder that grows set by set and is a whole session after each."""

import json
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from spherecal.base.errors import InputError, OutputError, reason
from spherecal.base.interrupts import uninterrupted
from spherecal.base.messages.values import Phrase
from spherecal_cameras.averaging import Stillness
from spherecal_cameras.plan import CapturePlan, PlannedSet
from spherecal_cameras.protocol import CameraSource, Frame, FrameSet
from spherecal_files import filesystem
from spherecal_files.capture_file import CAPTURE_FILE, CAPTURED_CAMERAS, FORMAT, VERSION
from spherecal_files.json_file import JsonValue, plain_fields, read_json
from spherecal_files.png_file import png_bytes
from spherecal_files.read_session import FORMAT as SESSION_FORMAT
from spherecal_files.read_session import VERSION as SESSION_VERSION
from spherecal_files.target_set_file import TARGETS


@dataclass(frozen=True)
class SessionCamera:
    """A camera of the session: its serial, and its entry in session.json."""

    serial: str
    entry: dict[str, Any]

    @property
    def id(self) -> str:
        """Its id in the session."""
        return self.entry["id"]


class SessionFolder:
    """A session folder being captured: begun by `start`, or gone on with; after every `add` it can be calibrated."""

    def __init__(
        self, folder: Path, plan: CapturePlan, cameras: tuple[SessionCamera, ...], source: CameraSource
    ) -> None:
        ids = [camera.id for camera in cameras] + [planned.id for planned in plan.sets]
        for one in ids:
            if problem := filesystem.id_problem(one):
                raise InputError(
                    Phrase("error-bad-id", {"folder": folder, "id": filesystem.shown_name(one), "problem": problem})
                )
        if len(set(ids[: len(cameras)])) < len(cameras):
            raise InputError(Phrase("error-cameras-one-name", {"folder": folder}))
        self.folder, self.plan, self.cameras = folder, plan, cameras
        self._by_serial = {camera.serial: camera for camera in cameras}
        self._source = {"kind": source.kind, "label": source.label, "simulated": source.label.startswith("SIMULATED")}
        self._images: dict[str, dict[str, str]] = {}
        self._sets: list[dict[str, Any]] = []

    def start(self, take_up: bool) -> None:
        """Make the folder, or with `take_up` go on with the sets that an earlier capture by the same cameras lacks."""
        try:
            held = sorted(entry.name for entry in self.folder.iterdir()) if self.folder.is_dir() else []
            if held and take_up and CAPTURE_FILE in held:
                self._take_up()
            elif held:
                raise OutputError(Phrase("error-not-empty", {"folder": self.folder}))
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            what = Phrase("error-cannot-write", {"file": str(self.folder), "why": reason(error)})
            raise OutputError(what, Phrase("error-name-folder")) from error
        if self.plan.target_set is not None:
            filesystem.write_below(self.folder, "targets.json", TARGETS.bytes(self.plan.target_set))
        self._write_metadata()

    def _take_up(self) -> None:
        f = read_json(self.folder / CAPTURE_FILE, FORMAT, VERSION, below=self.folder).fields(("sets", "cameras"))
        before = {camera["serial"] for camera in CAPTURED_CAMERAS.read(f["cameras"])}
        if before != set(self._by_serial):
            values = {"folder": str(self.folder), "names": sorted(before)}
            raise InputError(Phrase("error-other-cameras", values), Phrase("error-same-cameras"))
        for value in f["sets"].items():
            known = value.fields(("id", "images"))
            name = known["id"].id()
            self._images[name] = {camera: _image(image) for camera, image in known["images"].entries().items()}
            if isinstance(value.value, dict):
                self._sets.append(value.value)

    @property
    def to_take(self) -> tuple[PlannedSet, ...]:
        """The planned sets that are not there yet, in the plan's order."""
        return tuple(planned for planned in self.plan.sets if not self._images.get(planned.id))

    @property
    def incomplete(self) -> dict[str, tuple[str, ...]]:
        """The sets that lack images, whenever they were taken, each with the ids of the cameras."""
        lacking = {name: tuple(c.id for c in self.cameras if c.id not in has) for name, has in self._images.items()}
        return {name: cameras for name, cameras in lacking.items() if cameras}

    def add(self, planned: PlannedSet, taken: FrameSet, stillness: Mapping[str, Stillness] | None = None) -> None:
        """Write a set: its images first, each whole, then the metadata that name them."""
        folder = f"{'placements' if planned.bar is None else 'bars'}/{planned.id}"
        names = {serial: self._by_serial[serial].id for serial in taken.frames}
        images = {name: f"{folder}/{name}.png" for name in names.values()}
        about = {names[s]: _about(frame, (stillness or {}).get(s)) for s, frame in taken.frames.items()}

        if images:
            self._write_images(folder, {names[serial]: frame for serial, frame in taken.frames.items()})
        self._images[planned.id] = images
        self._sets = [one for one in self._sets if one["id"] != planned.id]  # no camera had delivered then
        self._sets.append(
            {
                "id": planned.id,
                "taken": datetime.now(UTC).isoformat(timespec="milliseconds"),
                "attempts": taken.attempts,
                "seconds": round(taken.seconds, 4),
                "spread_s": None if taken.spread_s is None else round(taken.spread_s, 6),
                "late": [self._by_serial[serial].id for serial in taken.late],
                "missing": {self._by_serial[one.camera].id: one.cause for one in taken.missing},
                "images": images,
                "cameras": about,
            }
        )
        self._write_metadata()

    def _write_images(self, folder: str, frames: Mapping[str, Frame]) -> None:
        """Write the images of a set by camera into a new folder, then give it its name; OutputError if that fails."""
        partial = f"{folder.rpartition('/')[0]}/{filesystem.scratch_name()}"
        try:
            filesystem.make_folder_below(self.folder, partial)
            with ThreadPoolExecutor(2) as pool:  # encoding leaves the interpreter alone
                for name, data in zip(
                    frames, pool.map(png_bytes, (frame.image for frame in frames.values())), strict=True
                ):
                    filesystem.write_new(self.folder, f"{partial}/{name}.png", data, durable=True)
            with uninterrupted():
                # of a set whose metadata never came: its images go, anything else would stay and stop us
                if not filesystem.remove_folder_below(self.folder, folder, self._is_own_image):
                    raise OutputError(Phrase("error-foreign-files", {"folder": self.folder / folder}))
                filesystem.move_below(self.folder, partial, folder)
        except OSError as error:
            what = Phrase("error-cannot-write", {"file": str(self.folder / folder), "why": reason(error)})
            raise OutputError(what, Phrase("error-free-disk")) from error
        finally:
            filesystem.remove_own_folder(self.folder / partial)

    def _is_own_image(self, name: str) -> bool:
        return name.endswith(".png") and name.removesuffix(".png") in {camera.id for camera in self.cameras}

    def _write_metadata(self) -> None:
        capture = {
            "format": FORMAT,
            "version": VERSION,
            "source": self._source,
            "planned": [{k: v for k, v in asdict(one).items() if v is not None} for one in self.plan.sets],
            "cameras": [{"id": camera.id, "serial": camera.serial} for camera in self.cameras],
            "sets": self._sets,
        }
        documents = {"session.json": self._session(), CAPTURE_FILE: capture}  # the last one decides, see _take_up
        written = {name: (json.dumps(one, indent=1) + "\n").encode() for name, one in documents.items()}
        filesystem.write_together(self.folder, written)

    def _session(self) -> dict[str, Any]:
        placements, poses = [], []
        for planned in self.plan.sets:
            images = self._images.get(planned.id)
            if not images:
                continue
            if planned.bar is None:
                placements.append({"id": planned.id, "images": images})
            else:
                pose = {"id": planned.id, "bar": planned.bar, "temperature_c": planned.temperature_c, "images": images}
                poses.append({key: value for key, value in pose.items() if value is not None})
        document: dict[str, Any] = {
            "format": SESSION_FORMAT,
            "version": SESSION_VERSION,
            "cameras": [camera.entry for camera in self.cameras],
            **self.plan.fields,
            "placements": placements,
            "bar_poses": poses,
        }
        if self.plan.target_set is not None:
            document["target_set"] = "targets.json"
        return document


def session_ids(names: Mapping[str, str]) -> dict[str, str]:
    """The ids of cameras by serial: their names with other characters replaced, serial numbers where they are alike."""
    ids = {serial: filesystem.as_id(name, filesystem.as_id(serial, "camera")) for serial, name in names.items()}
    return {s: one if list(ids.values()).count(one) == 1 else filesystem.as_id(s, one) for s, one in ids.items()}


def _image(image: JsonValue) -> str:
    text = image.text()
    if problem := filesystem.path_problem(text):
        raise image.error(Phrase("problem-path", {"problem": problem, "path": filesystem.shown_name(text)}))
    return text


def _about(frame: Frame, stillness: Stillness | None) -> dict[str, Any]:
    exposed = time.time() - (time.perf_counter() - frame.taken_s)
    known: dict[str, Any] = {
        **plain_fields(frame, "frame_id time_stamp_ns"),
        "exposed": datetime.fromtimestamp(exposed, UTC).isoformat(timespec="milliseconds"),
        **plain_fields(frame, "exposure_us gain_db temperature_c pixel_format bits averaged"),
        **(plain_fields(stillness, "dots motion_px noise_px") if stillness is not None else {}),
    }
    return {key: value for key, value in known.items() if value is not None}
