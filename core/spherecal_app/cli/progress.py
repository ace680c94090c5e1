"""Progress on a terminal: stage, percentage and time left; a plain line a stage where there is no terminal."""

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from spherecal.base import interrupts
from spherecal.base.context import Context, Progress

log = logging.getLogger("spherecal")
quiet = False  # set by `-q` while a command runs


@contextmanager
def shown_progress() -> Iterator[Context]:
    """A context whose progress events appear on standard error (never on standard output) and in the log."""
    if quiet:
        yield Context(lambda event: None, interrupts.came)
        return
    console = Console(stderr=True)
    if not console.is_terminal:
        yield Context(_Plain(), interrupts.came)
        return
    columns = (
        TextColumn("{task.description:<24}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Bar(*columns, console=console, transient=True) as bar:
        yield Context(_Terminal(bar), interrupts.came)


class _Plain:
    """One line for every stage that lasts: says that something is going on, without flooding a log file."""

    def __init__(self) -> None:
        self._stage, self._since = "", 0.0

    def __call__(self, event: Progress) -> None:
        if event.stage == self._stage:
            return
        self._stage = event.stage
        log.info("stage: %s", event.stage)
        with suppress(OSError, ValueError):  # nobody who reads it, or a full disk: the work goes on
            print(f"  {event.stage} ...", file=sys.stderr, flush=True)


class _Terminal:
    def __init__(self, bar: Bar) -> None:
        self._bar, self._stage, self._task, self._shown = bar, "", None, 0.0

    def __call__(self, event: Progress) -> None:
        now = time.monotonic()
        if event.stage != self._stage:
            if self._task is not None:
                self._bar.update(self._task, visible=False)
            log.info("stage: %s", event.stage)
            self._stage, self._task = event.stage, self._bar.add_task(event.stage, total=1.0, note="")
        elif now - self._shown < 0.05 and event.fraction < 1.0:
            return  # drawing more often than 20 times a second only costs time
        self._shown = now
        assert self._task is not None
        self._bar.update(self._task, completed=event.fraction, note=event.message)
