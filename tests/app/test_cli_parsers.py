"""The command line's shape: help for every command and option, the same conventions in all, misspellings."""

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import spherecal
from spherecal.base import early
from spherecal.data.findings import counted
from spherecal.initialise.camera_path import BASE
from spherecal.initialise.view_graph import TH_ER_PX
from spherecal_app.cli import console as commands
from spherecal_app.cli import doctor_command as doctor
from spherecal_app.cli.console import out as console
from spherecal_app.cli.exit_codes import BAD_INPUT, DONE, NOT_VALID
from spherecal_app.cli.main import main
from spherecal_app.cli.options import TABLE, command_of, make_parser
from spherecal_app.cli.parsing import is_leaf, parsers_below

PARSERS = dict(parsers_below(make_parser()))
LEAVES = {words: parser for words, parser in PARSERS.items() if is_leaf(parser)}


def run(*arguments: object) -> int:
    try:
        return main([str(a) for a in arguments])
    except SystemExit as left:
        return int(left.code or 0)


@pytest.fixture(scope="module")
def session_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("parsers") / "session"
    spherecal.simulate_session("demo", 1, spherecal.SimulationOptions(targets=80), folder=folder)
    return folder


@pytest.fixture(scope="module")
def result_folder(session_folder: Path) -> Path:
    folder = session_folder.parent / "result"
    spherecal.save_calibration(spherecal.calibrate_session(session_folder), folder)
    return folder


# --- all parsers -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", PARSERS, ids=" ".join)
def test_every_argument_has_help_and_every_command_a_description(words: tuple[str, ...]) -> None:
    parser = PARSERS[words]
    assert parser.description and parser.description.rstrip().endswith(".")
    for action in parser._actions:
        if not isinstance(action, argparse._SubParsersAction):
            assert action.help, f"{' '.join(words)} {action.option_strings or action.dest}"
    parser.format_help()  # a stray % would fail here


@pytest.mark.parametrize("words", PARSERS, ids=" ".join)
def test_options_are_never_abbreviated(words: tuple[str, ...]) -> None:
    assert not PARSERS[words].allow_abbrev


@pytest.mark.parametrize("words", LEAVES, ids=" ".join)
def test_log_verbose_and_quiet_are_everywhere(words: tuple[str, ...]) -> None:
    known = {name for action in LEAVES[words]._actions for name in action.option_strings}
    assert {"-h", "--help", "--log", "-v", "--verbose", "-q", "--quiet"} <= known


@pytest.mark.parametrize("words", LEAVES, ids=" ".join)
def test_one_name_has_one_meaning(words: tuple[str, ...]) -> None:
    """-o is where the result goes, --json a flag, --seed a number; and long names have dashes, no underscores."""
    for action in LEAVES[words]._actions:
        for name in action.option_strings:
            assert re.fullmatch(r"-[a-zA-Z]|--[a-z]+(-[a-z0-9]+)*", name), name
        if "-o" in action.option_strings:
            assert "--output" in action.option_strings
        if "--json" in action.option_strings:
            assert action.nargs == 0
        if "--seed" in action.option_strings:
            assert callable(action.type)


def test_every_command_can_be_run() -> None:
    run = {words for words, about in TABLE["commands"].items() if "run" in about}
    assert {" ".join(words) for words in LEAVES} == {*run, "help"}
    for words in run:
        command, _, action = words.partition(" ")
        run_by = command_of(argparse.Namespace(command=command, action=action or None))
        assert callable(run_by) and run_by.__doc__ and f"`spherecal {words}" in run_by.__doc__, words


def test_help_loads_no_engine() -> None:
    """Whoever asks for help waits for the parsers alone."""
    code = (
        "import sys\n"
        "from spherecal_app.cli.main import main\n"
        "try:\n    main(sys.argv[1:])\n"
        "except SystemExit:\n    print(*sys.modules, file=sys.stderr)\n"
    )
    for words in (["--help"], ["calibrate", "--help"], ["cameras", "capture", "--help"]):
        done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
        loaded = done.stderr.split()
        assert "spherecal_app.cli.options" in loaded
        rooms = {name.split(".")[1] for name in loaded if name.startswith("spherecal.")}
        assert rooms == {"base"}, rooms
        assert {name.split(".")[0] for name in loaded if name.startswith("spherecal")} == {"spherecal", "spherecal_app"}
        assert not {"scipy", "cv2", "numba", "rich", "spherecal_sim"} & set(loaded)


def test_the_default_of_path_base_is_the_methods() -> None:
    defaults = PARSERS[("calibrate",)].parse_args(["session", "-o", "result"])
    assert (defaults.path_base, defaults.path_error) == (BASE, TH_ER_PX)


