"""Connect where no camera is found: the reason, what to do on this system, the makers' drivers."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)
pytest.importorskip("harvesters.core", reason="the packages for cameras cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel, QPushButton

from spherecal.data.findings import Finding
from spherecal_cameras import camera_network
from spherecal_cameras.builtin_driver import BuiltinDriver, DriverTrouble
from spherecal_cameras.camera_network import InterfaceFact
from spherecal_cameras.genicam import discovery
from spherecal_cameras.genicam.trust import TrustStore
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.connect_dialogs import DriversPanel, MakersDialog
from spherecal_gui.pages.connect_page import ConnectPage
from spherecal_gui.presenters.drivers_presenter import driver_notes, makers_rows, network_notes
from spherecal_gui.workflow import Step
from tests.gui_walking import settle


def words(note):
    return " ".join((note.title, *note.steps))


@pytest.mark.parametrize(
    ("trouble", "linux", "windows"),
    [
        (DriverTrouble("no-driver", makers=("Basler AG",)), "then search again", "64-bit"),
        (DriverTrouble("no-cameras", "/opt/a.cti"), "udev", "firewall"),
    ],
)
def test_each_reason_says_what_to_do_on_each_system(trouble, linux, windows):
    for system, said, other in (("linux", linux, windows), ("win32", windows, linux)):
        (note,) = driver_notes([trouble], system)
        assert said in words(note) and other not in words(note)


def test_drivers_without_cameras_share_a_note_and_a_refused_one_can_be_allowed():
    many = [DriverTrouble("no-cameras", "/opt/a.cti"), DriverTrouble("no-cameras", "/opt/b.cti")]
    (note,) = driver_notes(many)
    assert "a.cti, b.cti" in note.title
    (refused,) = driver_notes([DriverTrouble("not-allowed", "/opt/a.cti")])
    assert refused.allow == "/opt/a.cti" and "a.cti" in refused.title
    (broken,) = driver_notes([DriverTrouble("not-loaded", "/opt/a.cti", "The file is empty.")])
    assert not broken.allow and broken.details == "The file is empty."


def test_the_panel_allows_with_a_click(qtbot):
    panel = DriversPanel()
    qtbot.addWidget(panel)
    allowed = []
    panel.allowed.connect(allowed.append)
    panel.show_notes(driver_notes([DriverTrouble("not-allowed", "/opt/a.cti"), DriverTrouble("no-driver")]))
    button = next(one for one in panel.findChildren(QPushButton) if one.property("key") == "allow-driver")
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)
    assert allowed == ["/opt/a.cti"]
    panel.show_notes([])
    assert panel.isHidden()


@pytest.mark.parametrize("system", ["linux", "win32", "darwin"])
def test_the_list_of_makers_has_a_driver_and_a_place_for_each(qtbot, system):
    rows = makers_rows(system)
    assert all(all(cells) for cells in rows) and any("Basler" in row[0] for row in rows)
    dialog = MakersDialog()
    qtbot.addWidget(dialog)
    assert dialog.table.rowCount() == len(makers_rows())


@pytest.fixture
def page(qtbot, tmp_path, monkeypatch):
    """The real page over a search with no drivers but those of a folder."""
    monkeypatch.setattr(discovery, "driver_patterns", lambda _: ())
    monkeypatch.setenv("SPHERECAL_DRIVERS", str(tmp_path / "drivers.json"))
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(tmp_path / "cti"))
    (tmp_path / "cti").mkdir()
    controller = Controller()
    made = ConnectPage(controller)
    qtbot.addWidget(made)
    yield SimpleNamespace(page=made, controller=controller, folder=tmp_path)
    controller.close_project()


def shown(page):
    return " ".join(one.text() for one in (page.summary, *page.drivers.findChildren(QLabel)))


def test_without_a_driver_the_page_says_so(page):
    page.controller.new_project("genicam", page.folder)
    settle(page.controller)
    page.page.enter(Step("connect", "connect"))
    assert "No camera driver is installed" in shown(page.page) and not page.page.drivers.isHidden()


def test_a_driver_that_is_not_allowed_is_allowed_on_the_page(page):
    file = page.folder / "cti" / "maker.cti"
    file.write_bytes(b"no library")
    page.controller.cameras.somebody_answers = True
    page.controller.cameras.driver_asked.connect(lambda question: question.answer(False))
    page.controller.new_project("genicam", page.folder)
    settle(page.controller)
    page.page.enter(Step("connect", "connect"))
    assert "maker.cti is not allowed" in shown(page.page)
    page.controller.cameras.allow_driver(str(file))
    settle(page.controller)
    page.page.refresh()
    assert TrustStore().look(str(file)).state == "known"
    assert "maker.cti does not work" in shown(page.page), "allowed, but no library"
    assert Path(file).is_file()


def test_what_is_wrong_with_the_network_has_its_command_and_a_firewall_is_named_only_in_trouble(qtbot, monkeypatch):
    values = {"interface": "eth1", "mtu": 1500, "command": "sudo ip link set eth1 mtu 9000"}
    large = Finding("packets-too-large", "warning", values, ("S1",))
    card = InterfaceFact("mtu", "eth1", "1500", large, values["command"])
    on = Finding("firewall-on", "info", values | {"firewall": "ufw"})
    wall = InterfaceFact("firewall", "eth1", "ufw", on, "sudo ufw x")
    well = InterfaceFact("speed", "eth1", "1000 Mbit/s")
    elsewhere = InterfaceFact("addresses", "eth1", "", Finding("other-subnet", "error", {}, ("S2",)), "sudo ip x")
    monkeypatch.setattr(camera_network, "can_apply", bool)
    (note,) = network_notes((card, wall, well, elsewhere), all_well=True)
    assert note.cure == values["command"] and values["command"] in words(note) and note.level == "caution"
    assert [one.cure for one in network_notes((card, wall), all_well=False)] == [card.cure, wall.cure]
    panel = DriversPanel(of_drivers=False)
    qtbot.addWidget(panel)
    cured = []
    panel.cured.connect(cured.append)
    panel.show_notes([note])
    (do_it,) = (one for one in panel.findChildren(QPushButton) if one.property("key") == "apply-cure")
    QTest.mouseClick(do_it, Qt.MouseButton.LeftButton)
    assert cured == [card.cure] and not panel.makers.isVisible()
    monkeypatch.setattr(camera_network, "can_apply", lambda _: False)
    (note,) = network_notes((card,), all_well=True)
    assert not note.cure and values["command"] in words(note), "the line to paste"


def test_a_driver_of_other_cameras_names_the_makers_package_and_offers_the_built_in_one():
    trouble = DriverTrouble("wrong-driver", "/opt/a.cti", makers=("Basler",))
    (note,) = driver_notes([trouble], "linux", BuiltinDriver("can-be-built"))
    assert note.builtin and "a.cti" in note.title and "pylon" in words(note) and "light" not in words(note)
    (note,) = driver_notes([trouble], "linux", BuiltinDriver("lacking", lacks=("compiler",), install="apt install g++"))
    assert not note.builtin and "apt install g++" in words(note)
    own = DriverTrouble("wrong-driver", "/x/spherecal_aravis.cti")
    (note,) = driver_notes([own], "linux", BuiltinDriver("installed"))
    assert not note.builtin, "it is the one that does not reach them"
