"""The walk by mouse clicks through the installed window: what it presses, and when it believes that it is done."""

import json
import sys
from pathlib import Path

import pytest

from installer.walk import Walk

if not sys.platform.startswith("linux"):
    pytest.skip("real clicks need X11", allow_module_level=True)


@pytest.fixture
def walk(tmp_path: Path) -> Walk:
    """A walk whose program ends at once; the tests say what it has told."""
    made = Walk(["/bin/true"], tmp_path, ":0", None)
    made.process.wait(30)
    return made


def tell(walk: Walk, *, enabled: bool, text: str) -> None:
    walk.map.write_text(json.dumps({"action": [600, 700, enabled, text]}), encoding="utf-8")


def test_what_ends_the_running_work_is_never_pressed(walk: Walk) -> None:
    """The large button of a running computation cancels it, and can be pressed."""
    assert walk.offer() == ""  # nothing was told yet
    tell(walk, enabled=True, text="Calibrate")
    assert walk.offer() == "Calibrate"
    for text in ("Cancel", "Stopping", "Stop here and keep"):
        tell(walk, enabled=True, text=text)
        assert walk.offer() == ""
    tell(walk, enabled=False, text="Measure the bar")
    assert walk.offer() == ""


def test_a_program_that_ended_is_said_with_its_last_words(walk: Walk) -> None:
    (walk.folder / "out.txt").write_text("no screen", encoding="utf-8")
    with pytest.raises(SystemExit, match=r"ended while waiting for: the first step\nno screen"):
        walk.wait(lambda: False, "the first step")


def test_a_report_counts_when_it_is_whole(walk: Walk) -> None:
    report = walk.folder / "projects" / "one" / "report.pdf"
    assert not walk.written()
    report.parent.mkdir(parents=True)
    report.write_bytes(b"%PDF-1.4 half of it")
    assert not walk.written()
    report.write_bytes(b"%PDF-1.4 all of it\n%%EOF\n")
    assert walk.written()


def test_a_step_is_done_when_what_it_is_for_was_kept(walk: Walk) -> None:
    folder = walk.folder / "projects" / "one"
    folder.mkdir(parents=True)
    (folder / "wizard.json").write_text(json.dumps({"scale_poses": ["B1", "B2"], "calibrated": None}))
    (folder / "capture.json").write_text(json.dumps({"sets": [{"id": "P1"}, {"id": "B1"}]}))
    assert walk.is_done("placement:P1")
    assert not walk.is_done("placement:P2")
    assert not walk.is_done("scale")
    assert not walk.is_done("calibrate")
    (folder / "capture.json").write_text(json.dumps({"sets": [{"id": "B2"}, {"id": "B1"}]}))
    (folder / "wizard.json").write_text(json.dumps({"scale_poses": ["B1", "B2"], "calibrated": {"verdict": "valid"}}))
    assert walk.is_done("scale")
    assert walk.is_done("calibrate")
