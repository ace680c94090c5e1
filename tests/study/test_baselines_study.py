"""Studies: trials that can be repeated to the bit anywhere, taken up again, survive a killed worker; their pages."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.context import Context
from spherecal.base.errors import Cancelled, InputError
from spherecal_app.cli.main import main
from spherecal_documents.report.style import report_style
from spherecal_sim import rigs
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions
from spherecal_study import compare_methods as compare
from spherecal_study import executor, noise, rendered
from spherecal_study import pages as pages_in
from spherecal_study import study_agreement as agreement
from spherecal_study.executor import DaskCluster, LocalProcesses, Trial, run_here, run_trials
from spherecal_study.rendered import renderings
from spherecal_study.studies import STUDIES, run_study
from spherecal_study.study_page import Options
from spherecal_study.trials import ball, bar, board, displaced, paths, some_cameras, wand
from tests.study_workers import kill_always, kill_once

TRIALS = [Trial("paths", {"preset": "demo", "seed": seed, "sigma_px": 0.04, "search": "opt"}) for seed in (1, 2, 3)]


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> list[dict]:
    return run_trials(TRIALS, tmp_path_factory.mktemp("here"), LocalProcesses(0), Context())


def untimed(results: list[dict]) -> list[dict]:
    return [{name: value for name, value in one.items() if name != "search_s"} for one in results]


def test_local_processes_give_the_same_to_the_bit(here, tmp_path):
    assert untimed(run_trials(TRIALS, tmp_path, LocalProcesses(2), Context())) == untimed(here)


@pytest.mark.slow
def test_a_cluster_gives_the_same_to_the_bit_and_a_killed_worker_costs_nothing_but_time(here, tmp_path):
    distributed = pytest.importorskip("distributed")
    trials = [Trial("x", {"seed": seed, "marker": str(tmp_path / "killed")}) for seed in range(4)]
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        assert untimed(run_trials(TRIALS, tmp_path / "same", DaskCluster(address), Context())) == untimed(here)
        if os.name != "nt":  # no SIGKILL there
            results = run_trials(trials, tmp_path / "kept", DaskCluster(address, kill_once), Context())
            assert (tmp_path / "killed").exists()
            assert [r["value"] for r in results] == [0, 1, 2, 3]


def test_no_cluster_is_said_plainly(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(executor, "_SCHEDULER_S", 0.5)
    with pytest.raises(InputError, match="No Dask scheduler answers"):
        list(DaskCluster("tcp://127.0.0.1:9").results(TRIALS, Context()))


@dataclass(frozen=True)
class Counted:
    """Runs trials here and counts them."""

    ran: list[Trial]

    def results(self, trials, context):
        for number, trial in enumerate(trials):
            context.check()
            self.ran.append(trial)
            yield number, {"value": float(trial.settings["seed"])}


def test_a_stopped_study_goes_on_where_it_was(tmp_path):
    ran: list[Trial] = []
    stop = Context(is_cancelled=lambda: len(ran) == 2)
    with pytest.raises(Cancelled):
        run_trials(TRIALS, tmp_path, Counted(ran), stop)
    again: list[Trial] = []
    results = run_trials(TRIALS, tmp_path, Counted(again), Context())
    assert [r["value"] for r in results] == [1.0, 2.0, 3.0]
    assert len(ran) + len(again) == 3
    (tmp_path / f"{TRIALS[0].key}.json").write_text("{ cut off")
    assert run_trials(TRIALS, tmp_path, Counted(again), Context()) == results
    assert len(again) == 2


def test_equal_trials_run_once(tmp_path):
    ran: list[Trial] = []
    assert len(run_trials([*TRIALS, *TRIALS], tmp_path, Counted(ran), Context())) == 6
    assert len(ran) == 3


def test_other_settings_are_other_trials():
    other = Trial("paths", {**TRIALS[0].settings, "sigma_px": 0.05})
    assert len({TRIALS[0].key, other.key, Trial("ball", TRIALS[0].settings).key}) == 3


@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
def test_a_killed_worker_costs_nothing_but_time(tmp_path):
    trials = [Trial("x", {"seed": seed, "marker": str(tmp_path / "killed")}) for seed in range(4)]
    results = run_trials(trials, tmp_path / "kept", LocalProcesses(2, kill_once), Context())
    assert (tmp_path / "killed").exists()
    assert [r["value"] for r in results] == [0, 1, 2, 3]


_STARTS = """
from pathlib import Path
from spherecal.base.context import Context
from spherecal_study import executor
from spherecal_study.executor import LocalProcesses, Trial, run_trials
from tests.study_workers import slow
executor._PARENT_S = 0.1  # here and, as it is spawned, in the worker
if __name__ == "__main__":
    folder = Path(FOLDER)
    run_trials([Trial("x", {"marker": str(folder / "pid")})], folder / "kept", LocalProcesses(1, slow), Context())
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
def test_workers_end_with_the_program_that_started_them(tmp_path):
    script = tmp_path / "start.py"
    script.write_text(_STARTS.replace("FOLDER", repr(str(tmp_path))))
    here = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(here), str(here / "core")])}
    program = subprocess.Popen([sys.executable, str(script)], env=environment, cwd=here)
    marker = tmp_path / "pid"
    patience = time.monotonic() + 120
    while not marker.exists() and time.monotonic() < patience:
        time.sleep(0.05)
    worker = int(marker.read_text())
    program.kill()
    program.wait()
    while time.monotonic() < patience:
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    os.kill(worker, signal.SIGKILL)
    pytest.fail("the worker outlived its program")


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
def test_a_trial_that_always_kills_its_worker_ends_the_study(tmp_path):
    with pytest.raises(InputError, match="died 3 times"):
        run_trials([Trial("x", {"seed": 1})], tmp_path, LocalProcesses(1, kill_always), Context())


