"""Reference bars as a table (CSV): one certified length a line, columns by their headings (en, de, zh) and units.

A line that cannot be used costs its own bar only, and is named with the reason; all other bars are read.
"""

import csv
import io
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime
from pathlib import Path
from typing import Any

from spherecal.base.errors import InputError, Words
from spherecal.base.file_reading import read_file
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import resource_path
from spherecal.data.session import BarLength, Mark
from spherecal_files.atomic import write_file_whole
from spherecal_files.bar_registry import REGISTERED_BAR, RegisteredBar, read_lengths
from spherecal_files.cells import cell, from_cell
from spherecal_files.json_file import JsonValue, printable

_MOST_BYTES = 4 << 20  # ten thousand lengths take 1 MB
_MOST_LINES = 20_000
# Heading as it is written -> the headings that mean the same.
_WORDS: dict[str, str] = tomllib.loads(resource_path("bars_table.toml").read_text(encoding="utf-8"))["headings"]
_HEADINGS = {name: tuple(words.split()) for name, words in _WORDS.items()}
COLUMNS = (
    "serial", "description", "from", "from_target", "to", "to_target", "nominal [mm]", "length [mm]",
    "uncertainty [mm]", "coverage_factor", "expansion [1/K]", "reference_temperature [°C]", "certificate",
    "laboratory", "date", "valid_until",
)  # fmt: skip
_KNOWN = {name.replace("_", ""): name for name in _HEADINGS} | {
    other: name for name, others in _HEADINGS.items() for other in others
}
_NEEDED = ("serial", "length", "from_target", "to_target")
_UNITS = {"mm": 1.0, "µm": 1e-3, "um": 1e-3, "μm": 1e-3, "m": 1e3, "cm": 10.0}
_LENGTHS = ("nominal", "length", "uncertainty")
_MILLIMETRES = (("length", "length_mm"), ("nominal", "nominal_mm"), ("uncertainty", "expanded_uncertainty_mm"))
_OF_THE_BAR = (
    "description", "expansion", "reference_temperature", "certificate", "laboratory", "date", "valid_until",
)  # fmt: skip
_FIELDS = {  # of a bar as files have it -> the table's column
    "length_mm": "length", "nominal_mm": "nominal", "expanded_uncertainty_mm": "uncertainty",
    "coverage_factor": "coverage_factor", "expansion_per_kelvin": "expansion",
    "reference_temperature_c": "reference_temperature", "number": "certificate", "laboratory": "laboratory",
    "date": "date", "valid_until": "valid_until", "from": "from", "to": "to", "serial": "serial",
    "description": "description",
}  # fmt: skip


@dataclass(frozen=True)
class LineProblem:
    """Why a line of the table cannot be used; `serial` is that of the bar it belongs to, as far as it is known."""

    line: int
    serial: str
    message: Phrase


@dataclass(frozen=True)
class BarsTable:
    """The whole bars of a table in its order, what is wrong with its other lines, and headings that are not known."""

    bars: tuple[RegisteredBar, ...]
    problems: tuple[LineProblem, ...]
    ignored: tuple[str, ...] = ()


@dataclass(frozen=True)
class Arrivals:
    """Bars of a table beside those that are known: new, the same as before, or with other figures."""

    new: tuple[RegisteredBar, ...]
    same: tuple[RegisteredBar, ...]
    other: tuple[RegisteredBar, ...]


def arrivals(table: BarsTable, known: Mapping[str, RegisteredBar]) -> Arrivals:
    """Which bars of a table are new, known with the same figures, or known with others."""
    fresh = tuple(bar for bar in table.bars if bar.serial not in known)
    same = tuple(bar for bar in table.bars if known.get(bar.serial) == bar)
    return Arrivals(fresh, same, tuple(bar for bar in table.bars if bar not in fresh and bar not in same))


class _Refused(Exception):
    """A cell that cannot be used."""

    def __init__(self, column: str, problem: Words) -> None:
        super().__init__(column)
        self.column, self.problem = column, problem


