"""Detected dots followed into later images by OpenCV's optical flow, for a live overlay; it finds no target anew."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.targets.blobs import GreyImage
from spherecal.targets.detection import Detections
from spherecal.targets.masks import Rectangle, masked

# In the image of half the size. On rendered images of rig A, moved by 40 px and 2 degrees, 98 % of the dots are then
# within 1 px, by 80 px 93 %. Windows of 15 px take twice the time, with 9 px and two levels half are lost at 40 px.
# Most dots need only two; the coarse ones mix them with a hand beside them.
_WINDOW, _LEVELS, _STEPS = 11, (1, 4), (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.01)
# Mean difference of the grey values around a dot from those of the detected image, over their standard deviation there.
# Of other scenes and blank images no target is then kept; of the ball moved by 12 px 98 % of the dots, in a sixth of
# the light 80 %. With one grey value more 3 % of those are of wrong targets.
_MOST_UNLIKE = 0.5
# How far a dot may go astray of its target's others, over the target's radius: 0.12 are 7 degrees from image to image.
# The dot beside it is at 0.3.
_MOST_OFF = 0.12
_MOVED = 1.0  # px of the smaller image; at rest all is compared with the detected image, so that nothing drifts
_LEAST_OF_TARGET = 0.6  # of its dots
_LEAST_TARGETS = 0.5  # with fewer, another scene is more likely than a hand before the ball


class Follower:
    """The dots of a camera, from the image (h, w) of some bits on in which they were detected."""

    def __init__(self, image: GreyImage, bits: int, found: Detections) -> None:
        self._found, self._image = found, _half(image, bits)
        self._start = self._at = self._before = ((found.uv + 0.5) / 2 - 0.5).astype(np.float32)
        self._row = np.searchsorted(found.target_ids, found.target)
        places = self._by_target(self._start)
        spread = np.linalg.norm(places - np.nanmean(places, axis=1, keepdims=True), axis=2)
        self._radius = np.nanmax(spread, axis=1, initial=0.0)
        self._contrast = _contrast(self._image, self._start)

    def follow(self, image: GreyImage, bits: int, ignore: tuple[Rectangle, ...] = ()) -> Detections | None:
        """The dots in a later image (h, w), as far as they are to be seen; None where too few are."""
        found, now = self._found, _half(image, bits)
        if now.shape != self._image.shape or not len(found):
            return None
        guess = (2 * self._at - self._before).astype(np.float32)
        at, kept, all_dots = guess.copy(), np.zeros(len(found), dtype=bool), np.bincount(self._row)
        usual, whole = np.zeros((0, 1, 2)), np.zeros(0, dtype=bool)
        for levels in _LEVELS:
            left = np.flatnonzero(~kept)
            if not len(left):
                break
            at[left], seen, unlike = cv2.calcOpticalFlowPyrLK(
                self._image, now, self._start[left], guess[left], None, None, (_WINDOW, _WINDOW), levels, _STEPS,
                cv2.OPTFLOW_USE_INITIAL_FLOW,
            )  # fmt: skip
            kept[left] = (seen[:, 0] == 1) & (unlike[:, 0] <= _MOST_UNLIKE * self._contrast[left])
            moves = self._by_target(at - self._start)
            usual = np.nanmedian(moves, axis=1, keepdims=True)
            kept &= np.linalg.norm(moves - usual, axis=2)[self._row, found.point] <= _MOST_OFF * self._radius[self._row]
            whole = np.bincount(self._row[kept], minlength=len(all_dots)) >= _LEAST_OF_TARGET * all_dots
            kept &= whole[self._row]
        if whole.sum() < _LEAST_TARGETS * len(whole):
            self._at = self._before = self._start
            return None
        usual[~whole] = np.median(usual[whole], axis=0)  # by what is in its place it would wander off, frame by frame
        at[~kept] = (self._start + usual[self._row, 0])[~kept]  # to be looked for beside the target's others
        self._before, self._at = self._at, at
        if np.median(np.linalg.norm(at - self._start, axis=1)) > _MOVED:  # a ball that turns soon looks unlike
            self._image, self._start = now, at
            self._contrast = np.where(kept, self._contrast, 0.0)  # where the others are was guessed: 2 px off, and more
        uv = (at.astype(float) + 0.5) * 2 - 0.5
        kept &= ~masked(uv, ignore)
        return replace(
            found,
            **{name: getattr(found, name)[kept] for name in ("target", "point", "sigma_uv")},
            **{name: getattr(found, name)[whole] for name in ("target_ids", "misfit", "tilt_deg", "blur_px")},
            uv=uv[kept],
        )

    def _by_target(self, values: NDArray[np.float32]) -> FloatArray:
        """Values of the dots (m, 2) as a table (n, points, 2), NaN where a target lacks a dot."""
        table = np.full((len(self._found.target_ids), len(self._found.points), 2), np.nan)
        table[self._row, self._found.point] = values
        return table


def _half(image: GreyImage, bits: int) -> NDArray[np.uint8]:
    """The image in half the size, in 8 bits; a Bayer mosaic becomes grey by it."""
    small = np.asarray(cv2.resize(image, (image.shape[1] // 2, image.shape[0] // 2), interpolation=cv2.INTER_AREA))
    return (small if small.dtype == np.uint8 else small // 2 ** max(bits - 8, 0)).astype(np.uint8, copy=False)


def _contrast(image: NDArray[np.uint8], at: NDArray[np.float32]) -> FloatArray:
    """The standard deviation of the grey values in the window around each of some places (m, 2)."""
    reach = np.arange(_WINDOW) - _WINDOW // 2
    rows, columns = (np.rint(at[:, axis, None]).astype(int) + reach for axis in (1, 0))
    rows, columns = rows.clip(0, image.shape[0] - 1), columns.clip(0, image.shape[1] - 1)
    return image[rows[:, :, None], columns[:, None, :]].std(axis=(1, 2))
