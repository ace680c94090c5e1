"""Boards in images: dots, chessboards and ChArUco boards rendered with a known homography, whole and cut off."""

import cv2
import numpy as np
import pytest

from spherecal_boards.board_images import find_board
from spherecal_boards.board_pattern import BoardKind, BoardPattern
from spherecal_boards.circles import find_circles

SIZE = (1200, 900)
RINGS = ((2, 2), (2, 6), (4, 2))


def pattern(kind: BoardKind = "circles", rows=7, columns=9, **fields) -> BoardPattern:
    given = {
        "light": False, "rings": (), "rows_upward": False, "dot_diameter_mm": None, "marker_mm": None,
        "dictionary": "", "legacy": False,
    }  # fmt: skip
    return BoardPattern(kind, rows, columns, 10.0, **(given | fields))


def homography(turn_deg: float = 8.0, scale: float = 8.0, shift=(600.0, 450.0), tilt=(2e-4, 3e-4)) -> np.ndarray:
    """Board millimetres about (40, 30) to pixels, with some perspective."""
    a = np.deg2rad(turn_deg)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    view = np.diag([scale, scale, 1.0])
    view[2, :2] = np.array(tilt) * scale
    place = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1.0]])
    return place @ view @ turn @ np.array([[1, 0, -40], [0, 1, -30], [0, 0, 1.0]])


def render(h: np.ndarray, inside, times: int = 5) -> np.ndarray:
    """A grey image of a figure on the board: `inside(x, y)` in mm says where it is dark; `times`^2 rays a pixel."""
    width, height = SIZE
    steps = (np.arange(times) + 0.5) / times - 0.5
    u = (np.arange(width)[:, None] + steps).ravel()
    v = (np.arange(height)[:, None] + steps).ravel()
    back = np.linalg.inv(h)
    image = np.empty((height, width), np.uint8)
    for row in range(height):
        uu, vv = np.meshgrid(u, v[row * times : (row + 1) * times])
        p = np.tensordot(back, np.stack([uu, vv, np.ones_like(uu)]), 1)
        dark = inside(p[0] / p[2], p[1] / p[2])
        share = dark.reshape(times, width, times).mean(axis=(0, 2))
        image[row] = np.round(200 - 160 * share)
    noise = np.random.default_rng(0).normal(0, 1.5, image.shape)
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def dots(rows=7, columns=9, rings=RINGS, radius=2.8):
    def inside(x, y):
        column, row = np.rint(x / 10), np.rint(y / 10)
        r = np.hypot(x - 10 * column, y - 10 * row)
        dark = (r < radius) & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        for ring in rings:
            dark &= ~((row == ring[0]) & (column == ring[1]) & (r < 0.35 * radius))
        return dark

    return inside


def truth(h, found, columns=9, radius=2.8) -> np.ndarray:
    """The centres of the images of dots of that radius: of conics, not the images of their centres."""
    row, column = np.divmod(found.index, columns)
    centre = np.column_stack([10.0 * column, 10.0 * row, np.ones(len(row))])
    dual = np.diag([radius**2, radius**2, 0.0]) - centre[:, :, None] * centre[:, None]
    dual = h @ dual @ h.T
    return dual[:, :2, 2] / dual[:, 2:3, 2]


@pytest.fixture(scope="module")
def whole() -> tuple[np.ndarray, np.ndarray]:
    h = homography()
    return h, render(h, dots())


def test_dots_with_rings_are_all_found(whole):
    h, image = whole
    found = find_board(image, pattern(rings=RINGS))
    assert found is not None
    assert found.index.tolist() == list(range(63))
    assert np.sqrt(((found.uv - truth(h, found)) ** 2).mean()) < 0.01
    assert found.diameter == pytest.approx(0.56, abs=0.01)


def test_rings_are_told_from_dots(whole):
    _, image = whole
    circles = find_circles(image, light=False)
    assert len(circles) == 63
    assert circles.ring.sum() == 3


