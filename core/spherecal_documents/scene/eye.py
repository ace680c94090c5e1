"""From where a scene is looked at: turned about the height axis and lifted, a parallel projection."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.base.arrays import FloatArray

# Turn about the height axis and lift above the ground, degrees.
SIDES = {
    "oblique": (-55.0, 28.0), "top": (-90.0, 90.0), "bottom": (-90.0, -90.0), "front": (-90.0, 0.0),
    "back": (90.0, 0.0), "side": (0.0, 0.0), "left": (180.0, 0.0),
}  # fmt: skip
_LEAST_ZOOM, _MOST_ZOOM = 0.2, 40.0


@dataclass(frozen=True, eq=False)
class Eye:
    """A parallel projection onto width x height px: the place (3,) in its middle, its axes (3,), px for a mm."""

    middle: FloatArray
    right: FloatArray
    up: FloatArray
    scale: float
    width: int
    height: int

    def flat(self, places: FloatArray) -> FloatArray:
        """Places (n, 3) on the picture, (n, 2) px from its top left corner."""
        own = (np.asarray(places, dtype=float) - self.middle) @ np.stack([self.right, self.up]).T * self.scale
        return np.array([self.width / 2, self.height / 2]) + own * np.array([1.0, -1.0])

    @property
    def towards(self) -> FloatArray:
        """The direction from the scene to the eye, (3,), a unit vector."""
        return np.cross(self.right, self.up)


@dataclass(frozen=True, eq=False)
class View:
    """How a scene was turned, moved and enlarged; `middle` (3,) mm is in the middle of the picture."""

    middle: FloatArray
    turn_deg: float
    lift_deg: float
    zoom: float = 1.0
    fitted: float = 1.0  # px for a mm at zoom 1

    def axes(self) -> tuple[FloatArray, FloatArray]:
        """Right and up in the picture, (3,) each."""
        turn, lift = np.deg2rad([self.turn_deg, self.lift_deg])
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        towards = np.array([np.cos(turn) * np.cos(lift), np.sin(turn) * np.cos(lift), np.sin(lift)])
        return right, np.cross(towards, right)

    def eye(self, width: int, height: int) -> Eye:
        """The projection onto a picture of this size, at least 16 x 16 px."""
        return Eye(self.middle, *self.axes(), self.zoom * self.fitted, max(width, 16), max(height, 16))

    def turned(self, turn_deg: float, lift_deg: float) -> "View":
        """The view after a turn, never past the poles."""
        lift = float(np.clip(self.lift_deg + lift_deg, -90, 90))
        return replace(self, turn_deg=self.turn_deg + turn_deg, lift_deg=lift)

    def moved(self, right_px: float, down_px: float) -> "View":
        """The view after the scene was moved by hand."""
        right, up = self.axes()
        scale = self.zoom * self.fitted
        return replace(self, middle=self.middle - (right_px * right - down_px * up) / scale)

    def closer(self, factor: float, right_px: float = 0.0, down_px: float = 0.0) -> "View":
        """The view closer by a factor, within the limits of the zoom; one place of the picture stays where it is."""
        zoom = float(np.clip(self.zoom * factor, _LEAST_ZOOM, _MOST_ZOOM))
        there = replace(self.moved(-right_px, -down_px), zoom=zoom)
        return there.moved(right_px, down_px)


def fitting_view(places: FloatArray, side: str, width: float, height: float) -> View:
    """The view from a side that shows all places (n, 3) mm in a picture of `width` x `height` px."""
    turn, lift = SIDES[side]
    view = View(np.zeros(3), turn, lift)
    right, up = view.axes()
    flat = places @ np.stack([right, up]).T
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = np.maximum(high - low, 1e-9)
    a, b = ((low + high) / 2).tolist()
    depth = np.cross(right, up)
    middle = a * right + b * up + float(np.median(places @ depth)) * depth
    return replace(view, middle=middle, fitted=float(min(width / size[0], height / size[1])))
