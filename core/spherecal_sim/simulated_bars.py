"""Reference bars in the simulated measuring volume."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.data.observations import Observations
from spherecal.data.session import Bar, BarLength, BarPose, Mark
from spherecal_sim.observe import ObservingCameras, lens_misfit, look, observe
from spherecal_sim.rigs import random_rotations
from spherecal_sim.truth import TrueBar, TrueBarPose, Truth

MARKS_MM = {"A": (0.0, 100.0, 300.0, 500.0), "B": (0.0, 120.0, 280.0, 500.0)}
# the distances that [Tao21] reports, and A's full length
_LENGTHS = {"A": ((1, 2), (3, 4), (1, 4)), "B": ((1, 2), (1, 3), (1, 4))}
_PLACED_SD_MM = 0.05  # marks are glued on by hand; the certificate says where they are
_CERTIFICATE_MM = 0.004  # expanded, k = 2
_STEEL_PER_KELVIN = 1.15e-5
_MIN_VIEWS = 3
_THERMOMETER_SD_C = 0.05


def make_bars(first_target: int, rng: np.random.Generator) -> tuple[TrueBar, ...]:
    """The two bars, with coded marks from target id `first_target` on."""
    bars = []
    for bar_id, nominal in MARKS_MM.items():
        targets = tuple(range(first_target, first_target + len(nominal)))
        first_target += len(nominal)
        names = tuple(f"{bar_id}{i + 1}" for i in range(len(nominal)))
        x = np.array(nominal) + rng.normal(0.0, _PLACED_SD_MM, len(nominal))
        bars.append(TrueBar(bar_id, names, targets, x, _STEEL_PER_KELVIN, 20.0))
    return tuple(bars)


def certify(bars: tuple[TrueBar, ...], scale_bar: str | None, rng: np.random.Generator) -> tuple[Bar, ...]:
    """The bars as a session describes them, with errors of their stated uncertainty; one the scale, or all check."""
    certified = []
    for bar in bars:
        lengths = []
        for first, last in _LENGTHS[bar.id]:
            true = bar.x_mm[last - 1] - bar.x_mm[first - 1]
            value = round(float(true + rng.normal(0.0, _CERTIFICATE_MM / 2)), 6)
            lengths.append(BarLength(f"{bar.id}{first}", f"{bar.id}{last}", value, _CERTIFICATE_MM, 2.0))
        marks = {name: Mark(target, "centre") for name, target in zip(bar.marks, bar.targets, strict=True)}
        role = "scale" if bar.id == scale_bar else "check"
        certified.append(
            Bar(bar.id, role, marks, tuple(lengths), bar.expansion_per_kelvin, bar.reference_temperature_c)
        )
    return tuple(certified)


def mark_places(bar: TrueBar, pose: TrueBarPose, flat_mm: FloatArray) -> FloatArray:
    """World places of points of a bar's marks, (marks, points, 3) mm, from those on their stickers, (.., 2) mm."""
    stretch = 1 + bar.expansion_per_kelvin * (pose.temperature_c - bar.reference_temperature_c)
    x = np.zeros((*flat_mm.shape[:2], 3))
    x[..., :2] = flat_mm
    x[..., 0] += stretch * bar.x_mm[:, None]
    return x @ pose.rotation.T + pose.place_mm


def pose_bars(
    bars: tuple[TrueBar, ...],
    count: int,
    view: ObservingCameras,
    volume_mm: FloatArray,
    view_limit_deg: float | None,
    rng: np.random.Generator,
) -> tuple[TrueBarPose, ...]:
    """At most `count` poses of each bar over the volume (2, 3) mm, every mark inside it and in at least 3 views."""
    poses = []
    for bar in bars:
        rotations, places = _fitting_poses(bar.x_mm, count, view, volume_mm, view_limit_deg, rng)
        temperatures = rng.uniform(20.5, 23.0, len(places))
        for i, (r, p, c) in enumerate(zip(rotations, places, temperatures, strict=True)):
            poses.append(TrueBarPose(f"{bar.id}-{i + 1:02d}", bar.id, r, p, float(c)))
    return tuple(poses)


