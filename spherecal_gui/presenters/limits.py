"""The limits as the technician sees them and the responsible person changes them: the lock, the words, the checks."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import ceil
from pathlib import Path

from PySide6.QtCore import QCoreApplication

from spherecal.base.errors import InputError, SpherecalError
from spherecal.verify.limit import parse_limit
from spherecal_gui import limits as in_use
from spherecal_gui.texts import error_text
from spherecal_rigs.limits_file import (
    DOTS,
    HOURS,
    KELVIN,
    LEAST_PIN,
    PAIRS,
    KeptLimits,
    LimitChange,
    Limits,
    Pin,
    Value,
    changing_limits,
    limits_path,
    read_limits,
    with_limits,
    with_pin,
    write_limits,
)

translate = QCoreApplication.translate

_FIRST_WAIT_S, _LONGEST_WAIT_S = 1.0, 30.0
_LONGEST_NAME = 100


@dataclass(frozen=True)
class LimitField:
    """One limit as it is shown: its words, its unit, why it is what it is, and how far it goes (None: no number)."""

    name: str
    title: str
    unit: str
    why: str
    span: tuple[float, float] | None = None
    digits: int = 0


def limit_fields() -> list[LimitField]:
    """All limits, in the order in which they are shown."""
    hours, kelvin = translate("Limits", "h"), "K"
    aged = translate("Limits", "The chip turns amber. Comparable systems warn after 5 h as well.")
    stale = translate("Limits", "The chip turns red. Comparable systems refuse to measure after 12 h.")
    warm = translate(
        "Limits",
        "Between calibrating and now. A rig 1.3 m wide on aluminium grows by 0.03 mm per kelvin.",
    )
    dots = translate(
        "Limits",
        "Green from this count on. Cameras see 270 to 420; a quarter of that doubles all standard deviations.",
    )
    formula = translate(
        "Limits", "A in mm, such as 0.03+L/20000: what the measuring task allows. Empty: judged by its own uncertainty."
    )
    unverified = translate(
        "Limits",
        "Only with a reason in the note. Without a bar nothing shows a wrong scale: no residual depends on it.",
    )
    return [
        LimitField(
            "needed_dots",
            translate("Limits", "Dots that each camera needs at a placement"),
            translate("Limits", "dots"),
            dots,
            DOTS,
        ),
        LimitField("ageing_hours", translate("Limits", "Ageing after"), hours, aged, HOURS, 1),
        LimitField("stale_hours", translate("Limits", "Out of date after"), hours, stale, HOURS, 1),
        LimitField(
            "ageing_kelvin", translate("Limits", "Ageing from a temperature change of"), kelvin, warm, KELVIN, 1
        ),
        LimitField(
            "stale_kelvin", translate("Limits", "Out of date from a temperature change of"), kelvin, warm, KELVIN, 1
        ),
        LimitField(
            "verification_limit",
            translate("Limits", "Limit of the length errors in new projects, A+L/K"),
            "mm",
            formula,
        ),
        LimitField(
            "verification_limit_open",
            translate("Limits", "The technician may give a project another limit"),
            "",
            translate("Limits", "Without this, nobody passes a rig by widening the limit at Verify."),
        ),
        LimitField(
            "unverified_use",
            translate("Limits", "A calibration that was not verified may be put to use"),
            "",
            unverified,
        ),
    ]


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
        found["verification_limit"] = " ".join(error_text(error)).strip()
    return found


def value_text(name: str, value: Value | None) -> str:
    """A limit's value with its unit, for people.

    `value` None or empty text: no limit.
    """
    if isinstance(value, bool):
        return translate("Limits", "yes") if value else translate("Limits", "no")
    unit = next((one.unit for one in limit_fields() if one.name == name), "")
    if value is None or value == "":
        return translate("Limits", "none")
    return f"{value:g} {unit}".strip() if isinstance(value, int | float) else f"{value} {unit}".strip()


def change_text(change: LimitChange) -> str:
    """Who has changed what, and when, on one line."""
    when = f"{change.at.astimezone():%Y-%m-%d %H:%M}  {change.by}: "
    if change.what == "pin-set":
        return when + translate("Limits", "set a PIN")
    if change.what == "pin-removed":
        return when + translate("Limits", "removed the PIN")
    title = next((one.title for one in limit_fields() if one.name == change.what), change.what)
    return f"{when}{title}: {value_text(change.what, change.before)} → {value_text(change.what, change.after)}"


def load_limits(path: Path | None = None) -> str:
    """Use the limits of the file; what is wrong with it, where the delivered ones are used. Empty: all is well."""
    try:
        in_use.use(read_limits(path).limits)
    except InputError as error:
        in_use.use(Limits())
        return _damage_text(" ".join(error_text(error)).strip())
    return ""


def _damage_text(problem: str) -> str:
    message = translate(
        "Limits", "{problem} Until then the delivered limits are used. Restore the file, or delete it to start again."
    )
    return message.format(problem=problem)


class Gate:
    """Makes who tries PINs wait: a second after a wrong one, twice as long after each further one, at most 30 s."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._wrong, self._until = clock, 0, 0.0

    @property
    def wait_s(self) -> float:
        """How long no PIN is looked at."""
        return max(0.0, self._until - self._clock())

    def tell(self, right: bool) -> None:
        """A PIN was right, or wrong."""
        self._wrong = 0 if right else self._wrong + 1
        longest = min(_FIRST_WAIT_S * 2.0 ** (min(self._wrong, 10) - 1), _LONGEST_WAIT_S)
        self._until = 0.0 if right else self._clock() + longest


