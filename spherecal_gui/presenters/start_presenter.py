"""The projects there are, and the validity of the calibration in use."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.errors import SpherecalError
from spherecal_files.filesystem import is_plain_file_below
from spherecal_gui.coverage import Level
from spherecal_gui.in_use import last_verification
from spherecal_gui.languages import error_line, translate, verdict_word, word
from spherecal_gui.project import VERIFIED, Project, usable
from spherecal_gui.project_folder import FILE, TRAINING_PROFILE, load_project, recent_projects
from spherecal_gui.standing import worst
from spherecal_rigs.kept_checks import last_check

if TYPE_CHECKING:
    from spherecal_rigs.entry import Entry
    from spherecal_rigs.store import Profile


@dataclass(frozen=True)
class ProjectLine:
    """One project in the list: when it was touched last, how far it came, where its images come from."""

    folder: Path
    title: str
    where: str
    source: str
    level: Level
    calibrated: bool
    simulated: bool = False


def picture_of(profile: Path, number: str | None) -> Path:
    """The picture of the rig as one of its calibrations has it, in the profile's folder."""
    own = profile / picture_name(number or "")
    return own if own.is_file() else profile / "picture.png"  # profiles saved before each had its own


def picture_name(number: str) -> str:
    """The name of a calibration's picture."""
    return f"picture-{number}.png"


# What can go wrong on the simulated demo rig, for training: the fault as simulated/simulated_source.py reads it.
SURPRISE = "surprise"
FAULTS = ("", "bump:C03:0.3@3", "lose:C04@2-2", "blur:C05:3", "dim:C02:0.05", "delay:C06@2-3")

_LEVELS: dict[str, Level] = {"valid": "good", "use-with-care": "caution", "not-valid": "bad"}


@dataclass(frozen=True)
class ProfileRow:
    """One calibration of the rig's profile."""

    number: str
    made: str
    state: str
    level: Level
    verdict: str
    verdict_level: Level
    rms_px: float | None
    in_use: bool
    valid: bool = True
    refused: bool = False

    @property
    def verified(self) -> bool:
        """Whether it is known to be good."""
        return self.level == "good" and self.verdict_level == "good"


def source_word(source: str) -> str:
    """LIVE, REPLAY or SIMULATED."""
    kind = source.partition(":")[0]
    return {"simulated": translate("Source", "SIMULATED"), "replay": translate("Source", "REPLAY")}.get(
        kind, translate("Source", "LIVE")
    )


def project_lines(parent: Path) -> list[ProjectLine]:
    """The projects in a folder, the newest first; one that cannot be read says so."""
    return [_line(folder) for folder in recent_projects(parent)]


def _line(folder: Path) -> ProjectLine:
    moment = datetime.fromtimestamp((folder / FILE).stat().st_mtime)
    title = f"{moment:%Y-%m-%d %H:%M}  {folder.name}"
    try:
        project = load_project(folder)
    except (SpherecalError, ValueError, KeyError) as error:
        return ProjectLine(folder, title, error_line(error), "", "bad", calibrated=False)
    where, level = progress_text(project)
    calibrated = project.purpose == "calibrate" and project.calibrated is not None
    return ProjectLine(folder, title, where, source_word(project.source), level, calibrated, project.simulated)


def progress_text(project: Project) -> tuple[str, Level]:
    """How far a project came."""
    if project.purpose == "check":
        return _checked_text(project)
    if project.verified is not None:
        return _verified_text(project.verified.verdict)
    if project.calibrated is not None and not usable(project.calibrated.verdict):
        return translate("Start", "calibrated, not valid"), "bad"
    if project.calibrated is not None:
        return translate("Start", "calibrated, not verified"), "caution"
    taken = sum(name in project.taken for name in project.placements)
    text = translate("Start", "{taken} of {planned} placements captured")
    return text.format(taken=taken, planned=len(project.placements)), "none"


def _verified_text(verdict: str) -> tuple[str, Level]:
    if verdict in VERIFIED:
        return translate("Start", "verified"), "good"
    if verdict in ("undecided", "no data"):
        return translate("Start", "verified, undecided"), "caution"
    return translate("Start", "the check bar contradicts it"), "bad"


def _checked_text(project: Project) -> tuple[str, Level]:
    if project.checked is None:
        return translate("Start", "check begun"), "none"
    levels: dict[str, Level] = {"ok": "good", "watch": "caution"}
    text = translate("Start", "checked: {verdict}").format(verdict=verdict_word(project.checked.verdict))
    return text, levels.get(project.checked.verdict, "bad")


def validity_of(profile: Path) -> tuple[str, Level, str]:
    """The chip of the rig's profile: word, colour, details; heavy imports only where there is a profile."""
    none = translate("Validity", "no calibration in use")
    if not (profile / "profile.json").is_file():
        return none, "none", ""
    from spherecal_rigs.store import open_profile  # imports scipy

    try:
        kept = open_profile(profile)
    except SpherecalError as error:
        return translate("Validity", "profile cannot be read"), "bad", error_line(error)
    if kept.active is None:
        return none, "none", "; ".join(kept.validity().reasons)
    found = kept.validity()
    judged = _judged(kept, kept.active)
    level = worst(one for one, _ in judged)
    word = next(text for one, text in judged if one == level)
    ages = translate("Validity", "{minutes} min old"), translate("Validity", "{hours} h old")
    age = _ago(kept.active.calibrated_at, *ages, translate("Validity", "{days} days old"))
    word = f"{word} · {age}"
    if profile.name == TRAINING_PROFILE and kept.active is not None:
        # green would pass for a calibration of the real rig from three metres
        simulated = translate("Source", "SIMULATED")
        word, level = f"{simulated} · {word}", "caution" if level == "good" else level
    made = f"{kept.active.calibrated_at.astimezone():%Y-%m-%d %H:%M}"
    when = translate("Validity", "Calibration {number} of {made}").format(number=kept.active_id, made=made)
    return word, level, "; ".join(one for one in (when, kept.active.note, *found.reasons) if one)


