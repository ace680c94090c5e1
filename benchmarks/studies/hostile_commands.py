"""The commands that are given hostile inputs."""

import os
import random
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.studies.hostile_inputs import Ground, spoil
from spherecal_app.cli.main import entry

# Half a second to two each, drawing or computing: as often as the others they would take most of the time.
_SLOW = {"report pdf", "report html", "report xml", "batch", "guide", "recalibrate", "licences", "profile trend"}
_SELDOM = 0.15


@dataclass(frozen=True)
class Command:
    """What is copied and may be made hostile, the words, and which of the copies the command may change."""

    inputs: tuple[str, ...]
    words: str
    changes: tuple[str, ...] = ()
    ending: str = ""  # of the output's name


@dataclass(frozen=True)
class Try:
    """A command on hostile inputs."""

    name: str
    run: Callable[[], int]
    untouched: tuple[Path, ...]


def make_output(ground: Ground, name: str, chance: random.Random) -> Path:
    """Where to write: mostly a free name in `out`, else something hostile there, or a folder of the user's."""
    shutil.rmtree(ground.out, ignore_errors=True)
    ground.out.mkdir()
    path = ground.out / name
    match chance.randrange(24):
        case 0:
            path.symlink_to(chance.choice([ground.precious, ground.precious / "secret.key", ground.out / "nowhere"]))
        case 1:
            os.mkfifo(path)
        case 2:
            shutil.copytree(ground.valid / "result1", path)
            (path / ".git").symlink_to(ground.precious / ".git")
        case 3:
            path = ground.out / ("n" * 300)
        case 4:
            path = path / ".." / ".." / "out" / name
        case 5:
            path.mkdir()
            (path / "notes.txt").write_text("the user's")
        case 6:
            path = Path(chance.choice((".", "..", "/", "./.", "")))
        case 7:
            path = chance.choice(
                (ground.precious, ground.precious / "secret.key" / "o", Path("/dev/full"), Path("/proc/x"))
            )
        case 8:
            path = ground.out / chance.choice(
                ("ü" * 127, "\udcff", "a\nb", "o. ", "-o", "=x", "con", "\U0001d4b3" * 63)
            )
        case 9:
            shutil.copytree(ground.valid / "result1", path)
        case _:
            pass
    return path


def make_try(ground: Ground, chance: random.Random, names: Sequence[str] = ()) -> Try:
    """A hostile input and the command that is given it, one of `names` (any without)."""
    shutil.rmtree(ground.given, ignore_errors=True)
    names = names or list(COMMANDS)
    name = chance.choices(names, [_SELDOM if one in _SLOW else 1.0 for one in names])[0]
    command = COMMANDS[name]
    ground.given.mkdir()
    for one in command.inputs:
        source = ground.valid / one
        (shutil.copytree if source.is_dir() else shutil.copy)(source, ground.given / one)
    if command.inputs and chance.random() < 0.85:  # else only the output is hostile
        spoil(ground, ground.given / chance.choice(command.inputs), chance)
    out = make_output(ground, f"o{command.ending}", chance)
    untouched = tuple(ground.given / one for one in command.inputs if one not in command.changes)
    if not command.words:
        return Try(name, lambda: open_in_window(ground.given / "project"), untouched)
    arguments = [word.format(given=ground.given, out=out, valid=ground.valid) for word in command.words.split()]

    def run() -> int:
        os.chdir(ground.here)
        sys.argv = ["spherecal", *arguments]
        return entry()

    return Try(name, run, untouched)


