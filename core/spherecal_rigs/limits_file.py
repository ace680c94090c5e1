"""Limits that the responsible person of a rig sets: one JSON file per user, with the lock's PIN and every change.

The PIN keeps a limit from being changed by mistake; whoever can write the file can change it all the same.
"""

import hashlib
import hmac
import os
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import make_parent, write_file_whole
from spherecal.files.codec import (
    FileFormat,
    Kind,
    boolean,
    choice,
    field,
    integer,
    items,
    number,
    one_of,
    optional,
    record,
    text,
    time,
)
from spherecal.files.json_file import JsonValue
from spherecal.files.lock import locked

if TYPE_CHECKING:
    from spherecal_rigs.validity import ValidityLimits

# Least: below this many common dots two cameras are no neighbours (spherecal.initialise.view_graph). Most: three times
# what the demo's and rig A's cameras see at best (420); no image would ever be enough.
DOTS = (20, 1260)
# Least: what two clocks may differ (profile.validity). Most: a year.
HOURS = (0.1, 8760.0)
# Least: what a shop's thermometer can resolve. Most: more than any shop changes.
KELVIN = (0.1, 50.0)
LEAST_PIN, MOST_PIN = 4, 100
_KEPT_CHANGES = 500
PAIRS = (("ageing_hours", "stale_hours"), ("ageing_kelvin", "stale_kelvin"))
# RFC 7914's setting for logins: n = 2^14, r = 8, p = 1 take 16 MB and 0.15 s (2 busy cores).
# The file names it, so that a later program can choose another.
_N, _R, _P = 2**14, 8, 1
_KIND = "scrypt-16384-8-1"
_SALT_BYTES, _HASH_BYTES = 16, 32

Value = int | float | str | bool


@dataclass(frozen=True)
class Limits:
    """What somebody responsible allows; as made here, they are those that the program is delivered with.

    `needed_dots`: dots that a camera should see at a placement. The demo's and rig A's cameras see 270 to 420; a
    quarter of that gives twice the standard deviation of everything that is estimated from it. The four of validity:
    profile.validity.

    `verification_limit`: A + L/K of a new project's length errors, empty for none. `verification_limit_open`: whether a
    project may have another. `unverified_use`: whether a calibration that was not verified may be put to use, with a
    reason.
    """

    needed_dots: int = 100
    ageing_hours: float = 5.0
    stale_hours: float = 12.0
    ageing_kelvin: float = 1.0
    stale_kelvin: float = 2.0
    verification_limit: str = ""
    verification_limit_open: bool = True
    unverified_use: bool = True

    @property
    def validity(self) -> "ValidityLimits":
        """Those of a calibration's age and temperature, as a profile has them."""
        from spherecal_rigs.validity import ValidityLimits

        return ValidityLimits(self.ageing_hours, self.stale_hours, self.ageing_kelvin, self.stale_kelvin)


NAMES = tuple(field.name for field in fields(Limits))


@dataclass(frozen=True)
class Pin:
    """A PIN as its salted hash (scrypt)."""

    salt: bytes
    digest: bytes

    @classmethod
    def of(cls, text: str) -> "Pin":
        """The hash of a PIN that somebody has chosen, with a salt of its own."""
        if not LEAST_PIN <= len(text) <= MOST_PIN:
            raise InputError(Phrase("error-pin-length", {"least": LEAST_PIN, "most": MOST_PIN, "found": len(text)}))
        salt = os.urandom(_SALT_BYTES)
        return cls(salt, _digest(text, salt))

    def fits(self, text: str) -> bool:
        """Whether this is the PIN."""
        return len(text) <= MOST_PIN and hmac.compare_digest(self.digest, _digest(text, self.salt))


def _digest(text: str, salt: bytes) -> bytes:
    whole = text.encode("utf-8", "surrogatepass")
    return hashlib.scrypt(whole, salt=salt, n=_N, r=_R, p=_P, dklen=_HASH_BYTES)


@dataclass(frozen=True)
class LimitChange:
    """Who has changed what, and when: `what` is a limit's name, `pin-set` or `pin-removed` (without values)."""

    at: datetime
    by: str
    what: str
    before: Value | None = None
    after: Value | None = None


@dataclass(frozen=True)
class KeptLimits:
    """The file's contents: limits, lock (None before a PIN was set), changes, oldest first."""

    limits: Limits = Limits()
    pin: Pin | None = None
    changes: tuple[LimitChange, ...] = ()


def _check_formula(text: str, value: JsonValue) -> None:
    from spherecal.verify.limit import parse_limit

    try:
        if text:
            parse_limit(text)
    except InputError:
        raise value.error(Phrase("problem-limit")) from None


def _check_pairs(limits: Limits, value: JsonValue) -> None:
    for ageing, stale in PAIRS:
        if getattr(limits, ageing) > getattr(limits, stale):
            raise value.error(Phrase("problem-ageing", {"ageing": ageing, "stale": stale}))


