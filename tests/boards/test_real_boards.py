"""Boards on photographs of others, and what is said where the board that was described is not there."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import spherecal
from benchmarks.simulators.rendered_stickers import paint
from spherecal.base.context import Context, Progress
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_app.cli.main import main
from spherecal_boards.board_images import find_board, spread
from spherecal_boards.board_pattern import BoardPattern, figure
from spherecal_boards.chessboard import find_chessboard, fit_corners
from spherecal_boards.looking import boards_of, look_for_chessboard, look_for_markers
from spherecal_boards.pattern_entry import board_entry, board_pattern
from spherecal_files.json_file import JsonValue


def pattern(text: str) -> BoardPattern:
    return board_pattern(JsonValue(board_entry(text), Path("board")))


def pictures(shared_data: Path, glob: str) -> list[np.ndarray]:
    found = sorted((shared_data / "boards").glob(glob))
    if not found:
        pytest.skip(f"no pictures {glob} in {shared_data / 'boards'}")
    return [np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) for path in found]


def noise_px(grids: list[np.ndarray], pattern: BoardPattern, size: tuple[int, int]) -> float:
    """The rms of OpenCV's own calibration of one camera by these corners."""
    points = np.column_stack([pattern.points_mm, np.zeros(len(pattern.points_mm))]).astype(np.float32)
    corners = [grid.astype(np.float32).reshape(-1, 1, 2) for grid in grids]
    return float(cv2.calibrateCamera([points] * len(grids), corners, size, np.eye(3), np.zeros(5))[0])


# camera -> pictures, those that show the board whole, most rms px. In one of cam02 there is none, in one of cam04 it is
# cut off.
CLOSE = {"cam01": (7, 7, 0.11), "cam02": (7, 6, 0.09), "cam03": (7, 7, 0.11), "cam04": (7, 6, 0.1)}


@pytest.mark.parametrize("camera", CLOSE)
def test_close_boards_with_large_squares(shared_data: Path, camera: str) -> None:
    images, board = (
        pictures(shared_data, f"pose2sim/{camera}_*.jpg"),
        pattern("chessboard,rows=4,columns=7,pitch_mm=60"),
    )
    count, whole, most = CLOSE[camera]
    grids = [grid for image in images if (grid := find_chessboard(image, board)) is not None]
    assert (len(images), len(grids)) == (count, whole)
    assert noise_px(grids, board, images[0].shape[::-1]) < most


def test_boards_held_by_hand(shared_data: Path) -> None:
    images, board = pictures(shared_data, "multidic/202_*.jpg"), pattern("chessboard,rows=14,columns=19,pitch_mm=10")
    grids = [grid for image in images if (grid := find_chessboard(image, board)) is not None]
    assert len(grids) == len(images) == 12
    assert (
        noise_px(grids, board, images[0].shape[::-1]) < 0.47
    )  # paper that is not flat: OpenCV's finder alone has 0.49


def test_a_part_of_a_larger_board_is_no_board(shared_data: Path) -> None:
    """OpenCV's finders see a chessboard of 9 x 6 in one of 19 x 14; which part it is nobody knows."""
    small = pattern("chessboard,rows=6,columns=9,pitch_mm=10")
    for image in pictures(shared_data, "multidic/201_*.jpg")[:3]:
        assert find_chessboard(image, small) is None


def test_a_part_of_a_larger_board_is_no_board_where_it_is_rendered() -> None:
    view = np.array([[3.0, 0.3, 60.0], [-0.3, 3.0, 120.7], [4e-4, -2e-4, 1.0]])
    image = rendered("chessboard,rows=10,columns=14,pitch_mm=20", view, (1200, 900), outside=60, black=30)
    found = cv2.findChessboardCornersSB(image, (9, 6), flags=cv2.CALIB_CB_EXHAUSTIVE)[0]
    assert found and find_chessboard(image, pattern("chessboard,rows=6,columns=9,pitch_mm=20")) is None
    assert find_chessboard(image, pattern("chessboard,rows=10,columns=14,pitch_mm=20")) is not None


