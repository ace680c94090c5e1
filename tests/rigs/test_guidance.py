"""Where to put the ball next, what a length will be measured to, and selected cameras."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.geometry.length_uncertainty import Cameras, predict_lengths
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli.main import main
from spherecal_documents.report.residual_drawings import length_map_figure
from spherecal_documents.report.style import report_style
from spherecal_documents.report.trend_chart import save_guidance_picture
from spherecal_files.rig_file import read_rig
from spherecal_files.write_result import write_result
from spherecal_rigs.limits_file import Limits
from spherecal_rigs.next_placement import ENOUGH_DOTS, advise
from spherecal_rigs.recalibrate import Selection, cross_validate, recalibrate
from spherecal_sim.simulate_session import observe_again, write_session
from spherecal_sim.truth import CameraMove
from tests.networks import calibrated, observed, one_thread, simulated, unstrained

__all__ = ["one_thread", "unstrained"]


def first_placements(session: Session, count: int) -> Session:
    """The session as it was after its first placements."""
    o = observed(session)
    return replace(session, placements=session.placements[:count], observations=o.select(o.placement < count))


def looking(calibration: Calibration) -> Cameras:
    cameras, covariance = calibration.rig.cameras, calibration.rig.covariance
    assert covariance is not None
    return Cameras(
        np.array([c.intrinsics for c in cameras]),
        np.array([c.rotation for c in cameras]),
        np.array([c.translation_mm for c in cameras]),
        np.array([c.image_size for c in cameras], dtype=float),
        covariance.matrix,
        covariance.intrinsics,
    )


def test_every_placement_is_predicted_to_help_and_does() -> None:
    session, _ = simulated("demo", 1, targets=60)
    stated = []
    for count in (2, 3, 4):
        so_far = first_placements(session, count)
        guidance = advise(so_far, calibrate(so_far), enough_dots=0)
        assert guidance is not None
        assert guidance.best is not None and guidance.now_mm is not None
        assert guidance.best.expanded_mm < guidance.now_mm
        assert guidance.placements == tuple(p.id for p in so_far.placements)
        assert [c.expanded_mm for c in guidance.candidates] == sorted(c.expanded_mm for c in guidance.candidates)
        assert guidance.best.cameras >= 3
        assert guidance.best.nearest in guidance.words()
        stated.append(guidance.now_mm)
    assert stated[0] > stated[1] > stated[2]


def test_the_advice_is_a_place_where_every_camera_sees_enough_wherever_there_is_one() -> None:
    """Of this rig's candidates after three placements the one that helps most leaves a camera with 39 dots."""
    assert Limits().needed_dots == ENOUGH_DOTS
    session, _ = simulated("demo", 1)
    three, enough = first_placements(session, 3), 50
    calibration = calibrate(three)
    free, wanted = advise(three, calibration, enough_dots=0), advise(three, calibration, enough_dots=enough)
    assert free is not None and wanted is not None and free.best is not None and wanted.best is not None
    assert free.best.fewest_dots < enough, "else this says nothing"
    assert wanted.best.fewest_dots >= enough
    short = [c.fewest_dots < enough for c in wanted.candidates]
    assert short == sorted(short) and any(short)
    assert wanted.best.expanded_mm < 1.1 * free.best.expanded_mm, "and it costs little"
    unheard_of = advise(three, calibration, enough_dots=10_000)
    assert unheard_of is not None and unheard_of.best == free.best, "where there is none, the one that helps most"


def test_turning_the_ball_beats_moving_it() -> None:
    session, _ = simulated("rigA", 1, placements=2, targets=60)
    guidance = advise(session, calibrate(session))
    assert guidance is not None and guidance.best is not None
    assert guidance.best.axis is not None


def test_one_placement_is_enough_to_plan() -> None:
    session, _ = simulated("rigA", 1, targets=60)
    alone = first_placements(session, 1)
    guidance = advise(alone, calibrate(alone))
    assert guidance is not None and guidance.best is not None and guidance.now_mm is not None
    assert guidance.now_mm > 3 * guidance.best.expanded_mm


def test_the_map_is_that_of_repeated_calibrations(unstrained: None) -> None:
    """Lengths measured by six calibrations of one rig scatter about the truth as each of them predicts."""
    session, truth = simulated("demo", 1)
    centre = np.mean([truth.points_mm(t).mean(axis=0) for t in range(4)], axis=0)
    scores = []
    for run in range(6):
        again = observe_again(session, truth, np.random.default_rng(run))[0]
        calibration = calibrate(again)
        from_truth = calibration.rig.camera("C01")
        true = next(c for c in truth.cameras if c.id == "C01")
        assert from_truth is not None
        turn = from_truth.rotation.T @ true.rotation
        shift = from_truth.rotation.T @ (true.translation_mm - from_truth.translation_mm)
        for direction in np.eye(3):
            ends = np.stack([centre - 100 * direction, centre + 100 * direction]) @ turn.T + shift
            predicted = predict_lengths(looking(calibration), ends[None], 1e-6)
            scores.append(
                (_measured(calibration, truth, centre, direction) - 200.0) / np.sqrt(predicted.calibration[0])
            )
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.6