# --- ways in ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", [["-V"], ["--version"]])
def test_version(words: list[str], capsys) -> None:
    assert run(*words) == DONE
    assert capsys.readouterr().out == f"spherecal {spherecal.__version__}\n"


def test_the_package_runs_as_a_module(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "spherecal", "-V"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (DONE, f"spherecal {spherecal.__version__}\n")
    wrong = subprocess.run(
        [sys.executable, "-m", "spherecal", "calibrate", tmp_path / "none", "-o", tmp_path / "out"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert wrong.returncode == BAD_INPUT and "there is no such folder" in wrong.stderr
    assert "Traceback" not in wrong.stderr


@pytest.mark.parametrize(
    ("line", "ours"),
    [
        (["python", "-m", "spherecal", "-V"], True),
        (["python", "-X", "dev", "-I", "-m", "spherecal_app.cli.main"], True),
        (["python", "-m", "pytest", "-m", "spherecal"], False),
        (["python", "tool.py", "-m", "spherecal"], False),
        (["python", "-c", "import spherecal"], False),
        (["python"], False),
    ],
)
def test_ctrl_c_is_taken_care_of_in_our_own_program_only(line: list[str], ours: bool, monkeypatch) -> None:
    monkeypatch.setattr(sys, "orig_argv", line)
    monkeypatch.setattr(sys, "argv", [line[1] if len(line) > 1 else ""])
    assert early.is_own_program() == ours


def test_help_prints_what_the_option_prints(capsys) -> None:
    for words in ([], ["calibrate"], ["profile"], ["profile", "save"], ["cameras", "capture"]):
        assert run("help", *words) == DONE
        said = capsys.readouterr().out
        assert run(*words, "--help") == DONE
        assert capsys.readouterr().out == said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["calibrat"], 'there is no command "calibrat"; is "calibrate" meant?'),
        (["verfy", "x"], 'is "verify" meant?'),
        (["profile", "sve"], 'there is no command "sve"; is "save" meant?'),
        (["help", "exprot"], 'is "export" meant?'),
        (["frobnicate"], "there are help, demo, simulate"),
        (["calibrate", "s", "-o", "r", "--methd", "free"], 'not known: --methd free; is "--method" meant?'),
        (["calibrate", "s", "-o", "r", "--meth", "free"], 'is "--method" meant?'),
        (["calibrate", "s", "-o", "r", "--method", "ridgid"], 'is "rigid" meant?'),
        (["simulate", "demo", "-o", "s", "--observations"], 'is "--observations-only" meant?'),
        (["verify", "s", "--rig", "r", "-o", "o", "extra"], "not known: extra"),
        (["simulate", "demo", "-o", "s", "--seed", "one"], "a seed is a whole number from 0"),
    ],
)
def test_misspellings_get_a_suggestion(words: list[str], message: str, capsys) -> None:
    assert run(*words) == BAD_INPUT
    err = capsys.readouterr().err
    assert message in err and "Traceback" not in err


def test_a_wrong_option_is_said_in_one_line(capsys) -> None:
    """14 lines of usage before."""
    assert run("profile", "show", "p", "--temprature", "20") == BAD_INPUT
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and 'is "--temperature" meant? Help: spherecal profile show --help' in err
    assert run("profile") == BAD_INPUT
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "required: one of save, list, show" in err


def test_the_help_groups_every_command_once(capsys) -> None:
    assert run("--help") == DONE
    lines = capsys.readouterr().out.splitlines()
    headings = [line for line in lines if line.endswith(":") and not line.startswith(" ")]
    assert headings[:4] == ["to begin:", "recording:", "calibrating and verifying:", "using a calibrated rig:"]
    listed = [line.split()[0] for line in lines if re.match(r"  [a-z]", line)]
    assert sorted(listed) == sorted({words[0] for words in PARSERS if words})


