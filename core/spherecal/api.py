"""The Python interface: what `import spherecal` offers, each name loaded on first use (docs/api.md).

Nothing here computes by itself: each function is the one that the command of the same name uses.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.calibrate import CalibrationSettings, Method, calibrate
from spherecal.context import Context, Progress
from spherecal.errors import Cancelled, InputError, OutputError, SpherecalError
from spherecal.export.cameras import Unit
from spherecal.export.frame import define_frame as _define_frame
from spherecal.export.frame import in_frame
from spherecal.export.write_export import DEFAULT_MAX_LOSS_PX, FORMATS, Exported
from spherecal.export.write_export import export_rig as _export_rig
from spherecal.findings import Finding
from spherecal.geometry.camera import project
from spherecal.geometry.user_frame import FrameDefinition, UserFrame
from spherecal.observe import observed
from spherecal.rig import Calibration, Quality, Rig, RigCamera
from spherecal.session.frame_file import read_frame, write_frame
from spherecal.session.model import Session
from spherecal.session.read_session import read_session
from spherecal.session.rig_file import read_rig
from spherecal.session.write_result import write_result
from spherecal.verify.bars import verify
from spherecal.verify.outlying_views import Views, triangulate_checked
from spherecal.verify.uncertainty import PointErrors, point_errors
from spherecal.verify.verification import Verification
from spherecal.verify.write_verification import write_verification

__all__ = [
    "FORMATS",
    "Calibration",
    "CalibrationSettings",
    "Cancelled",
    "Context",
    "Exported",
    "Finding",
    "InputError",
    "MeasuredPoints",
    "OutputError",
    "Progress",
    "Quality",
    "Rig",
    "RigCamera",
    "Session",
    "SpherecalError",
    "UserFrame",
    "Verification",
    "calibrate_session",
    "define_frame",
    "export_rig",
    "load_frame",
    "load_rig",
    "load_session",
    "project_points",
    "save_calibration",
    "save_frame",
    "save_verification",
    "triangulate_points",
    "verify_rig",
]

# What the detector reaches on clean prints is better, a laser dot or a feature matcher worse; the points' covariance
# is proportional to its square, so that a caller who knows better can say so.
DEFAULT_SIGMA_PX = 0.1
_AT_ONCE = 500  # points: 100 cameras with 15 parameters each take 18 MB

AnyPath = str | os.PathLike[str]


@dataclass(frozen=True)
class MeasuredPoints:
    """Points measured with a rig: `points_mm` (n, 3) in the world of rig.json or the user's frame, NaN for none.

    `covariance_mm2` (n, 3, 3): cameras (if the rig's covariance is there) and image noise, scale included. `views` (n,)
    counts the cameras that a point rests on; `used` says of each camera which of its image points took part, (n,);
    `contradicting` (n,) marks points given up because their views do not meet; `residuals_px` of each camera (n, 2) is
    predicted - observed.
    """

    points_mm: FloatArray
    covariance_mm2: FloatArray
    views: IntArray
    contradicting: BoolArray
    used: Mapping[str, BoolArray]
    residuals_px: Mapping[str, FloatArray]


def load_session(folder: AnyPath) -> Session:
    """The session in a folder; InputError names the file and the place in it that is not as it has to be."""
    return read_session(Path(folder))


def load_rig(path: AnyPath) -> Rig:
    """The rig in a rig.json, or in the result folder that holds one; with its covariance where that lies beside it."""
    path = Path(path)
    return read_rig(path / "rig.json" if path.is_dir() else path)


def calibrate_session(
    session: Session | AnyPath, method: Method = "auto", *, intrinsics: Literal["free", "fixed"] = "free",
    seed: int = 0, settings: CalibrationSettings | None = None, context: Context | None = None,
) -> Calibration:  # fmt: skip
    """The calibrated rig of a session or session folder, the same as `spherecal calibrate` writes.

    `settings`, where given, stand for `method`, `intrinsics` and `seed`. Ask `rig.quality.valid` before you use it: a
    rig that could not be calibrated is a result too, whose findings say why. InputError for what cannot be used,
    Cancelled where the context says so.
    """
    chosen = settings or CalibrationSettings(method=method, intrinsics=intrinsics, seed=seed)
    return calibrate(_session(session), chosen, context)


def save_calibration(calibration: Calibration, folder: AnyPath, details: Mapping[str, Any] | None = None) -> None:
    """Write the result folder, whole or not at all; `details` go into the entry `software` of rig.json."""
    write_result(calibration, Path(folder), details)


def verify_rig(session: Session | AnyPath, rig: Rig | AnyPath, context: Context | None = None) -> Verification:
    """The check bars of a session measured with a rig; InputError where the session has nothing to measure."""
    context = context or Context()
    chosen = rig if isinstance(rig, Rig) else load_rig(rig)
    return verify(observed(_session(session), context, bar_poses_only=True), chosen, context)


def save_verification(verification: Verification, folder: AnyPath, rig_file: AnyPath) -> None:
    """Write bars.csv and verification.json into the result folder of the rig that was verified."""
    write_verification(verification, Path(folder), Path(rig_file))


def define_frame(
    result: AnyPath, origin: str | None = None, x: str | None = None, xy: str | None = None,
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0), turns: Sequence[str] = (),
) -> UserFrame:  # fmt: skip
    """The user's frame by three places of a result folder: the origin, one on the +X axis, one in the XY plane.

    A place is a placement's id (the ball's centre there), POSE/MARK of a bar that was verified, or
    PLACEMENT/TARGET/POINT of points.csv; none of them: the reference camera's frame. The origin's place lies at
    `offset_mm`; then the axes are turned: "x90", "x-90", "y90", "y-90", "z90", "z-90". InputError for places that are
    not there, too near together, or nearly in a line.
    """
    return _define_frame(Path(result), FrameDefinition(origin, x, xy, offset_mm, tuple(turns)))


def load_frame(path: AnyPath) -> UserFrame:
    """The user's frame in a frame.json; InputError names what is wrong in it."""
    return read_frame(Path(path))


