"""Writers side by side: what they write, what a reader must see meanwhile, and what must stand at the end."""

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from spherecal.base.errors import SpherecalError
from spherecal_files.atomic import RESULT, write_folder_whole
from spherecal_files.filesystem import create
from spherecal_files.rig_file import rig_bytes
from spherecal_rigs.save_entry import save_result
from spherecal_rigs.store import apply, create_profile, open_profile
from tests.export_rigs import make_rig

_FILES = ("points.csv", "residuals.csv", "spheres.csv", "bars.csv")
Setup = Callable[[Path], None]
Work = Callable[[Path, int, int], int]
Read = Callable[[Path], int]
Judge = Callable[[Path, int, list[int]], str]


def _answer(work: Callable[[], object]) -> int:
    try:
        work()
    except SpherecalError:
        return 2
    return 0


def _marked(number: int, writer: int) -> str:
    return f"{number}-{writer}"


def _write_output(root: Path, number: int, writer: int) -> int:
    def build(new: Path) -> None:
        mark = _marked(number, writer)
        create(new / "rig.json", json.dumps({"format": "spherecal/rig", "is": mark}).encode())
        for name in _FILES:
            create(new / name, (mark + "\n").encode() * 2000)

    return _answer(lambda: write_folder_whole(root / "out", build, RESULT))


def _seen(folder: Path) -> set[str]:
    marks = {json.loads((folder / "rig.json").read_bytes())["is"]}
    for name in _FILES:
        lines = (folder / name).read_text().split()
        marks |= set(lines)
        assert len(lines) == 2000, f"{name} is cut"
    return marks


def _read_output(root: Path) -> int:
    for _ in range(5):
        with suppress(FileNotFoundError):  # between the old folder and the new one
            _seen(root / "out")
    return 0


def _judge_output(root: Path, number: int, codes: list[int]) -> str:
    names = sorted(path.name for path in (root / "out").iterdir())
    if names != sorted(("rig.json", *_FILES)):
        return f"holds {names}"
    (mark,) = _seen(root / "out")
    if mark not in {_marked(number, writer) for writer, code in enumerate(codes) if code == 0}:
        return f"holds {mark}, which nobody reported as written"
    left = [path.name for path in root.iterdir() if path.name not in ("out", "said")]
    return f"left {left}" if left else ""


def _make_profile(root: Path) -> None:
    profile = create_profile(root / "profile")
    for seed in (1, 2, 3):
        result = root / f"r{seed}"
        result.mkdir()
        (result / "rig.json").write_bytes(rig_bytes(make_rig(5, 4, seed)))
        save_result(profile, result)
    apply(open_profile(root / "profile"), "0001")


def _write_profile(root: Path, number: int, writer: int) -> int:
    opened = open_profile(root / "profile")  # as both see it before either writes
    return _answer(lambda: apply(opened, f"{writer + 1:04d}", _marked(number, writer)))


def _read_profile(root: Path) -> int:
    for _ in range(3):
        opened = open_profile(root / "profile")
        assert opened.active is not None and not opened.problems
        opened.rig()
    return 0


def _judge_profile(root: Path, number: int, codes: list[int]) -> str:
    opened = open_profile(root / "profile")
    notes = {event.note for event in opened.applied}
    lost = [writer for writer, code in enumerate(codes) if code == 0 and _marked(number, writer) not in notes]
    left = [path.name for path in (root / "profile").iterdir() if path.name.startswith(".")]
    copy = (root / "profile" / "rig.json").read_bytes() == (
        opened.path_of(opened.active_id or "") / "rig.json"
    ).read_bytes()
    return f"lost {lost}, left {left}, copy {copy}" if lost or left or not copy else ""


def _write_project(root: Path, number: int, writer: int) -> int:
    from spherecal_gui.project import Project
    from spherecal_gui.project_folder import save_project

    mark = _marked(number, writer)
    return _answer(lambda: save_project(Project(root / "project", f"replay:{mark}", bench=mark)))


def _read_project(root: Path) -> int:
    from spherecal_gui.project_folder import is_project, load_project

    for _ in range(5):
        if is_project(root / "project"):
            project = load_project(root / "project")
            assert project.source == f"replay:{project.bench}"
    return 0


def _judge_project(root: Path, number: int, codes: list[int]) -> str:
    from spherecal_gui.project_folder import load_project

    mark = load_project(root / "project").bench
    left = [path.name for path in (root / "project").iterdir() if path.name != "wizard.json"]
    right = mark in {_marked(number, writer) for writer, code in enumerate(codes) if code == 0}
    return "" if right and not left else f"holds {mark}, left {left}"


KINDS: dict[str, tuple[Setup, Work, Read, Judge]] = {
    "output": (lambda root: None, _write_output, _read_output, _judge_output),
    "profile": (_make_profile, _write_profile, _read_profile, _judge_profile),
    "project": (lambda root: None, _write_project, _read_project, _judge_project),
}
