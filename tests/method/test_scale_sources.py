"""What the scale rests on: an unmeasured print is stated, sources are weighed, odd poses of a bar are left out."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.studies.judged import judged
from benchmarks.studies.mischief_optics import two_sheets
from benchmarks.studies.mischief_world import make_world
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.data.session import UNMEASURED_PRINT, Scale, Session
from spherecal.steps.repairs import Repairs
from spherecal.steps.settings import CalibrationSettings
from spherecal.targets.target_set import TargetSet
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.main import main
from spherecal_files.read_session import read_session
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions, Truth
from spherecal_verify.verification import Verification
from spherecal_verify.verify_bars import verify

BY_PRINT = SimulationOptions(targets=80, placements=4, bar_poses=4)


def stated(value: float | None) -> float:
    """A figure that is always stated of lengths that were measured."""
    assert value is not None
    return value


@cache
def by_print() -> tuple[Session, Truth]:
    return simulate_session("rigA", 3, BY_PRINT)


@cache
def by_bar() -> Session:
    return simulate_session("rigA", 2, replace(BY_PRINT, scale="bar", bar_poses=6))[0]


def stated_larger(session: Session, factor: float, **more: object) -> Session:
    """Targets and spacing stated larger than they are, and the print not measured."""
    assert session.scale is not None and session.scale.distance_mm is not None and session.target_set is not None
    layouts = {
        number: {name: factor * np.asarray(place) for name, place in layout.items()}
        for number, layout in session.target_set.layouts.items()
    }
    targets: TargetSet = replace(session.target_set, layouts=layouts)
    scale = replace(session.scale, distance_mm=factor * session.scale.distance_mm, expanded_uncertainty_mm=None)
    return replace(session, **({"scale": scale, "target_set": targets} | more))


def codes(done: Calibration | Verification) -> dict[str, str]:
    found = done.rig.quality.findings if isinstance(done, Calibration) else done.findings
    return {f.code: f.severity for f in found}


def scale_of(done: Calibration) -> float:
    found = done.rig.scale.relative_uncertainty
    assert found is not None
    return found


@pytest.mark.parametrize("factor", [1.005, 0.995])
def test_an_unmeasured_print_is_in_every_uncertainty(factor: float) -> None:
    """5 mm in a metre, and no ball's diameter that could say so: VALID, 68 times U off, before."""
    session, _ = by_print()
    done = calibrate(stated_larger(session, factor, sphere_diameter_mm=None))
    assert done.rig.quality.verdict == "use-with-care" and any(one.scale for one in done.rig.quality.affected)
    assert codes(done)["print-unmeasured"] == "warning"
    assert scale_of(done) == pytest.approx(UNMEASURED_PRINT, rel=1e-2)
    found = verify(session, done.rig)  # the rig is wrong by 0.5 %, and says that it may be
    assert found.decision.verdict == "consistent"
    assert found.overall.mean_error_mm is not None and found.overall.expanded_uncertainty_mm is not None
    assert 0.5 < abs(found.overall.mean_error_mm) < found.overall.expanded_uncertainty_mm
    assert all(abs(stated(x.mean_error_mm)) < stated(x.expanded_uncertainty_mm) for x in found.lengths)


def test_a_measured_print_lifts_it() -> None:
    session, _ = by_print()
    assert session.scale is not None and session.scale.distance_mm is not None
    done = calibrate(replace(session, scale=replace(session.scale, expanded_uncertainty_mm=0.02)))
    assert done.rig.quality.verdict == "valid" and "print-unmeasured" not in codes(done)
    assert scale_of(done) == pytest.approx(0.01 / session.scale.distance_mm, rel=0.02)


def test_a_ball_of_measured_diameter_lifts_it() -> None:
    """A print 0.5 % too large; the ball is known to 0.2 mm, and round to 0.12 %."""
    session, _ = by_print()
    done = calibrate(stated_larger(session, 1.005, sphere_sd_mm=0.1))
    assert done.rig.quality.verdict == "valid" and done.rig.scale.source == "ball"
    assert 0.0003 < scale_of(done) < 0.0015
    found = verify(session, done.rig)
    assert found.decision.verdict == "consistent" and (found.overall.max_abs_error_mm or 9) < 1.3


def test_lengths_may_be_of_no_matter() -> None:
    session, _ = by_print()
    done = calibrate(replace(session, scale=Scale("none")))
    assert done.rig.quality.verdict == "valid" and done.rig.scale.source == "none"
    assert codes(done)["no-scale"] == "info"


