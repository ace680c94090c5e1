"""The command line as a user meets it: exit codes, one plain line for every error, results whole or not at all."""

import csv
import json
import logging
import os
import re
import shutil
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import spherecal_files.write_result as writing
from spherecal.base.arrays import FloatArray
from spherecal_app.cli import calibrate_command as command
from spherecal_app.cli.exit_codes import BAD_INPUT, CANCELLED, DONE, NOT_VALID
from spherecal_app.cli.main import main
from spherecal_files.rig_file import read_rig
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from tests.method.test_calibrate import cloud, line
from tests.networks import observed, session_of_points, simulated, with_observations

RESULT_FILES = ["points.csv", "residuals.csv", "rig.json", "spheres.csv"]


def names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


def assert_whole_result(folder: Path) -> None:
    """All files of a calibration and nothing half-written, inside and beside."""
    assert set(RESULT_FILES) <= set(names(folder))
    assert not [name for name in (*names(folder), *names(folder.parent)) if name.startswith(".") or "partial" in name]


def run(*arguments: object) -> int:
    """The exit code of a command; usage errors leave through SystemExit, as in a shell."""
    try:
        return main([str(a) for a in arguments])
    except SystemExit as left:
        return int(left.code or 0)


def assert_one_plain_line(err: str) -> str:
    """The last line is the message; before it only the names of stages."""
    assert "Traceback" not in err
    lines = err.splitlines()
    messages = [text for text in lines if text.startswith("spherecal: ")]
    assert len(messages) == 1, err
    assert lines[-1] == messages[0]
    assert all(text.startswith("  ") and text.endswith(" ...") for text in lines[:-1]), err
    return messages[0]


@pytest.fixture(scope="module")
def session_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A healthy session; not to be changed."""
    folder = tmp_path_factory.mktemp("healthy") / "session"
    write_session(*simulate_session("demo", 1, SimulationOptions(targets=80)), folder)
    return folder


@pytest.fixture(scope="module")
def result_folder(session_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrated") / "result"
    assert run("calibrate", session_folder, "-o", folder) == DONE
    return folder


@pytest.fixture(scope="module")
def two_cameras(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session that cannot be calibrated, which is soon known: its result is written all the same."""
    return save(tmp_path_factory.mktemp("few") / "session", None, [0, 1])


@pytest.fixture
def spoilt(session_folder: Path, tmp_path: Path) -> Path:
    """A copy of the healthy session to be spoilt."""
    folder = tmp_path / "session"
    folder.mkdir()
    for file in session_folder.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    return folder


