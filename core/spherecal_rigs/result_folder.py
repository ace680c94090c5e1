"""A result folder read whole, its tables with checked columns, and its verification by itself."""

import json
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from math import isnan
from pathlib import Path

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.filesystem import read_file, write_below
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import name_problem
from spherecal.data.rig import PlacedSphere, Rig
from spherecal.files.atomic import read_unchanged
from spherecal.files.findings_file import with_values
from spherecal.files.json_file import JsonValue, check_lines, decode, json_bytes, printable, read_bytes, read_json
from spherecal.files.rig_file import RIG, read_rig
from spherecal.files.write_result import POINT_COLUMNS, RESIDUAL_COLUMNS, SPHERE_COLUMNS
from spherecal.geometry.camera import project
from spherecal.verify.verification_file import VERIFICATION, BarReport, BarRow, Override
from spherecal.verify.write_verification import BAR_COLUMNS

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


_MOST_FILE_BYTES = 1 << 30


def read_bar_report(folder: Path) -> BarReport | None:
    """The verification in a result folder; None where there is none."""
    table, document = folder / "bars.csv", folder / "verification.json"
    if not table.exists() and not document.exists():
        return None
    for path, other in ((table, document), (document, table)):
        if not path.exists():
            raise InputError(Phrase("error-verification-part", {"file": path, "other": other.name}))
    found = VERIFICATION.read(document)
    return replace(found, measured=_read_rows(table), findings=with_values(found.findings, folder))


def _read_rows(path: Path) -> tuple[BarRow, ...]:
    table = read_csv(path, BAR_COLUMNS)
    u = table.lengths("u_mm", may_be_empty=True)
    return tuple(
        BarRow(bar, pose, start, end, length, reference, error, None if isnan(sigma) else sigma, views)
        for bar, pose, start, end, length, reference, error, sigma, views in zip(
            *(table.names(name) for name in ("bar", "pose", "from", "to")),
            *(table.numbers(name).tolist() for name in ("length_mm", "reference_mm", "error_mm")),
            u.tolist(),
            table.whole_numbers("views").tolist(),
            strict=True,
        )
    )


def refuse_failed(folder: Path) -> Override | None:
    """Refuse the rig of a folder whose verification failed, unless somebody answers for it: then the override."""
    path = folder / VERIFICATION.file
    if not path.is_file():
        return None
    found = VERIFICATION.read(path)
    if found.failed and found.override is None:
        raise InputError(Phrase("error-verification-failed", {"file": path, "folder": folder}))
    return found.override if found.failed else None


def answer_for(folder: Path, by: str, reason: str) -> None:
    """Write into a failed verification who uses its rig all the same, and why; every later headline says so."""
    path = folder / VERIFICATION.file
    if not path.is_file() or not VERIFICATION.read(path).failed:
        raise InputError(Phrase("error-nothing-to-override", {"file": path}))
    by, reason = " ".join(by.split()), " ".join(reason.split())
    if not by or not reason:
        raise InputError(Phrase("error-override-needs-name"))
    at = datetime.now(UTC).replace(microsecond=0).isoformat()
    document = json.loads(read_file(path, _MOST_FILE_BYTES)) | {"override": {"by": by, "reason": reason, "at": at}}
    VERIFICATION.kind.read(JsonValue(document, path))  # a control character would make the file unreadable
    write_below(folder, VERIFICATION.file, json_bytes(document))


RESULT_FILES = (
    "rig.json", "findings.json", "covariance.npy", "points.csv", "residuals.csv", "spheres.csv", "bars.csv",
    "image_motions.csv", "verification.json",
)  # fmt: skip


@dataclass(frozen=True)
class Software:
    """Who made the result: the program, its version, and what else rig.json notes (method, seed)."""

    name: str
    version: str
    details: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Points:
    """The points found, by row: names, places (n, 3), sigmas (n, 3) with NaN where unknown, views (n,)."""

    placement: list[str]
    target: IntArray
    point: list[str]
    xyz_mm: FloatArray
    sigma_mm: FloatArray
    views: IntArray


@dataclass(frozen=True)
class Residuals:
    """The observations: residuals (n, 2) px and predicted image points (n, 2) px, NaN where there is none."""

    placement: list[str]
    camera: list[str]
    target: IntArray
    point: list[str]
    du_dv: FloatArray
    used: BoolArray
    predicted: FloatArray

    @cached_property
    def rows_of(self) -> dict[str, IntArray]:
        """The rows of each camera, by its id."""
        rows: dict[str, list[int]] = {}
        for row, camera in enumerate(self.camera):
            rows.setdefault(camera, []).append(row)
        return {camera: np.array(own) for camera, own in rows.items()}


