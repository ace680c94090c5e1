"""The calibrated rig: the frozen result of a calibration."""

from __future__ import annotations  # help() then shows ArrayLike by its name

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray
from spherecal.base.errors import InputError, needing
from spherecal.base.messages.values import Phrase
from spherecal.base.notebook import html_table
from spherecal.data.findings import Finding, counted
from spherecal.data.from_arrays import of_kind
from spherecal.data.observations import Features, Observations
from spherecal.data.rig_camera import CameraSigma, ImageSize, OpenCVCamera, RigCamera, camera_of_opencv, table_row
from spherecal.geometry.length_uncertainty import LengthMap

if TYPE_CHECKING:
    import pandas  # pyright: ignore[reportMissingImports]
    from mpl_toolkits.mplot3d.axes3d import Axes3D

__all__ = ["CameraSigma", "RigCamera"]


@dataclass(frozen=True)
class RigScale:
    """Where the scale came from and its relative standard uncertainty (None where it is not known).

    `source`: `target_spacing`, `bar`, `board`, `ball`; `given` where lengths are millimetres by somebody else's word,
    `none` where they are arbitrary.
    """

    source: str
    relative_uncertainty: float | None


@dataclass(frozen=True, eq=False, repr=False)
class CameraCovariance(ByValue):
    """Covariance (c*w, c*w) of all cameras' parameters together, camera by camera in the rig's order, scale included.

    Of each camera (w,): turn in rad and shift in mm of its frame (docs/conventions.md), then those `intrinsics`
    (indices into the 16) that were estimated. The datum is the points as a whole. Predicted uncertainties of lengths
    need it, since the errors of cameras make up for each other.
    """

    matrix: FloatArray
    intrinsics: IntArray

    @property
    def width(self) -> int:
        """How many parameters w of a camera it is of."""
        return 6 + len(self.intrinsics)


Verdict = Literal["valid", "use-with-care", "not-valid"]


@dataclass(frozen=True)
class Affected:
    """What a calibration is to be used with care for: a camera, the scale, or a box of the volume.

    `region_mm` (2, 3): the lowest and the highest corner in the rig's world.
    """

    camera: str | None = None
    scale: bool = False
    region_mm: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None


