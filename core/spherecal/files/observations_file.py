"""observations.csv: image points of dots, read and written; a million rows in a second or two."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import LEAST_SIGMA_PX, MARGIN, SIGMA_COLUMNS, Observations, name_problem
from spherecal.files.atomic import write_file_whole
from spherecal.files.json_file import check_lines, decode, printable, read_bytes

COLUMNS = ("placement", "camera", "target", "point", "u", "v")

_MOST_BYTES = 128 << 20  # 2.5 million rows
_LONGEST_FIELD = 400  # bytes: a name of 100 characters in UTF-8

Bytes = NDArray[np.bytes_]


def read_observations(
    path: Path, placements: Sequence[str], cameras: Sequence[str], image_sizes: Sequence[tuple[int, int]]
) -> Observations:
    """The observations in a file, checked against a session's ids and image sizes (w, h); point names sorted."""
    table = _split(path, read_bytes(path, _MOST_BYTES))
    names = [decode(path, name) for name in sorted(set(table.columns[3].tolist()))]
    for name in names:
        if problem := name_problem(name):
            row = int(np.argmax(table.columns[3] == name.encode()))
            table.fail(row, 3, Phrase("problem-point-name", {"problem": problem}))
    placement = table.lookup(0, placements)
    camera = table.lookup(1, cameras)
    target = table.numbers(2, np.int64)
    point = table.lookup(3, names)
    uv = np.column_stack([table.numbers(k, np.float64) for k in (4, 5)])
    table.check_inside(uv, np.array(image_sizes, dtype=float).reshape(-1, 2)[camera])
    sigma = None
    if len(table.columns) > len(COLUMNS):
        sigma = np.column_stack([table.numbers(k, np.float64) for k in (6, 7)])
        for k in (0, 1):
            table.check(
                sigma[:, k] >= LEAST_SIGMA_PX, 6 + k, lambda _: Phrase("problem-sigma", {"least": LEAST_SIGMA_PX})
            )
    ids = tuple(placements), tuple(cameras), tuple(names)
    observations = Observations(*ids, placement, camera, target, point, uv, sigma)
    _check_repeated(table, observations)
    return observations


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


@dataclass(frozen=True)
class _Table:
    """The fields of a file, column by column, as bytes; complaints count lines from 1, the header."""

    path: Path
    header: tuple[str, ...]
    columns: list[Bytes]

    def fail(self, row: int, column: int, problem: Phrase) -> NoReturn:
        field = printable(decode(self.path, self.columns[column][row]))
        values = {"file": self.path, "line": row + 2, "column": self.header[column], "field": field, "problem": problem}
        raise InputError(Phrase("error-in-table", values))

    def check(self, good: BoolArray, column: int, problem: Callable[[int], Phrase]) -> None:
        """Raise InputError about the first row that is not good."""
        if not good.all():
            row = int(np.argmin(good))
            self.fail(row, column, problem(row))

    def lookup(self, column: int, names: Sequence[str]) -> IntArray:
        """Indices of a column's fields in `names`; InputError for a field that is not among them."""
        index = {name.encode(): i for i, name in enumerate(names)}
        fields = self.columns[column].tolist()
        found = np.fromiter(map(index.get, fields, repeat(-1)), np.int64, len(fields))
        known = Phrase("problem-not-placement" if self.header[column] == "placement" else "problem-not-camera")
        self.check(found >= 0, column, lambda _: known)
        return found

    def numbers(self, column: int, kind: type) -> NDArray:
        """A column as finite numbers; InputError for a field that is none."""
        fields = self.columns[column]
        bad = Phrase("problem-not-whole" if kind is np.int64 else "problem-not-number")
        try:
            if b"_" in fields.tobytes():  # Python reads 1_000 as a number
                raise ValueError
            values = fields.astype(kind)
        except (ValueError, OverflowError):
            self.fail(next(i for i, field in enumerate(fields) if not _parses(field, kind)), column, bad)
        self.check(np.isfinite(values), column, lambda _: bad)
        return values

    def check_inside(self, uv: FloatArray, size: FloatArray) -> None:
        """Raise InputError for an image point that is well outside its image."""
        margin = MARGIN * size.max(axis=1, initial=0.0, keepdims=True)
        good, exchanged = ((some >= -margin) & (some <= size - 1 + margin) for some in (uv, uv[:, ::-1]))

        def problem(row: int) -> Phrase:
            own = self.columns[1] == self.columns[1][row]
            named = "problem-axes-exchanged" if exchanged[own].all() else "problem-outside-image"
            return Phrase(named, {"width": float(size[row, 0]), "height": float(size[row, 1])})

        for k in (0, 1):
            self.check(good[:, k], 4 + k, problem)


def _parses(field: bytes, kind: type) -> bool:
    try:
        np.array([field]).astype(kind)
    except (ValueError, OverflowError):
        return False
    return b"_" not in field


def _split(path: Path, data: bytes) -> _Table:
    """Cut the file into columns of bytes; InputError for a wrong header, a wrong number of fields, no UTF-8."""
    check_lines(path, data)
    decode(path, data)
    data = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").rstrip(b"\n") + b"\n"
    end = data.index(b"\n")
    header = tuple(decode(path, data[:end]).replace('"', "").split(","))
    if header not in (COLUMNS, COLUMNS + SIGMA_COLUMNS):
        values = {"file": path, "columns": COLUMNS, "found": printable(",".join(header)), "optional": SIGMA_COLUMNS}
        raise InputError(Phrase("error-table-header", values))
    body = np.frombuffer(data, np.uint8, offset=end + 1)
    line_end = body == ord("\n")
    stop = np.flatnonzero(line_end | (body == ord(",")))
    _check_shape(path, len(header), np.flatnonzero(line_end[stop]) + 1)
    start = np.concatenate([[0], stop[:-1] + 1]) if len(stop) else stop
    columns = [_fields(path, body, start[k :: len(header)], stop[k :: len(header)]) for k in range(len(header))]
    return _Table(path, header, columns)


def _check_shape(path: Path, width: int, fields_until: IntArray) -> None:
    """`fields_until[i]` counts the fields up to the end of row i."""
    fields = np.diff(fields_until, prepend=0)
    if (fields != width).any():
        row = int(np.argmax(fields != width))
        values = {"file": path, "line": row + 2, "found": int(fields[row]), "n": width}
        raise InputError(Phrase("error-empty-line" if fields[row] == 1 else "error-field-count", values))


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


def _check_repeated(table: _Table, o: Observations) -> None:
    """Refuse two observations of one dot by one camera."""
    order = np.lexsort((o.camera, o.point, o.target, o.placement))
    same = np.ones(max(len(order) - 1, 0), dtype=bool)
    for key in (o.placement, o.target, o.point, o.camera):
        same &= key[order[1:]] == key[order[:-1]]
    if same.any():
        pair = np.flatnonzero(same)[np.argmin(order[1:][same])]
        first, again = int(order[pair]) + 2, int(order[pair + 1]) + 2
        raise InputError(Phrase("error-dot-twice", {"file": table.path, "line": again, "first": first}))
