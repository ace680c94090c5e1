"""What is printed on a calibration board: its kind, where its points are, and the figure in black and white."""

from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.targets.marker_set import marker_dictionary
from spherecal_files.session_file import BoardKind, board_grid
from spherecal_files.target_set_file import marker_bits

APRILTAGS = "DICT_APRILTAG_36h11"
KALIBR_BORDER_BITS = 2
_RING = 0.35  # a ring's hole over the dot's radius
_DOT = 0.56  # a printed dot's diameter over the pitch, where none is given
# Half a turn: OpenCV's tags 36h11 are upside down, compared with the bits that AprilTag's authors list
# (row by row from the top left, highest bit first).
_TURNED = 2


@dataclass(frozen=True)
class BoardPattern:
    """A board for images: points in `rows` x `columns` (dots, inner corners, or tags), `pitch_mm` apart.

    `light`: inverted colours; `rings`: (row, column) of dots with a hole; `rows_upward`: rows count from the bottom; of
    markers side, dictionary, first id, `legacy` (ChArUco) and black `border_bits` (AprilGrid; None: 1 or 2).
    """

    kind: BoardKind
    rows: int
    columns: int
    pitch_mm: float
    light: bool
    rings: tuple[tuple[int, int], ...]
    rows_upward: bool
    dot_diameter_mm: float | None
    marker_mm: float | None
    dictionary: str
    legacy: bool
    border_bits: int | None = None
    first_id: int = 0

    @property
    def markers(self) -> int:
        """How many markers the board has, with the ids from `first_id` on; 0 for boards without."""
        if self.kind == "aprilgrid":
            return self.rows * self.columns
        return (self.rows + 1) * (self.columns + 1) // 2 if self.kind == "charuco" else 0

    @property
    def points_mm(self) -> FloatArray:
        """Places (n, 2) mm of its points, in the order of their indices: x along the rows, y along the columns."""
        return board_grid(self.kind, self.rows, self.columns, self.pitch_mm, self.marker_mm)


@dataclass(frozen=True)
class Figure:
    """Rectangles (x, y, width, height) and discs (x, y, diameter) in mm with their grey (0 black), later ones on top.

    y runs down as printed; `origin_mm` is the place of the first point, `upward` whether the board's y runs up from it.
    """

    size_mm: tuple[float, float]
    rectangles: tuple[tuple[float, float, float, float, float], ...]
    discs: tuple[tuple[float, float, float, float], ...]
    origin_mm: tuple[float, float]
    upward: bool

    def places_mm(self, points_mm: FloatArray) -> FloatArray:
        """Where points (n, 2) mm of the board are on the figure, y down."""
        return np.array(self.origin_mm) + points_mm * (1, -1 if self.upward else 1)


def figure(pattern: BoardPattern) -> Figure:
    """The figure of a board, with a white (or dark) edge as wide as its finder needs."""
    if pattern.kind in ("circles", "asymmetric-circles"):
        return _dots(pattern)
    made = {"chessboard": _chessboard, "charuco": _charuco, "aprilgrid": _aprilgrid}[pattern.kind](pattern)
    if not pattern.light:
        return made
    ground = (0.0, 0.0, *made.size_mm, 1.0)
    return replace(made, rectangles=tuple((*r[:4], 1.0 - r[4]) for r in (ground, *made.rectangles)))


def charuco_board(p: BoardPattern) -> cv2.aruco.CharucoBoard:
    """OpenCV's own board; without its inversion, which it does not have."""
    assert p.marker_mm is not None
    ids = np.arange(p.first_id, p.first_id + p.markers)
    size = (p.columns + 1, p.rows + 1)
    board = cv2.aruco.CharucoBoard(size, p.pitch_mm, p.marker_mm, marker_dictionary(p.dictionary), ids)
    board.setLegacyPattern(p.legacy)
    return board


