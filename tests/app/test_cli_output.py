"""Standard output in place of a file, completion in shells, and a rig drawn in space."""

import io
import json
import shutil
import subprocess
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3D
from rich.console import Console

import spherecal
from spherecal.base.errors import InputError, MissingPackage
from spherecal_app.cli.completion import script
from spherecal_app.cli.main import main
from spherecal_app.cli.options import make_parser
from spherecal_app.cli.parsing import is_leaf, parsers_below
from tests.export_rigs import make_rig


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    spherecal.save_rig(make_rig(4, 3), tmp_path / "rig.json")
    return tmp_path / "rig.json"


def said(capsysbinary, *words: object) -> tuple[bytes, bytes]:
    assert main([str(word) for word in words]) == 0
    captured = capsysbinary.readouterr()
    return captured.out, captured.err


def test_one_file_goes_to_standard_output_and_words_to_standard_error(rig_file, tmp_path, capsysbinary) -> None:
    for words, name in (
        (["export", rig_file, "--to", "csv"], "rig.csv"),
        (["export", rig_file, "--to", "gltf"], "rig.gltf"),
        (["targets", "export", "--count", "3"], "targets.json"),
        (["targets", "sheet", "--count", "3"], "sheet.pdf"),
        (["targets", "sheet", "--board", "chessboard,rows=4,columns=5,pitch_mm=20"], "board.pdf"),
    ):
        text, talk = said(capsysbinary, *words, "-o", "-")
        said(capsysbinary, *words, "-o", tmp_path / name)
        assert text == (tmp_path / name).read_bytes() and talk, words
    assert not Path("-").exists()


def test_a_table_of_dots_goes_to_standard_output(tmp_path, capsysbinary) -> None:
    import cv2

    cv2.imwrite(str(tmp_path / "grey.png"), np.full((200, 200), 128, np.uint8))
    spherecal.save_targets(spherecal.make_targets(3), tmp_path / "targets.json")
    text, _ = said(capsysbinary, "detect", tmp_path / "grey.png", "--targets", tmp_path / "targets.json", "--csv", "-")
    assert text == b"image,target,point,u,v\n"


def test_a_folder_and_a_report_do_not_go_there(rig_file, capsysbinary) -> None:
    assert main(["export", str(rig_file), "--to", "opencv", "-o", "-"]) == 2
    assert b"A folder cannot be written to standard output" in capsysbinary.readouterr().err
    assert main(["report", str(rig_file.parent), "-o", "-"]) == 2  # nothing says which form
    assert b".pdf" in capsysbinary.readouterr().err


# --- completion ------------------------------------------------------------------------------------------------------

bash = pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")


def completed(tmp_path: Path, line: str) -> list[str]:
    """What bash offers at the end of a line."""
    (tmp_path / "completion.bash").write_text(script(make_parser(), "bash"))
    words = line.split(" ")
    listed = " ".join(f"'{word}'" for word in words)
    command = f"source completion.bash; COMP_WORDS=({listed}); COMP_CWORD={len(words) - 1}; _spherecal; "
    done = subprocess.run(
        ["bash", "--norc", "-c", command + 'printf "%s\\n" "${COMPREPLY[@]}"'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=30,
    )
    assert not done.stderr
    return done.stdout.split()


@bash
@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("spherecal cal", ["calibrate"]), ("spherecal session ", ["new"]), ("spherecal targets s", ["sheet"]),
        ("spherecal session new --pat", ["--pattern"]), ("spherecal calibrate x --method b", ["board", "bar"]),
        ("spherecal calibrate --method=x -o y --lens ", ["auto", "brown", "rational", "fisheye"]),
        ("spherecal completion ", ["bash", "zsh", "fish"]), ("spherecal calibrate folder", []),
    ],
)  # fmt: skip
def test_bash_completes(tmp_path: Path, line: str, offered: list[str]) -> None:
    assert completed(tmp_path, line) == offered