def recorded_poses(poses: tuple[TrueBarPose, ...], rng: np.random.Generator) -> tuple[BarPose, ...]:
    """The poses as a session states them: with the temperature that was read."""
    return tuple(
        BarPose(p.id, p.bar, round(p.temperature_c + float(rng.normal(0.0, _THERMOMETER_SD_C)), 2)) for p in poses
    )


_BATCH = 400
_BATCHES = 50


def _fitting_poses(
    x_mm: FloatArray,
    count: int,
    view: ObservingCameras,
    volume_mm: FloatArray,
    view_limit_deg: float | None,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Random rotations (count, 3, 3) and places (count, 3) of a bar that pass; drawn in batches, first come."""
    low, high = volume_mm
    found_r, found_p = [np.empty((0, 3, 3))], [np.empty((0, 3))]
    for _ in range(_BATCHES):
        if sum(map(len, found_p)) >= count:
            break
        rotations = random_rotations(_BATCH, rng)
        middle = rng.uniform(low, high, (_BATCH, 3))
        places = middle - rotations[:, :, 0] * (x_mm[0] + x_mm[-1]) / 2
        marks = places[:, None] + x_mm[:, None] * rotations[:, None, :, 0]
        good = ((marks >= low) & (marks <= high)).all(axis=(1, 2))
        rotations, places, marks = rotations[good], places[good], marks[good]
        if not len(places):
            continue
        normals = None if view_limit_deg is None else np.repeat(-rotations[:, :, 2], len(x_mm), axis=0)
        seen = observe(view, marks.reshape(-1, 3), normals, view_limit_deg or 90.0)
        views = np.bincount(seen.point, minlength=len(places) * len(x_mm)).reshape(len(places), -1)
        good = (views >= _MIN_VIEWS).all(axis=1)
        found_r.append(rotations[good])
        found_p.append(places[good])
    return np.concatenate(found_r)[:count], np.concatenate(found_p)[:count]


@dataclass(frozen=True)
class StudyBars:
    """Bars for studies: true ends (n, 2, 3) mm, lengths (n,) mm; observed as placement i, targets 1 and 2, centre."""

    ends_mm: FloatArray
    lengths_mm: FloatArray
    observations: Observations


STUDY_LENGTHS_MM = (100.0, 200.0, 300.0, 400.0, 500.0)
_STUDY_POSES = 8  # of each


def study_bars(truth: Truth, rng: np.random.Generator) -> StudyBars:
    """Random bars of 100 to 500 mm in the volume, both ends in at least 3 views, with the noise of the session."""
    view = look(truth.cameras)
    ends = []
    for length in STUDY_LENGTHS_MM:
        x = np.array([0.0, length])
        rotations, places = _fitting_poses(x, _STUDY_POSES, view, truth.volume_mm, None, rng)
        ends.append(places[:, None] + x[:, None] * rotations[:, None, :, 0])
    ends_mm = np.concatenate(ends)
    seen = observe(view, ends_mm.reshape(-1, 3), None)
    order = np.lexsort((seen.point % 2, seen.camera, seen.point // 2))
    camera, end, uv = seen.camera[order], seen.point[order], seen.uv[order]
    uv = uv + lens_misfit(uv, view.sizes[camera], truth.misfit_phases[camera], truth.options.misfit_px)
    observations = Observations(
        placements=tuple(f"S{i + 1:02d}" for i in range(len(ends_mm))), cameras=tuple(c.id for c in truth.cameras),
        points=("centre",), placement=end // 2, camera=camera, target=1 + end % 2,
        point=np.zeros(len(end), dtype=np.int64), uv=uv + rng.normal(size=uv.shape) * truth.sigma_px[camera, None],
    )  # fmt: skip
    return StudyBars(ends_mm, np.linalg.norm(ends_mm[:, 1] - ends_mm[:, 0], axis=1), observations)