def test_a_ball_trial_measures_bars_and_the_calibration_alone():
    result = ball("demo", 1, 0.04, method="free")
    assert result["valid"]
    assert sorted(result["bars"]) == ["A1A2", "A1A4", "A3A4", "B1B2", "B1B3", "B1B4"]
    bars = np.concatenate([result["bars"][label] for label in result["bars"]])
    exact = np.array(result["exact_errors_mm"])
    assert len(exact) == 40
    assert 0 < np.sqrt((exact**2).mean()) < 0.5
    assert 0.01 < np.sqrt((bars**2).mean()) < 0.5
    assert json.loads(json.dumps(result)) == result


def test_some_cameras_are_those_in_the_middle():
    session, truth = simulate_session("rigA", 1, SimulationOptions(bar_poses=1))
    few, its_truth = some_cameras(session, truth, 4)
    assert {c.id for c in few.cameras} <= {"C02", "C03", "C04", "C07", "C08", "C09"}  # not those at the ends
    assert len(few.cameras) == 4
    assert [c.id for c in its_truth.cameras] == [c.id for c in few.cameras] == list(few.observations.cameras)
    assert np.abs(few.observations.uv - its_truth.uv_true_px).max() < 0.3


def test_displaced_points_converge_with_the_diagonal():
    result = displaced("demo", 1, 0.04, "diagonal")
    cases = result["cases"]
    assert {(c["percent"], c["way"]) for c in cases} == {(p, way) for p in (10, 15, 20, 25) for way in ("spo", "none")}
    for case in cases:
        assert case["converged"] and case["settled"] and 1 <= case["iterations"] < 100
        assert case["start_px"] > 10
        assert case["rms_px"] == pytest.approx(result["best_rms_px"], rel=1e-3)
        assert len(case["camera_mean_px"]) == len(result["ids"]) == 6
        assert min(case["camera_mean_px"]) < case["mean_px"] < max(case["camera_mean_px"])


def test_known_intrinsics_make_the_count_of_common_points_weigh():
    settings = {"preset": "demo", "seed": 1, "sigma_px": 0.04}
    nominal, known = (paths(**settings, search="opt", known=known) for known in (False, True))
    assert sum(known["lengths"].values()) < 0.2 * sum(nominal["lengths"].values())
    assert known["count_share"] > 10 * nominal["count_share"]
    heavy = paths(**settings, search="opt", known=True, paths=(1.0, 1000.0, 250.0, 1.1))
    assert heavy["count_share"] > 0.85
    listed = paths(**settings, search="first-listed")
    assert set(listed["paths"]) == set(nominal["paths"])
    refused = paths(**settings, search="opt", paths=(1.0, 1.0, 1e-6, 1.1))
    assert list(refused["paths"]) == [str(refused["reference"])]  # TH_er refuses every edge


