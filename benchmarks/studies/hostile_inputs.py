"""Hostile inputs made on a file system with canaries, and the commands that are given them."""

import json
import os
import random
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from spherecal.profile.save import save_result
from spherecal.profile.store import apply, create_profile, open_profile
from spherecal.session.rig_file import rig_bytes
from spherecal.simulate.session import simulate_session
from spherecal.simulate.session_folder import write_session
from spherecal.simulate.truth import SimulationOptions
from tests.export_rigs import make_rig


@dataclass(frozen=True)
class Ground:
    """The folders of the trial: what must never change, valid inputs, and where a try takes place."""

    root: Path

    @property
    def precious(self) -> Path:
        """What belongs to the user."""
        return self.root / "precious"

    @property
    def valid(self) -> Path:
        """Valid inputs, copied for every try."""
        return self.root / "valid"

    @property
    def given(self) -> Path:
        """The hostile copy of this try."""
        return self.root / "in"

    @property
    def out(self) -> Path:
        """Where the try may write."""
        return self.root / "out"


def make_ground(root: Path) -> Ground:
    """Fill the folders."""
    ground = Ground(root)
    for name in ("thesis.tex", "secret.key", ".bashrc", ".git/config", ".ssh/authorized_keys", "rig.json"):
        path = ground.precious / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"the user's own {name}\n" * 3)
    session, truth = simulate_session("demo", 1, SimulationOptions(targets=12, placements=2, bar_poses=1))
    write_session(session, truth, ground.valid / "session")
    _project(ground.valid)
    results = []
    for seed in (1, 2):
        folder = ground.valid / f"result{seed}"
        folder.mkdir()
        (folder / "rig.json").write_bytes(rig_bytes(make_rig(5, 4, seed)))
        results.append(folder)
    for result in results:
        saved = save_result(create_profile(ground.valid / "profile"), result)
        apply(open_profile(ground.valid / "profile"), saved)
    image = np.random.default_rng(1).integers(0, 255, (90, 100), dtype=np.uint8)
    (ground.valid / "images").mkdir()
    Image.fromarray(image).save(ground.valid / "images" / "a.png")
    (ground.valid / "bars.json").write_text(json.dumps({"format": "spherecal/bars", "version": 1, "bars": []}))
    return ground


