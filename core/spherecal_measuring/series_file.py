"""The series folder: series.json and a table each of points, values, bodies, cameras and contradictions.

Tables are written set by set while the measurement goes on; the folder is put in its place, whole, at the end.
"""

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from typing import Any, BinaryIO, Literal

from spherecal.base.errors import MissingPackage
from spherecal.base.filesystem import create, new_file
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import Marker, write_folder_whole
from spherecal.files.json_file import json_bytes, software_entry
from spherecal.files.write_result import place_cell
from spherecal_measuring.measured_sets import MeasuredSet
from spherecal_measuring.measurer import Measurer
from spherecal_measuring.series_tables import COLUMNS, TEXTS, WHOLE_NUMBERS, Row, health_json, rows_of

TableKind = Literal["csv", "parquet"]
FORMAT = "spherecal/series"
VERSION = 1
SERIES = Marker(
    "series.json",
    FORMAT,
    frozenset({"series.json", *(f"{name}.{kind}" for name in COLUMNS for kind in ("csv", "parquet"))}),
)
_ROWS_AT_ONCE = 20_000  # of a row group


def check_table_kind(kind: TableKind) -> None:
    """Check that tables of a kind can be written here."""
    if kind == "parquet":
        _pyarrow()


def _pyarrow() -> tuple[ModuleType, ModuleType]:
    try:
        import pyarrow  # pyright: ignore[reportMissingImports]
        import pyarrow.parquet  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise MissingPackage(Phrase("error-needs-pyarrow")) from None
    return pyarrow, pyarrow.parquet


def write_series(
    sets: Iterable[MeasuredSet],
    measurer: Measurer,
    folder: Path,
    table: TableKind = "csv",
    seen: Callable[[MeasuredSet], None] | None = None,
) -> int:
    """Write all sets into a series folder, whole or not at all; how many there were.

    What ends the measurement early, Ctrl-C or a lost camera, is raised again once all sets so far are written. Before
    the first set nothing is written.
    """
    check_table_kind(table)
    count = 0
    ended: BaseException | None = None

    def build(new: Path) -> None:
        nonlocal count, ended
        with ExitStack() as stack:
            tables = {name: _table(new, name, table, stack) for name in COLUMNS}
            try:
                for measured in sets:
                    _keep(tables, measured)
                    count += 1
                    if seen is not None:
                        seen(measured)
            except _NotWrittenError as error:
                raise error.cause from None
            except (Exception, KeyboardInterrupt) as error:
                if not count:
                    raise
                ended = error
            for one in tables.values():
                one.end()
        create(new / SERIES.file, json_bytes(_about(measurer, count, table)))

    write_folder_whole(folder, build, SERIES)
    if ended is not None:
        raise ended
    return count


class _NotWrittenError(Exception):
    """A set could not be written: the folder cannot be used."""

    def __init__(self, cause: OSError) -> None:
        super().__init__(str(cause))
        self.cause = cause


def _keep(tables: Mapping[str, Any], measured: MeasuredSet) -> None:
    try:
        for name, row in rows_of(measured):
            tables[name].add(row)
    except OSError as error:
        raise _NotWrittenError(error) from error


def _about(measurer: Measurer, count: int, table: TableKind) -> dict[str, Any]:
    rig = measurer.rig
    return {
        "format": FORMAT,
        "version": VERSION,
        "sets": count,
        "table": table,
        "rig": {"input_sha256": rig.input_sha256, "reference_camera": rig.reference_camera},
        "health": health_json(measurer.health),
        "software": software_entry(None),
    }


class _CsvTable:
    def __init__(self, file: BinaryIO, columns: tuple[str, ...]) -> None:
        self._file = file
        file.write((",".join(columns) + "\n").encode())

    def add(self, row: Row) -> None:
        self._file.write((",".join(map(_cell, row)) + "\n").encode())

    def end(self) -> None:
        """Nothing is held back."""


def _cell(value: object) -> str:
    if value is None or isinstance(value, float):
        return place_cell(value)
    return str(value)


class _ParquetTable:
    def __init__(self, file: BinaryIO, columns: tuple[str, ...], stack: ExitStack) -> None:
        arrow, parquet = _pyarrow()
        kinds = {True: arrow.string(), False: arrow.float64()}
        fields = [(c, arrow.int64() if c in WHOLE_NUMBERS else kinds[c in TEXTS]) for c in columns]
        self._arrow, self._schema, self._rows = arrow, arrow.schema(fields), list[Row]()
        self._writer = stack.enter_context(parquet.ParquetWriter(file, self._schema))

    def add(self, row: Row) -> None:
        self._rows.append(row)
        if len(self._rows) >= _ROWS_AT_ONCE:
            self.end()

    def end(self) -> None:
        """Write the rows held back."""
        columns = [list(column) for column in zip(*self._rows, strict=True)]
        if columns:
            arrays = [
                self._arrow.array(values, field.type, from_pandas=True)  # NaN is null
                for values, field in zip(columns, self._schema, strict=True)
            ]
            self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))
        self._rows = []


def _table(folder: Path, name: str, kind: TableKind, stack: ExitStack) -> _CsvTable | _ParquetTable:
    file = stack.enter_context(new_file(folder, f"{name}.{kind}"))
    if kind == "csv":
        return _CsvTable(file, COLUMNS[name])
    return _ParquetTable(file, COLUMNS[name], stack)
