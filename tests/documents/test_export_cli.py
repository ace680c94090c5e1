"""`spherecal export` as a user has it: one line said, exit codes, files whole."""

import json
import re
from pathlib import Path

import pytest

from spherecal.data.rig import Quality, RigScale
from spherecal_app.cli.main import main
from spherecal_documents.export.write_export import FORMATS
from spherecal_files.rig_file import rig_bytes
from tests.export_rigs import make_rig


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    path = tmp_path / "rig.json"
    path.write_bytes(rig_bytes(make_rig(5, 3)))
    return path


@pytest.mark.parametrize("name", FORMATS)
def test_one_line_with_format_cameras_and_difference(rig_file: Path, tmp_path: Path, capsys, name: str) -> None:
    assert main(["export", str(rig_file), "--to", name, "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    found = re.match(rf"{name}: 3 cameras in .*out, lengths in mm?; largest difference (\S+) px over 1000 points", said)
    assert found is not None, said
    if name == "kalibr":
        assert "4 distortion coefficients: 3 lenses were fitted to it, which costs at most 0.0" in said
        assert 0.01 < float(found[1]) < 0.1
    else:
        assert said.count("\n") == 1
        assert float(found[1]) <= {"maps": 1e-3, "mrcal-splined": 0.01}.get(name, 1e-6)


def test_a_folder_says_what_it_holds(rig_file: Path, tmp_path: Path) -> None:
    assert main(["export", str(rig_file), "--to", "colmap", "-o", str(tmp_path / "out"), "--unit", "m"]) == 0
    said = json.loads((tmp_path / "out" / "export.json").read_text())
    assert (said["format"], said["export_format"], said["length_unit"]) == ("spherecal/export", "colmap", "m")
    assert said["cameras"] == {"C1": "C1", "C2": "C2", "C3": "C3"}


def test_bad_use_is_code_2_with_one_message(rig_file: Path, tmp_path: Path, capsys) -> None:
    out = str(tmp_path / "out")
    for arguments, expected in (
        ([str(rig_file), "--to", "houdini", "-o", out], "Formats: opencv, ros, kalibr"),
        ([str(tmp_path / "none.json"), "--to", "csv", "-o", out], "no such file"),
        ([str(rig_file), "--to", "kalibr", "-o", out, "--max-loss", "0.001"], "off by up to"),
        ([str(rig_file), "--to", "kalibr", "-o", out, "--max-loss", "nan"], "0 px or more"),
        ([str(rig_file), "--to", "csv", "-o", str(tmp_path / "missing" / "x.csv")], "cannot be written"),
        ([str(rig_file), "--to", "ros", "-o", out, "--unit", "mm"], "always in m"),
    ):
        assert main(["export", *arguments]) == 2
        error = capsys.readouterr().err
        assert expected in error
        assert error.count("\n") == 1
        assert not Path(out).exists()


def test_what_a_user_must_know_is_said(tmp_path: Path, capsys) -> None:
    from dataclasses import replace

    rig = replace(make_rig(5, 3), scale=RigScale("none", None), quality=Quality(False, None, None, None, ()))
    path = tmp_path / "rig.json"
    path.write_bytes(rig_bytes(rig))
    assert main(["export", str(path), "--to", "csv", "-o", str(tmp_path / "x.csv")]) == 0
    said = capsys.readouterr().out
    assert "the rig has no scale" in said
    assert "NOT VALID" in said