@dataclass
class _Draft:
    """A bar while its lines are read; `lines` are those of its lengths."""

    serial: str
    fields: dict[str, Any] = field(default_factory=dict)
    given: dict[str, int] = field(default_factory=dict)  # column -> the line that gave it first
    marks: dict[str, Mark] = field(default_factory=dict)
    lengths: list[dict[str, Any]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    broken: bool = False


@dataclass(frozen=True)
class _Column:
    name: str
    heading: str
    factor: float = 1.0


def read_bars_table(path: Path) -> BarsTable:
    """The bars of a CSV file."""
    text = _text_of(read_file(path, _MOST_BYTES), path)
    # semicolon or tab where the heading has one: then numbers may have a decimal comma
    heading = next((line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")), "")
    counts = {mark: heading.count(mark) for mark in (";", "\t", ",")}
    delimiter = max(counts, key=lambda mark: counts[mark]) if any(counts.values()) else ","
    try:
        rows = [(number, row) for number, row in _rows(text, delimiter) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputError(Phrase("error-bars-table", {"file": path, "why": str(error)})) from error
    if not rows:
        raise InputError(Phrase("error-bars-table-empty", {"file": path}))
    if len(rows) > _MOST_LINES:
        raise InputError(Phrase("error-bars-table-long", {"file": path, "most": _MOST_LINES, "found": len(rows)}))
    columns = _columns(rows[0][1], path)
    reader = _Reader(path, columns, decimal_comma=delimiter != ",")
    for number, row in rows[1:]:
        reader.read(number, row)
    known = {column.heading for column in columns if column is not None}
    ignored = tuple(cell.strip() for cell in rows[0][1] if cell.strip() and cell.strip() not in known)
    return reader.finish(ignored)


def _rows(text: str, delimiter: str) -> list[tuple[int, list[str]]]:
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    found, line = [], 1
    for row in reader:
        if not (row and row[0].lstrip().startswith("#")):
            found.append((line, row))
        line = reader.line_num + 1
    return found


def _text_of(data: bytes, path: Path) -> str:
    """As spreadsheets save it: UTF-8 or UTF-16 with their mark, else the system's Western letters."""
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise InputError(Phrase("error-bars-table-workbook", {"file": path}))
    for encoding in ("utf-16",) if data.startswith((b"\xff\xfe", b"\xfe\xff")) else ("utf-8-sig", "gb18030", "cp1252"):
        if encoding == "gb18030" and not _looks_chinese(data):
            continue
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise InputError(Phrase("error-bars-table-letters", {"file": path}))


def _looks_chinese(data: bytes) -> bool:
    """Whether bytes that are no UTF-8 give Chinese letters; a Western letter above 127 has no other beside it."""
    try:
        text = data.decode("gb18030")
    except UnicodeDecodeError:
        return False
    high = [c for c in text if ord(c) > 127]
    return bool(high) and all("\u3000" <= c <= "\u9fff" or "\uff00" <= c <= "\uffef" for c in high)


def _columns(headings: Sequence[str], path: Path) -> list[_Column | None]:
    columns: list[_Column | None] = []
    for heading in headings:
        column = _column(heading)
        if column is not None and any(one is not None and one.name == column.name for one in columns):
            raise InputError(Phrase("error-bars-table-twice", {"file": path, "column": heading.strip()}))
        columns.append(column)
    there = {column.name for column in columns if column is not None}
    lacking = [name for name in _NEEDED if name not in there]
    if lacking:
        values = {"file": path, "columns": lacking, "found": [h.strip() for h in headings if h.strip()] or "-"}
        raise InputError(Phrase("error-bars-table-columns", values))
    return columns


def _column(heading: str) -> _Column | None:
    """What a heading means, and by what its numbers are multiplied."""
    text = heading.strip()
    bracket = re.search(r"[\[(](.*?)[\])]\s*$", text) or re.search(r"\s*/\s*(\S+)$", text)
    plain = text[: bracket.start()] if bracket else text
    unit = bracket.group(1).strip().lower() if bracket else ""
    key = re.sub(r"[\s_.\-:#²]+", "", plain.lower())
    if key not in _KNOWN:
        for ending in ("mm", "µm", "um", "μm", "perkelvin"):  # length_mm, u_um
            if key.endswith(ending) and key.removesuffix(ending) in _KNOWN:
                key, unit = key.removesuffix(ending), unit or ending
                break
    name = _KNOWN.get(key)
    if name is None:
        return None
    if name in _LENGTHS:
        return _Column(name, text, _UNITS.get(unit, 1.0))
    if name == "expansion":
        return _Column(name, text, 1e-6 if re.search(r"ppm|µm|um|μm|e-?6|10\^?-?⁻?[6⁶]", unit) else 1.0)
    return _Column(name, text)


class _Reader:
    """Takes the lines one after the other."""

    def __init__(self, path: Path, columns: Sequence[_Column | None], decimal_comma: bool) -> None:
        self._path, self._columns, self._comma = path, columns, decimal_comma
        self._headings = {column.name: column.heading for column in columns if column is not None}
        self._factors = {column.name: column.factor for column in columns if column is not None}
        self._drafts: dict[str, _Draft] = {}
        self._problems: list[LineProblem] = []
        self._last: _Draft | None = None

    def read(self, line: int, row: Sequence[str]) -> None:
        """One line: a certified length of the bar that it names, or of the one above."""
        cells = {c.name: from_cell(text.strip()) for c, text in zip(self._columns, row, strict=False) if c is not None}
        serial = cells.get("serial", "")
        if not serial and self._last is None:
            self._complain(line, "", _Refused("serial", Phrase("problem-cell-empty")))
            return
        if serial:
            self._last = self._drafts.setdefault(serial, _Draft(serial))
        assert self._last is not None
        draft = self._last
        try:
            if len(row) > len(self._columns) and any(cell.strip() for cell in row[len(self._columns) :]):
                raise _Refused("", Phrase("problem-cells", {"found": len(row), "n": len(self._columns)}))
            for column in _OF_THE_BAR:
                self._take_field(draft, line, column, cells.get(column, ""))
            self._take_length(draft, line, cells)
        except _Refused as refused:
            draft.broken = True
            self._complain(line, draft.serial, refused)

    def _complain(self, line: int, serial: str, refused: _Refused) -> None:
        place = self._headings.get(refused.column, refused.column)
        values = {"line": line, "column": place, "problem": refused.problem}
        phrase = Phrase("table-line-cell", values) if place else Phrase("table-line", values)
        self._problems.append(LineProblem(line, serial, phrase))

    def _take_field(self, draft: _Draft, line: int, column: str, text: str) -> None:
        """What is said of the whole bar: once, or the same in every line."""
        if not text:
            return
        value: Any = text
        if column in ("expansion", "reference_temperature"):
            value = self._number(column, text) * self._factors.get(column, 1.0)
            if column == "expansion" and abs(value) > 0.1:  # 11.5 is meant in millionths: nothing expands by 10 %
                value *= 1e-6
        elif column in ("date", "valid_until"):
            value = _day(column, text)
        if column in draft.fields and draft.fields[column] != value:
            raise _Refused(column, Phrase("problem-cell-differs", {"line": draft.given[column]}))
        draft.fields[column] = value
        draft.given.setdefault(column, line)

    def _take_length(self, draft: _Draft, line: int, cells: Mapping[str, str]) -> None:
        if not any(cells.get(name) for name in ("length", "from_target", "to_target", "uncertainty")):
            if cells.get("serial"):
                raise _Refused("length", Phrase("problem-cell-empty"))
            return  # a note below the bar
        ends = [self._take_mark(draft, end, cells) for end in ("from", "to")]
        entry: dict[str, Any] = {"from": ends[0], "to": ends[1]}
        for column, key in _MILLIMETRES:
            if cells.get(column):
                entry[key] = self._number(column, cells[column]) * self._factors.get(column, 1.0)
        if cells.get("coverage_factor"):
            entry["coverage_factor"] = self._number("coverage_factor", cells["coverage_factor"])
        if "length_mm" not in entry:
            raise _Refused("length", Phrase("problem-cell-empty"))
        try:
            read_lengths(JsonValue([entry], self._path), draft.marks)
        except InputError as error:
            raise _refused_by(error) from None
        draft.lengths.append(entry)
        draft.lines.append(line)

    def _take_mark(self, draft: _Draft, end: str, cells: Mapping[str, str]) -> str:
        """The mark at one end: its sticker, `201` or `201:E`, and its name, else the sticker's number."""
        column = f"{end}_target"
        number, _, point = cells.get(column, "").partition(":")
        if not number:
            raise _Refused(column, Phrase("problem-cell-empty"))
        if not re.fullmatch(r"\d+(?:[.,]0+)?", number.strip()):
            raise _Refused(column, Phrase("problem-cell-target", {"text": printable(cells[column])}))
        mark = Mark(int(re.split(r"[.,]", number.strip())[0]), point.strip() or "centre")
        name = cells.get(end) or f"T{mark.target}"
        known = draft.marks.setdefault(name, mark)
        if known != mark:
            raise _Refused(column, Phrase("problem-cell-mark", {"mark": name, "target": known.target}))
        return name

    def _number(self, column: str, text: str) -> float:
        """A number as people write it: blanks between digits, a decimal comma where the table's columns have none."""
        plain = re.sub(r"[\s'\u2019\u00a0\u202f]", "", text).replace("\u2212", "-")
        if "," in plain and "." in plain:
            if plain.rfind(",") > plain.rfind("."):
                plain = plain.replace(".", "").replace(",", ".")
            else:
                plain = plain.replace(",", "")
        elif plain.count(",") == 1 and (self._comma or len(plain.split(",")[1]) != 3):
            plain = plain.replace(",", ".")
        try:
            value = float(plain)
        except ValueError:
            value = float("nan")
        if not abs(value) < 1e30:
            raise _Refused(column, Phrase("problem-cell-number", {"text": printable(text)}))
        return value

    def finish(self, ignored: tuple[str, ...]) -> BarsTable:
        """The bars that are whole."""
        bars = []
        for draft in self._drafts.values():
            if draft.broken:
                continue
            if not draft.lengths:
                continue
            try:
                bars.append(REGISTERED_BAR.read(JsonValue(_entry(draft), self._path)))
            except InputError as error:
                refused = _refused_by(error)
                line = draft.given.get(refused.column, draft.lines[0])
                self._complain(line, draft.serial, refused)
        order = sorted(self._problems, key=lambda one: one.line)
        return BarsTable(tuple(bars), tuple(order), ignored)


def _entry(draft: _Draft) -> dict[str, Any]:
    """The bar as the registry's file would have it, so that it is checked as that is."""
    entry: dict[str, Any] = {
        "serial": draft.serial,
        "marks": {name: {"target": mark.target, "point": mark.point} for name, mark in draft.marks.items()},
        "lengths": draft.lengths,
    }
    names = {"description": "description", "expansion": "expansion_per_kelvin"}
    names["reference_temperature"] = "reference_temperature_c"
    entry |= {key: draft.fields[name] for name, key in names.items() if name in draft.fields}
    about = {name: draft.fields[name] for name in ("laboratory", "date", "valid_until") if name in draft.fields}
    if "certificate" in draft.fields:
        entry["certificate"] = {"number": draft.fields["certificate"], **about}
    elif about:
        values = {"file": "", "place": "certificate.number", "problem": Phrase("problem-cell-empty")}
        raise InputError(Phrase("error-in-file", values))
    return entry


def _refused_by(error: InputError) -> _Refused:
    """What a reader of our files says, about the column of the table that it means."""
    said = error.parts[0]
    if not isinstance(said, Phrase):
        return _Refused("", said)
    key = re.split(r"[.\[\]]+", str(said.values.get("place", "")).rstrip("]"))[-1]
    problem = said.values.get("problem", str(error))
    return _Refused(_FIELDS.get(key, ""), problem if isinstance(problem, (str, Phrase)) else str(error))


def _day(column: str, text: str) -> str:
    """A date as 2026-11-21; 21.11.2026 is understood, 03/04/2026 has two meanings."""
    for form in ("%Y-%m-%d", "%Y/%m/%d", "%Y.%m.%d", "%d.%m.%Y", "%Y年%m月%d日", "%d %B %Y", "%d %b %Y"):
        try:
            return datetime.strptime(text, form).date().isoformat()
        except ValueError:
            continue
    days = re.fullmatch(r"(\d{1,2})/(\d{1,2})/(\d{4})", text)
    if days:
        first, second, year = map(int, days.groups())
        if first > 12 >= second or first == second:
            return date(year, second, first).isoformat()
        if second > 12 >= first:
            return date(year, first, second).isoformat()
    raise _Refused(column, Phrase("problem-cell-date", {"text": printable(text)}))


def bars_table(bars: Sequence[RegisteredBar]) -> str:
    """The bars as such a table; read back it gives the same bars, without marks that no length uses."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\r\n")
    writer.writerow(COLUMNS)
    for bar in bars:
        for number, length in enumerate(bar.lengths):
            first = number == 0
            own = [cell(bar.serial), cell(bar.description) if first else ""]
            writer.writerow([*own, *_length_cells(bar, length), *_about_cells(bar, first)])
    return out.getvalue()


def write_bars_table(bars: Sequence[RegisteredBar], path: Path) -> None:
    """Write the table, with the mark by which spreadsheets know UTF-8."""
    write_file_whole(path, b"\xef\xbb\xbf" + bars_table(bars).encode())


def _length_cells(bar: RegisteredBar, length: BarLength) -> list[str]:
    cells = []
    for name in (length.from_mark, length.to_mark):
        mark = bar.marks[name]
        cells += [cell(name), str(mark.target) if mark.point == "centre" else cell(f"{mark.target}:{mark.point}")]
    shown = (
        "" if length.nominal_mm is None else repr(length.nominal_mm),
        repr(length.length_mm),
        "" if "expanded_uncertainty_mm" in length.assumed else repr(length.expanded_uncertainty_mm),
        "" if "coverage_factor" in length.assumed else repr(length.coverage_factor),
    )
    return [*cells, *shown]


def _about_cells(bar: RegisteredBar, first: bool) -> list[str]:
    if not first:
        return [""] * 6
    own, c = bar.assumed, bar.certificate
    return [
        "" if "expansion_per_kelvin" in own else repr(bar.expansion_per_kelvin),
        "" if "reference_temperature_c" in own else repr(bar.reference_temperature_c),
        cell(c.number) if c else "",
        cell(c.laboratory) if c else "",
        str(c.date or "") if c else "",
        str(c.valid_until or "") if c else "",
    ]
