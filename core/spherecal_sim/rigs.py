"""Simulated rigs, x along, y across, z up, mm: the two of [Tao21], halls, domes; where cameras are, aims, lenses."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import STANDARD_PLACEMENTS, CameraSpec
from spherecal.geometry.camera import FISHEYE_MARK, N_INTRINSICS
from spherecal.geometry.rotation import exp_rotation

PRESETS = ("rigA", "rigB", "hall24", "hall50", "hall100", "dome24", "demo")


@dataclass(frozen=True)
class CameraKind:
    """A camera model with its lens, as the data sheets give them; `fisheye` lenses follow that model."""

    model: str
    image_size: tuple[int, int]
    pixel_pitch_um: float
    focal_length_mm: float
    fisheye: bool = False

    @property
    def focal_length_px(self) -> float:
        """The nominal focal length in pixels."""
        return self.focal_length_mm / self.pixel_pitch_um * 1e3


G319B = CameraKind("AVT G-319B", (2064, 1544), 3.45, 8.0)
CA050 = CameraKind("MV-CA050-20GM", (2448, 2048), 3.45, 12.0)
SMALL = CameraKind("simulated 1.3 MP", (1280, 1024), 4.8, 8.0)


@dataclass(frozen=True)
class RigDesign:
    """A rig as drawn: camera places and aims (n, 3) mm, the image's upward direction (3,), and the volumes in use."""

    name: str
    kind: CameraKind
    places_mm: FloatArray
    aims_mm: FloatArray
    up: FloatArray
    volume_mm: FloatArray  # (2, 3) lowest and highest corner
    ball_box_mm: FloatArray  # (2, 3) of the ball's centres
    placements: int = STANDARD_PLACEMENTS
    walk: bool = False  # the ball is walked along x instead of put on a grid


@dataclass(frozen=True)
class TrueCamera:
    """A simulated camera as it really is: 16 intrinsics and pose `x_camera = rotation @ x_world + translation_mm`."""

    id: str
    kind: CameraKind
    intrinsics: FloatArray
    rotation: FloatArray
    translation_mm: FloatArray

    @property
    def centre_mm(self) -> FloatArray:
        """The projection centre in the rig's frame, (3,) mm."""
        return -self.rotation.T @ self.translation_mm

    def known(self, prior: FloatArray, prior_given: bool) -> CameraSpec:
        """The camera as a user knows it."""
        kind, lens = self.kind, "fisheye" if self.kind.fisheye else "brown"
        about = {"model": kind.model, "pixel_pitch_um": kind.pixel_pitch_um, "focal_length_mm": kind.focal_length_mm}
        return CameraSpec(self.id, kind.image_size, prior, prior_given, self.id, lens_model=lens, **about)


def rig_design(preset: str) -> RigDesign:
    """The drawing of a preset, also any `hallN` (N even, >= 6), `domeN` (>= 3), `wideN` (field 60 to 160 degrees)."""
    if preset == "rigA":
        return _rig_a()
    if preset == "rigB":
        return _rig_b()
    if preset == "demo":
        return _demo()
    for shape, draw in (("hall", hall), ("dome", dome), ("wide", wide)):
        if preset.startswith(shape) and preset[len(shape) :].isdecimal():
            return draw(int(preset[len(shape) :]))
    what = Phrase("error-no-preset", {"name": repr(preset)})
    raise InputError(what, Phrase("error-presets", {"names": list(PRESETS)}))


def _rig_a() -> RigDesign:
    """[Tao21]'s first rig: ten cameras in two rows on top of a 1500 x 1000 x 1200 mm frame."""
    x = np.tile(np.linspace(-600.0, 600.0, 5), 2)
    y = np.repeat([-420.0, 420.0], 5)
    places = np.column_stack([x, y, np.full(10, 1200.0)])
    aims = np.column_stack([0.3 * x, -0.2 * y, np.full(10, 250.0)])
    return RigDesign(
        "rigA", G319B, places, aims, np.array([0.0, 1.0, 0.0]),
        volume_mm=np.array([[-450.0, -300.0, 100.0], [450.0, 300.0, 600.0]]),
        ball_box_mm=np.array([[-300.0, -200.0, 300.0], [300.0, 200.0, 300.0]]),
    )  # fmt: skip


