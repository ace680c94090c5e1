"""Files whose meaning is plain are read although something is not stated; what was assumed is said, with its cost."""

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spherecal
from spherecal.data.assumed import assumed_of_session
from spherecal.scale.bar_temperature import expansion_kelvin
from spherecal_app.cli.main import main
from spherecal_documents.support.redact import Redactor
from spherecal_files.bar_registry import REGISTERED_BAR
from spherecal_files.json_file import JsonValue
from spherecal_verify.verification import Verification

Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def session_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two bars: B gives the scale, A checks it."""
    folder = tmp_path_factory.mktemp("lenient") / "session"
    spherecal.simulate_session("demo", 1, spherecal.SimulationOptions(targets=80, scale="bar"), folder=folder)
    return folder


@pytest.fixture(scope="module")
def result_folder(session_folder: Path) -> Path:
    calibration = spherecal.calibrate_session(session_folder)
    spherecal.save_calibration(calibration, session_folder.parent / "result")
    return session_folder.parent / "result"


@pytest.fixture
def changed(session_folder: Path, tmp_path: Path) -> Callable[[Change], Path]:
    """The session with another session.json."""

    def make(change: Change) -> Path:
        document = json.loads((session_folder / "session.json").read_text(encoding="utf-8"))
        change(document)
        folder = tmp_path / "changed"
        folder.mkdir()
        for file in session_folder.iterdir():
            (folder / file.name).write_bytes(file.read_bytes())
        (folder / "session.json").write_text(json.dumps(document), encoding="utf-8")
        return folder

    return make


@pytest.fixture
def changed_rig(result_folder: Path, tmp_path: Path) -> Callable[[Change], Path]:
    """A rig.json alone, as somebody else might write it."""

    def make(change: Change) -> Path:
        document = json.loads((result_folder / "rig.json").read_text(encoding="utf-8"))
        del document["covariance"]
        change(document)
        (tmp_path / "rig.json").write_text(json.dumps(document), encoding="utf-8")
        return tmp_path / "rig.json"

    return make


def drop(bar: str, *keys: str) -> Change:
    def change(document: dict[str, Any]) -> None:
        for one in document["bars"]:
            for entry in (one, *one["lengths"]) if one["id"] == bar else ():
                for key in keys:
                    entry.pop(key, None)

    return change


def finding(found: tuple[spherecal.Finding, ...], code: str) -> spherecal.Finding:
    own = [one for one in found if one.code == code]
    assert len(own) == 1, [one.code for one in found]
    assert own[0].severity == "info"
    return own[0]


def verified(folder: Path, result: Path, limit: str | None = None) -> Verification:
    return spherecal.verify_rig(folder, result, limit=limit)


# --- bars ------------------------------------------------------------------------------------------------------------


def test_nothing_is_said_where_all_is_stated(session_folder: Path, result_folder: Path) -> None:
    codes = {f.code for f in verified(session_folder, result_folder).findings}
    codes |= {f.code for f in spherecal.load_rig(result_folder).quality.findings}
    assert not codes & {"bar-assumed", "length-without-uncertainty", "prior-assumed", "rig-incomplete"}


def test_a_bar_of_unknown_expansion_is_less_certain(changed, session_folder: Path, result_folder: Path) -> None:
    before = verified(session_folder, result_folder)
    after = verified(changed(drop("A", "expansion_per_kelvin", "reference_temperature_c")), result_folder)
    said = finding(after.findings, "bar-assumed")
    assert said.where == ("A",)
    assert "20 degrees" in said.message and "covers values from 0 to 23" in said.message
    assert [m.reference_mm for m in after.measured] == [m.reference_mm for m in before.measured], (
        "it is a steel bar at 20"
    )
    for old, new in zip(before.measured, after.measured, strict=True):
        assert new.budget.temperature_mm > old.budget.temperature_mm
        assert replace(new.budget, temperature_mm=0.0) == replace(old.budget, temperature_mm=0.0)
    assert before.procedure is not None and after.procedure is not None
    for old, new in zip(before.procedure.budgets, after.procedure.budgets, strict=True):
        assert new.combined_mm > old.combined_mm
    assert after.decision.verdict == "consistent"


@pytest.mark.parametrize(("warmer_k", "sd_k"), [(0.0, 2.9), (1.5, 0.29), (-6.0, 0.29), (0.0, 0.29)])
def test_the_widened_uncertainty_holds_what_bars_of_any_material_do(
    warmer_k: float, sd_k: float, session_folder
) -> None:
    """Monte Carlo over expansions from none to twice steel's and over the thermometer's error."""
    bar = replace(spherecal.load_session(session_folder).bars[0], assumed=("expansion_per_kelvin",))
    random = np.random.default_rng(4)
    true = random.uniform(0, 2 * bar.expansion_per_kelvin, 200_000)
    errors = true * (warmer_k + random.normal(0, sd_k, 200_000)) - bar.expansion_per_kelvin * warmer_k
    stated = bar.expansion_per_kelvin * math.hypot(sd_k, expansion_kelvin(bar, warmer_k, sd_k))
    assert stated == pytest.approx(errors.std(), rel=0.02)


def test_the_coverage_factor_is_two(changed, session_folder: Path, result_folder: Path) -> None:
    after = verified(changed(drop("A", "coverage_factor")), result_folder)
    assert "k = 2" in finding(after.findings, "bar-assumed").message
    assert after.lengths == verified(session_folder, result_folder).lengths


def test_a_length_without_uncertainty_decides_nothing(changed, result_folder: Path, tmp_path: Path) -> None:
    folder = changed(drop("A", "expanded_uncertainty_mm", "coverage_factor"))
    found = verified(folder, result_folder, "0.0001+L/10000000")
    assert found.measured and found.lengths, "it is measured all the same"
    assert found.decision.verdict == "no data" and not found.failed
    assert found.procedure is not None and found.procedure.acceptance is not None
    assert found.procedure.acceptance.verdict is None
    said = finding(found.findings, "length-without-uncertainty")
    assert "do not affect the decision" in said.message and said.where == ("A",)
    assert not [f for f in found.findings if f.code == "bar-assumed"], "no uncertainty, no factor"
    assert spherecal.check_rig(folder, result_folder).verdict == "ok"
    assert main(["verify", str(folder), "--rig", str(result_folder / "rig.json"), "-o", str(tmp_path / "out")]) == 0
    kept = json.loads((tmp_path / "out" / "verification.json").read_text(encoding="utf-8"))
    assert "expanded_uncertainty_mm" not in kept["procedure"]["bars"][0]["lengths"][0]


def test_one_length_without_uncertainty_leaves_the_others_their_decision(changed, result_folder: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        bar = next(bar for bar in document["bars"] if bar["id"] == "A")
        del bar["lengths"][0]["expanded_uncertainty_mm"]
        bar["lengths"][0]["length_mm"] += 3.0  # it would contradict all

    found = verified(changed(change), result_folder)
    assert found.decision.verdict == "consistent"
    assert {m.certified for m in found.measured} == {True, False}


def test_a_scale_without_uncertainty_is_as_uncertain_as_a_rule(changed, result_folder: Path) -> None:
    folder = changed(drop("B", "expanded_uncertainty_mm"))
    done = spherecal.calibrate_session(folder)
    before = spherecal.load_rig(result_folder).scale.relative_uncertainty
    after = done.rig.scale.relative_uncertainty
    assert before is not None and after is not None
    lengths = [
        length.length_mm for bar in spherecal.load_session(folder).bars if bar.id == "B" for length in bar.lengths
    ]
    shortest, longest = min(lengths), max(lengths)
    assert after > 3 * before
    assert (0.3 / longest + 2e-4) / 3 < after < (0.3 / shortest + 2e-4) / math.sqrt(3)
    assert "the scale has this uncertainty" in finding(done.rig.quality.findings, "length-without-uncertainty").message


def test_a_registered_bar_keeps_what_it_does_not_state(tmp_path: Path) -> None:
    given = {
        "serial": 4711,
        "marks": {"A1": {"target": 1, "point": "centre"}, "A2": {"target": 2, "point": "centre"}},
        "lengths": [{"from": "A1", "to": "A2", "length_mm": 500.0, "expanded_uncertainty_mm": 0.01}],
    }
    bar = REGISTERED_BAR.read(JsonValue(given, Path("bars.json")))
    assert bar.serial == "4711" and bar.assumed == ("expansion_per_kelvin", "reference_temperature_c")
    written = REGISTERED_BAR.entry(bar)
    assert "expansion_per_kelvin" not in written and "coverage_factor" not in written["lengths"][0]
    assert REGISTERED_BAR.read(JsonValue(written, Path("bars.json"))) == bar
    spherecal.save_bar(bar, tmp_path / "bars.json")
    assert spherecal.load_bars(tmp_path / "bars.json") == {"4711": bar}


# --- cameras ---------------------------------------------------------------------------------------------------------


def test_a_prior_without_distortion_begins_at_none(changed) -> None:
    def change(document: dict[str, Any]) -> None:
        for camera in document["cameras"][:2]:
            camera["prior"] = {"matrix": [[1200, 0, 639.5], [0, 1200, 479.5], [0, 0, 1]]}

    session = spherecal.load_session(changed(change))
    assert not session.cameras[0].prior[4:].any() and session.cameras[0].prior_given


def test_one_prior_without_distortion_is_said_of_one(session_folder: Path) -> None:
    session = spherecal.load_session(session_folder)
    for count, words in ((1, "The prior of C01 states no distortion"), (2, "The priors of C01, C02 state no")):
        assumed = [replace(camera, assumed=("distortion",)) for camera in session.cameras[:count]]
        (said,) = assumed_of_session(replace(session, cameras=tuple(assumed), scale=None))
        assert said.message.startswith(words)


def test_a_start_at_no_distortion_is_said_and_ends_where_the_other_does(changed, session_folder: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        for camera in document["cameras"]:
            prior = camera.get("prior")
            if prior is None:
                f = camera["focal_length_mm"] / camera["pixel_pitch_um"] * 1000
                width, height = camera["image_size"]
                camera["prior"] = {"matrix": [[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]]}
            else:
                del prior["distortion"]

    rig = spherecal.calibrate_session(changed(change)).rig
    said = finding(rig.quality.findings, "prior-assumed")
    assert said.where == tuple(camera.id for camera in rig)
    other = spherecal.calibrate_session(session_folder).rig
    assert rig.quality.verdict == other.quality.verdict
    assert max(np.linalg.norm(rig[c.id].centre_mm - c.centre_mm) for c in other) < 1e-3


@pytest.mark.parametrize("count", [4, 5, 8, 12])
def test_priors_take_opencvs_lists(changed, count: int) -> None:
    session = spherecal.load_session(changed(lambda d: d["cameras"][0].update(prior=prior(count))))
    assert np.count_nonzero(session.cameras[0].prior[4:]) == count


def prior(count: int) -> dict[str, Any]:
    return {"matrix": [[1200, 0, 639.5], [0, 1200, 479.5], [0, 0, 1]], "distortion": [1e-6] * count}


def test_the_tilted_model_is_refused_with_the_reason(changed, changed_rig) -> None:
    with pytest.raises(spherecal.InputError, match=r"prior\.distortion has 14 numbers: the last two tilt the sensor"):
        spherecal.load_session(changed(lambda d: d["cameras"][0].update(prior=prior(14))))
    with pytest.raises(spherecal.InputError, match=r"distortion has 14 numbers: the last two tilt the sensor"):
        spherecal.load_rig(changed_rig(lambda d: d["cameras"][0].update(distortion=[0.0] * 14)))


def test_serial_numbers_may_be_whole_numbers(changed, changed_rig) -> None:
    session = spherecal.load_session(changed(lambda d: d["cameras"][0].update(serial=500503343)))
    assert session.cameras[0].serial == "500503343"
    assert spherecal.load_rig(changed_rig(lambda d: d["cameras"][0].update(serial=7))).cameras[0].serial == "7"
    for wrong in (1.5, True, -3, [1]):
        with pytest.raises(spherecal.InputError, match="serial"):
            spherecal.load_rig(changed_rig(lambda d, wrong=wrong: d["cameras"][0].update(serial=wrong)))


def test_whole_numbers_are_taken_out_of_bundles_as_texts_are() -> None:
    document = {"cameras": [{"id": "C01", "serial": 500503343}, {"id": "C02", "serial": "500503344"}], "version": 1}
    data = json.dumps(document).encode()
    redactor = Redactor({"session.json": data})
    kept = json.loads(redactor.file("session.json", data))
    assert [camera["serial"] for camera in kept["cameras"]] == ["serial-1", "serial-2"] and kept["version"] == 1
    assert redactor.text("camera 500503343 was lost") == "camera serial-1 was lost"


# --- rig.json --------------------------------------------------------------------------------------------------------

BARE = ("scale", "quality", "input_sha256")


def strip(document: dict[str, Any]) -> None:
    """To what any other program would write."""
    kept = {"format", "version", "reference_camera", "cameras"}
    for key in set(document) - kept:
        del document[key]
    for camera in document["cameras"]:
        for key in ("sigma", "rms_px", "observations", "serial"):
            camera.pop(key, None)
        camera["distortion"] = camera["distortion"]["coefficients"][:5]


def test_a_bare_rig_measures_and_is_verified(changed_rig, session_folder: Path, result_folder: Path) -> None:
    path = changed_rig(strip)
    rig, whole = spherecal.load_rig(path), spherecal.load_rig(result_folder)
    assert [np.array_equal(a.intrinsics, b.intrinsics) for a, b in zip(rig, whole, strict=True)] == [True] * 6
    assert rig.scale == spherecal.RigScale("given", None) and rig.input_sha256 == ""
    assert rig.quality.valid and rig.quality.verdict == "use-with-care"
    said = finding(rig.quality.findings, "rig-incomplete")
    for word in ("scale", "quality", "which recording", "the uncertainties of C01, C02, C03, C04, C05, C06"):
        assert word in said.message
    bare, known = spherecal.verify_rig(session_folder, rig), spherecal.verify_rig(session_folder, whole)
    errors = [abs(a.error_mm - b.error_mm) for a, b in zip(bare.measured, known.measured, strict=True)]
    assert max(errors) < 1e-3
    assert bare.decision.verdict != "no data"


@pytest.mark.parametrize("key", BARE)
def test_each_field_may_be_absent_on_its_own(changed_rig, key: str) -> None:
    rig = spherecal.load_rig(changed_rig(lambda d: d.pop(key)))
    finding(rig.quality.findings, "rig-incomplete")
    assert (rig.quality.verdict == "use-with-care") == (key == "quality")


def test_what_was_assumed_is_written_and_not_said_twice(changed_rig, tmp_path: Path) -> None:
    rig = spherecal.load_rig(changed_rig(strip))
    spherecal.save_rig(rig, tmp_path / "again.json")
    assert spherecal.load_rig(tmp_path / "again.json") == rig


def test_our_own_file_without_uncertainties_is_complete(changed_rig) -> None:
    """A rig that could not be adjusted has `"sigma": null`."""
    rig = spherecal.load_rig(changed_rig(lambda d: [camera.update(sigma=None) for camera in d["cameras"]]))
    assert not [f for f in rig.quality.findings if f.code == "rig-incomplete"]


def test_every_command_takes_a_bare_rig(
    changed_rig, session_folder: Path, result_folder: Path, tmp_path: Path, capsys, monkeypatch
) -> None:
    path = str(changed_rig(strip))
    shutil.copytree(result_folder, tmp_path / "whole")
    shutil.copy(path, tmp_path / "whole" / "rig.json")
    for line in (
        ["verify", str(session_folder), "--rig", path, "-o", str(tmp_path / "result")],
        ["report", str(tmp_path / "whole"), "-o", str(tmp_path / "report.html")],
        ["report", str(tmp_path / "whole"), "-o", str(tmp_path / "report.pdf")],
        ["check", str(session_folder), "--profile", path],
        ["export", path, "--to", "opencv", "-o", str(tmp_path / "opencv")],
        ["profile", "compare", path, path],
    ):
        if line[-1].endswith(".pdf"):  # its scene is that of the HTML
            monkeypatch.setenv("SPHERECAL_3D", "painted")
        assert main(line) in (0, 3), line
        assert "Traceback" not in capsys.readouterr().err


# --- versions --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [1, 1.0, "1", "1.0", "1.7", 1.7, "1.12"])
def test_minor_versions_are_read(changed_rig, changed, session_folder: Path, result_folder: Path, version: Any) -> None:
    rig, session = spherecal.load_rig(result_folder), spherecal.load_session(session_folder)
    assert spherecal.load_rig(changed_rig(lambda d: d.update(version=version))).cameras == rig.cameras
    other = spherecal.load_session(changed(lambda d: d.update(version=version)))
    assert other.observations == session.observations and other.cameras == session.cameras


def test_a_later_minor_version_may_add_fields_of_any_name(changed) -> None:
    def later(version: Any) -> Change:
        def change(document: dict[str, Any]) -> None:
            document["version"] = version
            document["placements"][0].pop("images", None)
            document["placements"][0]["imagess"] = {}  # in version 1 a misspelling of "images"

        return change

    folder = changed(later("1.1"))
    spherecal.load_session(folder)
    document = json.loads((folder / "session.json").read_text(encoding="utf-8"))
    (folder / "session.json").write_text(json.dumps(document | {"version": 1}), encoding="utf-8")
    with pytest.raises(spherecal.InputError, match='Is "images" meant'):
        spherecal.load_session(folder)


@pytest.mark.parametrize(
    ("version", "message"),
    [("2.0", "the file.s version is 2,"), ("2.1", "version is 2.1,"), (2, "version is 2,")],
)
def test_a_later_major_version_is_refused(changed_rig, version: Any, message: str) -> None:
    with pytest.raises(spherecal.InputError, match=message):
        spherecal.load_rig(changed_rig(lambda d: d.update(version=version)))


@pytest.mark.parametrize("version", ["", "one", "1.", ".1", "1.2.3", "-1", 0, -1, True, [1], 0.5, "01", "1e3"])
def test_what_is_no_version_is_refused(changed_rig, version: Any) -> None:
    with pytest.raises(spherecal.InputError, match="version"):
        spherecal.load_rig(changed_rig(lambda d: d.update(version=version)))
