"""The quick check: an unchanged rig passes, a camera that moved is named, a bar or ball that no longer fits is told."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.rig import Rig, RigScale
from spherecal.data.rig_camera import posed
from spherecal.data.session import Placement, Session
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli.main import main
from spherecal_files.rig_file import read_rig
from spherecal_files.write_result import write_result
from spherecal_rigs.check_rig import check, check_json, read_known_ball
from spherecal_rigs.repose import repose
from spherecal_rigs.store import open_profile
from spherecal_sim.simulate_session import observe_again, simulate_session, write_session
from spherecal_sim.truth import CameraMove, SimulationOptions
from spherecal_verify.consistency import examine_cameras
from spherecal_verify.limit import parse_limit
from spherecal_verify.outlying_views import Views
from spherecal_verify.verify_bars import views_of

OPTIONS = SimulationOptions(targets=80, placements=5, bar_poses=1)
CALIBRATED = ("P1", "P2", "P3", "P4")


def recorded(move: CameraMove | None = None, seed: int = 3) -> Session:
    session, _ = simulate_session("rigA", seed, replace(OPTIONS, moved=move))
    return session


def only(session: Session, *names: str) -> Session:
    o = session.observations
    assert o is not None
    index = np.array([names.index(name) if name in names else -1 for name in o.placements])
    o = o.select(index[o.placement] >= 0)
    return replace(
        session,
        placements=tuple(p for p in session.placements if p.id in names),
        bar_poses=tuple(p for p in session.bar_poses if p.id in names),
        observations=replace(o, placements=names, placement=index[o.placement]),
    )


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("check") / "result"
    write_result(calibrate(only(recorded(), *CALIBRATED), CalibrationSettings(), Context()), folder)
    return folder


@pytest.fixture(scope="module")
def rig(result: Path) -> Rig:
    return read_rig(result / "rig.json")


def test_an_unchanged_rig_is_ok(result: Path, rig: Rig) -> None:
    found = check(only(recorded(), "P5"), rig, read_known_ball(result / "points.csv"))
    assert found.verdict == "ok" and found.to_repair == () and found.untested == ()
    assert len(found.cameras) == len(rig.cameras)
    (ball,) = found.balls
    assert ball.dots > 100 and abs(ball.scale_ppm) < 3.5 * ball.scale_sd_ppm < 350
    assert json.dumps(check_json(found), allow_nan=False)


@pytest.mark.parametrize("camera", ["C02", "C05", "C10"])
@pytest.mark.parametrize(
    ("shift_mm", "turn_deg", "verdict"), [(0.05, 0.0, "watch"), (0.0, 0.02, "recalibrate"), (30.0, 2.0, "recalibrate")]
)
def test_a_camera_that_moved_is_named(rig: Rig, camera: str, shift_mm: float, turn_deg: float, verdict: str) -> None:
    """From a twentieth of a millimetre to a knock that takes the whole image away: that camera and no other."""
    move = CameraMove(camera, 4, shift_mm, math.radians(turn_deg))
    found = check(only(recorded(move), "P5"), rig)
    assert found.to_repair == (camera,)
    worst = found.cameras[0]
    assert worst.test.id == camera and found.verdict in (verdict, "recalibrate")
    assert all(one.verdict == "ok" for one in found.cameras[1:])
    if turn_deg > 1:  # small turns and shifts of a camera look much alike
        assert math.degrees(float(np.linalg.norm(worst.test.turn_rad))) == pytest.approx(turn_deg, rel=0.05)
    assert camera in found.sentence


def test_a_camera_that_moved_does_not_make_the_ball_larger(tmp_path: Path) -> None:
    """On a rig of six cameras many dots have two views only, which nothing contradicts: +720 ppm before."""
    session, _ = simulate_session("demo", 1, SimulationOptions(bar_poses=0))
    calibration = calibrate(session)
    write_result(calibration, tmp_path / "result")
    now = only(session, "P1")
    o = now.observations
    assert o is not None
    knocked = replace(o, uv=o.uv + np.where(o.camera == 2, 9.0, 0.0)[:, None] * [1.0, 0.0])
    found = check(
        replace(now, observations=knocked), calibration.rig, read_known_ball(tmp_path / "result" / "points.csv")
    )
    assert found.to_repair == ("C03",)
    (ball,) = found.balls
    assert not ball.differs and abs(ball.scale_ppm) < 100 and ball.dots > 300
    assert found.findings == () and "grown" not in found.sentence


def test_two_cameras_that_moved_are_both_named(rig: Rig) -> None:
    first = recorded(CameraMove("C02", 4, 0.3))
    second = recorded(CameraMove("C07", 4, 0.0, math.radians(0.05)))
    assert first.observations is not None and second.observations is not None
    o, other = first.observations, second.observations
    c07 = o.cameras.index("C07")
    # both were seen through the same noise: camera C07's rows of the second recording
    keep = o.select((o.camera != c07) | (o.placement != 4))
    add = other.select((other.camera == c07) & (other.placement == 4))
    both = replace(
        keep,
        **{
            name: np.concatenate([getattr(keep, name), getattr(add, name)])
            for name in ("placement", "camera", "target", "point", "uv")
        },
    )  # type: ignore[arg-type]
    found = check(only(replace(first, observations=both), "P5"), rig)
    assert set(found.to_repair) == {"C02", "C07"}


def test_wrong_matches_are_no_motion(rig: Rig) -> None:
    session = only(recorded(), "P5")
    o = session.observations
    assert o is not None
    rng = np.random.default_rng(1)
    wrong = rng.choice(len(o), len(o) // 100, replace=False)
    uv = o.uv.copy()
    uv[wrong] += rng.uniform(-30, 30, (len(wrong), 2))
    found = check(replace(session, observations=replace(o, uv=uv)), rig)
    assert found.to_repair == ()


def test_chance_is_what_it_says() -> None:
    """The true rig, noise alone: the cameras' p are even between 0 and 1 (Kolmogorov-Smirnov)."""
    from scipy.stats import kstest

    from spherecal.data.observations import find_features
    from spherecal_sim.simulate_session import observe_again
    from tests.method.test_verify import true_rig

    session, truth = simulate_session("rigA", 1, SimulationOptions(targets=30, placements=1, bar_poses=0))
    rig = true_rig(truth)
    p = []
    for run in range(30):
        again, _ = observe_again(session, truth, np.random.default_rng(run))
        assert again.observations is not None
        features = find_features(again.observations)
        views, _ = views_of(again.observations, features, again.observations.camera, rig)
        p += [one.p for one in examine_cameras(views, rig, 0.04).cameras]
    assert kstest(p, "uniform").pvalue > 1e-3


