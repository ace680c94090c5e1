"""Where to lay bars: on three edges that do not meet and four diagonals of the volume (VDI/VDE 2634-1, reduced)."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.threads import on_one_blas_thread
from spherecal.data.observations import Observations, find_features
from spherecal.data.rig import Rig, RigCamera
from spherecal.data.session import Bar, BarLength
from spherecal.geometry.camera import is_unfolded, project
from spherecal.targets.target_set import TargetSet
from spherecal_verify.departures import LEAST_LENGTHS, MeasuringVolume, volume_box
from spherecal_verify.marks import MarkFinder, MarkPlace
from spherecal_verify.outlying_views import triangulate_checked
from spherecal_verify.verify_bars import views_of

# Where the three edge lines run, in half sides of the box: on edges that do not meet.
_EDGES = ((0, (0.0, -1.0, -1.0)), (1, (1.0, 0.0, -1.0)), (2, (-1.0, 1.0, 0.0)))
LINE_NAMES = ("edge X", "edge Y", "edge Z", "diagonal 1", "diagonal 2", "diagonal 3", "diagonal 4")
# A line moves towards the middle in these steps until every mark of the bar is seen.
_TOWARDS_MIDDLE = (0.9, 0.75, 0.6, 0.45, 0.3, 0.15, 0.0)
_LEAST_VIEWS, _GOOD_VIEWS = 2, 3
_MARGIN = 0.02  # of the image: a mark is larger than a point
_LITTLE_ROOM = 0.1  # of the bar's own length
_MOST_POSES = 20  # on a line
_POSES_PER_CAMERA = 2
_MOST_OBLIQUE_DEG = 60.0  # a mark is read up to this angle


@dataclass(frozen=True)
class BarMarks:
    """A bar's marks along it (m,) in mm from its first one, in order, and how many certified lengths it has."""

    bar: str
    names: tuple[str, ...]
    along_mm: FloatArray
    lengths: int

    @property
    def span_mm(self) -> float:
        """The distance of the last mark from the first."""
        return float(self.along_mm[-1])

    @staticmethod
    def of(bar: str, lengths: Sequence[BarLength]) -> "BarMarks":
        """The marks as the certified lengths that join them to the longest place them, running to their second mark."""
        longest = max(lengths, key=lambda x: x.length_mm)
        place = {longest.from_mark: 0.0, longest.to_mark: longest.length_mm}
        for _ in lengths:
            for x in lengths:
                if x.from_mark in place:
                    place.setdefault(x.to_mark, place[x.from_mark] + x.length_mm)
                elif x.to_mark in place:
                    place.setdefault(x.from_mark, place[x.to_mark] - x.length_mm)
        order = sorted(place, key=lambda name: place[name])
        low = place[order[0]]
        return BarMarks(bar, tuple(order), np.array([place[name] - low for name in order]), len(lengths))


@dataclass(frozen=True)
class PlannedPose:
    """Line, bar, places (3,) mm of its first and last mark, where the marks face (3,), cameras that see them all."""

    id: str
    line: int
    bar: str
    start_mm: FloatArray
    end_mm: FloatArray
    facing: FloatArray
    cameras: tuple[str, ...]
    near: tuple[str, str]
    good: bool


@dataclass(frozen=True)
class PosePlan:
    """The poses in order; `missing` lines, on which none is seen by two cameras, and cameras that see no whole bar."""

    box: MeasuringVolume
    poses: tuple[PlannedPose, ...]
    lengths_on_line: tuple[int, ...]
    missing: tuple[str, ...]
    cameras_left_out: tuple[str, ...] = ()

    def next_pose(self, done: Collection[str]) -> PlannedPose | None:
        """The first pose that is not done; None after the last."""
        return next((pose for pose in self.poses if pose.id not in done), None)

    def as_json(self) -> dict[str, Any]:
        """The plan as data for JSON, places in mm."""
        rounded = [np.round(x, 2).tolist() for x in (self.box.middle, self.box.half)]
        return {
            "volume": {"middle_mm": rounded[0], "half_mm": rounded[1], "axes": np.round(self.box.axes, 6).tolist()},
            "lines": [{"name": n, "lengths": c} for n, c in zip(LINE_NAMES, self.lengths_on_line, strict=True)],
            "missing": list(self.missing),
            "cameras_left_out": list(self.cameras_left_out),
            "poses": [
                {
                    "id": p.id,
                    "line": LINE_NAMES[p.line],
                    "bar": p.bar,
                    "start_mm": np.round(p.start_mm, 1).tolist(),
                    "end_mm": np.round(p.end_mm, 1).tolist(),
                    "facing": np.round(p.facing, 3).tolist(),
                    "cameras": list(p.cameras),
                    "near": list(p.near),
                }
                for p in self.poses
            ],
        }


