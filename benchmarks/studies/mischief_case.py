"""A recording with mischief, and what the kinds of mischief have in common."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.simulators.lens_errors import TrueLens
from benchmarks.studies.judged import Reference
from benchmarks.studies.mischief_world import Pose, World
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.data.findings import Finding
from spherecal.data.observations import Features, Observations
from spherecal.data.session import Session
from spherecal.geometry.rotation import exp_rotation
from spherecal.steps.settings import CalibrationSettings


@dataclass(frozen=True)
class Case:
    """A recording with mischief, its truth, and what ought to be blamed.

    `blame`: parts of finding codes, one of which must be in a warning or error (or an info of something repaired) that
    names one of `names`, if there are any. `settings` of the calibration. `world`: the rig as it is afterwards, where
    it can be recorded again.
    """

    session: Session
    reference: Reference
    blame: tuple[str, ...]
    names: tuple[str, ...] = ()
    settings: CalibrationSettings = field(default_factory=CalibrationSettings)
    world: World | None = None

    def blamed(self, findings: tuple[Finding, ...]) -> bool:
        """Whether the right thing was blamed."""
        return any(
            any(part in f.code for part in self.blame) and (not self.names or bool(set(self.names) & set(f.where)))
            for f in findings
            if f.code != "scale-uncertainty"  # every result says that
        )


# Frames of a board or bar, of which a few at the end tell nothing of a camera.
MANY = 15

Make = Callable[[World, float, np.random.Generator], Case]

IMAGE = ("wrong-placement", "image-contradicts", "stale", "swapped", "exchanged", "left-out", "identical", "image")
MOVED = ("moved", "split")
SCALE = ("scale", "size", "spacing", "distance", "diameter", "bar-length", "print")
SHAPE = ("shape", "ball-changed", "placements-contradict", "ball")
RECORDING = ("recording-contradicts", "contradicts-itself")


def direction(rng: np.random.Generator) -> FloatArray:
    d = rng.normal(size=3)
    return d / np.linalg.norm(d)


def displaced(pose: Pose, shift: FloatArray, turn: FloatArray) -> Pose:
    """A camera's pose after a shift (mm) and a turn (rad) in its own frame."""
    r = exp_rotation(turn)
    return r @ pose[0], r @ pose[1] + shift


def make_case(world: World, rng: np.random.Generator, blame: tuple[str, ...], names: tuple[str, ...] = ()) -> Case:
    return Case(
        world.session(world.record(rng), rng), world.reference(), blame + RECORDING, names, world.settings, world
    )


def spoilt(
    world: World,
    rng: np.random.Generator,
    blame: tuple[str, ...],
    names: tuple[str, ...],
    change: Callable[[Observations], Observations],
) -> Case:
    """A case whose observations were changed after the recording."""
    case = make_case(world, rng, blame, names)
    assert case.session.observations is not None
    return replace(case, session=replace(case.session, observations=change(case.session.observations)))


def in_order(o: Observations) -> Observations:
    return o.select(np.lexsort((o.point, o.target, o.camera, o.placement)))


def with_copy(o: Observations, keep: BoolArray, copied: BoolArray, camera: int) -> Observations:
    """Observations that are kept (n,), and others once more, as a camera's (index)."""
    both = o.select(np.concatenate([np.flatnonzero(keep), np.flatnonzero(copied)]))
    return in_order(replace(both, camera=np.concatenate([o.camera[keep], np.full(copied.sum(), camera)])))


def aligned_from(case: Case, placement: int) -> Case:
    """The case aligned with its truth by the ball as it lay after a motion: which half moved in the world is open."""
    whole = case.reference.places_of

    def places_of(features: Features, o: Observations) -> FloatArray:
        places = whole(features, o)
        places[features.placement < placement] = np.nan
        return places

    return replace(case, reference=replace(case.reference, places_of=places_of))


def excusing(case: Case, camera: str) -> Case:
    """The case without a judgement of one camera's pose, which may take up what was done to its lens."""
    return replace(case, reference=replace(case.reference, excused=frozenset({camera})))


def with_lens(world: World, camera: int, change: Callable[[FloatArray, int], None]) -> World:
    """The world in which one camera's intrinsics (16,) are changed in place, at each placement (index)."""

    def lens_of(c: int, placement: int) -> TrueLens:
        lens = world.lenses[c]
        if c != camera:
            return lens
        intrinsics = lens.intrinsics.copy()
        change(intrinsics, placement)
        return replace(lens, intrinsics=intrinsics)

    return replace(world, lens_of=lens_of)


def showing(world: World, camera: int, frame: Callable[[int], int]) -> World:
    """The world in which one camera's image of a placement shows the ball at another, `frame(placement)`."""
    last = len(world.turns) - 1

    def ball_of(c: int, placement: int) -> Pose:
        k = min(max(frame(placement), 0), last) if c == camera else placement
        return world.turns[k], world.places_mm[k]

    return replace(world, ball_of=ball_of)


def any_camera(world: World, rng: np.random.Generator) -> int:
    return int(rng.integers(len(world.cameras)))


def seen_placement(world: World, rng: np.random.Generator) -> tuple[int, int]:
    """A camera, and a placement from the second on at which it sees the ball: a later move would not show."""
    while True:
        c, t = any_camera(world, rng), later_placement(world, rng)
        if sees_ball(world, c, t):
            return c, t


def sees_ball(world: World, camera: int, placement: int) -> bool:
    normals = world.normals(world.ball, world.turns[placement])
    return len(world.image(camera, placement, world.points_mm(placement), normals)[0]) > 0


def later_placement(world: World, rng: np.random.Generator) -> int:
    """A placement index from the second on; of many frames one that has a fifth of them on either side."""
    frames = len(world.turns)
    return int(rng.integers(*((1, frames) if frames < MANY else (frames // 5, frames - frames // 5))))
