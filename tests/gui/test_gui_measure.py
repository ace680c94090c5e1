"""The page Measure: a live ruler between chosen points, a bar's deviation, a series recorded."""

import csv
import os
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QFontMetricsF

from spherecal.data.rig import Rig
from spherecal_cameras.protocol import CameraSettings
from spherecal_cameras.simulated.simulated_source import SimulatedSource
from spherecal_gui.pages.measure_page import DeviationChart, MeasurePage
from spherecal_gui.presenters.measure_presenter import rate_of, ruler_hint, rulers_of, trust_of
from spherecal_gui.workflow import Step
from spherecal_measuring.measured_sets import Contradiction

PATIENCE_MS = 60_000


class Bench(QObject):
    """What the page needs of the controller: the simulated demo rig, calibrated perfectly."""

    changed = Signal()

    def __init__(self, folder) -> None:
        super().__init__()
        source = SimulatedSource("demo", 1)
        session, cameras = source.stage.session, source.stage.truth.cameras
        source.show("A-01")
        source.open(source.discover().serials, {})
        names = {f"SIM-{camera.id}": camera.id for camera in cameras}
        plan = SimpleNamespace(target_set=session.target_set, bars=session.bars)
        connection = SimpleNamespace(source=source, names=names, plan=plan)
        self.cameras = SimpleNamespace(connection=connection, live=None)
        self.tuning = SimpleNamespace(settings_of=lambda _: CameraSettings())
        self.bars = SimpleNamespace(celsius=lambda: 20.0)
        K = {
            c.id: [[c.intrinsics[0], 0, c.intrinsics[2]], [0, c.intrinsics[1], c.intrinsics[3]], [0, 0, 1]]
            for c in cameras
        }
        self.result = SimpleNamespace(
            rig=Rig.from_opencv(
                {c.id: (K[c.id], c.intrinsics[4:], c.rotation, c.translation_mm) for c in cameras},
                {c.id: c.kind.image_size for c in cameras},
            )
        )
        self.project, self.state = SimpleNamespace(folder=folder), None
        self.said: list[tuple[str, str]] = []

    def tell(self, kind: str, text: str, hint: str = "") -> None:
        self.said.append((kind, text))


@pytest.fixture
def page(qtbot, tmp_path):
    made = MeasurePage(Bench(tmp_path))  # type: ignore[arg-type]
    qtbot.addWidget(made)
    made.resize(1100, 620)
    made.show()
    made.enter(Step("measure", "measure"))
    yield made
    made.close_page()
    made.controller.cameras.connection.source.close()


def ticking(page: MeasurePage, done) -> bool:
    page.tick()
    return bool(done())


def test_a_bar_is_measured_live_and_recorded(qtbot, page, tmp_path):
    qtbot.waitUntil(lambda: ticking(page, lambda: page.table.rowCount() >= 3), timeout=PATIENCE_MS)
    assert page.trust.text() == "The cameras agree."
    assert "mm" in page.large.text()
    action = page.action()
    assert action is not None and action.enabled
    page.act()
    qtbot.waitUntil(lambda: ticking(page, lambda: (page._run.recorded or 0) >= 2), timeout=PATIENCE_MS)
    assert page.action().text == "Stop recording"
    page.act()
    assert page.controller.said[-1][0] == "good"
    (folder,) = tmp_path.glob("series-*")
    with (folder / "values.csv").open(encoding="utf-8", newline="") as file:
        off = [float(row["deviation"]) for row in csv.DictReader(file)]
    assert len(off) >= 6
    assert max(map(abs, off)) < 0.03  # mm


def test_two_chosen_points_give_their_distance(qtbot, page):
    qtbot.waitUntil(lambda: ticking(page, lambda: page.points.count() >= 2), timeout=PATIENCE_MS)
    for row in (0, 1):
        page.points.item(row).setSelected(True)
    name = "-".join(page._chosen)
    assert page.hint.text() == ""
    qtbot.waitUntil(lambda: ticking(page, lambda: page._shown.values[0].name == name), timeout=PATIENCE_MS)
    assert page._shown.values[0].kind == "distance"


