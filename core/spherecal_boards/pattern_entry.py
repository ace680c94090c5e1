"""What is printed on a board, as the `board` section of session.json or `--board` describes it (docs/board.md)."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Session
from spherecal_boards.board_pattern import APRILTAGS, BoardKind, BoardPattern
from spherecal_files.json_file import JsonValue, decode, parse_json, printable, read_bytes, read_json
from spherecal_files.read_session import FORMAT, SESSION_FILE, VERSION
from spherecal_files.session_file import BOARD
from spherecal_files.target_set_file import marker_count
from spherecal_files.toml_text import toml_of

_FIELDS = tuple(BOARD.schema["properties"])
_TEXTS = ("kind", "polarity", "dictionary", "shape")
_MOST_BYTES = 1 << 20
SQUARED = ("chessboard", "charuco", "aprilgrid")  # kinds that show rows and columns by themselves
_LONGEST = 1000  # characters of --board


def read_board_pattern(session: Session) -> BoardPattern:
    """The pattern of a session's board."""
    board = _board(session)
    if board is None:
        raise InputError(Phrase("error-no-board", {"folder": session.where}))
    return board_pattern(board)


def board_pattern(board: JsonValue) -> BoardPattern:
    """The pattern that the fields of a board describe."""
    f, given = BOARD.read(board), board.fields(("kind",), _FIELDS)
    kind: BoardKind = f["kind"]
    if "points" in given:
        raise given["points"].error(Phrase("problem-board-points"))
    also = {"charuco": ("marker_mm", "dictionary"), "aprilgrid": ("marker_mm",)}.get(kind, ())
    board.fields(("rows", "columns", "pitch_mm", *also))
    rows, columns, pitch = f["rows"], f["columns"], f["pitch_mm"]
    if f.get("dot_diameter_mm", 0.0) >= pitch * (2**0.5 if kind == "asymmetric-circles" else 1):
        raise given["dot_diameter_mm"].error(Phrase("problem-board-dot"))
    if f.get("marker_mm", 0.0) >= pitch:
        raise given["marker_mm"].error(Phrase("problem-board-marker"))
    if kind == "asymmetric-circles" and rows % 2 == 0:
        raise given["rows"].error(Phrase("problem-board-odd"))
    for ring in given["rings"].items() if "rings" in given else ():
        row, column = ring.items(2)
        row.integer(0, rows - 1)
        column.integer(0, columns - 1)
    dictionary = _dictionary(given["dictionary"]) if "dictionary" in f else APRILTAGS if kind == "aprilgrid" else ""
    tags = kind in ("charuco", "aprilgrid")
    if tags:
        needed = (rows + 1) * (columns + 1) // 2 if kind == "charuco" else rows * columns
        there = marker_count(dictionary)
        if (needed := f.get("first_id", 0) + needed) > there:
            said = {"needed": needed, "dictionary": dictionary, "there": there}
            raise given["rows"].error(Phrase("problem-board-tags", said))
    return BoardPattern(
        kind,
        rows,
        columns,
        pitch,
        light=f.get("polarity") == "light-on-dark",
        rings=f.get("rings", ()),
        rows_upward=f.get("rows_upward", kind == "aprilgrid"),
        dot_diameter_mm=f.get("dot_diameter_mm"),
        marker_mm=f.get("marker_mm"),
        dictionary=dictionary,
        legacy=f.get("legacy", False),
        border_bits=f.get("border_bits"),
        first_id=f.get("first_id", 0),
    )


def board_entry(given: Mapping[str, Any] | str | Path) -> dict[str, Any]:
    """The fields of a board: of a mapping, a file (JSON, caliscope's), or "circles,rows=6,columns=9,rings=2:2+2:7"."""
    entry, where, place = _given(given)
    board_pattern(JsonValue(entry, where, place))
    if isinstance(entry, dict):
        return json.loads(json.dumps(entry))  # plain values, whatever the mapping held
    raise InputError(Phrase("error-holds-no-board", {"file": where}))


def partial_board(given: Mapping[str, Any] | str | Path) -> dict[str, Any] | None:
    """The fields of a board whose rows and columns are to be found by looking; None of one described whole."""
    entry, where, place = _given(given)
    if not isinstance(entry, dict) or entry.get("kind") not in SQUARED or {"rows", "columns"} & set(entry):
        return None
    value = JsonValue(entry, where, place)
    BOARD.read(value)
    value.fields(("pitch_mm", "marker_mm") if entry["kind"] == "aprilgrid" else ("pitch_mm",))
    return dict(entry)


