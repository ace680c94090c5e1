"""The session folder of a project: what capture writes, and besides retaking, deleting and undoing."""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from spherecal.base.errors import InputError, OutputError
from spherecal.base.file_reading import id_problem
from spherecal.base.interrupts import uninterrupted
from spherecal.base.messages.values import Phrase
from spherecal_cameras.averaging import Stillness
from spherecal_cameras.capture import SessionCamera, SessionFolder
from spherecal_cameras.plan import CapturePlan, PlannedSet
from spherecal_cameras.protocol import CameraSource, FrameSet
from spherecal_files.filesystem import (
    is_plain_file_below,
    make_folder_below,
    move_below,
    read_below,
    remove_below,
    remove_folder_below,
    write_below,
)
from spherecal_files.target_set_file import TARGETS
from spherecal_gui.project_folder import Document

_REMOVED = "removed"
_RETAKING = "retaking"
_MOST_BYTES = 16 << 20


class RecordedSession(SessionFolder):
    """A session folder of which sets can be taken away and brought back; nothing is ever deleted from disk."""

    def __init__(
        self, folder: Path, plan: CapturePlan, cameras: tuple[SessionCamera, ...], source: CameraSource
    ) -> None:
        super().__init__(folder, plan, cameras, source)
        self._trash: list[tuple[str, str]] = []

    def start(self, take_up: bool = True) -> None:
        """Make the folder or go on with it; what else is in it (the wizard's own files) is no hindrance."""
        if (self.folder / "capture.json").exists():
            super()._take_up()
            self._take_recorded_poses()
            # sets that were being taken again when the program was killed: back, unless the new one is there
            for marker in sorted((self.folder / _REMOVED).glob(f"*/{_RETAKING}")):
                aside = f"{_REMOVED}/{marker.parent.name}"
                if not is_plain_file_below(self.folder, f"{aside}/{_RETAKING}"):
                    continue
                set_id = self._set_aside(aside)
                planned = {one.id for one in self.plan.sets}
                if set_id in planned and set_id not in self._images:
                    self._bring_back(set_id, aside)
                remove_below(self.folder, f"{aside}/{_RETAKING}")
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.plan.target_set is not None:
            write_below(self.folder, "targets.json", TARGETS.bytes(self.plan.target_set))
        self._write_metadata()

    def document(self) -> Document:
        """What session.json says now."""
        return self._session()

    def plan_more(self, planned: PlannedSet) -> None:
        """Plan one more set, behind the others of its kind."""
        if planned.id not in {one.id for one in self.plan.sets}:
            self.plan = replace(self.plan, sets=(*self.plan.sets, planned))

    def _take_recorded_poses(self) -> None:
        """Of the poses that were taken, bar and temperature stay as session.json has them."""
        try:
            poses = json.loads(read_below(self.folder, "session.json", _MOST_BYTES))["bar_poses"]
            recorded = {one["id"]: PlannedSet(one["id"], one["bar"], one.get("temperature_c")) for one in poses}
        except (InputError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return
        self.plan = replace(self.plan, sets=tuple(recorded.get(one.id, one) for one in self.plan.sets))

    def plan_instead(self, sets: tuple[PlannedSet, ...]) -> None:
        """Plan these sets; those that were taken stay as they are."""
        taken = {one.id: one for one in self.plan.sets if one.id in self._images}
        planned = {one.id: taken.pop(one.id, one) for one in sets}
        self.plan = replace(self.plan, sets=(*taken.values(), *planned.values()))

    def plan_anew(self, set_id: str, temperature_c: float | None) -> None:
        """The set is to be taken (again), the bar being as warm as this. `temperature_c` None: it is not known."""
        sets = tuple(replace(one, temperature_c=temperature_c) if one.id == set_id else one for one in self.plan.sets)
        self.plan = replace(self.plan, sets=sets)

    def set_cameras(self, cameras: tuple[SessionCamera, ...]) -> None:
        """The same cameras with other entries in session.json, such as other masks."""
        self.cameras = cameras
        self._by_serial = {camera.serial: camera for camera in cameras}
        self._write_metadata()

    def planned(self, set_id: str) -> PlannedSet:
        """The planned set of this id."""
        return next(one for one in self.plan.sets if one.id == set_id)

    def taken_at(self, set_id: str) -> str:
        """The moment at which a set was taken, as capture.json has it."""
        return next(one["taken"] for one in self._sets if one["id"] == set_id)

    def images(self, set_id: str) -> dict[str, Path]:
        """The image files of a set by camera id."""
        return {camera: self.folder / path for camera, path in self._images.get(set_id, {}).items()}

    def add(self, planned: PlannedSet, taken: FrameSet, stillness: Mapping[str, Stillness] | None = None) -> None:
        """Write a set; one of the same id that was there is put aside first, and back where the new one fails."""
        if planned.id not in self._images:
            super().add(planned, taken, stillness)
            return
        self.remove(planned.id, retaking=True)
        marker = f"{self._trash[-1][1]}/{_RETAKING}"
        try:
            super().add(planned, taken, stillness)
        except BaseException:
            with suppress(OutputError):
                self.undo()  # the disk that refused the new one may refuse this as well: then `start` does it
            raise
        remove_below(self.folder, marker)

    def remove(self, set_id: str, retaking: bool = False) -> None:
        """Put a set aside, images and all; `undo` brings the last one back."""
        entry = next((one for one in self._sets if one["id"] == set_id), None)
        if entry is None:
            return
        aside = self._new_place(set_id)
        here = self._place(set_id)
        try:
            make_folder_below(self.folder, aside)
            if retaking:
                write_below(self.folder, f"{aside}/{_RETAKING}", b"")
            write_below(self.folder, f"{aside}/set.json", (json.dumps(entry, indent=1) + "\n").encode())
            self._forget(entry, here, aside)
        except OutputError as error:
            raise OutputError(error.parts[0], Phrase("error-free-disk-again")) from error
        self._trash.append((set_id, aside))

    def _forget(self, entry: Document, here: str, aside: str) -> None:
        """Take a set out of the metadata and its images aside; where the disk refuses, nothing has changed."""
        self._sets.remove(entry)
        images = self._images.pop(entry["id"])
        try:
            self._write_metadata()  # first: metadata never name images that are not there
            if (self.folder / here).is_dir():
                move_below(self.folder, here, f"{aside}/images")
        except BaseException:
            self._sets.append(entry)
            self._images[entry["id"]] = images
            with suppress(OutputError):
                self._write_metadata()
            raise

    @property
    def can_undo(self) -> str | None:
        """The id of the set that `undo` would bring back."""
        return self._trash[-1][0] if self._trash else None

    def undo(self) -> str | None:
        """Bring back the set that was put aside last, in place of a newer one; its id."""
        if not self._trash:
            return None
        set_id, aside = self._trash.pop()
        if set_id in self._images:
            self.remove(set_id)
            self._trash.pop()
        self._bring_back(set_id, aside)
        self._write_metadata()
        return set_id

    def _bring_back(self, set_id: str, aside: str) -> None:
        entry = json.loads(read_below(self.folder, f"{aside}/set.json", _MOST_BYTES))
        if (self.folder / aside / "images").is_dir():
            here = self._place(set_id)
            with uninterrupted():
                if not remove_folder_below(self.folder, here, self._is_own_image):
                    raise OutputError(Phrase("error-foreign-files", {"folder": self.folder / here}))
                move_below(self.folder, f"{aside}/images", here)
        remove_below(self.folder, f"{aside}/{_RETAKING}")
        self._sets.append(entry)
        self._images[set_id] = entry["images"]

    def _set_aside(self, aside: str) -> str:
        """The id of the set in a folder of `removed`; empty where it was never put aside, or is not ours."""
        try:
            entry = json.loads(read_below(self.folder, f"{aside}/set.json", _MOST_BYTES))
            own = isinstance(entry["id"], str) and id_problem(entry["id"]) is None and isinstance(entry["images"], dict)
            return entry["id"] if own else ""
        except (InputError, ValueError, KeyError, TypeError, RecursionError):
            return ""

    def _place(self, set_id: str) -> str:
        return f"{'placements' if self.planned(set_id).bar is None else 'bars'}/{set_id}"

    def _new_place(self, set_id: str) -> str:
        number = 1
        while os.path.lexists(self.folder / _REMOVED / f"{set_id}-{number}"):
            number += 1
        return f"{_REMOVED}/{set_id}-{number}"
