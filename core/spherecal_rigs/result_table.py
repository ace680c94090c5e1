"""Strict reading of the result folder's CSV tables: a complaint names file, line and column."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import name_problem
from spherecal.files.json_file import check_lines, decode, printable, read_bytes

_MOST_BYTES = 128 << 20  # two million residuals


@dataclass(frozen=True)
class CsvTable:
    """A table's cells by column; its methods give checked columns, or InputError with file, line and column."""

    path: Path
    columns: dict[str, list[str]]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def error(self, row: int, column: str, problem: Phrase) -> InputError:
        """An InputError about one cell, to be raised by the caller."""
        cell = printable(self.columns[column][row])
        values = {"file": self.path, "line": row + 2, "column": column, "field": cell, "problem": problem}
        return InputError(Phrase("error-in-table", values))

    def names(self, column: str) -> list[str]:
        """A column of names; none may be empty or hold commas or quotation marks."""
        cells = self.columns[column]
        for cell in dict.fromkeys(cells):
            if problem := name_problem(cell):
                raise self.error(cells.index(cell), column, Phrase("problem-csv-name", {"problem": problem}))
        return cells

    def numbers(self, column: str, may_be_empty: bool = False) -> FloatArray:
        """A column of finite numbers; NaN where a cell is empty, if it may be."""
        cells = self.columns[column]
        values = np.empty(len(cells))
        for row, cell in enumerate(cells):
            values[row] = np.nan if may_be_empty and not cell else self._number(row, column, cell)
        return values

    def _number(self, row: int, column: str, cell: str) -> float:
        try:
            value = float(cell) if "_" not in cell else np.nan
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise self.error(row, column, Phrase("problem-not-number"))
        return value

    def lengths(self, column: str, may_be_empty: bool = False) -> FloatArray:
        """A column of finite numbers none of which is negative; NaN where a cell is empty, if it may be."""
        values = self.numbers(column, may_be_empty)
        if (values < 0).any():
            raise self.error(int(np.argmax(values < 0)), column, Phrase("problem-negative"))
        return values

    def whole_numbers(self, column: str) -> IntArray:
        """A column of whole numbers."""
        values = self.numbers(column)
        wrong = (values != np.round(values)) | (np.abs(values) > 2**53)
        if wrong.any():
            raise self.error(int(np.argmax(wrong)), column, Phrase("problem-not-whole"))
        return values.astype(np.int64)

    def flags(self, column: str) -> BoolArray:
        """A column of 0 and 1."""
        cells = self.columns[column]
        for row, cell in enumerate(cells):
            if cell not in ("0", "1"):
                raise self.error(row, column, Phrase("problem-no-flag"))
        return np.array([cell == "1" for cell in cells], dtype=bool)


def read_csv(path: Path, header: str) -> CsvTable:
    """The table in a file with exactly this header."""
    data = read_bytes(path, _MOST_BYTES)
    check_lines(path, data)
    lines = decode(path, data).replace("\r\n", "\n").removesuffix("\n").split("\n")
    if lines[0] != header:
        raise InputError(Phrase("error-csv-header", {"file": path, "header": header, "found": printable(lines[0])}))
    names = header.split(",")
    rows = [line.split(",") for line in lines[1:]]
    for i, row in enumerate(rows):
        if len(row) != len(names):
            values = {"file": path, "line": i + 2, "found": len(row), "n": len(names)}
            raise InputError(Phrase("error-field-count" if lines[i + 1] else "error-empty-line", values))
    cells = zip(*rows, strict=True) if rows else ([] for _ in names)
    return CsvTable(path, {name: list(column) for name, column in zip(names, cells, strict=True)})
