"""The whole walk in a real window, by real mouse clicks, on GenICam cameras of the simulated producer."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from installer.walk import GOES_ON_S, virtual_screen
from spherecal_gentl.producer.producer_control import RigFeed
from tests.built_producer import built_producer
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

if not sys.platform.startswith("linux"):
    pytest.skip("real clicks need X11", allow_module_level=True)
for program in ("Xvfb", "xdotool"):
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed (Debian: apt-get install xvfb xdotool)", allow_module_level=True)
pytest.importorskip("PySide6", reason="the window needs PySide6")
pytest.importorskip("harvesters", reason="harvesters is not installed: pip install spherecal[cameras]")
pytest.importorskip("genicam.gentl", reason="genicam is not installed: pip install spherecal[cameras]")

# For an idle machine; where others work too, everything takes longer by about the load of a core.
PATIENCE_S = 240.0 * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


@pytest.fixture
def display() -> Iterator[str]:
    """A screen of its own."""
    with virtual_screen() as name:
        if name == ":":
            pytest.skip("Xvfb does not start here")
        yield name


# `python -m spherecal_gui`, with live images that leave the processors to the walk.
PROGRAM = """
import sys
from spherecal_gui.__main__ import main
from spherecal_gui.controllers.camera_controller import CameraController
CameraController.live_hz = 0.5
sys.exit(main())
"""


class Driver:
    """The program in its window, and the mouse."""

    def __init__(self, display: str, home: Path, feed: RigFeed, cti: Path, bench: Path) -> None:
        self.home, self.feed = home, feed
        self._map = home / "map.json"
        self.env = (
            os.environ
            | feed.control.environment
            | {
                "DISPLAY": display,
                "QT_QPA_PLATFORM": "xcb",
                "SPHERECAL_MAP": str(self._map),
                "XDG_CONFIG_HOME": str(home),
                "SPHERECAL_SETTINGS": str(home / "settings.ini"),
                "GENICAM_GENTL64_PATH": str(cti.parent),
                "PYTHONPATH": os.pathsep.join([str(ROOT / "core"), str(ROOT)]),
            }
        )
        command = [sys.executable, "-c", PROGRAM, "--projects", str(home / "projects"), "--language", "en"]
        with (home / "out.txt").open("wb") as out:
            self.process = subprocess.Popen(
                [*command, "--bench", str(bench)], cwd=ROOT, env=self.env, stdout=out, stderr=subprocess.STDOUT
            )

    def buttons(self) -> dict[str, list]:
        try:
            return json.loads(self._map.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}

    def wait(self, done: Callable[[], object], what: str, seconds: float = PATIENCE_S) -> None:
        until = time.monotonic() + seconds
        while not done():
            assert self.process.poll() is None, (self.home / "out.txt").read_text()[-3000:]
            assert time.monotonic() < until, f"{what}: {self.buttons()} {self.project()}"
            time.sleep(0.05)

    def enabled(self, key: str) -> bool:
        button = self.buttons().get(key)
        return bool(button and button[2])

    def settle(self) -> None:
        """Until the window has dealt with what was pressed and told twice since what can be pressed now."""
        for _ in range(2):
            ticks = self.buttons().get("", [0])[0]
            self.wait(lambda ticks=ticks: self.buttons().get("", [0])[0] != ticks, "the window answers")

    def click(self, key: str) -> None:
        """Move the mouse there and press."""
        self.settle()
        self.wait(lambda: self.enabled(key), f"{key} can be pressed")
        x, y = self.buttons()[key][:2]
        words = ["xdotool", "mousemove", str(x), str(y), "sleep", "0.1", "click", "1"]
        subprocess.run(words, env=self.env, check=True, timeout=60)

    @property
    def folder(self) -> Path | None:
        return next((path.parent for path in (self.home / "projects").glob("*/wizard.json")), None)

    def project(self) -> dict:
        try:
            assert self.folder is not None
            return json.loads((self.folder / "wizard.json").read_text(encoding="utf-8"))
        except (OSError, ValueError, AssertionError):
            return {}

    def taken(self) -> set[str]:
        found: set[str] = set()
        for name in ("capture.json", "verification/capture.json"):
            path = self.folder / name if self.folder is not None else None
            if path is not None and path.is_file():
                found |= {one["id"] for one in json.loads(path.read_text(encoding="utf-8"))["sets"]}
        return found

    def go_on(self, step: str) -> None:
        """The window goes on by itself from what is done well; from what is there to be read it is asked to."""
        until = time.monotonic() + GOES_ON_S
        while self.project().get("step") != step and time.monotonic() < until:
            time.sleep(0.05)
        if self.project().get("step") != step:
            self.click("next")
        self.wait(lambda: self.project().get("step") == step, step)

    def take(self, name: str) -> None:
        """Put the ball or the bar into place, then press the large button."""
        self.feed.show(name)  # at once: a set is triggered by itself, whatever live images are in flight
        self.click("action")
        self.wait(lambda: name in self.taken(), f"{name} is taken")

    def picture(self, path: Path) -> None:
        if shutil.which("import"):
            subprocess.run(["import", "-window", "root", str(path)], env=self.env, check=False, timeout=30)


@pytest.fixture
def driver(display: str, drawn_session: Path, tmp_path: Path) -> Iterator[Driver]:
    cti = built_producer()
    with RigFeed(drawn_session) as feed:
        made = Driver(display, tmp_path, feed, cti, drawn_session / "session.json")
        try:
            yield made
        finally:
            made.process.terminate()
            made.process.wait(30)


def test_from_plugged_in_cameras_to_a_verified_rig_by_mouse(driver: Driver) -> None:
    driver.click("new-live")
    driver.click("action")  # the bench is confirmed
    driver.go_on("look")
    driver.click("action")
    driver.go_on("placement:P1")
    plan = driver.project()
    steps = [f"placement:{name}" for name in plan["placements"]] + ["scale"]
    for name, after in zip(plan["placements"], steps[1:], strict=True):
        driver.take(name)
        driver.go_on(after)
    for pose in plan["scale_poses"]:
        driver.take(pose)
    driver.go_on("calibrate")
    driver.click("action")
    driver.wait(lambda: driver.project().get("calibrated"), "calibrated")
    assert driver.project()["calibrated"]["verdict"] == "valid"
    driver.go_on("results")
    driver.click("action")
    driver.go_on("verify")
    # The bar lies where the rig was recorded, not where the plan wants it: the large button says so and stays grey.
    driver.feed.show(plan["check_poses"][0])
    for pose in driver.project()["check_poses"][:2]:
        driver.wait(lambda: driver.enabled("take-anyway"), "it can be taken as it lies")
        assert not driver.enabled("action")
        driver.click("take-anyway")
        driver.wait(lambda pose=pose: pose in driver.taken(), f"{pose} is taken")
    driver.click("measure-now")
    driver.wait(lambda: driver.project().get("verified"), "verified")
    assert driver.project()["verified"]["verdict"] == "consistent"
    driver.picture(driver.home / "verify.png")
    driver.go_on("save")
    driver.click("action")
    driver.wait((driver.home / "projects" / "rig-profile" / "rig.json").is_file, "the profile is saved")
    driver.wait(lambda: driver.enabled("action"), "writing has ended")
    driver.click("action")
    assert driver.folder is not None
    driver.wait((driver.folder / "report.pdf").is_file, "the report is written")
    driver.click("home")
    driver.wait(lambda: driver.enabled("check"), "the start page, and the rig can be checked")
    assert "Traceback" not in (driver.home / "out.txt").read_text()
