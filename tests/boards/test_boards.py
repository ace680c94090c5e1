"""Boards of every kind: rendered as they are printed, found again, printed to measure; calibrated beside OpenCV."""

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.simulators.rendered_stickers import BoardCamera, render_board
from spherecal.base.errors import InputError
from spherecal.geometry.camera import intrinsics_vector, project
from spherecal.geometry.rotation import exp_rotation
from spherecal.targets.marker_set import marker_dictionary
from spherecal_app.cli.main import main
from spherecal_boards.board_images import find_board, spread
from spherecal_boards.board_pattern import BoardPattern, figure
from spherecal_boards.pattern_entry import board_entry, board_pattern
from spherecal_documents.sheets.board_sheet import BOARD_PAGES_MM, words, write_board_sheet
from spherecal_files.json_file import JsonValue

CAMERA = BoardCamera(
    intrinsics_vector(np.array([[900.0, 0, 322], [0, 905, 236], [0, 0, 1]]), [-0.15, 0.05, 0.0005, -0.0003, 0]),
    (640, 480),
)
BOARDS = {
    "circles": "circles,rows=7,columns=9,pitch_mm=20,rings=2:2+2:6+4:2",
    "plain circles": "circles,rows=7,columns=9,pitch_mm=20,rows_upward=true",
    "light circles": "circles,rows=7,columns=9,pitch_mm=20,polarity=light-on-dark",
    "asymmetric-circles": "asymmetric-circles,rows=11,columns=4,pitch_mm=14",
    "chessboard": "chessboard,rows=6,columns=9,pitch_mm=20",
    "charuco": "charuco,rows=6,columns=8,pitch_mm=20,marker_mm=15,dictionary=DICT_5X5_100",
    "old charuco": "charuco,rows=5,columns=8,pitch_mm=20,marker_mm=15,dictionary=DICT_4X4_50,legacy=true",
    "aprilgrid": "aprilgrid,rows=4,columns=5,pitch_mm=39,marker_mm=30",
    "aprilgrid down": "aprilgrid,rows=4,columns=5,pitch_mm=39,marker_mm=30,rows_upward=false,border_bits=1",
    "aruco grid": "aprilgrid,rows=4,columns=5,pitch_mm=36,marker_mm=30,dictionary=DICT_6X6_250,border_bits=1",
}


def pattern(text: str) -> BoardPattern:
    return board_pattern(JsonValue(board_entry(text), Path("board")))


def seen(board: BoardPattern, turn: float = 10.0, distance: float = 1.0, tilt=(0.3, -0.25), shift=(0.0, 0.0)):
    """An image of the board filling most of it, and where its points are in it."""
    drawn = figure(board)
    rotation = exp_rotation(np.array([*tilt, 0.0])) @ exp_rotation(np.array([0, 0, np.deg2rad(turn)]))
    away = distance * 1.25 * 900 * max(drawn.size_mm[0] / 640, drawn.size_mm[1] / 480)
    middle = np.array([*drawn.size_mm, 0.0]) / 2
    translation = np.array([*shift, away]) - rotation @ middle
    image = render_board(drawn, CAMERA, rotation, translation, np.random.default_rng(3))
    places = drawn.places_mm(board.points_mm)
    points = np.column_stack([places, np.zeros(len(places))])
    return image, project(points @ rotation.T + translation, CAMERA.intrinsics)


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("turn", [8.0, -20.0])
def test_what_is_printed_is_found(name: str, turn: float) -> None:
    board = pattern(BOARDS[name])
    image, truth = seen(board, turn)
    found = find_board(image, board)
    assert found is not None
    assert len(found.index) == len(board.points_mm) == len(truth)
    off = np.linalg.norm(found.uv - truth[found.index], axis=1)
    # dots are found as centres of ellipses, 0.06 px off the images of their centres here
    assert np.sqrt((off**2).mean()) < 0.1, off.max()


@pytest.mark.parametrize("turn", [95.0, 182.0, 265.0])
@pytest.mark.parametrize("name", ["asymmetric-circles", "charuco", "aprilgrid", "aruco grid"])
def test_these_tell_their_turn(name: str, turn: float) -> None:
    board = pattern(BOARDS[name])
    image, truth = seen(board, turn, distance=1.5)
    found = find_board(image, board)
    assert found is not None and len(found.index) > 0.7 * len(truth)
    assert np.linalg.norm(found.uv - truth[found.index], axis=1).max() < 1.0


