"""The course of a calibration: what goes into it, stages, time left, and the cost of each iteration."""

from collections.abc import Mapping, Sequence, Sized
from dataclasses import dataclass, field

from spherecal.base.context import Progress
from spherecal.base.messages.values import Phrase
from spherecal_gui import languages

# Share of the whole time at which each part begins and ends, measured on the demo from images (17 s on two busy cores):
# the targets are sought, the method runs, missed targets are sought again, the method runs again.
_PARTS = {"detect": (0.02, 0.36), "first": (0.36, 0.60), "again": (0.60, 0.72), "second": (0.72, 0.97)}
# Boards: looking is most of the work (2.8 processor seconds a picture of 2.3 MP without the board that is sought).
_BOARDS = (0.02, 0.85)
# ... and of one run of the method; the adjustments come once more after the step to the rigid ball.
_RUN = {
    "two-view gate": (0.0, 0.02), "triples": (0.02, 0.05), "start values": (0.05, 0.1),
    "growing the network": (0.1, 0.15), "robust adjustment": (0.15, 0.24), "resection": (0.24, 0.25),
    "bundle adjustment": (0.25, 0.4),
    "uncertainty": (0.4, 0.45), "rigid ball": (0.45, 0.5),
}  # fmt: skip
_AFTER_RIGID = {"bundle adjustment": (0.5, 0.85), "uncertainty": (0.85, 0.9), "diagnosis": (0.9, 1.0)}

_LOOKING_AGAIN = Phrase("looking-again")


def _between(ends: tuple[float, float], fraction: float) -> float:
    return ends[0] + fraction * (ends[1] - ends[0])


def input_rows(names: Sequence[str], dots: Mapping[str, Mapping[str, Sized]]) -> list[tuple[str, int, int, bool]]:
    """What a calibration would be computed from: sets, the cameras that see something, their dots; whether captured."""
    rows = []
    for name in names:
        seen = [len(one) for one in dots.get(name, {}).values() if len(one)]
        rows.append((name, len(seen), sum(seen), name in dots))
    return rows


@dataclass
class CourseOfWork:
    """Collects progress events; `stages` in the order in which they came, `runs` the costs of each adjustment."""

    stages: list[str] = field(default_factory=list)
    runs: list[list[float]] = field(default_factory=list)
    fraction: float = 0.0
    stage: str = ""  # of the newest event
    said: list[str] = field(default_factory=list)  # every event in words, for the log
    _last: tuple[str, int] = ("", 0)
    _part: str = "detect"
    _rigid: bool = False

    def add(self, news: Progress) -> None:
        """Take one event into account; the whole never runs backwards."""
        self.stage = news.stage
        if news.stage not in self.stages:
            self.stages.append(news.stage)
        self.said.append(f"{languages.word('stages', news.stage, news.stage)}  {news.words(languages.now())}".strip())
        self.fraction = max(self.fraction, self._reached(news))
        if news.iteration is not None and news.cost is not None:
            if not self.runs or news.stage != self._last[0] or news.iteration <= self._last[1]:
                self.runs.append([])
            self.runs[-1].append(news.cost)
            self._last = (news.stage, news.iteration)

    def _reached(self, news: Progress) -> float:
        """The share of the whole that is done when this is reported."""
        if news.stage == "writing the result":
            return 0.98
        if news.stage == "finding boards":
            return _between(_BOARDS, news.fraction)
        if news.stage == "detect":
            self._part = "again" if news.detail == _LOOKING_AGAIN else "detect"
            return _between(_PARTS[self._part], news.fraction)
        if news.stage == "two-view gate" and self._part in ("detect", "again"):
            self._part, self._rigid = ("first" if self._part == "detect" else "second"), False
        self._rigid |= news.stage == "rigid ball"
        share = (_AFTER_RIGID if self._rigid else {}).get(news.stage) or _RUN.get(news.stage)
        if share is None or self._part not in ("first", "second"):
            return 0.0
        return _between(_PARTS[self._part], _between(share, news.fraction))