GATE = Gate()  # of this program, so that closing the dialog does not help


class LimitsDesk:
    """The limits' file while the dialog is open; locked until somebody gives the PIN, and again when it is closed."""

    def __init__(self, profile: Path, path: Path | None = None, gate: Gate = GATE) -> None:
        """`profile` is the rig's profile, which keeps ages of its own and takes them over from here."""
        self.path, self._profile, self._gate = path or limits_path(), profile, gate
        self.kept, self.damage, self.by = KeptLimits(), "", ""
        self.unlocked = False
        self._read()

    def _read(self) -> None:
        try:
            self.kept, self.damage = read_limits(self.path), ""
        except InputError as error:
            self.kept, self.damage = KeptLimits(), " ".join(error_text(error)).strip()

    @property
    def has_pin(self) -> bool:
        """Whether a PIN was set."""
        return self.kept.pin is not None

    @property
    def wait_s(self) -> float:
        """How long no PIN is looked at."""
        return self._gate.wait_s

    @property
    def last_name(self) -> str:
        """Who has changed something last."""
        names = [one.by for one in self.kept.changes if one.what != "pin-removed"]
        return names[-1] if names else ""

    def state_text(self) -> str:
        """Why the limits cannot be changed now, or that they can."""
        if self.damage:
            return _damage_text(self.damage)
        if self.unlocked:
            return translate("Limits", "Unlocked for {name}. Closing this window locks them again.").format(
                name=self.by
            )
        return translate("Limits", "Locked: the responsible person of the rig sets these.")

    def honest_text(self) -> str:
        """What the lock is good for, and what to do about a forgotten PIN."""
        message = translate(
            "Limits",
            "The PIN guards against mistakes, not against somebody who can write {path}. "
            "If it was forgotten: spherecal limits reset-pin",
        )
        return message.format(path=self.path)

    # --- the lock ----------------------------------------------------------------------------------------------------

    def unlock(self, name: str, pin: str, again: str = "") -> str:
        """Unlock for somebody: with the PIN, or by setting one where there is none; what is in the way, else empty."""
        if self.wait_s > 0:
            return self.wait_text()
        name = name.strip()
        if not name or len(name) > _LONGEST_NAME or not name.isprintable():
            return translate("Limits", "Give your name: it is noted with every change.")
        problem = self._try_pin(pin) if self.has_pin else self._set_pin(name, pin, again)
        if not problem:
            self.by, self.unlocked = name, True
        return problem

    def _try_pin(self, pin: str) -> str:
        right = self.kept.pin is not None and self.kept.pin.fits(pin)
        self._gate.tell(right)
        return "" if right else self.wait_text()

    def wait_text(self) -> str:
        """That the PIN was wrong, and how long to wait."""
        wrong = translate("Limits", "That is not the PIN.")
        if self.wait_s <= 0:
            return wrong
        after = translate("Limits", "The next try is in {seconds} s.").format(seconds=ceil(self.wait_s))
        return f"{wrong} {after}"

    def _set_pin(self, name: str, pin: str, again: str) -> str:
        if len(pin) < LEAST_PIN:
            return translate("Limits", "A PIN has {least} characters or more.").format(least=LEAST_PIN)
        if pin != again:
            return translate("Limits", "The two PINs differ.")
        try:
            self._write(with_pin(self.kept, Pin.of(pin), name))
        except SpherecalError as error:
            return " ".join(error_text(error)).strip()
        return ""

    def lock(self) -> None:
        """Locked again."""
        self.unlocked, self.by = False, ""

    # --- changing ----------------------------------------------------------------------------------------------------

    def save(self, limits: Limits) -> tuple[list[str], str]:
        """Keep other limits and use them: the changes in words, and what is in the way (empty: nothing)."""
        problems = limit_problems(limits)
        if not self.unlocked or problems:
            return [], next(iter(problems.values()), self.state_text())
        said: list[str] = []
        try:
            with changing_limits(self.path):
                there = read_limits(self.path)  # another window may have changed some
                self._write(with_limits(there, limits, self.by))
            said = [change_text(one) for one in self.kept.changes[len(there.changes) :]]
            in_use.use(limits)
            self._into_profile(limits)
        except SpherecalError as error:
            return said, " ".join(error_text(error)).strip()
        return said, ""

    def _write(self, kept: KeptLimits) -> None:
        write_limits(kept, self.path)
        self.kept = kept

    def _into_profile(self, limits: Limits) -> None:
        from spherecal_rigs.store import set_limits  # imports scipy

        if self.differs_in_profile(limits):
            set_limits(self._profile, **asdict(limits.validity))

    def differs_in_profile(self, limits: Limits) -> bool:
        """Whether the rig's profile has other ages or temperatures; InputError where it cannot be read."""
        if not (self._profile / "profile.json").is_file():
            return False
        from spherecal_rigs.store import open_profile  # imports scipy

        return open_profile(self._profile).limits != limits.validity

    def profile_text(self) -> str:
        """That the rig's profile has other ages or temperatures; empty where it has not, or there is none."""
        try:
            if not self.differs_in_profile(self.kept.limits):
                return ""
        except SpherecalError as error:
            return " ".join(error_text(error)).strip()
        return translate("Limits", "The rig's profile still has others; saving here gives it these.")