def _rig_b() -> RigDesign:
    """[Tao21]'s second rig: twelve cameras on two opposed vertical planes of a 1290 x 1150 x 990 mm frame."""
    x, y, z = (a.ravel() for a in np.meshgrid([-552.0, 0.0, 552.0], [-575.0, 575.0], [228.0, 762.0], indexing="ij"))
    places = np.column_stack([x, y, z])
    aims = np.column_stack([-0.2 * x, 0.0 * y, 495.0 - 0.2 * (z - 495.0)])
    return RigDesign(
        "rigB", CA050, places, aims, np.array([0.0, 0.0, 1.0]),
        volume_mm=np.array([[-300.0, -250.0, 250.0], [300.0, 250.0, 740.0]]),
        ball_box_mm=np.array([[-137.0, -82.0, 495.0], [137.0, 82.0, 495.0]]),
    )  # fmt: skip


def _demo() -> RigDesign:
    """Six small cameras over a table: the least that shows the whole method, quick to render."""
    x = np.tile([-650.0, 0.0, 650.0], 2)
    y = np.repeat([-450.0, 450.0], 3)
    places = np.column_stack([x, y, np.full(6, 1150.0)])
    aims = np.column_stack([0.05 * x, 0.05 * y, np.full(6, 330.0)])
    return RigDesign(
        "demo", SMALL, places, aims, np.array([0.0, 1.0, 0.0]),
        volume_mm=np.array([[-300.0, -200.0, 150.0], [300.0, 200.0, 550.0]]),
        ball_box_mm=np.array([[-150.0, -100.0, 330.0], [150.0, 100.0, 330.0]]),
    )  # fmt: skip


# hall50 is 25 columns over 7.5 m and takes 7 to 12 hops from end to end
_HALL_COLUMN_MM = 312.5


def hall(n_cameras: int) -> RigDesign:
    """Two rows of cameras over a lane; the ball is walked along it, by default with one placement a camera."""
    if n_cameras < 6 or n_cameras % 2:
        raise InputError(f"A hall has an even number of cameras, at least 6, not {n_cameras}.")
    columns = n_cameras // 2
    half = (columns - 1) / 2 * _HALL_COLUMN_MM
    x = np.repeat(np.linspace(-half, half, columns), 2)
    y = np.tile([-420.0, 420.0], columns)
    places = np.column_stack([x, y, np.full(n_cameras, 1200.0)])
    aims = np.column_stack([x, 0.1 * y, np.full(n_cameras, 250.0)])
    return RigDesign(
        f"hall{n_cameras}",
        G319B,
        places,
        aims,
        np.array([0.0, 1.0, 0.0]),
        volume_mm=np.array([[-half - 150.0, -300.0, 100.0], [half + 150.0, 300.0, 600.0]]),
        ball_box_mm=np.array([[-half, -125.0, 250.0], [half, 125.0, 350.0]]),
        placements=n_cameras,
        walk=True,
    )


def dome(n_cameras: int) -> RigDesign:
    """Cameras spread evenly over the upper half of a sphere of 1200 mm, all aimed near its centre."""
    if n_cameras < 3:
        raise InputError(f"A dome has at least 3 cameras, not {n_cameras}.")
    i = np.arange(n_cameras)
    z = 0.33 + 0.62 * (i + 0.5) / n_cameras
    azimuth = i * _GOLDEN_ANGLE
    rim = np.sqrt(1 - z * z)
    direction = np.column_stack([rim * np.cos(azimuth), rim * np.sin(azimuth), z])
    centre = np.array([0.0, 0.0, 300.0])
    return RigDesign(
        f"dome{n_cameras}", G319B, centre + 1200.0 * direction, np.tile(centre, (n_cameras, 1)),
        np.array([0.0, 0.0, 1.0]), volume_mm=np.array([[-300.0, -300.0, 50.0], [300.0, 300.0, 550.0]]),
        ball_box_mm=np.array([[-120.0, -120.0, 300.0], [120.0, 120.0, 300.0]]),
    )  # fmt: skip


