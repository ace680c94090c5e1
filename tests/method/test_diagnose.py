"""Every fault of a recording is named with the camera, placement or target it belongs to, and what to do works."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.studies import diagnosis
from benchmarks.studies.diagnosis import FAULTS, Case
from spherecal.calibrate import calibrate
from spherecal.data.findings import Finding
from spherecal.steps.settings import CalibrationSettings
from spherecal_files.read_session import read_session
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions
from tests.networks import observed, one_thread, simulated

__all__ = ["one_thread"]

# one of each kind, on the smallest rig; the study has more of them, in many recordings on large rigs
CHOSEN = (
    "camera moved by 0.05 mm",
    "camera moved by 50 urad, free form",
    "camera moved by 50 mm and 50 mrad",
    "camera blurred, 0.15 px",
    "ball changes by 0.05 mm, only moved",
    "lenses misfit by 0.03 px",
    "images of two cameras exchanged at one placement",
    "two cameras exchanged, intrinsics known",
    "image of another placement",
    "focal length half in one prior",
    "two stickers with one number",
    "placements clustered",
    "placements stacked",
    "bar lengths 2 % wrong",
    "camera linked by a thread",
)


AS_RECORDED = CalibrationSettings(repair_by_itself=False)


@cache
def told(fault: str) -> tuple[Case, tuple[Finding, ...]]:
    simulate = diagnosis._simulate
    with pytest.MonkeyPatch.context() as patch:  # a ball with a third of the targets takes half of the time
        patch.setattr(diagnosis, "_simulate", lambda rig, seed, **o: simulate(rig, seed, **{"targets": 80, **o}))
        case = FAULTS[fault]("demo", 1, np.random.default_rng([1, 7]))
    settings = CalibrationSettings(method=case.method, repair_by_itself=False)
    return case, calibrate(case.session, settings).rig.quality.findings


@pytest.mark.parametrize("fault", CHOSEN)
def test_fault_is_named(fault: str) -> None:
    case, findings = told(fault)
    assert case.named(findings), [(f.code, f.where) for f in findings]
    finding = next(f for f in findings if f.code == case.code)
    assert finding.message.endswith(".") and finding.hint.endswith(".")
    assert "nan" not in finding.message + finding.hint
    assert "\n" not in finding.message + finding.hint


def test_a_contradicting_sticker_is_told_with_its_images() -> None:
    case, findings = told("two stickers with one number")
    (found,) = (f for f in findings if f.code == case.code == "target-contradicts")
    o = observed(case.session)
    rows = (o.target == int(found.where[0])) & (o.placement < len(case.session.placements))
    images, dots = np.unique(np.stack([o.camera[rows], o.placement[rows]]), axis=1, return_counts=True)
    assert 2 <= found.values["wrong"] <= found.values["images"] <= int((dots >= 3).sum())
    assert found.values["wrong"] >= 0.1 * found.values["images"]
    names = [f"{o.cameras[c]}@{o.placements[t]}" for c, t in images.T]
    shown = [name for name in found.values["shown"] if name != "..."]
    assert shown and len(set(shown)) == len(shown) <= 4 and set(shown) <= set(names)


def test_of_three_cameras_exchanged_in_turn_each_is_named_with_the_one_that_it_shows() -> None:
    """At two placements; each image once, with its own place in the repair."""
    session, _ = simulated("demo", 4, targets=85)
    o = observed(session)
    camera, at = o.camera.copy(), np.isin(o.placement, (1, 2))
    for shown, by in ((1, 2), (2, 3), (3, 1)):
        camera[at & (o.camera == shown)] = by
    found = calibrate(replace(session, observations=replace(o, camera=camera)), AS_RECORDED).rig.quality.findings
    shows = [f for f in found if f.code == "cameras-swapped"]
    assert {(f.values["camera"], f.values["other"]) for f in shows} == {("C02", "C04"), ("C03", "C02"), ("C04", "C03")}
    for f in shows:
        name = f.values["camera"]
        assert f.values["places"] == ("P2", "P3") and [r.target for r in f.repairs] == [f"{name}@P2", f"{name}@P3"]
        assert f"Camera {name} shows the image of {f.values['other']} at P2, P3" in f.message
        own = int((at & (camera == o.cameras.index(name))).sum())
        assert 0.9 * own < f.values["fitting"] <= f.values["points"] <= own


def test_a_noisy_camera_is_told_with_what_its_points_can_show() -> None:
    case, findings = told("camera blurred, 0.15 px")
    (found,) = (f for f in findings if f.code == case.code == "camera-noisy")
    values, o = found.values, observed(case.session)
    own = int((o.camera == o.cameras.index(found.where[0])).sum())
    assert 0.8 * own < values["points"] <= own
    assert values["percent"] == pytest.approx(100 / np.sqrt(2 * values["points"]))
    assert values["noise_px"] == pytest.approx(values["times"] * values["others_px"])
    assert 0.1 < values["noise_px"] < 0.25


def test_faults_do_not_feign_others() -> None:
    """A camera that moved, or is blurred, is no lens, ball or target; exchanged images are no moves."""
    others = {"lens-misfit", "ball-shape-changed", "target-contradicts", "cameras-swapped", "wrong-placement",
              "scale-conflict", "linked-by-a-thread", "image-contradicts", "camera-moved", "camera-noisy"}  # fmt: skip
    for fault in CHOSEN[:2] + CHOSEN[3:5] + CHOSEN[6:9]:
        case, findings = told(fault)
        assert not {f.code for f in findings} & (others - {case.code}), fault
    _, findings = told("focal length half in one prior")  # no other camera has what this one was given
    assert not {f.code for f in findings} & {"cameras-swapped", "camera-noisy"}


def test_a_faultless_rig_has_none_of_them() -> None:
    for options in ({"turns": "same"}, {"outlier_fraction": 0.02}):
        findings = calibrate(simulated("demo", 5, targets=100, **options)[0]).rig.quality.findings
        allowed = {"form-rigid", "form-free", "outliers-removed", "scale-uncertainty", "length-uncertainty",
                   "weak-self-calibration", "two-view-points", "little-coverage"}  # fmt: skip
        assert {f.code for f in findings} <= allowed, options


def test_sizes_of_moves_are_told() -> None:
    _, findings = told("camera moved by 50 mm and 50 mrad")
    message = next(f.message for f in findings if f.code == "camera-moved")
    shift = float(message.split("by about ")[1].split(" mm")[0])
    assert 35 < shift < 65  # nominal intrinsics measure it to some millimetres
    case, findings = told("camera moved by 0.05 mm")
    finding = next(f for f in findings if f.code == "camera-moved")
    assert f"--split {case.where[0]}@{case.where[1]}" in finding.hint
    assert 0.02 < float(finding.message.split("by about ")[1].split(" mm")[0]) < 0.12


def test_fixed_intrinsics_that_are_wrong() -> None:
    session, truth = simulated("demo", 2, targets=100)
    cameras = [replace(c, prior=t.intrinsics) for c, t in zip(session.cameras, truth.cameras, strict=True)]
    fixed = CalibrationSettings(intrinsics="fixed")
    right = calibrate(replace(session, cameras=tuple(cameras)), fixed).rig.quality.findings
    assert "fixed-intrinsics-contradicted" not in {f.code for f in right}
    cameras[2] = replace(cameras[2], prior=cameras[2].prior * np.r_[1.003, 1.003, np.ones(14)])
    wrong = calibrate(replace(session, cameras=tuple(cameras)), fixed).rig.quality.findings
    named = [f for f in wrong if f.code == "fixed-intrinsics-contradicted"]
    assert cameras[2].id in {name for f in named for name in f.where}
    told_px = float(next(f for f in named if cameras[2].id in f.where).message.split(": ")[1].split(" px")[0])
    assert told_px == pytest.approx(truth.cameras[2].intrinsics[0], rel=2e-3)


def test_the_study_reports_named_and_false(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis, "CLEAN", 50)  # one for each run
    page = diagnosis.report(1, ("demo",), ("camera blurred, 1 px",), processes=1)
    assert ("demo: camera blurred, 1 px: named in at least 95 %", True) in page.verdicts
    assert "1 of 1" in page.page()


def test_lenses_that_follow_no_model_are_no_moves(shared_data: Path) -> None:
    """15 cameras of a dome on strongly distorted lenses; they drift by up to 2 px, and nobody moved one."""
    findings = calibrate(read_session(shared_data / "dome15")).rig.quality.findings
    codes = {finding.code for finding in findings}
    assert "camera-drifts" in codes and not codes & {"lens-misfit", "camera-moved"}


def test_a_last_placement_without_observations_ends_in_a_result() -> None:
    session, _ = simulate_session("demo", 1, SimulationOptions(targets=80))
    o = session.observations
    assert o is not None
    moved = (o.camera == 2) & (o.placement == 1)
    shifted = replace(o, uv=o.uv + np.where(moved, 3.0, 0.0)[:, None]).select(o.placement < 3)
    done = calibrate(replace(session, observations=shifted, bar_poses=()), CalibrationSettings(repair_by_itself=False))
    assert "camera-moved" in {finding.code for finding in done.rig.quality.findings}
