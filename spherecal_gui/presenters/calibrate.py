"""The course of a calibration: stages, time left, and the cost of each iteration."""

import re
from dataclasses import dataclass, field

from PySide6.QtCore import QCoreApplication

from spherecal.context import Progress

translate = QCoreApplication.translate

# Share of the whole time up to the end of each stage, measured on the demo and on rig A from images (2 busy cores):
# detection takes half, the second look a sixth, the adjustments most of the rest.
_ENDS = {
    "reading the session": 0.02, "detect": 0.55, "two-view gate": 0.58, "triples": 0.65, "start values": 0.68,
    "growing the network": 0.74, "bundle adjustment": 0.88, "rigid ball": 0.95, "uncertainty": 0.97,
    "writing the result": 1.0,
}  # fmt: skip
_ITERATION = re.compile(r"iteration (\d+), cost (\S+)")
_SURE_AFTER_S = 2.0


def stage_name(stage: str) -> str:
    """The stage in words."""
    return {
        "reading the session": translate("Stages", "Reading what was taken"),
        "detect": translate("Stages", "Finding the targets in all images"),
        "two-view gate": translate("Stages", "Comparing pairs of cameras"),
        "triples": translate("Stages", "Linking three cameras at a time"),
        "start values": translate("Stages", "Start values"),
        "growing the network": translate("Stages", "Growing the network"),
        "robust adjustment": translate("Stages", "First adjustment, blunders damped"),
        "bundle adjustment": translate("Stages", "Adjusting everything together"),
        "rigid ball": translate("Stages", "Taking the ball as one rigid body"),
        "uncertainty": translate("Stages", "Uncertainties"),
        "writing the result": translate("Stages", "Writing the result"),
    }.get(stage, stage)


@dataclass
class CourseOfWork:
    """Collects progress events; `stages` in the order in which they came, `runs` the costs of each adjustment."""

    stages: list[str] = field(default_factory=list)
    runs: list[list[float]] = field(default_factory=list)
    fraction: float = 0.0
    message: str = ""
    _last: tuple[str, int] = ("", 0)

    def add(self, news: Progress) -> None:
        """Take one event into account; the whole never runs backwards."""
        if news.stage not in self.stages:
            self.stages.append(news.stage)
        self.message = news.message
        ends = list(_ENDS)
        if news.stage in _ENDS:
            at = ends.index(news.stage)
            before = _ENDS[ends[at - 1]] if at else 0.0
            self.fraction = max(self.fraction, before + news.fraction * (_ENDS[news.stage] - before))
        found = _ITERATION.search(news.message)
        if found:
            number, cost = int(found[1]), float(found[2])
            if not self.runs or news.stage != self._last[0] or number <= self._last[1]:
                self.runs.append([])
            self.runs[-1].append(cost)
            self._last = (news.stage, number)

    def seconds_left(self, elapsed_s: float) -> float | None:
        """How long it will still take at the pace so far; None while nothing can be said."""
        if elapsed_s < _SURE_AFTER_S or self.fraction < 0.05:
            return None
        return elapsed_s * (1 - self.fraction) / self.fraction


def time_text(seconds: float | None) -> str:
    """A time for people: rounded, never falsely exact."""
    if seconds is None:
        return translate("Calibrate", "estimating the time")
    if seconds < 60:
        return translate("Calibrate", "about {seconds} s left").format(seconds=max(1, 5 * round(seconds / 5)) or 1)
    return translate("Calibrate", "about {minutes} min left").format(minutes=round(seconds / 60))