def test_bars_are_measured_and_judged(rig: Rig) -> None:
    session = only(recorded(), "A-1", "B-1") if "A-1" in _ids(recorded()) else only(recorded(), "A-01", "B-01")
    found = check(session, rig)
    assert found.verdict == "watch" and len(found.lengths) == 6  # bars alone do not test every camera
    bars = tuple(
        replace(bar, lengths=tuple(replace(x, length_mm=x.length_mm + 0.5) for x in bar.lengths))
        for bar in session.bars
    )
    wrong = check(replace(session, bars=bars), rig)
    assert wrong.verdict == "recalibrate" and any(f.code == "bar-length" for f in wrong.findings)
    assert check(replace(session, bars=bars), rig, limit=parse_limit("2")).verdict == "watch"


def test_a_bar_that_two_cameras_see_is_measured_though_no_camera_is_tested(rig: Rig) -> None:
    session = only(recorded(), "A-1" if "A-1" in _ids(recorded()) else "A-01")
    o = session.observations
    assert o is not None
    most = np.argsort(np.bincount(o.camera))[-2:]
    by_two = replace(session, observations=o.select(np.isin(o.camera, most)))
    found = check(by_two, rig)
    assert (found.verdict, found.cameras) == ("watch", ()) and found.lengths
    assert "nothing is known about them" in found.sentence
    with pytest.raises(InputError, match="too little is seen"):
        check(replace(by_two, bar_poses=(), placements=(Placement("A-1", {}),)), rig)


def test_a_rig_without_scale_is_not_judged_by_bars(rig: Rig) -> None:
    """Its lengths are arbitrary: they were called half a metre wrong, and the rig was to be recalibrated."""
    arbitrary = replace(rig, scale=RigScale("none", None))
    found = check(recorded(), arbitrary)
    assert (found.verdict, found.lengths) == ("ok", ())
    assert [f.code for f in found.findings] == ["no-scale"]


def _ids(session: Session) -> list[str]:
    return [pose.id for pose in session.bar_poses]


def test_a_ball_of_another_size_is_told(result: Path, rig: Rig) -> None:
    known = read_known_ball(result / "points.csv")
    assert known is not None
    shrunk = replace(
        known, placements={p: {k: x * 0.999 for k, x in dots.items()} for p, dots in known.placements.items()}
    )
    found = check(only(recorded(), "P5"), rig, shrunk)
    assert found.verdict == "recalibrate"
    (finding,) = (f for f in found.findings if f.code == "ball-size")
    assert found.balls[0].scale_ppm == pytest.approx(1000, abs=150) and finding.severity == "error"


def test_too_little_is_refused(rig: Rig) -> None:
    session = only(recorded(), "P5")
    o = session.observations
    assert o is not None
    with pytest.raises(InputError, match="too little"):
        check(replace(session, observations=o.select(o.camera < 2)), rig)
    other = replace(session, cameras=tuple(replace(c, image_size=(10, 10)) for c in session.cameras))
    with pytest.raises(InputError, match="has images of 10 x 10"):
        check(other, rig)
    strange = replace(session, observations=replace(o, cameras=tuple(f"X{i}" for i in range(len(o.cameras)))))
    with pytest.raises(InputError, match="none of its cameras"):
        check(strange, rig)


