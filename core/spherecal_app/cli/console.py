"""Where commands say what came out: standard output as a console of rich's."""

import os
import sys
from contextlib import suppress
from math import isfinite
from typing import Any

from rich.console import Console


class _Output(Console):
    """Standard output as a console; where it cannot be written any more, the command goes on to its end.

    `lost`: why, unless whoever read it has had enough.
    """

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


def number(value: float | None, digits: int) -> str:
    """A number with so many decimals; "-" where there is none or it is not finite."""
    return "-" if value is None or not isfinite(value) else f"{value:.{digits}f}"
