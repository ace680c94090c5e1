"""Lenses put into smaller models: the loss stated is the loss there is, and too large a loss is refused."""

from pathlib import Path

import numpy as np
import pytest

from spherecal.base.errors import InputError
from spherecal.geometry.camera import project, undistort
from spherecal_documents.export.refit import pixel_grid, refit
from spherecal_documents.export.write_export import export_rig
from tests.export_rigs import make_rig

SIZE = (2064, 1544)


def lens(**named: float) -> np.ndarray:
    from spherecal.geometry.camera import INTRINSIC_NAMES

    vector = np.zeros(16)
    vector[:4] = 2318.0, 2320.0, 1025.0, 780.0
    for name, value in named.items():
        vector[INTRINSIC_NAMES.index(name)] = value
    return vector


def difference(full, small, rotation, grid=(61, 47)):
    xy, good = undistort(pixel_grid(SIZE, grid), full)
    rays = np.column_stack([xy[good], np.ones(good.sum())])
    return np.linalg.norm(project(rays @ rotation.T, small) - project(rays, full), axis=1)


def test_the_loss_is_that_of_the_projection():
    full = make_rig(12).cameras[2].intrinsics
    for count in (4, 5, 8):
        small, rotation, loss = refit(full, SIZE, count)
        assert not small[4 + count :].any()
        d = difference(full, small, rotation)
        assert d.max() == pytest.approx(loss.max_px, rel=0.02)
        assert np.sqrt((d**2).mean()) == pytest.approx(loss.rms_px, rel=0.1)


def test_a_refit_beats_dropping_by_far():
    full = make_rig(5).cameras[0].intrinsics
    small, rotation, loss = refit(full, SIZE, 4)
    cut = full.copy()
    cut[8] = 0
    assert difference(full, cut, np.eye(3)).max() > 10 * loss.max_px
    assert difference(full, small, rotation).max() < 0.1


def test_no_smaller_lens_near_the_found_one_is_better():
    full = make_rig(12).cameras[1].intrinsics
    small, rotation, _ = refit(full, SIZE, 5)
    fit = np.square(difference(full, small, rotation, (41, 31))).sum()
    for i, step in enumerate((0.02, 0.02, 0.02, 0.02, 1e-5, 1e-5, 1e-6, 1e-6, 1e-5)):
        for sign in (-1, 1):
            moved = small.copy()
            moved[i] += sign * step
            assert np.square(difference(full, moved, rotation, (41, 31))).sum() >= fit * (1 - 1e-3)


def test_the_paper_s_prism_becomes_a_turn_with_tangential_distortion():
    full = lens(k1=-0.1, k2=0.05, k3=-0.01, s1=8e-4, s3=-5e-4)
    small, rotation, loss = refit(full, SIZE, 5)
    angle = np.rad2deg(np.arccos((np.trace(rotation) - 1) / 2))
    assert loss.turned_deg == pytest.approx(angle)
    assert angle > 0.05
    assert small[6] != 0 and small[7] != 0
    assert loss.max_px < 0.02  # without the turn: 0.3 px
    d = difference(full, small, rotation)
    assert d.max() == pytest.approx(loss.max_px, rel=0.02)


def test_no_turn_where_it_does_not_help():
    _, rotation, loss = refit(lens(k1=-0.1, k2=0.09, k3=-0.03), SIZE, 4)
    np.testing.assert_array_equal(rotation, np.eye(3))
    assert loss.turned_deg == 0


def test_a_turned_camera_keeps_its_centre(tmp_path: Path) -> None:
    from spherecal_documents.export.write_export import FORMATS

    rig = make_rig(12)
    export_rig(rig, "metashape", tmp_path / "x.xml", max_loss_px=1)
    for camera, read in zip(rig.cameras, FORMATS["metashape"].read(tmp_path / "x.xml"), strict=True):
        np.testing.assert_allclose(read.placed.inverse().translation * 1000, camera.centre_mm, atol=1e-8)


def test_too_large_a_loss_is_refused_and_names_the_camera(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot represent k3.* of camera \"C\d+\".*off by up to 0\.\d+ px") as caught:
        export_rig(make_rig(12), "kalibr", tmp_path / "x")
    assert not (tmp_path / "x").exists()
    needed = float(caught.value.hint.split("--max-loss ")[1].rstrip("."))
    exported = export_rig(make_rig(12), "kalibr", tmp_path / "x", max_loss_px=needed)
    assert exported.largest_difference_px < needed
    with pytest.raises(InputError):
        export_rig(make_rig(12), "kalibr", tmp_path / "y", max_loss_px=0.01)


def test_a_lens_that_folds_is_refused():
    with pytest.raises(InputError, match="folds over"):
        refit(lens(k1=-8.0, s1=1e-3), SIZE, 5)
