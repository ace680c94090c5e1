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
from spherecal.base.file_reading import read_file
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import PlacedSphere, Rig
from spherecal.geometry.camera import project
from spherecal_files.filesystem import write_below
from spherecal_files.findings_file import with_values
from spherecal_files.json_file import JsonValue, json_bytes, read_json
from spherecal_files.rig_file import RIG, read_rig
from spherecal_files.table_file import Table, read_table
from spherecal_files.verification_file import VERIFICATION, BarReport, BarRow, Override
from spherecal_files.write_result import POINT_COLUMNS, RESIDUAL_COLUMNS, SPHERE_COLUMNS
from spherecal_files.write_verification import BAR_COLUMNS

_MOST_BYTES = 128 << 20  # two million residuals


def read_csv(path: Path, header: str) -> Table:
    """The table in a file of a result with exactly this header."""
    return read_table(
        path, _MOST_BYTES, (tuple(header.split(",")),),
        lambda file, found: Phrase("error-csv-header", {"file": file, "header": header, "found": found}),
    )  # fmt: skip


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
        BarRow(bar, from_mark, to_mark, pose, length, reference, error, None if isnan(sigma) else sigma, views)
        for bar, from_mark, to_mark, pose, length, reference, error, sigma, views in zip(
            *(table.names(name) for name in ("bar", "from", "to", "pose")),
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
    rig = read_rig(folder / "rig.json")
    points = _read_points(folder / "points.csv")
    residuals = _read_residuals(folder / "residuals.csv", rig, points)
    table = read_csv(folder / "spheres.csv", SPHERE_COLUMNS)
    sizes = table.lengths("radius_mm").tolist(), table.lengths("radial_sd_mm", may_be_empty=True).tolist()
    spheres = zip(table.names("placement"), _columns(table, ("x_mm", "y_mm", "z_mm")), *sizes, strict=True)
    return Result(
        folder=folder, rig=rig, software=_read_software(folder / "rig.json"), points=points, residuals=residuals,
        spheres=tuple(PlacedSphere(*row) for row in spheres), bars=read_bar_report(folder),
    )  # fmt: skip


def _read_software(path: Path) -> Software:
    fields = read_json(path, RIG.name, RIG.version).fields((), ("software",))
    if "software" not in fields:
        return Software("unknown program", "", ())
    entries = fields["software"].entries()
    texts = {key: str(value.value) for key, value in entries.items() if isinstance(value.value, (str, int, float))}
    name, version = texts.pop("name", "unknown program"), texts.pop("version", "")
    return Software(name, version, tuple(sorted(texts.items())))


def _columns(table: Table, names: tuple[str, ...], may_be_empty: bool = False) -> FloatArray:
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
