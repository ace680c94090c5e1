"""Where to put the ball next, and what stopping now would give: shown when the engine offers it.

`Controller.guide` is the engine's function; while it is None nothing of this appears in the window.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from spherecal.arrays import FloatArray
from spherecal_gui.presenters.coverage import SetDots


@dataclass(frozen=True, eq=False)
class Guidance:
    """One piece of advice, seen from above: places in mm in one plane.

    `sentence` where to put the ball and how to turn it, `forecast` what stopping now would give (empty: not known).
    `cameras` (c, 2) with `names`, `taken` (t, 2) places of the ball so far, `place` (2,) where to put it next,
    `radius_mm` of the ball, `turn_deg` by how much to turn it about the upright axis.
    """

    sentence: str
    forecast: str
    names: Sequence[str]
    cameras: FloatArray
    taken: FloatArray
    place: FloatArray
    radius_mm: float
    turn_deg: float = 0.0


# From the dots of the sets that were taken (by set, by camera) to the next piece of advice; None: none to give.
Guide = Callable[[Mapping[str, SetDots]], Guidance | None]
