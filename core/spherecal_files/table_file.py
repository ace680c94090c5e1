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
from spherecal.data.observations import name_problem
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
