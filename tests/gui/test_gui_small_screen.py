"""On a small screen, with the letters for three metres: nothing leaves the page, nothing covers anything else."""

import os
from types import SimpleNamespace
from typing import Any

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QCoreApplication, QPoint, QRect
from PySide6.QtWidgets import QLabel, QPushButton, QScrollArea, QVBoxLayout, QWidget

from spherecal.base.context import Progress
from spherecal_gui import languages, theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.calibrate_page import CalibratePage
from spherecal_gui.pages.connect_page import ConnectPage
from spherecal_gui.pages.save_page import SavePage
from spherecal_gui.pages.verify_page import VerifyPage
from spherecal_gui.presenters.connect_presenter import BenchRow, CameraLine
from spherecal_gui.project import Project
from spherecal_gui.standing import Button, Said, Standing
from spherecal_gui.wizard.header import Footer
from spherecal_gui.workflow import Running, Step, resolve

# What is left of 1280 x 800 for the page beside the rail, below the heading, above the large buttons.
ROOM = (1028, 505)


@pytest.fixture
def afar(qapp):
    theme.apply(qapp, dark=False, far=True)
    yield
    theme.apply(qapp, dark=False, far=False)


def test_rows_are_not_indented_once_there_is_no_room_for_pictures(qtbot, qapp):
    """The look is changed under a page that has shown pictures."""
    page = ConnectPage(Controller())
    qtbot.addWidget(page)
    page._show_lines([CameraLine("C01", "acA2440-20gm", "40010001", "ready", "good", "2448 x 2048")])
    page.resize(1600, 700)
    page.show()
    QCoreApplication.processEvents()
    row = page._rows["40010001"]
    assert row.name.x() > row.picture.width()
    try:
        theme.apply(qapp, dark=False, far=True)
        page.resize(*ROOM)
        QCoreApplication.processEvents()
        assert row.name.x() < row.picture.width()
    finally:
        theme.apply(qapp, dark=False, far=False)


@pytest.mark.parametrize("count", [6, 16])
@pytest.mark.parametrize("word", ["ready", "missing: plug it in, then search again"])
def test_connect_from_afar_fits_a_small_screen(qtbot, afar, count, word):
    page = ConnectPage(Controller())
    qtbot.addWidget(page)
    serials = {f"S{i}": f"C{i:02d}" for i in range(1, count + 1)}
    connection: Any = SimpleNamespace(names=serials)
    page.controller.cameras.connection = connection
    lines = [
        CameraLine(name, "acA2440-20gm", f"4001{i:04d}", word, "good", f"4001{i:04d} · 2448 x 2048")
        for i, name in enumerate(serials.values())
    ]
    lines = [
        CameraLine(one.name, one.model, serial, one.word, one.level, one.about)
        for one, serial in zip(lines, serials, strict=True)
    ]
    page._show_lines(lines)
    bars = "B: 120.029, 279.950, 500.032 mm"
    bench = (("Targets", "208 targets, nos. 1-208, 28 mm"), ("Scale from", bars), ("Verified by", bars))
    page._show_bench([BenchRow(title, value) for title, value in bench])
    page.resize(*ROOM)
    page.show()
    for _ in range(5):  # a layout asks for its size again, round after round
        QCoreApplication.processEvents()
    page.controller.cameras.connection = None
    assert page.minimumSizeHint().width() <= ROOM[0]
    for area in page.findChildren(QScrollArea):
        assert area.widget().width() <= area.viewport().width(), "nothing is out of sight to the right"
    buttons = [one for one in page.findChildren(QPushButton) if one.text() == "Which is it?"]
    assert len(buttons) == count
    for card in (page.cameras, page.bench):
        for area in card.findChildren(QScrollArea):
            inner = area.widget()
            assert inner is not None
            boxes = [
                QRect(one.mapTo(inner, QPoint(0, 0)), one.size())
                for one in inner.findChildren(QWidget)
                if isinstance(one, (QLabel, QPushButton)) and one.isVisible()
            ]
            assert len(boxes) > 3
            assert not [(a, b) for i, a in enumerate(boxes) for b in boxes[:i] if a.intersects(b)]


def test_calibrate_from_afar_fits_a_small_screen(qtbot, afar):
    page = CalibratePage(Controller())
    qtbot.addWidget(page)
    for number in range(14):
        page.course.add(Progress(f"stage {number} of a calibration", 0.5, "", 3, 5.2))
    page._draw()
    page.word.setText("Stopping as soon as there is a result")
    page.left.setText("56 % · Taking the ball as one rigid body · about 5 s left · 30 s")
    page.resize(*ROOM)
    page.show()
    page.stop_here.show()
    for _ in range(5):
        QCoreApplication.processEvents()
    assert page.minimumSizeHint().width() <= ROOM[0]
    assert page.minimumSizeHint().height() <= ROOM[1]


@pytest.mark.parametrize("language", ["en", "de", "zh_CN"])
@pytest.mark.parametrize("kind", [VerifyPage, SavePage])
def test_verify_and_save_from_afar_fit_a_small_screen(qtbot, home, afar, kind, language):
    languages.use(language)
    try:
        controller = Controller()
        lines = tuple(f"A{line}-{lay}" for line in range(1, 8) for lay in (1, 2))
        controller.project = Project(home / "p", "simulated:demo", cameras=("C01",), check_poses=lines)
        page = kind(controller)
        qtbot.addWidget(page)
        page.step = Step("verify", "verify")
        page.resize(*ROOM)
        page.show()
        page.refresh()
        if kind is VerifyPage:  # as while the engine says where the bar goes
            for part, shown in ((page.again, False), (page.as_it_lies, True), (page.automatic, True)):
                part.setVisible(shown)
        for _ in range(5):
            QCoreApplication.processEvents()
        assert page.minimumSizeHint().width() <= ROOM[0]
        assert page.minimumSizeHint().height() <= ROOM[1]
    finally:
        languages.use("en")


def test_the_space_bar_never_presses_cancel(qtbot, home):
    """The foot switch sends a space: the button that cancels must not be waiting for it."""
    window = QWidget()
    qtbot.addWidget(window)
    footer = Footer()
    QVBoxLayout(window).addWidget(footer)
    window.show()
    state = resolve(Project(home, "simulated:demo"), Running())
    begin, end = Said("good", "", Button("Calibrate", "calibrate")), Said("none", "", Button("Cancel", "cancel"))
    footer.show_standing(Standing("good", "", "action", begin), state, False)
    assert window.focusWidget() is footer.action
    footer.show_standing(Standing("none", "", "action", end), state, True)
    assert footer.action.isEnabled()
    assert window.focusWidget() is not footer.action
