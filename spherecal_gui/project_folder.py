"""A project on disk: `wizard.json` in the session's folder, written whole at every step.

What was taken is not in it: capture.json beside the images says that, so that a crash between the two loses nothing.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path
from typing import Any, get_args

from spherecal.base import filesystem as files
from spherecal.base.errors import InputError, OutputError, reason
from spherecal.base.filesystem import (
    PARTIAL,
    is_plain_file_below,
    move_below,
    read_below,
    remove_own_folder,
    write_below,
)
from spherecal.base.messages.values import Phrase
from spherecal.files.json_file import JsonValue, read_json
from spherecal_gui.project import Artefacts, Flaw, FlawCode, Project, Purpose, Rectangle, Run, Verdict

FORMAT = "spherecal/wizard"
# What is simulated keeps a profile of its own: it must never pass for the calibration of the rig.
PROFILE, TRAINING_PROFILE = "rig-profile", "training-profile"
VERSION = 1
FILE = "wizard.json"
_FOLDERS = ("result", "repair", "verification", "placements", "bars", "removed", "wizard")
CAPTURE = "capture.json"  # spherecal.cameras.capture, which takes a second to import
_MOST_BYTES = 64 << 20
_RUNS = ("calibrated", "accepted", "verified", "saved", "checked", "repaired")
_OPTIONAL = (
    "bench", "artefacts", "failures", "repairs", "purpose", "masks", "limit", "pose_bars", "bar_celsius", "flaws",
    "note",
)  # fmt: skip
_IDS = ("placements", "scale_poses", "check_poses")
_LISTS = ("cameras", "looked", *_IDS)


def is_project(folder: Path) -> bool:
    """Whether the wizard has worked in this folder."""
    return is_plain_file_below(folder, FILE)


def save_project(project: Project) -> None:
    """Write wizard.json; OutputError if that fails."""
    document: dict[str, Any] = {"format": FORMAT, "version": VERSION, "source": project.source, "bench": project.bench}
    document["purpose"] = project.purpose
    document["step"] = project.step
    document |= {key: list(getattr(project, key)) for key in _LISTS}
    document["artefacts"] = asdict(project.artefacts) if project.artefacts else None
    for key in _RUNS:
        run = getattr(project, key)
        document[key] = {"inputs": [list(pair) for pair in run.inputs], "verdict": run.verdict} if run else None
    document["failures"] = dict(project.failures)
    document["repairs"] = [list(pair) for pair in project.repairs]
    document["masks"] = [{"camera": camera, "rectangle": list(rectangle)} for camera, rectangle in project.masks]
    document["limit"], document["bar_celsius"] = project.limit, project.bar_celsius
    document["pose_bars"] = [list(pair) for pair in project.pose_bars]
    document["note"] = project.note
    document["flaws"] = [
        {"set": one.set_id, "taken": one.taken, "code": one.code, "cameras": list(one.cameras), "kept": one.kept}
        for one in project.flaws
    ]
    try:
        project.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = Phrase("error-cannot-write", {"file": str(project.folder), "why": reason(error)})
        raise OutputError(what, Phrase("error-choose-folder")) from error
    write_below(project.folder, FILE, (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode())


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
    f = read_json(folder / FILE, FORMAT, VERSION, below=folder).fields(
        ("source", "step", *_LISTS), (*_OPTIONAL, *_RUNS)
    )
    lists: dict[str, Any] = {
        key: tuple(one.id() if key in _IDS else one.text() for one in f[key].items()) for key in _LISTS
    }
    runs: dict[str, Any] = {key: _run(f[key]) for key in _RUNS if key in f}
    project = Project(
        folder=folder,
        source=f["source"].text(),
        bench=_text(f, "bench"),
        step=f["step"].text(),
        taken=taken_in(folder),
        artefacts=_artefacts(f["artefacts"]) if "artefacts" in f else None,
        failures={key: text.prose() for key, text in f["failures"].entries().items()} if "failures" in f else {},
        purpose=_purpose(_text(f, "purpose")),
        repairs=_pairs(f, "repairs"),
        pose_bars=_pairs(f, "pose_bars"),
        masks=tuple(_mask(one) for one in f["masks"].items()) if "masks" in f else (),
        limit=_text(f, "limit"),
        bar_celsius=f["bar_celsius"].number(-100, 200, "degrees Celsius") if "bar_celsius" in f else None,
        flaws=tuple(_flaw(one) for one in f["flaws"].items()) if "flaws" in f else (),
        note=_text(f, "note"),
        **lists,
        **runs,
    )
    return _as_on_disk(project)


def _purpose(text: str) -> Purpose:
    return next((one for one in get_args(Purpose) if one == text), "calibrate")


def _mask(entry: Any) -> tuple[str, Rectangle]:
    f = entry.fields(("camera", "rectangle"))
    left, top, width, height = f["rectangle"].numbers(4)
    return f["camera"].text(), (left, top, width, height)


def _flaw(entry: JsonValue) -> Flaw:
    f = entry.fields(("set", "taken", "code", "cameras", "kept"))
    code: FlawCode = f["code"].choice(*get_args(FlawCode))
    cameras = tuple(one.text() for one in f["cameras"].items())
    return Flaw(f["set"].id(), f["taken"].text(), code, cameras, f["kept"].boolean())


def _pairs(f: Mapping[str, Any], key: str) -> tuple[tuple[str, str], ...]:
    return tuple(_pair(one) for one in f[key].items()) if key in f else ()


def _pair(entry: JsonValue) -> tuple[str, str]:
    first, second = (one.prose() for one in entry.items(2))
    return first, second


def _text(f: Mapping[str, JsonValue], key: str) -> str:
    """An optional text, which may be empty."""
    return f[key].prose() if key in f else ""


def _artefacts(entry: JsonValue) -> Artefacts:
    f = entry.fields((), ("target_set", "ball", "scale", "scale_bar", "check_bars", "check", "board"))
    return Artefacts(
        _text(f, "target_set"),
        _text(f, "ball"),
        _text(f, "scale"),
        f["scale_bar"].prose() if "scale_bar" in f else None,
        tuple(one.prose() for one in f["check_bars"].items()) if "check_bars" in f else (),
        _text(f, "check"),
        "board" in f and f["board"].boolean(),
    )


def _run(entry: JsonValue) -> Run:
    f = entry.fields(("inputs", "verdict"))
    return Run(tuple(_pair(one) for one in f["inputs"].items()), f["verdict"].choice(*get_args(Verdict)))


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


def _as_on_disk(project: Project) -> Project:
    """Without a result that is no longer there, and without planned sets of an unknown kind."""
    if project.calibrated is not None and not (project.result_folder / "rig.json").is_file():
        project = replace(project, calibrated=None, accepted=None, verified=None)
    if project.repaired is not None and not (project.repair_folder / "rig.json").is_file():
        project = replace(project, repaired=None)
    if project.verified is not None and not (project.result_folder / "verification.json").is_file():
        project = replace(project, verified=None)
    return project


def new_folder(parent: Path, now: datetime, purpose: str = "calibration") -> Path:
    """A folder that is not there yet, named by what it is for, the day and the time."""
    base = parent / f"{purpose}-{now:%Y-%m-%d-%H%M}"
    folder, number = base, 2
    while folder.exists():
        folder, number = base.with_name(f"{base.name}-{number}"), number + 1
    return folder


_BOARD_PLACEMENTS = 12  # each of six cameras around a volume then sees the board four times, two at a time


def write_bench(projects: Path, board: Mapping[str, Any]) -> Path:
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
