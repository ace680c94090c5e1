"""Mischief with one camera's images, with the shape of ball and board, and with what gives the scale."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.studies.mischief_case import (
    IMAGE,
    MOVED,
    SCALE,
    SHAPE,
    Case,
    any_camera,
    direction,
    displaced,
    excusing,
    later_placement,
    make_case,
    seen_placement,
    showing,
    spoilt,
    with_lens,
)
from benchmarks.studies.mischief_frames import LATE
from benchmarks.studies.mischief_world import Pose, World
from spherecal.base.arrays import FloatArray
from spherecal.data.observations import Observations
from spherecal.data.session import Scale
from spherecal.geometry.rotation import exp_rotation
from spherecal_sim.simulated_ball import Ball

# What touches one camera alone: its name, and none of the ball's motion.
ALONE = (*MOVED, *IMAGE, "unsteady", "lens", "focus", "focal", "noisy", "scatter", "outlier")
_GLASS_INDEX, _GLASS_TILT = 1.5, np.deg2rad(20.0)


def _without(case: Case, camera: str) -> Case:
    """The case without a judgement of a camera whose images do not say which of two it is."""
    lengths, c = case.reference.lengths, case.reference.ids.index(camera)
    keep = lengths.camera != c
    kept = replace(lengths, end=lengths.end[keep], camera=lengths.camera[keep], uv=lengths.uv[keep])
    return excusing(replace(case, reference=replace(case.reference, lengths=kept), world=None), camera)


def _through(case: Case, camera: int, seen: Callable[[FloatArray], FloatArray]) -> Case:
    """The case with all that a camera sees, the lengths to measure too, at other places in its image."""
    o, lengths = case.session.observations, case.reference.lengths
    assert o is not None
    uv, ends = o.uv.copy(), lengths.uv.copy()
    uv[o.camera == camera] = seen(uv[o.camera == camera])
    ends[lengths.camera == camera] = seen(ends[lengths.camera == camera])
    session = replace(case.session, observations=replace(o, uv=uv))
    reference = replace(case.reference, lengths=replace(lengths, uv=ends))
    return excusing(replace(case, session=session, reference=reference, world=None), case.reference.ids[camera])


def focus_creeps(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's focal length grows by a share from the first placement to the last."""
    c, last = any_camera(world, rng), len(world.turns) - 1

    def change(intrinsics: FloatArray, placement: int) -> None:
        intrinsics[:2] *= 1 + size * placement / last

    return excusing(make_case(with_lens(world, c, change), rng, ALONE, (world.ids[c],)), world.ids[c])