@on_one_blas_thread
def plan_poses(rig: Rig, bars: Sequence[BarMarks], corners_mm: tuple[FloatArray, FloatArray]) -> PosePlan:
    """Poses of bars, taking turns, on the volume's seven lines: five lengths on each, seen by two, better by three.

    Then come poses for cameras that these would not verify. The lines: VDI/VDE 2634-1 (reduced), docs/verification.md.
    """
    box = volume_box(rig, corners_mm)
    poses: list[PlannedPose] = []
    lengths, missing = [], []
    for line, direction in enumerate(box.directions()):
        found: list[PlannedPose] = []
        for number in range(_MOST_POSES):
            bar = bars[number % len(bars)]
            if sum(_of(bars, pose.bar).lengths for pose in found) >= LEAST_LENGTHS and number >= len(bars):
                break
            pose = _pose(rig, box, line, direction, bar, number)
            if pose is not None:
                found.append(replace(pose, id=f"L{line + 1}-{len(found) + 1}"))
        poses += found
        lengths.append(sum(_of(bars, pose.bar).lengths for pose in found))
        if not found:
            missing.append(LINE_NAMES[line])
    left_out = _for_every_camera(rig, box, bars, poses, lengths)
    return PosePlan(box, tuple(poses), tuple(lengths), tuple(missing), left_out)


def _for_every_camera(
    rig: Rig, box: MeasuringVolume, bars: Sequence[BarMarks], poses: list[PlannedPose], lengths: list[int]
) -> tuple[str, ...]:
    """Add poses until every camera faces two bars; the cameras for which there is no place."""
    left_out: list[str] = []
    count = {camera.id: sum(camera.id in facing_cameras(rig, pose) for pose in poses) for camera in rig.cameras}
    for camera in rig.cameras:
        while count[camera.id] < _POSES_PER_CAMERA:
            found = _pose_for(rig, box, camera, bars, poses)
            if found is None:
                left_out += [] if count[camera.id] else [camera.id]
                break
            number = sum(pose.line == found.line for pose in poses) + 1
            poses.append(replace(found, id=f"L{found.line + 1}-{number}"))
            lengths[found.line] += _of(bars, found.bar).lengths
            for name in facing_cameras(rig, poses[-1]):
                count[name] += 1
    return tuple(left_out)


def _pose_for(
    rig: Rig, box: MeasuringVolume, camera: RigCamera, bars: Sequence[BarMarks], before: Sequence[PlannedPose]
) -> PlannedPose | None:
    """The pose that faces a camera and most others, away from those before; None where two never see a whole bar."""
    best: tuple[float, PlannedPose] | None = None
    taken = np.array([(pose.start_mm + pose.end_mm) / 2 for pose in before]).reshape(-1, 3)
    steps = np.linspace(-0.8, 0.8, 5)
    unit = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    for bar in sorted(bars, key=lambda one: -one.span_mm):
        for middle in np.array([box.point(at) for at in unit]):
            for line, direction in enumerate(box.directions()):
                pose = _seen(rig, line, direction, bar, middle, camera)
                if pose is None or camera.id not in pose.cameras or len(facing_cameras(rig, pose)) < _LEAST_VIEWS:
                    continue
                away = np.linalg.norm(taken - middle, axis=1).min(initial=box.diagonal_mm) / box.diagonal_mm
                value = len(facing_cameras(rig, pose)) + away
                if best is None or value > best[0]:
                    best = value, pose
        if best is not None:  # the longest bar that fits
            return best[1]
    return None


def facing_cameras(rig: Rig, pose: PlannedPose) -> tuple[str, ...]:
    """The cameras that see all of a planned bar and look at the side that its marks are on."""
    middle = (pose.start_mm + pose.end_mm) / 2
    out = []
    for name in pose.cameras:
        camera = rig.camera(name)
        assert camera is not None
        to = camera.centre_mm - middle
        if to @ pose.facing > np.cos(np.radians(_MOST_OBLIQUE_DEG)) * np.linalg.norm(to):
            out.append(name)
    return tuple(out)


def _of(bars: Sequence[BarMarks], name: str) -> BarMarks:
    return next(bar for bar in bars if bar.bar == name)


def _pose(
    rig: Rig, box: MeasuringVolume, line: int, direction: FloatArray, bar: BarMarks, before: int
) -> PlannedPose | None:
    """The pose after `before` others on a line: ends, middle, then between; None where it is not seen."""
    best: PlannedPose | None = None
    for inward in _TOWARDS_MIDDLE:
        offset = np.zeros(3) if line >= 3 else inward * np.array(_EDGES[line][1])
        # to the edge of the box along the direction, on the nearer side
        at, step = box.unit(box.point(offset)), direction @ box.axes.T / box.half
        with np.errstate(divide="ignore"):
            reach = np.minimum((1 - at) / np.abs(step), (1 + at) / np.abs(step))
        room = max(float(reach[np.abs(step) > 1e-9].min()) - bar.span_mm / 2, 0.0)
        if room < _LITTLE_ROOM * bar.span_mm and before % 2:
            offset = -offset  # the bar fills the line: the opposite edge instead of the same place again
        through = box.point(offset)
        shift = _shift(before) * room * (inward if line >= 3 else 1.0)
        middle = through + shift * direction
        pose = _seen(rig, line, direction, bar, middle)
        if pose is not None and pose.good:
            return pose
        best = best or pose
    return best


