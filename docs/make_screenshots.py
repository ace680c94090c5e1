"""Takes pictures of every page of the wizard: `python3 dev.py pictures --wizard FOLDER`.

In every language, light, dark and with large text, in two sizes, with sheets of nine to look through, and a list of
what does not fit on them, scrolls or has no label. One walk through the simulated demo rig for each language, without
a screen (or in a real window where QT_QPA_PLATFORM says so). Pictures that are there already are not taken again.
SPHERECAL_PICTURES names some pages only, by their names.
"""

import itertools
import json
import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

if TYPE_CHECKING:
    from spherecal.base.context import Progress
    from spherecal_cameras.simulated.stage import Vector
    from spherecal_gui.tasks.task import BackgroundTask

SIZE = (1280, 800)
SIZES = (SIZE, (1920, 1080))
LANGUAGES = ("en", "de", "zh_CN")
LOOKS = (  # name, dark, large text
    ("light", False, False), ("dark", True, False), ("large", False, True), ("large-dark", True, True),
)  # fmt: skip
_SCENE_S = 30.0
PATIENCE_S = 600.0


class Photographer:
    """The wizard's window and the folder of its pictures."""

    def __init__(
        self,
        folder: Path,
        projects: Path,
        language: str = "en",
        sizes: Sequence[tuple[int, int]] = (SIZE,),
        looks: Sequence[tuple[str, bool, bool]] = LOOKS,
    ) -> None:
        from PySide6.QtWidgets import QApplication

        from spherecal_gui import app, languages
        from spherecal_gui.controllers.camera_controller import CameraController

        application = QApplication.instance()
        self.application = application if isinstance(application, QApplication) else QApplication(["spherecal"])
        languages.use(language)
        self.folder, self.language, self.sizes, self.looks, self.number = folder, language, sizes, looks, 0
        self.only = tuple(os.environ.get("SPHERECAL_PICTURES", "").split())
        CameraController.live_hz = 1.0  # leave the cores to the walk
        folder.mkdir(parents=True, exist_ok=True)
        self.window: Any = app.make_window(projects)  # each page has widgets of its own
        self.window.showNormal()  # not maximised, as it is at the first start
        self.window.header.dark.setChecked(False)
        self.window.header.goes_on.setChecked(False)
        self.window.resize(*SIZE)

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

    @contextmanager
    def held(self, at: "Callable[[Progress], bool]") -> Iterator[None]:
        """Work that is begun here waits where it first reports what `at` is true of, while pictures are taken."""
        from spherecal_gui.tasks.task import BackgroundTask

        note, reached, released = BackgroundTask._note, threading.Event(), threading.Event()

        def waiting(task: "BackgroundTask", progress: "Progress") -> None:
            note(task, progress)
            if at(progress):
                reached.set()
                released.wait()

        with patch.object(BackgroundTask, "_note", waiting):
            yield
            self.wait(lambda: reached.is_set() or self.window.controller.runner.running is None)
        self.live(0.5)
        self.release = released.set

    def take(self, name: str) -> None:
        """One picture in each look and size, of those that are missing."""
        self.number += 1
        if self.only and name not in self.only:
            return
        wanted = [
            (look, size, path)
            for look in self.looks
            for size in self.sizes
            if not (path := self._path(name, look[0], size)).exists()
        ]
        self._take_all(wanted)
        self._dress(self.window, *LOOKS[0][1:])
        self.window.resize(*SIZE)

    def _path(self, name: str, look: str, size: tuple[int, int]) -> Path:
        words = [f"{self.number:02d}", name, *([] if self.language == "en" else [self.language]), look]
        words += [] if size == SIZE else [f"{size[0]}x{size[1]}"]
        return self.folder / f"{'-'.join(words)}.png"

    def _take_all(self, wanted: Sequence[tuple[Any, tuple[int, int], Path]]) -> None:
        worn = None
        for look, size, path in wanted:
            if look != worn:  # half of the time, with a look for each picture
                self._dress(self.window, *look[1:])
                worn = look
            self.window.resize(*size)
            self.live(0.3)
            self._save(self.window, path.stem)

    @staticmethod
    def _dress(window: Any, dark: bool, far: bool) -> None:
        window.header.blockSignals(True)  # else everything is styled twice
        window.header.dark.setChecked(dark)
        window.header.far.setChecked(far)
        window.header.blockSignals(False)
        window.header.toggled.emit()

    def take_dialog(self, dialog: Any, name: str) -> None:
        """One picture of a dialog over the window, which is closed."""
        self.live(0.6)
        self.number += 1
        self._save(dialog, self._path(name, "light", SIZE).stem)
        dialog.close()

    def _save(self, window: Any, name: str) -> None:
        from PySide6.QtCore import QEvent

        path = self.folder / f"{name}.png"
        until = time.monotonic() + _SCENE_S
        while time.monotonic() < until and not all(one.settled for one in _scenes(window)):
            self.live(0.05)
        self.application.sendPostedEvents(None, QEvent.Type.LayoutRequest)  # else a button has its former width
        window.grab().save(str(path.with_suffix(".part")), "PNG")
        path.with_suffix(".part").replace(path)  # a walk that is stopped leaves no half a picture
        print(path, flush=True)
        with (self.folder / f"faults-{self.language}.txt").open("a", encoding="utf-8") as file:
            file.writelines(f"{name}: {fault}\n" for fault in _faults(window))

    def go_on(self) -> None:
        """The page's work where it is not done, then the next step."""
        self.window.advance()
        self.wait()

    def reach(self, step: str) -> None:
        """Go on until this step is shown; a button pressed too early does nothing."""
        until = time.monotonic() + PATIENCE_S
        while self.window.controller.project.step != step:
            if time.monotonic() > until:
                raise TimeoutError(f"The wizard has not come to {step}.")
            self.go_on()
            self.live(1.0)


