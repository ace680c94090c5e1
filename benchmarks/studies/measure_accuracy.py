"""Measured points, distances and poses against the truth: errors and what was stated of them."""

from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from benchmarks.studies.measured_world import Path, World
from spherecal.base.arrays import FloatArray
from spherecal.geometry.rotation import log_rotation
from spherecal_measuring.measured_sets import MeasuredSet
from spherecal_measuring.measurer import Measurer
from spherecal_measuring.measuring_task import Body, BodyPoint, PointName, Ruler, Task

_CHI2_95 = {3: 7.815, 6: 12.592}


@dataclass
class Errors:
    """Errors and stated uncertainties of one kind of motion, gathered over worlds."""

    points: list[FloatArray] = field(default_factory=list)  # mm
    stated: list[FloatArray] = field(default_factory=list)  # covariances
    distances: list[tuple[float, float]] = field(default_factory=list)  # error, u
    poses: list[float] = field(default_factory=list)  # chi-square of six
    pose_mm: list[float] = field(default_factory=list)
    asked: int = 0  # targets that the rig may measure, seen by two cameras

    def row(self) -> tuple[object, ...]:
        """Targets measured of those seen; median and rms error, the same of u, held in 95 %; distances; poses."""
        off, cov = np.array(self.points), np.array(self.stated)
        chi = np.einsum("ni,ni->n", off, np.linalg.solve(cov, off[:, :, None])[:, :, 0])
        d = np.array(self.distances).reshape(-1, 2)
        held = 100 * float((np.abs(d[:, 0]) <= 1.96 * d[:, 1]).mean()) if len(d) else float("nan")
        poses = np.array(self.poses)
        return (
            f"{100 * len(off) / self.asked:.0f} %",
            float(np.median(np.linalg.norm(off, axis=1))),
            float(np.median(np.sqrt(np.einsum("nii->n", cov)))),
            rms3(off),
            float(np.sqrt(np.einsum("nii->n", cov).mean())),
            f"{100 * (chi <= _CHI2_95[3]).mean():.0f} %",
            float(np.sqrt((d[:, 0] ** 2).mean())),
            float(np.sqrt((d[:, 1] ** 2).mean())),
            f"{held:.0f} %",
            float(np.sqrt(np.square(self.pose_mm).mean())) if self.pose_mm else float("nan"),
            f"{100 * (poses <= _CHI2_95[6]).mean():.0f} %" if len(poses) else "-",
        )

    @property
    def held(self) -> float:
        """Share of the points whose stated uncertainty holds their error in 95 %."""
        off, cov = np.array(self.points), np.array(self.stated)
        chi = np.einsum("ni,ni->n", off, np.linalg.solve(cov, off[:, :, None])[:, :, 0])
        return float((chi <= _CHI2_95[3]).mean())


COLUMNS = (
    "motion", "targets measured", "point: median error, mm", "median u, mm", "rms error, mm", "rms u, mm",
    "held by 95 % limits", "distance: rms error, mm",
    "rms u, mm", "held", "pose: rms error, mm", "held",
)  # fmt: skip


def rms3(vectors: FloatArray) -> float:
    """The root mean square length."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def body_of(world: World, most: int = 60) -> Body:
    """A body of some of the targets, by their true centres."""
    centres = world.centres(np.eye(3), np.zeros(3))
    chosen = list(centres)[:: max(len(centres) // most, 1)]
    return Body("body", tuple(BodyPoint(name, tuple(centres[name].tolist())) for name in chosen))


def measure_motion(
    world: World,
    path: Path,
    skew_s: float,
    task: Task,
    sets: int,
    rng: np.random.Generator,
    errors: Errors,
    exposures: bool = True,
) -> None:
    """Sets along a path; those from the third on count, when velocities are known.

    Skew: each camera's own in every set, even. Without `exposures` nobody knows of the moments.
    """
    names = [PointName(int(t)) for t in world.targets[:: max(len(world.targets) // 10, 1)]]
    rulers = tuple(Ruler(pair) for pair in combinations(names, 2))
    task = Task(
        world.session.target_set, (), rulers, (), (body_of(world),), None, task.exposure_sd_s, task.correct_exposure
    )
    measurer = Measurer(world.rig, task)
    for number in range(1, sets + 1):
        late = rng.uniform(-skew_s / 2, skew_s / 2, len(world.truth.cameras))
        observed = world.seen(path, number, rng, late - late.mean())
        observed = observed if exposures else replace(observed, exposure_s=None)
        found = measurer.measure(observed)
        if number >= 3:
            rotation, place = path((number - 1) / 10.0)
            _compare(world, found, rotation, place, errors)
            o = observed.observations
            pairs = np.unique(np.stack([o.target, o.camera]), axis=1)
            errors.asked += int((np.unique(pairs[0], return_counts=True)[1] >= 2).sum())


def _compare(world: World, found: MeasuredSet, rotation: FloatArray, place: FloatArray, errors: Errors) -> None:
    centres, move = world.centres(rotation, place), world.to_truth
    turn = move.rotation
    for i, name in enumerate(found.names):
        errors.points.append(move.apply(found.points_mm[i][None])[0] - centres[name])
        errors.stated.append(turn @ found.covariance_mm2[i] @ turn.T)
    for value in found.values:
        first, second = (PointName(int(text)) for text in value.name.split("-"))
        true = float(np.linalg.norm(centres[second] - centres[first]))
        errors.distances.append((value.value - true, value.u))
    for pose in found.bodies:
        r, t = turn @ pose.rotation, move.apply(pose.translation_mm[None])[0]
        off = np.concatenate([turn.T @ log_rotation(rotation @ r.T), turn.T @ (place - t)])
        errors.poses.append(float(off @ np.linalg.solve(pose.covariance, off)))
        errors.pose_mm.append(float(np.linalg.norm(place - t)))