def _hex(about: str, count: int) -> Kind[bytes]:
    def read(value: JsonValue) -> bytes:
        try:
            found = bytes.fromhex(value.text())
        except ValueError:
            found = b""
        if len(found) != count:
            raise value.error(Phrase("problem-pin", {"digits": 2 * count}))
        return found

    return Kind({"description": about, "type": "string", "pattern": f"^[0-9a-fA-F]{{{2 * count}}}$"}, read, bytes.hex)


_LIMITS = record(
    "The limits; what is absent is as delivered.",
    Limits,
    optional("needed_dots", integer("Dots that each camera needs at a placement.", *DOTS)),
    optional(
        "ageing_hours", number("Age from which a calibration is ageing, not above `stale_hours`.", *HOURS, "hours")
    ),
    optional("stale_hours", number("Age from which it is stale.", *HOURS, "hours")),
    optional(
        "ageing_kelvin",
        number("Change of the rig's temperature from which it is ageing, not above `stale_kelvin`.", *KELVIN, "kelvin"),
    ),
    optional("stale_kelvin", number("Change from which it is stale.", *KELVIN, "kelvin")),
    optional(
        "verification_limit",
        text("A + L/K of the length errors in new projects of the wizard; empty for none.").checked(_check_formula),
    ),
    optional("verification_limit_open", boolean("Whether a project may have another limit.")),
    optional(
        "unverified_use",
        boolean("Whether a calibration that no bar has verified may be put to use, with a reason."),
    ),
).checked(_check_pairs)
_PIN = record(
    "The lock.",
    Pin,
    field("kind", choice("How it is hashed.", (_KIND,)), lambda _: _KIND),
    field("salt", _hex("32 hexadecimal digits.", _SALT_BYTES)),
    field("hash", _hex("64 hexadecimal digits.", _HASH_BYTES), "digest"),
)
_VALUE = one_of("", boolean(""), text(""), number(""))
_CHANGE = record(
    "",
    LimitChange,
    field("at", time("When it was changed.")),
    field("by", text("Who changed it.")),
    field("what", choice("A limit's name, or the PIN.", (*NAMES, "pin-set", "pin-removed"))),
    optional("before", _VALUE.described("Its value before the change."), omit=None),
    optional("after", _VALUE.described("Its value after the change."), omit=None),
)
LIMITS = FileFormat(
    "spherecal/limits",
    "limits.json",
    "What the responsible person has set, in the user's settings; `SPHERECAL_LIMITS` names another file.",
    record(
        "",
        KeptLimits,
        field("limits", _LIMITS),
        optional("pin", _PIN, omit=None),
        optional("changes", items("The last 500 changes, oldest first.", _CHANGE)),
    ),
    ("`verification_limit` is a limit such as `0.03+L/20000`.",),
    more="#limitsjson",
)


def limits_path() -> Path:
    """The file: `SPHERECAL_LIMITS`, else limits.json in the user's settings, beside the bars."""
    from platformdirs import user_config_path

    named = os.environ.get("SPHERECAL_LIMITS")
    return Path(named) if named else user_config_path("spherecal", appauthor=False) / "limits.json"


def read_limits(path: Path | None = None) -> KeptLimits:
    """The limits kept on this machine; those delivered where there is no file."""
    path = path or limits_path()
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return KeptLimits()
    except OSError:  # the reader says what is wrong: the window has to start all the same
        pass
    return LIMITS.read(path)


def limits_in_use(path: Path | None = None) -> tuple[Limits, str]:
    """The limits that hold, and what is wrong with their file: then those delivered hold. Empty where nothing is."""
    try:
        return read_limits(path).limits, ""
    except InputError as error:
        return Limits(), f"{error} Until then the delivered limits are used."


def changing_limits(path: Path) -> AbstractContextManager[None]:
    """Hold the limits' file from reading to writing, so that no other program's change is lost."""
    make_parent(path, Phrase("error-set-limits"))
    return locked(path)


def write_limits(kept: KeptLimits, path: Path | None = None) -> None:
    """Write the file whole, with the last 500 changes.

    `path` None: that of `limits_path`.
    """
    path = path or limits_path()
    kept = replace(kept, changes=kept.changes[-_KEPT_CHANGES:])
    make_parent(path, Phrase("error-set-limits"))
    write_file_whole(path, LIMITS.bytes(kept))


def with_limits(kept: KeptLimits, limits: Limits, by: str, now: datetime | None = None) -> KeptLimits:
    """Other limits in place of those kept, each that differs noted with who, when and what.

    `now` None: now.
    """
    pairs = [(name, getattr(kept.limits, name), getattr(limits, name)) for name in NAMES]
    news = tuple(LimitChange(_moment(now), by, name, before, after) for name, before, after in pairs if before != after)
    return replace(kept, limits=limits, changes=kept.changes + news)


def with_pin(kept: KeptLimits, pin: Pin | None, by: str, now: datetime | None = None) -> KeptLimits:
    """What is kept with another PIN or without one; the change is noted as well.

    `pin` None: no lock; `now` None: now.
    """
    change = LimitChange(_moment(now), by, "pin-removed" if pin is None else "pin-set")
    return replace(kept, pin=pin, changes=(*kept.changes, change))


def _moment(now: datetime | None) -> datetime:
    return (now or datetime.now(UTC)).replace(microsecond=0)
