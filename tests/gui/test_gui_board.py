"""A board in place of the ball, through the wizard: the same bytes as the command line; its dialog and its words."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

import shlex

import spherecal
from benchmarks.studies.boards import BASELINE_MM, render_set
from spherecal_app.cli.main import main
from spherecal_gui.coverage import BOARD_VIEWS, Dots, board_needs
from spherecal_gui.pages.images_dialogs import BoardDialog, ImportDialog
from spherecal_gui.pages.placement_page import PlacementPage
from spherecal_gui.pages.results_page import ResultsPage
from spherecal_gui.presenters.connect_presenter import bench_rows
from spherecal_gui.presenters.placement_presenter import Scene
from spherecal_gui.presenters.step_states import PlacementFacts, placement_says
from spherecal_gui.project_folder import load_project, write_bench
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Status
from tests.gui_walking import begun, settle, status, take

BOARD = "charuco,rows=5,columns=7,pitch_mm=36,marker_mm=27,dictionary=DICT_5X5_100"
ENTRY = {"kind": "charuco", "rows": 5, "columns": 7, "pitch_mm": 36, "marker_mm": 27, "dictionary": "DICT_5X5_100"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of eight rendered images of a board by each of two cameras."""
    folder = tmp_path_factory.mktemp("recorded")
    made = render_set(folder / "images", BOARD, 7, 8, (640, 480))
    spherecal.new_session(folder / "session", made.folder, board=BOARD)
    return folder / "session"


def test_a_board_calibrates_in_the_wizard_as_on_the_command_line(recorded: Path, qtbot, tmp_path: Path) -> None:
    controller = begun(tmp_path / "home", f"replay:{recorded}")
    window = WizardWindow(tmp_path / "home", controller=controller)
    qtbot.addWidget(window)
    try:
        project = controller.project
        assert project is not None and project.by_board and len(project.placements) == 8
        titles = [row.title for row in bench_rows(controller.cameras.connection, project.artefacts)]
        assert titles == ["Board", "Scale from the board's pitch"]
        for name in project.placements:
            take(controller, name)
        window.refresh()
        page = window.pages["placement"]
        assert isinstance(page, PlacementPage)
        assert all(25 < len(seen) <= 35 for one in controller.recording.dots.values() for seen in one.values())
        assert controller.advice.guidance is None and controller.advice.planner.running is None
        assert status(controller, "calibrate") is Status.READY
        assert controller.computation.calibrate()
        settle(controller)
        assert controller.project.calibrated is not None
        assert controller.project.calibrated.verdict in ("valid", "use with care")  # eight small images
        controller.go("results")
        window.refresh()
        rig = controller.result.rig
        baseline = np.linalg.norm(rig["cam1"].centre_mm - rig["cam2"].centre_mm)
        assert abs(baseline - BASELINE_MM) < 0.3  # as in tests/boards/test_boards.py
        shown = window.pages["results"]
        assert isinstance(shown, ResultsPage) and shown.word.text().startswith(("VALID", "USE WITH CARE"))
        line = shlex.split(controller.saving.commands()[0])
        assert line[:2] == ["spherecal", "calibrate"] and line[line.index("--method") + 1] == "board"
        line[line.index("-o") + 1] = str(tmp_path / "again")
        assert main(line[1:]) == 0
        ours, theirs = ((folder / "points.csv").read_bytes() for folder in (project.result_folder, tmp_path / "again"))
        assert ours == theirs
        assert load_project(project.folder).by_board
    finally:
        window.close()
        controller.close_project()


def test_the_dialog_describes_the_board_and_says_what_cannot_be(qtbot, tmp_path: Path) -> None:
    dialog = BoardDialog()
    qtbot.addWidget(dialog)
    assert dialog.entry["kind"] == "charuco" and dialog.begin.isEnabled()
    dialog.marker.setValue(40.0)
    assert not dialog.begin.isEnabled() and "marker_mm" in dialog.problem.text()
    dialog.marker.setValue(22.0)
    dialog.dictionary.setText("DICT_6X6_NONE")
    assert not dialog.begin.isEnabled() and "DICT_6X6_NONE" in dialog.problem.text()
    dialog.kind.setCurrentIndex(dialog.kind.findData("aprilgrid"))
    assert dialog.begin.isEnabled() and dialog.entry["dictionary"] == "DICT_APRILTAG_36h11"
    dialog.kind.setCurrentIndex(dialog.kind.findData("chessboard"))
    assert set(dialog.entry) == {"kind", "rows", "columns", "pitch_mm"} and dialog.marker.isHidden()
    dialog.save_sheet(tmp_path / "board.pdf")  # 12 x 9 squares of 30 mm: too large for A4
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF") and not dialog.problem.text()
    with qtbot.waitSignal(dialog.chosen) as told:
        dialog.begin.click()
    assert told.args == [{"kind": "chessboard", "rows": 6, "columns": 9, "pitch_mm": 30.0}]


