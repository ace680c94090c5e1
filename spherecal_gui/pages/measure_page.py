"""Measure: the rig as a live ruler between chosen points; a bar's deviation while it is carried; a series recorded."""

import itertools
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtWidgets import QAbstractItemView, QHBoxLayout, QListWidget, QVBoxLayout

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import SpherecalError
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import error_text
from spherecal_gui.pages.wizard_page import Page
from spherecal_gui.presenters.measure_presenter import (
    large_text,
    mark_ends,
    pace_text,
    point_names,
    rate_of,
    ruler_hint,
    rulers_of,
    trust_of,
    value_rows,
)
from spherecal_gui.presenters.step_states import MeasureFacts, measure_says
from spherecal_gui.rig_scenes import LiveParts, in_scene, rig_scene
from spherecal_gui.standing import Level, Said
from spherecal_gui.tasks.measuring_loop import LiveMeasurement
from spherecal_gui.widgets.basic import Card, add, label, named, say
from spherecal_gui.widgets.charts import Chart
from spherecal_gui.widgets.scene_view import SceneView
from spherecal_gui.widgets.table import Table
from spherecal_gui.workflow import Step
from spherecal_measuring.measured_sets import MeasuredSet
from spherecal_measuring.measuring_task import Task


class DeviationChart(Chart):
    """A value over the newest sets with its expanded uncertainty: the deviation from nominal, or from its mean."""

    def show_values(self, times: FloatArray, off: FloatArray, expanded: FloatArray, unit: str) -> None:
        """Show deviations with their expanded uncertainties. `times`: of the sets, (n,) s; `off`, `expanded` (n,)."""
        c = self.begin()
        if not len(times):
            return
        reach = float(max(np.abs(off).max(), expanded.max())) * 1.15 or 1.0
        self.span((float(times[0]), float(max(times[-1], times[0] + 1.0))), (-reach, reach))
        band = [pg.PlotDataItem(times, side * expanded, pen=pg.mkPen(c.border, width=1)) for side in (-1, 1)]
        for line in band:
            self.addItem(line)
        self.addItem(pg.FillBetweenItem(*band, brush=pg.mkBrush(c.raised)))
        self.addItem(pg.InfiniteLine(0.0, angle=0, pen=pg.mkPen(c.soft, width=1)))
        self.addItem(pg.PlotDataItem(times, off, pen=pg.mkPen(c.accent, width=2)))
        self.names(self.tr("s"), unit)


