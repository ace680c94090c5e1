"""A project on disk: `wizard.json`, written whole at every step; what was taken is said by capture.json alone."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import fields, replace
from datetime import datetime
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any, get_args

from spherecal.base.errors import InputError, OutputError, reason
from spherecal.base.messages.values import Phrase
from spherecal_files import filesystem as files
from spherecal_files.codec import (
    FileFormat,
    Kind,
    boolean,
    choice,
    entries,
    field,
    identifier,
    items,
    number,
    numbers,
    optional,
    prose,
    record,
    text,
)
from spherecal_files.filesystem import (
    PARTIAL,
    is_plain_file_below,
    move_below,
    read_below,
    remove_own_folder,
    write_below,
)
from spherecal_files.json_file import JsonValue
from spherecal_gui.project import (
    Artefacts,
    Computation,
    Flaw,
    FlawCode,
    Project,
    Purpose,
    Verdict,
    fingerprint,
)

# What is simulated keeps a profile of its own: it must never pass for the calibration of the rig.
PROFILE, TRAINING_PROFILE = "rig-profile", "training-profile"
FILE = "wizard.json"
_FOLDERS = ("result", "repair", "verification", "placements", "bars", "removed", "wizard")
CAPTURE = "capture.json"  # spherecal_cameras.capture, which takes a second to import
_MOST_BYTES = 64 << 20

Document = dict[str, Any]  # a JSON object, such as session.json: json itself gives Any


_ARTEFACTS = record(
    "What somebody has confirmed: words for people, and the bars.",
    Artefacts,
    optional("target_set", prose("The targets.")),
    optional("ball", prose("The ball.")),
    optional("scale", prose("What gives the scale.")),
    optional("scale_bar", prose("Id of the bar that gives it.")),
    optional("check_bars", items("Ids of the bars that verify.", prose(""))),
    optional("check", prose("The check bars.")),
    optional("board", boolean("Whether a board calibrates, not a ball.")),
)
_PAIR = items("", prose(""), length=2)


def _run(about: str) -> Kind[Computation]:
    return record(
        f"The last {about}.",
        Computation,
        field("inputs", items("What it was made of.", _PAIR)),
        field("verdict", choice("Its verdict.", get_args(Verdict))),
    )


_MASK = record(
    "",
    lambda camera, rectangle: (camera, rectangle),
    replace(field("camera", text("The camera.")), get=itemgetter(0)),
    replace(field("rectangle", numbers("`[left, top, width, height]` in px.", 4)), get=itemgetter(1)),
)
_FLAW = record(
    "",
    Flaw,
    field("set", identifier("The set."), "set_id"),
    field("taken", text("When it was taken.")),
    field("code", choice("What is wrong.", get_args(FlawCode))),
    field("cameras", items("The cameras.", text(""))),
    field("kept", boolean("Whether somebody keeps it so.")),
)


def _by_content(document: Document) -> Document:
    """Version 1 knew inputs by their repr: their fingerprints instead. A damaged document is left to the reader."""
    try:
        return _with_fingerprints(document)
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError):
        return document


def _with_fingerprints(document: Document) -> Document:
    drawn = sorted((one["camera"], tuple(map(float, one["rectangle"]))) for one in document.get("masks") or ())
    known = {repr(None): fingerprint(None), repr(drawn): fingerprint(drawn)}
    if document.get("artefacts") is not None:
        given: Document = dict(document["artefacts"])
        given["check_bars"] = tuple(given.get("check_bars") or ())
        artefacts = Artefacts(**given)
        words = {one.name: getattr(artefacts, one.name) for one in fields(artefacts) if one.name != "board"}
        known[f"Artefacts({_arguments(words)})"] = fingerprint(artefacts)
    for key in ("calibrated", "accepted", "checked", "verified", "repaired", "saved"):  # what follows from others last
        run: Document | None = document.get(key)
        if run is None or not isinstance(run["inputs"], list) or not all(isinstance(x, list) for x in run["inputs"]):
            continue
        was = Computation(tuple((name, text) for name, text in run["inputs"]), run["verdict"])
        now = replace(was, inputs=tuple((name, known.get(text, text)) for name, text in was.inputs))
        known[f"Run({_arguments(vars(was))})"] = fingerprint(now)
        document = document | {key: run | {"inputs": [list(pair) for pair in now.inputs]}}
    return document


def _arguments(values: Mapping[str, object]) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in values.items())


_PURPOSES = "`calibrate`, `check` or `verify`; anything else counts as `calibrate`."
_METHODS = "`tao2021`: the paper's method; anything else counts as our own."
WIZARD = FileFormat(
    "spherecal/wizard",
    FILE,
    "Where the wizard is in a project.",
    record(
        "",
        partial(Project, Path()),
        field("source", text("Where images come from.")),
        optional("bench", prose("The file that describes targets, ball and bars.")),
        optional("purpose", prose(_PURPOSES).mapped(lambda text: text if text in get_args(Purpose) else "calibrate")),
        field("step", text("The step.")),
        field("cameras", items("Serial numbers of the chosen cameras.", text(""))),
        field("looked", items("Those that were looked at.", text(""))),
        field("placements", items("Planned placements of the ball.", identifier(""))),
        field("scale_poses", items("Planned poses of the scale bar.", identifier(""))),
        field("check_poses", items("Planned poses of the check bars.", identifier(""))),
        optional("artefacts", _ARTEFACTS),
        optional("calibrated", _run("calibration")),
        optional("accepted", _run("accepted calibration")),
        optional("verified", _run("verification")),
        optional("saved", _run("calibration put to use")),
        optional("checked", _run("quick check")),
        optional("repaired", _run("repair")),
        optional("failures", entries("Errors of the last attempts by step.", prose(""))),
        optional("repairs", items("Options of the next calibration with their values.", _PAIR)),
        optional("masks", items("Parts of images in which nothing is a target.", _MASK)),
        optional("limit", prose("Limit of the length errors.")),
        optional("bar_celsius", number("Temperature of the bars in degrees Celsius.", -100, 200, "degrees Celsius")),
        optional("pose_bars", items("Which bar a pose is of.", _PAIR)),
        optional("note", prose("What the operator has written.")),
        optional("method", prose(_METHODS).mapped(lambda text: text if text == "tao2021" else "")),
        optional("flaws", items("What is wrong with a set.", _FLAW)),
    ),
    version=2,
    migrations={1: _by_content},
)


def is_project(folder: Path) -> bool:
    """Whether the wizard has worked in this folder."""
    return is_plain_file_below(folder, FILE)


def require_project(folder: Path) -> None:
    """Raise OutputError where the project's folder is gone: what was captured before is not there any more either."""
    if not is_project(folder):
        raise OutputError(Phrase("error-project-gone", {"folder": folder}))


