"""`--json`: every command has it, prints one document and nothing else, with the keys that docs/commands.md names."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import ROOT

import spherecal
from spherecal_app.cli.documents_command import manual_page
from spherecal_app.cli.exit_codes import BAD_INPUT, DONE, NOT_VALID
from spherecal_app.cli.main import main
from spherecal_app.cli.options import make_parser
from spherecal_app.cli.parsing import is_leaf, parsers_below

LEAVES = {words: one for words, one in parsers_below(make_parser()) if is_leaf(one)}
TEXT = {("help",), ("completion",)}  # a text for a person, a script for a shell
BAR = ["--mark", "A=1", "--mark", "B=2", "--length", "A,B,100,0.01", "--expansion", "1e-5"]

# The commands that need a compiler, a network of their own or minutes are run with --json where they are tested.
ELSEWHERE = {
    ("cameras", "build-producer"): "test_producer_feed.py",
    ("cameras", "simulate-producer"): "test_producer_feed.py",
    ("cameras", "simulate-gige"): "test_gige_ends.py",
    ("compile-kernels",): "test_compile_kernels.py",
    ("batch",): "test_batch.py",
    ("measure",): "test_measure_command.py",
}

# What follows the command; S: a session, R: its result, F: one that failed, P: a profile, W: a folder to work in.
RUNS: dict[str, str] = {
    "demo": "-o W/demo",
    "simulate": "hall6 --observations-only -o W/simulated",
    "targets export": "--count 3 -o W/targets.json",
    "targets sheet": "--count 3 -o W/sheet.pdf",
    "detect": "W/grey.png --targets W/three.json --csv W/dots.csv",
    "calibrate": "S -o W/calibrated",
    "verify": "S --rig R -o W/verified",
    "override": "F --by Someone --reason shapes",
    "report": "R -o W/report.html",
    "ball export": "R -o W/ball.json",
    "ball show": "R",
    "bars list": "--registry W/bars.json",
    "bars show": "S1 --registry W/bars.json",
    "bars export": "W/bars.csv --registry W/bars.json",
    "bars import": "W/table.csv --registry W/others.json",
    "bars add": f"S2 {' '.join(BAR)} --registry W/bars.json",
    "bars remove": "S1 --registry W/removed.json",
    "bars plan": "R --session S",
    "check": "S --profile R",
    "support-bundle": "S -o W/bundle.zip",
    "export": "R --to csv -o W/csv",
    "import": "W/theirs --format opencv -o W/imported.json",
    "import-priors": "W/theirs --session S -o W/priors",
    "frame": "R -o W/frame.json",
    "limits show": "--file W/limits.json",
    "profile save": "R --to W/saved",
    "profile list": "W",
    "profile show": "P",
    "profile apply": "P",
    "profile restore": "P",
    "profile compare": "R R",
    "profile trend": "P",
    "recalibrate": "S --rig R --only C02 -o W/again",
    "guide": "S",
    "cross-validate": "S",
    "session new": "W/new --images W/images --board chessboard,rows=4,columns=5,pitch_mm=20 --focal-length 8 "
    "--pixel-pitch 5",
    "study": "path --session S --runs 1 --workers 0 -o W/study",
    "licences": "",
    "manual": "",
    "doctor": "",
    "cameras list": "--source simulated --profile W/cameras.json",
    "cameras show": "C01 --source simulated --profile W/cameras.json",
    "cameras set": "C01 --name door --source simulated --profile W/cameras.json",
    "cameras doctor": "--source simulated --seconds 0.5 --profile W/cameras.json",
    "cameras capture": "--source simulated --placements 1 --no-wait --targets W/three.json -o W/captured "
    "--profile W/cameras.json",
    "cameras trust": "",
}

Run = Callable[[str], Any]


def documented() -> dict[str, set[str]]:
    """The keys of each command's document, from the table of docs/commands.md."""
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8").split("## What `--json` prints")[1]
    rows = re.findall(r"^\| (`[a-z -]+`(?:, `[a-z -]+`)*) \|([^|]*)\|", page, re.MULTILINE)
    return {name: set(re.findall(r"`(\w+)`", keys)) for names, keys in rows for name in names.strip("`").split("`, `")}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The arguments of a line of RUNS."""
    work = tmp_path_factory.mktemp("json")
    session, result, profile = work / "session", work / "result", work / "profile"
    spherecal.simulate_session("demo", 1, spherecal.SimulationOptions(targets=80), folder=session)
    spherecal.save_calibration(spherecal.calibrate_session(session), result)
    cv2.imwrite(str(work / "grey.png"), np.full((200, 200), 128, np.uint8))
    spherecal.save_targets(spherecal.make_targets(3), work / "three.json")
    spherecal.export_rig(spherecal.load_rig(result), "opencv", work / "theirs")
    for camera in ("left", "right"):
        for number in (1, 2, 3):
            place = work / "images" / camera / f"{number}.png"
            place.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(place), np.full((120, 160), 40 * number, np.uint8))
    for line in (
        ["bars", "add", "S1", *BAR, "--registry", work / "bars.json"],
        ["bars", "export", work / "table.csv", "--registry", work / "bars.json"],
        ["profile", "save", result, "--to", profile, "--apply", "-q"],
        ["profile", "save", result, "--to", profile, "--apply", "-q", "--calibrated-at", "2026-01-01T10:00:00"],
    ):
        assert main([str(word) for word in line]) == DONE
    shutil.copy(work / "bars.json", work / "removed.json")
    shutil.copytree(result, work / "failed")
    assert main(["verify", str(session), "--rig", str(result / "rig.json"), "-o", str(work / "failed")]) == DONE
    failed = work / "failed" / "verification.json"
    failed.write_text(failed.read_text().replace('"consistent"', '"inconsistent"'))
    places = {"S": session, "R": result, "F": work / "failed", "P": profile, "W": work}

    def of(name: str) -> list[str]:
        words = [re.sub(r"^([SRFPW])(?=/|$)", lambda m: str(places[m[1]]), word) for word in RUNS[name].split()]
        return [*name.split(), *words]

    return of


@pytest.mark.parametrize("words", LEAVES, ids=" ".join)
def test_every_command_has_it_and_is_run_with_it(words: tuple[str, ...]) -> None:
    known = {name for action in LEAVES[words]._actions for name in action.option_strings}
    assert ("--json" in known) == (words not in TEXT)
    if words in ELSEWHERE:
        assert '"--json"' in next((ROOT / "tests").rglob(ELSEWHERE[words])).read_text(encoding="utf-8")
    elif words not in TEXT:
        assert " ".join(words) in RUNS


def test_the_page_has_a_row_for_each() -> None:
    assert set(documented()) == {" ".join(words) for words in set(LEAVES) - TEXT}


@pytest.mark.parametrize("name", RUNS)
def test_one_document_and_nothing_else(
    name: str, run: Run, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "demo":  # without images, which are rendered and detected in test_demo.py
        monkeypatch.setattr("spherecal_app.cli.demo.demo_session", lambda _: Path(run("calibrate")[1]))
        monkeypatch.setenv("SPHERECAL_3D", "painted")
    code = main([*run(name), "--json"])
    out, err = capfd.readouterr()
    if name == "manual" and manual_page("en") is None:  # not built here
        assert (code, out) == (BAD_INPUT, "")
        return
    assert code in (DONE, NOT_VALID), err

    def refused(text: str) -> None:
        raise AssertionError(f"{text} is no JSON")

    document = json.loads(out, parse_constant=refused)
    assert json.dumps(document, indent=1) == out.rstrip("\n"), "the same form everywhere"
    keys = documented()[name]
    if isinstance(document, list):
        assert document and all(set(one) == keys for one in document)
    else:
        assert set(document) == ({"path"} if name == "study" else keys)


@pytest.mark.parametrize(
    "name", ["bars export", "support-bundle", "ball export", "frame", "export", "licences --texts"]
)
def test_beside_a_file_on_standard_output_it_goes_to_standard_error(
    name: str, run: Run, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    words = [*run(name.split(" --", maxsplit=1)[0])]
    if name.startswith("bars"):
        words[2] = "-"
    elif name.startswith("licences"):
        words += ["--texts", "-"]
    else:
        words[words.index("-o") + 1] = "-"
    assert main([*words, "-q", "--json"]) == DONE
    out, err = capfdbinary.readouterr()
    assert json.loads(err) and len(out) > 100


def test_brackets_in_paths_are_printed(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPHERECAL_3D", "painted")
    folder = tmp_path / "[old] rig"
    folder.mkdir()
    for name in ("report", "targets export", "ball export", "frame", "bars export", "export", "support-bundle"):
        words = run(name)
        at = 2 if name == "bars export" else words.index("-o") + 1
        words[at] = str(folder / Path(words[at]).name)
        assert main(words) == DONE
        assert words[at] in capsys.readouterr().out, name
