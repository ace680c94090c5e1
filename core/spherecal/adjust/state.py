"""The values of all unknowns of an adjustment."""

from dataclasses import dataclass, field, replace

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.geometry.transform import PosedCameras


@dataclass(frozen=True)
class State:
    """The values of all unknowns.

    `rotation, translation`: poses of the cameras, (c,3,3) and (c,3); `intrinsics`: (c,16), see docs/conventions.md;
    `points`: (p,3): of the world in the free form, else of the ball's frame; `placement_rotation,
    placement_translation`: poses (t,3,3) and (t,3) that bring the ball's points to the world; t = 0 in the free form;
    `shape_residual`: how far each feature (dot at a placement) of a deformable ball is off the shape in the world,
    (f,3); else (0,3); `anchored`: points whose frame a stored shape of the ball holds, (p,); else (0,).
    """

    rotation: FloatArray
    translation: FloatArray
    intrinsics: FloatArray
    points: FloatArray
    placement_rotation: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    placement_translation: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    shape_residual: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    anchored: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    @property
    def cameras(self) -> PosedCameras:
        """Lenses and poses of the cameras."""
        return PosedCameras(self.intrinsics, self.rotation, self.translation)

    @property
    def is_anchored(self) -> bool:
        """Whether a stored shape defines the ball's frame."""
        return len(self.anchored) > 0

    def scaled(self, factor: float) -> "State":
        """The same network with all lengths multiplied by `factor`."""
        lengths = ("translation", "points", "placement_translation", "shape_residual")
        return replace(self, **{name: getattr(self, name) * factor for name in lengths})

    def free(self, points: FloatArray) -> "State":
        """The free form: the same cameras and points (f,3) of the world."""
        return State(self.rotation, self.translation, self.intrinsics, points)

    def seen_from(self, camera: int) -> "State":
        """The same network in the frame of a camera: its pose is R = I, t = 0.

        In the rigid form the ball's frame moves along, so a placement that defines the world frame (R = I) still does.
        """
        r, t = self.rotation[camera], self.translation[camera]
        rotation = self.rotation @ r.T
        moved = replace(
            self,
            rotation=rotation,
            translation=self.translation - rotation @ t,
            points=self.points @ r.T + t,
            shape_residual=self.shape_residual @ r.T,
        )
        if self.is_anchored:  # the placements move instead of the shape; the first one is the world itself
            of_ball, translation = r @ self.placement_rotation, self.placement_translation @ r.T + t
            of_ball[0], translation[0] = np.eye(3), 0.0
            points = np.where(self.anchored[:, None], self.points, moved.points)
            return replace(moved, points=points, placement_rotation=of_ball, placement_translation=translation)
        of_ball = r @ self.placement_rotation @ r.T
        return replace(
            moved, placement_rotation=of_ball, placement_translation=self.placement_translation @ r.T + t - of_ball @ t
        )