def _ago(calibrated: datetime, minutes: str, hours: str, days: str) -> str:
    """How long ago, in one of these texts."""
    passed = max((datetime.now(UTC) - calibrated).total_seconds() / 3600, 0.0)
    if passed < 1:
        return minutes.format(minutes=round(60 * passed))
    return hours.format(hours=round(passed)) if passed < 48 else days.format(days=round(passed / 24))


def _judged(kept: "Profile", entry: "Entry") -> list[tuple[Level, str]]:
    """What there is to say of the calibration in use, what was measured of it before how old it is."""
    from spherecal_rigs.calibration_age import validity  # imports scipy

    last = last_verification(kept.folder, kept.active_id)
    verdict = last.verdict if last is not None else _entry_verdict(entry)
    check = last_check(kept.folder, kept.active_id)
    of_check: dict[str, tuple[Level, str]] = {
        "recalibrate": ("bad", translate("Validity", "check: recalibrate")),
        "watch": ("caution", translate("Validity", "check: watch it")),
    }
    of_age: dict[str, tuple[Level, str]] = {
        "fresh": ("good", translate("Validity", "calibration fresh")),
        "ageing": ("caution", translate("Validity", "calibration ageing")),
    }
    old: tuple[Level, str] = ("bad", translate("Validity", "calibration out of date"))
    judged: list[tuple[Level, str]] = []
    if not entry.valid:
        judged.append(("bad", translate("Validity", "calibration not valid")))
    if check is not None and check.verdict in of_check:
        judged.append(of_check[check.verdict])
    if verdict is None:
        judged.append(("caution", translate("Validity", "calibration not verified")))
    elif verdict in ("undecided", "no data"):
        judged.append(("caution", translate("Validity", "verification undecided")))
    elif verdict not in VERIFIED:
        judged.append(("bad", translate("Validity", "the check bar contradicts it")))
    if entry.care:
        judged.append(("caution", translate("Validity", "to be used with care")))
    age = validity(replace(entry, valid=True, care="", verdict=None, failed=False), kept.limits)
    return [*judged, of_age.get(age.state, old)]


def _entry_verdict(entry: "Entry") -> str | None:
    """The verdict of a calibration's verification, as projects have it: a limit that is exceeded is no agreement."""
    return "inconsistent" if entry.contradicted else entry.verdict


@dataclass(frozen=True)
class InUse:
    """The calibration in use in words: its number, how old it is, how it was verified last, when a check is due."""

    number: str
    age: str
    verified: str
    next_check: str


def _opened(profile: Path) -> "Profile | None":
    """The profile in a folder; None where there is none that can be read: then nothing heavy is imported."""
    if not is_plain_file_below(profile, "profile.json"):
        return None
    from spherecal_rigs.store import open_profile  # imports scipy

    try:
        return open_profile(profile)
    except SpherecalError:
        return None


def in_use(profile: Path) -> InUse | None:
    """The calibration in use; None where there is none, or where it cannot be read."""
    kept = _opened(profile)
    if kept is None or kept.active is None or kept.active_id is None:
        return None
    entry, number = kept.active, kept.active_id
    due = entry.calibrated_at + timedelta(hours=kept.limits.ageing_hours)  # by the profile's limits
    check = translate("Start", "Check the rig again by {at}.").format(at=f"{due.astimezone():%Y-%m-%d %H:%M}")
    ages = translate("Start", "Calibrated {minutes} minutes ago"), translate("Start", "Calibrated {hours} hours ago")
    age = _ago(entry.calibrated_at, *ages, translate("Start", "Calibrated {days} days ago"))
    return InUse(number, age, _verified_at(profile, number, entry), check)


def _verified_at(profile: Path, number: str, entry: "Entry") -> str:
    """When and how it was verified last."""
    if (last := last_verification(profile, number)) is not None:
        text = translate("Start", "Calibration {number}, verified {at}: {verdict}")
        at = f"{last.at.astimezone():%Y-%m-%d %H:%M}"
        return text.format(number=number, at=at, verdict=verdict_word(last.verdict))
    if entry.verdict is None:
        return translate("Start", "Calibration {number}, not verified yet").format(number=number)
    text = translate("Start", "Calibration {number}: {verdict}")
    return text.format(number=number, verdict=verdict_word(_entry_verdict(entry) or ""))


def profile_rows(folder: Path) -> list[ProfileRow]:
    """The calibrations of the rig's profile, newest first; empty where there is none that can be read."""
    kept, rows = _opened(folder), []
    if kept is None:
        return []
    for number, entry in reversed(kept.entries.items()):
        made = f"{entry.calibrated_at.astimezone():%Y-%m-%d %H:%M}"
        state = word("calibrations", entry.calibration_verdict), _LEVELS[entry.calibration_verdict]
        shown = *state, *_verified(_entry_verdict(entry)), entry.rms_px, number == kept.active_id
        refused = entry.contradicted and entry.override is None
        rows.append(ProfileRow(number, made, *shown, entry.valid, refused))
    return rows


def _verified(verdict: str | None) -> tuple[str, Level]:
    if verdict is None:
        return translate("Profile", "not verified"), "caution"
    return verdict_word(verdict), "good" if verdict in VERIFIED else "bad"
