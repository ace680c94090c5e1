"""The next placement as the window shows it: what stopping now would give, where the ball is to lie; no words."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from spherecal_documents.scene.model import SceneData

if TYPE_CHECKING:  # imports scipy
    from spherecal_gui.tasks.ghost import Ghost

# More than this says no more than "not determined yet" (the demo with one placement: 25 mm, with two 0.18 mm).
NOT_YET_MM = 5.0
# A placement that makes lengths better by less than this part is not worth a walk to the ball.
WORTH = 0.1


@dataclass(frozen=True, eq=False)
class GuidanceView:
    """One piece of advice; lengths are those of 500 mm (k = 2), None where they are not known."""

    now_mm: float | None  # when stopping now
    next_mm: float | None  # after the next placement
    ghost: "Ghost | None" = None  # the ball where it should go as the cameras would see it
    scene: SceneData | None = None  # the whole in space
    coarse: bool = False  # a first answer: the lengths are still being worked out

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras of which it is known where they are."""
        return tuple(camera.id for camera in self.scene.scene.cameras) if self.scene is not None else ()