@dataclass(frozen=True)
class Quality:
    """How good the fit is; `None` where nothing could be adjusted. `valid` is False exactly when the exit code is 3.

    `affected`: what the calibration is to be used with care for (data/verdict.py).
    """

    valid: bool
    rms_px: float | None
    mean_px: float | None
    sigma0: float | None
    findings: tuple[Finding, ...]
    affected: tuple[Affected, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """One of the three words."""
        return "not-valid" if not self.valid else "use-with-care" if self.affected else "valid"


@dataclass(frozen=True)
class Repair:
    """A repair, as on the command line; `earlier_pose`: the camera before it was split.

    `automatic`: not asked for, but certain (steps/automatic_repairs.py).
    """

    option: str
    value: str
    earlier_pose: RigCamera | None = None
    automatic: bool = False


@dataclass(frozen=True)
class Form:
    """How the ball was taken: `free`, `soft` or `rigid`, and why.

    Of the soft form the standard deviation per coordinate of its dots' places, `stated` by the user or estimated.
    """

    name: str
    reason: str
    shape_sd_mm: float | None = None
    stated: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Rig(ByValue):
    """A calibrated rig; the world is the reference camera's frame. Cameras that could not be placed are left out.

    `repairs` were done to the session first; `earlier_poses` are those of split cameras until the repair has them.
    `recorded_at`: when the last placement was taken, where the cameras noted it.
    """

    reference_camera: str | None
    cameras: tuple[RigCamera, ...]
    scale: RigScale
    quality: Quality
    input_sha256: str
    covariance: CameraCovariance | None = None
    length_map: LengthMap | None = None
    repairs: tuple[Repair, ...] = ()
    earlier_poses: tuple[RigCamera, ...] = ()
    form: Form | None = None
    recorded_at: datetime | None = None

    @classmethod
    def from_opencv(
        cls,
        cameras: Mapping[str, OpenCVCamera],
        image_size: ImageSize,
        *,
        fisheye: bool | Collection[str] = False,
        unit: Literal["mm", "m"] = "mm",
    ) -> Rig:
        """The rig of cameras that OpenCV calibrated.

        The world is as given; `reference_camera` is the camera in its origin, if there is one. Nothing is known of the
        rig's accuracy, which its one finding says.

        Parameters
        ----------
        cameras
            By id `(K, dist, rvec, tvec)`, poses from world to camera. `dist`: 4, 5, 8 or 12 numbers in any shape, or
            None. `rvec`: a rotation vector or matrix. `tvec` in `unit`.
        image_size
            (width, height) px, one for all or one for each by id.
        fisheye
            Whether all cameras, or which by id, are of cv2.fisheye.
        unit
            The unit of `tvec`.

        Raises
        ------
        InputError
            Names the camera that cannot be used.
        """
        if not of_kind("cameras", cameras, Mapping, "{camera: (K, dist, rvec, tvec)}"):
            raise InputError(Phrase("error-rig-empty"))
        if unit not in ("mm", "m"):
            raise InputError(Phrase("error-rig-unit", {"unit": repr(unit)}))
        mm = 1000.0 if unit == "m" else 1.0
        return rig_of_unknown_quality(
            tuple(camera_of_opencv(name, one, image_size, fisheye, mm) for name, one in cameras.items())
        )

    def camera(self, camera_id: str) -> RigCamera | None:
        """The placed camera with this id, or None."""
        return next((c for c in self.cameras if c.id == camera_id), None)

    def __getitem__(self, camera_id: str) -> RigCamera:
        found = self.camera(camera_id)
        if found is None:
            raise KeyError(f'no camera "{camera_id}"; the rig has {", ".join(c.id for c in self.cameras) or "none"}')
        return found

    def __iter__(self) -> Iterator[RigCamera]:
        return iter(self.cameras)

    def __contains__(self, camera_id: object) -> bool:
        return any(camera_id in (c.id, c) for c in self.cameras)

    def __repr__(self) -> str:
        ids = [c.id for c in self.cameras]
        named = ", ".join(ids) if len(ids) <= _FEW_IDS else f"{ids[0]} ... {ids[-1]}"
        return f"<Rig: {counted(len(ids), 'camera')}{f' ({named})' if ids else ''}, {'; '.join(self._words())}>"

    def _words(self) -> list[str]:
        q, scale = self.quality, self.scale
        words = [q.verdict.replace("-", " ").upper()]
        words += [] if q.rms_px is None else [f"rms {q.rms_px:.4f} px"]
        unscaled = scale.source == "none"
        words += ["lengths in arbitrary units: no scale" if unscaled else f"scale: {scale.source.replace('_', ' ')}"]
        words += [] if self.reference_camera is None else [f"reference {self.reference_camera}"]
        return words

    def _repr_html_(self) -> str:
        """What a notebook shows: a table of the cameras."""
        table = self._table()
        columns = ("camera", "lens_model", "fu", "centre_x_mm", "centre_y_mm", "centre_z_mm", "rms_px", "observations")
        said = "; ".join([f"Rig: {counted(len(self.cameras), 'camera')}", *self._words()])
        return html_table(said, {name: table.get(name, []) for name in columns})

    def plot(self, ax: Any = None) -> Axes3D:
        """The cameras drawn in space, in mm, with matplotlib; the axes.

        Parameters
        ----------
        ax
            Axes with projection "3d" to draw on; None for a new figure.

        Raises
        ------
        InputError
            For other axes, and for a rig without cameras.
        MissingPackage
            Without matplotlib.
        """
        from spherecal.data.rig_plot import plot_cameras

        return plot_cameras(self.cameras, self.reference_camera, ax)

    def to_dataframe(self) -> pandas.DataFrame:
        """The cameras as a table of pandas, a row for each, indexed by id.

        Raises
        ------
        MissingPackage
            Where pandas is not there.
        """
        with needing("pandas", "Rig.to_dataframe"):
            import pandas  # pyright: ignore[reportMissingImports]
        return pandas.DataFrame(self._table()).set_index("camera")

    def _table(self) -> dict[str, list[Any]]:
        """Columns of one value for each camera; absent values are None, coefficients that a lens does not have NaN."""
        rows = [table_row(camera) for camera in self.cameras]
        return {name: [row[name] for row in rows] for name in (rows[0] if rows else ("camera",))}


_FEW_IDS = 8


def rig_of_unknown_quality(cameras: tuple[RigCamera, ...]) -> Rig:
    """The rig of cameras that another program calibrated; its reference camera is the one in the origin, if any."""
    origin = [c.id for c in cameras if np.array_equal(c.rotation, np.eye(3)) and not c.translation_mm.any()]
    return Rig(origin[0] if origin else None, cameras, RigScale("given", None), unknown_quality(cameras), "")


def unknown_quality(cameras: Sequence[RigCamera]) -> Quality:
    """The quality of a rig of which nothing is known: to be used with care, all cameras."""
    finding = Finding("rig-incomplete", "info", kind="unknown")
    return Quality(True, None, None, None, (finding,), tuple(Affected(camera=camera.id) for camera in cameras))


@dataclass(frozen=True, eq=False, repr=False)
class PlacedSphere(ByValue):
    """The sphere fitted to one placement's points."""

    placement: str
    centre_mm: FloatArray
    radius_mm: float
    radial_sd_mm: float


@dataclass(frozen=True, eq=False, repr=False)
class BallShape(ByValue):
    """The ball's dots in a frame of its own: target and point name (d,), places (d,3) mm, covariances (d,3,3) mm^2.

    The covariances are those among the dots, without what a shift, turn or stretch of them all explains; the size is as
    sure as `scale` says.
    """

    target: IntArray
    point: tuple[str, ...]
    places_mm: FloatArray
    covariance_mm2: FloatArray
    scale: RigScale


@dataclass(frozen=True, eq=False, repr=False)
class BallProfile(ByValue):
    """A ball's shape with its name, the day it was calibrated, its targets' family and size, and where it came from.

    `input_sha256` is that of the calibration. None, or an empty text, is what is not known.
    """

    shape: BallShape
    name: str = ""
    calibrated: date | None = None
    family: str | None = None
    target_size_mm: float | None = None
    input_sha256: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class ImageMotion(ByValue):
    """How a camera was turned and shifted at one placement: `x = exp(turn) (R x_world + t) + shift`.

    `rotation_deg` (3,) and `translation_mm` (3,); their mean over a camera's images is 0.
    """

    placement: str
    camera: str
    rotation_deg: FloatArray
    translation_mm: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(ByValue):
    """All that a calibration finds: the rig, the points, the residuals, the spheres.

    `points_mm` (m, 3), `points_sigma_mm` (m, 3) (NaN where unknown) and `views` (m,) belong to `features`; points that
    could not be found are NaN. `residuals_px` (n, 2) = predicted - observed (NaN where there is no prediction) and
    `used` (n,) belong to `observations`. `ball`: the shape of a ball that was taken as rigid and of known scale.
    `motions` of images, where they were estimated.
    """

    rig: Rig
    observations: Observations
    features: Features
    points_mm: FloatArray
    points_sigma_mm: FloatArray
    views: IntArray
    residuals_px: FloatArray
    used: BoolArray
    spheres: tuple[PlacedSphere, ...]
    method: str
    seconds: dict[str, float]
    ball: BallShape | None = None
    motions: tuple[ImageMotion, ...] = ()

    def __repr__(self) -> str:
        points = int(np.isfinite(self.points_mm[:, 0]).sum())
        return f"<Calibration ({self.method}): {self.rig!r}, {points} points, {len(self.observations)} observations>"

    def _repr_html_(self) -> str:
        """What a notebook shows: the rig, and the findings."""
        found = self.rig.quality.findings
        words = {"severity": [f.severity for f in found], "finding": [f"{f.message} {f.hint}".strip() for f in found]}
        return self.rig._repr_html_() + html_table(
            f"Calibration ({self.method}): {counted(len(found), 'finding')}", words
        )