def _project(valid: Path) -> None:
    folder = valid / "project"
    write = {
        "wizard.json": {
            "format": "spherecal/wizard", "version": 1, "source": "replay:x", "step": "place", "cameras": ["S1"],
            "looked": ["S1"], "placements": ["P1", "P2"], "scale_poses": [], "check_poses": ["K1"],
        },
        "capture.json": {
            "format": "spherecal/capture", "version": 1, "cameras": [{"id": "C01", "serial": "S1"}],
            "sets": [{"id": "P1", "taken": "2026-01-01", "images": {"C01": "placements/P1/C01.png"}}],
        },
        "session.json": {"format": "spherecal/session", "version": 1, "cameras": [], "bar_poses": []},
        "removed/P2-1/set.json": {"id": "P2", "taken": "t", "images": {"C01": "placements/P2/C01.png"}},
        "verification/capture.json": {"sets": [{"id": "K1", "taken": "t", "images": {"C01": "x.png"}}]},
    }  # fmt: skip
    for name, document in write.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document))
    for name in ("placements/P1/C01.png", "removed/P2-1/images/C01.png", "removed/P2-1/retaking", "wizard/P1.npz"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")


# --- making it hostile -----------------------------------------------------------------------------------------------


def _texts(ground: Ground) -> list[Any]:
    return [
        "../../precious/thesis.tex", str(ground.precious), str(ground.precious / "secret.key"), "..", ".", "", "/", "~",
        "a" * 300, "a/../../precious", "x\\..\\y", "C:\\Windows", "\x00", "a\nb", "=cmd|' /C calc'!A0", "-1+1|cmd",
        "<img src=/dev/zero>", "--><!--", "\ud800", "ü" * 64, "\U0001d4b3" * 64, ".hidden", "con", 10**400, 1e308, -1,
        None,        [[]] * 50, {"a": {}}, True, "9" * 5000,
    ]  # fmt: skip


def _places(document: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = (
        document.items() if isinstance(document, dict) else (enumerate(document) if isinstance(document, list) else ())
    )
    return [path, *(place for key, value in inner for place in _places(value, (*path, key)))]


def spoil_text(ground: Ground, path: Path, chance: random.Random) -> None:
    """Put a hostile value somewhere into a JSON file; cut any other one."""
    try:
        document = json.loads(path.read_bytes())
    except (ValueError, OSError):
        path.write_bytes(path.read_bytes()[: chance.randrange(40)] + chance.randbytes(20))
        return
    place = chance.choice(_places(document))
    value = chance.choice(_texts(ground))
    if not place:
        document = value
    else:
        inner = document
        for key in place[:-1]:
            inner = inner[key]
        if isinstance(inner, dict) and isinstance(value, str) and chance.random() < 0.3:
            inner[value] = inner.pop(place[-1])
        else:
            inner[place[-1]] = value
    path.write_text(json.dumps(document), encoding="utf-8", errors="surrogatepass")


def spoil_kind(ground: Ground, path: Path, chance: random.Random) -> None:
    """Put something else in a file's or folder's place: a link, a pipe, a device, a huge file, a folder."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    match chance.randrange(9):
        case 0:
            os.mkfifo(path)
        case 1:
            path.symlink_to("/dev/zero")
        case 2:
            path.symlink_to(path)  # a loop
        case 3:
            path.symlink_to(ground.root / "nowhere")
        case 4:
            with path.open("wb") as file:
                file.write(b"\x89PNG\r\n\x1a\n" if chance.random() < 0.5 else b"{")
                file.truncate(12 << 30)
        case 5:
            path.mkdir()
        case 6 | 7:
            path.symlink_to(chance.choice([p for p in ground.precious.rglob("*") if p.is_file()]))
        case _:
            path.symlink_to(ground.precious, target_is_directory=True)


def spoil(ground: Ground, folder: Path, chance: random.Random) -> None:
    """One to three hostile changes below a folder (or of a file)."""
    for _ in range(chance.randint(1, 3)):
        inside = [p for p in (folder, *folder.rglob("*")) if p != folder or folder.is_file()]
        if not inside:
            return
        path = chance.choice(sorted(inside))
        if path.is_file() and not path.is_symlink() and path.stat().st_size < 1 << 20 and chance.random() < 0.55:
            spoil_text(ground, path, chance)
        else:
            spoil_kind(ground, path, chance)


def make_output(ground: Ground, name: str, chance: random.Random) -> Path:
    """Where to write: mostly a free name in `out`, else something hostile there."""
    shutil.rmtree(ground.out, ignore_errors=True)
    ground.out.mkdir()
    path = ground.out / name
    match chance.randrange(12):
        case 0:
            path.symlink_to(chance.choice([ground.precious, ground.precious / "secret.key", ground.root / "nowhere"]))
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
        case _:
            pass
    return path


# --- commands --------------------------------------------------------------------------------------------------------


def make_try(ground: Ground, chance: random.Random) -> tuple[str, Callable[[], int]]:
    """A hostile input and the command that is given it: its name, and what runs it (the exit code)."""
    shutil.rmtree(ground.given, ignore_errors=True)
    name = chance.choice(list(COMMANDS))
    folders, words = COMMANDS[name]
    ground.given.mkdir()
    for folder in folders:
        source = ground.valid / folder
        (shutil.copytree if source.is_dir() else shutil.copy)(source, ground.given / folder)
    spoil(ground, ground.given / chance.choice(folders), chance)
    out = make_output(ground, "o.zip" if name == "support-bundle" else "o", chance)
    if name == "window":
        return name, lambda: open_in_window(ground.given / "project")
    arguments = [word.format(given=ground.given, out=out, valid=ground.valid) for word in words.split()]

    def run() -> int:
        from spherecal.cli.main import main

        return main(arguments)

    return name, run


COMMANDS: dict[str, tuple[tuple[str, ...], str]] = {
    "calibrate": (("session",), "calibrate {given}/session -o {out} --method free"),
    "verify": (("session", "result1"), "verify {given}/session --rig {given}/result1/rig.json -o {out}"),
    "report": (("result1",), "report {given}/result1 -o {out}.html"),
    "export opencv": (("result1",), "export {given}/result1/rig.json --to opencv -o {out}"),
    "export csv": (("result1",), "export {given}/result1/rig.json --to csv -o {out}"),
    "export metashape": (("result1",), "export {given}/result1/rig.json --to metashape -o {out}"),
    "profile show": (("profile",), "profile show {given}/profile"),
    "profile list": (("profile",), "profile list {given}"),
    "profile apply": (("profile",), "profile apply {given}/profile 0001"),
    "profile save": (("profile", "result1"), "profile save {given}/result1 --to {given}/profile"),
    "profile restore": (("profile",), "profile restore {given}/profile"),
    "profile compare": (("profile", "result1"), "profile compare {given}/profile {given}/result1"),
    "support-bundle": (("session", "result1"), "support-bundle {given}/session -o {out} --result {given}/result1"),
    "detect": (("images", "session"), "detect {given}/images/a.png --targets {given}/session/targets.json --csv {out}"),
    "bars list": (("bars.json",), "bars list --registry {given}/bars.json"),
    "ball": (("result1",), "ball export {given}/result1 -o {out}"),
    "frame": (("result1",), "frame {given}/result1 -o {out}"),
    "check": (("session", "profile"), "check {given}/session --profile {given}/profile -o {out}"),
    "window": (("project",), ""),
}


def open_in_window(folder: Path) -> int:
    """What the window does with a project that is opened, up to the cameras: 0, or 2 where it is refused."""
    from types import SimpleNamespace

    from spherecal.cameras.capture import SessionCamera
    from spherecal.cameras.plan import CapturePlan, PlannedSet
    from spherecal.errors import SpherecalError
    from spherecal_gui.project_folder import load_project, save_project
    from spherecal_gui.recorded import RecordedSession
    from spherecal_gui.tasks.dot_store import DotStore

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