@bash
def test_every_command_and_option_is_completed(tmp_path: Path) -> None:
    assert set(completed(tmp_path, "spherecal ")) == {w[0] for w, _ in parsers_below(make_parser()) if len(w) == 1}
    for words, parser in parsers_below(make_parser()):
        if is_leaf(parser) and len(words) == 2 and words[0] in ("profile", "cameras", "session"):
            offered = completed(tmp_path, f"spherecal {' '.join(words)} --")
            known = [name for action in parser._actions for name in action.option_strings if name.startswith("--")]
            assert offered == known, words


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_scripts_of_other_shells_are_read_by_them(tmp_path: Path, shell: str, capsys) -> None:
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert text == script(make_parser(), shell) and "calibrate" in text and "pattern" in text
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell} to read it")
    (tmp_path / "script").write_text(text)
    subprocess.run([shell, "-n", tmp_path / "script"], check=True, timeout=30)


# --- drawing ---------------------------------------------------------------------------------------------------------


def test_a_rig_is_drawn_where_its_cameras_are(tmp_path: Path) -> None:
    rig = make_rig(5, 6)
    figure = Figure()
    FigureCanvasAgg(figure)
    axes = rig.plot(figure.add_subplot(projection="3d"))
    assert [text.get_text() for text in axes.texts] == [camera.id for camera in rig]
    for line, camera in zip(axes.lines, rig, strict=True):
        x, y, z = (np.asarray(values) for values in cast(Line3D, line).get_data_3d())
        np.testing.assert_allclose((x[0], y[0], z[0]), camera.centre_mm)
        middle = np.array([x[[1, 2, 4, 5]].mean(), y[[1, 2, 4, 5]].mean(), z[[1, 2, 4, 5]].mean()])
        ahead = (middle - camera.centre_mm) / np.linalg.norm(middle - camera.centre_mm)
        assert ahead @ camera.rotation[2] > 0.99
    assert np.ptp(axes.get_xlim()) == np.ptp(axes.get_ylim()) == np.ptp(axes.get_zlim())
    figure.savefig(tmp_path / "rig.png")
    assert (tmp_path / "rig.png").stat().st_size > 10_000


def test_a_rig_that_cannot_be_drawn(monkeypatch) -> None:
    with pytest.raises(InputError, match="needs 3-D axes"):
        make_rig(5, 2).plot(Figure().add_subplot())
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.pyplot", None)
    with pytest.raises(MissingPackage, match=r"needs matplotlib"):
        make_rig(5, 2).plot()


def test_json_of_an_import_is_clean_beside_the_file(rig_file, tmp_path, capsysbinary) -> None:
    spherecal.export_rig(make_rig(4, 3), "kalibr", tmp_path / "camchain.yaml")
    text, _ = said(capsysbinary, "import", tmp_path / "camchain.yaml", "--format", "kalibr", "-o", "-")
    assert len(json.loads(text)["cameras"]) == 3


@pytest.mark.parametrize(
    "command",
    [
        ["calibrate", "session"], ["verify", "session", "--rig", "rig.json"], ["simulate", "demo"], ["demo"],
        ["measure", "session", "--rig", "rig.json"],
    ],
)  # fmt: skip
def test_a_folder_does_not_go_to_standard_output(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*command, "-o", "-"]) == 2
    said = capsys.readouterr()
    assert "A folder cannot be written to standard output" in said.err and not said.out
    assert not list(tmp_path.iterdir())


def test_a_package_that_is_missing_is_told_by_the_exit_code(monkeypatch, capsys) -> None:
    monkeypatch.setitem(__import__("sys").modules, "genicam", None)
    monkeypatch.setitem(__import__("sys").modules, "genicam.gentl", None)
    monkeypatch.setitem(__import__("sys").modules, "harvesters.core", None)
    assert main(["cameras", "list", "--source", "genicam"]) == 3
    assert "pip install 'spherecal[cameras]'" in capsys.readouterr().err


@pytest.mark.parametrize(("variable", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_no_colour_where_none_is_wanted(monkeypatch: pytest.MonkeyPatch, variable: str, value: str) -> None:
    """On a terminal; our console is one of rich's, made with the same settings."""

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")

    def printed() -> str:
        from spherecal_app.cli.console import out

        stream = Terminal()
        type(out)(file=stream, highlight=False, soft_wrap=True).print("[green]VALID[/]")
        return stream.getvalue()

    assert isinstance(Console(), Console) and "\x1b[32m" in printed()
    monkeypatch.setenv(variable, value)
    assert "\x1b[32m" not in printed()
