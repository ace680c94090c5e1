"""What is in front of the simulated cameras: the ball or a bar in a lit room with clutter, dirt and an arm."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.targets.target_set import TargetSet
from spherecal_sim.optics import Psf, Sensor
from spherecal_sim.tracing import TracedScene
from spherecal_sim.truth import TrueBarPose, Truth


@dataclass(frozen=True)
class RenderSettings:
    """How images are made; the defaults are a well-kept rig."""

    psf: Psf = field(default_factory=Psf)
    psf_of: dict[str, Psf] = field(default_factory=dict)  # of single simulated cameras
    sensor: Sensor = field(default_factory=Sensor)
    exposure: float = 1.0  # 1: a white surface at the ball's usual distance has 80 % of full scale
    lighting: Literal["rings", "flat"] = "rings"
    ambient: float = 0.02
    gloss: float = 0.05  # height of the highlight; a white dot has 0.85
    vignetting: bool = True
    blobs: int = 0  # white discs on the room's walls
    arm: bool = False
    specks: float = 0.0  # mean count a sticker
    scratches: float = 0.0
    bounds: Callable[..., FloatArray] | None = (
        None  # each dot's Cramer-Rao bound (benchmarks/simulators), for its truth
    )

    def psf_at(self, camera: str) -> Psf:
        """The point-spread function of a camera."""
        return self.psf_of.get(camera, self.psf)


WHITE = 0.85
_BLACK = 0.04  # matt black print
_GREY = 0.25
_WALL = 0.12
_BAR_HALF_WIDTH_MM = 20.0
_BAR_OVERHANG_MM = 30.0
_FULL_SCALE_OF_WHITE = 0.8  # leaves room for the highlight at the nominal exposure


def ball_scene(truth: Truth, targets: TargetSet, placement: int, settings: RenderSettings) -> TracedScene:
    """The ball in a placement."""
    ball = truth.ball
    scene = _empty_scene(truth, targets, settings)
    dots = ball.layouts_mm
    rng = np.random.default_rng([truth.seed, 1])
    arms = np.empty((0, 7))
    if settings.arm:
        arms = _arm(truth, placement, np.random.default_rng([truth.seed, 2, placement]))
    return scene._replace(
        ball_radius=ball.radius_mm,
        ball_reach=ball.radius_mm + 1.1 * truth.options.bump_mm + 1e-6,
        ball_rotation=truth.ball_rotations[placement],
        ball_place=truth.ball_places_mm[placement],
        lobe_axes=ball.bumps.axes.T,
        lobe_coefficients=ball.bumps.coefficients.T,
        sticker_frames=ball.frames,
        sticker_dots=dots,
        sticker_grid=_sticker_grid(-ball.frames[:, 2], targets.size_mm / np.sqrt(2) / ball.radius_mm),
        dirt=_dirt(len(dots), targets.size_mm / 2, settings, rng),
        arms=arms,
    )


def bar_scene(truth: Truth, targets: TargetSet, pose: TrueBarPose, settings: RenderSettings) -> TracedScene:
    """A bar in one of its poses, its marks at their places at the pose's temperature."""
    bar = truth.bar(pose.bar)
    scene = _empty_scene(truth, targets, settings)
    points = truth.ball.points
    dots = np.array([[targets.layouts[t][p] for p in points] for t in bar.targets], dtype=float)
    stretch = 1 + bar.expansion_per_kelvin * (pose.temperature_c - bar.reference_temperature_c)
    rng = np.random.default_rng([truth.seed, 3, bar.targets[0]])
    x = bar.x_mm * stretch
    return scene._replace(
        bar_rotations=pose.rotation[None],
        bar_places=pose.place_mm[None],
        bar_faces=np.array([[x[0] - _BAR_OVERHANG_MM, x[-1] + _BAR_OVERHANG_MM, _BAR_HALF_WIDTH_MM]]),
        mark_bar=np.zeros(len(x), dtype=np.int64),
        mark_x=x,
        mark_dots=dots,
        dirt=_dirt(len(dots), targets.size_mm / 2, settings, rng),
    )


