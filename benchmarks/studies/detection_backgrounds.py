"""Textured and cluttered backgrounds for the ball: drawn by other means than our renderer, and photographs.

A background is an image of exposures (1 = full well) before the sensor, sharp to the pixel and then blurred by a lens
of its own; the ball, rendered with dots or with tags, is laid over it. What they have in common with halls, rigs and
outdoor scenes is detail of every size: most tiles of the image hold contrast.
"""

import importlib.util
import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from spherecal.geometry.camera import project

from .detection_scenes import View

Exposure = NDArray[np.float32]
_LIMB_POINTS = 720


# --- drawn -----------------------------------------------------------------------------------------------------------


def fractal(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """Noise with a spectrum of 1/f^1.2, as plaster, stone and worn floors have."""
    return _stretched(_power_noise(size, 1.2, rng), 0.03, 0.85)


def bricks(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """A brick wall, turned a little: bricks of unlike albedo, bright mortar, grain."""
    width, height = size
    angle, pitch = rng.uniform(-0.2, 0.2), rng.uniform(28, 60)
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    course = np.floor(v / pitch).astype(int)
    along = u / (2.4 * pitch) + 0.5 * (course % 2)
    shade = rng.uniform(0.08, 0.5, 1 << 16).astype(np.float32)
    image = shade[(course * 7919 + np.floor(along).astype(int) * 104729) & 0xFFFF]
    joint = 0.09 * pitch
    mortar = (v % pitch < joint) | ((along % 1) * 2.4 * pitch < joint)
    image[mortar] = 0.62
    return _with_grain(image, 0.25, rng)


def foliage(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """Dead leaves: ellipses of all sizes (density 1 / radius^3) that cover each other, as in natural images."""
    width, height = size
    image = np.full((height, width), 0.2, np.float32)
    count = width * height // 150
    radius = 2.0 / np.sqrt(rng.uniform((2.0 / 80) ** 2, 1.0, count))
    for r in radius:
        middle = (int(16 * rng.uniform(0, width)), int(16 * rng.uniform(0, height)))
        axes = (int(16 * r), int(16 * r * rng.uniform(0.3, 1.0)))
        cv2.ellipse(image, middle, axes, rng.uniform(0, 180), 0, 360, float(rng.uniform(0.02, 0.85)), -1, 8, 4)
    return _with_grain(image, 0.1, rng)


def speckle(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """White specks of the dots' sizes and forms, dense and at random, on a dark or uneven ground."""
    width, height = size
    ground = 0.03 + rng.uniform(0, 0.12) * _stretched(_power_noise(size, 1.6, rng), 0.0, 1.0)
    image = ground.astype(np.float32)
    spacing = rng.uniform(13, 22)
    low, high = rng.uniform(1.2, 2.2), rng.uniform(3.0, 5.5)
    for _ in range(int(width * height / spacing**2)):
        middle = (int(16 * rng.uniform(0, width)), int(16 * rng.uniform(0, height)))
        r = rng.uniform(low, high)
        axes = (int(16 * r), int(16 * r * rng.uniform(0.45, 1.0)))
        cv2.ellipse(image, middle, axes, rng.uniform(0, 180), 0, 360, float(rng.uniform(0.3, 0.8)), -1, 8, 4)
    return image


def text(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """Posters and labels full of print, white on black and black on white, of all sizes and directions."""
    width, height = size
    image = np.full((height, width), 0.25, np.float32)
    letters = np.array(list("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.:-%&/()oO"))
    for _ in range(max(width * height // 40_000, 4)):
        w, h = (int(rng.uniform(150, 500)), int(rng.uniform(100, 400)))
        white = bool(rng.random() < 0.5)
        paper, ink = (190, 10) if white else (12, 190)
        pixels = np.full((h, w), paper, np.uint8)
        scale = rng.uniform(0.3, 1.4)
        step = int(30 * scale) + 3
        for line in range(step, h, step):
            words = "".join(rng.choice(letters, 60))
            cv2.putText(pixels, words, (6, line), int(rng.integers(0, 8)), scale, ink, max(int(2 * scale), 1), 16)
        poster = pixels.astype(np.float32) / np.float32(255)
        turn = cv2.getRotationMatrix2D((w / 2, h / 2), rng.uniform(-40, 40), 1.0)
        turn[:, 2] += rng.uniform([-w / 2, -h / 2], [width - w / 2, height - h / 2])
        cv2.warpAffine(poster, turn, (width, height), image, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
    return _with_grain(image, 0.05, rng)


def cables(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """Cables and pipes across each other before a plain wall, each with its highlight."""
    width, height = size
    image = np.full((height, width), 0.12, np.float32)
    for _ in range(60 + width * height // 30_000):
        points = np.cumsum(np.vstack([rng.uniform(-50, [width, height]), rng.normal(0, 90, (14, 2))]), axis=0)
        t = np.linspace(0, len(points) - 1, 160)
        curve = np.stack([np.interp(t, np.arange(len(points)), points[:, k]) for k in (0, 1)], axis=1)
        curve = cv2.GaussianBlur(curve, (1, 31), 8)
        thick, shade = int(rng.integers(2, 16)), float(rng.uniform(0.02, 0.5))
        line = [np.rint(16 * curve).astype(np.int32)]
        cv2.polylines(image, line, False, shade, thick, 16, 4)
        cv2.polylines(image, line, False, min(shade + 0.3, 0.9), max(thick // 4, 1), 16, 4)
    return _with_grain(image, 0.05, rng)


def gratings(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """Perforated sheets, gratings and lamps: regular patterns of round and oblong holes, light on dark or the other."""
    width, height = size
    image = np.full((height, width), 0.1, np.float32)
    for _ in range(10):
        pitch, angle, part = rng.uniform(7, 40), rng.uniform(0, np.pi), rng.uniform(0.2, 0.4)
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        u, v = (np.cos(angle) * x + np.sin(angle) * y) / pitch, (np.cos(angle) * y - np.sin(angle) * x) / pitch
        v = v * rng.uniform(0.5, 1.0)
        rim = np.hypot(u - np.rint(u), v - np.rint(v)) - part
        holes = np.clip(0.5 - rim * pitch, 0, 1)
        front, back = (0.05, 0.7) if rng.random() < 0.5 else (0.5, 0.03)
        panel = np.zeros((height, width), np.uint8)
        corners = rng.uniform(0, 1, (4, 2)) * [width, height]
        cv2.fillConvexPoly(panel, cv2.convexHull(corners.astype(np.int32)), 1)
        image = np.where(panel > 0, front + (back - front) * holes, image).astype(np.float32)
    return _with_grain(image, 0.08, rng)


def metal(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """Brushed and machined metal: streaks along a direction and blinding glints."""
    width, height = size
    grain = rng.standard_normal((height, width)).astype(np.float32)
    grain = np.asarray(cv2.GaussianBlur(grain, (61, 1), 15), np.float32)
    image = _stretched(grain, 0.05, 0.6) * _stretched(_power_noise(size, 2.0, rng), 0.3, 1.4)
    for _ in range(width * height // 3000):
        middle = (int(16 * rng.uniform(0, width)), int(16 * rng.uniform(0, height)))
        axes = (int(16 * rng.uniform(1, 14)), int(16 * rng.uniform(0.6, 3)))
        cv2.ellipse(image, middle, axes, rng.normal(0, 8), 0, 360, float(rng.uniform(0.6, 1.6)), -1, 16, 4)
    return image.astype(np.float32)


def hall(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """Pieces of all of the drawn ones side by side, as in a workshop."""
    width, height = size
    image = np.full((height, width), 0.12, np.float32)
    plain = (bricks, foliage, fractal, text, cables, gratings, metal, speckle)
    for k in range(12):
        w, h = int(width * rng.uniform(0.25, 0.6)), int(height * rng.uniform(0.25, 0.6))
        x, y = int(rng.uniform(-0.2, 0.8) * width), int(rng.uniform(-0.2, 0.8) * height)
        x, y, w, h = max(x, 0), max(y, 0), min(w, width - max(x, 0)), min(h, height - max(y, 0))
        image[y : y + h, x : x + w] = rng.uniform(0.5, 1.1) * plain[k % len(plain)]((w, h), rng)
    return image


Background = Callable[[tuple[int, int], np.random.Generator], Exposure]
DRAWN: dict[str, Background] = {
    make.__name__: make for make in (fractal, bricks, foliage, speckle, text, cables, gratings, metal, hall)
}


# --- photographed ----------------------------------------------------------------------------------------------------


def photograph(size: tuple[int, int], rng: np.random.Generator) -> Exposure:
    """A photograph at hand, tiled by its mirror images: the dot board of SPHERECAL_DATA or a package's sample."""
    paths = _photographs()
    pixels = cv2.imread(str(paths[int(rng.integers(len(paths)))]), cv2.IMREAD_GRAYSCALE)
    assert pixels is not None
    pixels = np.hstack([pixels, pixels[:, ::-1]])
    pixels = np.vstack([pixels, pixels[::-1]])
    width, height = size
    times = -(-height // pixels.shape[0]), -(-width // pixels.shape[1])
    tiled = np.tile(pixels, times)[:height, :width].astype(np.float32)
    return np.asarray(0.01 + 0.85 * (tiled / 255.0) ** 1.6, np.float32)


def _photographs() -> list[Path]:
    found: list[Path] = []
    if data := os.environ.get("SPHERECAL_DATA"):
        found += sorted((Path(data) / "dotboard").glob("*.jpeg"))
    for package, name in (
        ("matplotlib", "mpl-data/sample_data/grace_hopper.jpg"),
        ("pyvista", "examples/2k_earth_daymap.jpg"),
    ):
        spec = importlib.util.find_spec(package)
        if spec is not None and spec.origin is not None and (Path(spec.origin).parent / name).exists():
            found.append(Path(spec.origin).parent / name)
    return found


def has_photographs() -> bool:
    """Whether any photograph is at hand."""
    return bool(_photographs())


# --- lens, and the ball before it ------------------------------------------------------------------------------------


def blurred(image: Exposure, lens: int) -> Exposure:
    """The image through one of four lenses: Gaussian, defocused disc, coma, Gaussian with a wide halo."""
    x, y = np.meshgrid(np.arange(-8, 9, dtype=np.float32), np.arange(-8, 9, dtype=np.float32))
    r = np.hypot(x, y)
    core = np.exp(-(r**2) / (2 * 0.7**2))
    if lens % 4 == 1:
        core = np.clip(1.7 - r, 0.0, 1.0)
    elif lens % 4 == 2:
        core = core + 0.12 * np.exp(-((x - 1.3) ** 2 + (y - 0.6) ** 2) / (2 * 1.2**2))
    elif lens % 4 == 3:
        core = core + 0.012 * np.exp(-r / 3.0)
    return np.asarray(cv2.filter2D(image, -1, core / core.sum(), borderType=cv2.BORDER_REFLECT), np.float32)


def laid_over(ball: Exposure, background: Exposure, view: View) -> Exposure:
    """The exposure of a rendered ball over a background; its rim is soft by the lens's blur."""
    mask = _silhouette(view)
    return np.asarray(mask * ball + (1 - mask) * background, np.float32)


def _silhouette(view: View) -> Exposure:
    """How much of each pixel the ball covers."""
    station, radius = view.station, view.truth.ball.radius_mm
    to_camera = station.centre_mm - view.truth.ball_places_mm[view.placement]
    distance = float(np.linalg.norm(to_camera))
    axis = to_camera / distance
    first = np.cross(axis, [0.3, 0.5, 0.8])
    first /= np.linalg.norm(first)
    angle = np.linspace(0, 2 * np.pi, _LIMB_POINTS, endpoint=False)[:, None]
    around = np.cos(angle) * first + np.sin(angle) * np.cross(axis, first)
    middle = view.truth.ball_places_mm[view.placement] + radius**2 / distance * axis
    limb = middle + radius * np.sqrt(1 - (radius / distance) ** 2) * around
    uv = project(limb @ station.rotation.T + station.translation_mm, station.intrinsics)
    width, height = station.size
    mask = np.zeros((height, width), np.float32)
    cv2.fillPoly(mask, [np.rint(16 * uv).astype(np.int32)], 1.0, 16, 4)
    return np.asarray(cv2.GaussianBlur(mask, (0, 0), 0.8), np.float32)


# --- helpers ---------------------------------------------------------------------------------------------------------


def _power_noise(size: tuple[int, int], exponent: float, rng: np.random.Generator) -> Exposure:
    width, height = size
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None, :])
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((height, width))) / frequency**exponent
    return np.asarray(np.fft.irfft2(spectrum, s=(height, width)), np.float32)


def _stretched(image: Exposure, low: float, high: float) -> Exposure:
    """The image with its 1st and 99th percentiles at `low` and `high`."""
    a, b = np.percentile(image, [1, 99])
    return np.clip(low + (high - low) * (image - a) / (b - a), 0.0, 1.3).astype(np.float32)


def _with_grain(image: Exposure, strength: float, rng: np.random.Generator) -> Exposure:
    """The image times 1/f noise: fine texture on every surface."""
    grain = _power_noise(image.shape[::-1], 0.8, rng)
    return np.clip(image * (1 + strength * grain / grain.std()), 0.005, 1.3).astype(np.float32)
