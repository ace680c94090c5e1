"""Batches: every session below a folder calibrated, to the bytes of the command line; failures do not end it."""

import csv
import json
import os
import shutil
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pytest

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal_app.cli.main import main
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from spherecal_study.batch_of_sessions import COLUMNS, find_sessions, run_batch
from spherecal_study.executor import LocalProcesses, run_here
from tests.study_workers import kill_on_monday

SETTINGS = {"method": "free", "search": "opt", "seed": 0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two good sessions, one in a folder of its own, one that cannot be read, one whose cameras share nothing."""
    root = tmp_path_factory.mktemp("many")
    for name, seed in (("monday", 1), ("later/tuesday", 2)):
        session, truth = simulate_session("demo", seed, SimulationOptions(placements=2, targets=60, bar_poses=3))
        write_session(session, truth, root / name)
    session = json.loads((root / "later/tuesday/session.json").read_text())
    for bar in session["bars"]:  # certificates 1 mm too long
        bar["lengths"] = [one | {"length_mm": one["length_mm"] + 1.0} for one in bar["lengths"]]
    (root / "later/tuesday/session.json").write_text(json.dumps(session))
    shutil.copytree(root / "monday", root / "broken")
    (root / "broken" / "session.json").write_text('{"format": "spherecal/session", "version": 1, "cameras": 3}')
    shutil.copytree(root / "monday", root / "blind")
    lines = (root / "blind" / "observations.csv").read_text().splitlines()
    (root / "blind" / "observations.csv").write_text("\n".join([lines[0], *[x for x in lines if ",C01," in x]]) + "\n")
    return root


@dataclass(frozen=True)
class Counted:
    """Runs trials here and keeps which."""

    ran: list[str] = field(default_factory=list)

    def results(self, trials, context):
        for number, trial in enumerate(trials):
            context.check()
            self.ran.append(Path(trial.settings["session"]).name)
            yield number, run_here(trial)


@pytest.fixture(scope="module")
def done(folder, tmp_path_factory):
    output = tmp_path_factory.mktemp("out")
    counted = Counted()
    return run_batch(folder, output, SETTINGS, counted, Context()), output, counted


def test_every_session_has_its_row(done):
    batch, output, _ = done
    rows = {row["session"]: row for row in batch.rows}
    assert list(rows) == ["blind", "broken", "later/tuesday", "monday"]
    assert rows["monday"]["outcome"] == rows["later/tuesday"]["outcome"] == "use with care"  # of two placements
    assert rows["monday"]["lengths"] > 6
    assert rows["monday"]["verification"] == "consistent"
    assert rows["later/tuesday"]["verification"] == "inconsistent"
    assert rows["broken"]["outcome"] == "failed"
    assert "broken" in rows["broken"]["message"]
    assert rows["blind"]["outcome"] == "not valid"
    assert rows["blind"]["message"]
    assert not batch.valid
    table = list(csv.DictReader((output / "batch.csv").open()))
    assert tuple(table[0]) == COLUMNS
    assert [row["outcome"] for row in table] == ["not valid", "failed", "use with care", "use with care"]
    assert batch.page.read_bytes().startswith(b"%PDF")


def test_results_are_those_of_the_command_line_to_the_byte(done, folder, tmp_path):
    _, output, _ = done
    alone = tmp_path / "alone"
    for command in (
        ["calibrate", folder / "monday", "-o", alone, "--method", "free"],
        ["verify", folder / "monday", "--rig", alone / "rig.json", "-o", alone],
    ):
        assert main([str(word) for word in command]) == 0
    ours = output / "results" / "monday"
    assert {path.name for path in ours.iterdir()} == {path.name for path in alone.iterdir()}
    for path in alone.iterdir():
        assert (ours / path.name).read_bytes() == path.read_bytes(), path.name


def test_only_what_is_new_changed_lost_or_failed_is_done_again(done, folder, tmp_path):
    _, output, counted = done
    assert sorted(counted.ran) == ["blind", "broken", "monday", "tuesday"]
    again = Counted()
    batch = run_batch(folder, output, SETTINGS, again, Context())
    assert again.ran == ["broken"]
    assert len(batch.rows) == 4
    shutil.rmtree(output / "results" / "monday")
    os.utime(folder / "later" / "tuesday" / "observations.csv")
    again = Counted()
    run_batch(folder, output, SETTINGS, again, Context())
    assert sorted(again.ran) == ["broken", "monday", "tuesday"]


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
def test_a_session_that_kills_its_worker_is_one_failed_row(folder, tmp_path):
    worker = partial(kill_on_monday, columns=COLUMNS[2:-1])
    batch = run_batch(folder, tmp_path, SETTINGS, LocalProcesses(2, worker), Context())
    outcomes = {row["session"]: row["outcome"] for row in batch.rows}
    assert outcomes == {"blind": "valid", "broken": "valid", "later/tuesday": "valid", "monday": "failed"}
    assert "took its worker process down" in batch.rows[3]["message"]


@pytest.mark.slow
def test_two_processes_and_a_cluster_give_the_same_bytes(done, folder, tmp_path):
    distributed = pytest.importorskip("distributed")
    from spherecal_study.executor import DaskCluster

    _, output, _ = done
    run_batch(folder, tmp_path / "two", SETTINGS, LocalProcesses(2), Context())
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        run_batch(folder, tmp_path / "dask", SETTINGS, DaskCluster(cluster.scheduler_address), Context())
    files = [path.relative_to(output) for path in (output / "results").rglob("*") if path.is_file()]
    assert len(files) > 10
    for other in ("two", "dask"):
        for name in [*files, Path("batch.csv"), Path("batch.pdf")]:
            assert (tmp_path / other / name).read_bytes() == (output / name).read_bytes(), name


def test_sessions_below_the_output_are_not_input(folder, done):
    _, output, _ = done
    names = [path.name for path in find_sessions(folder, folder / "later")]
    assert names == ["blind", "broken", "monday"]
    with pytest.raises(InputError, match="holds a session"):
        find_sessions(output, output / "elsewhere")
    with pytest.raises(InputError, match="is no folder"):
        find_sessions(folder / "nothing", output)


def test_the_command_says_what_came_out(folder, tmp_path, capsys):
    code = main(["batch", str(folder / "later"), "-o", str(tmp_path), "--method", "free", "--workers", "0", "--json"])
    assert code == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["session"] for row in rows] == ["tuesday"]
    assert main(["batch", str(tmp_path / "none"), "-o", str(tmp_path)]) == 2
    assert "is no folder" in capsys.readouterr().err
