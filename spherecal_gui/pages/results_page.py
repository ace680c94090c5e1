"""Results: verdict first, then the rig, the cameras worst first, residuals, and what the findings advise."""

from PySide6.QtCore import QSignalBlocker
from PySide6.QtGui import QImage, QPixmap
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QTabWidget, QVBoxLayout, QWidget

from spherecal_gui import theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import Cell, figure
from spherecal_gui.pages.wizard_page import Page
from spherecal_gui.presenters.results_presenter import (
    CameraResiduals,
    CameraRow,
    advice,
    camera_rows,
    compared_text,
    culprit,
    residual_text,
    residuals_of,
    verdict,
)
from spherecal_gui.presenters.step_states import ResultFacts, results_says
from spherecal_gui.project import usable
from spherecal_gui.rig_scenes import outcome_scene
from spherecal_gui.standing import Said
from spherecal_gui.widgets.basic import add, button, enable, label, named, say
from spherecal_gui.widgets.charts import HistogramChart
from spherecal_gui.widgets.results_views import EffectsView, FindingsList, ResidualView
from spherecal_gui.widgets.scene_panel import ScenePanel, SceneSplit
from spherecal_gui.widgets.scene_view import png_of
from spherecal_gui.widgets.table import Table
from spherecal_gui.workflow import Status

# A camera this much worse than the middle one stands out: rig A's differ by a tenth, a blurred one is 2 times worse.
_STANDS_OUT = 1.5
_THUMBNAIL_PX = (640, 480)


