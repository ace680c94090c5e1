"""`spherecal limits show|reset-pin`: what the responsible person has set, and what to do about a forgotten PIN."""

import argparse
from collections.abc import Callable
from pathlib import Path

from spherecal.cli.answer import answer


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's actions and their options."""
    limits = add("limits", "Limits that the responsible person has set in the window (More, Limits).")
    actions = limits.add_subparsers(dest="action", required=True, metavar="ACTION")
    for name, text in (
        ("show", "The limits that hold on this machine, and who has changed them."),
        ("reset-pin", "Remove a forgotten PIN; the limits stay, and whoever unlocks them next sets a new one."),
    ):
        one = actions.add_parser(name, help=text, description=text)
        one.add_argument("--file", type=Path, metavar="FILE", help="instead of your own (or $SPHERECAL_LIMITS)")


def limits(options: argparse.Namespace) -> int:
    """`spherecal limits`."""
    from spherecal.cli.main import DONE

    {"show": _show, "reset-pin": _reset_pin}[options.action](options)
    return DONE


def _say(*lines: str) -> None:
    from spherecal.cli.commands import out

    for line in lines:
        out.print(line, markup=False, soft_wrap=True)


def _show(options: argparse.Namespace) -> None:
    from spherecal.profile.limits_file import NAMES, Limits, limits_path, read_limits

    path = options.file or limits_path()
    kept = read_limits(path)
    values = {name: getattr(kept.limits, name) for name in NAMES}
    answer(options, {"limits": values, "pin": kept.pin is not None})
    _say(f"{path}: {'locked by a PIN' if kept.pin is not None else 'no PIN was set'}")
    for name, value in values.items():
        delivered = getattr(Limits(), name)
        _say(f"  {name}: {_word(value)}" + ("" if value == delivered else f" (delivered: {_word(delivered)})"))
    for one in kept.changes:
        values_said = "" if one.what.startswith("pin-") else f" {_word(one.before)} -> {_word(one.after)}"
        _say(f"  {one.at:%Y-%m-%d %H:%M} UTC, {one.by}: {one.what}{values_said}")


def _word(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, int | float) else str(value or "-")


def _reset_pin(options: argparse.Namespace) -> None:
    import getpass

    from spherecal.profile.limits_file import changing_limits, limits_path, read_limits, with_pin, write_limits

    path = options.file or limits_path()
    with changing_limits(path):
        kept = read_limits(path)
        answer(options, {"file": path, "removed": kept.pin is not None})
        if kept.pin is None:
            _say(f"{path}: no PIN was set.")
            return
        write_limits(with_pin(kept, None, f"{_login(getpass.getuser)}, spherecal limits reset-pin"), path)
    _say(f"{path}: the PIN was removed, and that is noted. Set a new one in the window: More, Limits, Unlock.")


def _login(ask: Callable[[], str]) -> str:
    try:
        return ask()
    except (OSError, KeyError, ImportError):  # an account without a name
        return "?"