def test_what_normalising_needs(shared_data: Path) -> None:
    """Pictures in which only OpenCV's normalising or its older finder sees the board at full size."""
    for image in pictures(shared_data, "ucl/*.jpg"):
        assert find_chessboard(image, pattern("chessboard,rows=6,columns=9,pitch_mm=25")) is not None


def test_corners_are_fitted_nearer_than_opencv_finds_them() -> None:
    """On renders too, whose corners are known: 0.02 px where OpenCV's finder is off by 0.03."""
    text = "chessboard,rows=6,columns=9,pitch_mm=20"
    view = np.array([[3.0, 0.3, 100.4], [-0.3, 3.0, 120.7], [4e-4, -2e-4, 1.0]])
    noise = np.random.default_rng(1).normal(0, 4, (900, 1100))
    image = cv2.GaussianBlur(rendered(text, view, (1100, 900), outside=60, black=30), (0, 0), 1.2)
    image = np.clip(image + noise, 0, 255).astype(np.uint8)
    places = figure(pattern(text)).places_mm(pattern(text).points_mm)
    truth = cv2.perspectiveTransform(places.reshape(-1, 1, 2), view).reshape(6, 9, 2)
    fine = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    theirs = np.asarray(cv2.findChessboardCornersSB(image, (9, 6), flags=fine)[1], dtype=float).reshape(6, 9, 2)
    theirs = min((theirs, theirs[::-1, ::-1]), key=lambda grid: np.abs(grid - truth).max())
    start = truth + np.random.default_rng(2).normal(0, 0.8, truth.shape)
    ours = find_chessboard(image, pattern(text))
    off = [
        np.sqrt(((grid - truth) ** 2).sum(axis=2).mean()) for grid in (ours, fit_corners(image, start, 45.0), theirs)
    ]
    assert max(off[:2]) < min(0.025, 0.8 * off[2])