def test_the_help_of_calibrate_is_short_and_the_whole_is_asked_for(capsys) -> None:
    """20 options of the paper stood beside the daily four."""
    assert run("calibrate", "--help") == DONE
    short = capsys.readouterr().out
    assert run("calibrate", "--help-all") == DONE
    whole = capsys.readouterr().out
    options = {name for action in PARSERS["calibrate",]._actions for name in action.option_strings}
    assert options <= set(re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", whole))
    assert "--xi" not in short and "--dijkstra" not in short and "--help-all" in short
    assert len(short.splitlines()) <= 36 and "--method" in short and "--ball" in short


def test_without_the_window_the_bare_command_says_what_to_do(capsys, monkeypatch) -> None:
    """It ended with a complaint about PySide6."""
    monkeypatch.setattr("spherecal_app.cli.main.find_spec", lambda name: None)
    assert run() == BAD_INPUT
    out, err = capsys.readouterr()
    assert not out and err.count("\n") == 1 and "PySide6" not in err
    assert "spherecal[gui]" in err and "spherecal demo" in err and "spherecal --help" in err


# --- what they say ---------------------------------------------------------------------------------------------------


def test_quiet_says_nothing_but_the_json(session_folder: Path, result_folder: Path, tmp_path: Path, capsys) -> None:
    verify = ["verify", session_folder, "--rig", result_folder, "-o", tmp_path / "b"]
    for words in (
        ["calibrate", session_folder, "-o", tmp_path / "a", "-q"],
        ["-q", *verify],
    ):
        assert run(*words) == DONE
        assert capsys.readouterr() == ("", "")
    assert run("calibrate", session_folder, "-o", tmp_path / "a", "--quiet", "--json") == DONE
    out, err = capsys.readouterr()
    assert json.loads(out)["valid"] and not err
    assert run("guide", session_folder, "-q") == DONE
    assert capsys.readouterr() == ("", "")
    assert run("calibrate", tmp_path / "none", "-o", tmp_path / "c", "-q") == BAD_INPUT
    assert "there is no such folder" in capsys.readouterr().err
    assert not console.quiet and not commands.quiet, "the next command speaks again"
    assert run(*verify) == DONE
    assert capsys.readouterr().out.startswith("CONSISTENT")


def test_verbose_shows_the_log(session_folder: Path, tmp_path: Path, capsys) -> None:
    assert run("calibrate", session_folder, "-o", tmp_path / "a", "-v") == DONE
    err = capsys.readouterr().err
    assert f"  spherecal {spherecal.__version__}: calibrate" in err and "  finding: info scale-uncertainty" in err
    assert run("calibrate", tmp_path / "none", "-o", tmp_path / "c", "-v") == BAD_INPUT
    assert capsys.readouterr().err.count("there is no such folder") == 1, "an error is said once"
    assert run("-v", "-q", "doctor") == BAD_INPUT


def test_a_log_of_any_command(tmp_path: Path) -> None:
    line = [
        sys.executable,
        "-m",
        "spherecal",
        "bars",
        "list",
        "--registry",
        tmp_path / "none.json",
        "--log",
        tmp_path / "log",
    ]
    assert subprocess.run(line, capture_output=True, check=False).returncode == DONE
    assert "bars" in (tmp_path / "log").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("number", "noun", "plural", "said"),
    [
        (1, "camera", None, "1 camera"),
        (2, "camera", None, "2 cameras"),
        (0, "dot", None, "0 dots"),
        (3, "lens", "lenses", "3 lenses"),
    ],
)
def test_counts_have_the_right_number(number: int, noun: str, plural: str | None, said: str) -> None:
    assert counted(number, noun, plural) == said


def test_one_is_never_many(session_folder: Path, result_folder: Path, tmp_path: Path, capsys) -> None:
    """Of the commands that print numbers, with one of everything."""
    assert run("targets", "export", "--count", "1", "-o", tmp_path / "targets.json") == DONE
    assert (
        run(
            "bars",
            "add",
            "S1",
            "--mark",
            "A=1",
            "--mark",
            "B=2",
            "--length",
            "A,B,100,0.01",
            "--expansion",
            "1e-5",
            "--registry",
            tmp_path / "bars.json",
        )
        == DONE
    )
    assert run("bars", "list", "--registry", tmp_path / "bars.json") == DONE
    K, zero = [[1200.0, 0, 640], [0, 1200, 480], [0, 0, 1]], [0.0, 0, 0]
    spherecal.save_rig(spherecal.Rig.from_opencv({"C1": (K, None, zero, zero)}, (1280, 960)), tmp_path / "one.json")
    assert run("export", tmp_path / "one.json", "--to", "csv", "-o", tmp_path / "csv") == DONE
    out = capsys.readouterr().out
    assert "1 target in" in out and "1 length," in out and "1 camera in" in out
    assert not re.search(r"\b1 [a-z]+s\b(?! \()", out.replace("1 ppms", "")), out


# --- files -----------------------------------------------------------------------------------------------------------


def test_a_result_folder_stands_for_its_rig(session_folder: Path, result_folder: Path, tmp_path: Path) -> None:
    assert run("verify", session_folder, "--rig", result_folder, "-o", tmp_path / "verified") == DONE
    assert run("export", result_folder, "--to", "opencv", "-o", tmp_path / "opencv") == DONE
    assert run("recalibrate", session_folder, "--rig", result_folder, "--only", "C02", "-o", tmp_path / "again") == DONE
    assert run("check", session_folder, "--profile", result_folder) == DONE
    assert run("profile", "compare", result_folder, result_folder) == DONE
    assert run("bars", "plan", result_folder, "--session", session_folder) == DONE


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("session", "new", "s", "--images", "i", "--sphere", "50cm"), "--sphere: a number is needed, not '50cm'"),
        (("targets", "export", "--count", "2.5", "-o", "t"), "--count: a whole number is needed, not '2.5'"),
    ],
)
def test_what_is_no_number_is_said_without_the_names_of_types(words: tuple[str, ...], said: str, capsys) -> None:
    with pytest.raises(SystemExit):
        main(list(words))
    assert said in capsys.readouterr().err