@pytest.mark.parametrize("turn", [90.0, 180.0, 250.0])
def test_rings_tell_the_turn(turn):
    h = homography(turn, scale=7.0)
    found = find_board(render(h, dots(), times=2), pattern(rings=RINGS))
    assert found is not None
    assert np.abs(found.uv - truth(h, found)).max() < 0.1


def test_a_board_running_out_of_the_picture_keeps_its_numbers():
    h = homography(15.0, scale=11.0, shift=(420.0, 380.0))
    found = find_board(render(h, dots(), times=2), pattern(rings=RINGS))
    assert found is not None
    assert 30 < len(found.index) < 63
    assert np.abs(found.uv - truth(h, found)).max() < 0.1
    assert find_board(render(h, dots(rings=()), times=2), pattern()) is None  # without marks nobody can tell


def test_light_dots_and_plain_boards():
    h = homography(-20.0)
    image = 255 - render(h, dots(rings=()), times=2)
    found = find_board(image, pattern(light=True))
    assert found is not None
    assert len(found.index) == 63
    assert np.abs(found.uv - truth(h, found)).max() < 0.1
    assert find_board(image, pattern()) is None  # asked for dark dots
    assert find_board(image, pattern(light=True, rows=6)) is None  # another board


def test_rows_may_count_upward():
    h = homography() @ np.array([[1, 0, 0], [0, -1, 60], [0, 0, 1.0]])
    image = render(h, dots(rings=()), times=2)
    found = find_board(image, pattern(rows_upward=True))
    assert found is not None
    assert np.abs(found.uv - truth(h, found)).max() < 0.1


def test_rings_that_do_not_fit_are_no_board(whole):
    _, image = whole
    assert find_board(image, pattern(rings=((2, 2), (2, 5), (4, 2)))) is None


def test_sixteen_bits_and_low_light(whole):
    h, image = whole
    found = find_board((image.astype(np.uint16) + 40), pattern(rings=RINGS))  # 8 significant bits of 16
    assert found is not None
    assert np.sqrt(((found.uv - truth(h, found)) ** 2).mean()) < 0.01


@pytest.mark.parametrize(("rows", "columns", "turn"), [(6, 9, 5.0), (6, 9, 185.0), (6, 8, 5.0)])
def test_chessboard(rows, columns, turn):
    h = homography(turn, scale=9.0, tilt=(1e-4, 1e-4)) @ np.array([[1, 0, -5], [0, 1, 0], [0, 0, 1.0]])

    def squares(x, y):
        inside = (x > -10) & (x < 10 * columns) & (y > -10) & (y < 10 * rows)
        return inside & ((np.floor(x / 10) + np.floor(y / 10)) % 2 == 0)

    found = find_board(render(h, squares, times=3), pattern("chessboard", rows, columns))
    assert found is not None
    assert np.abs(found.uv - truth(h, found, columns, 0.0)).max() < 0.2


def test_charuco_cut_off():
    asked = pattern("charuco", 6, 8, marker_mm=7.0, dictionary="DICT_5X5_100")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((9, 7), 10.0, 7.0, dictionary)
    drawn = board.generateImage((1800, 1400), marginSize=0, borderBits=1)
    # 20 px a mm, pixel edges at -0.5; the first inner corner is one square in
    to_mm = np.array([[1 / 20, 0, 0.5 / 20 - 10], [0, 1 / 20, 0.5 / 20 - 10], [0, 0, 1]])
    h = homography(10.0, scale=10.0, shift=(520.0, 380.0), tilt=(1e-4, 1e-4))
    image = cv2.warpPerspective(drawn, h @ to_mm, SIZE, flags=cv2.INTER_AREA, borderValue=128)
    found = find_board(np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8), np.uint8), asked)
    assert found is not None
    assert 20 < len(found.index) < 48
    assert np.abs(found.uv - truth(h, found, 8, 0.0)).max() < 0.3


def test_nothing_is_found_in_noise():
    image = np.random.default_rng(1).integers(0, 255, (400, 500), dtype=np.uint8)
    for kind in ("circles", "chessboard"):
        assert find_board(image, pattern(kind, rings=RINGS if kind == "circles" else ())) is None
    assert find_board(np.zeros((400, 500), np.uint8), pattern(rings=RINGS)) is None
