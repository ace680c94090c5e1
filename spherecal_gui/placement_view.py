"""The next placement as the window shows it: where the ball lies and is to lie, seen from above; no words."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal_documents.scene.model import SceneData

if TYPE_CHECKING:  # imports scipy
    from spherecal.data.rig import PlacedSphere, Rig
    from spherecal_gui.tasks.ghost import Ghost
    from spherecal_rigs.next_placement import Candidate
    from spherecal_rigs.next_placement import Guidance as Advised

# An axis this steep is upright: the ball is turned on its stand, else it is tipped.
_UPRIGHT = 0.7
# Nobody puts a ball nearer to where it should be by hand than this part of its radius.
_SAME_PLACE = 0.3
# More than this says no more than "not determined yet" (the demo with one placement: 25 mm, with two 0.18 mm).
NOT_YET_MM = 5.0
# A camera of which less than this part of the view is level looks down: from above it has no direction.
_DOWNWARDS = 0.15
# A placement that makes lengths better by less than this part is not worth a walk to the ball.
WORTH = 0.1


@dataclass(frozen=True, eq=False)
class GuidanceView:
    """One piece of advice, seen from above: places in mm in one plane.

    `now_mm` and `next_mm`: what a length of 500 mm is measured to (k = 2) when stopping now and after the next
    placement (None: not known). `coarse`: a first answer; the lengths are still being worked out.

    `names` of `cameras` (c, 2) and their unit directions of view `views` (c, 2); `taken_names` of `taken` (t, 2), where
    the ball was. `place` (2,) is where to put it, `away_mm` from the last place towards camera `towards` and `up_mm`
    higher. `up` (3,) is upright in the rig's frame.

    `turn_deg` is about the upright axis, counter-clockwise seen from above. Where `tip` (2,) is there, the ball's top
    goes that way instead, towards camera `tip_towards`.

    `ghost` is the ball there as the cameras would see it, `scene` the whole in space.
    """

    now_mm: float | None
    next_mm: float | None
    names: tuple[str, ...]
    cameras: FloatArray
    taken_names: tuple[str, ...]
    taken: FloatArray
    place: FloatArray
    radius_mm: float
    towards: str
    away_mm: float
    up_mm: float
    turn_deg: float = 0.0
    tip: FloatArray | None = None
    tip_towards: str = ""
    up: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    views: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    ghost: "Ghost | None" = None
    scene: SceneData | None = None
    coarse: bool = False

    @property
    def same_place(self) -> bool:
        """Whether the ball may stay where it is."""
        return bool(np.hypot(self.away_mm, self.up_mm) < _SAME_PLACE * self.radius_mm)


def guidance_of(found: "Advised", rig: "Rig", spheres: "Sequence[PlacedSphere]") -> GuidanceView | None:
    """The engine's answer as the window shows it; None where nothing helps."""
    from spherecal_documents.report.rig_view import TOP, choose_axes  # imports scipy

    best = found.best
    if best is None or not spheres:
        return None
    taken = np.array([sphere.centre_mm for sphere in spheres])
    centres = np.array([camera.centre_mm for camera in rig.cameras])
    axes = choose_axes(rig.cameras, centres, taken)[0]
    middle = taken.mean(axis=0)

    def above(places: FloatArray) -> FloatArray:
        return TOP.flat((places - middle) @ axes.T)

    names = tuple(camera.id for camera in rig.cameras)
    flat, place, last = above(centres), above(best.centre_mm), taken[-1]
    moved = axes @ (best.centre_mm - last)
    away = float(np.hypot(moved[0], moved[1]))
    towards = _camera_towards(names, flat, above(last), moved[:2]) if away > 0 else best.nearest
    turn, tip, tip_towards = _turn(best, axes)
    if tip is not None:
        tip_towards = _camera_towards(names, flat, place, tip)
    return GuidanceView(
        found.now_mm,
        best.expanded_mm,
        names,
        flat,
        tuple(sphere.placement for sphere in spheres),
        above(taken),
        place,
        spheres[-1].radius_mm,
        towards,
        away,
        float(moved[2]),
        turn,
        tip,
        tip_towards,
        axes[2],
        _views_above(rig, axes),
    )


def _views_above(rig: "Rig", axes: FloatArray) -> FloatArray:
    """The cameras' directions of view from above, unit vectors (c, 2); (0, 0) for one that looks straight down."""
    from spherecal_documents.report.rig_view import TOP  # imports scipy

    views = TOP.flat(np.array([camera.rotation[2] for camera in rig.cameras]) @ axes.T)
    long = np.linalg.norm(views, axis=1, keepdims=True)
    return np.where(long > _DOWNWARDS, views / np.maximum(long, 1e-9), 0.0)


def _camera_towards(names: tuple[str, ...], cameras: FloatArray, start: FloatArray, way: FloatArray) -> str:
    """The camera that lies best in a direction."""
    to = cameras - start
    along = to @ way / np.maximum(np.linalg.norm(to, axis=1) * float(np.linalg.norm(way)), 1e-9)
    return names[int(np.argmax(along))]


def _turn(best: "Candidate", axes: FloatArray) -> tuple[float, FloatArray | None, str]:
    """The turn about the upright axis, or which way the top goes."""
    if best.axis is None:
        return 0.0, None, ""
    axis = axes @ best.axis
    if abs(axis[2]) >= _UPRIGHT:
        return float(np.sign(axis[2]) * best.turn_deg), None, ""
    top = np.cross(axis, (0.0, 0.0, 1.0))[:2]  # where the top of a ball that turns about this axis goes
    return float(best.turn_deg), top / np.linalg.norm(top), ""
