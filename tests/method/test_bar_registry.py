"""The registry of reference bars, by command and through a session that names a serial."""

import json
import os
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path

import pytest

from spherecal.base.errors import InputError, OutputError
from spherecal.targets.family import make_target_set
from spherecal_app.cli.main import main
from spherecal_cameras.plan import read_plan
from spherecal_files.bar_registry import BAR_REGISTRY, find_bar
from spherecal_files.read_session import read_session
from spherecal_files.session_json import session_json
from spherecal_gui.tasks.jobs import artefacts_of
from tests.example_session import VALID, changed, make_session


@pytest.fixture
def registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "settings" / "bars.json"
    monkeypatch.setenv("SPHERECAL_BARS", str(path))
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 0) -> str:
    assert main(["bars", *map(str, arguments)]) == code
    said = capsys.readouterr()
    if code:
        assert said.err.count("\n") == 1
    return said.err if code else said.out


ADD = (
    "add", "B-17", "--mark", "A1=901", "--mark", "A2=902:E", "--length", "A1,A2,412.345,0.004",
    "--expansion", "1.15e-5", "--certificate", "K-2026-5", "--laboratory", "DAkkS lab", "--date", "2026-01-15",
)  # fmt: skip


def test_a_bar_is_entered_shown_replaced_and_removed(registry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "There are no bars" in run(capsys, "list")
    assert "1 length, certificate K-2026-5" in run(capsys, *ADD)
    bar = find_bar("B-17")
    assert bar.marks["A2"].point == "E" and bar.marks["A1"].target == 901
    assert (bar.lengths[0].length_mm, bar.lengths[0].coverage_factor) == (412.345, 2.0)
    assert bar.certificate is not None and bar.certificate.date == date(2026, 1, 15)
    assert json.loads(run(capsys, "list", "--json"))[0]["state"] == "ok"
    assert "A1 to A2: 412.3450 mm, U = 0.004 mm (k = 2)" in run(capsys, "show", "B-17")
    assert "--replace" in run(capsys, *ADD, code=2)
    past = (date.today() - timedelta(days=1)).isoformat()
    assert "WARNING" in run(capsys, *ADD, "--valid-until", past, "--replace")
    assert "expired" in run(capsys, "list")
    soon = (date.today() + timedelta(days=20)).isoformat()
    run(capsys, *ADD, "--valid-until", soon, "--replace")
    assert json.loads(run(capsys, "show", "B-17", "--json"))["state"] == "expires-soon"
    run(capsys, "remove", "B-17")
    assert BAR_REGISTRY.read() == {}
    assert "no bar" in run(capsys, "show", "B-17", code=2)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["--length", "A1,A9,5,0.001"], "names a mark that the bar does not have"),
        (["--length", "A1,A2,x,0.001"], "is not a length"),
        (["--length", "A1,A2,412,30"], "5 % of the length"),
        (["--mark", "A1"], "is not a mark"),
        (["--expansion", "11.5"], "must be from"),
        (["--date", "15.1.2026"], "must be a date"),
        (["--valid-until", "2025-01-01"], "before the certificate's date"),
        (["--nominal", "A1,A2,421"], "more than 1 % apart"),
        (["--nominal", "A1,A2,16.25"], "more than 1 % apart"),  # inches
        (["--nominal", "A1,A3,412"], "no certified length"),
        (["--nominal", "A1,A2"], "is not a nominal length"),
        (["--nominal", "A1,A2,-412"], "above 0"),
    ],
)
def test_wrong_figures_are_refused(
    registry: Path, capsys: pytest.CaptureFixture[str], changes: list[str], said: str
) -> None:
    assert said in run(capsys, *ADD, *changes, code=2)
    assert not registry.exists()


