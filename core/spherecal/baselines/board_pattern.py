"""What is printed on a board, as the `board` section of session.json tells it (docs/board.md)."""

from dataclasses import dataclass
from typing import Literal

import cv2

from spherecal.errors import InputError
from spherecal.session.json_file import JsonValue, read_json
from spherecal.session.model import Session
from spherecal.session.read_session import FORMAT, SESSION_FILE, VERSION

Kind = Literal["circles", "chessboard", "charuco"]
_FIELDS = (
    "kind", "rows", "columns", "pitch_mm", "polarity", "rings", "rows_upward", "dot_diameter_mm", "marker_mm",
    "dictionary", "legacy", "relative_uncertainty", "points", "shape",
)  # fmt: skip
_WORST_RELATIVE_UNCERTAINTY = 0.05


@dataclass(frozen=True)
class BoardPattern:
    """A board for images: points in `rows` x `columns` (dots, or inner corners), `pitch_mm` apart.

    `light` says light dots on a dark ground, `rings` the (row, column) of dots with a hole, `rows_upward` that rows
    count from the bottom. `marker_mm`, `dictionary` and `legacy` describe a ChArUco board.
    """

    kind: Kind
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


def read_board_pattern(session: Session) -> BoardPattern:
    """The pattern of a session's board; InputError where images need one and session.json does not describe it."""
    board = _board(session)
    if board is None:
        raise InputError(f"{session.where}: describes no board.", 'Add "board" to session.json, see docs/board.md.')
    f = board.fields(("kind",), [name for name in _FIELDS if name != "kind"])
    kind: Kind = f["kind"].choice("circles", "chessboard", "charuco")
    if "points" in f:
        raise f["points"].error("cannot be found in images", 'Give "rows", "columns" and "pitch_mm" instead.')
    f |= board.fields(("rows", "columns", "pitch_mm", *(("marker_mm", "dictionary") if kind == "charuco" else ())))
    rows, columns, pitch = f["rows"].integer(2, 1000), f["columns"].integer(2, 1000), f["pitch_mm"].positive("mm")
    diameter = f["dot_diameter_mm"].positive("mm") if "dot_diameter_mm" in f else None
    if diameter is not None and diameter >= pitch:
        raise f["dot_diameter_mm"].error("must be smaller than pitch_mm")
    return BoardPattern(
        kind, rows, columns, pitch,
        light="polarity" in f and f["polarity"].choice("dark-on-light", "light-on-dark") == "light-on-dark",
        rings=tuple(_ring(value, rows, columns) for value in f["rings"].items()) if "rings" in f else (),
        rows_upward="rows_upward" in f and f["rows_upward"].boolean(),
        dot_diameter_mm=diameter,
        marker_mm=_marker(f["marker_mm"], pitch) if "marker_mm" in f else None,
        dictionary=_dictionary(f["dictionary"]) if "dictionary" in f else "",
        legacy="legacy" in f and f["legacy"].boolean(),
    )  # fmt: skip


def board_uncertainty(session: Session) -> float | None:
    """The board's own relative standard uncertainty (of its pitch), where session.json states one."""
    board = _board(session)
    f = board.fields((), ("relative_uncertainty",)) if board is not None else {}
    return f["relative_uncertainty"].number(0, _WORST_RELATIVE_UNCERTAINTY) if f else None


def shape_estimated(session: Session) -> bool:
    """Whether the board's points are to be estimated."""
    board = _board(session)
    f = board.fields((), ("shape",)) if board is not None else {}
    return bool(f) and f["shape"].choice("nominal", "estimated") == "estimated"


def _board(session: Session) -> JsonValue | None:
    path = session.folder / SESSION_FILE
    if not path.is_file():
        return None
    return read_json(path, FORMAT, VERSION).fields((), ("board",)).get("board")


def _ring(value: JsonValue, rows: int, columns: int) -> tuple[int, int]:
    row, column = value.items(2)
    return row.integer(0, rows - 1), column.integer(0, columns - 1)


def _marker(value: JsonValue, pitch: float) -> float:
    marker = value.positive("mm")
    if marker >= pitch:
        raise value.error("must be smaller than pitch_mm, the side of a square")
    return marker


def _dictionary(value: JsonValue) -> str:
    name = value.text()
    if not (name.startswith("DICT_") and hasattr(cv2.aruco, name)):
        raise value.error(f'names no dictionary of OpenCV: "{name}"', 'For example "DICT_5X5_100".')
    return name
