"""Mischief with a board that is shown and a bar that is waved: the ball's kinds, and what only they suffer."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.studies.mischief_case import (
    IMAGE,
    Case,
    any_camera,
    direction,
    in_order,
    later_placement,
    make_case,
    showing,
    spoilt,
    with_copy,
)
from benchmarks.studies.mischief_world import Pose, World, make_world
from spherecal.data.observations import Observations
from spherecal.data.session import Bar, BarLength, BarPose, BoardPoint, Mark, Placement, Scale, Session
from spherecal.geometry.rotation import exp_rotation
from spherecal.steps.settings import CalibrationSettings
from spherecal_sim.rigs import random_rotations
from spherecal_sim.simulated_ball import Ball

PLACEMENTS, FRAMES = 24, 240
ROWS, COLUMNS, PITCH_MM = 8, 11, 33.0
BAR_MM, CERTIFICATE_MM = 300.0, 0.01
# As the ball's: what nobody can see from, and how far a board leans away from the camera that it is shown to.
_TILT = np.deg2rad(40.0)
LATE = ("camera-late", "image", "wrong-placement")


@dataclass(frozen=True)
class FrameWorld(World):
    """A rig before which a board or a bar is shown; `scale` of the points in the session over the true ones."""

    scale: float = 1.0

    @property
    def method(self) -> str:
        """Board or bar."""
        return self.settings.method

    @property
    def placements(self) -> tuple[str, ...]:
        """The frames' names."""
        return tuple(f"F{t + 1:03d}" for t in range(len(self.turns)))

    def session(self, observations: Observations, rng: np.random.Generator) -> Session:
        """The session of a recording; of a board without its uncertainty."""
        names = observations.placements
        if self.method == "board":
            board = tuple(
                BoardPoint(int(t), "centre", (float(x[0]) * self.scale, float(x[1]) * self.scale, 0.0))
                for t, x in zip(self.ball.dot_target, self.ball.layouts_mm.reshape(-1, 2), strict=True)
            )
            places = tuple(Placement(name) for name in names)
            return Session(Path(), self.specs(rng), places, (), (), None, board, None, None, observations, "")
        length = self.scale * (BAR_MM + float(rng.normal(0.0, CERTIFICATE_MM / 2)))
        certificate = BarLength("M1", "M2", length, self.scale * CERTIFICATE_MM, 2.0)
        marks = {"M1": Mark(1, "centre"), "M2": Mark(2, "centre")}
        bar = Bar("W", "scale", marks, (certificate,), 0.0, 20.0)
        poses, scale = tuple(BarPose(name, "W", 20.0) for name in names), Scale("bar", bar="W")
        return Session(Path(), self.specs(rng), (), (bar,), poses, scale, None, None, None, observations, "")


def make_frame_world(rig: str, method: str, seed: int) -> FrameWorld:
    """A rig of `mischief_world` with a board shown towards one camera after the other, or a bar waved all over."""
    world, rng = make_world(rig, seed, 20), np.random.default_rng([seed, 17])
    low, high = world.volume_mm
    count = PLACEMENTS if method == "board" else FRAMES
    places = rng.uniform(low + 0.1 * (high - low), high - 0.1 * (high - low), (count, 3))
    if method == "board":
        row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
        share = min(1.0, 0.5 * float((high - low).min()) / (COLUMNS * PITCH_MM))
        flat = PITCH_MM * share * np.column_stack([column - (COLUMNS - 1) / 2, row - (ROWS - 1) / 2])
        targets = np.arange(len(flat))
        towards = np.array([world.cameras[t % len(world.cameras)].centre_mm - places[t] for t in range(count)])
        turns = np.array([_facing(d, rng) for d in towards])
        normals = np.tile([0.0, 0.0, -1.0], (len(flat), 1))
    else:
        flat = np.array([[-BAR_MM / 2, 0.0], [BAR_MM / 2, 0.0]])
        targets, turns, normals = np.array([1, 2]), random_rotations(count, rng), np.zeros((0, 3))
    dots = np.column_stack([flat, np.zeros(len(flat))])
    figure = Ball(
        0.0, world.ball.bumps, ("centre",), targets, np.zeros((0, 3, 3)), flat[:, None], targets,
        np.zeros(len(flat), dtype=np.int64), dots, normals,
    )  # fmt: skip
    return FrameWorld(
        world.cameras, world.lenses, figure, turns, places, world.volume_mm, seed,
        settings=CalibrationSettings(method="board" if method == "board" else "bar"),
    )  # fmt: skip


