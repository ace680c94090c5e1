"""What SECURITY.md promises: each sentence has its row and its tests in docs/security.md."""

import ast
import hashlib
import re
from pathlib import Path

import pytest
from conftest import ROOT

from spherecal_app.cli.main import main
from spherecal_rigs.save_entry import save_result
from spherecal_rigs.store import apply, create_profile, open_profile
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions


def rows() -> list[tuple[str, list[tuple[str, str]]]]:
    """The words of SECURITY.md that a row is about, and its tests as file and function."""
    text = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    table = text.partition("## What is promised, and the test that shows it")[2]
    lines = [line.split("|")[1:3] for line in table.splitlines() if line.startswith("| ") and "`" in line]
    return [(words.strip(), re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", named)) for words, named in lines]


def sentences() -> list[str]:
    """The sentences under "What is promised"."""
    promised = (ROOT / "SECURITY.md").read_text(encoding="utf-8").partition("## What is promised")[2].partition("##")[0]
    bullets = [" ".join(one.split()) for one in promised.split("\n- ")[1:]]
    return [one for bullet in bullets for one in re.split(r"(?<=\.) (?=[A-Z])", bullet)]


def test_every_promise_has_its_row() -> None:
    told = [words for words, _ in rows()]
    assert [one for one in sentences() if not any(words in one for words in told)] == []
    assert [words for words in told if not any(words in one for one in sentences())] == []


@pytest.mark.parametrize(("words", "named"), rows())
def test_every_named_test_is_there(words: str, named: list[tuple[str, str]]) -> None:
    assert named, words
    for file, function in named:
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, (file, function)


def contents(folder: Path) -> dict[str, tuple[str, int]]:
    """The hash and the time of every file."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {str(p): (hashlib.sha256(p.read_bytes()).hexdigest(), p.stat().st_mtime_ns) for p in files}


def test_commands_that_read_write_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given, out = tmp_path / "given", tmp_path / "out"
    session, truth = simulate_session("demo", 1, SimulationOptions(targets=40, placements=4, bar_poses=1))
    write_session(session, truth, given / "session")
    out.mkdir()
    result, profile = given / "result", given / "profile"
    assert main(["calibrate", str(given / "session"), "-o", str(result)]) in (0, 3)
    made = create_profile(profile)
    for number in (1, 2):
        save_result(made, result)
        apply(open_profile(profile), f"{number:04d}", "of the test", despite_findings=True)
    before = contents(given)
    monkeypatch.chdir(out)
    for command in (
        f"profile show {profile}", f"profile list {given}", f"profile trend {profile} -o {out}/t.pdf",
        f"profile compare {profile}/history/0001 {result}", f"report {result} -o {out}/r.pdf",
        f"guide {given}/session", "doctor",
    ):  # fmt: skip
        assert main(command.split()) in (0, 3), command
        assert contents(given) == before, command
