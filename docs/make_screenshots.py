"""Takes pictures of every page of the wizard, light and dark: `python3 dev.py pictures --wizard FOLDER`.

Walks through the simulated demo rig without a screen (or in a real window where QT_QPA_PLATFORM says so).
"""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

SIZE = (1280, 800)
PATIENCE_S = 600.0


class Photographer:
    """The wizard's window and the folder of its pictures."""

    def __init__(self, folder: Path, projects: Path) -> None:
        from PySide6.QtWidgets import QApplication

        from spherecal_gui import app

        self.application = QApplication.instance() or QApplication(["spherecal"])
        self.folder, self.number = folder, 0
        folder.mkdir(parents=True, exist_ok=True)
        self.window = app.make_window(projects)
        self.window.resize(*SIZE)
        self.window.show()

    def live(self, seconds: float) -> None:
        """Let the window live for a while."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.application.processEvents()
            time.sleep(0.01)

    def wait(self, done: Callable[[], bool] | None = None) -> None:
        """Until no work runs, or until something else has happened."""
        until = time.monotonic() + PATIENCE_S
        runner = self.window.controller.runner
        while not (done() if done is not None else runner.running is None):
            if time.monotonic() > until:
                raise TimeoutError("The wizard has not come to an end.")
            self.live(0.05)
        self.live(0.3)

    def take(self, name: str) -> None:
        """One picture in each look."""
        self.number += 1
        for look, dark, far in (("light", False, False), ("dark", True, False), ("afar", False, True)):
            self.window.dark.setChecked(dark)
            self.window.far.setChecked(far)
            self.window.resize(*SIZE)
            self.live(0.4)
            path = self.folder / f"{self.number:02d}-{name}-{look}.png"
            self.window.grab().save(str(path))
            print(path)
        self.window.far.setChecked(False)

    def go_on(self) -> None:
        """The page's work where it is not done, then the next step."""
        self.window.advance()
        self.wait()


def walk(p: Photographer) -> None:
    """All pages: empty, running, done and failed; first those before the computation."""
    window, controller = p.window, p.window.controller
    p.take("start")
    window.new_project("simulated:nonsense")
    p.wait()
    p.take("connect-failed")
    window.show_start()
    window.new_project("simulated:demo")
    p.wait()
    p.take("connect")
    p.go_on()
    p.go_on()
    assert controller.live is not None
    p.wait(lambda: all(controller.live.sight(serial) for serial in controller.connection.names))
    p.take("look")
    _lose(p, "C02", lambda: "C02" in window.page.summary.text())
    p.take("look-failed")
    controller.connection.source.heal("C02")
    p.go_on()
    p.go_on()
    p.wait(lambda: bool(window.page.sights()) and window.page.scene().still is not None)
    p.take("placement-ready")
    _lose(p, "C05", lambda: "C05" in window.page.scene().lost)
    p.take("placement-failed")
    controller.connection.source.heal("C05")
    window.advance()
    p.live(0.1)
    p.take("placement-running")
    p.wait()
    p.take("placement-done")
    for _ in range(3):
        p.go_on()
        p.live(1.0)
        p.go_on()
    computing(p)


def computing(p: Photographer) -> None:
    """From the last placement on."""
    window, controller = p.window, p.window.controller
    window.page.tabs.setCurrentIndex(1)
    p.take("placement-pairs")
    window.page.tabs.setCurrentIndex(2)
    p.live(1.0)
    p.take("placement-images")
    window.page.tabs.setCurrentIndex(0)
    p.go_on()
    p.live(2.0)
    p.take("scale")
    while controller.project.step == "scale":
        p.go_on()
    p.take("calibrate-ready")
    window.advance()
    p.wait(lambda: controller.runner.running is None or window.page.course.fraction > 0.5)
    p.take("calibrate-running")
    p.wait()
    p.take("calibrate-done")
    p.go_on()
    p.live(1.0)
    for index, name in enumerate(("findings", "cameras", "residuals")):
        window.page.tabs.setCurrentIndex(index)
        p.take(f"results-{name}")
    p.go_on()
    p.go_on()
    p.live(2.0)
    p.take("verify-ready")
    while controller.project.verified is None:
        p.go_on()
    p.take("verify-done")
    p.go_on()
    p.take("save")
    controller.delete("P2")
    p.take("save-stale")
    window.controller.go("calibrate")
    p.take("calibrate-stale")
    window.show_start()
    p.take("start-with-projects")


def _lose(p: Photographer, camera: str, shown: Callable[[], bool]) -> None:
    from spherecal.cameras.simulated.faults import SimulatedFault

    p.window.controller.connection.source.inject(SimulatedFault("lose", camera))
    p.wait(shown)


def make_screenshots(folder: Path) -> int:
    """Make all pictures; 0 when done."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    with tempfile.TemporaryDirectory() as home:
        os.environ["SPHERECAL_SETTINGS"] = str(Path(home) / "settings.ini")
        p = Photographer(folder, Path(home) / "projects")
        walk(p)
        p.window.close()
        p.live(0.2)
    return 0
