"""What commands tell and write: progress, words on standard output (rich), JSON for other programs, findings, files."""

import argparse
import json
import logging
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Table

from spherecal.base import interrupts
from spherecal.base.context import Context, Progress
from spherecal.base.errors import InputError, OutputError
from spherecal.base.messages.catalogue import language
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal_app.cli.parsing import is_standard_output
from spherecal_files.atomic import Marker, check_folder, write_file_whole
from spherecal_files.json_file import plain

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


class _Output(Console):
    """Standard output as a console; where it cannot be written any more (`lost`: why), the command goes on."""

    lost: OSError | None = None

    def print(self, *objects: Any, **options: Any) -> None:
        """As rich's; what cannot be written is dropped."""
        try:
            super().print(*objects, **options)
        except OSError as error:  # a full disk
            self.lose(error)

    def lose(self, error: OSError) -> None:
        """Drop what is still to be said, for this reason."""
        self.lost = error
        self.on_broken_pipe()

    def on_broken_pipe(self) -> None:
        self.quiet = True
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


# a pipe has no width of its own: tables in a log file are not folded at 80 columns
out = _Output(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 140)


def say(*lines: str) -> None:
    """Print lines as they are: brackets in them are no markup."""
    for line in lines:
        out.print(line, markup=False)


def figures(first: str, *headings: str) -> Table:
    """A table without lines whose columns after the first hold figures, those without a heading words."""
    table = Table(first, box=None)
    for heading in headings:
        table.add_column(heading, justify="right" if heading else "left")
    return table


def number(value: float | None, digits: int) -> str:
    """A number with so many decimals; "-" where there is none or it is not finite."""
    return "-" if value is None or not isfinite(value) else f"{value:.{digits}f}"


def answer(options: argparse.Namespace, document: object) -> None:
    """With `--json`, print the document: all that goes to standard output, or to standard error beside a file there."""
    if options.json:
        try:
            print(json.dumps(plain(document), indent=1), file=out.file, flush=True)
        except BrokenPipeError:
            raise
        except OSError as error:
            out.lose(error)


_COLOUR = {"error": "red", "warning": "yellow", "info": "blue"}


def show_findings(findings: tuple[Finding, ...]) -> None:
    """Print each, with its severity in colour."""
    for finding in findings:
        out.print(f"[{_COLOUR[finding.severity]}]{finding.severity}[/] {finding.code}: ", end="")
        message, hint = (finding.words(part, language()) for part in ("message", "hint"))
        say(f"{message} {hint}".strip())


def log_findings(findings: tuple[Finding, ...]) -> None:
    """Write each into the log."""
    for finding in findings:
        log.info("finding: %s %s: %s", finding.severity, finding.code, finding.message)


def check_output_folder(path: Path, marker: Marker) -> None:
    """Check that a folder may be written, as `check_folder` does."""
    if is_standard_output(path):
        raise InputError(Phrase("error-folder-to-output"))
    check_folder(path, marker)


def to_output(path: Path, data: bytes) -> None:
    """Write a single file whole."""
    with output_file(path) as place:
        write_file_whole(place, data)


@contextmanager
def output_file(path: Path) -> Iterator[Path]:
    """Where to write a command's one file: `path`, or for "-" a temporary file that then goes to standard output."""
    if not is_standard_output(path):
        yield path
        return
    with TemporaryDirectory() as folder:
        place = Path(folder) / "output"
        yield place
        if place.is_dir():
            raise InputError(Phrase("error-folder-to-output"))
        sys.stdout.flush()
        sys.stdout.buffer.write(place.read_bytes())
        sys.stdout.buffer.flush()


def kept_in_profile(what: str, profile: Path, keep: Callable[[], bool]) -> str | None:
    """Keep it; what to say of it, None where there was nothing to keep. A profile that cannot be written to is said."""
    try:
        kept = keep()
    except OutputError as error:
        return f"{what} is not kept in the profile. {error}"
    return f"{what} is kept in the profile: spherecal profile trend {profile} --checks" if kept else None
