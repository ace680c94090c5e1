"""Progress and cooperative cancelling: the one thing every long stage is given."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from spherecal.base.errors import Cancelled, PartialResultAccepted
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase


@dataclass(frozen=True)
class Progress:
    """One progress event: named stage, done part of it (0..1), where it is; `iteration`, `cost` of an adjustment."""

    stage: str
    fraction: float
    detail: str | Phrase = ""
    iteration: int | None = None
    cost: float | None = None

    @property
    def message(self) -> str:
        """The detail, or the iteration and its cost, in English."""
        return self.words("en")

    def words(self, language: str) -> str:
        """The detail, or the iteration and its cost, in a language; names are the same in all."""
        if self.iteration is not None:
            return phrase(Phrase("iteration", {"iteration": self.iteration, "cost": self.cost}), language)
        return phrase(self.detail, language) if isinstance(self.detail, Phrase) else self.detail


def _ignore(_: Progress) -> None:
    pass


def _never() -> bool:
    return False


@dataclass(frozen=True)
class Context:
    """Carries progress events to whoever asked for the work and their wish to stop back to it.

    `accepts_partial`: the user wants what there is so far. Work that can end with it runs under `accepting_partial()`.
    """

    on_progress: Callable[[Progress], None] = _ignore
    is_cancelled: Callable[[], bool] = _never
    accepts_partial: Callable[[], bool] = _never
    has_partial_result: bool = False

    def accepting_partial(self) -> "Context":
        """The same, for work whose caller holds a partial result and catches PartialResultAccepted."""
        return replace(self, has_partial_result=True)

    def part_of(self, stage: str, fraction: float) -> "Context":
        """The same for work that is a part of another stage: its events have that stage's name and fraction.

        Parameters
        ----------
        stage, fraction
            The other stage, and how much of it is done, 0 to 1.
        """
        return replace(self, on_progress=lambda news: self.on_progress(replace(news, stage=stage, fraction=fraction)))

    def check(self) -> None:
        """Stop here if the user asked to; called at least every 0.2 s of work.

        Raises
        ------
        Cancelled
            Where the work is to stop.
        PartialResultAccepted
            Where the user wants what there is so far, and the caller holds a partial result.
        """
        if self.is_cancelled():
            raise Cancelled
        if self.has_partial_result and self.accepts_partial():
            raise PartialResultAccepted

    def report(self, stage: str, fraction: float, detail: str | Phrase = "") -> None:
        """Send one progress event, and stop here if the user asked to.

        Parameters
        ----------
        stage, fraction
            The stage's name, and how much of it is done, 0 to 1.
        detail
            Where it is: a name, or a phrase with numbers.

        Raises
        ------
        Cancelled, PartialResultAccepted
            As `check`.
        """
        self.check()
        self.on_progress(Progress(stage, min(max(fraction, 0.0), 1.0), detail))

    def report_iteration(self, stage: str, fraction: float, iteration: int, cost: float) -> None:
        """Send the progress of an adjustment, and stop here if the user asked to.

        Parameters
        ----------
        stage, fraction
            The stage's name, and how much of it is done, 0 to 1.
        iteration, cost
            The step's number, and the cost after it.

        Raises
        ------
        Cancelled, PartialResultAccepted
            As `check`.
        """
        self.check()
        self.on_progress(Progress(stage, min(max(fraction, 0.0), 1.0), "", iteration, cost))


class Stopwatch:
    """Seconds spent in each named stage, in order of first use."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Book the time since the last lap (or the start) under `stage`."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
