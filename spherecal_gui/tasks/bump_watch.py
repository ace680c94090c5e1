"""Tells a camera that was moved from a ball that was: it alone sees all dots shift, and they do not come back."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal_gui.coverage import dot_keys

# Of the median dot. At rest it stays below 0.03 px (simulated rigs, 32 to 420 dots); a camera that warms up drifts by
# some tenths in an hour. A ball that was moved shows in every camera that sees it.
BUMP_PX = 1.0
STILL_PX = 0.25  # the others: a ball that was nudged by what is BUMP_PX for one camera is more than this for another
_LEAST_DOTS = 16  # that two images have in common: half of a bar's
_LEAST_OTHERS = 2  # cameras that must have stayed where they are
_SETTLE_S = 1.0  # images that arrive sooner after a movement may still be older than it
_AGREE = 2  # images in a row that show the shift: one alone may be of a ball in motion


@dataclass
class _Seen:
    """A camera's dots when the scene came to rest, and what has become of them."""

    keys: IntArray
    uv: FloatArray
    at_s: float
    shift_px: float | None = None
    moved_s: float | None = None
    agreeing: int = 0
    bumped: bool = False


class BumpWatch:
    """Fed with every camera's dots, image after image, by one thread; `bumped` may be read by others."""

    def __init__(self) -> None:
        self._seen: dict[str, _Seen] = {}
        self._settled_s: float | None = None  # from then on images are of the new scene; None: from the next one on
        self.bumped: Mapping[str, float] = {}  # px by camera; exchanged whole, so no lock is needed

    def forget_scene(self) -> None:
        """The scene is another: what was seen of it tells nothing more."""
        self._seen, self._settled_s = {}, None

    def forgive(self) -> None:
        """Somebody has seen to the cameras: they count as they stand now."""
        self.forget_scene()
        self.bumped = {}

    def feed(self, camera: str, target: IntArray, point: IntArray, uv: FloatArray, at_s: float) -> None:
        """One image's dots: their targets (n,), points on them (n,), and places `uv` (n, 2) px."""
        keys = dot_keys(target, point)
        if self._settled_s is None:
            self._settled_s = at_s + _SETTLE_S
        if at_s < self._settled_s:
            return
        known = self._seen.get(camera)
        shift = None if known is None else _shift(known, keys, uv)
        if known is None or shift is None:  # the ball has gone, or something else is there now
            self._seen[camera] = _Seen(keys, uv, at_s)
            return
        known.at_s, known.shift_px = at_s, shift
        if shift <= BUMP_PX:
            known.moved_s, known.agreeing = None, 0
            if known.bumped:  # back where it was
                known.bumped = False
                self.bumped = {name: px for name, px in self.bumped.items() if name != camera}
        else:
            known.moved_s = at_s if known.moved_s is None else known.moved_s
            known.agreeing += 1
        self._judge()

    def _judge(self) -> None:
        """One camera alone has moved, or several: then it was the ball."""
        moved = [name for name, one in self._seen.items() if one.moved_s is not None and name not in self.bumped]
        if not moved:
            return
        if len(moved) > 1:
            self.forget_scene()
            return
        camera = self._seen[moved[0]]
        since = camera.moved_s or 0.0
        others = [
            one.at_s > since and one.shift_px <= STILL_PX
            for name, one in self._seen.items()
            if name != moved[0] and name not in self.bumped and one.shift_px is not None
        ]
        if camera.agreeing >= _AGREE and len(others) >= _LEAST_OTHERS and all(others):
            camera.bumped = True
            self.bumped = {**self.bumped, moved[0]: float(camera.shift_px or 0.0)}


def _shift(known: _Seen, keys: IntArray, uv: FloatArray) -> float | None:
    """How far the median dot has gone, px; None where too few dots are the same."""
    _, old, new = np.intersect1d(known.keys, keys, return_indices=True)
    if len(old) < _LEAST_DOTS:
        return None
    return float(np.median(np.linalg.norm(uv[new] - known.uv[old], axis=1)))