def save_frame(frame: UserFrame, path: AnyPath) -> None:
    """Write frame.json, whole or not at all."""
    write_frame(frame, Path(path))


def export_rig(
    rig: Rig, format_name: str, output: AnyPath, unit: Unit | None = None, max_loss_px: float = DEFAULT_MAX_LOSS_PX,
    frame: UserFrame | None = None,
) -> Exported:  # fmt: skip
    """Write the rig in a format of others (FORMATS) and read it back; the largest difference is in the answer.

    With a `frame` all poses are given in it; InputError where it belongs to a rig with another reference camera.
    """
    return _export_rig(rig, format_name, Path(output), unit, max_loss_px, frame)


def project_points(rig: Rig, points_mm: ArrayLike, frame: UserFrame | None = None) -> dict[str, FloatArray]:
    """Where each camera sees points (n, 3) of the rig's world, or of a `frame`: (n, 2) px, NaN for points behind it."""
    rig = rig if frame is None else in_frame(rig, frame)
    points = _rows(points_mm, 3, "points_mm")
    images: dict[str, FloatArray] = {}
    for camera in rig.cameras:
        x = points @ camera.rotation.T + camera.translation_mm
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            uv = project(x, camera.intrinsics)
        images[camera.id] = np.where(x[:, 2:] > 0, uv, np.nan)
    return images