def test_rivals_without_joint_adjustment_are_worse():
    settings = {"preset": "demo", "seed": 1, "sigma_px": 0.04}
    chained, joint = (board(**settings, placements=14, joint=joint) for joint in (False, True))
    assert not chained["valid"] and joint["valid"]
    assert chained["cameras"] == joint["cameras"] == 6
    assert rms(chained["exact_errors_mm"]) > 3 * rms(joint["exact_errors_mm"])
    bars = [bar(**settings, frames=150, joint=False, known=known) for known in (True, False)]
    assert all(result["cameras"] == 6 for result in bars)
    assert rms(bars[0]["exact_errors_mm"]) < 0.1 * rms(bars[1]["exact_errors_mm"])


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_papers_scale_takes_an_arc_for_a_line():
    literal, ours = (ball("demo", 1, 0.04, method=method) for method in ("tao2021", "free"))
    long = [np.mean(result["bars"]["B1B4"]) for result in (literal, ours)]
    radius, distance, length = 150.0, 17.0, 400.0  # of the demo's ball, of A and E, of the bar, in about
    assert long[0] - long[1] == pytest.approx(length * distance**2 / (24 * radius**2), rel=0.5)
    assert 2 * literal["bars_u_mm"]["B1B4"] > abs(long[0])  # which its uncertainty counts


def made_up(trial: Trial) -> dict:
    """A plausible result of any trial, for the pages."""
    rng = np.random.default_rng(abs(hash(trial.key)) % 2**32)
    if trial.kind == "displaced":
        case = {"iterations": 9, "settled": True, "mean_px": 0.04, "rms_px": 0.05, "camera_mean_px": [0.04] * 10}
        case["start_px"] = 90.0
        ways = [(p, way) for p in (10, 15, 20, 25) for way in ("spo", "none")]
        cases = [{"percent": p, "way": way, "converged": True, **case} for p, way in ways]
        return {"cases": cases, "best_rms_px": 0.05, "best_mean_px": 0.04, "ids": [f"C{i:02d}" for i in range(10)]}
    if trial.kind == "published":
        return run_here(Trial("published", {**trial.settings, "preset": "demo", "seed": 1}))
    if trial.kind == "paths":
        return run_here(Trial("paths", {**trial.settings, "preset": "demo", "seed": 1}))
    bars = {label: rng.normal(0, 0.02, 20).tolist() for label in ("A1A2", "A1A4", "A3A4", "B1B2", "B1B3", "B1B4")}
    return {
        "valid": True,
        "cameras": 12,
        "seconds": {"local reconstruction": 0.5, "bundle adjustment": 2.0},
        "mean_abs_px": [0.03, 0.03],
        "sd_px": [0.04, 0.04],
        "mean_px": 0.05,
        "rms_px": 0.056,
        "bars": bars,
        "bars_u_mm": dict.fromkeys(bars, 0.02),
        "exact_errors_mm": rng.normal(0, 0.01, 40).tolist(),
        "method": "free",
        "cpu_s": 2.0,
        **dict.fromkeys(WAND, 0.01),
        "camera_mean_abs_px": {"C01": [0.03, 0.03]},
        "camera_sd_px": {"C01": [0.04, 0.04]},
    }


WAND = (
    "points_mm", "points_bound_mm", "centres_mm", "centres_bound_mm", "focal_px", "focal_bound_px", "scale",
    "scale_bound",
)  # fmt: skip


@pytest.mark.parametrize("name", STUDIES)
def test_pages_are_drawn(name):
    options = Options(1)
    listed = STUDIES[name].trials(options)
    cache: dict[str, dict] = {}
    results = [cache.setdefault(str(t.settings.get("search", t.key)) + t.kind, made_up(t)) for t in listed]
    with report_style():
        page = STUDIES[name].page(listed, results, options)
        pdf = page.pdf()
    assert pdf.startswith(b"%PDF")
    assert len(pdf) > 10_000
    assert len(page.compared) >= 3
    tested = [row.judged for row in page.compared if row.judged.agrees is not None]
    assert tested
    assert {one.agrees for one in tested} == {"cannot tell"}  # one run tells nothing
    assert all(one.test in agreement.TESTS for one in tested)
    with report_style():  # a series that was stopped has a page too
        some = [i for i, t in enumerate(listed) if i % 3 == 0]
        assert STUDIES[name].page([listed[i] for i in some], [results[i] for i in some], options).pdf()


