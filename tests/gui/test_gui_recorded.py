"""The session folder of a project: taken again, deleted, undone, cut short; frames without cameras."""

import errno
import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from spherecal.base.errors import OutputError
from spherecal_cameras.capture import SessionCamera
from spherecal_cameras.plan import CapturePlan, PlannedSet
from spherecal_cameras.protocol import CameraSource, Frame, FrameSet
from spherecal_gui.project_folder import taken_in
from spherecal_gui.recorded_sets import RecordedSession

SOURCE = cast(CameraSource, SimpleNamespace(kind="replay", label=""))
ENTRY = {"id": "C01", "image_size": [8, 8], "pixel_pitch_um": 3.0, "focal_length_mm": 8.0}


def opened(folder: Path, sets: tuple[PlannedSet, ...] = (PlannedSet("P1"), PlannedSet("P2"))) -> RecordedSession:
    made = RecordedSession(folder, CapturePlan(sets, None, {}), (SessionCamera("S1", ENTRY),), SOURCE)
    made.start()
    return made


def taken(grey: int) -> FrameSet:
    image = np.full((8, 8), grey, np.uint8)
    return FrameSet(1, {"S1": Frame("S1", image, 8, "Mono8", 0.0, 0.0)})


def grey_of(folder: Path, name: str) -> int:
    from PIL import Image

    return int(np.asarray(Image.open(folder / "placements" / name / "C01.png"))[0, 0])


def full(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_taken_again_the_new_one_counts_and_undo_brings_the_old_one_back(tmp_path):
    session = opened(tmp_path)
    session.add(PlannedSet("P1"), taken(10))
    first = session.taken_at("P1")
    session.add(PlannedSet("P1"), taken(20))
    assert grey_of(tmp_path, "P1") == 20
    assert not list(tmp_path.glob("removed/*/retaking"))
    assert session.undo() == "P1"
    assert grey_of(tmp_path, "P1") == 10
    assert taken_in(tmp_path) == {"P1": first}


@pytest.mark.parametrize(
    "what", ["spherecal_cameras.capture.png_bytes", "spherecal_cameras.capture.filesystem.write_new"]
)
def test_a_full_disk_leaves_the_one_before_in_memory_and_on_disk(tmp_path, monkeypatch, what):
    session = opened(tmp_path)
    session.add(PlannedSet("P1"), taken(10))
    first = session.taken_at("P1")
    with monkeypatch.context() as patch:
        patch.setattr(what, full)
        with pytest.raises(OutputError, match=r"(?i)no space left"):
            session.add(PlannedSet("P1"), taken(20))
    session.add(PlannedSet("P2"), taken(30))  # somebody has freed the disk
    assert session.taken_at("P1") == first
    assert set(taken_in(tmp_path)) == {"P1", "P2"}
    assert grey_of(tmp_path, "P1") == 10
    again = opened(tmp_path)
    assert again.taken_at("P1") == first


@pytest.mark.parametrize("what", ["make_folder_below", "write_below", "move_below"])
def test_a_set_that_could_not_be_put_aside_is_still_there(tmp_path, monkeypatch, what):
    session = opened(tmp_path)
    session.add(PlannedSet("P1"), taken(10))
    first = session.taken_at("P1")

    def refused(*_: object) -> None:
        raise OutputError("The disk refuses.")

    with monkeypatch.context() as patch:
        patch.setattr(f"spherecal_gui.recorded_sets.{what}", refused)
        with pytest.raises(OutputError, match="refuses"):
            session.remove("P1")
    for one in (session, opened(tmp_path)):
        assert one.taken_at("P1") == first and one.can_undo is None
    assert taken_in(tmp_path) == {"P1": first} and grey_of(tmp_path, "P1") == 10
    session.remove("P1")
    assert session.undo() == "P1" and grey_of(tmp_path, "P1") == 10


@pytest.mark.parametrize("images", ["aside", "in place"])
def test_a_retake_cut_short_by_a_kill_comes_back_a_deletion_does_not(tmp_path, images):
    session = opened(tmp_path)
    for name, grey in (("P1", 10), ("P2", 20)):
        session.add(PlannedSet(name), taken(grey))
    at = dict(taken_in(tmp_path))
    session.remove("P1", retaking=True)  # the program is killed here ...
    session.remove("P2")
    if images == "in place":  # ... or before the images were moved
        (tmp_path / "removed" / "P1-1" / "images").rename(tmp_path / "placements" / "P1")
    assert taken_in(tmp_path) == {}
    again = opened(tmp_path)
    assert taken_in(tmp_path) == {"P1": at["P1"]}
    assert grey_of(tmp_path, "P1") == 10
    assert again.images("P1")["C01"].is_file()
    assert opened(tmp_path).taken_at("P1") == at["P1"], "once is enough"


def test_poses_that_were_taken_keep_bar_and_temperature_in_another_plan(tmp_path):
    fields = {"bars": [{"id": "A"}]}
    session = RecordedSession(
        tmp_path, CapturePlan((PlannedSet("L1-1", "A", 20.0),), None, fields), (SessionCamera("S1", ENTRY),), SOURCE
    )
    session.start()
    session.plan_anew("L1-1", 21.5)
    session.add(session.planned("L1-1"), taken(10))
    session.plan_instead((PlannedSet("L1-1", "A", 19.0), PlannedSet("L2-1", "A", 19.0)))
    assert [one.temperature_c for one in session.plan.sets] == [21.5, 19.0]
    session.set_cameras((SessionCamera("S1", {**ENTRY, "ignore": [[0, 0, 2, 2]]}),))
    document = json.loads((tmp_path / "session.json").read_text())
    assert document["bar_poses"][0]["temperature_c"] == 21.5
    assert document["cameras"][0]["ignore"] == [[0, 0, 2, 2]]
    later = RecordedSession(
        tmp_path, CapturePlan((PlannedSet("L1-1", "A", 19.0),), None, fields), (SessionCamera("S1", ENTRY),), SOURCE
    )
    later.start()
    assert later.planned("L1-1").temperature_c == 21.5
