"""A series of measured sets: its tables and its folder."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from types import ModuleType
from typing import Any, BinaryIO, Literal

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError, MissingPackage
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Observations
from spherecal.data.rig import Rig
from spherecal.data.session import CapturedSet, Session
from spherecal.detect.session_images import observed
from spherecal_files.atomic import Marker, write_folder_whole
from spherecal_files.capture_file import read_captured_sets
from spherecal_files.filesystem import create, new_file
from spherecal_files.json_file import finite, json_bytes, plain, plain_fields, software_entry
from spherecal_files.write_result import place_cell
from spherecal_measuring.measured_sets import BodyPose, Health, MeasuredSet, ObservedSet
from spherecal_measuring.measurer import Measurer, measure_sets
from spherecal_verify.participation import cameras_in_rig

Row = tuple[object, ...]  # numbers, texts, None

_SET = ("set", "id", "time_s")
_PAIRS = [(i, j) for i in range(6) for j in range(i, 6)]
COLUMNS: dict[str, tuple[str, ...]] = {
    "points": (
        *_SET, "target", "point", "x_mm", "y_mm", "z_mm", "sigma_x_mm", "sigma_y_mm", "sigma_z_mm",
        "cov_xy_mm2", "cov_xz_mm2", "cov_yz_mm2", "views", "dots", "speed_mm_s",
    ),
    "values": (*_SET, "kind", "name", "value", "unit", "u", "nominal", "deviation", "u_deviation"),
    "bodies": (
        *_SET, "body", "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz", "points", "points_left_out", "rms_mm",
        *(f"cov_{i + 1}{j + 1}" for i, j in _PAIRS),
    ),
    "cameras": (*_SET, "camera", "observations", "left_out", "rms_px"),
    "contradictions": (*_SET, "target", "camera", "views", "of"),
}  # fmt: skip
WHOLE_NUMBERS = frozenset({"set", "target", "views", "dots", "points", "observations", "left_out", "of"})
TEXTS = frozenset({"id", "point", "kind", "name", "unit", "body", "points_left_out", "camera"})


def rows_of(measured: MeasuredSet) -> Iterator[tuple[str, Row]]:
    """The rows of all tables for one set: (table, row)."""
    head = (measured.number, measured.id, measured.time_s)
    sigma, covariance = measured.sigma_mm, measured.covariance_mm2
    for i, name in enumerate(measured.names):
        c = covariance[i]
        yield (
            "points",
            (
                *head,
                name.target,
                name.point,
                *measured.points_mm[i].tolist(),
                *sigma[i].tolist(),
                *(float(c[j]) for j in ((0, 1), (0, 2), (1, 2))),
                int(measured.views[i]),
                int(measured.dots[i]),
                float(measured.speed_mm_s[i]),
            ),
        )
    for v in measured.values:
        yield "values", (*head, v.kind, v.name, v.value, v.unit, v.u, v.nominal, v.deviation, v.u_deviation)
    for body in measured.bodies:
        yield (
            "bodies",
            (
                *head,
                body.name,
                *body.translation_mm.tolist(),
                *quaternion(body).tolist(),
                body.points,
                " ".join(map(str, body.left_out)),
                body.rms_mm,
                *(float(body.covariance[i, j]) for i, j in _PAIRS),
            ),
        )
    for camera in measured.cameras:
        yield "cameras", (*head, camera.camera, camera.observations, camera.left_out, camera.rms_px)
    for c in measured.contradictions:
        yield "contradictions", (*head, c.target, c.camera or "", c.views, c.of)


def quaternion(body: BodyPose) -> np.ndarray:
    """The rotation from the body's frame to the world as w, x, y, z with w >= 0, (4,)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(body.rotation).as_quat(canonical=True)
    return np.array([w, x, y, z])