def _empty_scene(truth: Truth, targets: TargetSet, settings: RenderSettings) -> TracedScene:
    """The room and its light, with the targets' sizes and colours."""
    middle = truth.volume_mm.mean(axis=0)
    room = np.array([[middle[0] - 2500.0, middle[1] - 2500.0, 0.0], [middle[0] + 2500.0, middle[1] + 2500.0, 2800.0]])
    blobs = _blobs(settings.blobs, room, middle, np.random.default_rng([truth.seed, 4]))
    white, black = (WHITE, _BLACK) if targets.polarity == "light-on-dark" else (_BLACK, WHITE)
    flat = settings.lighting == "flat"
    lights = np.empty((0, 3)) if flat else np.array([c.centre_mm for c in truth.cameras])
    none = np.empty((0, 3))
    return TracedScene(
        ball_radius=0.0, ball_reach=0.0, ball_rotation=np.eye(3), ball_place=np.zeros(3), lobe_axes=np.empty((3, 0)),
        lobe_coefficients=np.empty((6, 0)), sticker_frames=np.empty((0, 3, 3)),
        sticker_dots=np.empty((0, len(truth.ball.points), 2)), sticker_grid=np.empty((1, 1, 1, 0), dtype=np.int32),
        bar_rotations=np.empty((0, 3, 3)), bar_places=none, bar_faces=none, mark_bar=np.empty(0, dtype=np.int64),
        mark_x=np.empty(0), mark_dots=np.empty((0, len(truth.ball.points), 2)), half_sticker=targets.size_mm / 2,
        dot_radius=targets.dot_diameter_mm / 2, dirt=np.empty((0, 0, 6)), arms=np.empty((0, 7)), room=room,
        blobs=blobs, blob_grid=_blob_grid(blobs, room),
        albedos=np.array([white, black, _GREY, _GREY, 0.4, _WALL, WHITE]), lights=lights, light_power=1.0,
        ambient=1.0 if flat else 0.0, gloss=0.0 if flat else settings.gloss,
    )  # fmt: skip


def lit_for(scene: TracedScene, truth: Truth, camera: int, settings: RenderSettings) -> TracedScene:
    """The scene lit so that a white surface facing the camera at the ball is 80 % of full scale times `exposure`."""
    level = settings.exposure * _FULL_SCALE_OF_WHITE / WHITE
    if not len(scene.lights):
        return scene._replace(ambient=level)
    middle = truth.ball_places_mm.mean(axis=0)
    to_camera = truth.cameras[camera].centre_mm - middle
    to_camera /= np.linalg.norm(to_camera)
    rays = scene.lights - (middle + truth.ball.radius_mm * to_camera)
    distance = np.linalg.norm(rays, axis=1)
    received = (np.clip(rays @ to_camera, 0.0, None) / distance**3).sum()
    return scene._replace(light_power=level / received, ambient=settings.ambient * level)


_DIRECTION_CELLS = 24


def _sticker_grid(centres: FloatArray, reach: float) -> NDArray[np.int32]:
    """Which stickers (centres (s, 3) unit, reach in radians) may show in each cell of the cube of directions."""
    g = _DIRECTION_CELLS
    middle = (np.arange(g) + 0.5) / g * 2 - 1
    cells = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1)
    # a chord is at most the arc; a cell's corner is sqrt(3) / g from its middle; 5 % for bumps and bending
    chord = 1.05 * reach + np.sqrt(3) / g
    squares = (cells**2).sum(axis=-1)[..., None] + (centres**2).sum(axis=-1) - 2 * cells @ centres.T
    near = squares < chord**2
    most = max(int(near.sum(axis=-1).max()), 1)
    order = np.argsort(~near, axis=-1, kind="stable")[..., :most].astype(np.int32)
    return np.where(np.take_along_axis(near, order, axis=-1), order, np.int32(-1))


_SPECK_HALF_WIDTH_MM = (0.05, 0.25)
_SCRATCH_HALF_WIDTH_MM = (0.04, 0.12)
_SCRATCH_LENGTH_MM = (5.0, 25.0)


