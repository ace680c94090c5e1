"""Results: verdict first, then the rig, the cameras worst first, residuals, and what the findings advise."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QHBoxLayout, QSplitter, QTabWidget, QVBoxLayout, QWidget

from spherecal_gui.pages.base import Page, PageAction
from spherecal_gui.presenters.results import CameraRow, advice, camera_rows, residuals_of, verdict
from spherecal_gui.presenters.scene import scene_data
from spherecal_gui.widgets.basic import button, label, set_level
from spherecal_gui.widgets.charts import HistogramChart
from spherecal_gui.widgets.findings import FindingsList
from spherecal_gui.widgets.residual_view import ResidualView
from spherecal_gui.widgets.scene import Scene3D, SceneView, make_scene_view
from spherecal_gui.widgets.table import Cell, Table
from spherecal_gui.wizard.controller import Controller
from spherecal_gui.workflow import Status

# A camera this much worse than the middle one stands out: rig A's differ by a tenth, a blurred one is 2 times worse.
_STANDS_OUT = 1.5


class ResultsPage(Page):
    """The result of the last calibration."""

    def __init__(self, controller: Controller, parent: QWidget | None = None) -> None:
        super().__init__(controller, parent)
        self._shown: object = None
        column = QVBoxLayout(self)
        head = QHBoxLayout()
        self.word = label("", "huge", wrap=False)
        self.sentence = label("", "big")
        self.copy = button(self.tr("Copy as command"), "copy-command")
        self.copy.setToolTip(self.tr("The command line that gives the same files, byte for byte."))
        self.copy.clicked.connect(self._copy)
        head.addWidget(self.word)
        head.addSpacing(14)
        head.addWidget(self.sentence, 1)
        head.addWidget(self.copy)
        column.addLayout(head)
        split = QSplitter(Qt.Orientation.Horizontal)
        split.addWidget(self._left())
        split.addWidget(self._right())
        split.setStretchFactor(0, 5)
        split.setStretchFactor(1, 6)
        column.addWidget(split, 1)

    def _left(self) -> QWidget:
        left = QWidget()
        column = QVBoxLayout(left)
        column.setContentsMargins(0, 0, 0, 0)
        self.scene: SceneView = make_scene_view()
        self.scene.camera_chosen.connect(self.show_camera)
        views = QHBoxLayout()
        for side, text in (
            ("oblique", self.tr("Oblique")), ("top", self.tr("Top")), ("front", self.tr("Front")),
            ("side", self.tr("Side")),
        ):  # fmt: skip
            one = button(text, f"view-{side}")
            one.setProperty("side", side)
            one.clicked.connect(self._look_from)
            views.addWidget(one)
        column.addWidget(self.scene, 1)
        column.addLayout(views)
        key = self.tr("Points by their residual: blue small, red large. Green: the volume that was calibrated.")
        column.addWidget(label(key, "soft"))
        return left

    def _right(self) -> QWidget:
        self.tabs = QTabWidget()
        self.findings = FindingsList()
        self.findings.asked.connect(self._do)
        self.table = Table(
            [
                self.tr("Camera"), self.tr("rms\npx"), self.tr("dots"), self.tr("left\nout"), self.tr("place ±\nmm"),
                self.tr("turn ±\ndeg"), self.tr("focal\npx"),
            ]
        )  # fmt: skip
        self.table.itemSelectionChanged.connect(self._selected)
        self.table.itemDoubleClicked.connect(lambda _: self.tabs.setCurrentIndex(2))
        residuals = QWidget()
        column = QVBoxLayout(residuals)
        self.residuals = ResidualView()
        self.histogram = HistogramChart()
        column.addWidget(self.residuals, 3)
        column.addWidget(self.histogram, 2)
        self.tabs.addTab(self.findings, self.tr("What to do"))
        self.tabs.addTab(self.table, self.tr("Cameras"))
        self.tabs.addTab(residuals, self.tr("Residuals"))
        return self.tabs

    def refresh(self) -> None:
        """There may be another result."""
        result = self.controller.result
        if self.project is None or result is None:
            self.word.setText(self.tr("Reading the result") if self.controller.runner.running else "")
            self.action_changed.emit()
            return
        told = verdict(result)
        state = self.state
        stale = state is not None and state.status is Status.STALE
        self.word.setText(self.tr("OUT OF DATE") if stale else told.word)
        set_level(self.word, "caution" if stale else told.level)
        self.sentence.setText(told.sentence)
        self.findings.show_advice(advice(result, self.project.placements))
        if result is not self._shown:
            self._shown = result
            self._fill()
        self.action_changed.emit()

    def _fill(self) -> None:
        result = self.controller.result
        rows = camera_rows(result)
        usual = sorted(row.rms_px for row in rows if row.rms_px is not None)
        middle = usual[len(usual) // 2] if usual else 1.0
        self.table.fill([_cells(row, middle) for row in rows], sort_by=1)
        self.scene.show_scene(scene_data(result))
        if rows:
            self.table.selectRow(0)
            self.show_camera(rows[0].camera)

    def dress(self) -> None:
        """Draw in the new colours."""
        if isinstance(self.scene, Scene3D):
            self.scene.dress()
        if self.controller.result is not None and self._shown is not None:
            self._fill()
        self.refresh()

    def show_camera(self, camera: str) -> None:
        """Show a camera's residuals and mark it in the scene."""
        result = self.controller.result
        if result is None:
            return
        shown = residuals_of(result, camera)
        self.residuals.show_camera(shown)
        if shown is not None:
            used = shown.du_dv[shown.used].ravel()
            limit = 4 * max(float((used**2).mean() ** 0.5) if len(used) else 0.1, 1e-3)
            self.histogram.show_values(used, limit)
        if self.scene.marked != camera:
            self.scene.mark(camera)
        if self.sender() is self.scene:
            self.table.select_name(camera)
            self.tabs.setCurrentIndex(2)

    def _selected(self) -> None:
        rows = self.table.selectionModel().selectedRows()
        if rows:
            self.show_camera(self.table.name_of(rows[0].row()))

    def _look_from(self) -> None:
        sender = self.sender()
        if sender is not None:
            self.scene.look_from(str(sender.property("side")))

    def _do(self, kind: str, target: str) -> None:
        """Do what a finding advises."""
        if kind == "add placement":
            self.controller.add_placement()
        elif kind == "retake":
            self.controller.go(f"placement:{target}")
        elif kind == "show camera":
            self.show_camera(target)
            self.tabs.setCurrentIndex(2)
        elif kind == "bench":
            self.controller.go("connect")

    def _copy(self) -> None:
        commands = self.controller.commands()
        QGuiApplication.clipboard().setText("\n".join(commands))
        self.controller.tell("info", self.tr("Copied."), commands[0] if commands else "")

    def action(self) -> PageAction:
        """Accept the result, valid or not; the technician decides."""
        state, text = self.state, self.tr("Accept the result")
        if self.controller.result is None:
            return PageAction(text, False, self.tr("The result is being read."))
        if self.project.accepted == self.project.calibrated:
            return PageAction(text, False, self.tr("It was accepted already."), done=True)
        if state is not None and state.status is Status.STALE:
            return PageAction(text, False, self.tr("It is out of date: calibrate again."))
        if state is not None and self.project.calibrated.verdict != "valid":
            return PageAction(text, False, self.tr("It is not valid: do what the findings advise."))
        return PageAction(text)

    def act(self) -> None:
        """Accept."""
        self.controller.accept_results()

    def close_page(self) -> None:
        """Let go of the 3-D view."""
        self.scene.close_view()


def _cells(row: CameraRow, middle: float) -> list[tuple[str, Cell, str]]:
    def cell(value: float | None, digits: int) -> tuple[str, Cell, str]:
        return ("-" if value is None else f"{value:.{digits}f}", value if value is not None else float("inf"), "")

    if not row.placed:
        return [(row.camera, row.camera, "bad"), ("not placed", float("inf"), "bad"), *[("-", 0.0, "")] * 5]
    level = "caution" if (row.rms_px or 0.0) > _STANDS_OUT * middle else ""
    rms = cell(row.rms_px, 3)
    return [
        (row.camera, row.camera, level), (rms[0], rms[1], level), (str(row.observations), row.observations, ""),
        (str(row.left_out), row.left_out, ""), cell(row.sd_centre_mm, 3), cell(row.sd_turn_deg, 4),
        cell(row.focal_px, 1),
    ]  # fmt: skip