def test_tags_beyond_the_border_are_left_out() -> None:
    board = pattern(BOARDS["aprilgrid"])
    image, truth = seen(board, distance=0.7, shift=(40.0, 20.0))
    found = find_board(image, board)
    inside = ((truth > 2) & (truth < np.array([637, 477]))).all(axis=1)
    assert found is not None and 8 <= len(found.index) <= inside.sum() < len(truth)
    assert np.linalg.norm(found.uv - truth[found.index], axis=1).max() < 0.5


def test_another_board_is_not_found() -> None:
    image, _ = seen(pattern(BOARDS["aprilgrid"]))
    for other in (
        BOARDS["aprilgrid down"].removesuffix(",border_bits=1"),
        "aprilgrid,rows=4,columns=6,pitch_mm=39,marker_mm=30",
    ):
        found = find_board(image, pattern(other))
        assert found is None
    assert find_board(image, pattern(BOARDS["asymmetric-circles"])) is None
    wrong, _ = seen(pattern("asymmetric-circles,rows=9,columns=4,pitch_mm=14"))
    assert find_board(wrong, pattern(BOARDS["asymmetric-circles"])) is None


def test_a_mirrored_board_is_not_found() -> None:
    for name in ("aprilgrid", "aruco grid", "charuco"):
        board = pattern(BOARDS[name])
        image, _ = seen(board)
        assert find_board(np.ascontiguousarray(image[:, ::-1]), board) is None, name


def test_printed_tags_have_the_bits_that_april_tags_authors_list() -> None:
    """Tag 0 of 36h11 is 0xd5d628584, its 36 bits row by row from the top left, highest first, 1 white."""
    board = pattern("aprilgrid,rows=2,columns=2,pitch_mm=26,marker_mm=20")
    drawn = figure(board)
    bits = [int(bit) for bit in f"{0xD5D628584:036b}"]
    # tag 0 is the lowest on the left (Kalibr's order); 10 cells of 2 mm, two of them border
    left, bottom = drawn.origin_mm
    white = np.zeros((6, 6))
    for x, y, width, _, grey in drawn.rectangles:
        column, row = (x - left) / 2 - 2, (y - (bottom - 20)) / 2 - 2
        if grey == 1 and -0.1 < column < 6 and -0.1 < row < 6:
            white[round(row), round(column) : round(column + width / 2)] = 1
    assert white.ravel().tolist() == bits