class ResultsPage(Page):
    """The result of the last calibration."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.deeds = {"accept": controller.computation.accept_results, "calibrate": self._calibrate_again}
        self._shown: object = None
        self._camera: str | None = None
        controller.saving.draw_rig = self._rig_png
        self.headline = self.word = label("", "huge", wrap=False)
        self.sentence, self.since = label("", "big"), label("", "soft")
        head = add(QHBoxLayout(), self.word, theme.PAD, (self.sentence, 1))
        split = SceneSplit(self._left(), self._right(), (620, 600))
        add(QVBoxLayout(self), head, self.since, (split, 1))

    def _left(self) -> QWidget:
        self.panel = ScenePanel()
        self.scene = self.panel.view
        self.scene.camera_chosen.connect(self.show_camera)
        self.panel.said.connect(self.controller.tell)
        self.map, self.links = self.panel.layers["map"], self.panel.layers["links"]
        return self.panel

    def _right(self) -> QWidget:
        self.tabs = QTabWidget()
        self.findings = FindingsList()
        self.findings.asked.connect(self._do)
        self.findings.taken_back.connect(self.controller.computation.take_back)
        headings = [
            self.tr("Camera"), self.tr("rms\npx"), self.tr("dots"), self.tr("left\nout"), self.tr("place ±\nmm"),
            self.tr("turn ±\ndeg"), self.tr("focal\npx"), self.tr("change\nmm"),
        ]  # fmt: skip
        self.table = Table(headings, spare=(6, 5, 3))
        self.table.itemSelectionChanged.connect(self._selected)
        self.table.itemDoubleClicked.connect(lambda _: self.tabs.setCurrentIndex(2))
        residuals = QWidget()
        self.residuals, self.histogram = ResidualView(), HistogramChart()
        self.residuals.image_chosen.connect(self._show_image)
        self.residual_size = label("")
        column = add(QVBoxLayout(residuals), self._image_row(), self.residual_size)
        add(column, (self.residuals, 3), (self.histogram, 2))
        self.histogram.setVisible(not theme.is_far())  # large text needs its room
        self.tabs.addTab(self.findings, self.tr("What to do"))
        self.tabs.addTab(self.table, self.tr("Cameras"))
        self.tabs.addTab(residuals, self.tr("Residuals"))
        self.effects = EffectsView()
        return self.tabs

    def _image_row(self) -> QVBoxLayout:
        """One image of the camera that is shown, and what can be done about it."""
        self.image = named(QComboBox(), "which-image", self.tr("Which image"))
        self.image.currentIndexChanged.connect(lambda: self._show_image(self.image.currentData()))
        self.leave_image = button(self.tr("Leave this image out"), "leave-image")
        self.leave_image.clicked.connect(lambda: self._leave_out(f"{self._camera}@{self.image.currentData()}"))
        self.leave_camera = button(self.tr("Leave the camera out"), "leave-camera")
        self.leave_camera.clicked.connect(lambda: self._leave_out(f"camera:{self._camera}"))
        # below each other: beside each other they are too wide for large text in German
        return add(QVBoxLayout(), self.image, add(QHBoxLayout(), self.leave_image, self.leave_camera, None))

    def show_project(self) -> None:
        """There may be another result."""
        result, project = self.controller.result, self.open_project
        if result is None:
            return
        self.sentence.setText(verdict(result).sentence)
        self.findings.show_advice(advice(result, project.placements), project.repairs_now)
        outcome = self.controller.outcome
        say(self.since, *compared_text(outcome.compared if outcome is not None else None))
        if result is not self._shown:
            self._shown = result
            self._fill()

    def _fill(self) -> None:
        outcome = self.controller.outcome
        if outcome is None:
            return
        rows = camera_rows(outcome.result, outcome.compared)
        usual = sorted(row.rms_px for row in rows if row.rms_px is not None)
        middle = usual[len(usual) // 2] if usual else 1.0
        accused = culprit(outcome.result)
        guilty, none = accused[0] if accused is not None else None, self.tr("not placed")
        self.table.fill([_cells(row, middle, none, row.camera == guilty) for row in rows], sort_by=1)
        self.table.setColumnHidden(7, outcome.compared is None)
        self.panel.show_scene(outcome_scene(outcome))
        # a tab for fields of lenses and drifts of cameras, where there are any
        self.effects.show_effects(outcome.effects)
        if (at := self.tabs.indexOf(self.effects)) >= 0 and not outcome.effects:
            self.tabs.removeTab(at)
        elif at < 0 and outcome.effects:
            self.tabs.addTab(self.effects, self.tr("Lenses"))
        if rows:  # the camera that the findings accuse, in the image they name; else that with the largest residuals
            name, placement = accused or (rows[0].camera, None)
            with QSignalBlocker(self.table):
                if not self.table.select_name(name):
                    self.table.selectRow(0)
            self.show_camera(name, placement)

    def dress(self) -> None:
        """Draw in the new colours."""
        self.panel.view.scene_changed()
        self.histogram.setVisible(not theme.is_far())
        if self.controller.result is not None and self._shown is not None:
            camera, placement = self._camera, self.image.currentData()
            self._fill()
            if camera is not None:  # what was chosen stays
                self.table.select_name(camera)
                self.show_camera(camera, placement)
        self.refresh()

    def show_camera(self, camera: str, placement: str | None = None) -> None:
        """Show a camera's residuals and mark it in the scene. `placement` None for those of all placements."""
        result = self.controller.result
        if result is None:
            return
        shown = residuals_of(result, camera, placement)
        self._camera = camera
        with QSignalBlocker(self.image):
            self.image.clear()
            if shown is not None:
                self.image.addItem(self.tr("{camera}: all images").format(camera=shown.camera), None)
                for name in shown.placements:
                    self.image.addItem(f"{shown.camera} · {name}", name)
                self.image.setCurrentIndex(max(self.image.findData(shown.placement), 0))
        self.residuals.show_camera(shown, self._picture(shown))
        self.residual_size.setText(residual_text(result, shown) if shown is not None else "")
        if shown is not None:
            used = shown.du_dv[shown.used].ravel()
            limit = 4 * max(float((used**2).mean() ** 0.5) if len(used) else 0.1, 1e-3)
            self.histogram.show_values(used, limit)
        if self.scene.marked != camera:
            self.scene.mark(camera)
        if self.sender() is self.scene:
            self.table.select_name(camera)
            self.tabs.setCurrentIndex(2)
        self._show_repairs(shown)

    def _show_repairs(self, shown: CameraResiduals | None) -> None:
        """What can be left out of what is shown."""
        stale = self.tr("It is already requested: calibrate again.")
        asked = self.open_project.repairs_now
        one = shown.placement if shown is not None else None
        why = stale if one is not None else self.tr("Choose one image on the left first.")
        there = one is not None and ("--leave-out", f"{self._camera}@{one}") not in asked
        enable(self.leave_image, there, why)
        enable(self.leave_camera, ("--leave-out", f"camera:{self._camera}") not in asked, stale)

    def _picture(self, shown: CameraResiduals | None) -> QImage | None:
        if shown is None or shown.placement is None:
            return None
        path = self.controller.recording.image_path(shown.placement, shown.camera)
        if path is None or not path.is_file():
            return None
        image = QImage(str(path))
        return None if image.isNull() else image.scaledToWidth(min(image.width(), 1600))

    def _show_image(self, placement: str | None) -> None:
        if self._camera is not None:
            self.show_camera(self._camera, placement)

    def _leave_out(self, what: str) -> None:
        self.controller.computation.repair("--leave-out", what)
        self._show_image(self.image.currentData())

    def _selected(self) -> None:
        if (camera := self.table.chosen) is not None:
            self.show_camera(camera)

    def _do(self, kind: str, target: str) -> None:
        if kind == "add placement":
            self.controller.sets.add_placement()
        elif kind == "retake":
            self.controller.go(f"placement:{target}")
        elif kind == "show camera":
            self.show_camera(target)
            self.tabs.setCurrentIndex(2)
        elif kind == "bench":
            self.controller.go("connect")
        elif kind == "calibrate":
            self._calibrate_again()
        elif kind.startswith("--"):
            self.controller.computation.repair(kind, target)

    def says(self) -> Said:
        """Accept the result, valid or not; the technician decides."""
        result, state, project = self.controller.result, self.state, self.open_project
        running = self.controller.runner.running or ""
        if result is None or state is None:
            return results_says(ResultFacts(running=running))
        message, calibrated = verdict(result), project.calibrated
        may_use = calibrated is None or usable(calibrated.verdict)
        accepted = project.accepted == calibrated
        stale = state.status is Status.STALE
        stopped = any(one.code == "stopped-early" for one in result.rig.quality.findings)
        return results_says(ResultFacts((message.word, message.level, may_use), stale, accepted, running, stopped))

    def _calibrate_again(self) -> None:
        self.controller.go("calibrate")
        self.controller.computation.calibrate()

    def _rig_png(self) -> bytes:
        """The scene as a PNG file; empty where nothing is shown."""
        if self.scene.data is None:
            return b""
        return png_of(QPixmap.fromImage(self.scene.thumbnail(*_THUMBNAIL_PX)))


def _cells(row: CameraRow, middle: float, not_placed: str, guilty: bool = False) -> list[tuple[str, Cell, str]]:
    if not row.placed:
        return [(row.camera, row.camera, "bad"), (not_placed, float("inf"), "bad"), *[("-", 0.0, "")] * 6]
    level = "caution" if (row.rms_px or 0.0) > _STANDS_OUT * middle else ""
    return [
        (row.camera, row.camera, "bad" if guilty else level),
        figure(row.rms_px, 3, level),
        (str(row.observations), row.observations, ""),
        (str(row.left_out), row.left_out, ""),
        figure(row.sd_centre_mm, 3),
        figure(row.sd_turn_deg, 4),
        figure(row.focal_px, 1),
        figure(row.change_mm, 3, "caution" if row.moved else ""),
    ]
