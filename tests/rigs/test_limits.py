"""The file of limits: checked; the commands that read it."""

import json
import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spherecal.base.errors import InputError, OutputError, SpherecalError
from spherecal.initialise.view_graph import MIN_COMMON
from spherecal_app.cli.main import main
from spherecal_files.write_result import write_result
from spherecal_rigs.calibration_age import ValidityLimits
from spherecal_rigs.limits_file import DOTS, LIMITS, NAMES, PAIRS, Limits, limits_in_use, read_limits, write_limits
from spherecal_rigs.store import open_profile
from tests.conftest import ROOT
from tests.method.test_results import example_calibration
from tests.method.test_session_fuzz import JSON_VALUES

TIGHT = Limits(150, 2.0, 4.0, 0.5, 1.0, "0.03+L/20000", verification_limit_open=False, unverified_use=False)


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    file = tmp_path / "settings" / "limits.json"
    monkeypatch.setenv("SPHERECAL_LIMITS", str(file))
    return file


def run(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 0) -> str:
    assert main([*map(str, arguments)]) == code
    said = capsys.readouterr()
    if code:
        assert said.err.count("\n") == 1
    return said.err if code else said.out


def a_document(**changes: object) -> dict[str, Any]:
    limits = {name: getattr(TIGHT, name) for name in NAMES} | changes
    return {"format": LIMITS.name, "version": 1, "limits": limits}


def written(path: Path, document: object) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_without_a_file_the_delivered_limits_hold(path: Path) -> None:
    assert read_limits() == Limits()
    assert limits_in_use() == (Limits(), "")
    assert Limits().validity == ValidityLimits(), "one source of what is delivered"
    assert DOTS[0] == MIN_COMMON


def test_what_is_written_is_read_back(path: Path) -> None:
    write_limits(TIGHT)
    assert read_limits() == TIGHT
    assert limits_in_use() == (TIGHT, "")


def test_a_file_with_a_pin_and_a_log_as_earlier_versions_wrote_is_read_for_its_limits(path: Path) -> None:
    changed = {"at": "2026-11-21T12:00:00+00:00", "by": "Maria", "what": "stale_hours", "before": 12, "after": 4}
    pin = {"kind": "scrypt-16384-8-1", "salt": "ab" * 16, "hash": "ab" * 32}
    written(path, a_document() | {"pin": pin, "changes": [changed]})
    assert limits_in_use() == (TIGHT, "")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"stale_hours": 1.0}, "ageing_hours above stale_hours"),
        ({"ageing_kelvin": 3.0}, "ageing_kelvin above stale_kelvin"),
        ({"needed_dots": 10}, "limits.needed_dots must be from 20"),
        ({"needed_dots": 100.5}, "whole number"),
        ({"ageing_hours": -1}, "limits.ageing_hours must be from 0.1"),
        ({"stale_hours": 1e9}, "limits.stale_hours must be from 0.1 to 8760 hours"),
        ({"verification_limit": "0.03+"}, "limits.verification_limit is not a limit"),
        ({"unverified_use": 1}, "limits.unverified_use must be true or false"),
        ({"needed_dots": None, "needed_dotts": 5}, "needed_dots"),
    ],
)
def test_a_wrong_value_is_named_and_the_delivered_ones_hold(path: Path, changes: dict[str, Any], said: str) -> None:
    written(path, a_document(**changes))
    with pytest.raises(InputError, match=r"limits\.json") as caught:
        read_limits()
    assert said in str(caught.value)
    limits, problem = limits_in_use()
    assert limits == Limits() and said in problem and "delivered limits" in problem


@pytest.mark.parametrize("text", ["", "[]", '{"format": "spherecal/bars"}', '{"format": "spherecal/limits"', "\xff"])
def test_a_broken_file_is_named(path: Path, text: str) -> None:
    path.parent.mkdir()
    path.write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match=r"limits\.json"):
        read_limits()


@pytest.mark.skipif(os.name == "nt", reason="Windows makes links for administrators only")
def test_a_file_that_is_there_and_cannot_be_opened_is_named(path: Path) -> None:
    path.parent.mkdir()
    path.symlink_to(path)  # a loop
    assert "limits.json: cannot be read" in limits_in_use()[1]


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write_limits(Limits(), tmp_path / "file" / "limits.json")


PLACES = [
    *[("limits", name) for name in NAMES],
    ("limits",),
    ("format",),
]


@settings(max_examples=150)
@given(st.sampled_from(PLACES), JSON_VALUES)
def test_fuzzed_limits_give_limits_or_one_of_our_errors(
    tmp_path_factory: pytest.TempPathFactory, place: tuple[Any, ...], value: object
) -> None:
    document: Any = a_document()
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    file = written(tmp_path_factory.getbasetemp() / "fuzzed" / "limits.json", document)
    kept = None
    with suppress(SpherecalError):
        kept = read_limits(file)
    if kept is None:
        return
    for ageing, stale in PAIRS:
        assert 0 < getattr(kept, ageing) <= getattr(kept, stale)
    write_limits(kept, file)
    assert read_limits(file) == kept


def test_they_are_read_before_the_window_stands(path: Path) -> None:
    """Without what takes half a second to import, a formula included."""
    write_limits(TIGHT)
    code = (
        "import sys; from spherecal_rigs.limits_file import limits_in_use; print(limits_in_use()[0].stale_hours); "
        "sys.exit(bool({'scipy', 'numba', 'cv2'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "4.0"), done.stderr


# --- the commands ----------------------------------------------------------------------------------------------------


def test_the_limits_are_shown(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "stale_hours: 12\n" in run(capsys, "limits", "show") and not path.exists()
    write_limits(TIGHT)
    shown = run(capsys, "limits", "show")
    assert "stale_hours: 4 (delivered: 12)" in shown and "unverified_use: no (delivered: yes)" in shown
    assert json.loads(run(capsys, "limits", "show", "--json"))["limits"]["needed_dots"] == 150
    path.write_text("{}")
    assert "limits.json" in run(capsys, "limits", "show", code=2)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("limits") / "result"
    write_result(example_calibration(), folder)
    return folder


def test_a_new_profile_has_the_machines_limits_and_options_go_before(
    path: Path, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "profile", "save", result, "--to", tmp_path / "before")
    assert open_profile(tmp_path / "before").limits == ValidityLimits()
    write_limits(TIGHT)
    run(capsys, "profile", "save", result, "--to", tmp_path / "new", "--stale-hours", "3")
    assert open_profile(tmp_path / "new").limits == ValidityLimits(2.0, 3.0, 0.5, 1.0)
    run(capsys, "profile", "save", result, "--to", tmp_path / "before")
    assert open_profile(tmp_path / "before").limits == ValidityLimits(), "one that is there keeps its own"
    path.write_text("{}")
    said = run(capsys, "profile", "save", result, "--to", tmp_path / "other")
    assert "delivered limits" in said and "limits.json" in said
    assert open_profile(tmp_path / "other").limits == ValidityLimits()


def test_names_are_those_of_the_limits() -> None:
    assert tuple(field.name for field in fields(Limits)) == NAMES