def test_the_command_checks_and_repairs(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, truth = simulate_session("rigA", 3, replace(OPTIONS, moved=CameraMove("C04", 4, 0.2, math.radians(0.02))))
    write_session(session, truth, tmp_path / "now")
    report, repaired = tmp_path / "check.json", tmp_path / "repaired"
    now, arguments = str(tmp_path / "now"), ["--only", "P5"]
    code = main(["check", now, "--profile", str(result), *arguments, "-o", str(report), "--repair", str(repaired)])
    said = capsys.readouterr().out
    assert code == 3 and "RECALIBRATE" in said and "C04" in said
    document = json.loads(report.read_bytes())
    assert document["verdict"] == "recalibrate" and document["cameras"][0]["id"] == "C04"
    assert main(["check", now, "--profile", str(repaired), *arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "ok"
    before, after = read_rig(result / "rig.json"), read_rig(repaired / "rig.json")
    for a, b in zip(before.cameras, after.cameras, strict=True):
        assert (a.id == "C04") != np.array_equal(a.translation_mm, b.translation_mm)
        assert a.sigma is not None and b.sigma is not None
    # hung on the others, the camera is no more certain than they are
    mended = after.camera("C04")
    assert mended is not None and mended.sigma is not None
    others = [float(np.linalg.norm(c.sigma.centre_mm)) for c in before.cameras if c.sigma is not None]
    assert 0.5 * min(others) < float(np.linalg.norm(mended.sigma.centre_mm)) < 3 * max(others)
    assert before.length_map is not None and after.length_map is not None
    assert before.length_map.typical_mm is not None and after.length_map.typical_mm is not None
    assert 0.9 < after.length_map.typical_mm / before.length_map.typical_mm < 1.5
    assert main(["check", now, "--profile", str(result), "--only", "P9"]) == 2
    assert "has no placement or bar pose P9" in capsys.readouterr().err


def test_checks_are_kept_and_make_a_trend(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Four checks of a rig as it was, then a camera moves: the chip turns stale, the trend names check and camera."""
    profile = tmp_path / "rig7"
    assert main(["profile", "save", str(result), "--to", str(profile), "--apply"]) == 0
    still = simulate_session("rigA", 3, OPTIONS)
    knocked = simulate_session("rigA", 3, replace(OPTIONS, moved=CameraMove("C04", 4, 0.2, math.radians(0.02))))
    for i in range(5):
        session, truth = observe_again(*(still if i < 4 else knocked), np.random.default_rng(i))
        write_session(session, truth, tmp_path / "now")
        code = main(["check", str(tmp_path / "now"), "--profile", str(profile), "--only", "P5"])
        assert code == (0 if i < 4 else 3)
        assert open_profile(profile).validity().state == ("fresh" if i < 4 else "stale")
    assert "is kept in the profile" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "now"), "--profile", str(profile), "--only", "P5", "--not-kept"]) == 3
    assert len(list((profile / "checks").iterdir())) == 5
    capsys.readouterr()

    assert main(["profile", "show", str(profile)]) == 0
    said = capsys.readouterr().out
    assert "STALE (the quick check of" in said and "Quick checks: 5" in said and "RECALIBRATE. Camera C04" in said
    chart = tmp_path / "t.pdf"
    assert main(["profile", "trend", str(profile), "--checks", "-o", str(chart)]) == 0
    said = capsys.readouterr().out
    assert "5 checks: 4 ok, 1 recalibrate" in said
    assert "camera C04: its move is outside the control limits in 5" in said
    assert main(["profile", "trend", str(profile), "--checks", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdicts"] == ["ok"] * 4 + ["recalibrate"]
    assert chart.read_bytes().startswith(b"%PDF")
    assert main(["profile", "save", str(result), "--to", str(profile), "--apply"]) == 0
    assert open_profile(profile).validity().state == "fresh"  # the check was of another calibration


def test_a_moved_reference_camera_is_mended(rig: Rig) -> None:
    assert rig.reference_camera is not None
    session = only(recorded(CameraMove(rig.reference_camera, 4, 0.3, math.radians(0.02))), "P5")
    assert check(session, rig).to_repair == (rig.reference_camera,)
    mended = repose(session, rig, (rig.reference_camera,)).rig
    reference = mended.camera(rig.reference_camera)
    assert reference is not None and np.abs(reference.translation_mm).max() < 1e-9
    assert check(session, mended).verdict == "ok"


def test_empty_views_are_no_error(rig: Rig) -> None:
    empty = Views(
        np.zeros(0, np.int64),
        np.zeros(0, np.int64),
        np.zeros((0, 2)),
        np.ones((0, 2)),
        0,
        posed(rig.cameras),
    )
    found = examine_cameras(empty, rig, 1.0)
    assert found.cameras == () and len(found.untested) == len(rig.cameras)
