"""A profile's folder: profile.json, history/0001, history/0002, ..., checks and rig.json, a copy of the one in use.

Nothing that was saved is ever changed in place. A calibration is added as a whole folder of its own. The last event in
profile.json says which one is in use; the event counts once rig.json, which is renamed last, is no longer the rig of
the event before. A crash at any moment leaves the old or the new state, and rig.json agrees with it.
"""

import hashlib
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from spherecal.base.errors import InputError, OutputError, reason
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import name_problem
from spherecal.data.rig import Rig
from spherecal_files import filesystem
from spherecal_files.codec import FileFormat, field, items, name, number, optional, record, software, text, time
from spherecal_files.json_file import JsonValue, software_entry
from spherecal_files.lock import LOCK, locked
from spherecal_rigs.calibration_age import Validity, ValidityLimits, validity
from spherecal_rigs.entry import ENTRY, ENTRY_FILE, RIG_FILE, Entry, checked_rig, read_entry
from spherecal_rigs.kept_checks import FOLDER as CHECKS
from spherecal_rigs.kept_checks import last_check

PROFILE_FILE = "profile.json"
HISTORY = "history"

_MOST_BYTES = 64 << 20
_LEFT_OVER_SECONDS = 3600.0
_ID = re.compile(r"[0-9]{4,9}")
_MOST_EVENTS = 10_000


@dataclass(frozen=True)
class Applied:
    """One event: from this time on, this calibration was in use."""

    calibration: str
    at: datetime
    note: str = ""


@dataclass(frozen=True)
class Profile:
    """A rig's calibrations by id, oldest first; the last event of `applied` names the one in use.

    `problems` lists which folders of the history could not be read.
    """

    folder: Path
    name: str
    limits: ValidityLimits
    applied: tuple[Applied, ...]
    entries: dict[str, Entry]
    problems: tuple[str, ...] = ()

    @property
    def active_id(self) -> str | None:
        """The calibration in use; None before the first was applied."""
        return self.applied[-1].calibration if self.applied else None

    @property
    def active(self) -> Entry | None:
        """The entry in use; None where there is none or it cannot be read."""
        return self.entries.get(self.active_id or "")

    def validity(self, temperature_c: float | None = None, now: datetime | None = None) -> Validity:
        """How far the calibration in use may be trusted now, at this temperature of the rig.

        Parameters
        ----------
        temperature_c
            The rig's temperature, degrees Celsius; None: not known.
        now
            The time to judge at; None: now.
        """
        if self.active_id is not None and self.active is None:
            return Validity("none", (f"calibration {self.active_id}, which is in use, cannot be read",))
        return validity(self.active, self.limits, now, temperature_c, last_check(self.folder, self.active_id))

    @property
    def last_good_id(self) -> str | None:
        """The last valid calibration that was in use before the present one."""
        earlier = [event.calibration for event in self.applied if event.calibration != self.active_id]
        good = (one for one in reversed(earlier) if one in self.entries and self.entries[one].valid)
        return next((one for one in good if not self.entries[one].contradicted), None)

    def rig(self, calibration: str | None = None) -> Rig:
        """The rig of a calibration; without an id of the one in use.

        Raises
        ------
        InputError
            Where there is none, or its file was changed.
        """
        chosen = calibration or self.active_id
        if chosen is None:
            raise InputError(Phrase("error-none-in-use", {"folder": self.folder}))
        return checked_rig(self.path_of(chosen), self.entry(chosen))

    def entry(self, calibration: str) -> Entry:
        """The entry of this id.

        Raises
        ------
        InputError
            Where there is none; lists those there are.
        """
        if calibration not in self.entries:
            values = {"folder": self.folder, "calibration": calibration, "names": list(self.entries)}
            raise InputError(Phrase("error-no-calibration", values))
        return self.entries[calibration]

    def path_of(self, calibration: str) -> Path:
        """The folder of a calibration."""
        return self.folder / HISTORY / calibration


def _profile(name: str, applied: tuple[Applied, ...], limits: ValidityLimits | None = None) -> Profile:
    return Profile(Path(), name, limits or ValidityLimits(), applied, {})


_STATED = record(
    "When a calibration is ageing or stale.",
    dict,
    optional("ageing_hours", number("Age from which it is ageing, not above `stale_hours`.", 0)),
    optional("stale_hours", number("Age from which it is stale.", 0)),
    optional("ageing_kelvin", number("Change of temperature from which it is ageing, not above `stale_kelvin`.", 0)),
    optional("stale_kelvin", number("Change from which it is stale.", 0)),
)


def _read_limits(value: JsonValue) -> ValidityLimits:
    stated = _STATED.read(value)
    try:
        return ValidityLimits(**stated)
    except InputError as error:  # which knows nothing of files
        what = Phrase("error-in-validity", {"file": value.file, "why": error.parts[0]})
        raise InputError(what, error.parts[1]) from error


