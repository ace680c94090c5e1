"""What a session is: cameras, placements, bars and observations, as read from its folder (frozen data)."""

import datetime
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.notebook import html_table
from spherecal.data.findings import counted
from spherecal.data.observations import Features, Observations, find_features
from spherecal.geometry.camera import LensModel
from spherecal.targets.masks import Rectangle
from spherecal.targets.target_set import TargetSet

if TYPE_CHECKING:
    from spherecal.data.from_arrays import Lens
    from spherecal.data.rig_camera import ImageSize

_SCALES = "a Scale, such as Scale('bar', bar='B1'); the ball's diameter is sphere_diameter_mm"

# [Tao21] tried one to seven placements: beyond four the gain is small (docs/studies: layouts).
STANDARD_PLACEMENTS = 4


@dataclass(frozen=True, eq=False, repr=False)
class CameraSpec(ByValue):
    """A camera as the session describes it; `prior` holds 16 intrinsics (docs/conventions.md), always present.

    Made from the file's prior, else from pixel pitch and focal length with a centred principal point;
    `prior_given` says which; `assumed` names what the prior lacked. Nothing in `ignore` is a target.
    `earlier_pose_of` names the camera whose pose before a move this one has (steps/repairs.py). `lens_model` is what a
    calibration estimates.
    """

    id: str
    image_size: tuple[int, int]
    prior: FloatArray
    prior_given: bool
    intrinsics_group: str
    serial: str | None = None
    model: str | None = None
    pixel_pitch_um: float | None = None
    focal_length_mm: float | None = None
    earlier_pose_of: str | None = None
    ignore: tuple[Rectangle, ...] = ()
    lens_model: LensModel = "brown"
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Placement:
    """One place of the ball: its id and the image file of each camera that has one (absolute paths)."""

    id: str
    images: dict[str, Path] = field(default_factory=dict)


# Printers err by 0.1 to 0.5 % in size, all targets alike: twice this covers it. Targets printed 0.5 % too large, with
# no share of it stated, gave lengths 68 times U off.
UNMEASURED_PRINT = 0.003


@dataclass(frozen=True)
class Scale:
    """Where millimetres come from: the distance of two named points of a target, a bar, or by choice nowhere.

    `expanded_uncertainty_mm`: that of the distance on the print, where it was measured.
    """

    kind: Literal["target_spacing", "bar", "none"]
    from_point: str | None = None
    to_point: str | None = None
    distance_mm: float | None = None
    surface: Literal["sphere", "flat"] = "flat"
    bar: str | None = None
    expanded_uncertainty_mm: float | None = None
    coverage_factor: float = 2.0

    @property
    def print_sd(self) -> float:
        """The relative standard uncertainty that all targets of a print have in common, measured or not."""
        if self.expanded_uncertainty_mm is None or not self.distance_mm:
            return UNMEASURED_PRINT
        return self.expanded_uncertainty_mm / self.coverage_factor / self.distance_mm


@dataclass(frozen=True)
class Mark:
    """A mark of a bar: a target's named point."""

    target: int
    point: str


@dataclass(frozen=True)
class BarLength:
    """A certified distance between two marks at the bar's reference temperature.

    `nominal_mm` is what the bar is called by, for people to recognise it; nothing is computed from it. `assumed` names
    what was not stated (`expanded_uncertainty_mm`, `coverage_factor`).
    """

    from_mark: str
    to_mark: str
    length_mm: float
    expanded_uncertainty_mm: float
    coverage_factor: float = 2.0
    nominal_mm: float | None = None
    assumed: tuple[str, ...] = ()

    @property
    def certified(self) -> bool:
        """Whether its uncertainty is stated; errors against a length without one decide nothing."""
        return "expanded_uncertainty_mm" not in self.assumed


@dataclass(frozen=True)
class Certificate:
    """What a bar's calibration certificate says of itself."""

    number: str
    laboratory: str = ""
    date: datetime.date | None = None
    valid_until: datetime.date | None = None