def _dirt(stickers: int, half_mm: float, settings: RenderSettings, rng: np.random.Generator) -> FloatArray:
    """Specks of dust and scratches on each sticker, (stickers, most, 6): segment ends, half width, albedo."""
    specks = rng.poisson(settings.specks, stickers)
    scratches = rng.poisson(settings.scratches, stickers)
    dirt = np.zeros((stickers, int((specks + scratches).max(initial=0)), 6))
    for s in range(stickers):
        n = specks[s] + scratches[s]
        start = rng.uniform(-half_mm, half_mm, (n, 2))
        angle = rng.uniform(0, 2 * np.pi, n)
        length = np.where(np.arange(n) < specks[s], 0.0, rng.uniform(*_SCRATCH_LENGTH_MM, n))
        dirt[s, :n, :2] = start
        dirt[s, :n, 2:4] = start + length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        wide, thin = rng.uniform(*_SPECK_HALF_WIDTH_MM, n), rng.uniform(*_SCRATCH_HALF_WIDTH_MM, n)
        dirt[s, :n, 4] = np.where(length > 0, thin, wide)
        dirt[s, :n, 5] = rng.uniform(0.25, 0.6, n)
    return dirt


def _arm(truth: Truth, placement: int, rng: np.random.Generator) -> FloatArray:
    """An operator's forearm that reaches in from a side, between the ball and one of the cameras, (1, 7)."""
    ball = truth.ball_places_mm[placement]
    towards = truth.cameras[rng.integers(len(truth.cameras))].centre_mm - ball
    towards /= np.linalg.norm(towards)
    side = np.cross(rng.normal(size=3), towards)
    side /= np.linalg.norm(side)
    hand = ball + 1.25 * truth.ball.radius_mm * towards + 60.0 * side
    return np.array([[*hand, *(hand + 600.0 * side + 100.0 * towards), 35.0]])


_BLOB_RADIUS_MM = (2.0, 12.0)
_BLOB_SPREAD_MM = 700.0
_BLOB_GROUP_MM = 40.0
_WALL_CELLS = 100


def _blobs(count: int, room: FloatArray, middle: FloatArray, rng: np.random.Generator) -> FloatArray:
    """White discs on the walls where cameras look past the ball, (count, 4): wall, two coordinates, radius."""
    wall = rng.integers(0, 6, count)
    first, second = np.where(wall < 2, 1, 0), np.where(wall >= 4, 1, 2)
    low, high = room
    groups = max(count // 6, 1)
    of_group = rng.normal(0.0, _BLOB_SPREAD_MM, (groups, 2))[rng.integers(0, groups, count)]
    offset = of_group + rng.normal(0.0, _BLOB_GROUP_MM, (count, 2))
    a = np.clip(middle[first] + offset[:, 0], low[first], high[first])
    b = np.clip(middle[second] + offset[:, 1], low[second], high[second])
    return np.column_stack([wall.astype(float), a, b, rng.uniform(*_BLOB_RADIUS_MM, count)])


def _blob_grid(blobs: FloatArray, room: FloatArray) -> NDArray[np.int32]:
    """Which blobs may show in each cell of each wall, (6, g, g, most)."""
    g = _WALL_CELLS
    members: dict[tuple[int, int, int], list[int]] = {}
    for index, (wall, a, b, radius) in enumerate(blobs):
        first, second = (1 if wall < 2 else 0), (1 if wall >= 4 else 2)
        spans = []
        for axis, place in ((first, a), (second, b)):
            per_mm = g / (room[1, axis] - room[0, axis])
            low, high = np.floor((np.array([place - radius, place + radius]) - room[0, axis]) * per_mm).astype(int)
            spans.append(range(max(low, 0), min(high, g - 1) + 1))
        for i in spans[0]:
            for j in spans[1]:
                members.setdefault((int(wall), i, j), []).append(index)
    grid = np.full((6, g, g, max(map(len, members.values()), default=0)), -1, dtype=np.int32)
    for cell, found in members.items():
        grid[cell][: len(found)] = found
    return grid


def blob_places(scene: TracedScene) -> tuple[FloatArray, FloatArray]:
    """Centres (b, 3) of the blobs in the world and their radii (b,), mm."""
    wall = scene.blobs[:, 0].astype(int)
    rows = np.arange(len(wall))
    places = np.empty((len(wall), 3))
    places[rows, wall // 2] = scene.room[wall % 2, wall // 2]
    places[rows, np.where(wall < 2, 1, 0)] = scene.blobs[:, 1]
    places[rows, np.where(wall >= 4, 1, 2)] = scene.blobs[:, 2]
    return places, scene.blobs[:, 3]