def _faults(window: Any) -> list[str]:
    """What one need not look at a picture for: what does not fit, scrolls sideways or both ways, has no label."""
    from PySide6.QtWidgets import QAbstractButton

    from tests.gui_fit import covered, cut_short, scrolled

    areas = scrolled(window)
    blank = [
        one.objectName() or type(one).__name__
        for one in window.findChildren(QAbstractButton)
        if one.isVisible() and type(one).__name__ in ("QPushButton", "QToolButton")
        and not one.text().strip() and one.icon().isNull()
    ]  # fmt: skip
    return [
        *cut_short(window),
        *covered(window),
        *(f"{area} scrolls {'both ways' if down else 'sideways'}" for area, across, down in areas if across),
        *(f"{name} has neither text nor icon" for name in blank),
    ]


def _scenes(window: Any) -> list[Any]:
    """The scenes that are on the screen."""
    from spherecal_gui.widgets.scene_view import SceneView

    return [one for one in window.findChildren(SceneView) if one.isVisible()]


def _bench(p: Photographer) -> None:
    """The bench editor as somebody fills it in, and the makers' drivers."""
    window = p.window
    window.edit_bench()
    dialog = window.bench_dialog
    for key, text in (("name", "Ball hall 3"), ("diameter", "500"), ("measured", "28.2")):
        dialog.ball.fields[key].line.textEdited.emit(text)
    p.live(0.3)
    p.number += 1
    p._save(dialog, p._path("bench-ball", "light", SIZE).stem)
    dialog.tabs.setCurrentIndex(1)
    dialog.bars.add_bar()
    dialog.bars.fields["serial"].line.textEdited.emit("B-500-17")
    p.live(0.3)
    p.number += 1
    p._save(dialog, p._path("bench-bars", "light", SIZE).stem)
    while dialog.desk.past:
        dialog.desk.undo()
    dialog.close()
    p.take_dialog(window.page.drivers.show_makers(), "makers")


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
    p.wait(lambda: all(one.image is not None for one in window.page.pictures()))
    p.take("connect")
    _camera(p)
    _bench(p)
    p.go_on()
    p.go_on()
    assert controller.cameras.live is not None
    p.wait(lambda: all(controller.cameras.live.sight(serial) for serial in controller.cameras.connection.names))
    p.take("look")
    controller.recording.mask("SIM-C02", (300.0, 200.0, 400.0, 300.0))
    window.page.draw.setChecked(True)
    p.live(2.0)
    p.take("look-masks")
    window.page.draw.setChecked(False)
    controller.recording.clear_masks()
    _lose(p, "C02", lambda: "C02" in window.page.summary.text())
    p.take("look-failed")
    controller.cameras.connection.source.heal("C02")
    p.wait(lambda: "C02" not in window.page.summary.text())
    p.go_on()
    p.go_on()
    p.wait(lambda: bool(window.page.sights()) and window.page.scene().still is not None)
    p.take("placement-ready")
    _lose(p, "C05", lambda: "C05" in window.page.scene().lost)
    p.take("placement-failed")
    controller.cameras.connection.source.heal("C05")
    p.wait(lambda: not window.page.scene().lost)
    p.live(1.5)
    with p.held(lambda progress: progress.stage == "taking images"):
        window.advance()
    p.take("placement-running")
    p.release()
    p.wait()
    p.take("placement-done")
    p.go_on()
    p.wait(lambda: controller.advice.to_go is not None and not controller.advice.guidance.coarse)
    seen = controller.cameras.live.rounds
    p.wait(lambda: controller.cameras.live.rounds > seen + 3)  # the ball as it stands now, not as it stood before
    p.live(1.5)
    p.take("placement-ghost")
    window.page.small["put-there"].click()
    p.wait(lambda: controller.advice.to_go is not None and controller.advice.to_go.near)
    p.take("placement-there")
    p.reach("placement:P4")
    while not window.page.is_taken:
        p.go_on()
    computing(p)