def test_the_papers_rivals_have_rows_of_their_own():
    rows = {(t.kind, t.settings.get("joint", True)) for t in compare.trials(Options(1))}
    assert rows == {("ball", True), ("board", False), ("bar", False)}
    prints = {t.settings.get("print_sd_mm", 0.0) for t in compare.trials(Options(1)) if t.kind == "ball"}
    assert prints == {0.0, compare.ASSUMPTION_3_SD_MM}


def test_table_2_is_on_the_papers_rig():
    listed = noise.trials(Options(2))
    assert {(t.settings["preset"], t.settings["damping"], t.settings.get("known", False)) for t in listed} == {
        ("rigA", "identity", False),
        ("rigA", "identity", True),
        ("rigA", "diagonal", False),
        ("rigB", "diagonal", False),
        ("rigB", "diagonal", True),
    }


def test_settings_of_a_study_reach_its_trials():
    asked = Options(1, known=True, paths=(1.0, 2.0, 5.0, 1.3))
    for name, study in STUDIES.items():
        for trial in study.trials(asked):
            assert trial.settings.get("known"), name
            weighed = trial.kind in ("ball", "paths", "published")
            assert trial.settings.get("paths") == ([1.0, 2.0, 5.0, 1.3] if weighed else None), (name, trial.kind)


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ([0.09, 0.11] * 15, "yes"),
        ([0.09, 0.11] * 14, "cannot tell"),  # 28 runs
        ([0.30, 0.32] * 15, "differs"),
        ([0.02, 0.22] * 15, "cannot tell"),  # an interval that is too wide
    ],
)
def test_a_value_agrees_by_its_interval(values, verdict):
    assert agreement.like(agreement.estimate(values), 0.1).agrees == verdict


def test_limits_shares_and_orders_are_tested_as_stated():
    e = agreement.estimate
    assert agreement.below(e([0.09, 0.11] * 15), 0.125).agrees == "yes"
    assert agreement.below(e([0.19, 0.21] * 15), 0.125).agrees == "differs"
    assert agreement.below(e([0.05, 0.20] * 15), 0.125).agrees == "cannot tell"
    assert agreement.above(e([1.9, 2.1] * 15), 1.25).agrees == "yes"
    assert agreement.always(60, 60).agrees == "yes" and agreement.always(30, 60).agrees == "differs"
    assert agreement.always(30, 30).agrees == "yes" and agreement.always(29, 29).agrees == "cannot tell"
    assert agreement.always(28, 30).agrees == "cannot tell"  # the interval begins at 78 %
    assert agreement.never(0, 60).agrees == "yes" and agreement.never(60, 60).agrees == "differs"
    up, flat, down = e([1.0, 1.2] * 15), e([-1.0, 1.0] * 15), e([-1.2, -1.0] * 15)
    assert agreement.ordered([up, up]).agrees == "yes"
    assert agreement.ordered([up, flat]).agrees == "cannot tell"
    assert agreement.ordered([up, down]).agrees == "differs"
    assert e([1.0, None, 3.0]).words(1) == "2.0 +- 1.0"


def test_an_interval_of_95_percent_holds_the_mean_in_95_percent():
    rng = np.random.default_rng(1)
    found = [agreement.estimate(rng.normal(1.0, 0.3, 30).tolist()) for _ in range(2000)]
    held = np.mean([one.low < 1.0 < one.high for one in found])
    assert 0.935 < held < 0.965


def test_a_page_of_what_is_kept_runs_nothing(tmp_path):
    options = Options(2)
    with pytest.raises(InputError, match="holds no results"):
        run_study("rigB", options, tmp_path, MadeUp(), Context(), kept_only=True)
    run_study("rigB", Options(1), tmp_path, MadeUp(), Context())
    ran: list[Trial] = []
    run_study("rigB", options, tmp_path, Counted(ran), Context(), kept_only=True)
    assert not ran
    text = (tmp_path / "paper.md").read_text()
    assert "not complete, 1 runs in some lines" in text
    assert "| cannot tell (" in text


def test_the_command_refuses_what_it_does_not_know(capsys):
    with pytest.raises(SystemExit) as error:
        main(["study", "everything"])
    assert error.value.code == 2
    assert "there is no study" in capsys.readouterr().err


def test_a_waved_bar_reaches_its_bound():
    result = wand("demo", 1, 0.04, 150)
    assert result["valid"]
    assert result["cameras"] == 6
    assert 0.7 < result["points_mm"] / result["points_bound_mm"] < 1.3
    assert 0.5 < result["centres_mm"] / result["centres_bound_mm"] < 2.0
    assert result["scale"] < 4 * result["scale_bound"]


