"""Calibration by a waved bar: against simulated truth, two cameras, three marks, dots for marks, refused input."""

import json
from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.geometry.rotation import log_rotation
from spherecal.geometry.transform import fit_similarity
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli.main import main
from spherecal_boards.bar import calibrate_bar
from spherecal_boards.bar_marks import bar_recording, known_lengths
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.simulated_boards import SimulatedRecording, simulate_waved_bar
from spherecal_sim.truth import SimulationOptions


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    with threadpool_limits(1, user_api="blas"):
        yield


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    return simulate_waved_bar("demo", 2, 250)


@pytest.fixture(scope="module")
def calibration(recording) -> Calibration:
    return calibrate_bar(recording.session)


def errors_over_sigma(recording: SimulatedRecording, calibration: Calibration) -> dict[str, np.ndarray]:
    """Errors after a similarity over the points, divided by their stated uncertainties."""
    f = calibration.features
    truth = recording.points_mm[f.placement, f.target - 1]
    found = np.isfinite(calibration.points_mm[:, 0])
    fit = fit_similarity(calibration.points_mm[found], truth[found])
    points = (fit.apply(calibration.points_mm) - truth) @ fit.rotation / calibration.points_sigma_mm
    parts = {"points": [points[found]], "centre": [], "rotation": [], "intrinsics": []}
    assert calibration.rig.scale.relative_uncertainty is not None
    parts["scale"] = [np.array([(fit.scale - 1) / calibration.rig.scale.relative_uncertainty])]
    true = {camera.id: camera for camera in recording.cameras}
    for camera in calibration.rig.cameras:
        assert camera.sigma is not None
        other = true[camera.id]
        moved = (fit.apply(camera.centre_mm[None])[0] - other.centre_mm) @ fit.rotation
        turned = np.rad2deg(log_rotation(camera.rotation @ fit.rotation.T @ other.rotation.T))
        free = camera.sigma.intrinsics > 0
        parts["centre"].append(moved / camera.sigma.centre_mm)
        parts["rotation"].append(turned / camera.sigma.rotation_deg)
        parts["intrinsics"].append((camera.intrinsics - other.intrinsics)[free] / camera.sigma.intrinsics[free])
    return {name: np.concatenate(values) for name, values in parts.items()}


def test_errors_are_those_that_the_result_states(recording, calibration):
    assert calibration.rig.quality.valid
    assert len(calibration.rig.cameras) == 6
    assert calibration.rig.scale.source == "bar"
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.05)
    z = errors_over_sigma(recording, calibration)
    for name, values in z.items():
        assert np.sqrt((values**2).mean()) < (3.0 if name == "scale" else 1.5), name
    assert 0.8 < np.sqrt((z["points"] ** 2).mean()) < 1.2
    assert 0.7 < np.sqrt((z["intrinsics"] ** 2).mean()) < 1.3


def test_the_bar_has_its_length(recording, calibration):
    f = calibration.features
    points = np.full((250, 2, 3), np.nan)
    points[f.placement, f.target - 1] = calibration.points_mm
    length = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    certified = recording.session.bars[0].lengths[0].length_mm
    # rows of length hold every frame to the micrometre, noise of one end is 0.02 mm
    assert np.nanmax(np.abs(length - certified)) < 0.003


def test_the_certificate_is_not_averaged(recording):
    bar = recording.session.bars[0]
    worse = replace(bar, lengths=(replace(bar.lengths[0], expanded_uncertainty_mm=0.3),))
    result = calibrate_bar(replace(recording.session, bars=(worse,)))
    assert result.rig.scale.relative_uncertainty == pytest.approx(0.15 / 300, rel=0.05)


def test_temperature_stretches_the_bar(recording, calibration):
    warm = tuple(replace(pose, temperature_c=30.0) for pose in recording.session.bar_poses)
    result = calibrate_bar(replace(recording.session, bar_poses=warm))
    ratio = [
        np.linalg.norm(a.centre_mm - result.rig.cameras[0].centre_mm)
        / np.linalg.norm(b.centre_mm - calibration.rig.cameras[0].centre_mm)
        for a, b in zip(result.rig.cameras[1:], calibration.rig.cameras[1:], strict=True)
    ]
    assert np.abs(np.array(ratio) - 1.000115).max() < 1e-8


def test_known_intrinsics_stay_and_help(recording):
    true = {c.id: c.intrinsics for c in recording.cameras}
    cameras = tuple(replace(c, prior=true[c.id]) for c in recording.session.cameras)
    result = calibrate_bar(replace(recording.session, cameras=cameras), CalibrationSettings(intrinsics="fixed"))
    assert all((c.intrinsics == true[c.id]).all() for c in result.rig.cameras)
    z = errors_over_sigma(recording, result)
    assert 0.8 < np.sqrt((z["points"] ** 2).mean()) < 1.2


def only(session: Session, cameras: list[int]) -> Session:
    o = session.observations
    assert o is not None
    own = o.select(np.isin(o.camera, cameras))
    new = np.searchsorted(cameras, own.camera)
    own = replace(own, cameras=tuple(o.cameras[c] for c in cameras), camera=new)
    return replace(session, cameras=tuple(session.cameras[c] for c in cameras), observations=own)