def _facing(direction: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A board's turn that shows it to somebody in a direction, leaning by up to 40 degrees."""
    z = -direction / np.linalg.norm(direction)
    x = np.cross([0.0, 0.3, 1.0], z)
    x /= np.linalg.norm(x)
    upright = np.column_stack([x, np.cross(z, x), z])
    return upright @ exp_rotation(np.array([*rng.uniform(-_TILT, _TILT, 2), rng.uniform(-np.pi, np.pi)]))


def out_of_step(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera started late: throughout, its images are those of so many frames before."""
    c = any_camera(world, rng)
    return make_case(showing(world, c, lambda placement: placement - int(size)), rng, LATE, (world.ids[c],))


def frame_lost(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera lost so many frames in the middle: what follows is stored too early."""
    c, t = any_camera(world, rng), later_placement(world, rng)
    lost = showing(world, c, lambda placement: placement + int(size) * (placement >= t))
    return make_case(lost, rng, (*LATE, "moved"), (world.ids[c],))


def twins(world: World, size: float, rng: np.random.Generator) -> Case:
    """Two cameras have the same files."""
    a, b = (int(c) for c in rng.permutation(len(world.cameras))[:2])

    def change(o: Observations) -> Observations:
        return with_copy(o, o.camera != b, o.camera == a, b)

    return spoilt(world, rng, IMAGE, (world.ids[a], world.ids[b]), change)


def wrong_unit(world: World, size: float, rng: np.random.Generator) -> Case:
    """Lengths in metres (0.001) or micrometres (1000) instead of millimetres."""
    assert isinstance(world, FrameWorld)
    return make_case(replace(world, scale=size), rng, ("size-implausible",))


def bent_board(world: World, size: float, rng: np.random.Generator) -> Case:
    """The board sags by so many mm in its middle, always alike."""
    flat = world.ball.layouts_mm.reshape(-1, 2)
    bulge = size * (1 - (flat**2).sum(axis=1) / (flat**2).sum(axis=1).max())
    dots = world.ball.dots_mm + np.column_stack([np.zeros_like(flat), bulge])
    return make_case(replace(world, ball=replace(world.ball, dots_mm=dots)), rng, ("board-shape",))


def wobbling_board(world: World, size: float, rng: np.random.Generator) -> Case:
    """The board bends by up to so many mm, each time otherwise."""
    flat = world.ball.layouts_mm.reshape(-1, 2)
    bulge = 1 - (flat**2).sum(axis=1) / (flat**2).sum(axis=1).max()
    amount = size * rng.uniform(-1, 1, len(world.turns))

    def shape_of(placement: int) -> Ball:
        off = np.column_stack([np.zeros_like(flat), amount[placement] * bulge])
        return replace(world.ball, dots_mm=world.ball.dots_mm + off)

    return make_case(replace(world, shape_of=shape_of), rng, ("board-shape", "parts-disagree", "lens", "scatter"))


def moving_board(world: World, size: float, rng: np.random.Generator) -> Case:
    """The board moves by up to so many mm, and turns by as much at its rim, between the exposures of the cameras."""
    late = rng.uniform(-1, 1, (len(world.turns), len(world.cameras)))
    way = [size * direction(rng) for _ in world.turns]
    axis = [size / 400 * direction(rng) for _ in world.turns]

    def ball_of(camera: int, placement: int) -> Pose:
        t = late[placement, camera]
        return exp_rotation(t * axis[placement]) @ world.turns[placement], world.places_mm[placement] + t * way[
            placement
        ]

    return make_case(replace(world, ball_of=ball_of), rng, ("board-moving",))


def mixed_moments(world: World, size: float, rng: np.random.Generator) -> Case:
    """Images of every camera are in an order of their own."""
    order = [rng.permutation(len(world.turns)) for _ in world.cameras]

    def ball_of(camera: int, placement: int) -> Pose:
        return world.turns[order[camera][placement]], world.places_mm[order[camera][placement]]

    return make_case(replace(world, ball_of=ball_of), rng, ("board-moving", "unlinked"))


def turned_ids(world: World, size: float, rng: np.random.Generator) -> Case:
    """In so many images the figure is found half turned: its points are numbered from the other end."""
    targets = np.sort(world.ball.dot_target)
    other = dict(zip(targets.tolist(), targets[::-1].tolist(), strict=True))
    pairs = [(any_camera(world, rng), int(rng.integers(len(world.turns)))) for _ in range(int(size))]

    def change(o: Observations) -> Observations:
        hit = np.zeros(len(o), dtype=bool)
        for c, t in pairs:
            hit |= (o.camera == c) & (o.placement == t)
        return in_order(replace(o, target=np.where(hit, [other[int(k)] for k in o.target], o.target)))

    return spoilt(world, rng, (*IMAGE, "outlier", "moved"), (), change)


def misnumbered(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera counts the board's points from another corner: their numbers are off by so many columns."""
    c = any_camera(world, rng)

    def change(o: Observations) -> Observations:
        own = o.camera == c
        kept = ~own | (o.target % COLUMNS + int(size) < COLUMNS)
        return in_order(replace(o, target=o.target + own * int(size)).select(kept))

    return spoilt(world, rng, ("misnumbered",), (world.ids[c],), change)


def loose_mark(world: World, size: float, rng: np.random.Generator) -> Case:
    """A mark of the bar shifts along it by so many mm from a frame on."""
    t = later_placement(world, rng)

    def shape_of(placement: int) -> Ball:
        off = np.zeros_like(world.ball.dots_mm)
        off[-1, 0] = size if placement >= t else 0.0
        return replace(world.ball, dots_mm=world.ball.dots_mm + off)

    return make_case(replace(world, shape_of=shape_of), rng, ("bar-poses", "bar-length", "scale"))
