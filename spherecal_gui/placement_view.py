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
    """One piece of advice.

    `now_mm` and `next_mm`: what a length of 500 mm is measured to (k = 2) when stopping now and after the next
    placement (None: not known). `coarse`: a first answer; the lengths are still being worked out. `ghost` is the ball
    where it should go as the cameras would see it, `scene` the whole in space.
    """

    now_mm: float | None
    next_mm: float | None
    ghost: "Ghost | None" = None
    scene: SceneData | None = None
    coarse: bool = False

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras of which it is known where they are."""
        return tuple(camera.id for camera in self.scene.scene.cameras) if self.scene is not None else ()
