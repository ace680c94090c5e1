"""Wide lenses calibrated to their stated uncertainty; other lens models tried, proposed and taken."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.findings import Finding
from spherecal.data.lens_model import with_lens_model
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.geometry.camera import INTRINSIC_NAMES, is_fisheye, lens_model, undistort
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli.main import main
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions, Truth
from tests.networks import codes, one_thread

__all__ = ["one_thread"]

SMALL = SimulationOptions(targets=60, placements=5, bar_poses=0)


@pytest.fixture(scope="module", params=["wide100", "wide140"])
def wide(request: pytest.FixtureRequest) -> tuple[Session, Truth]:
    return simulate_session(request.param, 3, SMALL)


def normalised_errors(found: Calibration, truth: Truth) -> np.ndarray:
    """Errors of the eight numbers of each fisheye lens over their stated uncertainties, (c, 8)."""
    true = {camera.id: camera.intrinsics for camera in truth.cameras}
    rows = []
    for camera in found.rig.cameras:
        assert camera.sigma is not None
        assert is_fisheye(camera.intrinsics)
        assert (camera.sigma.intrinsics[8:] == 0).all()
        rows.append((camera.intrinsics - true[camera.id])[:8] / camera.sigma.intrinsics[:8])
    return np.array(rows)


def test_the_field_is_filled_beyond_what_other_lenses_see(wide: tuple[Session, Truth]) -> None:
    session, truth = wide
    o = session.observations
    assert o is not None
    xy, good = undistort(o.uv, np.array([camera.intrinsics for camera in truth.cameras])[o.camera])
    assert good.all()
    assert np.rad2deg(np.arctan(np.hypot(*xy.T).max())) > 45


@pytest.mark.parametrize("method", ["free", "rigid"])
def test_wide_lenses_are_found_to_their_stated_uncertainty(wide: tuple[Session, Truth], method: str) -> None:
    session, truth = wide
    found = calibrate(session, CalibrationSettings(method=method))  # type: ignore[arg-type]
    assert found.rig.quality.valid
    assert len(found.rig.cameras) == len(session.cameras)
    assert "lens-misfit" not in codes(found)
    assert found.rig.quality.sigma0 == pytest.approx(0.04, rel=0.05)
    errors = normalised_errors(found, truth)
    # 80 numbers whose errors hang together: five series of 10 rigs had 1.02 to 1.11 over all
    assert 0.7 < np.sqrt((errors**2).mean()) < 1.4
    assert np.abs(errors).max() < 5


def lens_finding(found: Calibration) -> Finding:
    return next(f for f in found.rig.quality.findings if f.code == "lens-misfit")


def test_a_wrong_model_is_told_with_the_one_that_fits() -> None:
    session, _ = simulate_session("wide100", 4, SMALL)
    brown = with_lens_model(session, "brown")
    assert not any(is_fisheye(camera.prior) for camera in brown.cameras)
    told = lens_finding(calibrate(brown, CalibrationSettings(method="free")))
    assert "another model was used: the fisheye model" in told.message  # by itself, as nobody named one
    # from a data sheet, as a lens without distortion
    plain = [np.r_[camera.prior[:4], np.zeros(12)] for camera in session.cameras]
    nominal = replace(
        brown, cameras=tuple(replace(c, prior=prior) for c, prior in zip(brown.cameras, plain, strict=True))
    )
    taken = calibrate(nominal, CalibrationSettings(method="free", lens="auto"))
    assert {lens_model(camera.intrinsics) for camera in taken.rig.cameras} == {"fisheye"}
    assert taken.rig.quality.sigma0 == pytest.approx(0.04, rel=0.05)
    assert "another model was used: the fisheye model" in lens_finding(taken).message


def test_the_right_model_stays_and_shared_lenses_are_told() -> None:
    session, _ = simulate_session("demo", 2, replace(SMALL, targets=120))
    auto = calibrate(session, CalibrationSettings(lens="auto"))
    assert {lens_model(camera.intrinsics) for camera in auto.rig.cameras} == {"brown"}
    assert "lens-misfit" not in codes(auto)
    shared = replace(session, cameras=tuple(replace(c, intrinsics_group="one") for c in session.cameras))
    told = lens_finding(calibrate(shared, CalibrationSettings(method="free")))
    assert "a separate lens for each camera fits better".lower() in told.message.lower()
    assert "Calibrate with --own-intrinsics." in told.hint


def test_rational_lenses_are_estimated() -> None:
    session, _ = simulate_session("wide100", 5, SMALL)
    found = calibrate(session, CalibrationSettings(method="free", lens="rational"))
    assert found.rig.quality.valid
    camera = found.rig.cameras[0]
    assert lens_model(camera.intrinsics) == "rational"
    assert camera.sigma is not None
    estimated = [INTRINSIC_NAMES[i] for i in np.flatnonzero(camera.sigma.intrinsics)]
    assert estimated == list(INTRINSIC_NAMES[:12])
    assert found.rig.quality.sigma0 == pytest.approx(0.04, rel=0.05)  # eight coefficients follow these lenses


def test_the_papers_method_has_a_model_of_its_own() -> None:
    session, _ = simulate_session("wide100", 1, SMALL)
    with pytest.raises(InputError, match='Camera "C01" has the lens model fisheye'):
        calibrate(session, CalibrationSettings(method="tao2021"))


def test_by_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, truth = simulate_session("wide120", 6, replace(SMALL, bar_poses=2, targets=40))
    write_session(session, truth, tmp_path / "s")
    again = read_session(tmp_path / "s")
    for one, other in zip(session.cameras, again.cameras, strict=True):
        assert other.lens_model == "fisheye"
        np.testing.assert_array_equal(one.prior, other.prior)
    assert main(["calibrate", str(tmp_path / "s"), "-o", str(tmp_path / "r"), "--method", "free"]) == 0
    assert all(is_fisheye(camera.intrinsics) for camera in read_rig(tmp_path / "r" / "rig.json").cameras)
    rig = str(tmp_path / "r" / "rig.json")
    assert main(["verify", str(tmp_path / "s"), "--rig", rig, "-o", str(tmp_path / "r")]) == 0
    assert main(["report", str(tmp_path / "r"), "-o", str(tmp_path / "report.html")]) == 0
    assert "fisheye" in (tmp_path / "report.html").read_text()
    assert main(["export", rig, "--to", "kalibr", "-o", str(tmp_path / "chain.yaml")]) == 0
    capsys.readouterr()
    assert main(["export", rig, "--to", "metashape", "-o", str(tmp_path / "x.xml")]) == 2
    assert "has no fisheye model" in capsys.readouterr().err
