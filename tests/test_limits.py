"""The file of limits: checked, its changes noted, its PIN no more than a hash; the commands that read it."""

import json
import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spherecal.base.errors import InputError, OutputError, SpherecalError
from spherecal.files.write_result import write_result
from spherecal.initialise.view_graph import MIN_COMMON
from spherecal_app.cli.main import main
from spherecal_rigs.limits_file import (
    DOTS,
    LIMITS,
    NAMES,
    PAIRS,
    KeptLimits,
    Limits,
    Pin,
    limits_in_use,
    read_limits,
    with_limits,
    with_pin,
    write_limits,
)
from spherecal_rigs.store import open_profile
from spherecal_rigs.validity import ValidityLimits
from tests.conftest import ROOT
from tests.test_results import example_calibration
from tests.test_session_fuzz import JSON_VALUES

NOON = datetime(2026, 11, 21, 12, tzinfo=UTC)
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
    kept = with_limits(with_pin(KeptLimits(), Pin.of("4711"), "Maria", NOON), TIGHT, "Maria", NOON)
    pin = {"kind": "scrypt-16384-8-1", "salt": kept.pin.salt.hex(), "hash": kept.pin.digest.hex()}  # type: ignore[union-attr]
    limits = {name: getattr(kept.limits, name) for name in NAMES} | changes
    changed = [{"at": NOON.isoformat(), "by": "Maria", "what": "stale_hours", "before": 12, "after": 4}]
    return {"format": LIMITS.name, "version": 1, "limits": limits, "pin": pin, "changes": changed}


def written(path: Path, document: object) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_without_a_file_the_delivered_limits_hold(path: Path) -> None:
    assert read_limits() == KeptLimits()
    assert limits_in_use() == (Limits(), "")
    assert Limits().validity == ValidityLimits(), "one source of what is delivered"
    assert DOTS[0] == MIN_COMMON


def test_what_is_written_is_read_back(path: Path) -> None:
    kept = with_limits(with_pin(KeptLimits(), Pin.of("4711"), "Maria Huber"), TIGHT, "Maria Huber")
    write_limits(kept)
    assert read_limits() == kept
    assert limits_in_use() == (TIGHT, "")
    text = path.read_text(encoding="utf-8")
    assert "4711" not in text.replace(kept.pin.salt.hex(), "").replace(kept.pin.digest.hex(), "")  # type: ignore[union-attr]


def test_a_pin_is_kept_as_a_salted_hash() -> None:
    one, other = Pin.of("Ölwanne 7"), Pin.of("Ölwanne 7")
    assert one.digest != other.digest
    assert one.fits("Ölwanne 7") and not one.fits("Ölwanne 8") and not one.fits("x" * 10_000)
    for wrong in ("", "123", "x" * 101):
        with pytest.raises(InputError, match="4 to 100 characters"):
            Pin.of(wrong)


def test_every_change_is_noted_with_who_when_and_what() -> None:
    kept = with_limits(KeptLimits(), replace(Limits(), stale_hours=8.0, unverified_use=False), "Maria", NOON)
    assert [(one.at, one.by, one.what, one.before, one.after) for one in kept.changes] == [
        (NOON, "Maria", "stale_hours", 12.0, 8.0),
        (NOON, "Maria", "unverified_use", True, False),
    ]
    assert with_limits(kept, kept.limits, "Otto").changes == kept.changes
    assert [one.what for one in with_pin(with_pin(kept, Pin.of("4711"), "A"), None, "B").changes[-2:]] == [
        "pin-set",
        "pin-removed",
    ]


def test_old_changes_go_when_there_are_very_many(path: Path) -> None:
    kept = KeptLimits()
    for i in range(510):
        kept = with_limits(kept, replace(Limits(), needed_dots=100 + i), str(i), NOON)
    write_limits(kept)
    assert [one.by for one in read_limits().changes][::499] == ["10", "509"]


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


@pytest.mark.parametrize("where", ["kind", "salt", "hash"])
@pytest.mark.parametrize("value", ["", "zz", 5, "00" * 31])
def test_a_damaged_pin_is_named_and_opens_nothing(path: Path, where: str, value: object) -> None:
    document = a_document()
    document["pin"][where] = value
    written(path, document)
    with pytest.raises(InputError, match=rf"pin\.{where}"):
        read_limits()


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
        write_limits(KeptLimits(), tmp_path / "file" / "limits.json")


PLACES = [
    *[("limits", name) for name in NAMES],
    ("pin",),
    ("pin", "salt"),
    ("pin", "hash"),
    ("pin", "kind"),
    ("changes",),
    *[("changes", 0, key) for key in ("at", "by", "what", "before", "after")],
    ("changes", 0),
    ("limits",),
    ("format",),
]


@settings(max_examples=150)
@given(st.sampled_from(PLACES), JSON_VALUES)
def test_fuzzed_limits_give_limits_or_one_of_our_errors(
    tmp_path_factory: pytest.TempPathFactory, place: tuple[Any, ...], value: object
) -> None:
    document: Any = a_fixed_document()
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
        assert 0 < getattr(kept.limits, ageing) <= getattr(kept.limits, stale)
    write_limits(kept, file)
    assert read_limits(file) == kept


_FIXED = json.dumps(a_document())  # one PIN for all, as hashing is slow on purpose


def a_fixed_document() -> dict[str, Any]:
    return json.loads(_FIXED)


def test_they_are_read_before_the_window_stands(path: Path) -> None:
    """Without what takes half a second to import, a formula included."""
    write_limits(KeptLimits(TIGHT))
    code = (
        "import sys; from spherecal_rigs.limits_file import limits_in_use; print(limits_in_use()[0].stale_hours); "
        "sys.exit(bool({'scipy', 'numba', 'cv2'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "4.0"), done.stderr


# --- the commands ----------------------------------------------------------------------------------------------------


def test_the_limits_are_shown_and_a_forgotten_pin_is_removed(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no PIN was set" in run(capsys, "limits", "show")
    assert "no PIN was set" in run(capsys, "limits", "reset-pin")
    assert not path.exists()
    write_limits(with_limits(with_pin(KeptLimits(), Pin.of("4711"), "Maria"), TIGHT, "Maria"))
    shown = run(capsys, "limits", "show")
    assert "locked by a PIN" in shown
    assert "stale_hours: 4 (delivered: 12)" in shown and "unverified_use: no (delivered: yes)" in shown
    assert "Maria: stale_hours 12 -> 4" in shown and "Maria: pin-set" in shown
    assert json.loads(run(capsys, "limits", "show", "--json"))["limits"]["needed_dots"] == 150
    assert "the PIN was removed" in run(capsys, "limits", "reset-pin")
    kept = read_limits()
    assert kept.pin is None and kept.limits == TIGHT
    assert kept.changes[-1].what == "pin-removed" and "reset-pin" in kept.changes[-1].by
    path.write_text("{}")
    assert "limits.json" in run(capsys, "limits", "reset-pin", code=2)
    assert path.read_text() == "{}"


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
    write_limits(with_limits(KeptLimits(), TIGHT, "Maria"))
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