def test_images_of_a_board_need_its_kind_and_the_size_of_a_square(qtbot, shared_data: Path, tmp_path: Path) -> None:
    images = shared_data / "foreign" / "board-not-found" / "invert"
    if not images.is_dir():
        pytest.skip(f"no {images}")
    dialog = ImportDialog(images, tmp_path)
    qtbot.addWidget(dialog)
    dialog.shows_board.click()
    (asked,) = dialog.findChildren(BoardDialog)
    assert set(asked.entry) == {"kind", "pitch_mm"} and asked.rows.isHidden() and asked.begin.isEnabled()
    asked.kind.setCurrentIndex(asked.kind.findData("aprilgrid"))
    assert set(asked.entry) == {"kind", "pitch_mm", "marker_mm"}
    asked.kind.setCurrentIndex(asked.kind.findData("circles"))
    assert set(asked.entry) == {"kind", "pitch_mm", "rows", "columns"}
    asked.kind.setCurrentIndex(asked.kind.findData("charuco"))
    asked.looked.setChecked(False)
    assert set(asked.entry) == {"kind", "pitch_mm", "rows", "columns", "marker_mm", "dictionary"}
    asked.looked.setChecked(True)
    asked.pitch.setValue(45.0)
    asked.begin.click()
    with qtbot.waitSignal(dialog.imported, timeout=60_000) as told:
        dialog.start()
    folder, assumed = told.args
    board = json.loads((Path(folder) / "session.json").read_text(encoding="utf-8"))["board"]
    assert (board["rows"], board["columns"], board["polarity"]) == (5, 7, "light-on-dark")
    assert "--board charuco,rows=5,columns=7" in assumed


def test_a_board_begins_a_project_with_live_cameras(qtbot, tmp_path: Path) -> None:
    """On the simulated cameras here: they show no board, and the page says what to do."""
    window = WizardWindow(tmp_path)
    qtbot.addWidget(window)
    try:
        window.new_board_project(ENTRY, "simulated:demo")
        controller = window.controller
        settle(controller)
        controller.recording.confirm_bench()
        settle(controller)
        project = controller.project
        assert project is not None and project.by_board and len(project.placements) == 12
        assert json.loads(Path(project.bench).read_text(encoding="utf-8"))["board"] == ENTRY
        assert write_bench(tmp_path, ENTRY) == Path(project.bench), "one file for one board"
        assert controller.cameras.connection is not None and controller.cameras.connection.plan.target_set is None
    finally:
        window.close()


def test_the_one_sentence_at_a_placement() -> None:
    def said(counts: dict[str, int], still: bool | None = True, as_before: bool = False) -> str:
        return placement_says(PlacementFacts(Scene(counts, still, board=True), as_before=as_before)).text

    assert said({"C1": 0, "C2": 0}) == "Show the board to the cameras"
    assert said({"C1": 6, "C2": 0}, None) == "Checking that the board is still"
    assert said({"C1": 6, "C2": 0}, False) == "Hold the board still"
    assert said({"C1": 6, "C2": 0}, True, True) == "Move the board: elsewhere, and tilted otherwise"
    assert said({"C1": 6, "C2": 0}) == "Ready: press space"
    assert Scene({"C1": 6, "C2": 0}, True, board=True).enough and not Scene({"C1": 6, "C2": 0}, True).enough


def test_what_cameras_still_need_of_a_board() -> None:
    grid = np.stack(np.meshgrid(np.linspace(5, 95, 10), np.linspace(5, 95, 10)), axis=-1).reshape(-1, 2)
    index, point = np.arange(100), np.zeros(100, int)
    whole, part = Dots(index, point, grid, (100, 100)), Dots(index[:4], point[:4], grid[:4], (100, 100))
    none = Dots(index[:0], point[:0], grid[:0], (100, 100))
    sets = [{"A": whole, "B": part, "C": none, "D": whole if k < 2 else none} for k in range(BOARD_VIEWS)]
    found = {one.camera: (one.need, one.level) for one in board_needs(sets, ["A", "B", "C", "D"])}
    assert found == {
        "A": ("enough", "good"), "B": ("spread", "caution"), "C": ("more", "bad"), "D": ("more", "caution"),
    }  # fmt: skip
