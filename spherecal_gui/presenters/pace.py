"""How long work has run and how long it will still take, by what it took the last times on this computer."""

from collections.abc import Sequence

from PySide6.QtCore import QCoreApplication

translate = QCoreApplication.translate

SHOWN_AFTER_S = 1.0
_KEPT = 5  # runs that are remembered of each kind of work


def kind_of(name: str) -> str:
    """What work is remembered under: all placements are alike."""
    return name.partition(":")[0]


def read_durations(text: str) -> tuple[float, ...]:
    """Durations as the settings keep them; nonsense counts as none."""
    try:
        found = tuple(float(part) for part in text.split())
    except ValueError:
        return ()
    return tuple(one for one in found if 0 < one < 1e5)[-_KEPT:]


def with_duration(durations: Sequence[float], seconds: float) -> tuple[float, ...]:
    """The newest ones, with one more."""
    return (*durations, seconds)[-_KEPT:]


def as_text(durations: Sequence[float]) -> str:
    """As the settings keep them."""
    return " ".join(f"{one:.1f}" for one in durations)


def expected_s(durations: Sequence[float]) -> float | None:
    """How long such work usually takes: the middle of the last times."""
    return sorted(durations)[len(durations) // 2] if durations else None


def pace_text(elapsed_s: float, expected: float | None) -> str:
    """Elapsed and expected time; empty within the first second.

    `expected` None: not known.
    """
    if elapsed_s < SHOWN_AFTER_S:
        return ""
    if expected is None or expected < SHOWN_AFTER_S:
        return translate("Pace", "{seconds:.0f} s").format(seconds=elapsed_s)
    if elapsed_s > 1.5 * expected:
        text = translate("Pace", "{seconds:.0f} s, longer than usual ({usual:.0f} s)")
    else:
        text = translate("Pace", "{seconds:.0f} s of about {usual:.0f} s")
    return text.format(seconds=elapsed_s, usual=expected)