def slow_move(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera sinks by so many mm, and as many mrad, from the first placement to the last."""
    c, last = any_camera(world, rng), len(world.turns) - 1
    shift, turn = size * direction(rng), 1e-3 * size * direction(rng)

    def pose_of(camera: int, placement: int) -> Pose:
        pose, share = world.pose(camera, placement), placement / last
        return displaced(pose, share * shift, share * turn) if camera == c else pose

    return make_case(replace(world, pose_of=pose_of), rng, ALONE, (world.ids[c],))


def vibration(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera shakes: in each image it is elsewhere by some mm, and as many mrad."""
    c = any_camera(world, rng)
    shifts = size * rng.normal(size=(len(world.turns), 3))
    turns = 1e-3 * size * rng.normal(size=(len(world.turns), 3))

    def pose_of(camera: int, placement: int) -> Pose:
        pose = world.pose(camera, placement)
        return displaced(pose, shifts[placement], turns[placement]) if camera == c else pose

    case = make_case(replace(world, pose_of=pose_of), rng, ALONE, (world.ids[c],))
    return _without(replace(case, reference=world.reference()), world.ids[c])


def haze(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's lens is hazy: noise of so many px, and a third of its dots lost."""
    c = any_camera(world, rng)

    def change(o: Observations) -> Observations:
        own = o.camera == c
        uv = o.uv + np.where(own[:, None], rng.normal(0.0, size, o.uv.shape), 0.0)
        return replace(o, uv=uv).select(~own | (rng.random(len(own)) > 1 / 3))

    return spoilt(world, rng, ALONE, (world.ids[c],), change)


def local_fault(world: World, size: float, rng: np.random.Generator) -> Case:
    """A drop on one camera's lens: towards a place of its image, dots are shifted by up to so many px."""
    c = any_camera(world, rng)
    width, height = world.cameras[c].kind.image_size
    middle, reach = rng.uniform(0.3, 0.7, 2) * (width, height), 0.12 * width
    way = direction(rng)[:2]

    def seen(uv: FloatArray) -> FloatArray:
        near = np.exp(-(((uv - middle) / reach) ** 2).sum(axis=1) / 2)
        return uv + size * near[:, None] * way

    return _through(make_case(world, rng, ALONE, (world.ids[c],)), c, seen)


def glass(world: World, size: float, rng: np.random.Generator) -> Case:
    """A pane of so many mm is put before one camera before a placement, tilted by 20 degrees."""
    c, t = seen_placement(world, rng)
    tilt = rng.uniform(0, 2 * np.pi)
    normal = exp_rotation(_GLASS_TILT * np.array([np.cos(tilt), np.sin(tilt), 0.0])) @ np.array([0.0, 0.0, 1.0])

    def glass_of(camera: int, placement: int, x: FloatArray) -> FloatArray:
        if camera != c or placement < t:
            return x
        cosine = x @ normal / np.linalg.norm(x, axis=1)
        inside = np.sqrt(1 - (1 - cosine**2) / _GLASS_INDEX**2)
        return x - size * (1 - cosine / (_GLASS_INDEX * inside))[:, None] * normal

    return excusing(make_case(replace(world, glass_of=glass_of), rng, ALONE, (world.ids[c],)), world.ids[c])


def half_turned(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's images are turned by 180 degrees from a placement on."""
    c, t = seen_placement(world, rng)

    def change(o: Observations) -> Observations:
        own = (o.camera == c) & (o.placement >= t)
        turned = np.array(world.cameras[c].kind.image_size) - 1 - o.uv
        return replace(o, uv=np.where(own[:, None], turned, o.uv))

    blame = (*MOVED, *IMAGE, "mirrored", "unsteady")
    return _without(spoilt(world, rng, blame, (world.ids[c],), change), world.ids[c])


def axes_exchanged(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's image points have u and v exchanged."""
    c = any_camera(world, rng)

    def change(o: Observations) -> Observations:
        return replace(o, uv=np.where((o.camera == c)[:, None], o.uv[:, ::-1], o.uv))

    return _without(spoilt(world, rng, ("mirrored", *IMAGE, "unlinked"), (world.ids[c],), change), world.ids[c])


def whole_pixels(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's image points are rounded to so many px."""
    c = any_camera(world, rng)

    def change(o: Observations) -> Observations:
        return replace(o, uv=np.where((o.camera == c)[:, None], size * np.rint(o.uv / size), o.uv))

    return spoilt(world, rng, ALONE, (world.ids[c],), change)


def reflections(world: World, size: float, rng: np.random.Generator) -> Case:
    """A share of one camera's targets is read from a mirror image, to the side of where they are."""
    c = any_camera(world, rng)
    targets = np.unique(world.ball.dot_target)
    chosen = rng.permutation(targets)[: max(1, round(size * len(targets)))]
    axis = rng.uniform(0.3, 0.7) * world.cameras[c].kind.image_size[0]

    def change(o: Observations) -> Observations:
        own = (o.camera == c) & np.isin(o.target, chosen)
        uv = o.uv.copy()
        uv[own, 0] = 2 * axis - uv[own, 0]
        return replace(o, uv=uv)

    return spoilt(world, rng, (*ALONE, "target"), (world.ids[c],), change)


def lenses_exchanged(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera gets another lens of its kind before a placement: all intrinsics differ by so many parts of them."""
    c, t = seen_placement(world, rng)
    by = size * rng.uniform(-1, 1, 4)

    def change(intrinsics: FloatArray, placement: int) -> None:
        if placement >= t:
            intrinsics[:2] *= 1 + by[0]
            intrinsics[2:4] += by[1:3] * intrinsics[0]
            intrinsics[4] += 10 * by[3]

    return excusing(make_case(with_lens(world, c, change), rng, ALONE, (world.ids[c],)), world.ids[c])


def fixed_k3(world: World, size: float, rng: np.random.Generator) -> Case:
    """Fixed lenses, three of them off in k3 by so much."""
    case = make_case(world, rng, ("fixed-intrinsics", "intrinsics", "lens"))
    cameras, off = [], set(rng.permutation(len(world.cameras))[:3].tolist())
    for c, (spec, true) in enumerate(zip(case.session.cameras, world.cameras, strict=True)):
        prior = true.intrinsics.copy()
        prior[8] += size if c in off else 0.0
        cameras.append(replace(spec, prior=prior))
    session = replace(case.session, cameras=tuple(cameras))
    return replace(case, session=session, settings=replace(case.settings, intrinsics="fixed"))


def flattened(world: World, size: float, rng: np.random.Generator) -> Case:
    """The ball's weight flattens it, however it is turned: by so many mm of its diameter, and wider by half of it."""
    ball = world.ball

    def shape_of(placement: int) -> Ball:
        up = world.turns[placement].T @ np.array([0.0, 0.0, 1.0])
        height = ball.dots_mm @ up / ball.radius_mm
        squeezed = ball.dots_mm * (1 + size / 4 / ball.radius_mm) - 0.75 * size * np.outer(height, up)
        return replace(ball, dots_mm=squeezed)

    return make_case(replace(world, shape_of=shape_of), rng, (*SHAPE, "soft", "free", "flattened"))


def _stickers(ball: Ball, factor: float) -> Ball:
    """The ball with stickers so many times as large."""
    middle = -ball.frames[np.searchsorted(ball.targets, ball.dot_target), 2] * ball.radius_mm
    return replace(ball, dots_mm=middle + factor * (ball.dots_mm - middle))


def two_sheets(world: World, size: float, rng: np.random.Generator) -> Case:
    """Half of the stickers are of another sheet, printed larger by a share."""
    ball, targets = world.ball, np.unique(world.ball.dot_target)
    other = np.isin(ball.dot_target, rng.permutation(targets)[::2])
    dots = np.where(other[:, None], _stickers(ball, 1 + size).dots_mm, ball.dots_mm)
    return make_case(replace(world, ball=replace(ball, dots_mm=dots)), rng, ("print", "stickers"))


def warming_bar(world: World, size: float, rng: np.random.Generator) -> Case:
    """The waved bar grows by so many ppm from the first frame to the last, as by a warm hand."""
    last, bar = len(world.turns) - 1, world.ball
    grown = replace(world, shape_of=lambda frame: replace(bar, dots_mm=bar.dots_mm * (1 + 1e-6 * size * frame / last)))
    return make_case(grown, rng, ("bar-poses",))


def bending_bar(world: World, size: float, rng: np.random.Generator) -> Case:
    """The waved bar's length is off by a random amount in each frame, with a standard deviation of so many mm."""
    change, bar = 1 + size * rng.normal(size=len(world.turns)) / np.ptp(world.ball.dots_mm[:, 0]), world.ball
    unsteady = replace(world, shape_of=lambda frame: replace(bar, dots_mm=bar.dots_mm * change[frame]))
    return make_case(unsteady, rng, ("bar-poses",))


def shrinking_stickers(world: World, size: float, rng: np.random.Generator) -> Case:
    """Stickers shrink by a share from the first placement to the last, on a ball that does not."""
    last = len(world.turns) - 1
    world_ = replace(world, shape_of=lambda placement: _stickers(world.ball, 1 - size * placement / last))
    return make_case(world_, rng, ("stickers", *SCALE))


def dots_outward(world: World, size: float, rng: np.random.Generator) -> Case:
    """Every dot is found too far from its target's middle by so many px, as blur of the printed frame does it."""

    def change(o: Observations) -> Observations:
        key = np.stack([o.placement, o.camera, o.target], axis=1)
        image, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)[1:]
        image = image.reshape(-1)
        middle = np.stack([np.bincount(image, o.uv[:, i]) / count for i in (0, 1)], axis=1)[image]
        out = o.uv - middle
        far = np.linalg.norm(out, axis=1, keepdims=True)
        return replace(o, uv=o.uv + size * out / np.where(far > 1e-6, far, np.inf))

    return spoilt(world, rng, ("stickers", *SCALE), (), change)


def loose_target(world: World, size: float, rng: np.random.Generator) -> Case:
    """The scale bar's second mark lies so many mm off in two of its six poses."""
    case = make_case(world, rng, ("bar-poses", "bar-length", "scale"))
    seen, bar, poses = world.bar_of("scale", 6, 1.0, case.session.observations, rng, shifted=(size, (1, 4)))
    scale = Scale("bar", bar="B")
    return replace(case, session=replace(case.session, observations=seen, bars=(bar,), bar_poses=poses, scale=scale))


def wrong_temperature(world: World, size: float, rng: np.random.Generator) -> Case:
    """The scale bar's temperature is typed in Fahrenheit, or in kelvin."""
    case = make_case(world, rng, ("bar-temperature",))
    session = world.with_bar(case.session, 1.0, rng)
    bars = tuple(replace(bar, expansion_per_kelvin=1.15e-5) for bar in session.bars)
    poses = tuple(replace(pose, temperature_c=size) for pose in session.bar_poses)
    return replace(case, session=replace(session, bars=bars, bar_poses=poses))


def stretched_board(world: World, size: float, rng: np.random.Generator) -> Case:
    """The board is printed longer by a share along its rows."""
    dots = world.ball.dots_mm * np.array([1 + size, 1.0, 1.0])
    return make_case(replace(world, ball=replace(world.ball, dots_mm=dots)), rng, ("board-shape", "print"))


def other_board(world: World, size: float, rng: np.random.Generator) -> Case:
    """From a placement on another board of the same pattern is shown, so many times as large."""
    t = later_placement(world, rng)
    other = replace(world.ball, dots_mm=world.ball.dots_mm * size)
    world = replace(world, shape_of=lambda placement: other if placement >= t else world.ball)
    return make_case(world, rng, ("board", "scale", "bar-length", "bar-changed", "parts-disagree", *IMAGE))


def other_rate(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera runs slower than the others by a share: its images come to be of ever earlier frames."""
    c = any_camera(world, rng)
    slower = showing(world, c, lambda placement: int(placement * (1 - size)))
    return make_case(slower, rng, (*LATE, *ALONE), (world.ids[c],))


def repeated_frames(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera delivers a share of its frames twice, in place of the next."""
    c = any_camera(world, rng)
    repeated = rng.random(len(world.turns)) < size
    again = showing(world, c, lambda placement: placement - int(repeated[placement]))
    return make_case(again, rng, (*LATE, *ALONE), (world.ids[c],))


def turned_figure(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera reads the figure from the other end in all its images."""
    c, targets = any_camera(world, rng), np.sort(world.ball.dot_target)
    other = dict(zip(targets.tolist(), targets[::-1].tolist(), strict=True))

    def change(o: Observations) -> Observations:
        own = o.camera == c
        turned = replace(o, target=np.where(own, [other[int(k)] for k in o.target], o.target))
        return turned.select(np.lexsort((turned.point, turned.target, turned.camera, turned.placement)))

    return _without(spoilt(world, rng, (*ALONE, "unlinked", "mirrored"), (world.ids[c],), change), world.ids[c])
