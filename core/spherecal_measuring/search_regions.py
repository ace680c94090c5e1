"""Detection around the last places of the targets; the whole image once a second, each camera in its own turn."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from spherecal.base.arrays import FloatArray
from spherecal.targets.detection import Detections, DetectionSettings
from spherecal.targets.masks import Rectangle

FULL_PERIOD_S = 1.0
# Beyond a target's dots: the thresholds look at 36 px around, the paper at a dot's size; half a sticker more for what
# a velocity does not show.
_MARGIN_PX, _MARGIN_OF_SIZE = 40.0, 0.5
_AHEAD = 0.5  # of the way that a target went since the last image: it may turn or stop
_CELL_PX = 32  # of the mask in which regions are joined; whole tiles of the detection, also at half size
# A part costs as much a pixel as the whole, and some 3 ms each besides.
_MOST_OF_IMAGE = 0.6
_FORGOTTEN_S = 0.5  # a target not found for so long is left to the next whole image

Detect = Callable[[NDArray, DetectionSettings], Detections]


@dataclass(frozen=True)
class _Track:
    """A target's dots in an image: box (low, high) px, velocity px/s, and when."""

    low: FloatArray
    high: FloatArray
    velocity: FloatArray
    at_s: float


class RegionSearch:
    """One camera's search for targets; `last_part` is the part of the last image that was searched."""

    def __init__(self, detect: Detect, settings: DetectionSettings, turn: float = 1.0, period_s: float = FULL_PERIOD_S):
        self._detect, self._settings, self._period_s = detect, settings, period_s
        self._turn = turn
        self._last_turn: int | None = None
        self._tracks: dict[int, _Track] = {}
        self.last_part = 1.0  # of the image that was searched

    def find(self, image: NDArray, at_s: float) -> Detections:
        """The targets in an image, in the coordinates of the whole image; `image`: a grey image (h, w)."""
        parts = None if self._is_due(at_s) else self._parts(image.shape, at_s)
        if parts is None:
            found, self.last_part = self._detect(image, self._settings), 1.0
        else:
            found = _joined([self._in_part(image, part) for part in parts])
            area = sum((r.stop - r.start) * (c.stop - c.start) for r, c in parts)
            self.last_part = area / image.size
        self._learn(found, at_s, whole=parts is None)
        return found

    def _is_due(self, at_s: float) -> bool:
        """At the first image, and whenever the camera's turn has come since the last whole one."""
        if self._period_s <= 0:
            return True
        turn = math.floor(at_s / self._period_s - self._turn)
        due, self._last_turn = turn != self._last_turn, turn
        return due

    def _parts(self, shape: tuple[int, ...], at_s: float) -> list[tuple[slice, slice]] | None:
        """Rectangles around the predicted places that do not overlap; None where the whole image is less work."""
        height, width = shape
        cells = np.zeros((-(-height // _CELL_PX), -(-width // _CELL_PX)), dtype=bool)
        for track in self._tracks.values():
            passed = at_s - track.at_s
            way = track.velocity * passed
            margin = _MARGIN_PX + _MARGIN_OF_SIZE * float((track.high - track.low).max()) + _AHEAD * np.abs(way)
            low = np.floor((track.low + way - margin) / _CELL_PX).astype(int).clip(min=0)
            high = np.floor((track.high + way + margin) / _CELL_PX).astype(int) + 1
            cells[low[1] : max(high[1], 0), low[0] : max(high[0], 0)] = True
        boxes = _boxes(cells)
        scale = [slice(r.start * _CELL_PX, min(r.stop * _CELL_PX, height)) for r, _ in boxes]
        parts = [
            (rows, slice(c.start * _CELL_PX, min(c.stop * _CELL_PX, width)))
            for rows, (_, c) in zip(scale, boxes, strict=True)
        ]
        area = sum((r.stop - r.start) * (c.stop - c.start) for r, c in parts)
        return parts if area <= _MOST_OF_IMAGE * height * width else None

    def _in_part(self, image: NDArray, part: tuple[slice, slice]) -> Detections:
        rows, columns = part
        offset = np.array([columns.start, rows.start], dtype=float)
        s = self._settings
        height, width = image.shape
        u, v = s.principal_point_px or ((width - 1) / 2, (height - 1) / 2)
        ignore: tuple[Rectangle, ...] = tuple((x - offset[0], y - offset[1], w, h) for x, y, w, h in s.ignore)
        known = replace(s, principal_point_px=(u - offset[0], v - offset[1]), image_size=None, ignore=ignore)
        found = self._detect(image[part], known)
        return replace(found, uv=found.uv + offset)

    def _learn(self, found: Detections, at_s: float, whole: bool) -> None:
        tracks: dict[int, _Track] = {}
        for target in found.target_ids.tolist():
            uv = found.uv[found.target == target]
            if not len(uv):
                continue
            low, high = uv.min(axis=0), uv.max(axis=0)
            before = self._tracks.get(target)
            velocity = np.zeros(2)
            if before is not None and at_s > before.at_s:
                velocity = ((low + high) - (before.low + before.high)) / 2 / (at_s - before.at_s)
            tracks[target] = _Track(low, high, velocity, at_s)
        if not whole:  # what was hidden for a moment is looked for a little longer
            for target, track in self._tracks.items():
                if target not in tracks and at_s - track.at_s < _FORGOTTEN_S:
                    tracks[target] = track
        self._tracks = tracks


def _boxes(cells: NDArray[np.bool_]) -> list[tuple[slice, slice]]:
    """Rectangles that hold all set cells and do not overlap."""
    while True:
        labels = np.empty(cells.shape, dtype=np.int32)
        count = ndimage.label(cells, np.ones((3, 3)), output=labels)
        boxes = [(rows, columns) for rows, columns in ndimage.find_objects(labels)]
        filled = np.zeros_like(cells)
        for box in boxes:
            filled[box] = True
        if count == 0 or (filled == cells).all():
            return boxes
        cells = filled


def _joined(parts: list[Detections]) -> Detections:
    """The detections of several parts as those of one image, sorted by target."""
    if not parts:
        from spherecal.targets.family import DOTS

        none, whole = np.empty(0), np.empty(0, np.int64)
        return Detections(DOTS, whole, whole, np.empty((0, 2)), np.empty((0, 2)), whole, none, none, none)
    target = np.concatenate([p.target for p in parts])
    order = np.argsort(target, kind="stable")
    ids = np.concatenate([p.target_ids for p in parts])
    by_id = np.argsort(ids, kind="stable")

    def dots(name: str) -> NDArray:
        return np.concatenate([getattr(p, name) for p in parts])[order]

    def targets(name: str) -> NDArray:
        return np.concatenate([getattr(p, name) for p in parts])[by_id]

    return Detections(
        parts[0].points, target[order], dots("point"), dots("uv"), dots("sigma_uv"), ids[by_id], targets("misfit"),
        targets("tilt_deg"), targets("blur_px"),
    )  # fmt: skip
