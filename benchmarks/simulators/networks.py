"""Simulated close-range networks: many stations of one camera before one static scene, with their truth.

Three kinds: `targets` (113 views of 150 targets, some views with 10 to 20 points), `building` and `sheet`. `building`
has 60 views, 26,321 points of natural features and 90,561 marks; `sheet` has 21 views of one plane of 100 dots. Every
station is a camera of the session, all share one lens, and the scene is one placement. World in millimetres.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.simulators.heavy_tails import heavy_noise
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.data.observations import Observations
from spherecal.data.session import Bar, BarLength, BarPose, CameraSpec, Mark, Placement, Scale, Session
from spherecal.geometry.camera import N_INTRINSICS, image_reach, project
from spherecal.geometry.rotation import exp_rotation
from spherecal_sim.rigs import look_at

KINDS = ("targets", "building", "sheet")


@dataclass(frozen=True)
class TrueNetwork:
    """The truth behind a network: one lens (16,), poses (c, 3, 3), (c, 3), points (p, 3) mm by target id minus 1."""

    kind: str
    seed: int
    intrinsics: FloatArray
    rotation: FloatArray
    translation_mm: FloatArray
    points_mm: FloatArray
    wrong: BoolArray  # (n,) gross errors among the observations
    weak: BoolArray  # (c,) stations with few points
    noise_px: float  # sd of a coordinate

    @property
    def centres_mm(self) -> FloatArray:
        """Projection centres (c, 3) mm."""
        return -np.einsum("nji,nj->ni", self.rotation, self.translation_mm)

    @property
    def size_mm(self) -> float:
        """The diagonal of the scene's bounding box, mm."""
        return float(np.linalg.norm(np.ptp(self.points_mm, axis=0)))


@dataclass(frozen=True)
class _Lens:
    """A camera with its lens: image size px, true intrinsics (16,), focal length of the prior px."""

    size: tuple[int, int]
    intrinsics: FloatArray
    prior_focal_px: float


@dataclass(frozen=True)
class _Stations:
    """Where the camera was: world-to-camera rotations (c, 3, 3), translations (c, 3) mm, which are weak (c,)."""

    rotation: FloatArray
    translation: FloatArray
    weak: BoolArray


@dataclass(frozen=True)
class _Scene:
    """What is recorded: its kind and seed, the lens of all stations, and points (p,3) mm."""

    kind: str
    seed: int
    lens: _Lens
    stations: _Stations
    points: FloatArray


def simulate_network(kind: str, seed: int) -> tuple[Session, TrueNetwork]:
    """A session of a network and its truth; the same seed gives the same session."""
    makers = {"targets": _targets, "building": _building, "sheet": _sheet}
    if kind not in makers:
        raise InputError(f"There is no network {kind!r}.", f"Networks are {', '.join(KINDS)}.")
    return makers[kind](seed)


# ------------------------------------------------------------------------------------------------ targets
_TARGETS, _VIEWS, _MARKS = 150, 113, 9962
_MOST, _FEW = 117, (10, 20)  # points of the best and of the weak views
_TARGET_NOISE_PX, _TARGET_GROSS = 0.07, 0.01


def _targets(seed: int) -> tuple[Session, TrueNetwork]:
    """150 targets on a wall with blocks before it, from all around the front; five to ten views see 10 to 20 points."""
    of_scene, of_stations, of_lens, of_marks, of_noise = _streams(seed)
    points, normals = _wall_with_blocks(of_scene)
    lens = _lens((4288, 2848), 3000.0, 0.03, of_lens)
    stations = _around_the_wall(int(of_stations.integers(5, 11)), of_stations)
    seen = _visible(lens, stations, points, normals, np.where(stations.weak, 86.0, 72.0))
    seen = _thinned(seen, stations.weak, of_marks)
    camera, point = np.nonzero(seen)
    noise = np.full(len(camera), _TARGET_NOISE_PX)
    scene = _Scene("targets", seed, lens, stations, points)
    return _recorded(scene, camera, point, noise, _TARGET_GROSS, of_noise)