def save_project(project: Project) -> None:
    """Write wizard.json; OutputError if that fails."""
    try:
        project.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = Phrase("error-cannot-write", {"file": str(project.folder), "why": reason(error)})
        raise OutputError(what, Phrase("error-choose-folder")) from error
    write_below(project.folder, FILE, WIZARD.bytes(project))


def check_folders(folder: Path) -> None:
    """Raise InputError where one of a project's own folders is a link: what is written there would go elsewhere."""
    for name in _FOLDERS:
        if os.path.lexists(folder / name) and (files.is_link((folder / name).lstat()) or not (folder / name).is_dir()):
            raise InputError(Phrase("error-not-projects-folder", {"folder": folder / name}))


def load_project(folder: Path) -> Project:
    """The project in a folder as it was when it was left, with what is really on disk; InputError where it is none."""
    if not is_project(folder):
        raise InputError(Phrase("error-no-project", {"folder": folder, "file": FILE}))
    check_folders(folder)
    project = WIZARD.read(folder / FILE, below=folder)
    project = replace(project, folder=folder, taken=taken_in(folder))
    if project.calibrated is not None and not (project.result_folder / "rig.json").is_file():
        project = replace(project, calibrated=None, accepted=None, verified=None)
    if project.repaired is not None and not (project.repair_folder / "rig.json").is_file():
        project = replace(project, repaired=None)
    if project.verified is not None and not (project.result_folder / "verification.json").is_file():
        project = replace(project, verified=None)
    return project