def set_json(measured: MeasuredSet, health: Health | None) -> dict[str, Any]:
    """One set as the stream has it."""
    upper = np.triu_indices(3)
    document: dict[str, Any] = {
        "set": measured.number,
        "id": measured.id,
        "time_s": finite(measured.time_s),
        "points": [
            {
                "target": name.target, "point": name.point, "xyz_mm": finite(measured.points_mm[i]),
                "covariance_mm2": finite(measured.covariance_mm2[i][upper]), "views": int(measured.views[i]),
                "dots": int(measured.dots[i]), "speed_mm_s": finite(measured.speed_mm_s[i]),
            }
            for i, name in enumerate(measured.names)
        ],
        "values": [plain_fields(v, "kind name value unit u nominal deviation u_deviation") for v in measured.values],
        "bodies": [plain_fields(b) | {"left_out": [str(n) for n in b.left_out]} for b in measured.bodies],
        "missing": [{"name": name, "reason": reason} for name, reason in measured.missing],
        "contradictions": plain(measured.contradictions),
        "cameras": [{"id": c.camera, **plain_fields(c, "observations left_out rms_px")} for c in measured.cameras],
        "skew_s": finite(measured.skew_s),
        "latency_s": finite(measured.latency_s),
    }  # fmt: skip
    if health is not None:
        document["moved"] = list(health.moved)
    return document


def health_json(health: Health) -> dict[str, Any]:
    """The rig's health as series.json has it."""
    return {
        "sets": health.sets,
        "cameras": [
            {
                "id": one.camera,
                **plain_fields(one, "observations rms_px calibrated_rms_px left_out"),
                "moved": one.moved is not None,
                "named_at_set": one.named_at,
                "move_px": None if one.moved is None else finite(one.moved.move_px),
            }
            for one in health.cameras
        ],
    }


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
    """Write all sets into a series folder whole, also where the measurement ends early; how many there were."""
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


def sets_of_session(session: Session, rig: Rig, context: Context | None = None) -> Iterator[ObservedSet]:
    """The session's sets in order; times in seconds since the first, where capture.json has them."""
    session = observed(session, context or Context())
    o = session.observations
    assert o is not None
    cameras_in_rig(session, o, rig, Phrase("same-settings"))
    if not len(o):
        raise InputError(Phrase("error-nothing-to-measure", {"folder": session.where}))
    captured = {one.id: one for one in ([] if session.folder is None else read_captured_sets(session.folder))}
    begin = min((one.taken for one in captured.values() if one.taken is not None), default=None)
    for number, name in enumerate(o.placements, start=1):
        mine = o.placement == o.placements.index(name)
        time_s, exposure_s = _times(captured.get(name), begin)
        yield ObservedSet(number, name, one_set(o, mine), time_s, exposure_s)


def one_set(o: Observations, mine: np.ndarray) -> Observations:
    """Some observations as those of one set, with a single placement; `mine`: which are the set's, (n,) bool."""
    own = o.select(mine)
    name = o.placements[int(own.placement[0])] if len(own) else ""
    return Observations(
        (name,), o.cameras, o.points, np.zeros(len(own), dtype=np.int64), own.camera, own.target, own.point, own.uv,
        own.sigma,
    )  # fmt: skip


def _times(captured: CapturedSet | None, begin: datetime | None) -> tuple[float | None, dict[str, float] | None]:
    """The moment of a set and of its exposures, s since the first set."""
    if captured is None or begin is None:
        return None, None
    exposed = {
        camera: (frame.exposed - begin).total_seconds()
        for camera, frame in captured.frames.items()
        if frame.exposed is not None
    }
    if exposed:
        return float(np.mean(list(exposed.values()))), exposed
    return None if captured.taken is None else (captured.taken - begin).total_seconds(), None


def run(
    sets: Iterable[ObservedSet],
    measurer: Measurer,
    seen: Callable[[MeasuredSet], None],
    output: Path | None = None,
    table: TableKind = "csv",
    context: Context | None = None,
) -> int:
    """Measure all sets, give each to `seen`, record them in `output`, also where it ends early; how many there were."""
    measured = measure_sets(sets, measurer, context)
    if output is not None:
        return write_series(measured, measurer, output, table, seen)
    count = 0
    for one in measured:
        seen(one)
        count += 1
    return count
