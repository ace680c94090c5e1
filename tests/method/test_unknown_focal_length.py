"""Lenses that nobody stated: the calibration starts from the focal length that the ball shows."""

from dataclasses import replace

import numpy as np
import pytest

from spherecal.calibrate import calibrate
from spherecal.data.session import CameraSpec, Session
from spherecal.initialise.focal_length import with_seen_focal_lengths
from spherecal_sim import simulate_session as simulated
from spherecal_sim.rigs import RigDesign, rig_design
from spherecal_sim.truth import SimulationOptions, Truth

# Measured for 4 to 50 mm, two seeds: at most 7 % off, mostly the distortion that the start does not know.
MOST_OFF = 0.1


def _with_lens(focal_mm: float) -> RigDesign:
    """The demo's rig with another lens; longer ones farther away, as somebody would mount them."""
    design = rig_design("demo")
    kind, times = design.kind, focal_mm / design.kind.focal_length_mm
    away = design.aims_mm + (design.places_mm - design.aims_mm) * max(times, 0.45)
    return replace(design, kind=replace(kind, focal_length_mm=focal_mm), places_mm=away)


def _nobody_knows(camera: CameraSpec) -> CameraSpec:
    """As a new camera is recorded: 1.2 times the longer side, the middle of the image, no distortion."""
    prior = np.zeros_like(camera.prior)
    prior[:2] = 1.2 * max(camera.image_size)
    prior[2:4] = (np.array(camera.image_size) - 1) / 2
    return replace(camera, prior=prior, assumed=("focal_length", "distortion"))


def _session(focal_mm: float, monkeypatch: pytest.MonkeyPatch, options: SimulationOptions) -> tuple[Session, Truth]:
    monkeypatch.setattr(simulated.rigs, "rig_design", lambda _: _with_lens(focal_mm))
    session, truth = simulated.simulate_session("demo", 5, options)
    return replace(session, cameras=tuple(map(_nobody_knows, session.cameras))), truth


@pytest.mark.parametrize("focal_mm", [4.0, 6.0, 8.0, 12.0, 12.5, 16.0, 25.0, 35.0, 50.0])
def test_the_ball_shows_the_focal_length_of_any_lens(focal_mm: float, monkeypatch: pytest.MonkeyPatch) -> None:
    session, truth = _session(focal_mm, monkeypatch, SimulationOptions(targets=120, outlier_fraction=0.02))
    _, seen = with_seen_focal_lengths(session)
    true = {camera.id: camera.intrinsics[0] for camera in truth.cameras}
    assert seen.keys() == true.keys()
    assert max(abs(seen[name] / true[name] - 1) for name in true) < MOST_OFF


@pytest.mark.parametrize("focal_mm", [4.0, 12.0, 50.0])
def test_a_rig_of_unknown_lenses_is_calibrated(focal_mm: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """It says where it started; the adjustment ends at the true lenses."""
    session, truth = _session(focal_mm, monkeypatch, SimulationOptions(targets=120))
    result = calibrate(session)
    (said,) = [one for one in result.rig.quality.findings if one.code == "prior-assumed" and one.kind == "seen"]
    assert said.severity == "info" and set(said.where) == {camera.id for camera in session.cameras}
    true = {camera.id: camera for camera in truth.cameras}
    assert len(result.rig.cameras) == len(true)
    for camera in result.rig.cameras:
        assert abs(camera.intrinsics[0] / true[camera.id].intrinsics[0] - 1) < 0.02, camera.id


def test_cameras_of_one_group_start_from_one_focal_length(monkeypatch: pytest.MonkeyPatch) -> None:
    session, _ = _session(8.0, monkeypatch, SimulationOptions(targets=80))
    grouped = replace(session, cameras=tuple(replace(one, intrinsics_group="all") for one in session.cameras))
    _, seen = with_seen_focal_lengths(grouped)
    assert len(set(seen.values())) == 1


def test_nothing_is_started_from_what_cannot_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the ball's diameter, with too few targets, or where the lens was stated, all stays as it is."""
    session, _ = _session(8.0, monkeypatch, SimulationOptions(targets=80))
    o = session.observations
    assert o is not None
    stated = replace(session, cameras=tuple(replace(one, assumed=()) for one in session.cameras))
    few = replace(session, observations=o.select(o.target <= 3))
    for other in (replace(session, sphere_diameter_mm=None), few, stated):
        same, seen = with_seen_focal_lengths(other)
        assert not seen and same.cameras == other.cameras