def computing(p: Photographer) -> None:
    """From the last placement on."""
    window, controller = p.window, p.window.controller
    page = window.page
    for tab, name in ((page.pairs.parentWidget(), "pairs"), (page.coverage.parentWidget(), "coverage")):
        page.tabs.setCurrentWidget(tab)
        p.take(f"placement-{name}")
    page.tabs.setCurrentIndex(0)
    p.reach("scale")
    p.live(1.0)
    p.take("scale")
    p.reach("calibrate")
    p.take("calibrate-ready")
    window.advance()
    p.live(0.2)
    window.page.stop_here.click()
    p.take("calibrate-stopping")
    p.wait()
    p.go_on()
    p.live(1.0)
    p.take("results-stopped")
    controller.go("calibrate")
    image = controller.project.folder / "placements" / "P2" / "C03.png"
    right = image.read_bytes()
    image.write_bytes(b"no picture")
    controller.computation.calibrate()
    p.wait()
    p.take("calibrate-failed")
    image.write_bytes(right)
    with p.held(lambda progress: progress.stage == "rigid ball"):
        controller.computation.calibrate()
    p.take("calibrate-running")
    p.release()
    p.wait()
    p.take("calibrate-done")
    p.go_on()
    p.live(1.0)
    for index, name in enumerate(("findings", "cameras", "residuals")):
        window.page.tabs.setCurrentIndex(index)
        p.take(f"results-{name}")
    window.page.map.setChecked(True)
    window.page.links.setChecked(True)
    window.page.image.setCurrentIndex(3)
    p.take("results-map-and-image")
    window.page.leave_image.click()
    window.page.tabs.setCurrentIndex(0)
    p.take("results-repair-asked-for")
    controller.computation.take_back("--leave-out", window.controller.project.repairs[0][1])
    window.page.map.setChecked(False)
    window.page.links.setChecked(False)
    p.go_on()
    p.go_on()
    p.live(2.0)
    verifying(p)
    saving(p)
    checking(p)


def measuring(p: Photographer) -> None:
    """The bar that was verified last, carried to and fro by hand: up to 50 mm/s."""
    p.window.controller.go("measure")
    began = time.perf_counter()

    def carried(moment_s: float) -> "tuple[Vector, Vector]":
        way = 1.0 - math.cos(0.8 * (moment_s - began))
        return (50.0 * way, -33.0 * way, 17.0 * way), (10.0 * way, 7.0 * way, 0.0)

    p.live(2.0)
    began = time.perf_counter()
    p.window.controller.cameras.connection.source.stage.carry(carried)
    p.live(10.0)
    p.take("measure")
    p.window.controller.cameras.connection.source.show("P1")
    p.live(3.0)
    p.take("measure-ball")
    p.window.controller.go("save")