def taken_in(folder: Path) -> dict[str, str]:
    """The sets that capture.json and that of the check bars name: id -> moment of taking."""
    taken: dict[str, str] = {}
    for relative in (CAPTURE, f"verification/{CAPTURE}"):
        if not (folder / relative).exists():
            continue
        try:
            document = JsonValue(json.loads(read_below(folder, relative, _MOST_BYTES)), folder / relative)
            fields = [one.fields(("id", "taken", "images")) for one in document.fields(("sets",))["sets"].items()]
            taken |= {f["id"].id(): f["taken"].text() for f in fields if f["images"].value}
        except (InputError, ValueError, RecursionError) as error:
            other = Phrase("error-cannot-read", {"file": folder / relative, "why": str(error)})
            why = error.parts[0] if isinstance(error, InputError) else other
            raise InputError(why, Phrase("error-restore-backup")) from error
    return taken


def new_folder(parent: Path, now: datetime, purpose: str = "calibration") -> Path:
    """A folder that is not there yet, named by what it is for, the day and the time."""
    base = parent / f"{purpose}-{now:%Y-%m-%d-%H%M}"
    folder, number = base, 2
    while folder.exists():
        folder, number = base.with_name(f"{base.name}-{number}"), number + 1
    return folder


_BOARD_PLACEMENTS = 12  # each of six cameras around a volume then sees the board four times, two at a time


def write_bench(projects: Path, board: Mapping[str, object]) -> Path:
    """The description of a bench with nothing but a board on it, among the projects; one file for each board."""
    placements = [{"id": f"P{number:02d}"} for number in range(1, _BOARD_PLACEMENTS + 1)]
    document = {"format": "spherecal/session", "version": 1, "board": dict(board), "placements": placements}
    data = json.dumps(document, indent=1).encode()
    name = f"boards/{board['kind']}-{hashlib.sha256(data).hexdigest()[:8]}.json"
    write_below(projects, name, data)
    return projects / name


def remove_if_empty(project: Project) -> None:
    """Remove the folder of a project that never had a camera: an opening that failed leaves nothing behind."""
    if project.cameras or project.taken or project.artefacts is not None or project.calibrated is not None:
        return
    try:
        if all(FILE in path.name for path in project.folder.iterdir()):  # with its lock
            discard(project.folder)
    except OSError:
        return


def discard(folder: Path) -> None:
    """Remove a project's folder that was only just made."""
    aside = f".{folder.name}{PARTIAL}"
    move_below(folder.parent, folder.name, aside)
    remove_own_folder(folder.parent / aside)


def recent_projects(parent: Path, most: int = 8) -> list[Path]:
    """The projects in a folder, the newest first; unreadable ones are left out."""
    try:
        found = [path.parent for path in parent.glob(f"*/{FILE}")]
        there = [folder for folder in found if is_project(folder)]  # a link to nowhere hides no other project
        return sorted(there, key=lambda folder: -(folder / FILE).stat().st_mtime)[:most]
    except OSError:
        return []


def profile_of(project: Project) -> Path:
    """The profile of what a project calibrates: one for each place where projects are kept, another for training."""
    return project.folder.parent / (TRAINING_PROFILE if project.simulated else PROFILE)


def rig_bench(projects: Path) -> Path:
    """The file that describes the rig's bench, for all its calibrations; it may not be there."""
    return projects / "bench" / "bench.json"


def profile_shown(projects: Path) -> Path:
    """The rig's profile; where there is none yet, that of training."""
    rig, training = projects / PROFILE, projects / TRAINING_PROFILE
    return training if not (rig / "profile.json").is_file() and (training / "profile.json").is_file() else rig
