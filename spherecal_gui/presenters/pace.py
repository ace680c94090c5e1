"""How long work took the last times on this computer."""

from collections.abc import Sequence

_KEPT = 5  # runs that are remembered of each kind of work


def pace_key(name: str) -> str:
    """What work is remembered under in the settings: all placements are alike."""
    return f"pace-{name.partition(':')[0]}"


def read_durations(text: str) -> tuple[float, ...]:
    """Durations as the settings keep them; nonsense counts as none."""
    try:
        found = tuple(float(part) for part in text.split())
    except ValueError:
        return ()
    return tuple(one for one in found if 0 < one < 1e5)[-_KEPT:]


def with_duration(text: str, seconds: float) -> str:
    """The newest durations with one more, as the settings keep them."""
    return " ".join(f"{one:.1f}" for one in (*read_durations(text), seconds)[-_KEPT:])


def expected_s(durations: Sequence[float]) -> float | None:
    """How long such work usually takes: the middle of the last times."""
    return sorted(durations)[len(durations) // 2] if durations else None
