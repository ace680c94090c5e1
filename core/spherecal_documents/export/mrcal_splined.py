"""mrcal's splined lens models (mrcal.secretsauce.net/splined-models.html): they hold what a lens does beyond its model.

A ray's stereographic projection `u = 2 tan(theta / 2)` is looked up in a surface of cubic B-splines: the image point is
`f (u + du(u)) + c`. The surface's control points are those nearest to the lens with its field, by least squares.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import splu

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.geometry.camera import undistort
from spherecal_documents.export.file_cameras import FileCamera, FileRig, numbers
from spherecal_documents.export.format import Format
from spherecal_documents.export.mrcal import ENDING, cameramodel, read_model, read_pose
from spherecal_documents.export.refit import pixel_grid

# Columns of control points, until the fit is good enough. A field of 0.3 px, two periods per image, needs 24.
_COLUMNS = (16, 24, 36, 54)
MOST_PX = 0.01
_SAMPLES = 4  # rays between two control points along an axis
_RIDGE = 1e-9  # of the normal equations: for control points beyond the image, which no ray asks for
_NAME = re.compile(r"LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=(\d+)_Ny=(\d+)_fov_x_deg=(\d+)")


@dataclass(frozen=True)
class Spline:
    """A splined model: control points (rows, columns, 2) of u about 0, and how far it reaches to either side."""

    points: FloatArray
    fov_x_deg: int

    @property
    def name(self) -> str:
        """The model's name as mrcal has it."""
        rows, columns, _ = self.points.shape
        return f"LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx={columns}_Ny={rows}_fov_x_deg={self.fov_x_deg}"

    def design(self, u: FloatArray) -> csr_array:
        """Weights (n, rows * columns) of the control points at stereographic projections (n,2)."""
        rows, columns, _ = self.points.shape
        pitch = 4 * np.tan(np.deg2rad(self.fov_x_deg) / 4) / (columns - 3)
        parts = []
        for along, count in ((u[:, 1], rows), (u[:, 0], columns)):
            at = np.clip(along / pitch + (count - 1) / 2, 1, count - 2 - 1e-12)
            parts.append(BSpline.design_matrix(at, np.arange(-2.0, count + 2), 3).toarray())
        return csr_array((parts[0][:, :, None] * parts[1][:, None, :]).reshape(len(u), -1))


@dataclass(frozen=True)
class SplinedCamera(FileCamera):
    """A camera whose lens is a splined model; of `intrinsics` focal lengths and principal point count alone."""

    spline: Spline | None = None

    def project(self, world: FloatArray) -> FloatArray:
        """Image points (n, 2) px of world points (n, 3)."""
        assert self.spline is not None
        u = stereographic(world @ self.placed.rotation.T + self.placed.translation)
        bent = u + self.spline.design(u) @ self.spline.points.reshape(-1, 2)
        return bent * self.intrinsics[:2] + self.intrinsics[2:4]


def stereographic(points: FloatArray) -> FloatArray:
    """Projections (n,2) of points (n,3) of the camera's frame: 2 tan(theta / 2) from the axis."""
    return 2 * points[:, :2] / (np.linalg.norm(points, axis=1) + points[:, 2])[:, None]


def _seen(camera: FileCamera, columns: int) -> tuple[FloatArray, FloatArray]:
    """Stereographic projections (n,2), and image points (n,2) px, over the image where the lens can be inverted."""
    width, height = camera.size
    uv = pixel_grid(camera.size, (_SAMPLES * columns, _SAMPLES * int(np.ceil(columns * height / width))))
    xy, good = undistort(uv if camera.field is None else uv - camera.field.at(uv), camera.intrinsics)
    return stereographic(np.column_stack([xy, np.ones(len(xy))])[good]), uv[good]


def fitted(camera: FileCamera) -> tuple[Spline, float]:
    """The nearest splined model of a camera's lens with its field, and the largest difference in px over the image."""
    spline, off = None, np.inf
    for columns in _COLUMNS:
        u, uv = _seen(camera, columns)
        reach = np.abs(u).max(axis=0) * 1.001
        fov = int(np.ceil(np.rad2deg(4 * np.arctan(reach[0] / 2))))
        pitch = 4 * np.tan(np.deg2rad(fov) / 4) / (columns - 3)
        rows = int(np.ceil(2 * reach[1] / pitch)) + 3
        spline = Spline(np.zeros((rows, columns, 2)), fov)
        wanted = (uv - camera.intrinsics[2:4]) / camera.intrinsics[:2] - u
        design = spline.design(u)
        normal = (design.T @ design + _RIDGE * len(u) / columns / rows * eye_array(rows * columns)).tocsc()
        spline = Spline(splu(normal).solve(design.T @ wanted).reshape(rows, columns, 2), fov)
        u, uv = _seen(camera, columns + 1)  # between the rays that it was fitted to
        bent = (u + spline.design(u) @ spline.points.reshape(-1, 2)) * camera.intrinsics[:2] + camera.intrinsics[2:4]
        off = float(np.linalg.norm(bent - uv, axis=1).max())
        if off <= MOST_PX:
            break
    assert spline is not None
    return spline, off


def _write_splined(rig: FileRig) -> Mapping[str, str]:
    files = {}
    for name, camera in zip(rig.safe_names(), rig.cameras, strict=True):
        spline, off = fitted(camera)
        if off > MOST_PX:
            raise InputError(Phrase("error-no-spline", {"camera": camera.id, "max_px": off, "limit_px": MOST_PX}))
        lens = f"{numbers(camera.intrinsics[:4])}, {numbers(spline.points.ravel())}"
        files[f"{name}{ENDING}"] = cameramodel(camera, rig, spline.name, lens)
    return files


def _read_camera(path: Path) -> SplinedCamera:
    f = read_model(path).fields(("lensmodel", "intrinsics", "imagersize", "rt_cam_ref"))
    named = _NAME.fullmatch(f["lensmodel"].text())
    if named is None:
        raise f["lensmodel"].error("is no cubic splined model")
    columns, rows, fov = map(int, named.groups())
    found = f["intrinsics"].numbers(4 + 2 * rows * columns)
    width, height = (side.integer(1) for side in f["imagersize"].items(2))
    lens = np.zeros(16)
    lens[:4] = found[:4]
    spline = Spline(np.reshape(found[4:], (rows, columns, 2)), fov)
    pose = read_pose(f["rt_cam_ref"])
    return SplinedCamera(path.name.removesuffix(ENDING), (width, height), lens, pose, spline=spline)


MRCAL_SPLINED = Format(
    "mrcal-splined",
    "mrcal cameramodel with splines",
    12,
    ("m", "mm"),
    _write_splined,
    lambda folder: [_read_camera(path) for path in sorted(folder.glob(f"*{ENDING}"))],
    folder=True,
    ids=FileRig.safe_names,
    fisheye=True,
    fields=True,
)