def test_what_is_written_is_read_back(registry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(capsys, *ADD)
    bars = BAR_REGISTRY.read()
    before = registry.read_bytes()
    BAR_REGISTRY.write(bars)
    assert registry.read_bytes() == before
    assert BAR_REGISTRY.read() == bars


def test_a_nominal_length_is_kept_beside_the_certified_one(
    registry: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, *ADD)
    without = registry.read_bytes()
    run(capsys, *ADD, "--nominal", "A2,A1,412", "--replace")
    assert find_bar("B-17").lengths[0].nominal_mm == 412.0
    assert "nominal 412 mm, certified 412.345 mm" in run(capsys, "list")
    assert "A1 to A2: nominal 412 mm, certified 412.3450 mm, U" in run(capsys, "show", "B-17")
    assert json.loads(run(capsys, "show", "B-17", "--json"))["lengths"][0]["nominal_mm"] == 412.0
    bars = BAR_REGISTRY.read()
    BAR_REGISTRY.write(bars)
    assert BAR_REGISTRY.read() == bars
    run(capsys, *ADD, "--replace")
    assert registry.read_bytes() == without, "none where none is given"
    with_nominal = changed("bars", 0, "lengths", 0, "nominal_mm", to=412)
    folder = make_session(tmp_path_made(tmp_path, "nominal"), with_nominal)
    session = read_session(folder)
    assert session.bars[0].lengths[0].nominal_mm == 412.0
    assert session_json(session, folder)["bars"][0]["lengths"] == [with_nominal["bars"][0]["lengths"][0]]
    run(capsys, "add", "B-18", "--from-session", folder)
    assert find_bar("B-18").lengths[0].nominal_mm == 412.0
    plain = read_session(make_session(tmp_path_made(tmp_path, "plain")))
    assert "nominal_mm" not in session_json(plain, plain.folder)["bars"][0]["lengths"][0]


def test_a_session_names_a_bar_by_its_serial(
    registry: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full = make_session(tmp_path_made(tmp_path, "full"))
    run(capsys, "add", "B-17", "--from-session", full, "--certificate", "K-9")
    named = make_session(
        tmp_path_made(tmp_path, "named"), changed("bars", to=[{"id": "A", "role": "check", "serial": "B-17"}])
    )
    session = read_session(named)
    given, taken = read_session(full).bars[0], session.bars[0]
    assert (taken.lengths, taken.marks, taken.expansion_per_kelvin) == (
        given.lengths,
        given.marks,
        given.expansion_per_kelvin,
    )
    assert taken.serial == "B-17" and taken.certificate is not None and taken.certificate.number == "K-9"
    # the session's fingerprint follows the registry
    run(capsys, "add", "B-17", "--from-session", full, "--certificate", "K-10", "--replace")
    assert read_session(named).input_sha256 != session.input_sha256
    run(capsys, "remove", "B-17")
    with pytest.raises(InputError, match='the registry has no bar "B-17"'):
        read_session(named)


def test_a_bench_of_bars_by_serial_is_shown_with_their_lengths(
    registry: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full = make_session(tmp_path_made(tmp_path, "full"))
    run(capsys, "add", "B-17", "--from-session", full)
    named = make_session(
        tmp_path_made(tmp_path, "named"), changed("bars", to=[{"id": "A", "role": "check", "serial": "B-17"}])
    )
    assert read_plan(named).bars[0].lengths == read_session(full).bars[0].lengths
    plan = replace(read_plan(named), target_set=make_target_set(8))
    artefacts = artefacts_of(plan)
    assert artefacts is not None and artefacts.check_bars == ("A",)
    assert artefacts.check == f"A: {plan.bars[0].lengths[0].length_mm:.3f} mm"


def tmp_path_made(folder: Path, name: str) -> Path:
    made = folder / name
    made.mkdir()
    return made


def test_a_session_gives_all_of_a_bar_or_nothing(registry: Path, tmp_path: Path) -> None:
    bar = {**VALID["bars"][0], "serial": "own", "certificate": {"number": "K", "valid_until": "2030-01-01"}}
    session = read_session(make_session(tmp_path, changed("bars", to=[bar])))
    assert session.bars[0].certificate is not None  # without a registry
    half = {key: value for key, value in bar.items() if key != "lengths"}
    with pytest.raises(InputError, match="named by its serial"):
        read_session(make_session(tmp_path, changed("bars", to=[half])))


@pytest.mark.parametrize(
    "text",
    [
        "", "[]", '{"format": "spherecal/bars", "version": 1}',
        '{"format": "spherecal/bars", "version": 2, "bars": []}',
        '{"format": "spherecal/bars", "version": 1, "bars": [{"serial": "../x"}]}', '{"format": "other"}', "\xff",
        '{"format": "spherecal/bars", "version": 1, "bars": ' + "[" * 3000 + "]" * 3000 + "}",
    ],
)  # fmt: skip
def test_a_broken_registry_is_named(registry: Path, text: str) -> None:
    registry.parent.mkdir()
    registry.write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match=r"bars\.json"):
        BAR_REGISTRY.read()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root writes everywhere")
def test_a_read_only_folder_changes_nothing(registry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(capsys, *ADD)
    before = registry.read_bytes()
    registry.parent.chmod(0o500)
    try:
        with pytest.raises(OutputError):
            BAR_REGISTRY.write({})
    finally:
        registry.parent.chmod(0o700)
    assert registry.read_bytes() == before


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("SPHERECAL_BARS", str(tmp_path / "file" / "bars.json"))
    with pytest.raises(OutputError, match="cannot be written"):
        BAR_REGISTRY.write({})
