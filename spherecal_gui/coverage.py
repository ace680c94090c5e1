"""What the cameras have seen of the ball: counters against need, image coverage, common dots of pairs; kept on disk."""

import io
import zipfile
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.errors import SpherecalError
from spherecal_files.filesystem import read_below, write_below
from spherecal_gui import limits_in_force as limits

CELLS = 10
# The same two figures as in diagnose/run_checks.py and initialise/view_graph.py (a test compares them), which
# take a second to import: cells of the image that must hold dots, and the common dots below which two cameras are no
# neighbours.
LITTLE_COVERAGE = 0.6
MIN_COMMON = 20
# Common dots below which a link counts as weak: five times the least, so that no single placement carries it.
WEAK_COMMON = 5 * MIN_COMMON

Level = Literal["none", "bad", "caution", "good"]
Need = Literal["enough", "more", "spread"]


def dot_keys(target: IntArray, point: IntArray) -> IntArray:
    """One number for each dot of a target set (n,), by its target's number and the point on it."""
    return np.asarray(target, dtype=np.int64) * 64 + np.asarray(point, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Dots:
    """The dots of one image: `target` (n,), `point` (n,), `uv` (n, 2) px, and the image's size (width, height)."""

    target: IntArray
    point: IntArray
    uv: FloatArray
    image_size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.target)

    @property
    def keys(self) -> IntArray:
        """One number for each dot, (n,)."""
        return dot_keys(self.target, self.point)

    @property
    def targets(self) -> int:
        """How many targets they belong to."""
        return len(np.unique(self.target))

    def of_targets(self, known: Collection[int]) -> "Dots":
        """Those of these targets alone."""
        own = np.isin(self.target, list(known))
        return Dots(self.target[own], self.point[own], self.uv[own], self.image_size)

    def targets_among(self, known: Collection[int]) -> int:
        """How many of these targets they belong to; with none given, how many targets."""
        return len(set(self.target.tolist()) & set(known)) if known else self.targets


SetDots = Mapping[str, Dots]  # by camera

# The median dot of a ball at rest stays within 0.03 px (tasks/live_detection.py); one that was moved by a hand's
# breadth goes 40 px and more on the demo rig (0.5 px/mm). In between, half a pixel is what warming up does in an hour.
SAME_PX = 1.0
_SAME_DOTS = 16  # that two images of one camera have in common


def same_place(before: SetDots, now: SetDots) -> bool:
    """Whether the ball shows the same dots at the same places in most cameras that see it, as if it was never moved."""
    same = other = 0
    for camera, dots in now.items():
        if len(dots) < _SAME_DOTS or camera not in before:
            continue
        old = before[camera]
        _, a, b = np.intersect1d(old.keys, dots.keys, return_indices=True)
        close = len(a) >= _SAME_DOTS and np.median(np.linalg.norm(old.uv[a] - dots.uv[b], axis=1)) <= SAME_PX
        same, other = same + bool(close), other + (not close)
    return same > other


def unmasked(dots: Dots, rectangles: Sequence[tuple[float, float, float, float]]) -> Dots:
    """The dots outside all of these parts of the image. `rectangles`: left, top, width and height of each part, px."""
    if not rectangles:
        return dots
    out = np.zeros(len(dots), dtype=bool)
    for left, top, width, height in rectangles:
        out |= ((dots.uv >= (left, top)) & (dots.uv <= (left + width, top + height))).all(axis=1)
    return Dots(dots.target[~out], dots.point[~out], dots.uv[~out], dots.image_size)


def needed_dots() -> int:
    """The dots that a camera should see at a placement, as the responsible person has set it."""
    return limits.now().needed_dots


def cells(images: Sequence[Dots]) -> IntArray:
    """How many dots of some images of one camera fall into each cell, (CELLS, CELLS), rows from the top."""
    counts = np.zeros((CELLS, CELLS), dtype=np.int64)
    for dots in images:
        if len(dots):
            place = (dots.uv + 0.5) / np.array(dots.image_size) * CELLS
            u, v = np.clip(place, 0, CELLS - 1e-9).astype(int).T
            np.add.at(counts, (v, u), 1)
    return counts


def coverage(images: Sequence[Dots]) -> float:
    """The share of cells that hold dots."""
    return float((cells(images) > 0).mean())


def common_dots(sets: Sequence[SetDots], cameras: Sequence[str]) -> IntArray:
    """The dots that each two cameras see at the same placement, summed, (c, c); the diagonal counts a camera's own."""
    total = np.zeros((len(cameras), len(cameras)), dtype=np.int64)
    for one in sets:
        keys = [one[camera].keys if camera in one else np.empty(0, np.int64) for camera in cameras]
        names, flat = np.unique(np.concatenate(keys) if keys else np.empty(0), return_inverse=True)
        seen = np.zeros((len(cameras), len(names)), dtype=np.int64)
        at = np.repeat(np.arange(len(cameras)), [len(key) for key in keys])
        seen[at, flat.reshape(-1)] = 1
        total += seen @ seen.T
    return total


