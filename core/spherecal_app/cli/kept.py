"""What is said of a result that was also kept in the profile."""

from collections.abc import Callable
from pathlib import Path

from spherecal.base.errors import OutputError


def kept_in_profile(what: str, profile: Path, keep: Callable[[], bool]) -> str | None:
    """Keep it; what to say of it, None where there was nothing to keep. A profile that cannot be written to is said."""
    try:
        kept = keep()
    except OutputError as error:
        return f"{what} is not kept in the profile. {error}"
    return f"{what} is kept in the profile: spherecal profile trend {profile} --checks" if kept else None