@dataclass(frozen=True)
class Result:
    """All that a result folder says; `bars` is None where nothing was verified."""

    folder: Path
    rig: Rig
    software: Software
    points: Points
    residuals: Residuals
    spheres: tuple[PlacedSphere, ...]
    bars: BarReport | None

    @property
    def has_scale(self) -> bool:
        """Whether lengths are in millimetres."""
        return self.rig.scale.source != "none"

    @property
    def unit(self) -> str:
        """The unit of lengths."""
        return "mm" if self.has_scale else "units"

    @property
    def camera_ids(self) -> list[str]:
        """The cameras that are placed or have observations, sorted."""
        return sorted({camera.id for camera in self.rig.cameras} | set(self.residuals.camera))


def read_result(folder: Path) -> Result:
    """Read a result folder."""
    if not (folder / "rig.json").exists():
        raise InputError(Phrase("error-no-rig" if folder.is_dir() else "error-no-result-folder", {"folder": folder}))
    return read_unchanged(folder, _read_result)


def _read_result(folder: Path) -> Result:
    rig = read_rig(folder / "rig.json")
    points = _read_points(folder / "points.csv")
    return Result(
        folder=folder, rig=rig, software=_read_software(folder / "rig.json"), points=points,
        residuals=_read_residuals(folder / "residuals.csv", rig, points),
        spheres=_read_spheres(folder / "spheres.csv"), bars=read_bar_report(folder),
    )  # fmt: skip


def _read_software(path: Path) -> Software:
    fields = read_json(path, RIG.name, RIG.version).fields((), ("software",))
    if "software" not in fields:
        return Software("unknown program", "", ())
    entries = fields["software"].entries()
    texts = {key: str(value.value) for key, value in entries.items() if isinstance(value.value, (str, int, float))}
    name, version = texts.pop("name", "unknown program"), texts.pop("version", "")
    return Software(name, version, tuple(sorted(texts.items())))


def _columns(table: CsvTable, names: tuple[str, ...], may_be_empty: bool = False) -> FloatArray:
    return np.column_stack([table.numbers(name, may_be_empty) for name in names])


def _read_points(path: Path) -> Points:
    table = read_csv(path, POINT_COLUMNS)
    sigmas = [table.lengths(f"sigma_{axis}_mm", may_be_empty=True) for axis in "xyz"]
    return Points(
        table.names("placement"), table.whole_numbers("target"), table.names("point"),
        _columns(table, ("x_mm", "y_mm", "z_mm")), np.column_stack(sigmas), table.whole_numbers("views"),
    )  # fmt: skip


def _read_residuals(path: Path, rig: Rig, points: Points) -> Residuals:
    table = read_csv(path, RESIDUAL_COLUMNS)
    du_dv = _columns(table, ("du", "dv"), may_be_empty=True)
    used = table.flags("used")
    if (lacking := used & np.isnan(du_dv).any(axis=1)).any():
        raise table.error(int(np.argmax(lacking)), "used", Phrase("problem-used-no-residual"))
    placement, camera, point = (table.names(name) for name in ("placement", "camera", "point"))
    target = table.whole_numbers("target")
    row_of = {
        key: row for row, key in enumerate(zip(points.placement, points.target.tolist(), points.point, strict=True))
    }
    rows = np.array(
        [row_of.get(key, -1) for key in zip(placement, target.tolist(), point, strict=True)], dtype=np.int64
    )
    predicted = _predict(rig, np.array(camera, dtype=object), rows, points.xyz_mm)
    return Residuals(placement, camera, target, point, du_dv, used, predicted)


def _predict(rig: Rig, camera: np.ndarray, rows: IntArray, xyz: FloatArray) -> FloatArray:
    """The image points (n, 2) of the points in `rows` (-1: not found); NaN where there is none."""
    predicted = np.full((len(rows), 2), np.nan)
    for placed in rig.cameras:
        own = np.flatnonzero((camera == placed.id) & (rows >= 0))
        x_camera = xyz[rows[own]] @ placed.rotation.T + placed.translation_mm
        in_front = x_camera[:, 2] > 0
        predicted[own[in_front]] = project(x_camera[in_front], placed.intrinsics)
    return predicted


def _read_spheres(path: Path) -> tuple[PlacedSphere, ...]:
    table = read_csv(path, SPHERE_COLUMNS)
    centres = _columns(table, ("x_mm", "y_mm", "z_mm"))
    radii, sds = table.lengths("radius_mm"), table.lengths("radial_sd_mm", may_be_empty=True)
    return tuple(
        PlacedSphere(name, centre, float(radius), float(sd))
        for name, centre, radius, sd in zip(table.names("placement"), centres, radii, sds, strict=True)
    )