def rendered(
    text: str, view: np.ndarray, size: tuple[int, int] = (640, 480), outside: int = 128, black: int = 0
) -> np.ndarray:
    """A board as a camera sees it: `view` maps mm of its figure, y down, to px."""
    grey = black + (235 - black) * paint(figure(pattern(text)), 6.0).grey
    to_px = view @ np.array([[1 / 6, 0, 1 / 12], [0, 1 / 6, 1 / 12], [0, 0, 1.0]])  # its pixel edges are at 0
    made = cv2.warpPerspective(grey, to_px, size, flags=cv2.INTER_LINEAR, borderValue=outside)
    return np.clip(np.asarray(made), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("square_px", [15.0, 18.0, 21.0])
def test_a_small_bright_board_in_a_dark_hall(square_px: float) -> None:
    """Normalising the image, as it was done, loses these."""
    text = "chessboard,rows=6,columns=9,pitch_mm=20"
    s = square_px / 20
    view = np.array([[s, 0.1 * s, 700], [-0.1 * s, s, 400], [2e-4, -1e-4, 1.0]])
    board = rendered(text, view, (1920, 1200), outside=12, black=40)
    noise = np.random.default_rng(1).normal(0, 3, board.shape)
    image = np.clip(cv2.GaussianBlur(board, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    assert not cv2.findChessboardCornersSB(image, (9, 6), flags=flags)[0]
    found = find_board(image, pattern(text))
    assert found is not None
    places = figure(pattern(text)).places_mm(pattern(text).points_mm)
    truth = cv2.perspectiveTransform(places.reshape(-1, 1, 2), view).reshape(-1, 2)
    assert np.sqrt(((found.uv - truth) ** 2).sum(axis=1).mean()) < 0.15


@pytest.mark.parametrize("text", [
    "charuco,rows=5,columns=7,pitch_mm=20,marker_mm=15,dictionary=DICT_5X5_100,polarity=light-on-dark",
    "charuco,rows=5,columns=7,pitch_mm=20,marker_mm=15,dictionary=DICT_4X4_250,first_id=60,legacy=true",
    "aprilgrid,rows=4,columns=5,pitch_mm=26,marker_mm=20,first_id=36",
])  # fmt: skip
def test_inverted_boards_and_first_ids(text: str) -> None:
    image = rendered(text, np.array([[3.0, 0.3, 20], [-0.2, 3.0, 30], [2e-4, 1e-4, 1.0]]))
    found = find_board(image, pattern(text))
    assert found is not None
    assert len(found.index) == len(pattern(text).points_mm)
    for change in (
        ("polarity=light-on-dark", "polarity=dark-on-light"),
        ("first_id=60", "first_id=0"),
        ("first_id=36", "first_id=0"),
    ):
        if change[0] in text:
            other = find_board(image, pattern(text.replace(*change)))
            assert other is None or len(other.index) < len(found.index)


LOOKED = {
    "aprilgrid/iphone.png": {"kind": "aprilgrid", "rows": 6, "columns": 11},
    "aprilgrid/TUM_VI.png": {"kind": "aprilgrid", "rows": 6, "columns": 6},
    "charuco_lr/L_Frame_000.jpg": {"kind": "charuco", "columns": 18, "legacy": True, "dictionary": "DICT_4X4_250"},
}


@pytest.mark.parametrize("name", LOOKED)
def test_rows_columns_and_dictionary_are_seen(shared_data: Path, name: str) -> None:
    markers = look_for_markers(pictures(shared_data, name))
    assert markers is not None
    board = next(boards_of(markers))
    assert LOOKED[name].items() <= board.items()


def test_a_chessboard_is_seen(shared_data: Path) -> None:
    assert look_for_chessboard(pictures(shared_data, "multidic/201_0*.jpg")) == (14, 19)


# picture -> board; least share of the corners in the cut picture that is found: those of a tag that is cut are not
GRID = "aprilgrid,rows=6,columns={},pitch_mm=70,marker_mm=54"
CUT = {
    "boards/aprilgrid/TUM_VI.png": (GRID.format(6), 0.55),
    "boards/aprilgrid/EuRoC.png": (GRID.format(6), 0.6),
    "boards/aprilgrid/iphone.png": (GRID.format(11), 0.6),
    "boards/charuco_lr/L_Frame_000.jpg": (
        "charuco,rows=25,columns=18,pitch_mm=5,marker_mm=4,dictionary=DICT_4X4_250,legacy=true", 0.85,
    ),
}  # fmt: skip


def cuts(image: np.ndarray, uv: np.ndarray, parts: tuple[float, ...]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The picture cut on each side so that so much of the board is lost, with the place of its first pixel."""
    low, high = uv.min(axis=0), uv.max(axis=0)
    for part in parts:
        (x, y), (right, bottom) = (low + part * (high - low)).astype(int), (high - part * (high - low)).astype(int)
        for found, first in (
            (image[:, x:], (x, 0)),
            (image[y:], (0, y)),
            (image[:, :right], (0, 0)),
            (image[:bottom], (0, 0)),
        ):
            yield np.ascontiguousarray(found), np.array(first)


@pytest.mark.parametrize("name", CUT)
def test_a_board_cut_by_the_edge_is_used(shared_data: Path, name: str) -> None:
    """What is found in a part of a real picture has the indices and the places that it has in the whole one."""
    text, least = CUT[name]
    (image,) = pictures(shared_data.joinpath(name).parent.parent.parent, name.removeprefix("boards/"))
    whole = find_board(image, pattern(text))
    assert whole is not None
    at = dict(zip(whole.index.tolist(), whole.uv, strict=True))
    for part, first in cuts(image, whole.uv, (0.3, 0.6)):
        found = find_board(part, pattern(text))
        assert found is not None
        inside = ((whole.uv >= first) & (whole.uv < first + part.shape[::-1])).all(axis=1).sum()
        known = [(uv + first, at[i]) for i, uv in zip(found.index.tolist(), found.uv, strict=True) if i in at]
        assert len(known) >= 0.9 * len(found.index) and len(found.index) >= least * inside
        assert np.linalg.norm(np.subtract(*zip(*known, strict=True)), axis=1).max() < 0.05


def test_a_ringed_board_cut_by_the_edge_is_used_where_its_rings_are_seen(shared_data: Path) -> None:
    """Dots of a real picture keep their numbers while the rings are in it, and have none where they cannot be known."""
    path = shared_data / "dotboard" / "CalB-sys2-0001_0.jpeg"
    if not path.is_file():
        pytest.skip(f"no picture at {path}")
    image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
    rings = ((2, 2), (2, 7), (5, 2))
    board = replace(pattern("circles,rows=8,columns=10,pitch_mm=3.5"), rings=rings)
    whole = find_board(image, board)
    assert whole is not None and len(whole.index) >= 72
    at = dict(zip(whole.index.tolist(), whole.uv, strict=True))
    results = []
    for part, first in cuts(image, whole.uv, (0.1, 0.18, 0.5)):
        found = find_board(part, board)
        marks = [at[10 * row + column] - first for row, column in rings]
        margin = min(min(np.concatenate([uv, np.array(part.shape[::-1]) - uv])) for uv in marks)
        results.append((margin, found is not None))
        if found is not None:
            off = [np.linalg.norm(uv + first - at[i]) for i, uv in zip(found.index.tolist(), found.uv, strict=True)]
            assert np.median(off) < 0.05 and max(off) < 5  # those at the new edge are cut themselves
    assert all(seen for margin, seen in results if margin > 100) and any(seen for _, seen in results)
    assert not all(seen for _, seen in results)


# folder, board as described -> what would fit
CHARUCO = "charuco,rows=5,columns=7,pitch_mm=45,marker_mm=34,dictionary=DICT_5X5_100"
WRONG = {
    "legacy": ("plain", f"{CHARUCO},legacy=true", "--board charuco,rows=5,columns=7,dictionary=DICT_5X5_100,"),
    "exchanged": ("plain", CHARUCO.replace("5,columns=7", "7,columns=5"), "--board charuco,rows=5,columns=7,"),
    "squares": ("plain", CHARUCO.replace("5,columns=7", "6,columns=8"), "--board charuco,rows=5,columns=7,"),
    "dictionary": ("plain", CHARUCO.replace("5X5", "6X6"), "markers of DICT_5X5_50"),
    "inverted": ("invert", CHARUCO, "polarity=light-on-dark"),
    "mirrored": ("mirror", CHARUCO, "mirrored"),
    "first id": ("ag36", "aprilgrid,rows=4,columns=6,pitch_mm=55,marker_mm=44", "first_id=36"),
}


@pytest.mark.parametrize("row", WRONG)
def test_what_was_seen_is_said_and_its_line_works(shared_data: Path, row: str, tmp_path: Path) -> None:
    folder, text, said = WRONG[row]
    images = shared_data / "foreign" / "board-not-found" / folder
    if not images.is_dir():
        pytest.skip(f"no {images}")
    spherecal.new_session(tmp_path / "s", images, board=text)
    with pytest.raises(InputError) as refused:
        spherecal.calibrate_session(tmp_path / "s", method="board")
    assert said in refused.value.hint
    if "--board " in refused.value.hint:
        line = refused.value.hint.partition("--board ")[2].partition(" ")[0]
        spherecal.new_session(tmp_path / "t", images, board=line)
        done = spherecal.calibrate_session(tmp_path / "t", method="board")
        assert len(done.rig.cameras) == 2


def test_a_board_by_its_kind_and_the_size_of_a_square(shared_data: Path, tmp_path: Path, capsys) -> None:
    images = shared_data / "foreign" / "board-not-found" / "invert"
    if not images.is_dir():
        pytest.skip(f"no {images}")
    assert main(["session", "new", str(tmp_path / "s"), "--images", str(images), "--board", "charuco,pitch_mm=45"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "the board as its images show it: --board charuco,rows=5,columns=7,dictionary=DICT_5X5_50" in said
    assert "polarity=light-on-dark" in said
    assert main(["calibrate", str(tmp_path / "s"), "-o", str(tmp_path / "r")]) == 0  # auto takes the board
    rig = spherecal.load_rig(tmp_path / "r" / "rig.json")
    assert rig.scale.source == "board"


def test_videos_that_contradict_each_other_are_not_valid_with_residuals_that_are_numbers(
    shared_data: Path, tmp_path: Path, capsys
) -> None:
    """Of points behind a camera there is none: "rms nan px" was printed."""
    videos = shared_data / "foreign" / "video-rates" / "v_fps"
    if not videos.is_dir():
        pytest.skip(f"no videos in {videos}")
    session, result = str(tmp_path / "session"), str(tmp_path / "result")
    assert main(["session", "new", session, "--images", str(videos), "--board", "charuco,pitch_mm=40"]) == 0
    capsys.readouterr()
    assert main(["calibrate", session, "-o", result]) == 3
    said = capsys.readouterr().out
    assert "NOT VALID: 3 of 3 cameras placed, rms 4" in said and "nan" not in said


def test_the_first_twenty_without_a_board_are_the_end(tmp_path: Path) -> None:
    """What was seen and what would fit is said after 20 of 31 images, counted while it looks."""
    text = "chessboard,rows=6,columns=9,pitch_mm=20"
    (tmp_path / "in" / "cam").mkdir(parents=True)
    for number in range(31):
        view = np.array([[2.0, 0.2, 60.0 + number], [-0.1, 2.0, 80.0], [2e-4, 1e-4, 1.0]])
        cv2.imwrite(str(tmp_path / "in" / "cam" / f"{number:03d}.png"), rendered(text, view, outside=200))
    wrong = text.replace("columns=9", "columns=8")
    spherecal.new_session(tmp_path / "s", tmp_path / "in", pattern="{camera}/{placement}.png", board=wrong)
    counted: list[int] = []

    def count(step: Progress) -> None:
        if step.stage == "finding boards" and isinstance(step.detail, Phrase):
            counted.append(step.detail.values["number"])

    with pytest.raises(InputError) as refused:
        spherecal.calibrate_session(tmp_path / "s", method="board", context=Context(on_progress=count))
    assert refused.value.code == "error-board-not-in-first" and "none of 20 of its 31 images" in refused.value.message
    assert counted == list(range(1, 21))
    assert "--board chessboard,rows=6,columns=9,pitch_mm=20" in refused.value.hint


def test_nothing_is_seen_in_noise() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (400, 500), np.uint8)
    assert look_for_markers([noise]) is None
    assert look_for_chessboard([noise]) is None


def test_twenty_of_a_recording_are_spread_over_it() -> None:
    assert spread(6, 20) == [0, 1, 2, 3, 4, 5]
    assert len(set(spread(95, 20))) == 20
    assert (spread(95, 20)[0], spread(95, 20)[-1]) == (0, 94)
    assert spread(1, 20) == [0]


CALISCOPE = """columns = 4
rows = 5
board_height = 11.0
board_width = 8.5
dictionary = "DICT_4X4_50"
units = "inch"
aruco_scale = 0.75
inverted = true
"""


def test_caliscopes_board(tmp_path: Path) -> None:
    (tmp_path / "charuco.toml").write_text(CALISCOPE + "square_size_overide_cm = 5.4\n")
    entry = board_entry(tmp_path / "charuco.toml")
    assert entry == {
        "kind": "charuco", "rows": 4, "columns": 3, "pitch_mm": 54.0, "marker_mm": 40.5, "dictionary": "DICT_4X4_50",
        "polarity": "light-on-dark",
    }  # fmt: skip
    (tmp_path / "charuco.toml").write_text(CALISCOPE)  # not measured: 8.5 inches for four squares
    assert board_entry(tmp_path / "charuco.toml")["pitch_mm"] == pytest.approx(25.4 * 8.5 / 4)
    (tmp_path / "config.toml").write_text(
        f"x = 1\n[charuco]\n{CALISCOPE}square_size_override_cm = 5.0\nlegacy_pattern = true\n"
    )
    old = board_entry(tmp_path / "config.toml")
    assert (old["pitch_mm"], old["legacy"]) == (50.0, True)
    (tmp_path / "other.toml").write_text("title = 'x'\n")
    with pytest.raises(InputError):
        board_entry(tmp_path / "other.toml")