_APPLIED = record(
    "",
    Applied,
    field(
        "calibration",
        text("Its number.").that(_ID.fullmatch, Phrase("problem-calibration-number"), pattern="^[0-9]{4,9}$"),
    ),
    field("at", time("When it was put to use.")),
    optional("note", text("The reason.")),
)
_EVENTS = items(
    "The calibrations that were put to use, oldest first.",
    _APPLIED,
    most=_MOST_EVENTS,
    excess=Phrase("problem-many-events", {"most": _MOST_EVENTS}),
)
PROFILE = FileFormat(
    "spherecal/profile",
    PROFILE_FILE,
    "A rig's profile: name, limits, and which calibration was in use when.",
    record(
        "",
        _profile,
        field("name", name("Name of the rig.")),
        optional("validity", replace(_STATED, read=_read_limits), "limits"),
        field("applied", _EVENTS),
        software(),
    ),
    more="profiles.md",
)


def is_profile(folder: Path) -> bool:
    """Whether a folder is (or at least says that it is) a profile."""
    return filesystem.is_plain_file_below(folder, PROFILE_FILE)


def open_profile(folder: Path) -> Profile:
    """The profile in a folder, checked."""
    if not is_profile(folder):
        raise InputError(Phrase("error-no-profile", {"folder": folder}))
    kept = PROFILE.read(folder / PROFILE_FILE, below=folder)
    entries, problems = _read_history(folder)
    applied = _put_to_use(folder, kept.applied, entries)
    return replace(kept, folder=folder, applied=applied, entries=entries, problems=problems)


def _put_to_use(folder: Path, applied: tuple[Applied, ...], entries: dict[str, Entry]) -> tuple[Applied, ...]:
    """Without the last event where its rig never came into rig.json, which is still that of the event before."""
    if len(applied) < 2:
        return applied
    before, last = (entries[e.calibration].files[RIG_FILE] if e.calibration in entries else "" for e in applied[-2:])
    return applied[:-1] if before != last and _copy(folder) == before else applied


def _copy(folder: Path) -> str | None:
    """The hash of a profile's rig.json; None where it cannot be read."""
    try:
        return _sha256(filesystem.read_below(folder, RIG_FILE, _MOST_BYTES))
    except InputError:
        return None


def _read_history(folder: Path) -> tuple[dict[str, Entry], tuple[str, ...]]:
    """The entries by id, and what is wrong with those that cannot be read; folders half written are none of them."""
    entries: dict[str, Entry] = {}
    problems: list[str] = []
    try:
        if filesystem.is_link((folder / HISTORY).lstat()):
            raise InputError(Phrase("error-link-in-profile", {"folder": folder / HISTORY}))
        there = [path for path in (folder / HISTORY).iterdir() if _ID.fullmatch(path.name)]
        found = sorted(there, key=lambda path: (int(path.name), path.name))
    except FileNotFoundError:
        return {}, ()
    except OSError as error:
        raise InputError(Phrase("error-cannot-read", {"file": folder / HISTORY, "why": reason(error)})) from error
    for path in found:
        try:
            if path.is_symlink() or not path.is_dir():
                raise InputError(Phrase("error-not-profiles-folder", {"folder": path}))
            entries[path.name] = read_entry(path)
        except InputError as error:
            problems.append(str(error))
    return entries, tuple(problems)


def create_profile(folder: Path, name: str | None = None, limits: ValidityLimits | None = None) -> Profile:
    """Make an empty profile in a new or empty folder, or open the one there; its name is the folder's by default."""
    if is_profile(folder):
        return open_profile(folder)
    called = name or Path(os.path.abspath(folder)).name
    if problem := name_problem(called):
        raise InputError(Phrase("error-profile-name", {"problem": problem}))
    try:
        if folder.exists() and (
            not folder.is_dir()
            or any(path.name not in (HISTORY, CHECKS) and not path.name.endswith(LOCK) for path in folder.iterdir())
        ):
            raise OutputError(Phrase("error-holds-no-profile", {"folder": folder}))
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _refused(folder, error) from error
    with locked(folder / PROFILE_FILE):
        if not is_profile(folder):  # another program may have made it meanwhile
            filesystem.make_folder_below(folder, HISTORY)
            write_profile(Profile(folder, called, limits or ValidityLimits(), (), {}))
    return open_profile(folder)


def set_limits(folder: Path, **given: float) -> Profile:
    """Change limits of the validity of a profile's calibrations; the others stay."""
    with locked(folder / PROFILE_FILE):
        profile = open_profile(folder)
        write_profile(replace(profile, limits=replace(profile.limits, **given)))
        return open_profile(folder)


def write_profile(profile: Profile) -> None:
    """Replace profile.json whole: the one step by which a profile changes from one state to the next."""
    filesystem.write_below(profile.folder, PROFILE_FILE, PROFILE.bytes(profile), alone=True)  # under the profile's lock


