"""A session's folder while its writer is killed, and the exchange of two folders behind it."""

import sys
from pathlib import Path

import pytest

from benchmarks.studies.profiles import kill_sessions
from spherecal_files import atomic
from spherecal_files.atomic import RESULT, write_folder_whole


def test_killed_while_a_session_is_written(tmp_path: Path) -> None:
    """Few kills here, 100 in benchmarks/studies/profiles.md."""
    kills = kill_sessions(3, tmp_path, seed=5)
    assert kills.problems == ()
    assert sum(kills.found) == 3


@pytest.mark.parametrize("can_exchange", [True, False])
def test_a_folder_is_replaced_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, can_exchange: bool) -> None:
    if can_exchange and sys.platform != "linux":
        pytest.skip("only Linux exchanges folders in one step")
    if not can_exchange:
        monkeypatch.setattr(atomic, "_exchange", lambda *_: False)
    target = tmp_path / "result"

    def make(text: str):
        def build(folder: Path) -> None:
            (folder / "rig.json").write_text('{"format": "spherecal/rig"}')
            (folder / text).write_text(text)

        return build

    for text in ("points.csv", "bars.csv", "spheres.csv"):
        write_folder_whole(target, make(text), RESULT)
        assert sorted(p.name for p in target.iterdir()) == sorted(["rig.json", text])
    assert [p.name for p in tmp_path.iterdir()] == ["result"]