@dataclass(frozen=True)
class MadeUp:
    """Answers every trial with a made-up result."""

    def results(self, trials, context):
        for number, trial in enumerate(trials):
            yield number, made_up(trial)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two studies' pages, one of them on another rig."""
    folder = tmp_path_factory.mktemp("pages")
    run_study("cameras", Options(1), folder, MadeUp(), Context())
    run_study("rigB", Options(2), folder, MadeUp(), Context())
    return folder


def test_pages_of_a_folder_are_listed_with_their_pictures(folder):
    found = pages_in(folder)
    assert [page.name for page in found] == ["cameras", "rigB"]
    for page in found:
        assert page.pdf.read_bytes().startswith(b"%PDF")
        assert len(page.pictures) >= 1
        assert all(picture.read_bytes().startswith(b"\x89PNG") for picture in page.pictures)
        assert page.title
        assert {"what", "paper", "ours", "agrees", "why", "test", "runs", "pipeline"} == set(page.compared[0])
    assert found[1].options["runs"] == 2
    assert pages_in(folder / "nothing") == ()


def test_damaged_pages_are_left_out(folder, tmp_path):
    for name in ("cameras.json", "cameras.pdf"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    assert pages_in(tmp_path) == ()  # its pictures are missing
    (tmp_path / "other.json").write_text('{"format": "spherecal/study"}')
    (tmp_path / "wrong.json").write_text("[1, 2")
    assert pages_in(tmp_path) == ()


def test_the_papers_table_has_every_figure(folder):
    text = (folder / "paper.md").read_text()
    for said in ("AVT G-319B", "MV-CA050-20GM", "0.0453, 0.0483 px", "0.0632, 0.0629 px", "0.0593 px at best"):
        assert said in text
    assert "(run `spherecal study noise`)" in text  # what is missing is said
    assert "| cannot tell (" in text  # one or two runs


def test_another_rig_is_no_figure_of_the_paper(folder, tmp_path):
    run_study("cameras", Options(1, preset="demo"), tmp_path, MadeUp(), Context())
    assert not (tmp_path / "paper.md").exists()
    listed = json.loads((tmp_path / "cameras.json").read_text())["trials"]
    assert {t["settings"].get("cameras") for t in listed} == {4, None}  # four of the six, and all
    assert {t["settings"]["preset"] for t in listed} == {"demo"}


@pytest.mark.parametrize("name", [name for name in STUDIES if name not in ("bar", "rigB")])
def test_images_are_rendered_once_for_all_trials(name):
    listed = STUDIES[name].trials(Options(1, sigma_px=None))
    assert {t.settings["preset"] for t in listed} == {"demo"}
    needed = renderings(listed)
    assert needed
    assert len({trial.key for trial in needed}) == len(needed) <= len(listed)
    assert renderings(STUDIES[name].trials(Options(1))) == []


@pytest.mark.slow
def test_trials_on_rendered_images(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(rendered, "BAR_POSES", 1)  # each image is half a second of a processor,
    small = replace(rigs.SMALL, image_size=(800, 640), pixel_pitch_um=rigs.SMALL.pixel_pitch_um * 1280 / 800)
    monkeypatch.setattr(rigs, "SMALL", small)  # and less with fewer pixels
    result = ball("demo", 1, None, placements=2, method="free")
    assert result["valid"]
    assert result["cameras"] == 6
    assert 0.001 < result["mean_px"] < 0.2
    assert len(result["bars"]["A1A4"]) == 1
    assert np.sqrt(np.mean(np.square(result["exact_errors_mm"]))) < 0.2
    kept = list((tmp_path / "spherecal" / "studies").iterdir())
    assert len(kept) == 2  # the ball and the bars, nothing half-done


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["bar", "--images"], "thousands of frames"),
        (["rigB", "--rig", "demo"], "compares rigs A and B"),
        (["layouts", "--images", "--sigma", "0.1"], "noise of their sensor"),
        (["layouts", "--rig", "nowhere"], "no rig preset"),
        (["noise", "--session", "x"], "makes no sense on a recorded session"),
        (["layouts", "--session", "x", "--images"], "its own rig, images and noise"),
    ],
)
def test_what_makes_no_sense_is_refused(options, says, tmp_path, capsys):
    assert main(["study", *options, "-o", str(tmp_path), "--workers", "0"]) == 2
    assert says in capsys.readouterr().err
