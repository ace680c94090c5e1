"""Mischief: what goes wrong with a recording, in sizes from invisible to gross, and what ought to be blamed."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.studies.judged import Reference
from benchmarks.studies.mischief_world import Pose, World
from spherecal.arrays import FloatArray
from spherecal.calibrate import CalibrationSettings
from spherecal.findings import Finding
from spherecal.geometry.rotation import exp_rotation
from spherecal.network.observations import Features, Observations
from spherecal.session.model import Session
from spherecal.simulate.ball import make_ball
from spherecal.simulate.faults import shape_changes
from spherecal.simulate.lens_errors import TrueLens
from spherecal.targets.family import make_target_set


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
        )


Make = Callable[[World, float, np.random.Generator], Case]

_IMAGE = ("wrong-placement", "image-contradicts", "stale", "swapped", "exchanged", "left-out", "identical", "image")
_MOVED = ("moved", "split")
_SCALE = ("scale", "size", "spacing", "distance", "diameter", "bar-length", "print")
_SHAPE = ("shape", "ball-changed", "placements-contradict", "ball")
_RECORDING = ("recording-contradicts", "contradicts-itself")


def _unit(rng: np.random.Generator) -> FloatArray:
    d = rng.normal(size=3)
    return d / np.linalg.norm(d)


def _changed(pose: Pose, shift: FloatArray, turn: FloatArray) -> Pose:
    """A camera's pose after a shift (mm) and a turn (rad) in its own frame."""
    r = exp_rotation(turn)
    return r @ pose[0], r @ pose[1] + shift


def _case(world: World, rng: np.random.Generator, blame: tuple[str, ...], names: tuple[str, ...] = ()) -> Case:
    return Case(
        world.session(world.record(rng), rng), world.reference(), blame + _RECORDING, names, world.settings,
        world,
    )  # fmt: skip


def _spoilt(
    world: World, rng: np.random.Generator, blame: tuple[str, ...], names: tuple[str, ...],
    change: Callable[[Observations], Observations],
) -> Case:  # fmt: skip
    """A case whose observations were changed after the recording."""
    case = _case(world, rng, blame, names)
    assert case.session.observations is not None
    return replace(case, session=replace(case.session, observations=change(case.session.observations)))


def _aligned_from(case: Case, placement: int) -> Case:
    """The case aligned with its truth by the ball as it lay after a motion: which half moved in the world is open."""
    whole = case.reference.places_of

    def places_of(features: Features, o: Observations) -> FloatArray:
        places = whole(features, o)
        places[features.placement < placement] = np.nan
        return places

    return replace(case, reference=replace(case.reference, places_of=places_of))


def _excused(case: Case, camera: str) -> Case:
    """The case without a judgement of one camera's pose, which may take up what was done to its lens."""
    return replace(case, reference=replace(case.reference, excused=frozenset({camera})))


def _camera(world: World, rng: np.random.Generator) -> int:
    return int(rng.integers(len(world.cameras)))


def _knocked(world: World, rng: np.random.Generator) -> tuple[int, int]:
    """A camera, and a placement from the second on at which it sees the ball: a later move nothing can tell."""
    while True:
        c, t = _camera(world, rng), _later(world, rng)
        if len(world.image(c, t, world.points_mm(t), world.ball.normals @ world.turns[t].T)[0]):
            return c, t


def _later(world: World, rng: np.random.Generator) -> int:
    """A placement index from the second on."""
    return int(rng.integers(1, len(world.turns)))


def nothing(world: World, size: float, rng: np.random.Generator) -> Case:
    """A clean recording; with a size, a bar gives the scale."""
    case = _case(world, rng, ())
    return replace(case, session=world.with_bar(case.session, 1.0, rng)) if size else case