def wide(field_deg: int) -> RigDesign:
    """Rig A's frame with fisheye lenses of the given field over the image's diagonal."""
    if not 60 <= field_deg <= 160:
        raise InputError(f"A wide rig has lenses of 60 to 160 degrees, not {field_deg}.")
    plain = _rig_a()
    half_px = np.hypot(*G319B.image_size) / 2
    focal_mm = float(half_px / np.deg2rad(field_deg / 2)) * G319B.pixel_pitch_um / 1e3
    kind = replace(G319B, focal_length_mm=round(focal_mm, 3), fisheye=True)
    return replace(
        plain, name=f"wide{field_deg}", kind=kind, aims_mm=plain.aims_mm * [0.5, 1.0, 1.0], placements=8,
        ball_box_mm=np.array([[-650.0, -450.0, 250.0], [650.0, 450.0, 550.0]]),
    )  # fmt: skip


_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def build_cameras(design: RigDesign, rng: np.random.Generator) -> tuple[TrueCamera, ...]:
    """The simulated cameras of a rig as built: mounted a little off the drawing, with lenses of their own."""
    n = len(design.places_mm)
    centres = design.places_mm + rng.normal(0.0, 4.0, (n, 3))
    tilts = exp_rotation(rng.normal(0.0, np.deg2rad(0.5), (n, 3)))
    intrinsics = _true_intrinsics(design.kind, n, rng)
    cameras = []
    for i in range(n):
        rotation = tilts[i] @ look_at(design.places_mm[i], design.aims_mm[i], design.up)
        cameras.append(TrueCamera(f"C{i + 1:02d}", design.kind, intrinsics[i], rotation, -rotation @ centres[i]))
    return tuple(cameras)


def look_at(place: FloatArray, aim: FloatArray, up: FloatArray) -> FloatArray:
    """World-to-camera rotation (3, 3) of a camera at a place (3,) that looks at another, `up` not along the way."""
    z = (aim - place) / np.linalg.norm(aim - place)
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _true_intrinsics(kind: CameraKind, n: int, rng: np.random.Generator) -> FloatArray:
    """Lenses as built, (n, 16): focal length +-1.5 %, principal point sd 10 px, -2.3 % distortion at rig A's corner."""
    if kind.fisheye:
        # between equidistant and stereographic ones, as most on the market are
        lenses = np.zeros((n, N_INTRINSICS))
        wide, high = kind.image_size
        lenses[:, 0] = kind.focal_length_px * (1 + rng.uniform(-0.015, 0.015, n))
        lenses[:, 1] = lenses[:, 0] * (1 + rng.normal(0.0, 5e-5, n))
        lenses[:, 2:4] = (np.array([wide, high]) - 1) / 2 + rng.normal(0.0, 10.0, (n, 2))
        lenses[:, 4:8] = rng.normal([0.03, 0.004, -0.002, 0.0], [0.01, 0.003, 0.001, 0.0003], (n, 4))
        lenses[:, 15] = FISHEYE_MARK
        return lenses
    c = np.zeros((n, N_INTRINSICS))
    width, height = kind.image_size
    c[:, 0] = kind.focal_length_px * (1 + rng.uniform(-0.015, 0.015, n))
    c[:, 1] = c[:, 0] * (1 + rng.normal(0.0, 5e-5, n))
    c[:, 2] = (width - 1) / 2 + rng.normal(0.0, 10.0, n)
    c[:, 3] = (height - 1) / 2 + rng.normal(0.0, 10.0, n)
    c[:, 4] = rng.normal(-0.10, 0.005, n)  # k1
    c[:, 5] = rng.normal(0.09, 0.005, n)  # k2
    c[:, 6:8] = rng.normal(0.0, 3e-4, (n, 2))  # p1, p2
    c[:, 8] = rng.normal(-0.02, 0.005, n)  # k3
    return c