def _given(given: Mapping[str, Any] | str | Path) -> tuple[Any, Path, str]:
    """The fields as they are given, with the file and the place in it that messages name."""
    if isinstance(given, Mapping):
        return dict(given), Path("board"), "board"
    ending = Path(str(given)).suffix.lower()
    if ending == ".json":
        loaded = parse_json(read_bytes(Path(given), _MOST_BYTES))
        return loaded.get("board", loaded) if isinstance(loaded, dict) else {}, Path(given), ""
    if ending == ".toml":
        return _of_caliscope(Path(given)), Path(given), ""
    kind, *fields = str(given)[:_LONGEST].split(",")
    entry: dict[str, Any] = {"kind": kind.strip()}
    for field in fields:
        name, equal, value = (part.strip() for part in field.partition("="))
        if not equal or name not in _FIELDS:
            said = {"field": printable(field), "example": "chessboard,rows=6,columns=9,pitch_mm=20"}
            raise InputError(Phrase("error-board-option", said))
        entry[name] = value if name in _TEXTS else _value(name, value)
    return entry, Path("--board"), "board"


def _of_caliscope(path: Path) -> dict[str, Any]:
    """The board of caliscope's charuco.toml in cm or inches: squares as measured, else as they fit the sheet."""
    try:
        document = toml_of(decode(path, read_bytes(path, _MOST_BYTES)))
    except ValueError as error:
        raise InputError(Phrase("error-holds-no-board", {"file": path}), str(error)) from None
    board = document.get("charuco", document)
    f = JsonValue(board, path).fields(
        ("columns", "rows", "dictionary", "aruco_scale"),
        ("board_height", "board_width", "units", "square_size_override_cm", "square_size_overide_cm", "inverted",
         "legacy_pattern", "thickness_cm"),
    )  # fmt: skip
    columns, rows = f["columns"].integer(2), f["rows"].integer(2)
    measured = next((f[key] for key in ("square_size_override_cm", "square_size_overide_cm") if key in f), None)
    if measured is not None:
        square = 10 * measured.positive()
    else:
        mm = 10.0 if "units" in f and f["units"].text() == "cm" else 25.4
        sides = JsonValue(board, path).fields(("board_height", "board_width"))
        square = mm * min(sides["board_height"].positive() / rows, sides["board_width"].positive() / columns)
    inverted = "inverted" in f and f["inverted"].boolean()
    return {
        "kind": "charuco",
        "rows": rows - 1,
        "columns": columns - 1,
        "pitch_mm": round(square, 6),
        "marker_mm": round(square * f["aruco_scale"].positive(), 6),
        "dictionary": f["dictionary"].text(),
        **({"polarity": "light-on-dark"} if inverted else {}),
        **({"legacy": True} if "legacy_pattern" in f and f["legacy_pattern"].boolean() else {}),
    }


def _value(name: str, text: str) -> Any:
    if name == "rings":
        text = "[" + ",".join(f"[{one.replace(':', ',')}]" for one in text.split("+")) + "]"
    try:
        return json.loads(text)
    except ValueError:
        raise InputError(Phrase("error-board-number", {"name": name, "text": printable(text)})) from None


def board_uncertainty(session: Session) -> float | None:
    """The board's own relative standard uncertainty (of its pitch), where session.json states one."""
    board = _board(session)
    return None if board is None else BOARD.read(board).get("relative_uncertainty")


def board_shape(session: Session) -> str | None:
    """Whether the board's points are to be `estimated` or are `nominal`; None where that is not said."""
    board = _board(session)
    return None if board is None else BOARD.read(board).get("shape")


def _board(session: Session) -> JsonValue | None:
    path = session.folder / SESSION_FILE
    if session.folder == Path() or not path.is_file():  # one in memory is not the one in the working folder
        return None
    return read_json(path, FORMAT, VERSION).fields((), ("board",)).get("board")


def recorded_board(session: Session) -> dict[str, Any] | None:
    """The `board` in a recorded session's session.json; None if it has none that can be found in images."""
    board = _board(session)
    entry = board.value if board is not None else None
    return entry if isinstance(entry, dict) and "kind" in entry else None


def _dictionary(value: JsonValue) -> str:
    name = value.text()
    if not (name.startswith("DICT_") and hasattr(cv2.aruco, name)):
        raise value.error(Phrase("problem-board-dictionary", {"name": name}))
    return name
