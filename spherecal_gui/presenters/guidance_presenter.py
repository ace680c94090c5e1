"""What stopping now and one more placement would give: the engine's advice in words."""

import numpy as np

from spherecal_gui.coverage import Level
from spherecal_gui.languages import translate
from spherecal_gui.placement_view import NOT_YET_MM, WORTH, GuidanceView


def is_enough(shown: GuidanceView, planned_taken: bool) -> bool:
    """Whether all that was planned is taken and one more placement would not be worth it."""
    if not planned_taken or shown.coarse or shown.now_mm is None or shown.next_mm is None:
        return False
    return shown.next_mm > (1 - WORTH) * shown.now_mm


def now_text(shown: GuidanceView) -> tuple[str, Level]:
    """What stopping now would give."""
    if shown.coarse:
        return translate("Guidance", "If you stop now: being worked out"), "none"
    if shown.now_mm is None or not np.isfinite(shown.now_mm) or shown.now_mm > NOT_YET_MM:
        return translate("Guidance", "If you stop now: not determined yet"), "bad"
    text = translate("Guidance", "If you stop now: 500 ± {mm:.3f} mm").format(mm=shown.now_mm)
    if shown.next_mm is None:  # whether that is enough is not known: a placement more may halve it
        return text, "none"
    return text, "caution" if shown.next_mm < (1 - WORTH) * shown.now_mm else "good"


def next_text(shown: GuidanceView, planned_taken: bool = False) -> str:
    """What the next placement would give, or one more than was planned."""
    if shown.next_mm is None or not np.isfinite(shown.next_mm):
        return ""
    text = translate("Guidance", "With this placement: 500 ± {mm:.3f} mm")
    if planned_taken:
        text = translate("Guidance", "With one more placement: 500 ± {mm:.3f} mm")
    return text.format(mm=shown.next_mm)
