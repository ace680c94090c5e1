"""Quick checks kept in a profile: what is read back, what is refused, what a full or read-only disk does."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from spherecal.base.errors import InputError, OutputError
from spherecal_app.cli.console import kept_in_profile
from spherecal_files import filesystem as files
from spherecal_files.rig_file import rig_bytes
from spherecal_rigs.calibration_age import ValidityLimits, validity
from spherecal_rigs.check_rig import keep
from spherecal_rigs.kept_checks import keep_check, last_check, read_checks
from spherecal_rigs.save_entry import save_result
from spherecal_rigs.store import Profile, apply, create_profile, open_profile
from spherecal_rigs.trend import make_check_trend
from tests.export_rigs import make_rig

NOW = datetime(2026, 11, 21, 9, 30, tzinfo=UTC)


def document(verdict: str = "ok", point_mm: float = 0.01) -> dict[str, Any]:
    """The parts of a check.json that a profile keeps."""
    cameras = [
        {"id": "C1", "point_mm": point_mm, "rms_px": 0.03, "points": 100, "moved": False},
        {"id": "C2", "point_mm": 0.02, "rms_px": 0.04, "points": 300, "moved": False},
        {"id": "C3", "point_mm": None, "rms_px": None, "points": 0, "moved": False},
    ]
    return {
        "verdict": verdict, "sentence": "The rig is as it was.", "tolerance_mm": 0.1, "cameras": cameras,
        "balls": [{"placement": "P5", "dots": 40, "scale_ppm": 12.5, "scale_sd_ppm": 5.0}],
        "lengths": [{"bar": "A", "error_mm": 0.01}, {"bar": "A", "error_mm": -0.03}],
    }  # fmt: skip


@pytest.fixture
def profile(tmp_path: Path) -> Profile:
    made = create_profile(tmp_path / "profile", "Rig 7")
    result = tmp_path / "r"
    result.mkdir()
    (result / "rig.json").write_bytes(rig_bytes(make_rig(5, 3, 1)))
    saved = save_result(made, result)
    return apply(open_profile(made.folder), saved)


def test_what_was_checked_is_read_back(profile: Profile) -> None:
    for i in range(3):
        keep_check(profile.folder, "0001", document(point_mm=0.01 * i), 21.5, NOW + timedelta(hours=i))
    found, problems = read_checks(profile.folder)
    assert problems == () and [one.at for one in found] == [NOW + timedelta(hours=i) for i in range(3)]
    last = found[-1]
    assert (last.calibration, last.verdict, last.temperature_c) == ("0001", "ok", 21.5)
    assert last.point_mm == {"C1": 0.02, "C2": 0.02}
    assert last.rms_px == pytest.approx(((100 * 0.03**2 + 300 * 0.04**2) / 400) ** 0.5)
    assert last.scale_ppm == 12.5 and last.bar_error_mm == pytest.approx(-0.01)
    assert read_checks(profile.folder, 1)[0] == (last,)
    assert last_check(profile.folder, "0001") == last and last_check(profile.folder, "0002") is None
    trend = make_check_trend(profile)
    assert [s.name for s in trend.cameras] == ["C1", "C2"] and trend.verdicts == ("ok",) * 3
    assert trend.series[0].values.tolist() == [0.02, 0.02, 0.02]


def test_a_trend_needs_two_checks(profile: Profile) -> None:
    keep_check(profile.folder, "0001", document(), None)
    with pytest.raises(InputError, match="a trend needs two quick checks or more, it has 1"):
        make_check_trend(profile)


@pytest.mark.parametrize(("verdict", "state"), [("ok", "fresh"), ("watch", "ageing"), ("recalibrate", "stale")])
def test_the_chip_heeds_the_last_check(profile: Profile, verdict: str, state: str) -> None:
    entry = profile.active
    assert entry is not None
    keep_check(profile.folder, "0001", document(verdict), None, NOW)
    found = validity(replace(entry, calibrated_at=NOW), ValidityLimits(), NOW, None, last_check(profile.folder, "0001"))
    assert found.state == state
    assert ("quick check of 2026-11-21 09:30 UTC" in found.reasons[0]) == (verdict != "ok")


def test_broken_checks_hide_nothing(profile: Profile) -> None:
    path = keep_check(profile.folder, "0001", document(), None, NOW)
    good = path.read_bytes()
    later = path.with_name("20261122T093000000000Z.json")
    for data in (b"{", good.replace(b'"ok"', b'"fine"'), good.replace(b'"version": 1', b'"version": 2'), b"[]"):
        later.write_bytes(data)
        found, problems = read_checks(profile.folder)
        assert len(found) == 1 and len(problems) == 1 and later.name in problems[0]
        assert open_profile(profile.folder).validity().state == "fresh"
    later.unlink()
    (path.parent / "notes.json").write_text("{}")
    later.symlink_to(path)
    assert len(read_checks(profile.folder)[1]) == 1


def test_a_profile_that_cannot_be_written_does_not_spoil_the_check(
    profile: Profile, monkeypatch: pytest.MonkeyPatch
) -> None:
    def said() -> str:
        return kept_in_profile("The check", profile.folder, lambda: keep(profile.folder, document())) or ""

    assert said().startswith("The check is kept in the profile")
    before = sorted(p.name for p in (profile.folder / "checks").iterdir())

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files, "_create", refuse)
    assert said().startswith("The check is not kept in the profile. ") and "no space left" in said()
    with pytest.raises(OutputError):
        keep_check(profile.folder, "0001", document(), None)
    assert sorted(p.name for p in (profile.folder / "checks").iterdir()) == before
    assert keep(profile.folder.parent / "r", document()) is False  # a result folder has no history


def test_a_kept_check_is_plain_json(profile: Profile) -> None:
    path = keep_check(profile.folder, "0001", document(), None, NOW)
    assert path.name == "20261121T093000000000Z.json"
    assert json.loads(path.read_bytes())["check"]["cameras"][0]["id"] == "C1"