def stale(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera delivers the previous placement's image, at so many placements in a row."""
    c, t = _camera(world, rng), _later(world, rng)
    times = [k for k in range(t, min(t + int(size), len(world.turns)))]

    def ball_of(camera: int, placement: int) -> Pose:
        k = t - 1 if camera == c and placement in times else placement
        return world.turns[k], world.places_mm[k]

    def change(o: Observations) -> Observations:  # the very same points, not another exposure
        uv = o.uv.copy()
        before = o.uv[(o.camera == c) & (o.placement == t - 1)]
        for k in times:
            uv[(o.camera == c) & (o.placement == k)] = before
        return replace(o, uv=uv)

    return _spoilt(replace(world, ball_of=ball_of), rng, _IMAGE, (world.ids[c],), change)


def shifted_frames(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera lost a frame: from a placement on each of its images is the next placement's."""
    c, t = _camera(world, rng), _later(world, rng)
    last = len(world.turns) - 1

    def ball_of(camera: int, placement: int) -> Pose:
        k = min(placement + 1, last) if camera == c and placement >= min(t, last - 1) else placement
        return world.turns[k], world.places_mm[k]

    return _case(replace(world, ball_of=ball_of), rng, _IMAGE, (world.ids[c],))


def typed_distance(world: World, size: float, rng: np.random.Generator) -> Case:
    """The target distance typed wrong by a factor."""
    case = _case(world, rng, _SCALE)
    scale = case.session.scale
    assert scale is not None and scale.distance_mm is not None
    return replace(case, session=replace(case.session, scale=replace(scale, distance_mm=scale.distance_mm * size)))


def printed_small(world: World, size: float, rng: np.random.Generator) -> Case:
    """Stickers printed at another scale on a ball that has its nominal size."""
    ball = world.ball
    n = ball.normals
    middle = -ball.frames[np.searchsorted(ball.targets, ball.dot_target), 2] * ball.radius_mm
    dots = middle + size * (ball.dots_mm - middle)
    dots *= (np.linalg.norm(ball.dots_mm, axis=1) / np.linalg.norm(dots, axis=1))[:, None]  # still on the ball
    return _case(replace(world, ball=replace(ball, dots_mm=dots, normals=n)), rng, _SCALE)


def bar_certificate(world: World, size: float, rng: np.random.Generator) -> Case:
    """A scale bar whose certificate says so many times its length."""
    case = _case(world, rng, _SCALE)
    return replace(case, session=world.with_bar(case.session, size, rng))


def moved(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera is knocked before a placement: a shift in mm, and as many mrad."""
    c, t = _knocked(world, rng)
    shift, turn = size * _unit(rng), 1e-3 * size * _unit(rng)

    def pose_of(camera: int, placement: int) -> Pose:
        pose = world.pose(camera, placement)
        return _changed(pose, shift, turn) if camera == c and placement >= t else pose

    return _case(replace(world, pose_of=pose_of), rng, _MOVED, (world.ids[c],))


def moved_once(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera is elsewhere at one placement and comes back."""
    c, t = _camera(world, rng), int(rng.integers(0, len(world.turns) - 1))
    shift, turn = size * _unit(rng), 1e-3 * size * _unit(rng)

    def pose_of(camera: int, placement: int) -> Pose:
        pose = world.pose(camera, placement)
        return _changed(pose, shift, turn) if camera == c and placement == t else pose

    return _case(replace(world, pose_of=pose_of), rng, (*_MOVED, *_IMAGE), (world.ids[c],))


def two_moved(world: World, size: float, rng: np.random.Generator) -> Case:
    """Two cameras are knocked before different placements."""
    pair = rng.permutation(len(world.cameras))[:2]
    at = rng.permutation(np.arange(1, len(world.turns)))[:2]
    shift, turn = [size * _unit(rng) for _ in pair], [1e-3 * size * _unit(rng) for _ in pair]

    def pose_of(camera: int, placement: int) -> Pose:
        pose = world.pose(camera, placement)
        for c, t, s, w in zip(pair, at, shift, turn, strict=True):
            if camera == c and placement >= t:
                pose = _changed(pose, s, w)
        return pose

    return _case(replace(world, pose_of=pose_of), rng, _MOVED, tuple(world.ids[c] for c in pair))


def beam(world: World, size: float, rng: np.random.Generator) -> Case:
    """Half of the cameras hang on one beam that sags, turned a little, before a placement."""
    t = _later(world, rng)
    centres = np.array([c.centre_mm for c in world.cameras])
    side = centres @ _unit(rng)
    group = set(np.argsort(side)[: max(3, len(side) // 2)].tolist())
    middle = centres[sorted(group)].mean(axis=0)
    turn, fall = exp_rotation(1e-3 * size * _unit(rng)), size * np.array([0.0, 0.0, -1.0])

    def pose_of(camera: int, placement: int) -> Pose:
        r, v = world.pose(camera, placement)
        if camera not in group or placement < t:
            return r, v
        # the camera's world moves with the beam: x_camera = R turn' (x - middle - fall) + ...
        back = turn.T
        return r @ back, r @ (middle - back @ (middle + fall)) + v

    case = _case(replace(world, pose_of=pose_of), rng, (*_MOVED, "group", "beam"))
    return _aligned_from(case, t)


def drifting(world: World, size: float, rng: np.random.Generator) -> Case:
    """All cameras drift from the first to the last placement by a total of so many mm and a tenth as many mrad."""
    n = len(world.cameras)
    shift, turn = [size * _unit(rng) for _ in range(n)], [1e-4 * size * _unit(rng) for _ in range(n)]
    last = len(world.turns) - 1

    def pose_of(camera: int, placement: int) -> Pose:
        share = placement / last
        return _changed(world.pose(camera, placement), share * shift[camera], share * turn[camera])

    return _case(replace(world, pose_of=pose_of), rng, (*_MOVED, "drift"))


def trigger_groups(world: World, size: float, rng: np.random.Generator) -> Case:
    """The ball is displaced by so many mm between the exposures of two groups of cameras, at each placement."""
    second = set(rng.permutation(len(world.cameras))[: len(world.cameras) // 2].tolist())
    shift = [size * _unit(rng) for _ in world.turns]

    def ball_of(camera: int, placement: int) -> Pose:
        return world.turns[placement], world.places_mm[placement] + (shift[placement] if camera in second else 0.0)

    return _case(replace(world, ball_of=ball_of), rng, ("ball-moved", "trigger", "exposure", "moving"))


def late_camera(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera is late, and the ball is still moving: displaced by so many mm for it, each time elsewhere."""
    c = _camera(world, rng)
    shift = [size * _unit(rng) for _ in world.turns]

    def ball_of(camera: int, placement: int) -> Pose:
        return world.turns[placement], world.places_mm[placement] + (shift[placement] if camera == c else 0.0)

    blame = ("ball-moved", "trigger", "exposure", "moving", *_MOVED, "image-contradicts")
    return _case(replace(world, ball_of=ball_of), rng, blame, (world.ids[c],))


def rolling_ball(world: World, size: float, rng: np.random.Generator) -> Case:
    """The ball rolls during the exposures: every camera sees it turned by up to so many degrees."""
    late = rng.uniform(0, 1, (len(world.turns), len(world.cameras)))
    axis = [np.deg2rad(size) * _unit(rng) for _ in world.turns]
    radius = world.ball.radius_mm

    def ball_of(camera: int, placement: int) -> Pose:
        turn = late[placement, camera] * axis[placement]
        way = radius * np.cross(turn, [0.0, 0.0, 1.0])  # on a table below it
        return exp_rotation(turn) @ world.turns[placement], world.places_mm[placement] + way

    return _case(replace(world, ball_of=ball_of), rng, ("ball-moved", "trigger", "exposure", "moving"))


def fixed_intrinsics(world: World, size: float, rng: np.random.Generator) -> Case:
    """Fixed intrinsics, all focal lengths wrong by a share; the rest of the lens is right."""
    case = _case(world, rng, ("fixed-intrinsics", "prior-focal", "intrinsics"))
    cameras = []
    for spec, true in zip(case.session.cameras, world.cameras, strict=True):
        prior = true.intrinsics.copy()
        prior[:2] *= 1 + size
        cameras.append(replace(spec, prior=prior))
    session = replace(case.session, cameras=tuple(cameras))
    return replace(case, session=session, settings=CalibrationSettings(intrinsics="fixed"))


def fixed_data_sheet(world: World, size: float, rng: np.random.Generator) -> Case:
    """Fixed intrinsics from the data sheet: no distortion, centred, each focal length wrong by up to a share."""
    world = replace(world, prior_error=size)
    case = _case(world, rng, ("fixed-intrinsics", "prior-focal", "intrinsics", "lens"))
    return replace(case, settings=CalibrationSettings(intrinsics="fixed"))


def fixed_one_placement(world: World, size: float, rng: np.random.Generator) -> Case:
    """The same with one placement."""
    return fixed_data_sheet(replace(world, turns=world.turns[:1], places_mm=world.places_mm[:1]), size, rng)


def copies(world: World, size: float, rng: np.random.Generator) -> Case:
    """Four copies of one placement: exposed again with noise (size 1), or the very same images (size 0)."""
    world = replace(world, turns=np.tile(world.turns[:1], (4, 1, 1)), places_mm=np.tile(world.places_mm[:1], (4, 1)))

    def change(o: Observations) -> Observations:
        first = o.uv[o.placement == 0]
        return o if size else replace(o, uv=np.tile(first, (4, 1)))

    return _spoilt(world, rng, ("identical", "copies", "same", "placements", "duplicate"), (), change)


def skew(world: World, size: float, rng: np.random.Generator) -> Case:
    """All sensors skewed: u shifted by so many px from the lowest to the highest row."""

    def change(o: Observations) -> Observations:
        height = np.array([c.kind.image_size[1] for c in world.cameras], dtype=float)[o.camera]
        uv = o.uv.copy()
        uv[:, 0] += size * (uv[:, 1] / height - 0.5)
        return replace(o, uv=uv)

    case = _spoilt(world, rng, ("lens", "skew", "model"), (), change)
    lengths = case.reference.lengths
    height = np.array([c.kind.image_size[1] for c in world.cameras], dtype=float)[lengths.camera]
    uv = lengths.uv.copy()
    uv[:, 0] += size * (uv[:, 1] / height - 0.5)
    everyone = frozenset(world.ids)
    return replace(
        case, reference=replace(case.reference, lengths=replace(lengths, uv=uv), excused=everyone), world=None
    )


def fisheye(world: World, size: float, rng: np.random.Generator) -> Case:
    """Fisheye lenses in Brown's model: equidistant with k1 = size."""
    lenses = []
    for lens in world.lenses:
        plain = lens.intrinsics.copy()
        plain[4:] = 0.0
        lenses.append(replace(lens, intrinsics=plain, fisheye=np.array([size, -0.1 * size, 0.02 * size, 0.0])))
    return _case(replace(world, lenses=tuple(lenses)), rng, ("lens", "model", "fisheye"))


def mirrored(world: World, size: float, rng: np.random.Generator) -> Case:
    """Images of one camera (size 1) or of all (size 0) flipped left to right."""
    c = _camera(world, rng)

    def change(o: Observations) -> Observations:
        uv = o.uv.copy()
        width = np.array([k.kind.image_size[0] for k in world.cameras], dtype=float)[o.camera]
        rows = (o.camera == c) | (not size)
        uv[rows, 0] = width[rows] - 1 - uv[rows, 0]
        return replace(o, uv=uv)

    case = _spoilt(world, rng, ("mirror", "flip"), (world.ids[c],) if size else (), change)
    return replace(case, world=None)


def exchanged_halfway(world: World, size: float, rng: np.random.Generator) -> Case:
    """Two cameras' images exchanged: from a placement on (size 1) or at one placement (size 0)."""
    a, b = (int(c) for c in rng.permutation(len(world.cameras))[:2])
    t = _later(world, rng)

    def change(o: Observations) -> Observations:
        at = (o.placement >= t) if size else (o.placement == t)
        camera = np.where(at & (o.camera == a), b, np.where(at & (o.camera == b), a, o.camera))
        out = replace(o, camera=camera)
        return out.select(np.lexsort((out.point, out.target, out.camera, out.placement)))

    return _spoilt(world, rng, _IMAGE, (world.ids[a], world.ids[b]), change)


def image_of_another(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera's image at one placement is a copy of another camera's."""
    a, b = (int(c) for c in rng.permutation(len(world.cameras))[:2])
    t = _later(world, rng)

    def change(o: Observations) -> Observations:
        rest = o.select(~((o.placement == t) & (o.camera == a)))
        copy = o.select((o.placement == t) & (o.camera == b))
        both = Observations(
            o.placements, o.cameras, o.points, np.concatenate([rest.placement, copy.placement]),
            np.concatenate([rest.camera, np.full(len(copy), a)]), np.concatenate([rest.target, copy.target]),
            np.concatenate([rest.point, copy.point]), np.concatenate([rest.uv, copy.uv]),
        )  # fmt: skip
        return both.select(np.lexsort((both.point, both.target, both.camera, both.placement)))

    return _spoilt(world, rng, _IMAGE, (world.ids[a],), change)


def binned(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's images binned 2 x 2 in the upper left of the frame: from a placement on (1), or always (0)."""
    c, t = _knocked(world, rng) if size else (_camera(world, rng), 0)

    def change(o: Observations) -> Observations:
        uv = o.uv.copy()
        rows = (o.camera == c) & (o.placement >= t)
        uv[rows] = (uv[rows] + 0.5) / 2 - 0.5
        return replace(o, uv=uv)

    case = _spoilt(world, rng, (*_IMAGE, *_MOVED, "focal", "binn", "lens"), (world.ids[c],), change)
    lengths = case.reference.lengths
    uv = lengths.uv.copy()
    own = lengths.camera == c
    uv[own] = (uv[own] + 0.5) / 2 - 0.5
    return replace(case, reference=replace(case.reference, lengths=replace(lengths, uv=uv)), world=None)


def shifted_roi(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's region of interest is shifted by so many px before a placement, and stays so."""
    c, t = _knocked(world, rng)

    def lens_of(camera: int, placement: int) -> TrueLens:
        lens = world.lenses[camera]
        if camera != c or placement < t:
            return lens
        intrinsics = lens.intrinsics.copy()
        intrinsics[2:4] += size * np.array([1.0, -0.5])
        return replace(lens, intrinsics=intrinsics)

    blame = (*_MOVED, "focus", "lens", "roi", "image")
    return _excused(_case(replace(world, lens_of=lens_of), rng, blame, (world.ids[c],)), world.ids[c])


def refocused(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera is focused again before a placement: its focal length changes by a share."""
    c, t = _knocked(world, rng)

    def lens_of(camera: int, placement: int) -> TrueLens:
        lens = world.lenses[camera]
        if camera != c or placement < t:
            return lens
        intrinsics = lens.intrinsics.copy()
        intrinsics[:2] *= 1 + size
        return replace(lens, intrinsics=intrinsics)

    blame = (*_MOVED, "focus", "lens", "focal")
    return _excused(_case(replace(world, lens_of=lens_of), rng, blame, (world.ids[c],)), world.ids[c])


def two_stickers(world: World, size: float, rng: np.random.Generator) -> Case:
    """So many pairs of stickers bear one number."""
    pairs = rng.permutation(world.ball.targets)[: 2 * int(size)].reshape(-1, 2)

    def change(o: Observations) -> Observations:
        target = o.target.copy()
        for a, b in pairs:
            target[target == b] = a
        keys = np.stack([o.placement, o.camera, target, o.point])
        order = np.lexsort((rng.random(len(target)), *keys[::-1]))  # where both are seen one of them stays
        first = np.ones(len(order), dtype=bool)
        first[1:] = (keys[:, order[1:]] != keys[:, order[:-1]]).any(axis=0)
        return replace(o, target=target).select(order[first])

    return _spoilt(world, rng, ("target", "sticker", "duplicate"), (), change)


def other_ball(world: World, size: float, rng: np.random.Generator) -> Case:
    """At one placement another ball of the same set was used; size is the share of its radius."""
    t = _later(world, rng)
    targets = make_target_set(int(world.ball.targets.max()))
    other = make_ball(targets, tuple(int(k) for k in world.ball.targets), rng, size * world.ball.radius_mm)
    world = replace(world, shape_of=lambda placement: other if placement == t else world.ball)
    return _case(world, rng, (*_SHAPE, *_IMAGE), (world.placements[t],))


def bent_ball(world: World, size: float, rng: np.random.Generator) -> Case:
    """The ball is bent by so many mm (rms) from placement to placement."""
    changes = shape_changes(world.ball, len(world.turns), size, "smooth", rng)
    bent = [replace(world.ball, dots_mm=world.ball.dots_mm + change) for change in changes]
    return _case(replace(world, shape_of=lambda placement: bent[placement]), rng, (*_SHAPE, "soft", "free"))


def older_placement(world: World, size: float, rng: np.random.Generator) -> Case:
    """One placement is of an older session: all cameras stood elsewhere by so many mm and mrad."""
    t = int(rng.integers(0, len(world.turns) - 1))
    n = len(world.cameras)
    shift, turn = [size * _unit(rng) for _ in range(n)], [1e-3 * size * _unit(rng) for _ in range(n)]

    def pose_of(camera: int, placement: int) -> Pose:
        pose = world.pose(camera, placement)
        return _changed(pose, shift[camera], turn[camera]) if placement == t else pose

    blame = (*_SHAPE, *_MOVED, "placement", "left-out")
    return _case(replace(world, pose_of=pose_of), rng, blame, (world.placements[t],))


def wrong_pitch(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's pixel pitch is wrong by a factor, so is its focal length in px."""
    c = _camera(world, rng)
    case = _case(world, rng, ("focal", "pitch", "prior"), (world.ids[c],))
    cameras = list(case.session.cameras)
    prior = cameras[c].prior.copy()
    prior[:2] *= size
    cameras[c] = replace(cameras[c], prior=prior)
    return replace(case, session=replace(case.session, cameras=tuple(cameras)))


@dataclass(frozen=True)
class Mischief:
    """A kind of mischief and its sizes; `row` is that of the issue's table, empty for those thought up here."""

    name: str
    make: Make
    sizes: tuple[float, ...]
    unit: str = ""
    row: str = ""


KINDS: tuple[Mischief, ...] = (
    Mischief("nothing", nothing, (0, 1), "bar"),
    Mischief("stale image", stale, (1, 2), "placements", "A"),
    Mischief("distance typed wrong", typed_distance, (0.495, 0.8, 0.97), "x", "B"),
    Mischief("stickers printed small", printed_small, (0.9, 0.97), "x", "C"),
    Mischief("bar's certificate wrong", bar_certificate, (1.2, 1.05, 1.02), "x", "D"),
    Mischief("camera moved", moved, (0.01, 0.1, 0.3, 3, 30), "mm and mrad", "E"),
    Mischief("beam sags", beam, (0.02, 0.2, 2), "mm and mrad", "F"),
    Mischief("ball moved between trigger groups", trigger_groups, (0.01, 0.05, 0.2, 1, 5), "mm", "G"),
    Mischief("fixed focal lengths wrong", fixed_intrinsics, (0.001, 0.015), "x", "H"),
    Mischief("fixed data-sheet intrinsics", fixed_data_sheet, (0.015,), "x", "H"),
    Mischief("the same, one placement", fixed_one_placement, (0.015,), "x", "H"),
    Mischief("copies of one placement", copies, (0, 1), "noise", "I"),
    Mischief("skew", skew, (0.2, 2, 8), "px", "J"),
    Mischief("fisheye lenses", fisheye, (0.0, 0.3), "k1", "J"),
    Mischief("mirrored", mirrored, (1, 0), "camera", "mirrored"),
    Mischief("camera elsewhere once", moved_once, (0.1, 1, 30), "mm and mrad"),
    Mischief("two cameras moved", two_moved, (0.1, 1, 10), "mm and mrad"),
    Mischief("all cameras drift", drifting, (0.02, 0.2, 1), "mm"),
    Mischief("one camera late", late_camera, (0.05, 0.3, 3), "mm"),
    Mischief("ball rolls", rolling_ball, (0.005, 0.05, 1), "deg"),
    Mischief("frame lost", shifted_frames, (1,)),
    Mischief("cameras exchanged", exchanged_halfway, (1, 0), "halfway"),
    Mischief("image of another camera", image_of_another, (1,)),
    Mischief("images binned", binned, (1, 0), "from a placement on"),
    Mischief("region of interest shifted", shifted_roi, (0.2, 2, 8, 64), "px"),
    Mischief("focus changed", refocused, (0.0001, 0.001, 0.01), "x"),
    Mischief("stickers with one number", two_stickers, (1, 3, 10), "pairs"),
    Mischief("another ball at one placement", other_ball, (1.0, 0.8), "x"),
    Mischief("ball bent", bent_ball, (0.02, 0.2, 2), "mm"),
    Mischief("placement of an older session", older_placement, (0.05, 0.5, 5), "mm and mrad"),
    Mischief("pixel pitch wrong", wrong_pitch, (1.39, 0.72), "x"),
)
