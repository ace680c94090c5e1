"""A placement while the ball is put into place: who sees enough, is it still, what to do next, what that would give."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import IntArray
from spherecal_gui import languages
from spherecal_gui.coverage import CameraNeed, Level, needed_dots
from spherecal_gui.languages import translate
from spherecal_gui.rig_scenes import NOT_YET_MM, WORTH, GuidanceView

# Somebody who lets go of the ball needs this long to step out of the picture.
HOLD_S = 1.5
_THIRD = 3  # of the ten cells across an image
_NAMED = 4  # cameras in one sentence


@dataclass(frozen=True)
class Scene:
    """What the cameras see now."""

    counts: Mapping[str, int]  # dots by camera name
    still: bool | None  # None: not known
    lost: tuple[str, ...] = ()
    board: bool = False  # which need not be in every camera's sight
    made_up: bool = False  # the other placements have enough of what a camera lacks here

    @property
    def ready(self) -> tuple[str, ...]:
        """The cameras that see enough."""
        least = 1 if self.board else needed_dots()
        return tuple(name for name, count in self.counts.items() if count >= least)

    @property
    def enough(self) -> bool:
        """Whether every camera that works sees enough, or has it elsewhere; of a board, whether any does."""
        if self.board:
            return bool(self.ready)
        if self.made_up:
            return True
        return bool(self.counts) and len(self.ready) + len(self.lost) >= len(self.counts)

    @property
    def short(self) -> dict[str, int]:
        """The cameras that work and see less than enough, with their dots."""
        if self.board:
            return {}
        least = needed_dots()
        return {name: count for name, count in self.counts.items() if count < least and name not in self.lost}


def ready_text(poor: Sequence[str]) -> str:
    """That it can be captured; `poor`: cameras that see little here, which others make up for."""
    if not poor:
        return translate("Placement", "Ready: press space")
    text = translate("Placement", "Ready: {names} sees little here, but enough elsewhere")
    return text.format(names=languages.listed(poor[:_NAMED]))


def is_stuck(scene: Scene, as_before: bool = False, away: bool = False) -> bool:
    """Whether the ball lies still where it should, and a camera that works nevertheless sees too little of it."""
    waiting = as_before or away or scene.lost or not any(scene.counts.values())
    return bool(scene.still and scene.short and not scene.made_up and not waiting)


def short_text(short: Mapping[str, int]) -> str:
    """Which cameras see how many dots, and what to do; the worst first."""
    worst = sorted(short.items(), key=lambda one: one[1])[:_NAMED]
    message = translate("Placement", "Fewer than {needed} dots: {cameras}. Capture anyway, or move the ball")
    return message.format(needed=needed_dots(), cameras=languages.listed(f"{name} ({count})" for name, count in worst))


class Hold:
    """Whether something has been as it should for a while; then it begins anew."""

    _since: float | None = None

    def held(self, now_s: float) -> float:
        """The share of the wait that has passed; 0 where nothing is waited for."""
        return 0.0 if self._since is None else min((now_s - self._since) / HOLD_S, 1.0)

    def lasts(self, good: bool, now_s: float) -> bool:
        """Whether it has been good for long enough now."""
        if not good:
            self._since = None
        elif self._since is None:
            self._since = now_s
        over = self._since is not None and now_s - self._since >= HOLD_S
        self._since = None if over else self._since
        return over


class AutoTrigger(Hold):
    """Takes by itself once the scene has been still and sufficient for a while, and again only after a movement."""

    _armed = True

    def feed(self, scene: Scene, now_s: float) -> bool:
        """Whether to take now."""
        self._armed = self._armed or not scene.still
        taken = self.lasts(bool(scene.still and scene.enough and self._armed), now_s)
        self._armed = self._armed and not taken
        return taken


@dataclass(frozen=True)
class NeedLine:
    """What some cameras need: the text before their names, the names, whether these are all cameras."""

    message: str
    cameras: tuple[str, ...]
    everyone: bool

    @property
    def all_words(self) -> str:
        """What is written in place of the names of all."""
        return translate("Placement", "all cameras")

    @property
    def text(self) -> str:
        """In plain words."""
        return f"{self.message} {self.all_words if self.everyone else languages.listed(self.cameras)}"


def need_lists(found: Sequence[CameraNeed], more_to_come: bool = False) -> tuple[NeedLine | None, NeedLine | None]:
    """The cameras that need more dots, and those that need them better spread; None where no camera does."""
    elsewhere = translate("Placement", "Need them elsewhere in the image:")
    if more_to_come:
        elsewhere = translate("Placement", "At the next placements, fill other parts of the image:")
    lines = []
    for need, message in (("more", translate("Placement", "Need more dots:")), ("spread", elsewhere)):
        names = tuple(one.camera for one in found if one.need == need)
        lines.append(NeedLine(message, names, len(names) == len(found)) if names else None)
    return lines[0], lines[1]


def need_text(need: str, cells: IntArray) -> str:
    """What a camera needs, for its tile: more dots, or dots where the `cells` (10, 10) of its image have few."""
    if need == "more":
        return translate("Placement", "needs more dots")
    thirds = {
        translate("Placement", "on the left"): cells[:, :_THIRD],
        translate("Placement", "on the right"): cells[:, -_THIRD:],
        translate("Placement", "at the top"): cells[:_THIRD],
        translate("Placement", "at the bottom"): cells[-_THIRD:],
    }
    part = min(thirds, key=lambda name: float((thirds[name] > 0).mean()))
    text = translate("Placement", "no dots {part}")
    if (thirds[part] > 0).any():
        text = translate("Placement", "few dots {part}")
    return text.format(part=part)


def island_text(groups: Sequence[Sequence[int]], cameras: Sequence[str]) -> tuple[str, Level]:
    """Whether all cameras hang together."""
    if len(groups) <= 1:
        return translate("Placement", "All cameras are linked."), "good"
    names = " | ".join(" ".join(cameras[i] for i in group) for group in groups)
    return translate("Placement", "Not linked with each other: {names}").format(names=names), "bad"


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
