"""Studies on a recorded session: parts of it calibrated, their pages; what makes no sense is refused."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal_app.cli.main import main
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from spherecal_study import pages
from spherecal_study.executor import LocalProcesses
from spherecal_study.on_sessions import SessionOptions, run_session_study
from spherecal_study.trials import apart_mm, seen_along_the_thinnest


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "monday"
    session, truth = simulate_session("demo", 3, SimulationOptions(placements=3, targets=25, bar_poses=2))
    write_session(session, truth, folder)
    return folder


@pytest.fixture(scope="module")
def out(session, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    for name in ("layouts", "cameras", "path"):
        run_session_study(name, SessionOptions(session, runs=2), folder, LocalProcesses(0), Context())
    return folder


def trials(out: Path, name: str) -> list[dict]:
    return json.loads((out / f"{name}-session.json").read_text())["trials"]


def test_fewer_placements_leave_the_cameras_further_off(out):
    whole, *parts = trials(out, "layouts")
    assert whole["settings"].keys() == {"session", "fingerprint"}
    off = {n: [] for n in range(3)}
    for part in parts:
        if part["settings"]["method"] == "free":
            off[len(part["settings"]["without"])].append(
                apart_mm(part["result"]["centres"], whole["result"]["centres"])
            )
    assert all(1 <= len(off[n]) <= 2 for n in (1, 2))  # one where the same part was drawn twice
    assert np.mean(off[2]) > np.mean(off[1]) > 0


def test_fewer_cameras_are_those_of_the_middle(out):
    _, *parts = trials(out, "cameras")
    for part in parts:
        assert part["result"]["cameras"] == 6 - len(part["settings"]["without"])
    fewest = max(parts, key=lambda part: len(part["settings"]["without"]))
    assert len(fewest["settings"]["without"]) == 3
    assert fewest["result"]["bars"]


def test_searches_are_compared(out):
    kinds = {(t["kind"], t["settings"].get("search")) for t in trials(out, "path")[1:]}
    searches = ("opt", "dijkstra", "first", "first-listed")
    assert kinds == {(kind, s) for kind in ("recorded", "recorded-paths") for s in searches}


def test_their_pages_are_listed_after_nothing_of_the_paper(out):
    found = {page.name: page for page in pages(out)}
    assert set(found) == {"layouts-session", "cameras-session", "path-session"}
    assert found["path-session"].options["session"] == "monday"
    assert not (out / "paper.md").exists()


def test_what_cannot_be_left_out_is_refused(tmp_path):
    few, truth = simulate_session("demo", 3, SimulationOptions(placements=2, targets=60, bar_poses=0))
    write_session(few, truth, tmp_path / "few")
    with pytest.raises(InputError, match="only 2 placements"):
        run_session_study("layouts", SessionOptions(tmp_path / "few"), tmp_path, LocalProcesses(0), Context())


def test_the_command_names_the_page(session, out, tmp_path, capsys):
    shutil.copytree(out / "trials", tmp_path / "trials")  # what has been computed
    assert main(["study", "path", "--session", str(session), "-o", str(tmp_path), "--workers", "0"]) == 0
    assert "path-session.pdf" in capsys.readouterr().out.replace("\n", "")


def test_cameras_off_is_a_rigid_difference():
    places = {"a": [0.0, 0, 0], "b": [100.0, 0, 0], "c": [0.0, 80, 0], "d": [0.0, 0, 60]}
    moved = {name: [p[1] + 5, -p[0], p[2]] for name, p in places.items()}
    assert apart_mm(moved, places) == pytest.approx(0, abs=1e-9)
    assert apart_mm({name: [1.01 * x for x in p] for name, p in places.items()}, places) > 0.1
    assert apart_mm({"a": [0, 0, 0]}, places) is None
    flat = seen_along_the_thinnest({n: p for n, p in places.items() if n != "d"}, ["a", "b", "c", "z"])
    assert np.linalg.norm(flat[1] - flat[0]) == pytest.approx(100)
    assert np.isnan(flat[3]).all()
