"""The session folder of a project: what capture writes, and besides retaking, deleting and undoing."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from spherecal.cameras.averaging import Stillness
from spherecal.cameras.capture import SessionCamera, SessionFolder
from spherecal.cameras.plan import CapturePlan, PlannedSet
from spherecal.cameras.protocol import CameraSource, FrameSet
from spherecal.errors import OutputError
from spherecal.session.atomic import write_file_whole

_REMOVED = "removed"


class RecordedSession(SessionFolder):
    """A session folder of which sets can be taken away and brought back; nothing is ever deleted from disk."""

    def __init__(
        self, folder: Path, plan: CapturePlan, cameras: tuple[SessionCamera, ...], source: CameraSource
    ) -> None:
        super().__init__(folder, plan, cameras, source)
        self._trash: list[tuple[str, Path]] = []

    def start(self, take_up: bool = True) -> None:
        """Make the folder or go on with it; what else stands in it (the wizard's own files) is no hindrance."""
        if (self.folder / "capture.json").is_file():
            super()._take_up()
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.plan.target_set is not None:
            from spherecal.session.target_files import write_target_set

            write_target_set(self.folder / "targets.json", self.plan.target_set)
        self._write_metadata()

    def document(self) -> dict[str, Any]:
        """What session.json says now."""
        return self._session()

    def plan_more(self, planned: PlannedSet) -> None:
        """Plan one more set, behind the others of its kind."""
        if planned.id not in {one.id for one in self.plan.sets}:
            self.plan = replace(self.plan, sets=(*self.plan.sets, planned))

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
        """Write a set; one of the same id that was there is put aside first."""
        if planned.id in self._images:
            self.remove(planned.id)
        super().add(planned, taken, stillness)

    def remove(self, set_id: str) -> None:
        """Put a set aside, images and all; `undo` brings the last one back."""
        entry = next((one for one in self._sets if one["id"] == set_id), None)
        if entry is None:
            return
        aside = self._new_place(set_id)
        here = self._place(set_id)
        try:
            aside.mkdir(parents=True)
            write_file_whole(aside / "set.json", (json.dumps(entry, indent=1) + "\n").encode())
            self._sets.remove(entry)
            self._images.pop(set_id)
            self._write_metadata()  # first: metadata never name images that are not there
            if here.is_dir():
                here.rename(aside / "images")
        except OSError as error:
            raise OutputError(f"{aside}: cannot be written ({error.strerror}).", "Free the disk, try again.") from error
        self._trash.append((set_id, aside))

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
        entry = json.loads((aside / "set.json").read_bytes())
        if (aside / "images").is_dir():
            here = self._place(set_id)
            shutil.rmtree(here, ignore_errors=True)
            here.parent.mkdir(exist_ok=True)
            (aside / "images").rename(here)
        self._sets.append(entry)
        self._images[set_id] = entry["images"]
        self._write_metadata()
        return set_id

    def _place(self, set_id: str) -> Path:
        kind = "placements" if self.planned(set_id).bar is None else "bars"
        return self.folder / kind / set_id

    def _new_place(self, set_id: str) -> Path:
        number = 1
        while (self.folder / _REMOVED / f"{set_id}-{number}").exists():
            number += 1
        return self.folder / _REMOVED / f"{set_id}-{number}"