def test_a_report_of_what_is_no_result_says_what_one_is(session_folder: Path, tmp_path: Path, capsys) -> None:
    assert run("report", session_folder, "-o", tmp_path / "report.pdf") == BAD_INPUT
    assert f"{session_folder}: contains no rig.json. A result is the folder that" in capsys.readouterr().err


def test_a_folder_without_a_rig_is_named(session_folder: Path, tmp_path: Path, capsys) -> None:
    assert run("export", session_folder, "--to", "csv", "-o", tmp_path / "csv") == BAD_INPUT
    assert f"{session_folder / 'rig.json'}: there is no such file" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["report.docx", "report", "report.pdf.txt"])
def test_reports_are_written_by_known_endings_only(result_folder: Path, tmp_path: Path, name: str, capsys) -> None:
    assert run("report", result_folder, "-o", tmp_path / name) == BAD_INPUT
    assert "a report is written as .pdf, .html, .json or .xml" in capsys.readouterr().err
    assert not (tmp_path / name).exists()


def test_pictures_are_png(session_folder: Path, tmp_path: Path, capsys) -> None:
    assert run("guide", session_folder, "--picture", tmp_path / "next.jpg") == BAD_INPUT
    assert "a picture is written as .png" in capsys.readouterr().err


# --- exit codes ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frozen", "system", "wanted"),
    [
        (False, "Linux", "not installed (3-D views; install spherecal[gui])"),
        (True, "Linux", "not part of this package (3-D views; install the package spherecal-3d)"),
        (True, "Windows", "not part of this package (3-D views)"),
    ],
)
def test_doctor_names_what_installs_a_missing_part_here(monkeypatch, capsys, frozen, system, wanted) -> None:
    """pip does not reach into the .deb: there the 3-D view is a package of its own."""
    monkeypatch.setitem(sys.modules, "pyvista", None)  # as where it is not installed
    monkeypatch.setattr(sys, "frozen", frozen, raising=False)
    monkeypatch.setattr("platform.system", lambda: system)
    assert run("doctor") == DONE
    assert wanted in " ".join(capsys.readouterr().out.split())


def test_doctor_ends_with_3_where_something_needed_is_missing(monkeypatch, capsys) -> None:
    assert run("doctor") == DONE
    monkeypatch.setattr(doctor, "_NEEDED", (*doctor._NEEDED, "a_package_that_is_nowhere"))
    assert run("doctor") == NOT_VALID
    assert "a_package_that_is_nowhere" in capsys.readouterr().out
    assert run("doctor", "--json") == NOT_VALID
    found = {one["what"]: one["state"] for one in json.loads(capsys.readouterr().out)}
    assert found["a_package_that_is_nowhere"] == "missing" and found["numpy"] == found["kernels"] == "ok"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("study", "--seed", "-3"), "--seed: a seed is a whole number from 0 to 2147483646"),
        (("batch", "a", "-o", "b", "--seed", "-1"), "--seed: a seed is a whole number from 0 to 2147483646"),
        (("study", "--runs", "many"), "--runs: must be 1 or more"),
        (("study", "--sigma", "0"), "--sigma: must be from 0.0001 to 10 px"),
        (("cameras", "doctor", "--rate", "fast"), "--rate: a number above 0 is needed"),
    ],
)
def test_options_say_which_numbers_they_take(
    words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not "invalid _positive value"."""
    with pytest.raises(SystemExit, match="2"):
        main(list(words))
    assert f"argument {said}" in capsys.readouterr().err


def test_listing_cameras_ends_with_3_where_there_are_none(monkeypatch, tmp_path: Path, capsys) -> None:
    pytest.importorskip("genicam.gentl")
    monkeypatch.setenv("GENICAM_GENTL64_PATH", "")
    profile = ["--profile", tmp_path / "cameras.json"]
    assert run("cameras", "list", *profile) == NOT_VALID
    assert "No camera found." in capsys.readouterr().out
    assert run("cameras", "list", "--json", *profile) == NOT_VALID
    assert json.loads(capsys.readouterr().out)["cameras"] == []
    assert run("cameras", "list", "--source", "simulated", *profile) == DONE
