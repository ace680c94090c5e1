"""Connect with real drivers: each camera by itself, whatever the others are like; lenses asked last."""

import json
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)
pytest.importorskip("harvesters.core", reason="the packages for cameras cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from spherecal_app.cli.main import main
from spherecal_cameras.camera_network import WireCamera
from spherecal_cameras.camera_settings import CameraProfile, default_profile_path, read_profile
from spherecal_cameras.genicam import discovery
from spherecal_cameras.new_recording import RigCameras, pitch_of_model, pixel_pitch_um
from spherecal_cameras.protocol import CameraInfo, Discovery, FeatureReport, SetupReport
from spherecal_gentl.producer.producer_control import ACCESS_DENIED, ProducerControl, SimulatedCamera
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.connect_page import ConnectPage
from spherecal_gui.presenters.connect_presenter import CameraLine, camera_lines, connect_summary
from spherecal_gui.workflow import Step
from tests.built_producer import built_producer
from tests.gui_walking import pump, settle

SIZE = (320, 240)
NAMES = tuple(f"SIM{i}" for i in range(6))


@pytest.fixture
def control(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[ProducerControl]:
    """Six cameras of the simulated producer, no other driver, a user who has set nothing."""
    built_producer()
    monkeypatch.setattr(discovery, "driver_patterns", lambda _: ())
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("SPHERECAL_DRIVERS", str(tmp_path / "drivers.json"))
    with ProducerControl([SimulatedCamera(name, *SIZE) for name in NAMES]) as steering:
        for key, value in steering.environment.items():
            monkeypatch.setenv(key, value)
        yield steering


@pytest.fixture
def connect(qtbot: Any, home: Path, control: ProducerControl) -> Iterator[Any]:
    """The page of a new project with these cameras; `search` connects."""
    controller = Controller()
    page = ConnectPage(controller)
    qtbot.addWidget(page)

    def search() -> None:
        if controller.project is None:
            controller.new_project("genicam", home)
        else:
            controller.cameras.connect_all()
        settle(controller)
        page.enter(Step("connect", "connect"))
        page.show()

    yield SimpleNamespace(page=page, controller=controller, search=search)
    controller.close_project()


def _pictures(page: ConnectPage) -> int:
    page.tick()
    return sum(one.image is not None for one in page.pictures())


def test_six_cameras_show_six_pictures_and_no_lens_is_asked_for(connect: Any) -> None:
    connect.search()
    assert not connect.controller.project.failures
    pump(lambda: _pictures(connect.page) == 6)
    assert "6 of 6" in connect.page.summary.text()
    entries = [camera.entry for camera in connect.controller.cameras.connection.cameras]
    assert all(entry["prior"]["assumed"] == ["focal_length"] for entry in entries)


def test_one_that_is_held_hinders_nobody_and_joins_when_it_is_let_go(connect: Any, control: ProducerControl) -> None:
    control.set("SIM2", open_error=ACCESS_DENIED)
    connect.search()
    pump(lambda: _pictures(connect.page) == 5)
    row = connect.page._rows["SIM2"]
    assert row.line.level == "bad" and "Another program" in row.word.text()
    assert "SIM2" not in connect.controller.cameras.connection.names
    control.clear_faults("SIM2")
    pump(lambda: _pictures(connect.page) == 6)
    assert "SIM2" in connect.controller.cameras.connection.names


def test_a_driver_whose_texts_are_not_utf8_shows_its_cameras_too(
    connect: Any, control: ProducerControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPHERECAL_GENTL_ODD", "texts=c4e3bad3")  # GBK
    control.set("SIM5", open_error=ACCESS_DENIED)
    connect.search()
    pump(lambda: _pictures(connect.page) == 5)
    levels = {name: row.line.level for name, row in connect.page._rows.items()}
    assert levels["SIM5"] == "bad" and "bad" not in {levels[name] for name in NAMES[:5]}


def test_whoever_is_left_out_stays_out(connect: Any, control: ProducerControl) -> None:
    control.set("SIM4", open_error=ACCESS_DENIED)
    connect.search()
    box = connect.page._rows["SIM4"].in_rig
    QTest.mouseClick(box, Qt.MouseButton.LeftButton)
    settle(connect.controller)
    connect.page.refresh()
    assert read_profile(default_profile_path()).entry("SIM4").in_rig is False
    assert connect.page._rows["SIM4"].line.level == "none"
    pump(lambda: "5 of 5" in (connect.page.refresh() or connect.page.summary.text()))
    connect.search()
    assert "SIM4" not in connect.controller.cameras.connection.source.statuses(), "it is not even opened"
    assert control.open_by("SIM4") is None


def test_the_lens_of_all_is_stated_in_one_line(connect: Any) -> None:
    connect.search()
    bar = connect.page.lenses
    bar.focal.setCurrentIndex(bar.focal.findData(12.5))
    bar.pitch.setValue(3.45)
    bar.focal.activated.emit(bar.focal.currentIndex())
    settle(connect.controller)
    entries = [camera.entry for camera in connect.controller.cameras.connection.cameras]
    assert {(one["focal_length_mm"], one["pixel_pitch_um"]) for one in entries} == {(12.5, 3.45)}
    assert not any("prior" in one for one in entries)
    pump(lambda: _pictures(connect.page) == 6)


def test_capture_takes_the_good_ones_and_names_the_bad_one(
    control: ProducerControl, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["targets", "export", "-o", str(tmp_path / "t.json")]) == 0
    control.set("SIM1", open_error=ACCESS_DENIED)
    line = ["cameras", "capture", "--targets", str(tmp_path / "t.json"), "--no-wait", "--placements", "1", "--json"]
    capsys.readouterr()
    assert main([*line, "-o", str(tmp_path / "a")]) == 3, "one of the rig is missing"
    said = json.loads(capsys.readouterr().out)
    assert said["cameras"] == [name for name in NAMES if name != "SIM1"]
    assert "SIM1" in said["without"] and said["sets"][0]["missing"] == []
    assert main(["cameras", "set", "SIM1", "--in-rig", "no", "--offline"]) == 0
    capsys.readouterr()
    assert main([*line, "-o", str(tmp_path / "b")]) == 0, "left out, it hinders nobody"
    assert json.loads((tmp_path / "b" / "session.json").read_text())["cameras"][0]["prior"]["assumed"]


# --- rows ------------------------------------------------------------------------------------------------------------


def _wire(serial: str, **changes: Any) -> WireCamera:
    seen = WireCamera(f"02:{serial}", "192.168.8.20", "255.255.255.0", "Basler", "acA", serial, "", "eth1", True, False)
    return replace(seen, **changes)


def test_cameras_that_no_driver_lists_are_rows_with_their_cure() -> None:
    elsewhere, near = _wire("S1", subnet_ok=False), _wire("S2", user_name="left")
    first, second = camera_lines(None, (), (elsewhere, near))
    assert first.cured_at == elsewhere and "192.168.8.20 is in another subnet" in first.word
    assert second.name == "left" and "install pylon" in second.word and second.cured_at is None
    assert not second.builtin and camera_lines(None, (), (near,), builtin=True)[0].builtin


def test_a_listed_camera_in_another_subnet_offers_an_address() -> None:
    info, seen = CameraInfo("S1", "acA", "Basler", "a.cti"), _wire("S1", subnet_ok=False)
    source = SimpleNamespace(statuses=dict, kind="genicam")
    connection: Any = SimpleNamespace(
        names={},
        source=source,
        discovery=Discovery((info,)),
        reports=(),
        profile=CameraProfile(),
        rig=RigCameras((), {"S1": "left"}, {"S1": ValueError()}),  # type: ignore[dict-item]
        wire=(seen,),
    )
    (line,) = camera_lines(connection, (), (seen,))
    assert (line.name, line.cured_at, line.level) == ("left", seen, "bad")
    assert connect_summary([line], False, "")[1] == "bad"
    said = connect_summary([line], False, "No camera was found. Plug the cameras in.")
    assert said == ("Cameras that answer, but cannot be used yet: 1", "bad")


@pytest.mark.parametrize(
    ("model", "pitch"),
    [
        ("acA2440-20gm", 3.45),
        ("acA1920-40gc", 5.86),
        ("Blackfly S BFS-U3-31S4M", 3.45),
        ("Mako G-319B", 3.45),
        ("MV-CA050-10GM", 3.45),
        ("Fake", None),
    ],
)
def test_the_pixel_pitch_is_the_cameras_own_else_its_data_sheets(model: str, pitch: float | None) -> None:
    assert pitch_of_model(model) == pitch
    info = CameraInfo("S1", model, "", "a.cti")
    assert pixel_pitch_um(info, None) == pitch
    said = SetupReport("S1", (FeatureReport("pixel pitch", "SensorPixelWidth", got="2.74"),))
    assert pixel_pitch_um(info, said) == 2.74


def test_a_camera_that_no_driver_lists_hinders_nobody() -> None:
    """As a code reader on the same network: it has its row, and the rig is ready without it."""
    usable = CameraLine("C01", "Viky", "0", "ready", "good", "0 · 800 × 800", listed=True)
    reader = CameraLine("GV01", "Aravis Fake", "GV01", "It answers.", "bad", "GV01 · 192.168.77.11")
    assert connect_summary([usable, reader], False, "") == ("1 of 1 cameras ready", "good")
    missing = CameraLine("C02", "", "", "Not found.", "bad")
    assert connect_summary([usable, reader, missing], False, "")[0] == "1 of 2 cameras ready, without C02"
