"""Tables (CSV) read column by column and checked; a million rows in a second or two."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import LEAST_SIGMA_PX, MARGIN, SIGMA_COLUMNS, Observations, name_problem
from spherecal_files.atomic import write_file_whole
from spherecal_files.json_file import check_lines, decode, printable, read_bytes

_LONGEST_FIELD = 400  # bytes: a name of 100 characters in UTF-8

Bytes = NDArray[np.bytes_]


@dataclass(frozen=True)
class Table:
    """The fields of a file by column, as bytes; complaints name the file, the line, which counts from 1, and column."""

    path: Path
    columns: dict[str, Bytes]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def error(self, row: int, column: str, problem: Phrase) -> InputError:
        """An InputError about one field, to be raised by the caller."""
        field = printable(decode(self.path, self.columns[column][row]))
        values = {"file": self.path, "line": row + 2, "column": column, "field": field, "problem": problem}
        return InputError(Phrase("error-in-table", values))

    def check(self, good: BoolArray, column: str, problem: Phrase | Callable[[int], Phrase]) -> None:
        """Raise InputError about the first row that is not good."""
        if not good.all():
            row = int(np.argmin(good))
            raise self.error(row, column, problem if isinstance(problem, Phrase) else problem(row))

    def names(self, column: str) -> list[str]:
        """A column of names; none may be empty or hold commas or quotation marks."""
        names = [field.decode() for field in self.columns[column].tolist()]
        for name in dict.fromkeys(names):
            if problem := name_problem(name):
                raise self.error(names.index(name), column, Phrase("problem-csv-name", {"problem": problem}))
        return names

    def lookup(self, column: str, names: Sequence[str], problem: Phrase) -> IntArray:
        """Indices of a column's fields in `names`; the problem is that a field is not among them."""
        index = {name.encode(): i for i, name in enumerate(names)}
        fields = self.columns[column].tolist()
        found = np.fromiter(map(index.get, fields, repeat(-1)), np.int64, len(fields))
        self.check(found >= 0, column, problem)
        return found

    def numbers(self, column: str, may_be_empty: bool = False) -> FloatArray:
        """A column of finite numbers; NaN where a field is empty, if it may be."""
        fields = self.columns[column]
        empty = (fields == b"") & may_be_empty
        values = self._parsed(column, np.where(empty, b"nan", fields), np.float64, Phrase("problem-not-number"))
        self.check(np.isfinite(values) | empty, column, Phrase("problem-not-number"))
        return values

    def lengths(self, column: str, may_be_empty: bool = False) -> FloatArray:
        """A column of finite numbers none of which is negative; NaN where a field is empty, if it may be."""
        values = self.numbers(column, may_be_empty)
        self.check(~(values < 0), column, Phrase("problem-negative"))
        return values

    def whole_numbers(self, column: str) -> IntArray:
        """A column of whole numbers."""
        return self._parsed(column, self.columns[column], np.int64, Phrase("problem-not-whole"))

    def flags(self, column: str) -> BoolArray:
        """A column of 0 and 1."""
        fields = self.columns[column]
        self.check((fields == b"0") | (fields == b"1"), column, Phrase("problem-no-flag"))
        return fields == b"1"

    def _parsed(self, column: str, fields: Bytes, kind: type, problem: Phrase) -> NDArray:
        try:
            if b"_" in fields.tobytes():  # Python reads 1_000 as a number
                raise ValueError
            return fields.astype(kind)
        except (ValueError, OverflowError):
            row = next(i for i, field in enumerate(fields) if not _parses(field, kind))
            raise self.error(row, column, problem) from None


def _parses(field: bytes, kind: type) -> bool:
    try:
        np.array([field]).astype(kind)
    except (ValueError, OverflowError):
        return False
    return b"_" not in field


def read_table(
    path: Path, most: int, headers: Sequence[tuple[str, ...]], header_problem: Callable[[Path, str], Phrase]
) -> Table:
    """The table in a file of at most `most` bytes whose first line is one of some headers."""
    data = read_bytes(path, most)
    check_lines(path, data)
    decode(path, data)
    data = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").rstrip(b"\n") + b"\n"
    end = data.index(b"\n")
    header = tuple(decode(path, data[:end]).replace('"', "").split(","))
    if header not in headers:
        raise InputError(header_problem(path, printable(",".join(header))))
    body = np.frombuffer(data, np.uint8, offset=end + 1)
    line_end = body == ord("\n")
    stop = np.flatnonzero(line_end | (body == ord(",")))
    n = len(header)
    fields = np.diff(np.flatnonzero(line_end[stop]) + 1, prepend=0)  # of each row
    if (fields != n).any():
        row = int(np.argmax(fields != n))
        values = {"file": path, "line": row + 2, "found": int(fields[row]), "n": n}
        raise InputError(Phrase("error-empty-line" if fields[row] == 1 else "error-field-count", values))
    start = np.concatenate([[0], stop[:-1] + 1]) if len(stop) else stop
    return Table(path, {name: _fields(path, body, start[k::n], stop[k::n]) for k, name in enumerate(header)})


