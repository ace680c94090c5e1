"""Plots: names for many lengths, adjustments against their own start, dots that lead to their image, numbers."""

import os
from pathlib import Path

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QLocale, QPoint, QPointF, Qt
from PySide6.QtGui import QTextLayout
from PySide6.QtWidgets import QLabel, QWidget
from pytestqt.qtbot import QtBot

from spherecal_files.findings_file import Sentence
from spherecal_files.verification_file import BarReport, BarRow, ProcedureReport
from spherecal_gui import languages
from spherecal_gui.presenters.bars_presenter import Errors
from spherecal_gui.presenters.bars_presenter import errors_of as verification_errors
from spherecal_gui.presenters.results_presenter import CameraResiduals
from spherecal_gui.widgets.basic import label
from spherecal_gui.widgets.charts import ConvergenceChart, ErrorChart
from spherecal_gui.widgets.results_views import ResidualView
from spherecal_gui.widgets.scene_panel import SceneSplit
from spherecal_gui.widgets.table import Table
from spherecal_verify.limit import Acceptance, LengthConformity, parse_limit


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
        "B: 120.029, -279.95, 0.5 mm": "B: 120,029; -279,95; 0,5 mm",
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


def _lines(text: str, width: float) -> list[str]:
    """The lines of a text as Qt breaks them."""
    layout, found = QTextLayout(text), []
    layout.beginLayout()
    while (line := layout.createLine()).isValid():
        line.setLineWidth(width)
        found.append(text[line.textStart() : line.textStart() + line.textLength()].strip())
    layout.endLayout()
    return found


@pytest.mark.parametrize(
    ("text", "held"),
    [
        ("about 0.5 mm beside it", "0.5\u00a0mm"),
        ("80 mm and 15 degrees to go", "15\u00a0degrees"),
        ("bis auf ± 0,5 ° genau", "±\u00a00,5\u00a0°"),
        ("at 50 mm/s or less", "50\u00a0mm/\u2060s"),
        ("zu 4 % hell", "4\u00a0%"),
        ("还需 30 秒。", "30\u00a0秒"),
        ("还需 30 秒后再试", "30\u00a0秒"),
    ],
)
def test_no_line_ends_between_a_number_and_its_unit(qapp, text: str, held: str) -> None:
    shown = languages.unbroken(text)
    assert any(held.replace("\u00a0", " ").replace("\u2060", "") not in line for line in _lines(text, 1.0))
    assert any(held in line for line in _lines(shown, 1.0)), "even where there is no room at all"


@pytest.mark.parametrize(
    "text", ["placement 3 minus 2", "C03 made 5 images", "4 m-bars", "12 shots", "0.03 mm+L/20000"]
)
def test_other_words_are_not_tied_to_numbers(text: str) -> None:
    assert languages.unbroken(text).replace("0.03\u00a0mm", "0.03 mm") == text


def test_only_the_screen_has_no_break_spaces(qapp) -> None:
    made = label("0.25 px at 50 mm/s")
    assert made.text() == "0.25 px at 50 mm/s" and QLabel.text(made) == "0.25\u00a0px at 50\u00a0mm/\u2060s"
    made.clear()
    assert made.text() == "" and QLabel.text(made) == ""
    assert languages.by_locale("0.25 px") == "0.25 px", "cells of tables are copied"
    window = Path(languages.__file__).parent
    callers = {path.name for path in window.rglob("*.py") if "unbroken(" in path.read_text(encoding="utf-8")}
    assert callers == {"languages.py", "basic.py", "fields.py"}, "nothing that is written, copied or compared"


@pytest.mark.parametrize(("low", "high", "told"), [(-3.1, 0.1, [-3, -2, -1, 0]), (-0.8, 0.1, [0.2, 0.5, 1])])
def test_labels_of_the_convergence_do_not_cover_each_other(qtbot: QtBot, low: float, high: float, told: list) -> None:
    chart = ConvergenceChart()
    qtbot.addWidget(chart)
    (_, labelled), (_, others) = chart.getAxis("left").tickValues(low, high, 400.0)
    shown = labelled if high - low > 1.0 else [10**value for value in labelled]
    assert shown == pytest.approx(told)
    assert others and not set(others) & set(labelled) and all(low <= value <= high for value in labelled + others)


def test_a_larger_screen_is_the_scenes(qtbot: QtBot) -> None:
    split = SceneSplit(QWidget(), QWidget(), (620, 600))
    qtbot.addWidget(split)
    split.resize(1220 + split.handleWidth(), 700)
    split.show()
    assert split.sizes() == [620, 600]
    split.resize(2420 + split.handleWidth(), 1300)
    assert split.sizes() == [1420, 1000]
    split.moveSplitter(900, 1)
    split.resize(1820 + split.handleWidth(), 1000)
    assert split.sizes()[0] < 900, "where somebody put the handle, in proportion"


def test_the_errors_of_a_verification_with_a_limit_have_its_guard_band() -> None:
    """The page read another name of the field and ended with an error."""
    row = LengthConformity("A", "A1", "A2", "L1", 0.004, 0.03, 0.008, "pass")
    acceptance = Acceptance(parse_limit("0.03+L/20000"), "pass", (row,))
    bar = BarRow("A", "A1", "A2", "L1", 500.004, 500.0, 0.004, 0.003, 4)
    procedure = ProcedureReport("", (), (), (), (), acceptance=acceptance)
    report = BarReport((), 1, "consistent", Sentence("r"), coverage_factor=2.0, procedure=procedure, measured=(bar,))
    shown = verification_errors(report)
    assert shown.guard is not None and shown.guard.tolist() == [0.008]
