"""Figures that pages for readers quote are those of the pages they come from, and a goal that is missed says so."""

import json
import re
from pathlib import Path

import pytest
from conftest import ROOT

STUDIES = ROOT / "benchmarks" / "studies"
READERS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
# Pages that quote another figure of a study than the one whose goal was missed.
OTHER_FIGURES = {("measuring.md", "measure")}


def words(path: Path) -> str:
    return " ".join(path.read_text(encoding="utf-8").split())


def paragraphs(path: Path) -> list[str]:
    return [" ".join(one.split()) for one in re.split(r"\n\s*\n|\n(?=- )", path.read_text(encoding="utf-8"))]


def test_wrong_recordings() -> None:
    (missed,) = re.findall(r"wrong and VALID: 0: (\d+) of (\d+)", words(STUDIES / "wrong.md"))
    said = re.search(
        r"Of ([\d,]+) recordings with deliberate faults[^.]*?, (\d+|none) w", words(ROOT / "docs/accuracy.md")
    )
    assert said is not None and (said[2].replace("none", "0"), said[1].replace(",", "")) == missed


def test_realistic_recordings() -> None:
    page = words(STUDIES / "realistic.md")
    patterns = (r"No result at all: \d+ of (\d+)", r"\| right \| (\d+) \|", r"\| \*\*wrong\*\* \| (\d+) \|")
    number, right, wrong = (re.findall(pattern, page)[0] for pattern in patterns)
    said = f"Of {number} realistic ones without any, {right} were VALID and right and {wrong} VALID and wrong"
    assert said in words(ROOT / "docs/accuracy.md")


@pytest.mark.parametrize("path", READERS, ids=lambda path: path.name)
def test_a_missed_goal_is_told_where_the_study_is_quoted(path: Path) -> None:
    for text in paragraphs(path):
        for name in re.findall(r"`benchmarks/studies/(\w+)\.md`", text):
            page = (STUDIES / f"{name}.md").read_text(encoding="utf-8")
            if "**MISSED**" in page and (path.name, name) not in OTHER_FIGURES:
                assert re.search(r"\bmiss(ed|es)\b", text), f"{path.name} quotes {name}.md, whose goal is missed"


def test_the_only_real_row_beside_other_programs() -> None:
    row = words(STUDIES / "others.md").partition("## dome15, real photographs")[2]
    whole, alone = (
        re.search(rf"\| SphereCal, {name} \|(?: [^|]+\|){{4}} ([\d.]+) \|", row)
        for name in ("whole", "adjustment alone")
    )
    assert whole is not None and alone is not None
    assert f"{whole[1]} px against {alone[1]} px" in words(ROOT / "docs/accuracy.md")


def test_the_bars_of_the_readme() -> None:
    """Its standard deviation is that of the comparison; what it leaves out is what the page on accuracy has."""
    readme, paper = words(ROOT / "README.md"), words(ROOT / "docs/studies/paper.md")
    found = re.search(r"bars, sd: ball, rigid \| below 0.125 mm \| ([\d.]+)\(\d+\) mm \|", paper)
    assert found is not None and f"{float(found[1]):.3f} mm" in readme
    adds = re.search(r"adds ([\d.]+ to [\d.]+ mm) on 400 mm", words(ROOT / "docs/accuracy.md"))
    assert adds is not None and f"adds {adds[1]} on 400 mm" in readme
    assert "do not change this" not in readme


def test_the_check_bars_of_rendered_images() -> None:
    """They had been those of a version of weeks before."""
    lines = (STUDIES / "rendered.md").read_text(encoding="utf-8").splitlines()
    rows = [[cell.strip() for cell in line.split("|")] for line in lines if line.startswith("| rigA |")]
    mean, largest, rms = (max(abs(float(row[k])) for row in rows) for k in (11, 13, 5))
    page = words(ROOT / "docs/accuracy.md")
    assert f"{rms:.3f} px rms. The mean error of a check bar's lengths was {mean:.3f} mm at most" in page
    assert f"the largest single error {largest:.3f} mm" in page


def test_time_and_memory_of_large_rigs() -> None:
    """The table is the baseline's."""
    cases = json.loads((ROOT / "benchmarks/baseline.json").read_text(encoding="utf-8"))["scale"]["cases"]
    page = (ROOT / "benchmarks/README.md").read_text(encoding="utf-8")
    table = page.partition("| case | observations | CPU s | peak MB | before")[2].partition("\n\n")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()[2:]]
    own = [[f"{case['observations']:,}", f"{case['cpu_s']:.0f}", f"{case['peak_mb']:.0f}"] for case in cases]
    assert [row[1:4] for row in rows] == own
    assert "as `baseline.json` holds" in page
