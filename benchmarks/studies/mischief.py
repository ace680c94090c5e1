"""Mischief: what goes wrong with a recording, in sizes from invisible to gross, and what ought to be blamed."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from benchmarks.studies.mischief_case import (
    IMAGE,
    MOVED,
    SCALE,
    SHAPE,
    Case,
    Make,
    any_camera,
    direction,
    displaced,
    excusing,
    in_order,
    later_placement,
    make_case,
    seen_placement,
    sees_ball,
    showing,
    spoilt,
    with_copy,
    with_lens,
)
from benchmarks.studies.mischief_frames import (
    bent_board,
    frame_lost,
    loose_mark,
    misnumbered,
    out_of_step,
    turned_ids,
    twins,
    wobbling_board,
    wrong_unit,
)
from benchmarks.studies.mischief_motions import (
    beam,
    drifting,
    late_camera,
    moved,
    moved_once,
    rolling_ball,
    trigger_groups,
    two_moved,
    warming,
)
from benchmarks.studies.mischief_optics import (
    axes_exchanged,
    bending_bar,
    dots_outward,
    fixed_k3,
    flattened,
    focus_creeps,
    glass,
    half_turned,
    haze,
    lenses_exchanged,
    local_fault,
    loose_target,
    other_board,
    other_rate,
    reflections,
    repeated_frames,
    shrinking_stickers,
    slow_move,
    stretched_board,
    turned_figure,
    two_sheets,
    vibration,
    warming_bar,
    whole_pixels,
    wrong_temperature,
)
from benchmarks.studies.mischief_world import Pose, World
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.observations import Observations
from spherecal.targets.family import make_target_set
from spherecal_sim.observe import shape_changes
from spherecal_sim.simulated_ball import Ball, make_ball


def nothing(world: World, size: float, rng: np.random.Generator) -> Case:
    """A clean recording; with a size, a bar gives the scale."""
    case = make_case(world, rng, ())
    return replace(case, session=world.with_bar(case.session, 1.0, rng)) if size else case


def stale(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera delivers the previous placement's image, at so many placements in a row."""
    c, t = any_camera(world, rng), later_placement(world, rng)
    times = [k for k in range(t, min(t + int(size), len(world.turns)))]

    def change(o: Observations) -> Observations:  # the very same points, not another exposure
        uv = o.uv.copy()
        before = o.uv[(o.camera == c) & (o.placement == t - 1)]
        for k in times:
            uv[(o.camera == c) & (o.placement == k)] = before
        return replace(o, uv=uv)

    old = showing(world, c, lambda placement: t - 1 if placement in times else placement)
    return spoilt(old, rng, IMAGE, (world.ids[c],), change)