class MeasurePage(Page):
    """Points to choose on the left, values and their course on the right."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.deeds = {"record": self._record, "stop recording": self._end_recording}
        self._run: LiveMeasurement | None = None
        self._shown: MeasuredSet | None = None
        self._names: tuple[str, ...] = ()
        self._chosen: list[str] = []
        self._said = ""
        self._trust: tuple[str, Level] = ("", "none")
        self.headline = self.trust = label("", "big")
        self.pace, self.recording = label("", "soft"), label("", "soft")
        self.space = SceneView()
        self._rig: object = None  # the result whose rig the scene shows
        self.points = named(QListWidget(), "measured-points", self.tr("Points that are seen now"))
        self.points.setSelectionMode(QAbstractItemView.SelectionMode.MultiSelection)
        self.points.itemSelectionChanged.connect(self._choose)
        self.hint, card = label(ruler_hint(()), "soft"), Card(self.tr("Points"))
        add(card.body, (self.points, 1), self.hint)
        left = add(QVBoxLayout(), (self.space, 3), (card, 2))
        self.large = label("", "huge")
        headings = [self.tr("Value"), self.tr("measured"), self.tr("± (95 %)"), self.tr("off its nominal value")]
        self.table = Table(headings, sortable=False, spare=(2,))
        self.chart = DeviationChart()
        row = add(QHBoxLayout(), (left, 4), (add(QVBoxLayout(), self.large, (self.table, 1), (self.chart, 1)), 5))
        add(QVBoxLayout(self), self.trust, self.pace, (row, 1), self.recording)

    def enter(self, step: Step) -> None:
        """Begin to measure."""
        super().enter(step)
        self._begin()

    def leave(self) -> None:
        """End it; a series that is being recorded is written."""
        self._end()
        if self.controller.cameras.live is not None:
            self.controller.cameras.live.start(self.controller.cameras.live_hz)

    def close_page(self) -> None:
        """The program ends."""
        self._end()
        super().close_page()

    def _begin(self) -> None:
        connection, result = self.controller.cameras.connection, self.controller.result
        if self._run is not None or connection is None or result is None or connection.plan.target_set is None:
            return
        if self.controller.cameras.live is not None:
            self.controller.cameras.live.stop()  # its detection would take the time that measuring needs
        settings = map(self.controller.tuning.settings_of, connection.names)
        by_hardware = all(one.trigger == "hardware" for one in settings)
        task = Task(
            connection.plan.target_set,
            bars=tuple(connection.plan.bars),
            temperature_c=self.controller.bars.celsius(),
            exposure_sd_s=0.0 if by_hardware else None,
        )
        self._run = LiveMeasurement(connection.source, dict(connection.names), result.rig, task)
        self._run.ask(rulers_of(self._chosen))

    def _end(self) -> None:
        run, self._run = self._run, None
        if run is not None:
            try:
                run.stop()
            except SpherecalError as error:
                self.controller.tell("bad", *error_text(error))

    def show_project(self) -> None:
        """Cameras may have gone."""
        if self.controller.cameras.connection is None:
            self._end()

    def tick(self) -> None:
        """Show the newest set."""
        run = self._run
        if run is None:
            self._begin()
            return
        if run.problem is not None:
            text = " ".join(error_text(run.problem))
            if text != self._said:
                self._said = text
                self._trust = text, "bad"
                self.show_standing()
            return
        measured = run.latest
        if measured is None or measured is self._shown:
            return
        self._shown = measured
        self._show(run, measured)

    def _show(self, run: LiveMeasurement, measured: MeasuredSet) -> None:
        history = list(run.history)
        self._trust = trust_of(measured, run.moved)
        self.show_standing()
        self.pace.setText(pace_text(measured, rate_of([at for at, _ in history])))
        self._show_points(point_names(measured))
        self._show_space(measured, run.moved)
        rows = value_rows(measured)
        off = [(one.deviation, one.deviation, one.level) for one in rows]
        self.table.fill([[one.name, one.value, one.uncertainty, last] for one, last in zip(rows, off, strict=True)])
        for part in (self.table, self.chart, self.hint):  # else columns and axes without anything in them
            part.setVisible(bool(rows))
        first = (large_text(rows[0]), rows[0].level) if rows else (ruler_hint(self._chosen),)
        say(self.large, *first, hides=False)
        self._show_course(history, measured.values[0].name if measured.values else "")
        self.recording.setText(self.said().left)

    def _show_space(self, measured: MeasuredSet, moved: Sequence[str]) -> None:
        """The rig with the points that are measured, and the bars and distances between them."""
        result = self.controller.result
        if result is not None and result is not self._rig:
            self._rig = result
            self.space.show_scene(rig_scene(result.rig))
        data, connection = self.space.data, self.controller.cameras.connection
        if data is None or connection is None:
            return
        names = point_names(measured)
        places = dict(zip(names, in_scene(data, measured.points_mm), strict=True)) if names else {}
        lines = [mark_ends(bar) for bar in connection.plan.bars] + list(itertools.pairwise(self._chosen))
        bars = tuple((np.stack([places[a], places[b]]), True) for a, b in lines if a in places and b in places)
        levels: dict[str, Level] = {name: "bad" if name in moved else "good" for name in connection.names.values()}
        self.space.show_live(LiveParts(bars=bars, levels=levels, points=tuple(places.items())))

    def _show_points(self, names: tuple[str, ...]) -> None:
        """All points seen now, and those that are chosen."""
        names = tuple(dict.fromkeys((*names, *self._chosen)))
        if names == self._names:
            return
        self._names = names
        with QSignalBlocker(self.points):
            self.points.clear()
            self.points.addItems(list(names))
            for name in self._chosen:
                for item in self.points.findItems(name, Qt.MatchFlag.MatchExactly):
                    item.setSelected(True)

    def _show_course(self, history: list[tuple[float, MeasuredSet]], name: str) -> None:
        found = [(at, v) for at, one in history for v in one.values if v.name == name]
        times = np.array([at for at, _ in found])
        values = np.array([v.value if v.deviation is None else v.deviation for _, v in found])
        expanded = np.array([2 * (v.u if v.u_deviation is None else v.u_deviation) for _, v in found])
        middle = float(np.mean(values)) if found and found[-1][1].deviation is None else 0.0
        unit = f"{name} [{found[-1][1].unit}]" if found else ""
        self.chart.show_values(times, values - middle, expanded, unit)

    def _choose(self) -> None:
        """Points in the order in which they were chosen."""
        now = [item.text() for item in self.points.selectedItems()]
        self._chosen = [name for name in self._chosen if name in now] + [n for n in now if n not in self._chosen]
        self.hint.setText(ruler_hint(self._chosen))
        if self._run is not None:
            self._run.ask(rulers_of(self._chosen))

    def says(self) -> Said:
        """Record a series, or end it."""
        run = self._run
        measuring = run is not None and run.problem is None
        return measure_says(MeasureFacts(self._trust, measuring, run.recorded if run is not None else None))

    def _record(self) -> None:
        if self._run is not None:
            self._folder = Path(self.open_project.folder) / f"series-{datetime.now():%Y%m%d-%H%M%S}"
            self._run.record(self._folder)
        self.action_changed.emit()

    def _end_recording(self) -> None:
        try:
            count = self._run.end_recording() if self._run is not None else 0
        except SpherecalError as error:
            self.controller.tell("bad", *error_text(error))
        else:
            text = self.tr("{sets} sets recorded in {folder}.").format(sets=count, folder=self._folder)
            self.controller.tell("good", text)
            self.recording.setText(text)
        self.action_changed.emit()