def test_the_session_file_says_how_the_print_was_measured(tmp_path: Path) -> None:
    session, truth = by_print()
    write_session(session, truth, tmp_path / "session")
    file = tmp_path / "session" / "session.json"
    document = json.loads(file.read_text())
    for scale, sphere, print_sd, sphere_sd in (
        ({}, {}, UNMEASURED_PRINT, None),
        ({"expanded_uncertainty_mm": 0.04, "coverage_factor": 4}, {}, 0.01 / 22.0, None),
        ({}, {"expanded_uncertainty_mm": 0.3, "coverage_factor": 3}, UNMEASURED_PRINT, 0.1),
    ):
        spacing = {key: document["scale"][key] for key in ("kind", "from", "to", "surface")}
        stated = {"scale": {**spacing, "distance_mm": 22.0, **scale}, "sphere": {"nominal_diameter_mm": 500, **sphere}}
        file.write_text(json.dumps(document | stated))
        read = read_session(tmp_path / "session")
        assert read.scale is not None and read.scale.print_sd == pytest.approx(print_sd)
        assert read.sphere_sd_mm == (None if sphere_sd is None else pytest.approx(sphere_sd))
    file.write_text(json.dumps(document | {"scale": {"kind": "none"}}))
    assert read_session(tmp_path / "session").scale == Scale("none")


def certified_larger(session: Session, on_800_mm: float) -> Session:
    bars = tuple(
        replace(bar, lengths=tuple(replace(x, length_mm=x.length_mm * (1 + on_800_mm / 800)) for x in bar.lengths))
        if bar.id == "B"
        else bar
        for bar in session.bars
    )
    return replace(session, bars=bars)


@pytest.mark.parametrize(
    ("on_800_mm", "verdict"),
    [(0.0, "valid"), (1.0, "use-with-care"), (-2.5, "use-with-care"), (4.5, "not-valid"), (-7.0, "not-valid")],
)
def test_print_and_ball_contradict_a_wrong_bar(on_800_mm: float, verdict: str) -> None:
    """A certificate mistyped: VALID, 60 to 132 U off, before; both others say so by as much."""
    done = calibrate(certified_larger(by_bar(), on_800_mm))
    assert done.rig.quality.verdict == verdict
    assert ("scale-sources" in codes(done)) == (verdict != "valid")
    if verdict != "valid":
        (finding,) = (f for f in done.rig.quality.findings if f.code == "scale-sources")
        assert finding.where == ("B",)
        assert finding.values["print_percent"] == pytest.approx(on_800_mm / 8, abs=0.02)
        assert "print-scale" not in codes(done)  # which would have the wrong value taken for the print's


@pytest.mark.parametrize("source", ["print", "ball", "bar"])
def test_a_source_is_struck_out_by_hand(source: str) -> None:
    wrong = certified_larger(by_bar(), 5.0)
    done = calibrate(wrong, CalibrationSettings(repairs=Repairs(leave_out=(f"scale:{source}",))))
    assert "scale-sources" not in codes(done) and codes(done)["left-out"] == "info"
    assert done.rig.quality.valid and done.rig.scale.source == ("target_spacing" if source == "bar" else "bar")
    if source == "bar":
        assert done.rig.quality.verdict == "use-with-care"  # the print, which nobody measured, gives the scale


def shifted(session: Session, poses: list[str], mm: float) -> Session:
    """One mark of the bar further along it by `mm` in some poses: read wrong, or loose."""
    o = session.observations
    assert o is not None
    bar = next(bar for bar in session.bars if bar.id == "B")
    longest = max(bar.lengths, key=lambda x: x.length_mm)
    first, last = (bar.marks[name].target for name in (longest.from_mark, longest.to_mark))
    uv = o.uv.copy()
    for pose in map(o.placements.index, poses):
        for camera in range(len(o.cameras)):
            here = (o.placement == pose) & (o.camera == camera)
            a, b = here & (o.target == first), here & (o.target == last)
            if a.any() and b.any():
                uv[b] += (uv[b].mean(axis=0) - uv[a].mean(axis=0)) / longest.length_mm * mm
    return replace(session, observations=replace(o, uv=uv))


@pytest.mark.parametrize(("poses", "mm"), [(["B-01"], 0.3), (["B-02"], -1.0), (["B-01", "B-02"], 3.0)])
def test_odd_poses_of_the_bar_are_named_and_left_out(poses: list[str], mm: float) -> None:
    right, session = calibrate(by_bar()), by_bar()
    assert "bar-poses-disagree" not in codes(right)
    done = calibrate(shifted(session, poses, mm))
    (finding,) = (f for f in done.rig.quality.findings if f.code == "bar-poses-disagree")
    assert list(finding.where) == poses and done.rig.quality.verdict == "use-with-care"
    centres = [np.array([c.centre_mm for c in one.rig.cameras]) for one in (right, done)]
    size = [np.linalg.norm(x[1:] - x[0], axis=1).sum() for x in centres]
    assert size[1] / size[0] == pytest.approx(1.0, abs=5e-5)


def test_poses_without_a_majority_are_not_valid() -> None:
    done = calibrate(shifted(by_bar(), ["B-01", "B-02", "B-03"], 1.0))
    assert codes(done)["bar-poses-disagree"] == "error" and done.rig.quality.verdict == "not-valid"