def _wall_with_blocks(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Targets and normals (150, 3): a wall of 4 x 2.6 m, boxes before it, a strip of floor; z is towards the views."""
    n_wall, n_floor = 85, 20
    wall = np.column_stack(
        [rng.uniform(-2000, 2000, n_wall), rng.uniform(-1300, 1300, n_wall), rng.normal(0, 15, n_wall)]
    )
    floor = np.column_stack(
        [rng.uniform(-2000, 2000, n_floor), np.full(n_floor, -1350.0), rng.uniform(100, 1400, n_floor)]
    )
    places, normals = [wall, floor], [np.tile([0.0, 0, 1], (n_wall, 1)), np.tile([0.0, 1, 0], (n_floor, 1))]
    left = _TARGETS - n_wall - n_floor
    for count in np.diff(np.linspace(0, left, 6).astype(int)):
        middle, half = rng.uniform([-1600, -1000, 250], [1600, 1000, 900]), rng.uniform(120, 300, 3)
        face = rng.choice(4, count, p=[0.7, 0.1, 0.1, 0.1])  # front, left, right, above
        axis, sign = np.array([2, 0, 0, 1])[face], np.array([1.0, -1, 1, 1])[face]
        place = rng.uniform(-half, half, (count, 3))
        place[np.arange(count), axis] = sign * half[axis]
        normal = np.zeros((count, 3))
        normal[np.arange(count), axis] = sign
        places.append(middle + place)
        normals.append(normal)
    return np.concatenate(places), np.concatenate(normals)


def _around_the_wall(n_weak: int, rng: np.random.Generator) -> _Stations:
    """Stations on a cap of 4 to 6 m before the wall, the camera rolled by quarter turns; the weak ones steep or far."""
    n = _VIEWS
    weak = np.zeros(n, dtype=bool)
    weak[rng.choice(n, n_weak, replace=False)] = True
    azimuth = np.deg2rad(rng.uniform(-55, 55, n))
    height = np.deg2rad(rng.uniform(-12, 45, n))
    distance = rng.uniform(4000, 6000, n)
    steep = weak & (rng.random(n) < 0.5)
    azimuth[steep] = np.deg2rad(rng.uniform(70, 82, steep.sum())) * rng.choice([-1, 1], steep.sum())
    distance[weak & ~steep] = rng.uniform(12000, 22000, (weak & ~steep).sum())
    direction = np.column_stack([np.cos(height) * np.sin(azimuth), np.sin(height), np.cos(height) * np.cos(azimuth)])
    aim = rng.uniform([-500, -300, 0], [500, 300, 400], (n, 3))
    roll = np.pi / 2 * rng.integers(0, 4, n) + rng.normal(0, 0.05, n)
    return _standing(aim + distance[:, None] * direction, aim, np.array([0.0, 1, 0]), roll, weak)


def _thinned(seen: BoolArray, weak: BoolArray, rng: np.random.Generator) -> BoolArray:
    """Views (c, p) cut down to 9,962 marks: weak views keep 10 to 20 points of a patch, the others at most 117."""
    seen = seen.copy()
    for c in range(len(seen)):
        points = np.flatnonzero(seen[c])
        keep = int(rng.integers(_FEW[0], _FEW[1] + 1)) if weak[c] else _MOST
        if len(points) > keep:
            seen[c, rng.permutation(points)[keep:]] = False
    strong = np.flatnonzero(~weak)
    share = rng.gamma(1.5, size=len(strong))  # how much each of the others loses
    while (excess := int(seen.sum()) - _MARKS) > 0:
        for c in rng.choice(strong, min(excess, 50), p=share / share.sum()):
            points = np.flatnonzero(seen[c])
            if len(points) > 30:
                seen[c, rng.choice(points)] = False
    return seen


# ------------------------------------------------------------------------------------------------ building
_B_POINTS, _B_VIEWS, _B_MARKS = 26321, 60, 90561
_B_NOISE_PX, _B_GROSS = 0.55, 0.024


def _building(seed: int) -> tuple[Session, TrueNetwork]:
    """Tracks of natural features on a building with relief and the ground before it; mean 3.4 views a point."""
    of_scene, of_stations, of_lens, of_marks, of_noise = _streams(seed)
    lens = _lens((3872, 2592), 3100.0, 0.02, of_lens)
    stations = _along_the_facade(of_stations)
    points, normals = _facade(4 * _B_POINTS, of_scene)
    seen = _visible(lens, stations, points, normals, np.full(_B_VIEWS, 70.0))
    enough = np.flatnonzero(seen.sum(axis=0) >= 6)
    chosen = np.sort(of_marks.permutation(enough)[:_B_POINTS])
    points, seen = points[chosen], seen[:, chosen]
    camera, point = _tracks(seen, of_marks)
    # what one detector finds over many scales is not equally sharp
    noise = _B_NOISE_PX * of_marks.lognormal(-0.045, 0.3, len(points))[point]
    scene = _Scene("building", seed, lens, stations, points)
    return _recorded(scene, camera, point, noise, _B_GROSS, of_noise)


def _facade(count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Features (count, 3) mm and normals: a front of 34 x 14 m with bays and window reveals, two wings, the ground."""
    part = rng.choice(4, count, p=[0.56, 0.17, 0.17, 0.10])
    x, y = rng.uniform(-17000, 17000, count), rng.uniform(0, 14000, count)
    bay = 900.0 * (np.floor((x + 17000) / 4250) % 2)
    window = -350.0 * (((x % 2125) < 900) & ((y % 3500) < 1800))
    front = np.column_stack([x, y, bay + window + rng.normal(0, 30, count)])
    along = rng.uniform(0, 11000, count)
    wing = np.column_stack([17000 + 0.35 * along, y, along - 200 * ((along % 2500) < 900)])
    ground = np.column_stack(
        [rng.uniform(-18000, 18000, count), rng.normal(0, 40, count), rng.uniform(800, 9000, count)]
    )
    other = wing * [-1, 1, 1]
    of_wing = np.array([-1, 0, 0.35]) / np.hypot(1, 0.35)
    places = np.choose(part[:, None], [front, wing, other, ground])
    normals = np.array([[0, 0, 1.0], of_wing, of_wing * [-1, 1, 1], [0, 1, 0]])[part]
    return places, normals


def _along_the_facade(rng: np.random.Generator) -> _Stations:
    """60 stations on a walk of two rows before the building, from 12 to 22 m, some turned by a quarter."""
    n = _B_VIEWS
    row = np.arange(n) % 2
    x = np.linspace(-15500, 15500, n) + rng.normal(0, 300, n)
    place = np.column_stack([x, 1700 + 2500 * row + rng.normal(0, 150, n), 15500 + 5000 * row + rng.normal(0, 500, n)])
    aim = np.column_stack([0.75 * x + rng.normal(0, 2500, n), rng.uniform(4500, 7500, n), np.zeros(n)])
    roll = np.where(rng.random(n) < 0.15, np.pi / 2, 0.0) + rng.normal(0, 0.02, n)
    return _standing(place, aim, np.array([0.0, 1, 0]), roll, np.zeros(n, dtype=bool))


def _tracks(seen: BoolArray, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Camera and point of 90,561 marks: each feature is followed over two or more neighbouring views that see it."""
    views = seen.sum(axis=0)
    length = np.minimum(2 + rng.geometric(1 / 2.44, len(views)) - 1, views)
    while (missing := _B_MARKS - int(length.sum())) != 0:
        step = 1 if missing > 0 else -1
        able = np.flatnonzero(length < views if step > 0 else length > 2)
        length[rng.permutation(able)[: abs(missing)]] += step
    camera, point = [], []
    for p, count in enumerate(length):
        own = np.flatnonzero(seen[:, p])
        # views next to each other on the walk, now and then one left out
        first = int(rng.integers(0, len(own) - count + 1))
        stretch = own[first : first + min(len(own) - first, count + int(rng.integers(0, 2)))]
        camera.append(np.sort(rng.permutation(stretch)[:count]))
        point.append(np.full(count, p))
    order = np.lexsort((np.concatenate(point), np.concatenate(camera)))
    return np.concatenate(camera)[order], np.concatenate(point)[order]


# ------------------------------------------------------------------------------------------------ sheet
_S_VIEWS, _S_NOISE_PX = 21, 0.12


def _sheet(seed: int) -> tuple[Session, TrueNetwork]:
    """A flat sheet of 10 x 10 dots 1 m wide, from five sides, above and rolled; a few dots are missed."""
    _, of_stations, of_lens, of_marks, of_noise = _streams(seed)
    grid = np.linspace(-500, 500, 10)
    points = np.stack([*np.meshgrid(grid, grid), np.zeros((10, 10))], axis=-1).reshape(-1, 3)
    lens = _lens((2272, 1704), 2336.0, 0.01, of_lens)
    azimuth = np.deg2rad(90.0 * (np.arange(_S_VIEWS) % 4) + of_stations.normal(0, 8, _S_VIEWS))
    tilt = np.deg2rad(of_stations.uniform(25, 50, _S_VIEWS))
    tilt[::5] = np.deg2rad(of_stations.uniform(2, 10, len(tilt[::5])))
    distance = of_stations.uniform(1950, 2300, _S_VIEWS)
    direction = np.column_stack([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    aim = np.column_stack([of_stations.normal(0, 40, (_S_VIEWS, 2)), np.zeros(_S_VIEWS)])
    roll = of_stations.choice([0.0, np.pi / 2, np.pi, -np.pi / 2], _S_VIEWS)
    never = np.zeros(_S_VIEWS, dtype=bool)
    stations = _standing(aim + distance[:, None] * direction, aim, np.array([0.3, 1, 0.0]), roll, never)
    normals = np.tile([0.0, 0, 1], (100, 1))
    seen = _visible(lens, stations, points, normals, np.full(_S_VIEWS, 75.0))
    seen &= of_marks.random(seen.shape) > 0.012
    camera, point = np.nonzero(seen)
    noise = np.full(len(camera), _S_NOISE_PX)
    scene = _Scene("sheet", seed, lens, stations, points)
    return _recorded(scene, camera, point, noise, 0.0, of_noise)


# ------------------------------------------------------------------------------------------------ common
def _streams(seed: int) -> list[np.random.Generator]:
    return [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(5)]


def _lens(size: tuple[int, int], focal_px: float, prior_error: float, rng: np.random.Generator) -> _Lens:
    """A moderate Brown lens; the prior's focal length is off by up to the given share."""
    width, height = size
    c = np.zeros(N_INTRINSICS)
    c[0] = focal_px * (1 + rng.uniform(-0.02, 0.02))
    c[1] = c[0] * (1 + rng.normal(0, 1e-4))
    c[2:4] = (width - 1) / 2 + rng.normal(0, 20), (height - 1) / 2 + rng.normal(0, 20)
    c[4:6] = rng.normal(-0.09, 0.015), rng.normal(0.08, 0.02)
    c[6:8] = rng.normal(0, 4e-4, 2)
    c[8] = rng.normal(-0.01, 0.01)
    return _Lens(size, c, float(c[0] * (1 + rng.uniform(-prior_error, prior_error))))


def _standing(places: FloatArray, aims: FloatArray, up: FloatArray, roll: FloatArray, weak: BoolArray) -> _Stations:
    turn = exp_rotation(np.column_stack([np.zeros(len(roll)), np.zeros(len(roll)), roll]))
    rotation = np.array([t @ look_at(place, aim, up) for t, place, aim in zip(turn, places, aims, strict=True)])
    return _Stations(rotation, -np.einsum("nij,nj->ni", rotation, places), weak)


def _visible(
    lens: _Lens, stations: _Stations, points: FloatArray, normals: FloatArray, limit_deg: FloatArray
) -> BoolArray:
    """Which station sees which point (c, p), by view angle below each station's limit, depth and frame."""
    seen = np.zeros((len(limit_deg), len(points)), dtype=bool)
    size = np.array(lens.size)
    reach = image_reach(lens.intrinsics[None], size[None])
    for c, limit in enumerate(np.cos(np.deg2rad(limit_deg))):
        x = points @ stations.rotation[c].T + stations.translation[c]
        ray = -stations.rotation[c].T @ stations.translation[c] - points
        facing = (ray * normals).sum(axis=1) > limit * np.linalg.norm(ray, axis=1)
        ahead = (x[:, 2] > 0) & (np.hypot(x[:, 0], x[:, 1]) < reach * x[:, 2])
        rows = np.flatnonzero(facing & ahead)
        uv = project(x[rows], lens.intrinsics)
        seen[c, rows] = ((uv > -0.5) & (uv < size - 0.5)).all(axis=1)
    return seen


def _recorded(
    scene: _Scene, camera: IntArray, point: IntArray, noise_px: FloatArray, gross: float, rng: np.random.Generator
) -> tuple[Session, TrueNetwork]:
    """Session and truth of what was seen: heavy-tailed noise, a share of gross errors, two points as a scale bar."""
    lens, stations, points = scene.lens, scene.stations, scene.points
    x = np.einsum("nij,nj->ni", stations.rotation[camera], points[point]) + stations.translation[camera]
    uv = project(x, lens.intrinsics) + heavy_noise(noise_px, rng)
    wrong = np.zeros(len(uv), dtype=bool)
    bar = _bar_points(points, camera, point)
    on_bar = np.isin(point, bar)
    able = np.flatnonzero(~on_bar)
    wrong[rng.permutation(able)[: round(gross * len(uv))]] = True
    uv[wrong] += _gross_errors(int(wrong.sum()), float(np.median(noise_px)), np.array(lens.size), rng)
    views = tuple(f"V{i + 1:03d}" for i in range(len(stations.weak)))
    observations = Observations(
        ("P1", "S1"),
        views,
        ("centre",),
        on_bar.astype(np.int64),
        camera,
        point + 1,
        np.zeros(len(uv), dtype=np.int64),
        uv,
    )
    order = np.lexsort((point, camera, on_bar))
    truth = TrueNetwork(
        scene.kind,
        scene.seed,
        lens.intrinsics,
        stations.rotation,
        stations.translation,
        points,
        wrong[order],
        stations.weak,
        float(np.sqrt((noise_px**2).mean())),
    )
    return _session(lens, views, points, bar, observations.select(order)), truth


def _gross_errors(count: int, noise_px: float, size: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Shifts (count, 2) px: six in ten of 8 sigma to 40 px (log-uniform), the others of up to a third of the image."""
    length = np.exp(rng.uniform(np.log(8 * noise_px), np.log(40.0), count))
    far = rng.random(count) < 0.4
    length[far] = rng.uniform(40.0, float(size.min()) / 3, far.sum())
    angle = rng.uniform(0, 2 * np.pi, count)
    return length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def _bar_points(points: FloatArray, camera: IntArray, point: IntArray) -> IntArray:
    """Two points far from each other that many views see: the ends of the scale bar."""
    views = np.bincount(point, minlength=len(points))
    best = np.flatnonzero(views >= np.quantile(views, 0.8))
    middle = points[best].mean(axis=0)
    one = best[np.linalg.norm(points[best] - middle, axis=1).argmax()]
    other = best[np.linalg.norm(points[best] - points[one], axis=1).argmax()]
    return np.sort([one, other])


def _session(
    lens: _Lens, views: tuple[str, ...], points: FloatArray, bar: IntArray, observations: Observations
) -> Session:
    width, height = lens.size
    prior = np.zeros(N_INTRINSICS)
    prior[:4] = lens.prior_focal_px, lens.prior_focal_px, (width - 1) / 2, (height - 1) / 2
    cameras = tuple(CameraSpec(name, lens.size, prior, True, "LENS") for name in views)
    length = float(np.linalg.norm(points[bar[1]] - points[bar[0]]))
    scale_bar = Bar(
        "B",
        "scale",
        {"B1": Mark(int(bar[0]) + 1, "centre"), "B2": Mark(int(bar[1]) + 1, "centre")},
        (BarLength("B1", "B2", length, 1e-5 * length, 2.0),),
        0.0,
        20.0,
    )
    return Session(
        Path(),
        cameras,
        (Placement("P1"),),
        (scale_bar,),
        (BarPose("S1", "B"),),
        Scale("bar", bar="B"),
        None,
        None,
        None,
        observations,
        "",
    )
