"""Recordings of a board and of a waved bar on the simulated rigs, for studies and tests: observations with truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.data.observations import Observations
from spherecal.data.session import Bar, BarLength, BarPose, BoardPoint, CameraSpec, Mark, Placement, Scale, Session
from spherecal.geometry.rotation import exp_rotation
from spherecal_sim.observe import Seen, look, observe
from spherecal_sim.rigs import TrueCamera, build_cameras, nominal_intrinsics, random_rotations, rig_design

_CERTIFICATE_MM = 0.004  # of a waved bar's lengths, k = 2
_MOST_TILT_DEG = 40.0
_VIEW_LIMIT_DEG = 65.0  # beyond, dots are too slender to be measured


@dataclass(frozen=True)
class SimulatedRecording:
    """A session of observations, the true cameras, and true features (placements, points, 3) mm, rig's frame."""

    session: Session
    cameras: tuple[TrueCamera, ...]
    points_mm: FloatArray


def simulate_board(
    preset: str,
    seed: int,
    placements: int,
    *,
    rows: int = 8,
    columns: int = 11,
    pitch_mm: float = 33.0,
    sigma_px: float = 0.04,
    print_sd_mm: float = 0.0,
) -> SimulatedRecording:
    """A board of dots shown all over the volume, towards one simulated camera after the other."""
    design = rig_design(preset)
    of_rig, of_board, of_places, of_noise = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4))
    cameras = build_cameras(design, of_rig)
    row, column = np.divmod(np.arange(rows * columns), columns)
    board = np.column_stack([column * pitch_mm, row * pitch_mm, np.zeros(rows * columns)])
    printed = board + of_board.normal(size=board.shape) * (print_sd_mm, print_sd_mm, 0.0)
    low, high = design.volume_mm
    places, normals = [], []
    for number in range(placements):
        middle = of_places.uniform(low, high)
        rotation = _tilted(cameras[number % len(cameras)].centre_mm - middle, of_places)
        places.append((printed - printed.mean(axis=0)) @ rotation.T + middle)
        normals.append(-rotation[:, 2])  # z away from the viewer, into the board
    points = np.array(places)
    view = look(cameras)
    seen = [observe(view, p, np.tile(n, (len(p), 1)), _VIEW_LIMIT_DEG) for p, n in zip(points, normals, strict=True)]
    names = tuple(f"B{i + 1:03d}" for i in range(placements))
    observations = _observations(seen, names, cameras, np.arange(rows * columns), sigma_px, of_noise)
    session = Session(
        Path(),
        _specs(cameras),
        tuple(Placement(name) for name in names),
        (),
        (),
        None,
        tuple(BoardPoint(i, "centre", (float(p[0]), float(p[1]), 0.0)) for i, p in enumerate(board)),
        None,
        None,
        observations,
        "",
    )
    return SimulatedRecording(session, cameras, points)


def simulate_waved_bar(
    preset: str,
    seed: int,
    frames: int,
    *,
    marks_mm: tuple[float, ...] = (0.0, 300.0),
    sigma_px: float = 0.04,
) -> SimulatedRecording:
    """A bar of marks waved all over the volume, seen from all around."""
    design = rig_design(preset)
    of_rig, of_bar, of_places, of_noise = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4))
    cameras = build_cameras(design, of_rig)
    x = np.array(marks_mm)
    low, high = design.volume_mm
    points = np.empty((0, len(x), 3))
    while len(points) < frames:
        direction = random_rotations(frames, of_places)[:, :, 0]
        middle = of_places.uniform(low, high, (frames, 3))
        drawn = middle[:, None] + (x - x.mean())[:, None] * direction[:, None]
        points = np.concatenate([points, drawn[((drawn >= low) & (drawn <= high)).all(axis=(1, 2))]])
    points = points[:frames]
    view = look(cameras)
    seen = [observe(view, p, None) for p in points]
    names = tuple(f"F{i + 1:0{len(str(frames))}d}" for i in range(frames))
    observations = _observations(seen, names, cameras, np.arange(1, len(x) + 1), sigma_px, of_noise)
    marks = {f"M{i + 1}": Mark(i + 1, "centre") for i in range(len(x))}
    lengths = tuple(
        BarLength(f"M{i + 1}", f"M{i + 2}", step + of_bar.normal(0.0, _CERTIFICATE_MM / 2), _CERTIFICATE_MM, 2.0)
        for i, step in enumerate(np.diff(x).tolist())
    )
    bar = Bar("W", "scale", marks, lengths, 1.15e-5, 20.0)
    session = Session(
        Path(), _specs(cameras), (), (bar,), tuple(BarPose(name, "W", 20.0) for name in names), Scale("bar", bar="W"),
        None, None, None, observations, "",
    )  # fmt: skip
    return SimulatedRecording(session, cameras, points)


def _tilted(towards: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A board's rotation: its face (-z) towards the cameras, tilted by up to 40 degrees, turned in its plane."""
    z = -towards / np.linalg.norm(towards)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    facing = np.column_stack([x, np.cross(z, x), z])
    axis = rng.uniform(0, 2 * np.pi)
    tilt = np.deg2rad(_MOST_TILT_DEG) * np.sqrt(rng.uniform())
    turn = exp_rotation(np.array([0.0, 0.0, rng.uniform(0, 2 * np.pi)]))
    return facing @ exp_rotation(tilt * np.array([np.cos(axis), np.sin(axis), 0.0])) @ turn


def _specs(cameras: tuple[TrueCamera, ...]) -> tuple[CameraSpec, ...]:
    """The cameras as data sheets describe them."""
    return tuple(c.known(nominal_intrinsics(c.kind), prior_given=False) for c in cameras)


def _observations(
    seen: list[Seen],
    names: tuple[str, ...],
    cameras: tuple[TrueCamera, ...],
    targets: np.ndarray,
    sigma_px: float,
    rng: np.random.Generator,
) -> Observations:
    counts = [len(one.camera) for one in seen]
    uv = np.concatenate([one.uv for one in seen])
    return Observations(
        names, tuple(c.id for c in cameras), ("centre",), np.repeat(np.arange(len(seen)), counts),
        np.concatenate([one.camera for one in seen]), targets[np.concatenate([one.point for one in seen])],
        np.zeros(len(uv), dtype=np.int64), uv + sigma_px * rng.normal(size=uv.shape),
    )  # fmt: skip