@dataclass(frozen=True)
class Bar:
    """A reference bar; role `scale` gives the scale, role `check` only verifies, never both.

    With a `serial` it may be in the owner's registry (bar_registry.py). `assumed` names what was not stated
    (`expansion_per_kelvin`, `reference_temperature_c`).
    """

    id: str
    role: Literal["scale", "check"]
    marks: dict[str, Mark]
    lengths: tuple[BarLength, ...]
    expansion_per_kelvin: float
    reference_temperature_c: float = 20.0
    serial: str | None = None
    certificate: Certificate | None = None
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class BarPose:
    """One pose of a bar, observed under its own id; temperature None where it was not measured."""

    id: str
    bar: str
    temperature_c: float | None = None
    images: dict[str, Path] = field(default_factory=dict)


@dataclass(frozen=True)
class BoardPoint:
    """A point of a calibration board: target, point name, place in millimetres."""

    target: int
    point: str
    xyz_mm: tuple[float, float, float]


@dataclass(frozen=True)
class CapturedFrame:
    """What a camera noted of one image: its frame number, its own clock, and when the host says it was exposed."""

    frame_id: int | None = None
    time_stamp_ns: int | None = None
    exposed: datetime.datetime | None = None


@dataclass(frozen=True)
class CapturedSet:
    """One set of images: when it was taken, temperatures and what was noted of each image, by camera id."""

    id: str
    taken: datetime.datetime | None
    temperatures_c: dict[str, float]
    frames: dict[str, CapturedFrame] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class Session(ByValue):
    """A recorded session, checked; `observations` is None where there are only images.

    `observations` rows name placements and bar poses, in the order of `placements` then `bar_poses`, and cameras in
    the order of `cameras`. `input_sha256` covers session.json and every file it names. `sphere_sd_mm`: standard
    uncertainty of the diameter, over the targets, where it was measured. `struck`: sources of scale (`print`, `ball`)
    that say nothing, by the user's wish. `wanted_uncertainty_mm`: the expanded one (k = 2) that lengths are wanted
    with. `captured`: what the cameras noted of its sets; `recorded_at`: when the last placement was taken.
    """

    folder: Path
    cameras: tuple[CameraSpec, ...]
    placements: tuple[Placement, ...]
    bars: tuple[Bar, ...]
    bar_poses: tuple[BarPose, ...]
    scale: Scale | None
    board: tuple[BoardPoint, ...] | None
    sphere_diameter_mm: float | None
    target_set: TargetSet | None
    observations: Observations | None
    input_sha256: str
    sphere_sd_mm: float | None = None
    struck: tuple[str, ...] = ()
    wanted_uncertainty_mm: float | None = None
    captured: tuple[CapturedSet, ...] = ()
    recorded_at: datetime.datetime | None = None

    @classmethod
    def from_arrays(
        cls,
        observations: Any,
        cameras: "Mapping[str, Lens] | Lens",
        image_size: "ImageSize | None" = None,
        *,
        fisheye: bool | Collection[str] = False,
        scale: Scale | None = None,
        bars: Sequence[Bar] = (),
        bar_poses: Sequence[BarPose] = (),
        target_set: TargetSet | None = None,
        sphere_diameter_mm: float | None = None,
    ) -> "Session":
        """A session from image points in memory instead of a folder.

        Parameters
        ----------
        observations
            Points with ids: {camera: {frame: (ids, uv)}}, with {id: (u, v)} in place of (ids, uv) too; uv is (n, 2) px,
            or (n, 4, 2) for the corners of markers. Or a table (a dict of columns, or a data frame) with `camera`,
            `target`, `u`, `v`, and optionally `placement`, `point`, `sigma_u`, `sigma_v`. Or arrays by camera, (n, 2)
            px or (t, n, 2) for t placements: row i is the same point in all cameras, NaN where it is not seen. Or such
            arrays by placement, or an array (cameras, n, 2).
        cameras
            By id K or (K, dist) in OpenCV's terms, as start values, or a CameraSpec. One K or (K, dist) for all.
        image_size
            (width, height) px, one for all or one for each by id; None where all cameras are a CameraSpec.
        fisheye
            Whether all cameras, or which by id, have lenses of cv2.fisheye.
        scale
            Where millimetres come from; None: lengths are arbitrary.
        bars, bar_poses
            Reference bars and their poses; image points of a pose are those of the placement of its id.
        target_set
            The targets' layouts; None where they have none.
        sphere_diameter_mm
            The ball's diameter; None where it is not known.

        Raises
        ------
        InputError
            Says what cannot be used.
        """
        from spherecal.data import from_arrays as given

        given.of_kind("scale", scale, (Scale, type(None)), _SCALES)
        given.of_kind("target_set", target_set, (TargetSet, type(None)), "a TargetSet (load_targets reads one)")
        for name, values, kind in (("bars", bars, Bar), ("bar_poses", bar_poses, BarPose)):
            for one in given.of_kind(name, values, Sequence, f"a list of {kind.__name__}"):
                given.of_kind(f"Each item of {name}", one, kind, f"a {kind.__name__}")
        if sphere_diameter_mm is not None:
            sphere_diameter_mm = given.above_zero("sphere_diameter_mm", sphere_diameter_mm)
        specs = given.camera_specs(given.lenses_by_camera(cameras, observations), image_size, fisheye)
        poses = [pose.id for pose in bar_poses]
        names = {bar.id: bar.role for bar in bars}
        if unknown := [pose.bar for pose in bar_poses if pose.bar not in names]:
            raise InputError(Phrase("error-pose-bar", {"bar": unknown[0]}))
        if scale is not None and scale.kind == "bar" and names.get(scale.bar or "") != "scale":
            raise InputError(Phrase("error-scale-bar", {"bar": scale.bar}))
        table = given.observations_of(observations, specs, poses)
        placements = tuple(Placement(name) for name in table.placements if name not in poses)
        of_bars = tuple(bars), tuple(bar_poses)
        sha = given.digest(specs, table, target_set, repr((scale, *of_bars, sphere_diameter_mm)))
        of_ball = None, sphere_diameter_mm, target_set
        return cls(Path(), specs, placements, *of_bars, scale, *of_ball, table, sha)

    @property
    def where(self) -> str:
        """Its folder, or that it has none, for messages."""
        return "the session in memory" if self.folder == Path() else str(self.folder)

    def _repr_html_(self) -> str:
        """What a notebook shows: a row for each camera."""
        o = self.observations
        counts = {} if o is None else dict(zip(o.cameras, np.bincount(o.camera, minlength=len(o.cameras)), strict=True))
        columns = {
            "camera": [c.id for c in self.cameras],
            "width": [c.image_size[0] for c in self.cameras],
            "height": [c.image_size[1] for c in self.cameras],
            "lens": [c.lens_model for c in self.cameras],
            "observations": [counts.get(c.id) for c in self.cameras],
        }
        return html_table(repr(self).strip("<>"), columns)

    def __repr__(self) -> str:
        o = self.observations
        seen = "images only" if o is None else counted(len(o), "observation")
        counts = ((self.cameras, "camera"), (self.placements, "placement"), (self.bar_poses, "bar pose"))
        words = ", ".join(counted(len(items), noun) for items, noun in counts)
        where = "" if self.folder == Path() else f" {self.folder}"
        return f"<Session{where}: {words}, {seen}>"


# --- what a calibration starts from ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Recording:
    """A session, the observations that may be used and the features (placement, target, point) that they are of."""

    session: Session
    observations: Observations
    features: Features

    @classmethod
    def of(cls, session: Session) -> "Recording":
        """The recording of a session that has observations."""
        o = session.observations
        assert o is not None
        # placements, and the marks of the bar that gives the scale; never check bars
        take = o.placement < len(session.placements)
        bars = {bar.id: bar for bar in session.bars}
        for i, pose in enumerate(session.bar_poses):
            if session.scale is not None and pose.bar == session.scale.bar:
                marks = [mark.target for mark in bars[pose.bar].marks.values()]
                take |= (o.placement == len(session.placements) + i) & np.isin(o.target, marks)
        o = o if take.all() else o.select(take)
        return cls(session, o, find_features(o))

    @property
    def priors(self) -> FloatArray:
        """What is known of the cameras' intrinsics before the calibration, (c,16)."""
        return np.array([camera.prior for camera in self.session.cameras])

    @property
    def n_ball(self) -> int:
        """How many placements are the ball's; they come first."""
        return len(self.session.placements)

    @property
    def n_placements(self) -> int:
        """How many placements there are, poses of bars included."""
        return self.n_ball + len(self.session.bar_poses)
