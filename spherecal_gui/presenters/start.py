"""The projects there are, and the validity of the calibration in use."""

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from PySide6.QtCore import QCoreApplication

from spherecal.errors import SpherecalError
from spherecal_gui.presenters.coverage import Level
from spherecal_gui.project import Project
from spherecal_gui.project_folder import FILE, load_project, recent_projects

translate = QCoreApplication.translate


@dataclass(frozen=True)
class ProjectLine:
    """One project in the list: when it was touched last, how far it came, where its images come from."""

    folder: Path
    title: str
    where: str
    source: str
    level: Level
    calibrated: bool


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
        return ProjectLine(folder, title, str(error), "", "bad", calibrated=False)
    where, level = progress_text(project)
    return ProjectLine(folder, title, where, source_word(project.source), level, project.calibrated is not None)


def progress_text(project: Project) -> tuple[str, Level]:
    """How far a project came."""
    if project.verified is not None and project.verified.verdict == "consistent":
        return translate("Start", "verified"), "good"
    if project.verified is not None:
        return translate("Start", "the check bar contradicts it"), "bad"
    if project.calibrated is not None and project.calibrated.verdict != "valid":
        return translate("Start", "calibrated, not valid"), "bad"
    if project.calibrated is not None:
        return translate("Start", "calibrated, not verified"), "caution"
    taken = sum(name in project.taken for name in project.placements)
    text = translate("Start", "{taken} of {planned} placements taken")
    return text.format(taken=taken, planned=len(project.placements)), "none"


def validity_of(profile: Path) -> tuple[str, Level, str]:
    """The chip of the rig's profile: word, colour, details; heavy imports only where there is a profile."""
    none = translate("Validity", "no calibration in use")
    if not (profile / "profile.json").is_file():
        return none, "none", ""
    from spherecal.profile.store import open_profile
    from spherecal.profile.validity import validity

    try:
        kept = open_profile(profile)
    except SpherecalError as error:
        return translate("Validity", "profile cannot be read"), "bad", str(error)
    found = validity(kept.active, kept.limits)
    words: dict[str, tuple[str, Level]] = {
        "fresh": (translate("Validity", "calibration fresh"), "good"),
        "ageing": (translate("Validity", "calibration ageing"), "caution"),
        "stale": (translate("Validity", "calibration out of date"), "bad"),
        "none": (none, "none"),
    }
    word, level = words[found.state]
    return word, level, "; ".join(found.reasons)