def add_entry(profile: Profile, entry: Entry, files: dict[str, bytes]) -> str:
    """Add a calibration to the history, whole or not at all; its id. The one in use stays in use."""
    root = profile.folder
    new = f"{HISTORY}/.{secrets.token_hex(6)}{filesystem.PARTIAL}"
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    written = {**files, ENTRY_FILE: ENTRY.bytes(replace(entry, files=hashes), software=software_entry(None))}
    try:
        with locked(root / PROFILE_FILE):
            # what crashed processes have left half written, older than an hour (or so far ahead: a clock put back)
            for left in (root / HISTORY).glob(f".*{filesystem.PARTIAL}"):
                try:
                    state = left.lstat()
                    if (
                        not filesystem.is_link(state)
                        and abs(datetime.now(UTC).timestamp() - state.st_mtime) > _LEFT_OVER_SECONDS
                    ):
                        filesystem.remove_own_folder(left)
                except OSError:
                    continue
            filesystem.make_folder_below(root, new)
            for name, data in written.items():
                filesystem.write_new(root, f"{new}/{name}", data, durable=True)
            taken = [int(path.name) for path in (root / HISTORY).iterdir() if _ID.fullmatch(path.name)]
            number = f"{max(taken, default=0) + 1:04d}"
            filesystem.move_below(root, new, f"{HISTORY}/{number}")
            with filesystem.confirming(root / HISTORY / number):
                filesystem.sync(root / HISTORY)
            return number
    except OSError as error:
        raise _refused(root, error) from error
    finally:
        filesystem.remove_own_folder(root / new)


def apply(profile: Profile, calibration: str, note: str = "", despite_findings: bool = False) -> Profile:
    """Put a calibration to use: from one moment to the next, and rig.json becomes a copy of its rig."""
    with saying_what_is_in_use(profile.folder), locked(profile.folder / PROFILE_FILE):
        # opened again: what others have put to use meanwhile is not lost
        return _apply(open_profile(profile.folder), calibration, note, despite_findings)


def _apply(profile: Profile, calibration: str, note: str, despite_findings: bool) -> Profile:
    entry = profile.entry(calibration)
    profile.rig(calibration)
    rig = filesystem.read_below(profile.folder, f"{HISTORY}/{calibration}/{RIG_FILE}", _MOST_BYTES)
    if _sha256(rig) != entry.files[RIG_FILE]:
        raise InputError(Phrase("error-changed-since", {"file": profile.path_of(calibration) / RIG_FILE}))
    if os.path.lexists(profile.folder / RIG_FILE) and not filesystem.is_plain_file_below(profile.folder, RIG_FILE):
        raise InputError(Phrase("error-copy-of-rig", {"file": profile.folder / RIG_FILE}))
    if not entry.valid and not despite_findings:
        raise InputError(Phrase("error-not-put-to-use", {"calibration": calibration}))
    if entry.contradicted and entry.override is None:
        raise InputError(Phrase("error-not-put-to-use-failed", {"calibration": calibration}))
    if entry.care and not note.strip():
        raise InputError(Phrase("error-with-care", {"calibration": calibration, "care": entry.care}))
    event = Applied(calibration, datetime.now(UTC).replace(microsecond=0), note)
    changed = replace(profile, applied=(*profile.applied, event)[-_MOST_EVENTS:])
    filesystem.write_together(profile.folder, {PROFILE_FILE: PROFILE.bytes(changed), RIG_FILE: rig}, alone=True)
    return open_profile(profile.folder)


@contextmanager
def saying_what_is_in_use(folder: Path) -> Iterator[None]:
    """A block that writes into a profile's folder; its OutputErrors say which calibration is in use then."""
    try:
        yield
    except OutputError as error:
        why, hint = error.parts
        used = open_profile(folder).active_id or Phrase("no-calibration")
        raise OutputError(Phrase("error-in-use-now", {"why": why, "calibration": used}), hint) from error


def restore(profile: Profile, calibration: str | None = None, note: str = "") -> Profile:
    """Put an earlier calibration back to use: the one named, else the last valid one that was in use before."""
    chosen = calibration or profile.last_good_id
    if chosen is None:
        raise InputError(Phrase("error-nothing-to-restore", {"folder": profile.folder}))
    return apply(profile, chosen, note or "restored", despite_findings=calibration is not None)


def copy_is_right(profile: Profile) -> bool:
    """Whether rig.json is the copy of the rig in use that it should be: somebody else may have left another."""
    return profile.active is None or _copy(profile.folder) == profile.active.files[RIG_FILE]


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _refused(folder: Path, error: OSError) -> OutputError:
    return OutputError(Phrase("error-profile-not-written", {"folder": folder, "why": reason(error)}))
