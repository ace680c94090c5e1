"""`spherecal limits show`: what the responsible person has set."""

import argparse

from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_rigs.limits_file import NAMES, Limits, limits_path, read_limits


def show(options: argparse.Namespace) -> int:
    """`spherecal limits show`."""
    path = options.file or limits_path()
    limits = read_limits(path)
    values = {name: getattr(limits, name) for name in NAMES}
    answer(options, {"limits": values})
    say(f"{path}:")
    for name, value in values.items():
        delivered = getattr(Limits(), name)
        say(f"  {name}: {_word(value)}" + ("" if value == delivered else f" (delivered: {_word(delivered)})"))
    return DONE


def _word(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, int | float) else str(value or "-")
