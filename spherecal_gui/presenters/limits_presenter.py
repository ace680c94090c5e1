"""The limits as the technician sees them and the responsible person changes them: the words, the checks."""

from dataclasses import asdict
from pathlib import Path

from spherecal.base.errors import InputError, SpherecalError
from spherecal_gui import limits_in_force as in_use
from spherecal_gui.languages import error_line, translate, word
from spherecal_rigs.limits_file import DOTS, HOURS, KELVIN, PAIRS, Limits, Value, limits_path, read_limits, write_limits
from spherecal_verify.limit import parse_limit

# The limits in the order in which they are shown: how far each goes (None: it is no number), and its digits.
SPANS: dict[str, tuple[tuple[float, float] | None, int]] = {
    "needed_dots": (DOTS, 0), "ageing_hours": (HOURS, 1), "stale_hours": (HOURS, 1), "ageing_kelvin": (KELVIN, 1),
    "stale_kelvin": (KELVIN, 1), "verification_limit": (None, 0), "verification_limit_open": (None, 0),
    "unverified_use": (None, 0),
}  # fmt: skip


def limit_problems(limits: Limits) -> dict[str, str]:
    """What cannot be saved and why, by the limit's name."""
    found = {}
    for ageing, stale in PAIRS:
        if getattr(limits, ageing) > getattr(limits, stale):
            found[stale] = translate("Limits", "A calibration ages before it is out of date: give this one more.")
    try:
        if limits.verification_limit:
            parse_limit(limits.verification_limit)
    except InputError as error:
        found["verification_limit"] = error_line(error)
    return found


def value_text(name: str, value: Value) -> str:
    """A limit's value with its unit, for people; an empty text is no limit."""
    if isinstance(value, bool):
        return translate("Limits", "yes") if value else translate("Limits", "no")
    if value == "":
        return translate("Limits", "none")
    return f"{value if isinstance(value, str) else f'{value:g}'} {word('limit-units', name)}".strip()


def changes_text(before: Limits, after: Limits) -> list[str]:
    """What differs, each limit on a line."""
    values = [(name, getattr(before, name), getattr(after, name)) for name in SPANS]
    return [f"{word('limits', n)}: {value_text(n, a)} → {value_text(n, b)}" for n, a, b in values if a != b]


def load_limits(path: Path | None = None) -> str:
    """Use the limits of the file; what is wrong with it, where the delivered ones are used. Empty: all is well."""
    try:
        in_use.use(read_limits(path))
    except InputError as error:
        in_use.use(Limits())
        return _damage_text(error_line(error))
    return ""


def _damage_text(problem: str) -> str:
    message = translate(
        "Limits", "{problem} Until then the delivered limits are used. Restore the file, or delete it to start again."
    )
    return message.format(problem=problem)


class LimitsDesk:
    """The limits' file while the dialog is open."""

    def __init__(self, profile: Path, path: Path | None = None) -> None:
        """`profile` is the rig's profile, which keeps ages of its own and takes them over from here."""
        self.path, self._profile = path or limits_path(), profile
        self.kept, self.damage = Limits(), ""
        try:
            self.kept = read_limits(self.path)
        except InputError as error:
            self.damage = error_line(error)

    def state_text(self) -> str:
        """Whose the limits are and where they are kept, or why they cannot be changed."""
        if self.damage:
            return _damage_text(self.damage)
        message = translate("Limits", "The responsible person of the rig sets these. They are kept in {path}.")
        return message.format(path=self.path)

    def save(self, limits: Limits) -> tuple[list[str], str]:
        """Keep other limits and use them: the changes in words, and what is in the way (empty: nothing)."""
        problems = limit_problems(limits)
        if self.damage or problems:
            return [], next(iter(problems.values()), self.state_text())
        said: list[str] = []
        try:
            write_limits(limits, self.path)
            said, self.kept = changes_text(self.kept, limits), limits
            in_use.use(limits)
            from spherecal_rigs.store import set_limits  # imports scipy

            if self.differs_in_profile(limits):
                set_limits(self._profile, **asdict(limits.validity))
        except SpherecalError as error:
            return said, error_line(error)
        return said, ""

    def differs_in_profile(self, limits: Limits) -> bool:
        """Whether the rig's profile has other ages or temperatures; InputError where it cannot be read."""
        if not (self._profile / "profile.json").is_file():
            return False
        from spherecal_rigs.store import open_profile  # imports scipy

        return open_profile(self._profile).limits != limits.validity

    def profile_text(self) -> str:
        """That the rig's profile has other ages or temperatures; empty where it has not, or there is none."""
        try:
            if not self.differs_in_profile(self.kept):
                return ""
        except SpherecalError as error:
            return error_line(error)
        return translate("Limits", "The rig's profile still has others; saving here gives it these.")