def _dots(p: BoardPattern) -> Figure:
    edge = p.pitch_mm
    places = p.points_mm
    width, height = places.max(axis=0) + 2 * edge
    diameter = p.dot_diameter_mm or _DOT * p.pitch_mm * (2**0.5 if p.kind == "asymmetric-circles" else 1)
    dot, ground = (1.0, 0.0) if p.light else (0.0, 1.0)
    origin = (edge, height - edge if p.rows_upward else edge)
    made = Figure((width, height), ((0, 0, width, height, ground),), (), origin, p.rows_upward)
    rings = {row * p.columns + column for row, column in p.rings}
    discs = []
    for index, (x, y) in enumerate(made.places_mm(places).tolist()):
        discs.append((x, y, diameter, dot))
        if index in rings:
            discs.append((x, y, _RING * diameter, ground))
    return Figure(made.size_mm, made.rectangles, tuple(discs), origin, p.rows_upward)


def _chessboard(p: BoardPattern) -> Figure:
    """Squares with one more in each direction than inner corners; the first one, top left, is black."""
    s = p.pitch_mm
    width, height = (p.columns + 3) * s, (p.rows + 3) * s
    squares = [
        ((column + 1) * s, (row + 1) * s, s, s, 0.0)
        for row, column in product(range(p.rows + 1), range(p.columns + 1))
        if (row + column) % 2 == 0
    ]
    if p.rows_upward:
        squares = [(x, height - y - s, a, b, grey) for x, y, a, b, grey in squares]
    origin = (2 * s, height - 2 * s if p.rows_upward else 2 * s)
    return Figure((width, height), tuple(squares), (), origin, p.rows_upward)


def _charuco(p: BoardPattern) -> Figure:
    """OpenCV's own arrangement of markers; the squares without one are black."""
    assert p.marker_mm is not None
    s, board = p.pitch_mm, charuco_board(p)
    parts: list[tuple[float, float, float, float, float]] = []
    taken = set()
    for marker, corners in zip(np.asarray(board.getIds()).ravel(), board.getObjPoints(), strict=True):
        left, top = np.asarray(corners)[:, :2].min(axis=0).tolist()
        taken.add((round((top - (s - p.marker_mm) / 2) / s), round((left - (s - p.marker_mm) / 2) / s)))
        parts += marker_parts(marker_bits(p.dictionary, int(marker)), s + left, s + top, p.marker_mm)
    squares = [
        ((column + 1) * s, (row + 1) * s, s, s, 0.0)
        for row, column in product(range(p.rows + 1), range(p.columns + 1))
        if (row, column) not in taken
    ]
    return Figure(((p.columns + 3) * s, (p.rows + 3) * s), (*squares, *parts), (), (2 * s, 2 * s), False)


def _aprilgrid(p: BoardPattern) -> Figure:
    """Tags with small squares at their corners, which make every corner one of a chessboard, as Kalibr prints them."""
    assert p.marker_mm is not None
    size, gap = p.marker_mm, p.pitch_mm - p.marker_mm
    width, height = p.columns * p.pitch_mm + 3 * gap, p.rows * p.pitch_mm + 3 * gap
    parts: list[tuple[float, float, float, float, float]] = []
    for row, column in product(range(p.rows), range(p.columns)):
        left, top = 2 * gap + column * p.pitch_mm, 2 * gap + row * p.pitch_mm
        if p.rows_upward:
            top = height - top - size
        marker = p.first_id + row * p.columns + column
        bits = marker_bits(p.dictionary, marker, p.border_bits or KALIBR_BORDER_BITS)
        parts += marker_parts(np.rot90(bits, _TURNED) if p.dictionary == APRILTAGS else bits, left, top, size)
    for row, column in product(range(p.rows + 1), range(p.columns + 1)):
        parts.append((gap + column * p.pitch_mm, gap + row * p.pitch_mm, gap, gap, 0.0))
    origin = (2 * gap, height - 2 * gap if p.rows_upward else 2 * gap)
    return Figure((width, height), tuple(parts), (), origin, p.rows_upward)


def marker_parts(
    bits: FloatArray, left: float, top: float, size: float
) -> list[tuple[float, float, float, float, float]]:
    """A black square with its white cells (`bits` (n,n): 1), joined: x, y, width, height (mm), grey."""
    cell = size / len(bits)
    parts = [(left, top, size, size, 0.0)]
    for row, cells in enumerate(bits):
        edges = np.flatnonzero(np.diff(np.concatenate([[0.0], cells, [0.0]])))
        parts += [
            (left + a * cell, top + row * cell, (b - a) * cell, cell, 1.0)
            for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        ]
    return parts