def islands(common: IntArray) -> list[list[int]]:
    """The groups of cameras that hang together by enough common dots, the largest first."""
    left, groups = set(range(len(common))), []
    while left:
        group, reach = set(), {min(left)}
        while reach:
            one = reach.pop()
            group.add(one)
            reach |= {other for other in left - group if common[one, other] >= MIN_COMMON}
        left -= group
        groups.append(sorted(group))
    return sorted(groups, key=lambda group: (-len(group), group[0]))


@dataclass(frozen=True)
class CameraNeed:
    """What one camera lacks over all placements."""

    camera: str
    need: Need
    level: Level


# A camera alone is calibrated by a board from four placements on (three give f, a fourth checks it).
BOARD_VIEWS = 4


def board_needs(sets: Sequence[SetDots], cameras: Sequence[str]) -> list[CameraNeed]:
    """As `needs`, of a board: it is to be seen at some placements, and by a second camera at one of them."""
    common, found = common_dots(sets, cameras), []
    for index, camera in enumerate(cameras):
        images = [one[camera] for one in sets if camera in one and len(one[camera])]
        linked = len(cameras) < 2 or np.delete(common[index], index).max() > 0
        lacks: Level = "none"
        if len(images) < BOARD_VIEWS or not linked:
            lacks = "caution" if images else "bad"
        found.append(_need(camera, images, lacks))
    return found


def _need(camera: str, images: Sequence[Dots], lacks: Level) -> CameraNeed:
    """What a camera needs that lacks dots as badly as this, or none (`none`): then these may be badly spread."""
    if lacks != "none":
        return CameraNeed(camera, "more", lacks)
    spread = coverage(images) >= LITTLE_COVERAGE
    return CameraNeed(camera, "enough" if spread else "spread", "good" if spread else "caution")


def needs(sets: Sequence[SetDots], cameras: Sequence[str]) -> list[CameraNeed]:
    """What each camera still needs: `more` dots, or the dots it has better `spread` over its image."""
    common = common_dots(sets, cameras)
    found = []
    for index, camera in enumerate(cameras):
        images = [one[camera] for one in sets if camera in one]
        dots = sum(len(image) for image in images)
        others = np.sort(np.delete(common[index], index))
        linked = len(others) < 2 or others[-2] >= MIN_COMMON  # a triple takes two partners
        lacks: Level = "none"
        if dots < needed_dots() * max(len(sets), 1) or not linked:
            lacks = "bad" if not linked or dots < MIN_COMMON * max(len(sets), 1) else "caution"
        found.append(_need(camera, images, lacks))
    return found


# Ten thousand dots in each of a hundred cameras are 36 MB.
_MOST_BYTES = 64 << 20


class DotStore:
    """The dots of each set that was taken, on disk beside the project, so that counters survive a crash."""

    def __init__(self, folder: Path) -> None:
        self._root = folder

    def save(self, set_id: str, taken: str, dots: Mapping[str, Dots]) -> None:
        """Keep the dots of a set; where the disk refuses they are found again in the images."""
        arrays: dict[str, Any] = {"taken": np.array(taken)}  # Any: savez has a keyword that is no array
        for camera, one in dots.items():
            arrays |= {f"{camera}/{key}": getattr(one, key) for key in ("target", "point", "uv")}
            arrays[f"{camera}/size"] = np.array(one.image_size)
        try:
            data = io.BytesIO()
            np.savez(data, **arrays)
            write_below(self._root, f"wizard/{set_id}.npz", data.getvalue())
        except SpherecalError:
            return

    def load(self, set_id: str, taken: str) -> dict[str, Dots] | None:
        """The dots of this taking of a set; None where there are none."""
        try:
            data = read_below(self._root, f"wizard/{set_id}.npz", _MOST_BYTES)
            with zipfile.ZipFile(io.BytesIO(data)) as packed:
                if sum(one.file_size for one in packed.infolist()) > _MOST_BYTES:
                    return None
            with np.load(io.BytesIO(data), allow_pickle=False) as kept:
                if str(kept["taken"]) != taken:
                    return None
                cameras = {key.rsplit("/", 1)[0] for key in kept.files if "/" in key}
                return {camera: _kept(kept, camera) for camera in sorted(cameras)}
        except (SpherecalError, OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
            return None  # not ours, or damaged: the dots are found again in the images


def _kept(kept: Mapping[str, np.ndarray], camera: str) -> Dots:
    width, height = kept[f"{camera}/size"]
    target, point, uv = (kept[f"{camera}/{key}"] for key in ("target", "point", "uv"))
    return Dots(target, point, uv, (int(width), int(height)))