def saving(p: Photographer) -> None:
    """The profile, origin and axes, the limits; what is out of date."""
    from spherecal_gui.pages.limits_dialog import LimitsDialog

    window, controller = p.window, p.window.controller
    controller.go("save")
    p.take("save")
    window.page.profile.click()
    p.wait()
    p.take("save-done")
    measuring(p)
    window.page.axes.click()
    p.take_dialog(window.page.dialog, "save-origin-and-axes")
    controller.sets.delete("P2")
    p.take("save-stale")
    window.controller.go("calibrate")
    p.take("calibrate-stale")
    controller.sets.undo()
    p.wait()
    window.show_start()
    p.take("start-with-projects")
    window.header.limits.trigger()
    p.take_dialog(window.findChild(LimitsDialog), "limits")


def verifying(p: Photographer) -> None:
    """The check bar: where it goes, where it lies wrong, what was measured, with and without a limit."""
    window, controller = p.window, p.window.controller
    page = window.page
    p.wait(lambda: page.guide is not None and page.guide.level == "good")
    p.take("verify-ready")
    controller.cameras.connection.source.stage.move((0.0, 0.0, 9000.0))  # out of every camera's sight
    controller.cameras.live.forget()
    p.live(3.0)
    p.take("verify-no-bar")
    pose = controller.project.check_poses[0]
    controller.sets.take(pose, "verify")
    p.wait()
    page.enough.click()
    p.wait()
    p.take("verify-no-pose")
    controller.sets.delete(pose)
    page.more.click()
    controller.staging.show_pose(page.current)
    p.wait(lambda: page.guide is not None and page.guide.level == "good")
    controller.cameras.connection.source.stage.move((0.0, 0.0, 0.0), (0.0, 0.0, 18.0))
    controller.cameras.live.forget()
    p.wait(lambda: page.guide is not None and not page.guide.accepted)
    p.take("verify-bar-elsewhere")
    controller.staging.show_pose(page.current)
    for _ in range(3):
        p.wait(lambda: page.guide is not None and page.guide.level == "good")
        p.go_on()
    page.enough.click()
    p.wait()
    p.take("verify-done")
    controller.bars.set_limit("0.02+L/50000")
    p.take("verify-stale")
    controller.computation.verify()
    p.wait()
    page.outcome.tables.setCurrentIndex(1)
    p.take("verify-limit-and-budget")
    page.more.click()
    p.live(2.0)
    p.take("verify-more-poses")
    page.enough.click()
    p.wait()
    page.outcome.tables.setCurrentIndex(0)
    certificate = controller.project.verification_folder / "session.json"
    right = certificate.read_text(encoding="utf-8")
    certificate.write_text(_longer(right, 1.004), encoding="utf-8")
    controller.computation.seen_bars = None
    controller.computation.verify()
    p.wait()
    p.take("verify-inconsistent")
    certificate.write_text(right, encoding="utf-8")
    controller.bars.set_limit("")
    controller.computation.seen_bars = None
    controller.computation.verify()
    p.wait()


def checking(p: Photographer) -> None:
    """The check of the calibration in use, of a rig whose camera was knocked since."""
    from dataclasses import replace

    from spherecal_cameras.simulated.simulated_source import SimulatedFault
    from spherecal_gui.project_folder import load_project
    from tests.gui_walking import at_rest

    window, controller = p.window, p.window.controller
    like = load_project(next(line.folder for line in window.start._lines if line.calibrated))
    controller.new_check(replace(like, source="simulated:demo+bump:C03:0.3"))
    p.wait()
    p.reach("check")
    p.take("check-ready")
    p.wait(lambda: at_rest(controller))
    controller.cameras.connection.source.inject(SimulatedFault("bump", "C05"))
    p.wait(lambda: bool(controller.cameras.live.watch.bumped))
    p.take("check-bump")
    controller.cameras.connection.source.heal("C05")
    controller.cameras.live.watch.forgive()
    window.advance()
    p.wait()
    p.take("check-failed")
    window.page.repair.click()
    p.wait()
    p.take("check-repaired")
    window.page.act()
    p.wait()
    p.take("check-done")
    window.show_start()


