"""Rigs drawn at random: 4 to 16 cameras of mixed kinds in six layouts about a ball of 100 to 300 mm radius."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.geometry.camera import N_INTRINSICS
from spherecal.geometry.rotation import exp_rotation
from spherecal_sim.rigs import CameraKind, TrueCamera, look_at

Arrangement = Literal["top", "ring", "dome", "walls", "fan", "scattered"]
# sensors on the market: width, height, pixel pitch in um
_SENSORS = (
    (1280, 1024, 4.8), (1600, 1200, 4.5), (1920, 1200, 5.86), (2064, 1544, 3.45), (2448, 2048, 3.45),
    (4096, 3000, 3.45), (5472, 3648, 2.4),
)  # fmt: skip
_LENSES_MM = (2.8, 3.5, 4.0, 5.0, 6.0, 8.0, 12.0, 16.0, 25.0, 35.0, 50.0, 75.0)


@dataclass(frozen=True)
class RandomRig:
    """A rig as built: cameras, which are fisheyes (c,), volume and box of the ball's centres (2, 3) mm, the ball."""

    arrangement: Arrangement
    cameras: tuple[TrueCamera, ...]
    fisheye: BoolArray
    ball_radius_mm: float
    volume_mm: FloatArray
    ball_box_mm: FloatArray


def random_rig(rng: np.random.Generator, lenses: Literal["usual", "wide", "strong", "long"] = "usual") -> RandomRig:
    """A rig whose simulated cameras all see the middle of its volume."""
    arrangement: Arrangement = rng.choice(get_args(Arrangement))
    n = int(rng.integers(6 if arrangement in ("walls", "ring") else 4, 17))
    radius = float(rng.uniform(100, 300))
    distance = radius * (rng.uniform(3.0, 6.0) if lenses != "long" else rng.uniform(10, 16))
    if lenses == "wide":
        distance = radius * rng.uniform(2.6, 3.5)
    direction = _directions(arrangement, n, rng)
    places = distance * rng.uniform(0.9, 1.1, (n, 1)) * direction
    half = radius * rng.uniform([0.6, 0.6, 0.1], [1.3, 1.3, 0.6])
    aims = rng.uniform(-0.3, 0.3, (n, 3)) * half
    mixed = rng.random() < 0.3
    first = _sensor(rng)
    cameras = []
    for i in range(n):
        sensor = _sensor(rng) if mixed else first
        kind = _kind(sensor, float(np.linalg.norm(places[i])), radius, lenses, rng)
        up = np.array([0.0, 0, 1]) if abs(direction[i, 2]) < 0.95 else np.array([0.0, 1, 0])
        roll = exp_rotation(np.array([0, 0, np.pi / 2 * (rng.integers(4) if rng.random() < 0.2 else 0)]))
        rotation = exp_rotation(rng.normal(0, 0.01, 3)) @ roll @ look_at(places[i], aims[i], up)
        intrinsics = _intrinsics(kind, lenses, rng)
        cameras.append(TrueCamera(f"C{i + 1:02d}", kind, intrinsics, rotation, -rotation @ places[i]))
    reach = half + 0.6 * radius
    return RandomRig(
        arrangement,
        tuple(cameras),
        np.full(n, lenses == "wide"),
        radius,
        np.array([-reach, reach]),
        np.array([-half, half]),
    )


def _sensor(rng: np.random.Generator) -> tuple[int, int, float]:
    return _SENSORS[int(rng.integers(len(_SENSORS)))]


def _directions(arrangement: Arrangement, n: int, rng: np.random.Generator) -> FloatArray:
    """Unit vectors (n, 3) from the volume to the cameras."""
    i = np.arange(n)
    if arrangement == "top":
        columns = (n + 1) // 2
        x = np.linspace(-0.6, 0.6, columns)[i // 2]
        d = np.column_stack([x, np.where(i % 2, 0.45, -0.45), np.ones(n)])
    elif arrangement == "ring":
        azimuth, height = 2 * np.pi * i / n, np.deg2rad(rng.uniform(10, 45) + 12 * (i % 2))
        d = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.tan(height)])
    elif arrangement == "dome":
        z, azimuth = 0.15 + 0.8 * (i + 0.5) / n, i * np.pi * (3 - np.sqrt(5))
        d = np.column_stack([np.sqrt(1 - z * z) * np.cos(azimuth), np.sqrt(1 - z * z) * np.sin(azimuth), z])
    elif arrangement == "walls":
        x = np.linspace(-0.7, 0.7, (n + 3) // 4)[i // 4]
        d = np.column_stack([x, np.where(i % 2, 1.0, -1.0), np.where(i // 2 % 2, 0.5, -0.1)])
    elif arrangement == "fan":
        azimuth, height = np.deg2rad(np.linspace(-45, 45, n)), np.deg2rad(20 + 25.0 * (i % 2))
        d = np.column_stack([np.sin(azimuth) * np.cos(height), np.cos(azimuth) * np.cos(height), np.sin(height)])
    else:
        d = rng.normal(size=(n, 3))
        d[:, 2] = np.abs(d[:, 2]) + 0.1
    d = d + rng.normal(0, 0.05, d.shape)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def _kind(
    sensor: tuple[int, int, float], distance: float, radius: float, lenses: str, rng: np.random.Generator
) -> CameraKind:
    """The lens on the market that shows the ball about as large as wanted."""
    width, height, pitch = sensor
    if lenses == "wide":  # equidistant: 50 degrees at the corner
        focal = np.hypot(width, height) / 2 * pitch / 1e3 / np.deg2rad(50.0)
        return CameraKind(f"{width} x {height}", (width, height), pitch, round(float(focal), 2))
    wanted = rng.uniform(0.25, 0.5) * height * pitch / 1e3 * distance / (2 * radius)
    focal = min(_LENSES_MM, key=lambda f: abs(np.log(f / wanted)))
    # the ball may leave the image, but its middle half must be in it
    return CameraKind(f"{width} x {height}", (width, height), pitch, float(np.clip(focal, 0.6 * wanted, 1.6 * wanted)))


def _intrinsics(kind: CameraKind, lenses: str, rng: np.random.Generator) -> FloatArray:
    """A lens as built, (16,); distortion is that at the corner, whatever the focal length."""
    c = np.zeros(N_INTRINSICS)
    width, height = kind.image_size
    c[0] = kind.focal_length_px * (1 + rng.uniform(-0.02, 0.02))
    c[1] = c[0] * (1 + rng.normal(0, 1e-4))
    c[2:4] = (width - 1) / 2 + rng.normal(0, 0.006 * width), (height - 1) / 2 + rng.normal(0, 0.006 * width)
    if lenses == "wide":
        return c
    corner2 = (np.hypot(width, height) / 2 / c[0]) ** 2
    # r (1 + a r^2 + b r^4) rises everywhere where 9 a^2 < 20 b
    at_corner = rng.uniform(-0.15, -0.10) if lenses == "strong" else rng.normal(-0.02, 0.012)
    c[4] = at_corner / corner2
    c[5] = (0.6 * at_corner**2 if lenses == "strong" else rng.normal(0.003, 0.002)) / corner2**2
    c[6:8] = rng.normal(0, 3e-4, 2) / np.sqrt(corner2) * 0.5
    return c