def test_result_folder_holds_all_files(result_folder: Path, session_folder: Path) -> None:
    assert_whole_result(result_folder)
    assert names(result_folder.parent) == ["result"]
    document = json.loads((result_folder / "rig.json").read_text())
    assert document["format"] == "spherecal/rig" and document["version"] == 1
    assert document["quality"]["valid"] is True
    assert len(document["cameras"]) == 6
    assert document["software"]["method"] == "auto"
    assert re.fullmatch("[0-9a-f]{64}", document["input_sha256"])
    with (result_folder / "residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    with (session_folder / "observations.csv").open() as file:
        placements = [r for r in csv.DictReader(file) if r["placement"].startswith("P")]
    assert len(rows) == len(placements)
    assert {r["used"] for r in rows} == {"0", "1"}
    with (result_folder / "spheres.csv").open() as file:
        assert [r["placement"] for r in csv.DictReader(file)] == ["P1", "P2", "P3", "P4"]


def test_verdict_is_printed_first(session_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("calibrate", session_folder, "-o", tmp_path / "out") == DONE
    out, err = capsys.readouterr()
    assert out.startswith("VALID: 6 of 6 cameras placed")
    assert f"Result in {tmp_path / 'out'}." in out.replace("\n", "")
    assert "bundle adjustment" in err
    assert "spherecal:" not in err


def test_json_is_all_that_is_printed(session_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("calibrate", session_folder, "-o", tmp_path / "out", "--json") == DONE
    summary = json.loads(capsys.readouterr().out)
    rig = json.loads((tmp_path / "out" / "rig.json").read_text())
    assert summary["valid"] is True
    assert summary["cameras"] == summary["cameras_in_session"] == 6
    assert summary["findings"] == rig["quality"]["findings"]
    assert summary["rms_px"] == pytest.approx(rig["quality"]["rms_px"])
    assert summary["scale"]["source"] == "target_spacing"


def test_switches_reach_the_method(session_folder: Path, tmp_path: Path) -> None:
    def rig(*switches: str, code: int = DONE) -> dict:
        assert run("calibrate", session_folder, "-o", tmp_path / "out", *switches) == code
        return json.loads((tmp_path / "out" / "rig.json").read_text())

    paper = rig("--method", "tao2021", "--no-spo", "--no-opt")
    assert paper["software"]["method"] == "tao2021"
    assert all(camera["distortion"]["coefficients"][2:4] == [0, 0] for camera in paper["cameras"])
    assert "setting-without-effect" not in {finding["code"] for finding in paper["quality"]["findings"]}
    idle = rig("--no-spo", "--no-joint")
    said = [f["message"] for f in idle["quality"]["findings"] if f["code"] == "setting-without-effect"]
    assert len(said) == 2
    assert all(option in message for option, message in zip(("--no-spo", "--no-joint"), said, strict=True))
    assert run("calibrate", session_folder, "-o", tmp_path / "no", "--path-base", "0.5") == BAD_INPUT
    fixed = rig("--intrinsics", "fixed", "--seed", "3", code=NOT_VALID)  # data-sheet values do not hold
    priors = json.loads((session_folder / "session.json").read_text())["cameras"]
    assert fixed["software"]["seed"] == 3
    for camera, given in zip(fixed["cameras"], priors, strict=True):
        assert camera["matrix"] == given["prior"]["matrix"]
        assert camera["sigma"]["matrix"] == [0, 0, 0, 0]


def test_own_intrinsics_disregard_the_groups(spoilt: Path, tmp_path: Path) -> None:
    document = json.loads((spoilt / "session.json").read_text())
    for camera in document["cameras"]:
        camera["intrinsics_group"] = "all"
    (spoilt / "session.json").write_text(json.dumps(document))
    focal = {}
    for name, switches in (("shared", []), ("own", ["--own-intrinsics"])):
        assert run("calibrate", spoilt, "-o", tmp_path / name, *switches) in (DONE, NOT_VALID)
        focal[name] = {c.intrinsics[0] for c in read_rig(tmp_path / name / "rig.json").cameras}
    assert len(focal["shared"]) == 1
    assert len(focal["own"]) == 6


def test_verification_goes_into_the_result(
    session_folder: Path, result_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (result_folder / "rig.json").read_bytes()
    assert (
        run("verify", session_folder, "--rig", result_folder / "rig.json", "-o", tmp_path / "checked", "--json") == DONE
    )
    assert json.loads(capsys.readouterr().out)["n"] > 0
    assert (tmp_path / "checked" / "bars.csv").is_file()
    assert (tmp_path / "checked" / "verification.json").is_file()
    assert (result_folder / "rig.json").read_bytes() == before


# what is wrong, how the healthy session is spoilt, words of the message
def _edit(change: Callable[[dict], object]) -> Callable[[Path], object]:
    def spoil(folder: Path) -> None:
        document = json.loads((folder / "session.json").read_text())
        change(document)
        (folder / "session.json").write_text(json.dumps(document))

    return spoil


def _table(change: Callable[[list[str]], list[str]]) -> Callable[[Path], object]:
    def spoil(folder: Path) -> None:
        path = folder / "observations.csv"
        path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")

    return spoil


def _cut(name: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:-300])


BROKEN: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "truncated session": (_cut("session.json"), ["session.json", "not valid JSON"]),
    "truncated targets": (_cut("targets.json"), ["targets.json", "not valid JSON"]),
    "no session": (lambda f: (f / "session.json").unlink(), ["session.json"]),
    "binary session": (lambda f: (f / "session.json").write_bytes(os.urandom(100)), ["session.json"]),
    "nan in the prior": (
        _edit(lambda d: d["cameras"][0]["prior"]["matrix"][0].__setitem__(0, float("nan"))),
        ["session.json", "cameras[0].prior.matrix[0][0]", "finite"],
    ),
    "nan in the table": (_table(lambda t: [*t[:5], re.sub(r"[^,]+$", "nan", t[5]), *t[6:]]), ["line 6", "column v"]),
    "line cut off": (_table(lambda t: [*t[:-1], t[-1][: len(t[-1]) // 2]]), ["observations.csv", "line"]),
    "observation twice": (_table(lambda t: [*t, t[9]]), ["line 10", "same dot"]),
    "unknown camera in the table": (_table(lambda t: [*t[:7], t[7].replace("C01", "C99"), *t[8:]]), ["line 8", "C99"]),
    "unknown camera in a placement": (
        _edit(lambda d: d["placements"][0].__setitem__("images", {"C99": "x.png"})),
        ["placements[0].images.C99"],
    ),
    "camera twice": (_edit(lambda d: d["cameras"].append(d["cameras"][0])), ["cameras[6]", "C01"]),
    "placement twice": (_edit(lambda d: d["placements"].append(d["placements"][0])), ["placements[4]", "P1"]),
    "path that leaves the folder": (_edit(lambda d: d.__setitem__("target_set", "../targets.json")), ["target_set"]),
    "absolute path": (_edit(lambda d: d.__setitem__("target_set", "/etc/passwd")), ["target_set"]),
    "image that leaves the folder": (
        _edit(lambda d: d["placements"][0].__setitem__("images", {"C01": "../../x.png"})),
        ["placements[0].images.C01"],
    ),
    "missing target set": (lambda f: (f / "targets.json").unlink(), ["targets.json", "does not exist"]),
    "no cameras": (_edit(lambda d: d.__setitem__("cameras", [])), ["cameras"]),
    "later version": (_edit(lambda d: d.__setitem__("version", 2)), ["version"]),
}


@pytest.mark.parametrize("name", BROKEN)
def test_bad_input_is_told_in_one_line(
    name: str, spoilt: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, words = BROKEN[name]
    spoil(spoilt)
    assert run("calibrate", spoilt, "-o", tmp_path / "out") == BAD_INPUT
    out, err = capsys.readouterr()
    message = assert_one_plain_line(err)
    for word in words:
        assert word in message
    assert out == ""
    assert names(tmp_path) == ["session"]


def test_missing_session_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for place in (tmp_path / "nowhere", Path("/proc/nowhere")):
        assert run("calibrate", place, "-o", tmp_path / "out") == BAD_INPUT
        assert "nowhere" in assert_one_plain_line(capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["calibrate", "verify", "simulate"])
def test_output_that_cannot_be_written(
    command: str, session_folder: Path, result_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Told before the long work; also for root, whom no permission stops."""
    arguments: list[object] = {
        "calibrate": ["calibrate", session_folder],
        "verify": ["verify", session_folder, "--rig", result_folder / "rig.json"],
        "simulate": ["simulate", "demo", "--observations-only"],
    }[command]
    (tmp_path / "file").write_text("somebody's")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("years of work")
    for place in (tmp_path / "file", tmp_path / "file" / "out", tmp_path / "full", Path("/proc/out"), Path("/")):
        assert run(*arguments, "-o", place) == BAD_INPUT
        err = capsys.readouterr().err
        assert_one_plain_line(err)
        assert "adjustment" not in err
    assert (tmp_path / "file").read_text() == "somebody's"
    assert [f.name for f in (tmp_path / "full").iterdir()] == ["thesis.tex"]
    assert names(tmp_path) == ["file", "full"]


def test_recording_is_never_the_output(spoilt: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = names(spoilt)
    assert run("calibrate", spoilt, "-o", spoilt) == BAD_INPUT
    assert_one_plain_line(capsys.readouterr().err)
    assert names(spoilt) == before


def test_older_result_is_replaced_whole(session_folder: Path, result_folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(result_folder, out)
    (out / "bars.csv").write_text("of the older result")
    assert run("calibrate", session_folder, "-o", out, "--seed", "1") == DONE
    assert_whole_result(out)
    assert "bars.csv" not in names(out)
    assert json.loads((out / "rig.json").read_text())["software"]["seed"] == 1
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize(
    "trouble", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=["disk", "ctrl-c"]
)
@pytest.mark.parametrize("older", [False, True])
def test_trouble_while_writing_changes_nothing(
    trouble: BaseException,
    older: bool,
    session_folder: Path,
    result_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    if older:
        shutil.copytree(result_folder, out)
    before = {f.name: f.read_bytes() for f in out.iterdir()} if older else None
    real, calls = writing.write_table, []

    def failing(path: Path, *rest: object) -> None:
        calls.append(path)
        if len(calls) == 2:
            path.write_text("half")
            raise trouble
        real(path, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(writing, "write_table", failing)
    capsys.readouterr()
    expected = CANCELLED if isinstance(trouble, KeyboardInterrupt) else BAD_INPUT
    assert run("calibrate", session_folder, "-o", out, "--seed", "9") == expected
    assert len(calls) == 2
    assert_one_plain_line(capsys.readouterr().err)
    assert names(tmp_path) == (["out"] if older else [])
    if older:
        assert {f.name: f.read_bytes() for f in out.iterdir()} == before


def test_a_folder_name_of_two_lines_is_refused(
    session_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("calibrate", session_folder, "-o", tmp_path / "a\nb") == BAD_INPUT
    assert "Traceback" not in capsys.readouterr().err
    assert not (tmp_path / "a\nb").exists()


@pytest.mark.parametrize("odd", ["a b", "a[bold]b", "x[/b]", "ü", "-x", "100%"])
def test_odd_folder_names(odd: str, two_cameras: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / odd
    assert run("calibrate", two_cameras, "-o", folder) == NOT_VALID
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    assert str(folder) in out
    assert (folder / "rig.json").is_file()


@pytest.mark.parametrize(
    "arguments",
    [
        ["calibrate"],
        ["calibrate", "session"],
        ["calibrate", "session", "-o"],
        ["calibrate", "session", "-o", "out", "--method", "magic"],
        ["calibrate", "session", "-o", "out", "--seed", "-1"],
        ["calibrate", "session", "-o", "out", "--seed", "one"],
        ["calibrate", "session", "-o", "out", "--seed", str(2**31)],
        ["calibrate", "session", "-o", "out", "--intrinsics", "maybe"],
        ["simulate", "demo"],
        ["verify", "session", "-o", "out"],
        ["targets"],
        ["fly"],
        ["--fly"],
    ],
)
def test_bad_usage(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    assert "error: " in err.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_unknown_preset(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for preset in ("rigC", "hall7", ""):
        assert run("simulate", preset, "--observations-only", "-o", tmp_path / "out") == BAD_INPUT
        assert_one_plain_line(capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []


def test_verify_needs_a_rig(session_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rig.json").write_text("{")
    for rig in (tmp_path / "none.json", tmp_path / "rig.json", session_folder / "session.json", tmp_path):
        assert run("verify", session_folder, "--rig", rig, "-o", tmp_path / "out") == BAD_INPUT
        assert_one_plain_line(capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


def save(folder: Path, places: FloatArray | None, cameras: list[int] | None = None) -> Path:
    """A session folder of chosen points, or of the demo rig with two groups of cameras that share nothing."""
    if places is not None:
        write_session(*session_of_points("demo", places, 0.0), folder)
        return folder
    session, truth = simulated("rigA", 3)
    o = observed(session)
    left, right = [0, 1, 5, 6], [3, 4, 8, 9]
    apart = (np.isin(o.camera, left) & (o.placement < 2)) | (np.isin(o.camera, right) & (o.placement >= 2))
    write_session(with_observations(session, apart if cameras is None else np.isin(o.camera, cameras)), truth, folder)
    return folder


NOT_VALID_SESSIONS: dict[str, Callable[[Path], Path]] = {
    "collinear": lambda folder: save(folder, line(50)[None]),
    "too few": lambda folder: save(folder, cloud(15)[None]),
    "unconnected": lambda folder: save(folder, None),
    "two cameras": lambda folder: save(folder, None, [0, 1]),
}


@pytest.mark.parametrize("name", NOT_VALID_SESSIONS)
def test_what_cannot_be_calibrated_is_a_result_that_is_not_valid(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = NOT_VALID_SESSIONS[name](tmp_path / "session")
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert run("calibrate", folder, "-o", tmp_path / "out") == NOT_VALID
    out, err = capsys.readouterr()
    assert out.startswith("NOT VALID")
    assert "Traceback" not in err and "spherecal:" not in err
    assert_whole_result(tmp_path / "out")
    document = json.loads((tmp_path / "out" / "rig.json").read_text())
    assert document["quality"]["valid"] is False
    errors = [f for f in document["quality"]["findings"] if f["severity"] == "error"]
    assert errors
    assert all(finding["hint"] for finding in errors)
    assert "NaN" not in (tmp_path / "out" / "rig.json").read_text()
    if name == "unconnected":
        finding = next(f for f in errors if f["code"] == "cameras-unlinked")
        placed = {camera["id"] for camera in document["cameras"]}
        assert len(placed) == 4
        assert set(finding["where"]) == {f"C{i:02d}" for i in range(1, 11)}
        assert "C01 C02 C06 C07" in finding["message"] and "C04 C05 C09 C10" in finding["message"]
    read_rig(tmp_path / "out" / "rig.json")  # a result that is not valid is readable all the same


def test_ctrl_c_is_one_line(
    session_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "read_session", interrupted)
    assert run("calibrate", session_folder, "-o", tmp_path / "out") == CANCELLED
    assert assert_one_plain_line(capsys.readouterr().err) == "spherecal: Cancelled."
    assert list(tmp_path.iterdir()) == []


def shell(*arguments: object, **options: object) -> subprocess.CompletedProcess[str]:
    """The installed command in a process of its own."""
    command = [sys.executable, "-m", "spherecal_app.cli.main", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, **options)  # type: ignore[call-overload]


def test_real_process_gives_the_same_bytes(session_folder: Path, result_folder: Path, tmp_path: Path) -> None:
    done = shell("calibrate", session_folder, "-o", tmp_path / "out", "--log", tmp_path / "log.txt", "--json")
    assert done.returncode == DONE
    assert json.loads(done.stdout)["valid"] is True
    for file in RESULT_FILES:
        assert (tmp_path / "out" / file).read_bytes() == (result_folder / file).read_bytes()
    log = (tmp_path / "log.txt").read_text()
    assert "calibrate" in log and "stage: bundle adjustment" in log and "finding: " in log


def test_real_process_of_a_rig_that_is_not_valid_ends_with_3(two_cameras: Path, tmp_path: Path) -> None:
    assert shell("calibrate", two_cameras, "-o", tmp_path / "out").returncode == NOT_VALID == 3


def test_real_process_with_bad_input_says_and_logs_it(tmp_path: Path) -> None:
    done = shell("--log", tmp_path / "log.txt", "calibrate", tmp_path / "nowhere", "-o", tmp_path / "out")
    assert done.returncode == BAD_INPUT
    assert done.stdout == ""
    message = assert_one_plain_line(done.stderr)
    assert "nowhere" in message
    assert message.removeprefix("spherecal: ")[:40] in (tmp_path / "log.txt").read_text()
    assert names(tmp_path) == ["log.txt"]


def test_log_that_cannot_be_written(session_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for log in (tmp_path, tmp_path / "no" / "log.txt", Path("/proc/log.txt")):
        assert run("calibrate", session_folder, "-o", tmp_path / "out", "--log", log) == BAD_INPUT
        assert_one_plain_line(capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []


def test_each_run_of_a_process_has_its_own_log(tmp_path: Path) -> None:
    """Where a log handler exists already, as pytest's here, the file was ignored."""
    assert logging.root.handlers
    for name in ("first", "second"):
        assert run("calibrate", tmp_path / name, "-o", tmp_path / "out", "--log", tmp_path / f"{name}.txt") == BAD_INPUT
    texts = [(tmp_path / f"{name}.txt").read_text() for name in ("first", "second")]
    assert "first" in texts[0] and "second" not in texts[0]
    assert "second" in texts[1] and "first" not in texts[1]


def test_version_and_help() -> None:
    done = shell("--version")
    assert done.returncode == DONE
    assert re.fullmatch(r"spherecal \d+\.\d+\S*\n", done.stdout)


@pytest.fixture(scope="module")
def large_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Takes seconds in every stage."""
    folder = tmp_path_factory.mktemp("large") / "session"
    session, truth = simulated("hall24", 1)
    write_session(replace(session, bars=(), bar_poses=()), truth, folder)
    return folder


@pytest.mark.skipif(os.name == "nt", reason="SIGINT reaches a whole console there")
@pytest.mark.parametrize("stage", ["reading the session", "triples", "growing the network", "bundle adjustment"])
def test_interrupt_ends_a_running_calibration_and_leaves_nothing(
    stage: str, large_session: Path, tmp_path: Path
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "spherecal_app.cli.main", "calibrate", large_session, "-o", tmp_path / "out"],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        # whoever runs the tests in the background has interrupts ignored, and children inherit that
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )
    assert process.stderr is not None
    seen = ""
    for text in process.stderr:
        seen += text
        if stage in text:
            break
    else:
        pytest.fail(f"ended before {stage}: {seen}")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == CANCELLED, err
    assert out == ""
    assert assert_one_plain_line(seen + err) == "spherecal: Cancelled."
    assert list(tmp_path.iterdir()) == []
    assert names(large_session.parent) == ["session"]


def test_a_calibration_of_observations_loads_only_the_method(tmp_path: Path) -> None:
    """No simulator, report, camera, rig or window, only formats: what is loaded follows need."""
    write_session(*simulate_session("demo", 1, SimulationOptions(targets=80)), tmp_path / "session")
    code = (
        "import sys; from spherecal_app.cli.main import main\n"
        "assert main(['calibrate', sys.argv[1], '-o', sys.argv[2], '-q']) == 0\n"
        "ours = {name.partition('.')[0] for name in sys.modules if name.startswith('spherecal')}\n"
        "assert ours == {'spherecal', 'spherecal_app', 'spherecal_files'}, ours\n"
        "assert not {'matplotlib', 'typst', 'PySide6', 'harvesters', 'genicam'} & set(sys.modules)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "session"), str(tmp_path / "result")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
