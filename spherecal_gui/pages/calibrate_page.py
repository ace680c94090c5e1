"""Calibrate: what goes into it, stages, time left, convergence, log; it can be cancelled at any moment."""

import time
from functools import partial
from html import escape
from typing import Literal

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QPlainTextEdit, QProgressBar, QVBoxLayout, QWidget

from spherecal_gui import coverage as cov
from spherecal_gui import theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import reason_text, word
from spherecal_gui.pages.wizard_page import Page
from spherecal_gui.presenters.calibrate_presenter import CourseOfWork, input_rows
from spherecal_gui.presenters.step_states import CalibrateFacts, calibrate_says
from spherecal_gui.project import usable
from spherecal_gui.standing import Said
from spherecal_gui.widgets.basic import Card, add, bare, button, enable, label, named
from spherecal_gui.widgets.charts import ConvergenceChart, CoverageChart
from spherecal_gui.widgets.table import Table
from spherecal_gui.workflow import Status

_MOST_STAGES, _MOST_FROM_AFAR = 11, 6  # what fits 1280 x 800
_DRAW_S = 0.7
_LAST = "writing the result"  # the stage that every computation with a result comes to


class CalibratePage(Page):
    """The computation."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.deeds = {"calibrate": controller.computation.calibrate, "results": partial(controller.go, "results")}
        self.course: CourseOfWork = controller.computation.course or CourseOfWork()
        self._was_running = False
        self._drawn_s, self._told = 0.0, 0
        self.headline = self.word = label("", "huge")
        self.bar = QProgressBar(maximum=1000, textVisible=False)  # no text is legible on both halves of a bar
        self.left = label("", "big")
        tip = self.tr("Ends as soon as there is something to look at. Such a result is not valid.")
        self.stop_here = button(self.tr("Stop here"), "stop-here", act=controller.computation.stop_here, tip=tip)
        self.again = button(self.tr("Calibrate again"), "calibrate-again", act=self.controller.computation.calibrate)
        line = add(QHBoxLayout(), (self.left, 1), self.stop_here, self.again)
        self._inputs, self._work, self._method_line = self._input_card(), self._make_work(), self._make_method_line()
        self._inputs.hide()
        self._method_line.hide()
        self.details.toggled.connect(self._show_method)
        column = add(QVBoxLayout(self), self.word, self.bar, line)
        add(column, (self._inputs, 1), (self._work, 1), self._method_line)
        if self.course.stages:  # a window made again, in another language say
            self._draw()

    def _make_work(self) -> QWidget:
        """Stages, convergence and log of the running computation."""
        work = QWidget()
        stages = Card(self.tr("Stages"))
        self._stages = label("", "", wrap=False)  # one text: a grid of labels is laid out for 50 ms beside the engine
        self._stages.setTextFormat(Qt.TextFormat.RichText)
        add(stages.body, self._stages, None)
        plot = Card(self.tr("Convergence"))
        self.plot = ConvergenceChart()
        text = self.tr("Done when the line falls no more. Each adjustment goes on where the one before ended.")
        self._plot_key = label(text, "soft")
        self.details = button(self.tr("Details"), "details", icon="list-details")
        self.details.setCheckable(True)
        foot = add(QHBoxLayout(), (self._plot_key, 1), (self.details, Qt.AlignmentFlag.AlignRight))
        add(plot.body, (self.plot, 1), foot)
        self._log = Card(self.tr("Log"))  # for the person at the desk
        lines = QPlainTextEdit(readOnly=True, maximumBlockCount=2000)
        self.lines = named(lines, "", self.tr("Log of the computation"))
        self._log.body.addWidget(self.lines, 1)
        self._log.hide()
        self.details.toggled.connect(self._log.setVisible)
        add(bare(QHBoxLayout(work)), (stages, 2), (add(QVBoxLayout(), (plot, 3), (self._log, 2)), 3))
        return work

    def _input_card(self) -> Card:
        """What there is to compute from: a table, and what the images cover."""
        made = Card(self.tr("What goes into it"))
        self.inputs = Table(
            [self.tr("Captured"), self.tr("cameras"), self.tr("dots"), self.tr("state")], sortable=False
        )
        self.inputs.setSelectionMode(Table.SelectionMode.NoSelection)
        self.coverage = CoverageChart()
        self.covered_key = label(self.tr("Green: where each camera has seen dots, over all placements."), "soft")
        covered = add(QVBoxLayout(), (self.coverage, 1), self.covered_key)
        made.body.addLayout(add(QHBoxLayout(), (self.inputs, 5), (covered, 4)), 1)
        return made

    def _make_method_line(self) -> QWidget:
        """The choice of the method, for those who come from the paper."""
        line = QWidget()
        tip = self.tr("With the paper's method lengths are less certain. The report names the method.")
        self.method = named(QComboBox(), "", self.tr("Method of the calibration"), tip)
        self.method.addItem(self.tr("ours (recommended)"), "")
        self.method.addItem(self.tr("the paper's (Tao et al., 2021)"), "tao2021")
        self.method.activated.connect(lambda _: self.controller.change(method=self.method.currentData()))
        add(bare(QHBoxLayout(line)), label(self.tr("Method"), "soft"), self.method, None)
        return line

    def _show_method(self) -> None:
        """Before the first computation, later among the details; a board has a method of its own."""
        project = self.project
        asked = self._inputs.isVisibleTo(self) or self.details.isChecked()
        self._method_line.setVisible(project is not None and not project.by_board and asked and not theme.is_far())
        if project is not None:
            self.method.setCurrentIndex(max(self.method.findData(project.method), 0))
        self.method.setEnabled(not self.is_running)

    @property
    def is_running(self) -> bool:
        """Whether the computation runs."""
        return self.controller.runner.running == "calibrate"

    def show_project(self) -> None:
        """Started, ended, or something is out of date."""
        if self.controller.computation.course is not self.course:  # begun, another project, or a window made again
            self.course = self.controller.computation.course or CourseOfWork()
            self._told = 0
            self.lines.clear()
            self._draw()
        self._show_news(last=not self.is_running)
        if self._was_running != self.is_running:
            self._draw()
        self._was_running = self.is_running
        said = self.said()
        self._show_stop_here()
        self.left.setText(said.left)
        self.bar.setVisible(self.is_running)
        self.again.setVisible("calibrate-again" in said.also)
        self._show_inputs()
        self._show_method()

    def _show_inputs(self) -> None:
        """Before anything is computed: what it would be computed from."""
        waiting = not self.is_running and not self.course.stages
        self._inputs.setVisible(waiting)
        self._work.setVisible(not waiting)
        if not waiting:
            return
        words = ((self.tr("captured"), "good"), (self.tr("not captured"), "caution"))
        there, lacking = ((word, word, level) for word, level in words)
        rows = input_rows(self.open_project.sets, self.controller.recording.dots)
        self.inputs.fill([[*figures, there if captured else lacking] for *figures, captured in rows])
        self._show_coverage()

    def _show_coverage(self) -> None:
        """What the images of all placements cover, camera by camera."""
        dots, cameras = self.controller.recording.dots, list(self.controller.cameras.names.values())
        sets = [dots[name] for name in self.open_project.placements if name in dots]
        for part in (self.coverage, self.covered_key):
            part.setVisible(bool(cameras and sets))
        if not cameras or not sets:
            return
        before = [cov.cells([one[name] for one in sets if name in one]) for name in cameras]
        needs = (cov.board_needs if self.open_project.by_board else cov.needs)(sets, cameras)
        self.coverage.show_cells(cameras, before, [0 * one for one in before], [one.level for one in needs])

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Names stand above the frames where there is room."""
        super().resizeEvent(event)
        if self._inputs.isVisible():
            self._show_coverage()

    def _show_stop_here(self) -> None:
        """Offered while it computes; a valid result is never given away for a part of one."""
        task, done = self.controller.runner.task, self.open_project.calibrated
        self.stop_here.setVisible(self.is_running)
        keeps = done is not None and usable(done.verdict)
        idle = task is not None and not task.stopping and not task.keeping
        why = self.tr("The last calibration is valid and would be lost: cancel instead.") if keeps else ""
        enable(self.stop_here, idle and not keeps, why or self.tr("It was asked for."))

    def dress(self) -> None:
        """Draw in the new colours."""
        self._draw()
        self.refresh()

    def tick(self) -> None:
        """Follow the computation."""
        if not self.is_running:
            return
        self.bar.setValue(int(1000 * self.course.fraction))
        self.left.setText(self.said().left)
        self.show_standing()
        self._show_news()

    def _show_news(self, last: bool = False) -> None:
        """Draw what has come since the last look; that costs the window 20 ms each time."""
        now = time.monotonic()
        self._draw_stages()  # never later than the line above it
        if len(self.course.said) == self._told or (now - self._drawn_s < _DRAW_S and not last):
            return
        for line in self.course.said[self._told :]:
            self.lines.appendPlainText(line)
        self._told, self._drawn_s = len(self.course.said), now
        self._draw_plot()

    def _draw_plot(self) -> None:
        self.plot.show_runs(self.course.runs)
        self._plot_key.setVisible(bool(self.course.runs))  # else there is no line

    def _draw(self) -> None:
        far = theme.is_far()
        self.details.setVisible(not far)
        self._log.setVisible(self.details.isChecked() and not far)
        self._draw_stages()
        self._draw_plot()

    def _draw_stages(self) -> None:
        """All stages so far; the one that it is at is marked wherever it stands, for the adjustments come twice."""
        stages = self.course.stages[-(_MOST_FROM_AFAR if theme.is_far() else _MOST_STAGES) :]
        good, now, bad = theme.now().good, theme.now().accent, theme.now().caution
        lines = []
        for stage in stages:
            mark, tint, words = "✓", good, escape(word("stages", stage, stage))
            if stage == self.course.stage and self.is_running:
                mark, tint, words = "▸", now, f"<b>{words}</b>"
            elif stage == stages[-1] and _LAST not in self.course.stages and not self.is_running:  # cut short
                mark, tint = "✕", bad
            lines.append(f'<span style="color: {tint}">{mark}</span>&nbsp; {words}')
        text = f'<p style="line-height: 150%">{"<br>".join(lines)}</p>' if lines else ""
        if text != self._stages.text():
            self._stages.setText(text)

    def says(self) -> Said:
        """Start, cancel, see what came of it."""
        state, task, project = self.open_state, self.controller.runner.task, self.open_project
        run: Literal["", "running", "stopping", "keeping"] = ""
        if self.is_running and task is not None:
            run = "stopping" if task.stopping else "keeping" if task.keeping else "running"
        code = state.reason.code if state.reason is not None else ""
        computed = state.status in (Status.DONE, Status.CARE) or (state.status, code) == (Status.FAILED, "not valid")
        verdict = project.calibrated.verdict if project.calibrated is not None and computed else ""
        how = state.status, reason_text(state.reason), code == "error", verdict, run, task is not None
        taken = sum(name in project.taken for name in project.placements)
        return calibrate_says(CalibrateFacts(*how, taken, len(project.placements), self.controller.progress_text()))
