"""`spherecal limits show|reset-pin`: what the responsible person has set, and what to do about a forgotten PIN."""

import argparse
import getpass
from collections.abc import Callable

from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_rigs.limits_file import (
    NAMES,
    Limits,
    changing_limits,
    limits_path,
    read_limits,
    with_pin,
    write_limits,
)


def show(options: argparse.Namespace) -> int:
    """`spherecal limits show`."""
    path = options.file or limits_path()
    kept = read_limits(path)
    values = {name: getattr(kept.limits, name) for name in NAMES}
    answer(options, {"limits": values, "pin": kept.pin is not None})
    say(f"{path}: {'locked by a PIN' if kept.pin is not None else 'no PIN was set'}")
    for name, value in values.items():
        delivered = getattr(Limits(), name)
        say(f"  {name}: {_word(value)}" + ("" if value == delivered else f" (delivered: {_word(delivered)})"))
    for one in kept.changes:
        values_said = "" if one.what.startswith("pin-") else f" {_word(one.before)} -> {_word(one.after)}"
        say(f"  {one.at:%Y-%m-%d %H:%M} UTC, {one.by}: {one.what}{values_said}")
    return DONE


def _word(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, int | float) else str(value or "-")


def reset_pin(options: argparse.Namespace) -> int:
    """`spherecal limits reset-pin`."""
    path = options.file or limits_path()
    with changing_limits(path):
        kept = read_limits(path)
        answer(options, {"file": path, "removed": kept.pin is not None})
        if kept.pin is None:
            say(f"{path}: no PIN was set.")
            return DONE
        write_limits(with_pin(kept, None, f"{_login(getpass.getuser)}, spherecal limits reset-pin"), path)
    say(f"{path}: the PIN was removed, and that is noted. Set a new one in the window: More, Limits, Unlock.")
    return DONE


def _login(ask: Callable[[], str]) -> str:
    try:
        return ask()
    except (OSError, KeyError, ImportError):  # an account without a name
        return "?"