def test_a_charuco_board_is_opencvs_own() -> None:
    from benchmarks.simulators.rendered_stickers import paint

    for name in ("charuco", "old charuco"):
        board = pattern(BOARDS[name])
        assert board.marker_mm is not None
        opencv = cv2.aruco.CharucoBoard(
            (board.columns + 1, board.rows + 1), board.pitch_mm, board.marker_mm, marker_dictionary(board.dictionary)
        )
        opencv.setLegacyPattern(board.legacy)
        theirs = opencv.generateImage((560 // 7 * (board.columns + 1), 80 * (board.rows + 1)), marginSize=0)
        ours = paint(figure(board), 4.0).grey[80:-80, 80:-80]
        assert ours.shape == theirs.shape and np.abs(ours * 255 - theirs).mean() < 6


# --- the description -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BOARDS)
def test_a_board_in_words_is_the_same_board(name: str) -> None:
    board = pattern(BOARDS[name])
    said = words(board)
    assert pattern(said) == board or board.border_bits == 1


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("asymmetric-circles,rows=10,columns=4,pitch_mm=14", "must be odd"),
        ("aprilgrid,rows=4,columns=4,pitch_mm=30,marker_mm=30", "must be smaller than pitch_mm"),
        ("aprilgrid,rows=30,columns=30,pitch_mm=30,marker_mm=20", "need 900 tags, but DICT_APRILTAG_36h11 has 587"),
        ("aprilgrid,rows=4,columns=4,pitch_mm=30", 'lacks "marker_mm"'),
        ("chessboard,rows=six,columns=4,pitch_mm=30", "must be a number"),
        ("chessboard;rows=6", "must be"),
        ("chessboard,rows 6", "cannot be read"),
    ],
)
def test_boards_that_cannot_be(text: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        board_entry(text)


@pytest.mark.parametrize("name", BOARDS)
def test_boards_are_printed(name: str, tmp_path: Path) -> None:
    from tests.documents.test_targets_sheet import MM_PER_POINT, circles, pages

    board = pattern(BOARDS[name])
    assert main(["targets", "sheet", "--board", BOARDS[name], "--page", "A3", "-o", str(tmp_path / "board.pdf")]) == 0
    (page,) = pages(tmp_path / "board.pdf")
    data = (tmp_path / "board.pdf").read_bytes()
    height = float(data.split(b"/MediaBox [")[1].split(b"]")[0].split()[3]) * MM_PER_POINT
    drawn = figure(board)
    if drawn.discs:
        np.testing.assert_allclose(
            circles(page, height), [[20 + x, 8 + y, d] for x, y, d, _ in drawn.discs], atol=0.005
        )
    assert page.count(" re") >= len(drawn.rectangles)


@pytest.mark.parametrize("size", ["rows=9,columns=12", "rows=2,columns=12", "rows=12,columns=2"])
def test_a_board_that_is_too_large_is_refused(size: str, tmp_path: Path, capsys) -> None:
    """In both directions, or only in one: neither way round may it run off the page."""
    line = ["targets", "sheet", "--board", f"chessboard,{size},pitch_mm=30", "-o", str(tmp_path / "b.pdf")]
    assert main(line) == 2
    assert "does not fit on a page of A4" in capsys.readouterr().err and not (tmp_path / "b.pdf").exists()


@settings(max_examples=50)
@given(st.integers(2, 20), st.integers(2, 20), st.floats(5, 60), st.sampled_from(["A4", "Letter", "A3"]))
def test_all_of_a_board_is_on_its_page(rows: int, columns: int, pitch_mm: float, page: str) -> None:
    """Every rectangle and the rulers; a page is turned only where the board needs it."""
    board = pattern(f"chessboard,rows={rows},columns={columns},pitch_mm={pitch_mm:.3f}")
    across, down = figure(board).size_mm
    from tests.documents.test_targets_sheet import pages

    with TemporaryDirectory() as folder:
        file = Path(folder, "board.pdf")
        try:
            write_board_sheet(file, board, page)
        except InputError:
            short, long = BOARD_PAGES_MM[page]
            assert not (across < short - 28 and down < long - 40) and not (across < long - 28 and down < short - 40)
            return
        data, (drawn,) = file.read_bytes(), pages(file)
    width, height = (float(x) for x in data.split(b"/MediaBox [")[1].split(b"]")[0].split()[2:])
    found = re.findall(r"([-\d.]+) ([-\d.]+) ([-\d.]+) ([-\d.]+) re", drawn)
    boxes = np.array(found, dtype=float)
    assert len(boxes) >= rows * columns // 2
    low, high = (
        np.minimum(boxes[:, :2], boxes[:, :2] + boxes[:, 2:]),
        np.maximum(boxes[:, :2], boxes[:, :2] + boxes[:, 2:]),
    )
    assert (low > 0).all() and (high < [width, height]).all()


# --- calibration beside OpenCV ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "charuco,rows=5,columns=7,pitch_mm=36,marker_mm=27,dictionary=DICT_5X5_100",
        "aprilgrid,rows=4,columns=4,pitch_mm=65,marker_mm=50",
    ],
    ids=["charuco", "aprilgrid"],
)
def test_a_board_calibrates_as_well_as_opencv_does(text: str, tmp_path: Path) -> None:
    """A small set of the study (benchmarks/studies/boards.md), from a folder of images, by the example program."""
    import spherecal
    from benchmarks.studies.boards import BASELINE_MM, opencv, render_set
    from tests.app.test_examples import run

    made = render_set(tmp_path / "images", text, 7, 8, (640, 480))
    said = run("board_on_the_wall", made.folder, tmp_path / "session", tmp_path / "result", text)
    assert said.startswith("<Rig: 2 cameras (cam1, cam2), ") and "scale: board" in said
    rig, theirs = spherecal.load_rig(tmp_path / "result"), opencv(made)
    assert rig.quality.valid and rig.quality.rms_px is not None and rig.quality.rms_px < 0.15
    baseline = np.linalg.norm(rig["cam1"].centre_mm - rig["cam2"].centre_mm)
    # seeds 1 to 7: ours within 0.15 mm, OpenCV's within 0.27 mm
    assert abs(baseline - BASELINE_MM) < 0.3 and abs(theirs.baseline_mm - BASELINE_MM) < 0.5
    for camera, true in zip(rig, made.cameras, strict=True):
        assert abs(camera.K[0, 0] / true.intrinsics[0] - 1) < 0.004


def test_a_board_that_lacks_something_is_no_file(capsys: pytest.CaptureFixture[str]) -> None:
    board = "charuco,rows=6,columns=9,pitch_mm=20,marker_mm=15"
    assert main(["targets", "sheet", "--board", board, "-o", "board.pdf"]) == 2
    assert capsys.readouterr().err.startswith('spherecal: --board: board lacks "dictionary".')


def test_some_of_many_images_are_spread_from_first_to_last_and_none_is_taken_twice() -> None:
    assert [spread(*case) for case in ((10, 4), (3, 8), (1, 4), (0, 4))] == [[0, 3, 6, 9], [0, 1, 2], [0], []]
