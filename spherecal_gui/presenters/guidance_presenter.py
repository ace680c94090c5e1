"""Where to put the ball next and what stopping now would give: the engine's advice, seen from above, in words."""

from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QCoreApplication

from spherecal_gui.coverage import Level
from spherecal_gui.placement_view import NOT_YET_MM, WORTH, GuidanceView

if TYPE_CHECKING:  # imports scipy
    from spherecal_gui.tasks.ghost import ToGo

translate = QCoreApplication.translate


def move_text(shown: GuidanceView) -> str:
    """Where to put the ball and how to turn it."""
    if shown.same_place:
        place = translate("Guidance", "Leave the ball where it is")
    else:
        up = round(shown.up_mm, -1)
        text = translate("Guidance", "Move the ball {away:.0f} mm towards {camera}")
        if up >= 20:
            text = translate("Guidance", "Move the ball {away:.0f} mm towards {camera} and {up:.0f} mm up")
        elif up <= -20:
            text = translate("Guidance", "Move the ball {away:.0f} mm towards {camera} and {up:.0f} mm down")
        place = text.format(away=round(shown.away_mm, -1), camera=shown.towards, up=abs(up))
    if not shown.turn_deg:
        return place + "."
    if shown.tip is not None:
        turn = translate("Guidance", "tip its top {turn:.0f}° towards {camera}").format(
            turn=shown.turn_deg, camera=shown.tip_towards
        )
    elif shown.turn_deg > 0:
        turn = translate("Guidance", "turn it {turn:.0f}° to the left, as on a turntable").format(turn=shown.turn_deg)
    else:
        turn = translate("Guidance", "turn it {turn:.0f}° to the right, as on a turntable").format(turn=-shown.turn_deg)
    return translate("Guidance", "{place}, {turn}.").format(place=place, turn=turn)


def is_enough(shown: GuidanceView, planned_taken: bool) -> bool:
    """Whether all that was planned is taken and one more placement would not be worth it."""
    if not planned_taken or shown.coarse or shown.now_mm is None or shown.next_mm is None:
        return False
    return shown.next_mm > (1 - WORTH) * shown.now_mm


def advice_text(shown: GuidanceView, planned_taken: bool) -> str:
    """Where to put the ball next; "Enough" where all that was planned is taken and no move is worth a tenth."""
    if is_enough(shown, planned_taken):
        return translate("Guidance", "Enough.")
    if not planned_taken and is_enough(shown, True):
        return translate("Guidance", "Any place where the cameras see it well, turned, will do.")
    return move_text(shown)


def to_go_text(to_go: "ToGo") -> tuple[str, Level]:
    """How far the ball still is from where it should go (tasks.ghost.ToGo)."""
    if to_go.near:
        return translate("Guidance", "In place"), "good"
    away = round(to_go.away_mm, -1)
    if to_go.turn_deg is None:
        return translate("Guidance", "{away:.0f} mm to go").format(away=away), "caution"
    text = translate("Guidance", "{away:.0f} mm and {turn:.0f}° to go")
    return text.format(away=away, turn=to_go.turn_deg), "caution"


def now_text(shown: GuidanceView) -> tuple[str, Level]:
    """What stopping now would give."""
    if shown.coarse:
        return translate("Guidance", "If you stop now: being worked out"), "none"
    if shown.now_mm is None or not np.isfinite(shown.now_mm) or shown.now_mm > NOT_YET_MM:
        return translate("Guidance", "If you stop now: not determined yet"), "bad"
    text = translate("Guidance", "If you stop now: {mm:.3f} mm").format(mm=shown.now_mm)
    gain = shown.next_mm is not None and shown.next_mm < (1 - WORTH) * shown.now_mm
    return text, "caution" if gain else "good"


def next_text(shown: GuidanceView, planned_taken: bool = False) -> str:
    """What the next placement would give, or one more than was planned."""
    if shown.next_mm is None or not np.isfinite(shown.next_mm):
        return ""
    text = translate("Guidance", "With this placement: {mm:.3f} mm")
    if planned_taken:
        text = translate("Guidance", "With one more placement: {mm:.3f} mm")
    return text.format(mm=shown.next_mm)