def _camera(p: Photographer) -> None:
    """The dialog of one camera."""
    from spherecal_gui.pages.connect_dialogs import CameraDialog

    dialog = CameraDialog(p.window.controller, "SIM-C03", p.window)
    dialog.show()
    p.live(3.0)
    p.take_dialog(dialog, "camera")


def _lose(p: Photographer, camera: str, shown: Callable[[], bool]) -> None:
    from spherecal_cameras.simulated.simulated_source import SimulatedFault

    p.window.controller.cameras.connection.source.inject(SimulatedFault("lose", camera))
    p.wait(shown)


def _longer(session: str, times: float) -> str:
    """A session whose bars' certificates have lengths that are so many times as long."""
    made = json.loads(session)
    for bar in made["bars"]:
        for one in bar["lengths"]:
            one["length_mm"] *= times
    return json.dumps(made)


def make_screenshots(
    folder: Path,
    language: str = "en",
    sizes: Sequence[tuple[int, int]] = (SIZE,),
    looks: Sequence[tuple[str, bool, bool]] = LOOKS,
) -> int:
    """Make all pictures of a language; 0 when done."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    with tempfile.TemporaryDirectory() as home:
        os.environ["SPHERECAL_SETTINGS"] = str(Path(home) / "settings.ini")
        os.environ["SPHERECAL_LIMITS"] = str(Path(home) / "limits.json")
        p = Photographer(folder, Path(home) / "projects", language, sizes, looks)
        walk(p)
        p.window.close()
        p.live(0.2)
    return 0


def make_matrix(folder: Path) -> int:
    """All pictures, a process for each language; then the sheets and the list of faults."""
    walks = [subprocess.Popen([sys.executable, __file__, str(folder), language]) for language in LANGUAGES]
    codes = [walk.wait() for walk in walks]
    make_sheets(folder)
    for path in sorted(folder.glob("faults-*.txt")):
        print(path.read_text(encoding="utf-8"), end="")
    return max(codes)


def make_sheets(folder: Path) -> None:
    """The pictures of each page on sheets of nine: a row for each language, columns of looks and sizes."""
    from PIL import Image

    shown: dict[str, list[Path]] = {}
    for path in folder.glob("*.png"):
        look = next(look for look, _, _ in reversed(LOOKS) if f"-{look}" in path.stem)
        words = path.stem.removesuffix("-1920x1080").removesuffix(f"-{look}")
        shown.setdefault(words.removesuffix("-de").removesuffix("-zh_CN"), []).append(path)
    (folder / "sheets").mkdir(exist_ok=True)
    for page, paths in shown.items():
        columns = list(itertools.product(SIZES, [look for look, _, _ in LOOKS]))
        for number in range(0, len(columns), 3):
            sheet = Image.new("RGB", (3 * 800, 3 * 500), (120, 120, 120))
            for (column, (size, look)), (row, language) in itertools.product(
                enumerate(columns[number : number + 3]), enumerate(LANGUAGES)
            ):
                words = [page, *([] if language == "en" else [language]), look]
                words += [] if size == SIZE else [f"{size[0]}x{size[1]}"]
                path = folder / f"{'-'.join(words)}.png"
                if path in paths:
                    picture = Image.open(path).convert("RGB")
                    picture.thumbnail((796, 496), Image.Resampling.LANCZOS)
                    sheet.paste(picture, (800 * column, 500 * row))
            sheet.save(folder / "sheets" / f"{page}-{number // 3 + 1}.png")


if __name__ == "__main__":
    sys.exit(make_screenshots(Path(sys.argv[1]), sys.argv[2], SIZES))