def test_two_cameras_are_enough(recording):
    result = calibrate_bar(only(recording.session, [0, 1]))
    assert result.rig.quality.valid
    two = replace(recording, cameras=recording.cameras[:2])
    z = errors_over_sigma(two, result)
    assert np.sqrt((z["points"] ** 2).mean()) < 1.5
    between = np.linalg.norm(result.rig.cameras[0].centre_mm - result.rig.cameras[1].centre_mm)
    truth = np.linalg.norm(recording.cameras[0].centre_mm - recording.cameras[1].centre_mm)
    assert between == pytest.approx(truth, rel=5e-3)


def test_three_marks_and_wrong_matches():
    recording = simulate_waved_bar("demo", 4, 150, marks_mm=(0.0, 120.0, 300.0))
    o = recording.session.observations
    assert o is not None
    rng = np.random.default_rng(3)
    uv = o.uv.copy()
    wrong = rng.permutation(len(o))[: len(o) // 30]
    uv[wrong] += rng.uniform(8, 60, (len(wrong), 2)) * rng.choice([-1, 1], (len(wrong), 2))
    result = calibrate_bar(replace(recording.session, observations=replace(o, uv=uv)))
    assert result.rig.quality.valid
    assert result.used[wrong].mean() < 0.02  # what lies along the ray of a second camera alone looks right
    z = errors_over_sigma(recording, result)
    assert np.sqrt((z["centre"] ** 2).mean()) < 1.6


def test_marks_found_from_their_dots():
    options = SimulationOptions(scale="bar", bar_poses=50, mark_points="dots", targets=10)
    session, truth = simulate_session("demo", 1, options)
    bar = next(b for b in session.bars if b.role == "scale")
    recording = bar_recording(session, bar)
    assert recording.slots == 32
    lengths = known_lengths(session, recording, np.ones(recording.n_points, dtype=bool))
    assert len(lengths.frame) == 3 * 50
    assert np.abs(lengths.coefficient.sum(axis=1)).max() < 1e-9
    result = calibrate_bar(session)
    assert result.rig.quality.valid
    true = np.array([c.centre_mm for c in truth.cameras])
    found = np.array([c.centre_mm for c in result.rig.cameras])
    fit = fit_similarity(found, true)
    # the certificate errs by 0.002 mm on lengths of 120 to 500 mm
    assert result.rig.scale.relative_uncertainty is not None
    assert fit.scale == pytest.approx(1.0, abs=4 * result.rig.scale.relative_uncertainty + 1e-4)
    assert np.abs(fit.apply(found) - true).max() < 0.5


def test_unlinked_cameras_are_named(recording):
    o = recording.session.observations
    half = np.isin(o.camera, [0, 1, 3]) == (o.placement % 2 == 0)
    result = calibrate_bar(replace(recording.session, observations=o.select(half)))
    assert not result.rig.quality.valid
    finding = next(f for f in result.rig.quality.findings if f.code == "cameras-unlinked")
    assert "C01 C02 C04" in finding.message
    assert "C03 C05 C06" in finding.message
    assert len(result.rig.cameras) == 3


def test_nothing_in_common_is_a_result_too(recording):
    o = recording.session.observations
    alone = o.select(o.placement % 6 == o.camera)
    result = calibrate_bar(replace(recording.session, observations=alone))
    assert not result.rig.quality.valid
    assert result.rig.quality.findings[0].code == "nothing-reconstructed"


def test_refused_sessions(recording):
    session = recording.session
    with pytest.raises(InputError, match="needs a bar"):
        calibrate_bar(replace(session, scale=None))
    with pytest.raises(InputError, match="bar_poses"):
        calibrate_bar(replace(session, bar_poses=()))
    o = session.observations
    with pytest.raises(InputError, match="none of its observations"):
        calibrate_bar(replace(session, observations=replace(o, target=o.target + 50)))


def test_the_same_input_gives_the_same_bytes(recording, calibration):
    again = calibrate(recording.session, CalibrationSettings(method="bar"))
    for a, b in zip(calibration.rig.cameras, again.rig.cameras, strict=True):
        assert (a.translation_mm == b.translation_mm).all()
        assert (a.intrinsics == b.intrinsics).all()


def test_command_line(tmp_path):
    options = SimulationOptions(scale="bar", bar_poses=100, targets=10)
    session, truth = simulate_session("demo", 1, options)
    write_session(session, truth, tmp_path / "s")
    code = main(["calibrate", str(tmp_path / "s"), "-o", str(tmp_path / "r"), "--method", "bar"])
    assert code == 0
    rig = json.loads((tmp_path / "r" / "rig.json").read_text())
    assert rig["scale"]["source"] == "bar"
    assert rig["software"]["method"] == "bar"
    placements = {line.split(",")[0] for line in (tmp_path / "r" / "points.csv").read_text().splitlines()[1:]}
    assert placements == {pose.id for pose in session.bar_poses if pose.bar == "B"}


@pytest.mark.slow
def test_fifteen_hundred_frames_before_ten_cameras():
    recording = simulate_waved_bar("rigA", 1, 1500)
    result = calibrate_bar(recording.session)
    assert result.rig.quality.valid
    assert len(result.rig.cameras) == 10
    z = errors_over_sigma(recording, result)
    for name in ("points", "rotation", "intrinsics", "centre"):
        assert 0.6 < np.sqrt((z[name] ** 2).mean()) < 1.4, name
    assert sum(result.seconds.values()) < 45  # 5 s on two quiet cores