def _shift(number: int) -> float:
    """The shift within the room: to one end, the other, the middle, then ever finer between."""
    order = [-1.0, 1.0, 0.0, -0.5, 0.5]
    return order[number] if number < len(order) else float(np.random.default_rng(number).uniform(-1, 1))


def _seen(
    rig: Rig, line: int, direction: FloatArray, bar: BarMarks, middle: FloatArray, towards: RigCamera | None = None
) -> PlannedPose | None:
    """The pose at a place, its marks towards one camera or the middle of all that see them; None if too few do."""
    marks = middle + (bar.along_mm - bar.span_mm / 2)[:, None] * direction
    by_camera = cameras_that_see(rig, marks)
    all_marks = [i for i, seen in enumerate(by_camera) if seen.all()]
    views = by_camera.sum(axis=0).min() if len(by_camera) else 0
    if views < _LEAST_VIEWS:
        return None
    centres = np.array([camera.centre_mm for camera in rig.cameras])
    to = centres[all_marks] if all_marks else centres
    look = (to.mean(axis=0) if towards is None else towards.centre_mm) - middle
    facing = look - (look @ direction) * direction
    facing /= max(float(np.linalg.norm(facing)), 1e-9)
    near = tuple(rig.cameras[int(np.linalg.norm(centres - end, axis=1).argmin())].id for end in (marks[0], marks[-1]))
    ids = tuple(rig.cameras[i].id for i in all_marks)
    return PlannedPose("", line, bar.bar, marks[0], marks[-1], facing, ids, (near[0], near[1]), views >= _GOOD_VIEWS)


def cameras_that_see(rig: Rig, points: FloatArray) -> np.ndarray:
    """Which camera's image holds which points (n, 3) mm, 2 % off its edges: bool (cameras, n). Nothing hides them."""
    seen = np.zeros((len(rig.cameras), len(points)), dtype=bool)
    for i, camera in enumerate(rig.cameras):
        x = points @ camera.rotation.T + camera.translation_mm
        with np.errstate(all="ignore"):
            uv = project(x, camera.intrinsics)
        size = np.array(camera.image_size)
        margin = _MARGIN * size
        inside = ((uv >= margin) & (uv <= size - 1 - margin)).all(axis=1)
        inside &= x[:, 2] > 0
        inside[inside] = is_unfolded(x[inside], np.broadcast_to(camera.intrinsics, (int(inside.sum()), 16)))
        seen[i] = inside
    return seen


@dataclass(frozen=True)
class PoseAnswer:
    """Whether a bar is where the plan wants it, the distance of its middle, and the angle between the directions."""

    accepted: bool
    off_mm: float
    off_deg: float


# A tenth of a 1.5 m volume and a third of the angle between neighbouring lines: the spread stays what was planned.
ACCEPT_MM, ACCEPT_DEG = 150.0, 15.0


def judge_pose(pose: PlannedPose, ends_mm: FloatArray | None) -> PoseAnswer:
    """Whether the measured ends (2, 3) mm of the bar are where the plan wants them, either way round."""
    if ends_mm is None or not np.isfinite(ends_mm).all():
        return PoseAnswer(False, np.inf, np.inf)
    requested = np.stack([pose.start_mm, pose.end_mm])
    along, is_along = requested[1] - requested[0], ends_mm[1] - ends_mm[0]
    cosine = abs(float(along @ is_along)) / max(float(np.linalg.norm(along) * np.linalg.norm(is_along)), 1e-9)
    off_deg = float(np.degrees(np.arccos(min(cosine, 1.0))))
    off_mm = float(np.linalg.norm(requested.mean(axis=0) - ends_mm.mean(axis=0)))
    return PoseAnswer(off_mm <= ACCEPT_MM and off_deg <= ACCEPT_DEG, off_mm, off_deg)


def measured_ends(
    rig: Rig, bar: Bar, target_set: TargetSet | None, observations: Observations, placement: int = 0
) -> FloatArray | None:
    """The places (2, 3) in mm of the bar's first and last mark in one placement; None unless two cameras see both."""
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    in_rig = np.array([index.get(name, -1) for name in observations.cameras], dtype=np.int64)
    targets = [mark.target for mark in bar.marks.values()]
    requested = (observations.placement == placement) & np.isin(observations.target, targets)
    own = observations.select(requested & (in_rig[observations.camera] >= 0))
    if not len(own):
        return None
    features = find_features(own)
    views, noise = views_of(own, features, in_rig[own.camera], rig)
    finder = MarkFinder(own, features, triangulate_checked(views, noise), target_set)
    marks = BarMarks.of(bar.id, bar.lengths)
    places = [finder.find(placement, bar.marks[name]) for name in (marks.names[0], marks.names[-1])]
    ends = [place.place_mm for place in places if isinstance(place, MarkPlace)]
    return np.stack(ends) if len(ends) == 2 else None
