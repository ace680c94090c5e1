"""The page docs/tao2021.md against the code: its numbers, functions, options and tests are those that exist."""

import re
from pathlib import Path

import pytest

from spherecal.data.session import STANDARD_PLACEMENTS
from spherecal.initialise.camera_path import BASE
from spherecal.initialise.view_graph import TH_ER_PX, EdgeWeights
from spherecal.steps.settings import TH_PT, CalibrationSettings
from spherecal.steps.tao2021 import MOST_STEPS
from spherecal_app.cli.options import make_parser
from spherecal_rigs.ball_registry import Bench
from spherecal_sim.rigs import CA050, G319B, rig_design
from spherecal_study.compare_methods import ASSUMPTION_3_SD_MM

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/tao2021.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.splitlines()
    if line.startswith("| ") and line.count("|") == 7
][1:]


def test_every_equation_and_algorithm_has_its_row_in_order() -> None:
    named = [row[0] for row in ROWS if row[0] != "adjacency"]
    assert named == [*(f"({n})" for n in range(1, 23)), *(f"Algorithm {n}" for n in (1, 2, 3))]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_functions_options_and_tests_exist(row: list[str]) -> None:
    _, _, code, option, test, _ = row
    file, name = code.strip("`").split(": ")
    folder = ROOT / "core" / ("" if file.startswith("spherecal_") else "spherecal")
    assert re.search(rf"^ *def {name}\(", (folder / file).read_text(encoding="utf-8"), re.MULTILINE)
    if option:
        command = "study" if option == "`--known`" else "calibrate"
        listed = make_parser()._subparsers._group_actions[0].choices[command]._option_string_actions  # type: ignore
        assert option.strip("`") in listed
    if test != "the same":
        file, name = test.strip("`").split(": ")
        found = next((ROOT / "tests").rglob(file)).read_text(encoding="utf-8")
        assert f"\ndef {name}(" in found


@pytest.mark.parametrize(
    ("row", "value"),
    [
        ("(2)", f"{MOST_STEPS} steps"),
        ("(11)", f"{TH_ER_PX:g} px"),
        ("(13)", f"{EdgeWeights().error:g} and {EdgeWeights().count:g}"),
        ("adjacency", f"{TH_PT} points"),
        ("(14)", f"b = {BASE:g}"),
    ],
)
def test_numbers_of_a_row(row: str, value: str) -> None:
    assert value in next(cells[-1] for cells in ROWS if cells[0] == row)


def test_four_placements_are_the_default_by_name() -> None:
    assert STANDARD_PLACEMENTS == 4 and "four placements, the paper's standard (`STANDARD_PLACEMENTS`)" in PAGE
    assert rig_design("rigA").placements == rig_design("rigB").placements == STANDARD_PLACEMENTS
    assert Bench.placements == STANDARD_PLACEMENTS


def test_other_numbers() -> None:
    assert f"standard deviation {ASSUMPTION_3_SD_MM:g} mm" in PAGE
    text = " ".join(PAGE.split())
    width, height = CA050.image_size
    assert f"{G319B.focal_length_mm:g} mm lenses, and {width} x {height} pixels of {CA050.pixel_pitch_um:g} um" in text
    assert CalibrationSettings().th_pt == TH_PT
    known = make_parser()._subparsers._group_actions[0].choices["calibrate"]._option_string_actions  # type: ignore
    assert known["--th-pt"].default == TH_PT and f"default {TH_PT})" in known["--th-pt"].help
    assert known["--th-er"].default == TH_ER_PX and f"default {TH_ER_PX:g})" in known["--th-er"].help


def test_what_opt_and_spo_are_worth_is_what_the_study_found() -> None:
    """The page's table of converged runs against the study's rows in paper.md."""
    text = (ROOT / "docs/studies/paper.md").read_text(encoding="utf-8")
    found, notes = {}, set()
    for row in (line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| runs of ")):
        runs, words = re.fullmatch(r"runs of (\d+) that end in the optimum, (.+)", row[0]).groups()  # type: ignore
        assert runs == "30"
        found[words] = row[2].split(", ")
        notes.add(row[3])
    note = re.search(rf"^{notes.pop()[1:-1]}\. from the starts (.+?)\. How", text, re.MULTILINE)
    assert note is not None and not notes and len(found) == 4
    starts = note[1].split("; ")
    table = PAGE.split("## What OPT and SPO are worth")[1]
    heads, _, *lines = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("|")]
    assert heads[0] == "start" and set(heads[1:]) == found.keys()
    assert {line[0]: line[1:] for line in lines} == {
        start: list(counts) for start, *counts in zip(starts, *(found[head] for head in heads[1:]), strict=True)
    }