def nominal_intrinsics(kind: CameraKind) -> FloatArray:
    """The intrinsics (16,) of a data sheet: nominal focal length, centred principal point, no distortion."""
    c = np.zeros(N_INTRINSICS)
    width, height = kind.image_size
    c[:4] = kind.focal_length_px, kind.focal_length_px, (width - 1) / 2, (height - 1) / 2
    c[15] = FISHEYE_MARK if kind.fisheye else 0.0
    return c


Layout = Literal["spread", "heights", "row", "clustered", "stacked"]
Turns = Literal["turned", "moved", "random"]

# Corners first: four placements on a 2 x 2 grid are the method's standard.
_GRID = ((-1, -1), (1, 1), (-1, 1), (1, -1), (0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
_CLUSTER_MM = 60.0  # numerics of the method: spread placements are 2 to 3 times better than these
_HEIGHT_MM = 150.0


def ball_places(design: RigDesign, count: int, layout: Layout) -> FloatArray:
    """Where the ball's centre is put, (count, 3) mm in the rig's frame."""
    low, high = design.ball_box_mm
    middle, half = (low + high) / 2, (high - low) / 2
    if design.walk and layout == "spread":
        along = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
        step = np.arange(count)
        return middle + half * np.column_stack([along, np.where(step % 2, 1.0, -1.0), np.resize([0, 1, -1], count)])
    unit = np.zeros((count, 3))
    unit[:, :2] = _unit_grid(count)
    if layout == "row":
        unit[:, 0], unit[:, 1] = (np.linspace(-1, 1, count) if count > 1 else 0.0), 0.0
    if layout == "clustered":
        half = np.array([_CLUSTER_MM, _CLUSTER_MM, 0.0])
    if layout in ("heights", "stacked"):
        half = np.array([half[0], half[1], _HEIGHT_MM])
        unit[:, 2] = np.linspace(-1, 1, count)[np.argsort(np.arange(count) % 2, kind="stable")]
    if layout == "stacked":
        unit[:, :2] = 0.0
    return middle + half * unit


def _unit_grid(count: int) -> FloatArray:
    """Places in the square +-1, (count, 2): the middle, the corners, the 3 x 3 grid, or an even scatter."""
    if count == 1:
        return np.zeros((1, 2))
    if count <= len(_GRID):
        return np.array(_GRID[:count], dtype=float)
    # the two-dimensional golden-ratio sequence spreads any number of points evenly
    steps = np.outer(np.linspace(0.5, count - 0.5, count), [0.7548776662466927, 0.5698402909980532])
    return 2 * (steps % 1.0) - 1


def ball_turns(count: int, turns: Turns, rng: np.random.Generator) -> FloatArray:
    """Rotations ball to world of the placements, (count, 3, 3)."""
    if turns == "moved":
        return np.tile(random_rotations(1, rng), (count, 1, 1))
    if turns == "random":
        return random_rotations(count, rng)
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    steps = exp_rotation(axes * np.deg2rad(rng.uniform(30.0, 60.0, (count, 1))))
    rotations = [random_rotations(1, rng)[0]]
    for step in steps[1:]:
        rotations.append(step @ rotations[-1])
    return np.array(rotations)


def random_rotations(count: int, rng: np.random.Generator) -> FloatArray:
    """Uniformly distributed rotations, (count, 3, 3), from normal quaternions."""
    quaternions = rng.normal(size=(count, 4))
    w, x, y, z = (quaternions / np.sqrt((quaternions**2).sum(axis=1, keepdims=True))).T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        -2,
    )
