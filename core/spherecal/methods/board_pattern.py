"""What is printed on a board, as the `board` section of session.json or `--board` describes it (docs/board.md)."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Session
from spherecal.files.json_file import JsonValue, parse_json, printable, read_bytes, read_json
from spherecal.files.read_session import FORMAT, SESSION_FILE, VERSION
from spherecal.targets.board_pattern import APRILTAGS, BOARD_KINDS, BoardKind, BoardPattern, tag_dictionary

_FIELDS = (
    "kind", "rows", "columns", "pitch_mm", "polarity", "rings", "rows_upward", "dot_diameter_mm", "marker_mm",
    "dictionary", "legacy", "border_bits", "relative_uncertainty", "points", "shape",
)  # fmt: skip
_TEXTS = ("kind", "polarity", "dictionary", "shape")
_WORST_RELATIVE_UNCERTAINTY = 0.05
_MOST_BYTES = 1 << 20
_LONGEST = 1000  # characters of --board


def read_board_pattern(session: Session) -> BoardPattern:
    """The pattern of a session's board.

    Raises
    ------
    InputError
        Where images need one and session.json does not describe it, or not as `board_pattern` wants it.
    """
    board = _board(session)
    if board is None:
        raise InputError(Phrase("error-no-board", {"folder": session.where}))
    return board_pattern(board)


def board_pattern(board: JsonValue) -> BoardPattern:
    """The pattern that the fields of a board describe.

    Raises
    ------
    InputError
        Where a field cannot be as it is; the error names it.
    """
    f = board.fields(("kind",), [name for name in _FIELDS if name != "kind"])
    kind: BoardKind = f["kind"].choice(*BOARD_KINDS)
    if "points" in f:
        raise f["points"].error(Phrase("problem-board-points"))
    also = {"charuco": ("marker_mm", "dictionary"), "aprilgrid": ("marker_mm",)}.get(kind, ())
    f |= board.fields(("rows", "columns", "pitch_mm", *also))
    rows, columns, pitch = f["rows"].integer(2, 1000), f["columns"].integer(2, 1000), f["pitch_mm"].positive("mm")
    diameter = f["dot_diameter_mm"].positive("mm") if "dot_diameter_mm" in f else None
    if diameter is not None and diameter >= pitch * (2**0.5 if kind == "asymmetric-circles" else 1):
        raise f["dot_diameter_mm"].error(Phrase("problem-board-dot"))
    if kind == "asymmetric-circles" and rows % 2 == 0:
        raise f["rows"].error(Phrase("problem-board-odd"))
    tags = kind in ("charuco", "aprilgrid")
    dictionary = _dictionary(f["dictionary"]) if "dictionary" in f else APRILTAGS if kind == "aprilgrid" else ""
    if tags:
        _check_count(f["rows"], dictionary, (rows + 1) * (columns + 1) // 2 if kind == "charuco" else rows * columns)
    return BoardPattern(
        kind,
        rows,
        columns,
        pitch,
        light="polarity" in f and f["polarity"].choice("dark-on-light", "light-on-dark") == "light-on-dark",
        rings=tuple(_ring(value, rows, columns) for value in f["rings"].items()) if "rings" in f else (),
        rows_upward=f["rows_upward"].boolean() if "rows_upward" in f else kind == "aprilgrid",
        dot_diameter_mm=diameter,
        marker_mm=_marker(f["marker_mm"], pitch) if "marker_mm" in f else None,
        dictionary=dictionary,
        legacy="legacy" in f and f["legacy"].boolean(),
        border_bits=f["border_bits"].integer(1, 2) if "border_bits" in f else None,
    )


def board_entry(given: Mapping[str, Any] | str | Path) -> dict[str, Any]:
    """The fields of a board as session.json has them: of a mapping, a JSON file, or "chessboard,rows=6,columns=9,...".

    In the text `rings` are written 2:2+2:7+5:2.

    Raises
    ------
    InputError
        Where no board can be read from it, checked as `board_pattern` does.
    """
    if isinstance(given, Mapping):
        where, entry, place = Path("board"), dict(given), "board"
    elif str(given).lower().endswith(".json"):
        where, place = Path(given), ""
        loaded = parse_json(read_bytes(where, _MOST_BYTES))
        entry = loaded.get("board", loaded) if isinstance(loaded, dict) else {}
    else:
        where, entry, place = Path("--board"), _written(str(given)), "board"
    board_pattern(JsonValue(entry, where, place))
    if isinstance(entry, dict):
        return json.loads(json.dumps(entry))  # plain values, whatever the mapping held
    raise InputError(Phrase("error-holds-no-board", {"file": where}))


def _written(text: str) -> dict[str, Any]:
    kind, *fields = text[:_LONGEST].split(",")
    entry: dict[str, Any] = {"kind": kind.strip()}
    for field in fields:
        name, equal, value = (part.strip() for part in field.partition("="))
        if not equal or name not in _FIELDS:
            raise InputError(
                Phrase(
                    "error-board-option",
                    {"field": printable(field), "example": "chessboard,rows=6,columns=9,pitch_mm=20"},
                )
            )
        entry[name] = value if name in _TEXTS else _value(name, value)
    return entry


def _value(name: str, text: str) -> Any:
    if name == "rings":
        text = "[" + ",".join(f"[{one.replace(':', ',')}]" for one in text.split("+")) + "]"
    try:
        return json.loads(text)
    except ValueError:
        raise InputError(Phrase("error-board-number", {"name": name, "text": printable(text)})) from None


def board_uncertainty(session: Session) -> float | None:
    """The board's own relative standard uncertainty (of its pitch), where session.json states one.

    Raises
    ------
    InputError
        Where session.json cannot be read, or states one out of range.
    """
    board = _board(session)
    f = board.fields((), ("relative_uncertainty",)) if board is not None else {}
    return f["relative_uncertainty"].number(0, _WORST_RELATIVE_UNCERTAINTY) if f else None


def shape_estimated(session: Session) -> bool:
    """Whether the board's points are to be estimated.

    Raises
    ------
    InputError
        Where session.json cannot be read, or says neither `nominal` nor `estimated`.
    """
    board = _board(session)
    f = board.fields((), ("shape",)) if board is not None else {}
    return bool(f) and f["shape"].choice("nominal", "estimated") == "estimated"


def _board(session: Session) -> JsonValue | None:
    path = session.folder / SESSION_FILE
    if not path.is_file():
        return None
    return read_json(path, FORMAT, VERSION).fields((), ("board",)).get("board")


def recorded_board(session: Session) -> dict[str, Any] | None:
    """The `board` of a recorded session as its session.json has it; None where it has none that images can show.

    Raises
    ------
    InputError
        Where session.json cannot be read.
    """
    board = _board(session)
    entry = board.value if board is not None else None
    return entry if isinstance(entry, dict) and "kind" in entry else None


def _ring(value: JsonValue, rows: int, columns: int) -> tuple[int, int]:
    row, column = value.items(2)
    return row.integer(0, rows - 1), column.integer(0, columns - 1)


def _marker(value: JsonValue, pitch: float) -> float:
    marker = value.positive("mm")
    if marker >= pitch:
        raise value.error(Phrase("problem-board-marker"))
    return marker


def _dictionary(value: JsonValue) -> str:
    name = value.text()
    if not (name.startswith("DICT_") and hasattr(cv2.aruco, name)):
        raise value.error(Phrase("problem-board-dictionary", {"name": name}))
    return name


def _check_count(rows: JsonValue, dictionary: str, needed: int) -> None:
    there = len(tag_dictionary(dictionary).bytesList)
    if needed > there:
        raise rows.error(Phrase("problem-board-tags", {"needed": needed, "dictionary": dictionary, "there": there}))
