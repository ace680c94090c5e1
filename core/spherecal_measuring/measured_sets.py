"""What measuring gives: for every set its points, values, bodies, and what contradicts; frozen types only."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray, IntArray
from spherecal.data.observations import Observations
from spherecal_measuring.measuring_task import PointName
from spherecal_verify.consistency import CameraTest

ValueKind = Literal["distance", "angle", "bar"]


@dataclass(frozen=True, eq=False, repr=False)
class ObservedSet(ByValue):
    """The image points of one set of images; `observations` have one placement, whose name is `id`.

    `time_s` counts from any moment, None where unknown; `exposure_s` (by camera id) are the moments of exposure on the
    same clock. `arrived_s` is when the last image was there, on the clock of `time.perf_counter`.
    """

    number: int
    id: str
    observations: Observations
    time_s: float | None = None
    exposure_s: dict[str, float] | None = None
    arrived_s: float | None = None


@dataclass(frozen=True)
class MeasuredValue:
    """A distance (mm), an angle (deg) or a bar's length (mm), with standard uncertainties (k = 1).

    `deviation` is value - nominal; its uncertainty holds, of a bar, the certificate's and the temperature's too.
    """

    kind: ValueKind
    name: str
    value: float
    u: float
    nominal: float | None = None
    deviation: float | None = None
    u_deviation: float | None = None

    @property
    def unit(self) -> str:
        """mm or deg."""
        return "deg" if self.kind == "angle" else "mm"


@dataclass(frozen=True, eq=False, repr=False)
class BodyPose(ByValue):
    """A body's pose: x_world = rotation (3, 3) @ x_body + translation_mm (3,).

    `covariance` (6, 6): first a small turn about the world's axes in rad (the true rotation is exp(turn) @ rotation),
    then the translation in mm. `left_out` names points that contradict the rest. `rms_mm` is that of the points used.
    """

    name: str
    rotation: FloatArray
    translation_mm: FloatArray
    covariance: FloatArray
    points: int
    left_out: tuple[PointName, ...]
    rms_mm: float


@dataclass(frozen=True)
class Contradiction:
    """Views of a target by a camera that fit no other's and were left out; None: which is wrong stays open."""

    target: int
    camera: str | None
    views: int
    of: int


@dataclass(frozen=True)
class CameraResidual:
    """A camera in one set: image points, those left out, and the rms length of the others' residuals, px."""

    camera: str
    observations: int
    left_out: int
    rms_px: float | None


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredSet(ByValue):
    """One set measured: points (n,) with places (n, 3) mm and covariances (n, 3, 3) mm^2 in the rig's world.

    `views` (n,) counts the cameras that a point rests on, `dots` (n,) the dots of its target that were used.
    `speed_mm_s` (n,) is how fast the points move, NaN where unknown. `missing`: bodies and values that could not be
    measured, and why. `skew_s` is the largest difference between the moments of exposure. `latency_s` is the time from
    the arrival of the last image to the result.
    """

    number: int
    id: str
    time_s: float | None
    names: tuple[PointName, ...]
    points_mm: FloatArray
    covariance_mm2: FloatArray
    views: IntArray
    dots: IntArray
    speed_mm_s: FloatArray
    values: tuple[MeasuredValue, ...]
    bodies: tuple[BodyPose, ...]
    missing: tuple[tuple[str, str], ...]
    contradictions: tuple[Contradiction, ...]
    cameras: tuple[CameraResidual, ...]
    noise: float
    skew_s: float | None = None
    latency_s: float | None = None

    @property
    def sigma_mm(self) -> FloatArray:
        """Standard uncertainties (n, 3) of the points along the world's axes."""
        return np.sqrt(np.einsum("nii->ni", self.covariance_mm2))

    def index(self, name: PointName) -> int | None:
        """The row of a point, None where it was not measured."""
        return self.names.index(name) if name in self.names else None


@dataclass(frozen=True)
class CameraHealth:
    """A camera over all sets so far: its residuals against those of the calibration; its move, where there is one."""

    camera: str
    observations: int
    rms_px: float | None
    calibrated_rms_px: float | None
    left_out: int
    moved: CameraTest | None = None
    named_at: int | None = None  # the set in which it was first said to have moved


@dataclass(frozen=True)
class Health:
    """The rig while it measures: sets so far and every camera."""

    sets: int
    cameras: tuple[CameraHealth, ...]
    tests: tuple[CameraTest, ...] = ()  # of each camera the newest over many sets, before there is one over a few

    @property
    def moved(self) -> tuple[str, ...]:
        """Cameras that have moved since the calibration."""
        return tuple(one.camera for one in self.cameras if one.moved is not None)


@dataclass(frozen=True)
class Series:
    """All sets of a recording, and the rig's health over them."""

    sets: tuple[MeasuredSet, ...]
    health: Health