COMMANDS: dict[str, Command] = {
    "calibrate": Command(("session",), "calibrate {given}/session -o {out} --method rigid"),
    "calibrate images": Command(("pictures",), "calibrate {given}/pictures -o {out}"),
    "calibrate bundle": Command(("b.zip",), "calibrate {given}/b.zip -o {out} --method rigid"),
    "calibrate ball": Command(("session", "ball.json"), "calibrate {given}/session -o {out} --ball {given}/ball.json"),
    "recalibrate": Command(
        ("session", "result1"), "recalibrate {given}/session --rig {given}/result1/rig.json --only C05 -o {out}"
    ),
    "verify": Command(("session", "result1"), "verify {given}/session --rig {given}/result1/rig.json -o {out}"),
    "verify into": Command(
        ("session", "result1"), "verify {given}/session --rig {given}/result1/rig.json -o {given}/result1", ("result1",)
    ),
    "batch": Command(("session", "pictures"), "batch {given} -o {out} --method rigid --workers 0"),
    "guide": Command(("session",), "guide {given}/session --picture {out}", ending=".png"),
    "report html": Command(("result1",), "report {given}/result1 -o {out}", ending=".html"),
    "report pdf": Command(
        ("result1", "session"), "report {given}/result1 -o {out} --session {given}/session", ending=".pdf"
    ),
    "report json": Command(("result1",), "report {given}/result1 -o {out}", ending=".json"),
    "report xml": Command(
        ("result1", "issuer.json"), "report {given}/result1 -o {out} --issuer {given}/issuer.json", ending=".xml"
    ),
    "export opencv": Command(("result1",), "export {given}/result1/rig.json --to opencv -o {out}"),
    "export csv": Command(("result1",), "export {given}/result1/rig.json --to csv -o {out}"),
    "export colmap": Command(("result1",), "export {given}/result1/rig.json --to colmap -o {out} --max-loss 1000"),
    "export metashape": Command(
        ("result1",), "export {given}/result1/rig.json --to metashape -o {out} --max-loss 1000"
    ),
    "export gltf": Command(("result1",), "export {given}/result1/rig.json --to gltf -o {out}", ending=".gltf"),
    "import colmap": Command(("colmap",), "import {given}/colmap --format colmap -o {out}", ending=".json"),
    "import opencv": Command(("priors.yml",), "import {given}/priors.yml --format opencv -o {out}", ending=".json"),
    "session new": Command(
        ("pictures",), "session new {out} --images {given}/pictures/placements --targets {given}/pictures/targets.json"
    ),
    "priors colmap": Command(("session", "colmap"), "import-priors {given}/colmap --session {given}/session -o {out}"),
    "priors yml": Command(
        ("session", "priors.yml"), "import-priors {given}/priors.yml --session {given}/session -o {out}"
    ),
    "profile show": Command(("profile",), "profile show {given}/profile"),
    "profile list": Command(("profile",), "profile list {given}"),
    "profile apply": Command(("profile",), "profile apply {given}/profile 0001 --note x", ("profile",)),
    "profile save": Command(("profile", "result1"), "profile save {given}/result1 --to {given}/profile", ("profile",)),
    "profile new": Command(("result1", "session"), "profile save {given}/result1 --to {out} --session {given}/session"),
    "profile restore": Command(("profile",), "profile restore {given}/profile", ("profile",)),
    "profile compare": Command(("profile", "result1"), "profile compare {given}/profile {given}/result1"),
    "profile trend": Command(("profile",), "profile trend {given}/profile -o {out}", ending=".svg"),
    "support-bundle": Command(
        ("session", "result1"), "support-bundle {given}/session -o {out} --result {given}/result1", ending=".zip"
    ),
    "bundle images": Command(("pictures",), "support-bundle {given}/pictures -o {out} --images", ending=".zip"),
    "detect": Command(
        ("pictures",),
        "detect {given}/pictures/placements/P1/C01.png --targets {given}/pictures/targets.json --csv {out}",
    ),
    "bars list": Command(("bars.json",), "bars list --registry {given}/bars.json"),
    "bars add": Command(
        ("bars.json", "session"),
        "bars add B8 --from-session {given}/session --bar B --registry {given}/bars.json",
        ("bars.json",),
    ),
    "limits": Command(("limits.json",), "limits show --file {given}/limits.json"),
    "ball export": Command(("result1",), "ball export {given}/result1 -o {out}"),
    "ball show": Command(("ball.json",), "ball show {given}/ball.json"),
    "frame": Command(("result1",), "frame {given}/result1 -o {out} --origin P1 --x P2 --xy P3"),
    "check": Command(("session", "profile"), "check {given}/session --profile {given}/profile -o {out}", ("profile",)),
    "targets": Command((), "targets export -o {out} --count 9"),
    "sheet": Command((), "targets sheet -o {out} --count 9", ending=".pdf"),
    "simulate": Command((), "simulate demo -o {out} --observations-only"),
    "licences": Command((), "licences --texts {out}"),
    "window": Command(("project",), "", ("project",)),
}


def open_in_window(folder: Path) -> int:
    """What the window does with a project that is opened, up to the cameras: 0, or 2 where it is refused."""
    from types import SimpleNamespace

    from spherecal.base.errors import SpherecalError
    from spherecal_cameras.capture import SessionCamera
    from spherecal_cameras.plan import CapturePlan, PlannedSet
    from spherecal_gui.coverage import DotStore
    from spherecal_gui.project_folder import load_project, save_project
    from spherecal_gui.recorded_sets import RecordedSession

    entry = {"id": "C01", "image_size": [8, 8], "pixel_pitch_um": 3.0, "focal_length_mm": 8.0}
    source: Any = SimpleNamespace(kind="replay", label="")
    try:
        project = load_project(folder)
        store = DotStore(folder)
        for name, at in project.taken.items():
            store.load(name, at)
            store.save(name, at, {})
        plan = CapturePlan(tuple(PlannedSet(one) for one in project.sets), None, {})
        RecordedSession(folder, plan, (SessionCamera("S1", entry),), source).start()
        save_project(project)
    except SpherecalError as error:
        print(error)
        return 2
    return 0