def test_points_alone_ask_for_a_choice_in_place_of_empty_axes(qtbot, page):
    page.controller.cameras.connection.source.show("P1")
    qtbot.waitUntil(
        lambda: ticking(page, lambda: page.points.count() > 20 and not page._shown.values), timeout=PATIENCE_MS
    )
    assert page.table.isHidden() and page.chart.isHidden()
    assert page.large.text().startswith("Choose two points")
    page.controller.cameras.connection.source.show("A-01")
    qtbot.waitUntil(lambda: ticking(page, lambda: bool(page._shown.values)), timeout=PATIENCE_MS)
    assert not page.table.isHidden() and not page.chart.isHidden()


def test_the_upper_tick_of_the_course_is_not_cut(qtbot):
    """A number stood half above the chart."""
    chart = DeviationChart()
    qtbot.addWidget(chart)
    chart.resize(700, 240)
    chart.show()
    chart.show_values(np.linspace(0.0, 8.0, 40), np.zeros(40), np.full(40, 0.0435), "bar 1 [mm]")  # up to 0.05002
    axis = chart.getAxis("left")
    qtbot.waitUntil(lambda: axis.picture is not None)
    top = axis.mapRectToScene(axis.linkedView().mapRectToItem(axis, axis.linkedView().boundingRect())).top()
    assert top >= QFontMetricsF(axis.style["tickFont"]).height() / 2 - 1


def test_leaving_the_page_ends_the_measurement_and_writes_what_was_recorded(qtbot, page, tmp_path):
    qtbot.waitUntil(lambda: ticking(page, lambda: page._shown is not None), timeout=PATIENCE_MS)
    page.act()
    qtbot.waitUntil(lambda: ticking(page, lambda: (page._run.recorded or 0) >= 1), timeout=PATIENCE_MS)
    page.leave()
    assert page._run is None
    assert len(list(tmp_path.glob("series-*/series.json"))) == 1


def test_cameras_that_are_gone_are_said(qtbot, page):
    qtbot.waitUntil(lambda: ticking(page, lambda: page._shown is not None), timeout=PATIENCE_MS)
    page.controller.cameras.connection.source.close()
    qtbot.waitUntil(lambda: ticking(page, lambda: page._run.problem is not None), timeout=PATIENCE_MS)
    page.tick()
    assert "open" in page.trust.text().lower(), page.trust.text()  # "Open them again.", or "No camera is open."
    assert not page.action().enabled


def test_words_about_trust() -> None:
    def measured(names: tuple[int, ...], *contradictions: Contradiction) -> Any:
        return SimpleNamespace(names=names, contradictions=contradictions)

    assert trust_of(measured((1,)), ())[1] == "good"
    moved, level = trust_of(measured((1,)), ("C02",))
    assert level == "bad" and "C02" in moved
    assert "C03" in trust_of(measured((1,), Contradiction(7, "C03", 8, 8)), ())[0]
    assert "7" in trust_of(measured((1,), Contradiction(7, None, 8, 8)), ())[0]
    assert trust_of(measured((1,), Contradiction(7, "C03", 1, 8)), ())[1] == "good", "one dot"
    assert trust_of(measured(()), ())[1] == "caution"


def test_rulers_and_rates() -> None:
    assert rulers_of(["1"]) == () and ruler_hint(["1"])
    assert rulers_of(["1", "2/A"])[0].name == "1-2/A" and ruler_hint(["1", "2"]) == ""
    assert rulers_of(["1", "2", "3"])[0].kind == "angle"
    assert rulers_of(["1", "2", "3", "4"]) == () and ruler_hint(["1", "2", "3", "4"])
    assert rate_of([0.0, 0.1, 0.2]) == pytest.approx(10.0)
    assert rate_of([0.0]) is None