def _fields(path: Path, body: NDArray[np.uint8], start: IntArray, stop: IntArray) -> Bytes:
    """The bytes between start and stop as one array of fixed width; a pair of quotation marks around them goes."""
    if not len(start):
        return np.empty(0, dtype="S1")
    quoted = (stop - start >= 2) & (body[start] == ord('"')) & (body[stop - 1] == ord('"'))
    start, stop = start + quoted, stop - quoted
    width = max(int((stop - start).max()), 1)
    if width > _LONGEST_FIELD:
        line = 2 + int(np.argmax(stop - start))
        values = {"file": path, "line": line, "width": width, "most": _LONGEST_FIELD}
        raise InputError(Phrase("error-field-long", values))
    padded = np.concatenate([body, np.zeros(width, np.uint8)])
    fields = np.lib.stride_tricks.sliding_window_view(padded, width)[start]
    fields[np.arange(width) >= (stop - start)[:, None]] = 0
    return fields.view(f"S{width}").reshape(-1)


COLUMNS = ("placement", "camera", "target", "point", "u", "v")

_MOST_BYTES = 128 << 20  # 2.5 million rows


def read_observations(
    path: Path, placements: Sequence[str], cameras: Sequence[str], image_sizes: Sequence[tuple[int, int]]
) -> Observations:
    """The observations in a file, checked against a session's ids and image sizes (w, h); point names sorted."""
    table = read_table(path, _MOST_BYTES, (COLUMNS, COLUMNS + SIGMA_COLUMNS), _header_problem)
    names = [decode(path, name) for name in sorted(set(table.columns["point"].tolist()))]
    for name in names:
        if problem := name_problem(name):
            row = int(np.argmax(table.columns["point"] == name.encode()))
            raise table.error(row, "point", Phrase("problem-point-name", {"problem": problem}))
    placement = table.lookup("placement", placements, Phrase("problem-not-placement"))
    camera = table.lookup("camera", cameras, Phrase("problem-not-camera"))
    target = table.whole_numbers("target")
    point = table.lookup("point", names, Phrase("problem-not-camera"))
    uv = np.column_stack([table.numbers(column) for column in "uv"])
    _check_inside(table, uv, np.array(image_sizes, dtype=float).reshape(-1, 2)[camera])
    sigma = None
    if len(table.columns) > len(COLUMNS):
        sigma = np.column_stack([table.numbers(column) for column in SIGMA_COLUMNS])
        for k, column in enumerate(SIGMA_COLUMNS):
            table.check(sigma[:, k] >= LEAST_SIGMA_PX, column, Phrase("problem-sigma", {"least": LEAST_SIGMA_PX}))
    ids = tuple(placements), tuple(cameras), tuple(names)
    observations = Observations(*ids, placement, camera, target, point, uv, sigma)
    order = np.lexsort((observations.camera, observations.point, observations.target, observations.placement))
    same = np.ones(max(len(order) - 1, 0), dtype=bool)
    for key in (observations.placement, observations.target, observations.point, observations.camera):
        same &= key[order[1:]] == key[order[:-1]]
    if same.any():
        pair = np.flatnonzero(same)[np.argmin(order[1:][same])]
        first, again = int(order[pair]) + 2, int(order[pair + 1]) + 2
        raise InputError(Phrase("error-dot-twice", {"file": table.path, "line": again, "first": first}))
    return observations


def _header_problem(path: Path, found: str) -> Phrase:
    values = {"file": path, "columns": COLUMNS, "found": found, "optional": SIGMA_COLUMNS}
    return Phrase("error-table-header", values)


def write_observations(path: Path, observations: Observations) -> None:
    """Write observations.csv; numbers keep their full precision."""
    write_file_whole(path, observations_bytes(observations))


def observations_bytes(observations: Observations) -> bytes:
    """The contents of observations.csv; numbers keep their full precision."""
    o = observations
    columns: list[list[str]] = [
        [o.placements[i] for i in o.placement.tolist()],
        [o.cameras[i] for i in o.camera.tolist()],
        list(map(str, o.target.tolist())),
        [o.points[i] for i in o.point.tolist()],
        *(list(map(repr, column.tolist())) for column in o.uv.T),
    ]
    header = COLUMNS
    if o.sigma is not None:
        columns += [list(map(repr, column.tolist())) for column in o.sigma.T]
        header += SIGMA_COLUMNS
    lines = [",".join(header), *map(",".join, zip(*columns, strict=True))]
    return ("\n".join(lines) + "\n").encode()


def _check_inside(table: Table, uv: FloatArray, size: FloatArray) -> None:
    """Raise InputError for an image point that is well outside its image."""
    margin = MARGIN * size.max(axis=1, initial=0.0, keepdims=True)
    good, exchanged = ((some >= -margin) & (some <= size - 1 + margin) for some in (uv, uv[:, ::-1]))

    def problem(row: int) -> Phrase:
        own = table.columns["camera"] == table.columns["camera"][row]
        named = "problem-axes-exchanged" if exchanged[own].all() else "problem-outside-image"
        return Phrase(named, {"width": float(size[row, 0]), "height": float(size[row, 1])})

    for k, column in enumerate("uv"):
        table.check(good[:, k], column, problem)