def triangulate_points(
    rig: Rig, image_points: Mapping[str, ArrayLike], sigma_px: float = DEFAULT_SIGMA_PX,
    frame: UserFrame | None = None,
) -> MeasuredPoints:  # fmt: skip
    """Points from their images: for each camera (n, 2) px, row i of all cameras the same point, NaN where not seen.

    With three or more views a grossly wrong one is left out. `sigma_px` is the standard uncertainty of an image
    coordinate; from 30 redundant observations on, the residuals correct it. With a `frame` points and covariances are
    given in it, without the frame's own uncertainty. InputError for a camera that the rig does not have, for arrays of
    another shape and for a frame of another rig.
    """
    rig = rig if frame is None else in_frame(rig, frame)
    if not sigma_px > 0:
        raise InputError(f"sigma_px must be above 0, but is {sigma_px:g}.")
    arrays, n = _image_points(rig, image_points)
    seen = [(c, uv, np.flatnonzero(np.isfinite(uv).all(axis=1))) for c, uv in arrays.items()]
    feature = np.concatenate([rows for _, _, rows in seen]) if seen else np.zeros(0, dtype=int)
    camera = np.concatenate([np.full(len(rows), c) for c, _, rows in seen]) if seen else feature
    uv = np.concatenate([uv[rows] for _, uv, rows in seen]) if seen else np.zeros((0, 2))
    views = Views(
        feature, camera, uv, np.full(uv.shape, sigma_px), n,
        np.array([one.intrinsics for one in rig.cameras]).reshape(-1, 16),
        np.array([one.rotation for one in rig.cameras]).reshape(-1, 3, 3),
        np.array([one.translation_mm for one in rig.cameras]).reshape(-1, 3),
    )  # fmt: skip
    checked = triangulate_checked(views, 1.0)
    covariance = _point_covariance(rig, views, point_errors(views, checked, rig.covariance, rig))
    points = np.where(checked.contradicting[:, None], np.nan, checked.points.points)
    used: dict[str, BoolArray] = {}
    residuals: dict[str, FloatArray] = {}
    for c, _, rows in seen:
        mine = camera == c
        name = rig.cameras[c].id
        used[name], residuals[name] = np.zeros(n, dtype=bool), np.full((n, 2), np.nan)
        used[name][rows] = checked.kept[mine] & np.isfinite(points[rows, 0])
        residuals[name][rows] = checked.points.residual[mine]
    return MeasuredPoints(points, covariance, checked.points.views, checked.contradicting, used, residuals)


def _point_covariance(rig: Rig, views: Views, errors: PointErrors) -> FloatArray:
    """Covariance (n, 3, 3): image noise, and the cameras' share G C G' with all their correlations."""
    width, covariance = errors.by_camera.shape[2], errors.covariance.copy()
    for first in range(0, views.n_features, _AT_ONCE):
        n = min(_AT_ONCE, views.n_features - first)
        rows = np.flatnonzero((views.feature >= first) & (views.feature < first + n))
        by_parameter = np.zeros((n, 3, len(rig.cameras), width))
        by_parameter[views.feature[rows] - first, :, views.camera[rows]] = errors.by_camera[rows]
        g = by_parameter.reshape(n, 3, len(rig.cameras) * width)
        covariance[first : first + n] += np.einsum("nip,njp->nij", g @ errors.cameras, g)
    return covariance


def _session(session: Session | AnyPath) -> Session:
    return session if isinstance(session, Session) else load_session(session)


def _image_points(rig: Rig, image_points: Mapping[str, ArrayLike]) -> tuple[dict[int, FloatArray], int]:
    index = {camera.id: c for c, camera in enumerate(rig.cameras)}
    arrays: dict[int, FloatArray] = {}
    for name, values in image_points.items():
        if name not in index:
            raise InputError(f'The rig has no camera "{name}".', f"It has: {', '.join(index) or 'none'}.")
        arrays[index[name]] = _rows(values, 2, f"image points of {name}")
    lengths = {len(values) for values in arrays.values()}
    if len(lengths) > 1:
        raise InputError(
            f"The cameras have different numbers of image points ({', '.join(map(str, sorted(lengths)))}).",
            "Row i of every camera is the same point; put NaN where a camera does not see it.",
        )
    return dict(sorted(arrays.items())), lengths.pop() if lengths else 0


def _rows(values: ArrayLike, width: int, what: str) -> FloatArray:
    array = np.asarray(values, dtype=float)
    if array.ndim != 2 or array.shape[1] != width:
        raise InputError(f"{what} must be an array of shape (n, {width}), but have the shape {array.shape}.")
    return array
