"""Plots: names for many lengths, adjustments against their own start, dots that lead to their image, numbers."""

import os

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QLocale, QPoint, QPointF, Qt
from pytestqt.qtbot import QtBot

from spherecal_gui import languages
from spherecal_gui.presenters.bars import Errors
from spherecal_gui.presenters.results import CameraResiduals
from spherecal_gui.widgets.basic import label
from spherecal_gui.widgets.charts import ConvergenceChart, ErrorChart
from spherecal_gui.widgets.residual_view import ResidualView
from spherecal_gui.widgets.table import Table


def errors_of(poses: int, lengths: int) -> Errors:
    names = [f"L{i + 1}\nA{j + 1}-A{j + 2}" for i in range(poses) for j in range(lengths)]
    count = len(names)
    return Errors(tuple(names), np.linspace(-0.01, 0.01, count), np.full(count, 0.02), (False,) * count)


def ticks(chart: ErrorChart) -> list[str]:
    (major,) = chart.getAxis("bottom")._tickLevels
    return [name for _, name in major]


def test_42_lengths_are_named_by_their_poses_and_few_by_both(qtbot: QtBot) -> None:
    chart = ErrorChart()
    qtbot.addWidget(chart)
    chart.resize(900, 300)
    chart.show()
    chart.show_errors(errors_of(2, 3))
    assert ticks(chart) == ["L1\nA1-A2", "L1\nA2-A3", "L1\nA3-A4", "L2\nA1-A2", "L2\nA2-A3", "L2\nA3-A4"]
    chart.show_errors(errors_of(14, 3))
    assert ticks(chart) == [f"L{i}" for i in range(1, 15)]
    chart.resize(260, 300)
    assert 1 <= len(ticks(chart)) < 14
    chart.resize(900, 300)
    assert len(ticks(chart)) == 14


def test_each_adjustment_goes_on_where_the_last_ended(qtbot: QtBot) -> None:
    """One of more dots costs more: drawn as it is, it would look like a step back."""
    chart = ConvergenceChart()
    qtbot.addWidget(chart)
    chart.show_runs([(1000.0, 10.0), (5.0, 0.5), (8000.0, 80.0)])
    earlier, latest = (np.asarray(curve.getData()[1]) for curve in (chart._earlier, chart._latest))
    assert np.allclose(earlier, [0, -2, -2, -3, -3])
    assert np.allclose(latest, [-3, -5])
    chart.show_runs([(4.0, 0.0)])
    assert np.allclose(np.asarray(chart._latest.getData()[1]), [0, 0])
    chart.show_runs(())


def test_a_dot_leads_to_its_image(qtbot: QtBot) -> None:
    view = ResidualView()
    qtbot.addWidget(view)
    view.resize(400, 326)
    uv = np.array([(100.0, 100.0), (500.0, 300.0), (505.0, 302.0)])
    shown = CameraResiduals(
        "C01", (800, 600), uv, np.full((3, 2), 0.01), np.ones(3, bool), ("P1", "P2"), None, ("P1", "P2", "P1")
    )
    view.show_camera(shown)
    view.show()
    field, scale = view._field()
    at = QPointF(field.left() + 500.5 * scale, 300.5 * scale)
    assert view.dot_at(at) == 1
    assert view.dot_at(QPointF(field.left() + 700 * scale, 50 * scale)) is None
    with qtbot.waitSignal(view.image_chosen) as chosen:
        qtbot.mouseClick(view, Qt.MouseButton.LeftButton, pos=QPoint(round(at.x()), round(at.y())))
    assert chosen.args == ["P2"]


@pytest.fixture
def german(qapp):
    languages.use("de")
    yield
    languages.use("en")


def test_numbers_are_written_as_the_language_writes_them(german, qtbot: QtBot) -> None:
    written = {
        "500 mm auf 0.014 mm (k = 2.1).": "500 mm auf 0,014 mm (k = 2,1).", "+0.002": "+0,002", "± 0.5°": "± 0,5°",
        "Version 0.1.0": "Version 0.1.0", "192.168.1.20": "192.168.1.20", "P1.5": "P1.5",
        "0.03+L/20000": "0.03+L/20000", "rig.json": "rig.json", "2.5": "2,5", "-0.001 mm": "-0,001 mm",
    }  # fmt: skip
    assert {text: languages.by_locale(text) for text in written} == written
    assert label("0.25 px").text() == "0,25 px"
    table = Table(["a", "b"])
    qtbot.addWidget(table)
    table.fill([[("C01", "C01", ""), ("0.5", 0.5, "")], [("C02", "C02", ""), ("0.25", 0.25, "")]], sort_by=1)
    assert [table.item(row, 1).text() for row in (0, 1)] == ["0,5", "0,25"]
    assert QLocale().toString(1234.5, "f", 1) == "1234,5"
    assert QLocale().toDouble("1.5") == (0.0, False), "1.5 is not read as 15"


def test_in_english_numbers_keep_their_point(qapp) -> None:
    languages.use("en")
    assert languages.by_locale("0.5 mm") == "0.5 mm"