def shifted_frames(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera lost a frame: from a placement on each of its images is the next placement's."""
    c, t = any_camera(world, rng), later_placement(world, rng)
    first = min(t, len(world.turns) - 2)
    lost = showing(world, c, lambda placement: placement + int(placement >= first))
    return make_case(lost, rng, IMAGE, (world.ids[c],))


def typed_distance(world: World, size: float, rng: np.random.Generator) -> Case:
    """The target distance typed wrong by a factor."""
    case = make_case(world, rng, SCALE)
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
    return make_case(replace(world, ball=replace(ball, dots_mm=dots, normals=n)), rng, SCALE)


def bar_certificate(world: World, size: float, rng: np.random.Generator) -> Case:
    """A scale bar whose certificate says so many times its length."""
    case = make_case(world, rng, SCALE)
    return replace(case, session=world.with_bar(case.session, size, rng))


def fixed_intrinsics(world: World, size: float, rng: np.random.Generator) -> Case:
    """Fixed intrinsics, all focal lengths wrong by a share; the rest of the lens is right."""
    case = make_case(world, rng, ("fixed-intrinsics", "prior-focal", "intrinsics"))
    cameras = []
    for spec, true in zip(case.session.cameras, world.cameras, strict=True):
        prior = true.intrinsics.copy()
        prior[:2] *= 1 + size
        cameras.append(replace(spec, prior=prior))
    session = replace(case.session, cameras=tuple(cameras))
    return replace(case, session=session, settings=replace(case.settings, intrinsics="fixed"))


def fixed_data_sheet(world: World, size: float, rng: np.random.Generator) -> Case:
    """Fixed intrinsics from the data sheet: no distortion, centred, each focal length wrong by up to a share."""
    world = replace(world, prior_error=size)
    case = make_case(world, rng, ("fixed-intrinsics", "prior-focal", "intrinsics", "lens"))
    return replace(case, settings=replace(case.settings, intrinsics="fixed"))


def fixed_one_placement(world: World, size: float, rng: np.random.Generator) -> Case:
    """The same with one placement."""
    return fixed_data_sheet(replace(world, turns=world.turns[:1], places_mm=world.places_mm[:1]), size, rng)


def copies(world: World, size: float, rng: np.random.Generator) -> Case:
    """Four copies of one placement: exposed again with noise (size 1), or the very same images (size 0)."""
    world = replace(world, turns=np.tile(world.turns[:1], (4, 1, 1)), places_mm=np.tile(world.places_mm[:1], (4, 1)))

    def change(o: Observations) -> Observations:
        first = o.uv[o.placement == 0]
        return o if size else replace(o, uv=np.tile(first, (4, 1)))

    return spoilt(world, rng, ("identical", "copies", "same", "placements", "duplicate"), (), change)


def _lasting(case: Case, change: Callable[[FloatArray, IntArray], FloatArray]) -> Case:
    """The case in which image points (n,2) of cameras (n,) are changed when lengths are measured, too."""
    lengths = case.reference.lengths
    lengths = replace(lengths, uv=change(lengths.uv, lengths.camera))
    return replace(case, reference=replace(case.reference, lengths=lengths), world=None)


def skew(world: World, size: float, rng: np.random.Generator) -> Case:
    """All sensors skewed: u shifted by so many px from the lowest to the highest row."""
    height = np.array([c.kind.image_size[1] for c in world.cameras], dtype=float)

    def change(uv: FloatArray, camera: IntArray) -> FloatArray:
        return np.column_stack([uv[:, 0] + size * (uv[:, 1] / height[camera] - 0.5), uv[:, 1]])

    blame = ("lens", "skew", "model")
    case = _lasting(spoilt(world, rng, blame, (), lambda o: replace(o, uv=change(o.uv, o.camera))), change)
    return replace(case, reference=replace(case.reference, excused=frozenset(world.ids)))


def zoomed(world: World, size: float, rng: np.random.Generator) -> Case:
    """All lenses are zoomed before a placement, and stay so: every image is larger by a share."""
    t, images = later_placement(world, rng), np.array([c.kind.image_size for c in world.cameras], dtype=float)

    def change(uv: FloatArray, camera: IntArray, after: BoolArray) -> FloatArray:
        return uv + size * after[:, None] * (uv - (images[camera] - 1) / 2)

    blame = (*MOVED, *SHAPE, "focus", "lens", "focal", "late", "contradicts")
    case = spoilt(world, rng, blame, (), lambda o: replace(o, uv=change(o.uv, o.camera, o.placement >= t)))
    case = _lasting(case, lambda uv, camera: change(uv, camera, np.ones(len(uv), dtype=bool)))
    return replace(case, reference=replace(case.reference, excused=frozenset(world.ids)))


def fisheye(world: World, size: float, rng: np.random.Generator) -> Case:
    """Fisheye lenses in Brown's model: equidistant with k1 = size."""
    lenses = []
    for lens in world.lenses:
        plain = lens.intrinsics.copy()
        plain[4:] = 0.0
        lenses.append(replace(lens, intrinsics=plain, fisheye=np.array([size, -0.1 * size, 0.02 * size, 0.0])))
    return make_case(replace(world, lenses=tuple(lenses)), rng, ("lens", "model", "fisheye"))


def mirrored(world: World, size: float, rng: np.random.Generator) -> Case:
    """Images of one camera (size 1) or of all (size 0) flipped left to right."""
    c = any_camera(world, rng)

    def change(o: Observations) -> Observations:
        uv = o.uv.copy()
        width = np.array([k.kind.image_size[0] for k in world.cameras], dtype=float)[o.camera]
        rows = (o.camera == c) | (not size)
        uv[rows, 0] = width[rows] - 1 - uv[rows, 0]
        return replace(o, uv=uv)

    case = spoilt(world, rng, ("mirror", "flip"), (world.ids[c],) if size else (), change)
    return replace(case, world=None)


def exchanged_halfway(world: World, size: float, rng: np.random.Generator) -> Case:
    """Two cameras' images exchanged: from a placement on (size 1) or at one placement (size 0).

    One of the two sees the ball before: where neither does, the recording is that of a rig with these names.
    """
    while True:
        a, b = (int(c) for c in rng.permutation(len(world.cameras))[:2])
        t = later_placement(world, rng)
        if any(sees_ball(world, c, k) for c in (a, b) for k in range(t)):
            break

    def change(o: Observations) -> Observations:
        at = (o.placement >= t) if size else (o.placement == t)
        camera = np.where(at & (o.camera == a), b, np.where(at & (o.camera == b), a, o.camera))
        return in_order(replace(o, camera=camera))

    return spoilt(world, rng, IMAGE, (world.ids[a], world.ids[b]), change)


def image_of_another(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera's image at one placement is a copy of another camera's."""
    a, b = (int(c) for c in rng.permutation(len(world.cameras))[:2])
    t = later_placement(world, rng)

    def change(o: Observations) -> Observations:
        here = o.placement == t
        return with_copy(o, ~(here & (o.camera == a)), here & (o.camera == b), a)

    return spoilt(world, rng, IMAGE, (world.ids[a],), change)


def binned(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's images binned 2 x 2 in the upper left of the frame: from a placement on (1), or always (0)."""
    c, t = seen_placement(world, rng) if size else (any_camera(world, rng), 0)

    def change(uv: FloatArray, own: BoolArray) -> FloatArray:
        return np.where(own[:, None], (uv + 0.5) / 2 - 0.5, uv)

    def binned_from(o: Observations) -> Observations:
        return replace(o, uv=change(o.uv, (o.camera == c) & (o.placement >= t)))

    case = spoilt(world, rng, (*IMAGE, *MOVED, "focal", "binn", "lens"), (world.ids[c],), binned_from)
    return _lasting(case, lambda uv, camera: change(uv, camera == c))


def shifted_roi(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's region of interest is shifted by so many px before a placement, and stays so."""
    c, t = seen_placement(world, rng)

    def change(intrinsics: FloatArray, placement: int) -> None:
        intrinsics[2:4] += size * np.array([1.0, -0.5]) * (placement >= t)

    blame = (*MOVED, "focus", "lens", "roi", "image")
    return excusing(make_case(with_lens(world, c, change), rng, blame, (world.ids[c],)), world.ids[c])


_FILES = TemporaryDirectory()


def stated_roi(world: World, size: float, rng: np.random.Generator) -> Case:
    """The same, where the camera's files state where their region lies."""
    c, t = seen_placement(world, deepcopy(rng))
    case, places = shifted_roi(world, size, rng), []
    for k, place in enumerate(case.session.placements):
        path, tags, off = Path(_FILES.name) / f"{place.id}.png", Image.Exif(), size * (k >= t)
        tags.update({0x011A: 1.0, 0x011B: 1.0, 0x011E: 100 + off, 0x011F: 100 - off / 2})
        Image.new("L", (8, 8), k).save(path, exif=tags)
        places.append(replace(place, images={world.ids[c]: path}))
    return replace(case, session=replace(case.session, placements=tuple(places)), blame=("image-settings",))


def refocused(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera is focused again before a placement: its focal length changes by a share."""
    c, t = seen_placement(world, rng)

    def change(intrinsics: FloatArray, placement: int) -> None:
        intrinsics[:2] *= 1 + size * (placement >= t)

    blame = (*MOVED, "focus", "lens", "focal")
    return excusing(make_case(with_lens(world, c, change), rng, blame, (world.ids[c],)), world.ids[c])


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

    return spoilt(world, rng, ("target", "sticker", "duplicate"), (), change)


def other_ball(world: World, size: float, rng: np.random.Generator) -> Case:
    """At one placement another ball of the same set was used; size is the share of its radius."""
    t = later_placement(world, rng)
    targets = make_target_set(int(world.ball.targets.max()))
    other = make_ball(targets, tuple(int(k) for k in world.ball.targets), rng, size * world.ball.radius_mm)
    world = replace(world, shape_of=lambda placement: other if placement == t else world.ball)
    return make_case(world, rng, (*SHAPE, *IMAGE), (world.placements[t],))


def bent_ball(world: World, size: float, rng: np.random.Generator) -> Case:
    """The ball is bent by so many mm (rms) from placement to placement."""
    changes = shape_changes(world.ball, len(world.turns), size, "smooth", rng)
    bent = [replace(world.ball, dots_mm=world.ball.dots_mm + change) for change in changes]
    return make_case(replace(world, shape_of=lambda placement: bent[placement]), rng, (*SHAPE, "soft", "free"))


def growing_ball(world: World, size: float, rng: np.random.Generator) -> Case:
    """The ball grows by so many ppm from the first placement to the last, as a warm one does."""
    last = len(world.turns) - 1

    def shape_of(placement: int) -> Ball:
        return replace(world.ball, dots_mm=world.ball.dots_mm * (1 + 1e-6 * size * (placement / last - 0.5)))

    return make_case(replace(world, shape_of=shape_of), rng, (*SHAPE, "size"))


def stretched_print(world: World, size: float, rng: np.random.Generator) -> Case:
    """All stickers are longer by a share in one direction of the print."""
    ball = world.ball
    frame = ball.frames[np.searchsorted(ball.targets, ball.dot_target)]
    middle = -frame[:, 2] * ball.radius_mm
    along = ((ball.dots_mm - middle) * frame[:, 0]).sum(axis=1)
    dots = ball.dots_mm + size * along[:, None] * frame[:, 0]
    dots *= (np.linalg.norm(ball.dots_mm, axis=1) / np.linalg.norm(dots, axis=1))[:, None]  # still on the ball
    return make_case(replace(world, ball=replace(ball, dots_mm=dots)), rng, ("stretched", *SCALE))


def older_placement(world: World, size: float, rng: np.random.Generator) -> Case:
    """One placement is of an older session: all cameras stood elsewhere by so many mm and mrad."""
    t = int(rng.integers(0, len(world.turns) - 1))
    n = len(world.cameras)
    shift, turn = [size * direction(rng) for _ in range(n)], [1e-3 * size * direction(rng) for _ in range(n)]

    def pose_of(camera: int, placement: int) -> Pose:
        pose = world.pose(camera, placement)
        return displaced(pose, shift[camera], turn[camera]) if placement == t else pose

    blame = (*SHAPE, *MOVED, "placement", "left-out")
    return make_case(replace(world, pose_of=pose_of), rng, blame, (world.placements[t],))


def wrong_pitch(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera's pixel pitch is wrong by a factor, so is its focal length in px."""
    c = any_camera(world, rng)
    case = make_case(world, rng, ("focal", "pitch", "prior"), (world.ids[c],))
    cameras = list(case.session.cameras)
    prior = cameras[c].prior.copy()
    prior[:2] *= size
    cameras[c] = replace(cameras[c], prior=prior)
    return replace(case, session=replace(case.session, cameras=tuple(cameras)))


@dataclass(frozen=True)
class Mischief:
    """A kind of mischief and its sizes; `row` is that of the issue's table, empty for those thought up here.

    `methods` by which it is recorded and calibrated.
    """

    name: str
    make: Make
    sizes: tuple[float, ...]
    unit: str = ""
    row: str = ""
    methods: tuple[str, ...] = ("ball",)


_ALL, _FRAMES, _SHOWN = ("ball", "board", "bar"), ("board", "bar"), ("ball", "board")
_BOARD, _BAR = ("board",), ("bar",)

KINDS: tuple[Mischief, ...] = (
    Mischief("nothing", nothing, (0, 1), "bar"),
    Mischief("stale image", stale, (1, 2), "placements", "A", methods=_SHOWN),
    Mischief("distance typed wrong", typed_distance, (0.495, 0.8, 0.97), "x", "B"),
    Mischief("stickers printed small", printed_small, (0.9, 0.97), "x", "C"),
    Mischief("bar's certificate wrong", bar_certificate, (1.2, 1.05, 1.02), "x", "D"),
    Mischief("camera moved", moved, (0.01, 0.1, 0.3, 3, 30), "mm and mrad", "E", methods=_ALL),
    Mischief("beam sags", beam, (0.02, 0.2, 2), "mm and mrad", "F", methods=_ALL),
    Mischief("ball moved between trigger groups", trigger_groups, (0.01, 0.05, 0.2, 1, 5), "mm", "G"),
    Mischief("fixed focal lengths wrong", fixed_intrinsics, (0.001, 0.015), "x", "H", methods=_ALL),
    Mischief("fixed data-sheet intrinsics", fixed_data_sheet, (0.015,), "x", "H", methods=_ALL),
    Mischief("the same, one placement", fixed_one_placement, (0.015,), "x", "H"),
    Mischief("copies of one placement", copies, (0, 1), "noise", "I"),
    Mischief("skew", skew, (0.2, 2, 8), "px", "J", methods=_ALL),
    Mischief("fisheye lenses", fisheye, (0.0, 0.3), "k1", "J", methods=_SHOWN),
    Mischief("mirrored", mirrored, (1, 0), "camera", "mirrored"),
    Mischief("camera elsewhere once", moved_once, (0.1, 1, 30), "mm and mrad", methods=_SHOWN),
    Mischief("two cameras moved", two_moved, (0.1, 1, 10), "mm and mrad", methods=_ALL),
    Mischief("all cameras drift", drifting, (0.02, 0.2, 1), "mm", methods=_ALL),
    Mischief("one camera late", late_camera, (0.05, 0.3, 3), "mm", methods=_ALL),
    Mischief("ball rolls", rolling_ball, (0.005, 0.05, 1), "deg"),
    Mischief("frame lost", shifted_frames, (1,)),
    Mischief("cameras exchanged", exchanged_halfway, (1, 0), "halfway", methods=_ALL),
    Mischief("image of another camera", image_of_another, (1,), methods=_SHOWN),
    Mischief("images binned", binned, (1, 0), "from a placement on", methods=_ALL),
    Mischief("region of interest shifted", shifted_roi, (0.2, 2, 8, 64), "px", methods=_ALL),
    Mischief("focus changed", refocused, (0.0001, 0.001, 0.01), "x", methods=_ALL),
    Mischief("stickers with one number", two_stickers, (1, 3, 10), "pairs"),
    Mischief("another ball at one placement", other_ball, (1.0, 0.8), "x"),
    Mischief("ball bent", bent_ball, (0.02, 0.2, 2), "mm"),
    Mischief("placement of an older session", older_placement, (0.05, 0.5, 5), "mm and mrad", methods=_SHOWN),
    Mischief("pixel pitch wrong", wrong_pitch, (1.39, 0.72), "x", methods=_SHOWN),
    Mischief("ball grows", growing_ball, (50, 300, 1500), "ppm"),
    Mischief("prints stretched", stretched_print, (0.001, 0.003, 0.02), "x"),
    Mischief("rig warms", warming, (20, 100), "ppm"),
    Mischief("nothing with frames", nothing, (0,), methods=_FRAMES),
    Mischief("camera mirrored", mirrored, (1,), methods=_FRAMES),  # of a whole rig nothing shows it
    Mischief("camera out of step", out_of_step, (1, 2), "frames", methods=_FRAMES),
    Mischief("frames lost", frame_lost, (1,), "frames", methods=_FRAMES),
    Mischief("two cameras, one file", twins, (1,), methods=_ALL),
    Mischief("lengths in another unit", wrong_unit, (0.001, 1000), "x", methods=_FRAMES),
    Mischief("board bent", bent_board, (0.1, 0.8), "mm", methods=_BOARD),
    Mischief("board bends", wobbling_board, (0.05, 0.3, 1), "mm", methods=_BOARD),
    Mischief("figure half turned", turned_ids, (1, 5), "images", methods=_FRAMES),
    Mischief("mark of the bar loose", loose_mark, (0.1, 0.5, 3), "mm", methods=_BAR),
    Mischief("ball flattened by its weight", flattened, (0.1, 0.3, 1), "mm"),
    Mischief("stickers shrink", shrinking_stickers, (0.0003, 0.001, 0.002), "x"),
    Mischief("dots smeared outward", dots_outward, (0.03, 0.1, 0.3), "px"),
    Mischief("mark of the scale bar loose", loose_target, (0.2, 1, 3), "mm"),
    Mischief("temperature typed wrong", wrong_temperature, (70, 120, 293), "degrees C"),
    Mischief("certificate mistyped", bar_certificate, (0.997, 1.005, 1.01), "x"),
    Mischief("three fixed lenses off", fixed_k3, (0.05, 0.3, 1), "k3", methods=_ALL),
    Mischief("focus creeps", focus_creeps, (0.0001, 0.001, 0.005), "x", methods=_ALL),
    Mischief("camera sinks", slow_move, (0.05, 0.3, 3), "mm and mrad", methods=_ALL),
    Mischief("camera shakes", vibration, (0.02, 0.1, 1), "mm and mrad", methods=_ALL),
    Mischief("camera hazy", haze, (0.1, 0.3, 1), "px", methods=_ALL),
    Mischief("drop on a lens", local_fault, (0.1, 0.5, 3), "px", methods=_ALL),
    Mischief("glass put before a camera", glass, (0.5, 2, 10), "mm", methods=_ALL),
    Mischief("images half turned", half_turned, (1,), "camera", methods=_ALL),
    Mischief("axes exchanged", axes_exchanged, (1,), "camera", methods=_ALL),
    Mischief("points rounded", whole_pixels, (0.25, 1), "px", methods=_ALL),
    Mischief("reflections", reflections, (0.05, 0.2), "x", methods=_SHOWN),
    Mischief("another lens", lenses_exchanged, (0.0003, 0.003, 0.02), "x", methods=_ALL),
    Mischief("board stretched", stretched_board, (0.001, 0.003, 0.02), "x", methods=_BOARD),
    Mischief("another figure", other_board, (1.001, 1.01, 1.2), "x", methods=_FRAMES),
    Mischief("camera at another rate", other_rate, (0.02, 0.1), "x", methods=_FRAMES),
    Mischief("frames repeated", repeated_frames, (0.05, 0.3), "x", methods=_FRAMES),
    Mischief("figure turned for a camera", turned_figure, (1,), "camera", methods=_FRAMES),
    Mischief("region stated by its files", stated_roi, (2, 64), "px", methods=_SHOWN),
    Mischief("stickers of two sheets", two_sheets, (0.002, 0.01), "x"),
    Mischief("bar warms", warming_bar, (100, 500), "ppm", methods=_BAR),
    Mischief("bar bends", bending_bar, (0.05, 0.3, 1), "mm", methods=_BAR),
    Mischief("all lenses zoomed", zoomed, (0.0001, 0.0003, 0.003, 0.05), "x", methods=_SHOWN),
    Mischief("board misnumbered", misnumbered, (1, 2), "columns", methods=_BOARD),
)