def _measured(calibration: Calibration, truth, centre: np.ndarray, direction: np.ndarray) -> float:
    """A length of 200 mm, seen without noise by the true cameras, measured with the calibrated ones."""
    from spherecal.geometry.camera import project
    from spherecal.geometry.transform import PosedCameras
    from spherecal.geometry.triangulation import triangulate

    ends = np.stack([centre - 100 * direction, centre + 100 * direction])
    rows = [(e, c) for e in range(2) for c in range(len(truth.cameras))]
    end, camera = np.array(rows).T
    uv = np.array(
        [
            project(
                (truth.cameras[c].rotation @ ends[e] + truth.cameras[c].translation_mm)[None],
                truth.cameras[c].intrinsics[None],
            )[0]
            for e, c in rows
        ]
    )
    cameras = looking(calibration)
    found = triangulate(
        end, camera, uv, np.ones(len(uv)), 2, PosedCameras(cameras.intrinsics, cameras.rotation, cameras.translation)
    )
    return float(np.linalg.norm(found.points[1] - found.points[0]))


def test_the_map_is_written_read_and_drawn(tmp_path: Path) -> None:
    calibration = calibrated("demo", 1)[0]
    write_result(calibration, tmp_path / "out")
    rig = read_rig(tmp_path / "out" / "rig.json")
    assert rig.length_map is not None and rig.covariance is not None and calibration.rig.covariance is not None
    assert rig.length_map.typical_mm is not None and 0 < rig.length_map.typical_mm < 0.2
    np.testing.assert_array_equal(rig.covariance.matrix, calibration.rig.covariance.matrix)
    figure = length_map_figure(rig.length_map)
    with report_style():
        drawn = figure.svg()
    worst = rig.length_map.expanded_mm
    assert f"{np.nanmax(worst):.3f}".lstrip("0") in drawn


def test_a_covariance_of_another_rig_is_refused(tmp_path: Path) -> None:
    write_result(calibrated("demo", 1)[0], tmp_path / "out")
    file = tmp_path / "out" / "covariance.npy"
    file.write_bytes(file.read_bytes()[:-8] + bytes(8))
    with pytest.raises(InputError, match="does not belong"):
        read_rig(tmp_path / "out" / "rig.json")
    file.unlink()
    assert read_rig(tmp_path / "out" / "rig.json").covariance is None


def test_one_camera_anew_and_the_rest_as_it_was() -> None:
    before = calibrated("demo", 1)[0].rig
    moved, _ = simulated("demo", 1, moved=CameraMove("C02", 0, 3.0, 0.01))
    after = recalibrate(moved, before, Selection(("C02",))).rig
    assert after.quality.valid
    assert after.scale == before.scale
    for camera in before.cameras:
        again = after.camera(camera.id)
        assert again is not None
        size = np.linalg.norm(again.centre_mm - camera.centre_mm)
        assert size == pytest.approx(3.0, abs=1.0) if camera.id == "C02" else size < 1e-9
    pose_only = recalibrate(moved, before, Selection(("C02",), "pose")).rig.camera("C02")
    known = before.camera("C02")
    assert pose_only is not None and known is not None
    np.testing.assert_array_equal(pose_only.intrinsics, known.intrinsics)


def test_what_cannot_be_selected_is_refused() -> None:
    session, rig = simulated("demo", 1)[0], calibrated("demo", 1)[0].rig
    ids = [camera.id for camera in rig.cameras]
    for cameras, words in ((("C99",), "no camera C99"), (tuple(ids[1:]), "Fewer than two"), ((), "No camera")):
        with pytest.raises(InputError, match=words):
            recalibrate(session, rig, Selection(cameras))


def test_every_placement_is_predicted_by_the_others() -> None:
    session, _ = simulated("demo", 1, targets=60)
    _, found = cross_validate(session, CalibrationSettings())
    assert [one.placement for one in found] == [p.id for p in session.placements]
    for one in found:
        assert one.rms_px is not None and one.rms_px < 0.08  # 0.04 px of noise a coordinate
        assert one.shape_rms_mm is not None and one.shape_rms_mm < 0.1
        assert one.length_error is not None and abs(one.length_error) < 5e-4
    with pytest.raises(InputError, match="too few"):
        cross_validate(first_placements(session, 2))


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, truth = simulated("demo", 1, targets=50)
    write_session(session, truth, tmp_path / "session")
    picture = tmp_path / "next.png"
    assert main(["guide", str(tmp_path / "session"), "--json", "--picture", str(picture)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["now_mm"] > told["candidates"][0]["expanded_mm"] > 0
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert main(["calibrate", str(tmp_path / "session"), "-o", str(tmp_path / "out")]) == 0
    again = ["recalibrate", str(tmp_path / "session"), "--rig", str(tmp_path / "out" / "rig.json"), "--only", "C03"]
    assert main([*again, "-o", str(tmp_path / "again")]) == 0
    assert read_rig(tmp_path / "again" / "rig.json").quality.valid
    capsys.readouterr()
    assert main(["cross-validate", str(tmp_path / "session"), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == len(session.placements)


def test_the_picture_of_a_plan(tmp_path: Path) -> None:
    session, _ = simulated("demo", 1)
    calibration = calibrated("demo", 1)[0]
    guidance = advise(session, calibration)
    assert guidance is not None
    save_guidance_picture(calibration.rig, guidance, 250.0, tmp_path / "plan.png")
    assert (tmp_path / "plan.png").stat().st_size > 20_000
