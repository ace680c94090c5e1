"""The calibrated rig: the frozen result of a calibration."""

from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.findings import Finding
from spherecal.network.observations import Features, Observations
from spherecal.predict.volume_map import LengthMap


@dataclass(frozen=True)
class CameraSigma:
    """Standard uncertainties of one camera: about and along which axes, see docs/conventions.md.

    rotation_deg (3,) about the camera's axes, centre_mm (3,) in the world's axes, intrinsics (16,), 0 where fixed.
    """

    rotation_deg: FloatArray
    centre_mm: FloatArray
    intrinsics: FloatArray


@dataclass(frozen=True)
class RigCamera:
    """One placed camera: intrinsics (16,), pose `x_camera = rotation @ x_world + translation_mm`."""

    id: str
    serial: str | None
    image_size: tuple[int, int]
    intrinsics: FloatArray
    rotation: FloatArray
    translation_mm: FloatArray
    rms_px: float | None
    observations: int
    sigma: CameraSigma | None

    @property
    def centre_mm(self) -> FloatArray:
        """The projection centre in the world frame, (3,)."""
        return -self.rotation.T @ self.translation_mm


@dataclass(frozen=True)
class RigScale:
    """Where the scale came from and its relative standard uncertainty (None for arbitrary lengths)."""

    source: str
    relative_uncertainty: float | None


@dataclass(frozen=True)
class CameraCovariance:
    """Covariance (c*w, c*w) of all cameras' parameters together, camera by camera in the rig's order, scale included.

    Of each camera (w,): turn in rad and shift in mm of its frame (docs/conventions.md), then the `intrinsics` (indices
    into the 16) that were estimated; datum: the points as a whole. Predicted uncertainties of lengths need it, since
    the errors of cameras make up for each other.
    """

    matrix: FloatArray
    intrinsics: IntArray


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

    `affected`: what the calibration is to be used with care for (verdict.py).
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

    `automatic`: not asked for, but certain (mending.py).
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


@dataclass(frozen=True)
class Rig:
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

    def camera(self, camera_id: str) -> RigCamera | None:
        """The placed camera with this id, or None."""
        return next((c for c in self.cameras if c.id == camera_id), None)


@dataclass(frozen=True)
class PlacedSphere:
    """The sphere fitted to one placement's points."""

    placement: str
    centre_mm: FloatArray
    radius_mm: float
    radial_sd_mm: float


@dataclass(frozen=True)
class BallShape:
    """The ball's dots in a frame of its own: target and point name (d,), places (d,3) mm, covariances (d,3,3) mm^2.

    The covariances are those among the dots, without what a shift, turn or stretch of them all explains; the size is as
    sure as `scale` says.
    """

    target: IntArray
    point: tuple[str, ...]
    places_mm: FloatArray
    covariance_mm2: FloatArray
    scale: RigScale


@dataclass(frozen=True)
class Calibration:
    """All that a calibration finds: the rig, the points, the residuals, the spheres.

    `points_mm` (m, 3), `points_sigma_mm` (m, 3) (NaN where unknown) and `views` (m,) belong to `features`; points that
    could not be found are NaN. `residuals_px` (n, 2) = predicted - observed (NaN where there is no prediction) and
    `used` (n,) belong to `observations`. `ball`: the shape of a ball that was taken as rigid and of known scale.
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