@pytest.mark.parametrize(("celsius", "guess"), [(70.0, "21.1"), (120.0, ""), (293.0, "19.9"), (46.0, "7.8")])
def test_a_temperature_of_no_workshop_is_asked_about(celsius: float, guess: str) -> None:
    session = by_bar()
    hot = replace(session, bar_poses=tuple(replace(p, temperature_c=celsius) for p in session.bar_poses))
    done = calibrate(hot)
    assert done.rig.quality.verdict == "not-valid"
    (finding,) = (f for f in done.rig.quality.findings if f.code == "bar-temperature")
    assert f"{celsius:g} °C" in finding.message and guess in finding.message
    found = verify(hot, calibrate(session).rig)
    assert found.failed and codes(found)["bar-temperature"] == "error"


def test_the_bars_temperature_is_in_the_scales_uncertainty() -> None:
    """Not measured, it may be 5 K off: 33 ppm of steel, where the certificate has 4."""
    session = by_bar()
    unknown = replace(session, bar_poses=tuple(replace(p, temperature_c=None) for p in session.bar_poses))
    measured, assumed = scale_of(calibrate(session)), scale_of(calibrate(unknown))
    assert measured < 2e-5 and assumed == pytest.approx(np.hypot(measured, 3.3e-5), rel=0.1)


def test_session_new_takes_what_the_print_measures(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    images = tmp_path / "images"
    for place in (images / f"cam{camera}" / f"{number}.png" for camera in (1, 2) for number in (1, 2, 3)):
        place.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(place), np.full((120, 160), 40 * int(place.stem), np.uint8))
    assert main(["targets", "export", "--count", "3", "-o", str(tmp_path / "targets.json")]) == DONE
    for more, stated in (([], None), (["--spacing", "27.9,0.05"], 0.05)):
        new = tmp_path / f"new{len(more)}"
        words = ["session", "new", str(new), "--images", str(images), "--targets", str(tmp_path / "targets.json")]
        capsys.readouterr()
        assert main([*words, *more]) == DONE
        scale = json.loads((new / "session.json").read_text())["scale"]
        assert scale.get("expanded_uncertainty_mm") == stated
        assert ("0.3 %" in capsys.readouterr().out) == (stated is None)


def spoilt_stickers(session: Session, shrink: float = 0.0, outward_px: float = 0.0) -> Session:
    """Stickers that shrink steadily over the recording by `shrink`, or whose dots are blurred outward."""
    o = session.observations
    assert o is not None
    count = len(session.placements)
    of = np.unique(np.stack([o.placement, o.camera, o.target]), axis=1, return_inverse=True)[1].reshape(-1)
    middle = np.stack([np.bincount(of, o.uv[:, i]) / np.bincount(of) for i in (0, 1)], axis=1)[of]
    out, ball = o.uv - middle, (o.placement < count)[:, None]
    factor = np.where(ball, 1 - shrink * o.placement[:, None] / (count - 1), 1.0)
    size = np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    uv = middle + out * factor + np.where(ball, outward_px * out / size, 0.0)
    return replace(session, observations=replace(o, uv=uv))


@pytest.mark.parametrize(("shrink", "outward_px"), [(2e-3, 0.0), (0.0, 0.1)])
def test_stickers_that_change_make_the_scale_doubtful(shrink: float, outward_px: float) -> None:
    """VALID, lengths 7.4 and 4.6 U off, before."""
    session, _ = by_print()
    assert "stickers-change" not in codes(calibrate(session))
    done = calibrate(spoilt_stickers(session, shrink, outward_px))
    assert done.rig.quality.verdict == "use-with-care" and any(one.scale for one in done.rig.quality.affected)
    assert codes(done)["stickers-change"] == "warning"
    found = verify(session, done.rig)
    assert found.decision.verdict == "consistent"
    assert all(abs(stated(x.mean_error_mm)) < stated(x.expanded_uncertainty_mm) for x in found.lengths)
    by = calibrate(spoilt_stickers(by_bar(), shrink, outward_px))  # whose scale the stickers do not touch
    assert "stickers-change" not in codes(by) and by.rig.quality.verdict == "valid"


@pytest.mark.parametrize(("rig", "larger", "verdict"), [("rigA", 0.002, "valid"), ("rigB", 0.01, "use-with-care")])
def test_stickers_of_two_sheets_make_the_scale_doubtful(rig: str, larger: float, verdict: str) -> None:
    """VALID with lengths 4 and 5 U off; where noise is little one half was left out as wrong."""
    case = two_sheets(make_world(rig, 1), larger, np.random.default_rng(1))
    done = calibrate(case.session)
    (finding,) = [f for f in done.rig.quality.findings if f.code == "print-stretched"]
    assert finding.kind == "sheets" and finding.values["percent"] == pytest.approx(100 * larger, rel=0.1)
    assert done.rig.quality.verdict == verdict and judged(done, case.reference).covered >= 0.95
