"""Certificates of reference bars: which have expired or soon will, in the words of the start page and of Verify."""

from collections.abc import Iterable
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.errors import SpherecalError
from spherecal_files.json_file import read_json
from spherecal_gui.languages import word
from spherecal_gui.standing import Level, worst

if TYPE_CHECKING:
    from spherecal.data.session import Bar, Certificate
    from spherecal_files.bar_registry import RegisteredBar

# Imported inside functions: sessions and bars take 15 ms, for which the window does not wait.
_LEVELS: dict[str, Level] = {
    "no-certificate": "caution", "expired": "bad", "expires-soon": "caution", "not-yet": "caution",
    "unlimited": "none", "ok": "good",
}  # fmt: skip


def state_words(certificate: "Certificate | None", today: date) -> tuple[str, Level]:
    """The state of a certificate in a few words, and the colour of that. `certificate` None where it has none."""
    from spherecal_verify.expiry import expiry

    said = expiry(certificate, today)
    until = certificate.valid_until if certificate is not None else None
    state = said[0] if said is not None else "ok" if until is not None else "unlimited"
    begun = certificate.date if certificate is not None else None
    return word("certificates", state, date=begun if state == "not-yet" else until), _LEVELS[state]


def reminder(bars: "Iterable[Bar | RegisteredBar]", today: date) -> tuple[str, Level]:
    """One sentence about the bars whose certificate has expired or soon will, and its colour; empty where none has."""
    from spherecal_files.bar_registry import RegisteredBar
    from spherecal_verify.expiry import expiry

    names: dict[str, list[str]] = {"expired": [], "not-yet": [], "expires-soon": []}
    for bar in bars:
        said = expiry(bar.certificate, today)
        if said is not None and said[0] in names:
            words, _ = state_words(bar.certificate, today)
            name = bar.serial if isinstance(bar, RegisteredBar) else bar.serial or bar.id
            names[said[0]].append(f"{name} ({words})")
    notes: list[tuple[Level, str]] = [
        (_LEVELS[state], word("reminders", state, bars=own)) for state, own in names.items() if own
    ]
    return " ".join(text for _, text in notes), worst(level for level, _ in notes)


def bench_reminder(bench: Path, today: date) -> tuple[str, Level]:
    """Of the bars on the rig's bench; where none was described, of all bars of the library."""
    from spherecal_files.bar_registry import BAR_REGISTRY
    from spherecal_files.read_session import read_bars
    from spherecal_rigs.ball_registry import FORMAT, VERSION

    bars: Iterable[Bar | RegisteredBar] = ()
    try:
        if bench.is_file():
            f = read_json(bench, FORMAT, VERSION).fields((), ("bars",))
            bars = read_bars(f["bars"])[0] if "bars" in f else ()
        else:
            bars = BAR_REGISTRY.read().values()
    except SpherecalError:  # it is named where the bench is used; the start page comes up all the same
        return "", "none"
    return reminder(bars, today)
