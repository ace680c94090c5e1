"""The fisheye model against OpenCV's, its derivatives against differences, its inverse, its files and exports."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.data.lens_model import with_lens_model
from spherecal.geometry.camera import (
    FISHEYE_MARK,
    camera_matrix,
    distort_with_jacobian,
    fisheye_vector,
    intrinsics_vector,
    is_fisheye,
    lens_model,
    project,
    project_with_derivatives,
    project_with_point_derivatives,
    undistort,
)
from spherecal.geometry.lens_fit import fit_lens, image_field
from spherecal_documents.export.colmap import read_colmap
from spherecal_documents.export.import_rig import write_with_priors
from spherecal_documents.export.kalibr import read_kalibr
from spherecal_documents.export.opencv_yaml import read_opencv
from spherecal_documents.export.write_export import FORMATS, export_rig
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig, rig_bytes
from tests.export_rigs import make_rig

SIZE = (2064, 1544)


def lens(rng: np.random.Generator, field_deg: float = 140.0) -> FloatArray:
    """A lens whose image of the field's edge lies in the corner, with coefficients as real ones have."""
    focal = np.hypot(*SIZE) / 2 / np.deg2rad(field_deg / 2) * rng.uniform(0.98, 1.02)
    matrix = np.array(
        [[focal, 0, 1031.5 + rng.normal(0, 10)], [0, focal * 1.0005, 771.5 + rng.normal(0, 10)], [0, 0, 1]]
    )
    return fisheye_vector(matrix, rng.normal(0, [0.03, 0.01, 0.003, 0.001]))


def rays(rng: np.random.Generator, count: int, widest_deg: float = 70.0) -> FloatArray:
    angle, around = np.deg2rad(widest_deg) * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    r = np.tan(angle)
    return np.column_stack([r * np.cos(around), r * np.sin(around), np.ones(count)]) * rng.uniform(
        0.5, 2000, (count, 1)
    )


def test_projection_agrees_with_opencv() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        c, x = lens(rng), rays(rng, 40)
        expected = cv2.fisheye.projectPoints(x[:, None], np.zeros(3), np.zeros(3), camera_matrix(c), c[4:8])[0]
        np.testing.assert_allclose(project(x, c), expected[:, 0], rtol=0, atol=1e-8)
        np.testing.assert_allclose(project(x, np.tile(c, (40, 1))), expected[:, 0], rtol=0, atol=1e-8)


def test_undistortion_agrees_with_opencv() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        c = lens(rng)
        uv = project(rays(rng, 40, 60.0), c)
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-12)
        expected = cv2.fisheye.undistortPoints(uv[:, None], camera_matrix(c), c[4:8], criteria=criteria)[:, 0]
        found, good = undistort(uv, c)
        assert good.all()
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)


def test_undistortion_takes_distortion_back_up_to_the_edge_of_140_degrees() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        c = lens(rng)
        x = rays(rng, 200)
        xy = x[:, :2] / x[:, 2:]
        found, good = undistort(project(x, c), c)
        assert good.all()
        np.testing.assert_allclose(found, xy, rtol=1e-10, atol=1e-12)
    centred = lens(rng)
    np.testing.assert_array_equal(undistort(centred[None, 2:4], centred)[0], 0.0)


def test_undistortion_says_where_a_lens_ends_or_folds_over() -> None:
    plain = fisheye_vector(np.diag([1000.0, 1000.0, 1.0]), [])
    angle = np.deg2rad([10.0, 85.0, 88.9, 89.5, 95.0, 400.0])
    xy, good = undistort(np.column_stack([1000 * angle, np.zeros(6)]), plain)
    assert good.tolist() == [True, True, True, False, False, False]
    assert np.isnan(xy[~good]).all()
    np.testing.assert_allclose(xy[good, 0], np.tan(angle[good]), rtol=1e-10)
    # theta (1 - theta^2 / 2) turns at sqrt(2/3) = 46.8 degrees, where it is 0.544
    folding = fisheye_vector(np.diag([1000.0, 1000.0, 1.0]), [-0.5])
    xy, good = undistort(np.array([[0.0, 300.0], [540.0, 0.0], [550.0, 0.0], [0.0, 900.0], [np.nan, 0.0]]), folding)
    assert good.tolist() == [True, True, False, False, False]
    assert (np.arctan(np.hypot(*xy[good].T)) < np.sqrt(2 / 3)).all()


def test_undistortion_never_returns_a_wrong_point() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        c = np.r_[rng.uniform(500, 1500, 2), rng.uniform(500, 1000, 2), rng.normal(0, 1, 4), np.zeros(7), FISHEYE_MARK]
        uv = c[2:4] + c[:2] * rng.uniform(-2, 2, (50, 2))
        xy, good = undistort(uv, c)
        assert np.isnan(xy[~good]).all()
        again = project(np.column_stack([xy, np.ones(50)]), c)
        np.testing.assert_allclose(again[good], uv[good], rtol=0, atol=1e-6)


def test_derivatives_agree_with_differences_beside_other_lenses() -> None:
    rng = np.random.default_rng(4)
    x = rays(rng, 60) / 100
    x[:3, :2] = [[0, 0], [1e-9, 0], [1e-4, -1e-4]]  # on the axis and next to it
    c = np.array([lens(rng) for _ in x])
    wide = rng.random(60) < 0.6
    wide[:3] = True
    c[~wide] = intrinsics_vector(camera_matrix(c[0]), [-0.01, 0.002, 1e-4, 1e-4])
    assert (is_fisheye(c) == wide).all()
    uv, by_point, by_lens = project_with_derivatives(x, c)
    np.testing.assert_allclose(uv, project(x, c), rtol=1e-12)
    for one, other in zip(project_with_point_derivatives(x, c), (uv, by_point), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    for axis in range(3):
        step = 1e-6 * np.abs(x[:, 2:3]) * np.eye(3)[axis]
        numeric = (project(x + step, c) - project(x - step, c)) / (2 * step[:, axis : axis + 1])
        np.testing.assert_allclose(by_point[:, :, axis], numeric, rtol=1e-5, atol=1e-6 * np.abs(numeric).max())
    for i in range(8):
        step = (1.0 if i < 4 else 1e-4) * np.eye(16)[i]
        numeric = (project(x, c + step) - project(x, c - step)) / (2 * step[i])
        np.testing.assert_allclose(by_lens[wide, :, i], numeric[wide], rtol=1e-7, atol=1e-7 * np.abs(numeric).max())
    assert (by_lens[wide, :, 8:] == 0).all()
    xy = x[:, :2] / x[:, 2:]
    ideal, good = undistort(uv, c)
    assert good.all()
    np.testing.assert_allclose(ideal, xy, rtol=1e-8, atol=1e-9)
    for axis in range(2):
        h = 1e-6 * np.eye(2)[axis]
        numeric = (distort_with_jacobian(xy + h, c)[0] - distort_with_jacobian(xy - h, c)[0]) / 2e-6
        np.testing.assert_allclose(distort_with_jacobian(xy, c)[1][:, :, axis], numeric, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("field_deg", [100.0, 120.0, 140.0])
def test_a_lens_is_described_by_the_other_models(field_deg: float) -> None:
    true = lens(np.random.default_rng(5), field_deg)
    field = image_field(SIZE)
    rational = fit_lens(true, field, "rational")
    assert rational is not None
    assert lens_model(rational.intrinsics) == "rational"
    back = fit_lens(rational.intrinsics, field, "fisheye")
    assert back is not None
    assert max(rational.rms_px, back.rms_px) < 0.01  # eight coefficients follow such a lens to 1e-3 px
    np.testing.assert_allclose(back.intrinsics[:4], true[:4], rtol=1e-5)
    found = fit_lens(true, field, "brown")
    assert found is not None
    assert not found.intrinsics[9:].any()
    assert found.rms_px > 10 * rational.rms_px


def test_a_lens_that_folds_over_cannot_be_described() -> None:
    folding = intrinsics_vector(np.array([[500.0, 0, 1031.5], [0, 500.0, 771.5], [0, 0, 1]]), [-2e6])
    assert fit_lens(folding, image_field(SIZE), "fisheye") is None


def wide_rig():
    rig = make_rig(5, cameras=4)
    rng = np.random.default_rng(6)
    return replace(rig, cameras=(rig.cameras[0], *(replace(c, intrinsics=lens(rng)) for c in rig.cameras[1:])))


def test_a_rig_file_holds_both_models(tmp_path: Path) -> None:
    rig = wide_rig()
    (tmp_path / "rig.json").write_bytes(rig_bytes(rig))
    entries = [c["distortion"] for c in json.loads(rig_bytes(rig))["cameras"]]
    assert [e["model"] for e in entries] == ["opencv"] + 3 * ["opencv-fisheye"]
    assert [len(e["coefficients"]) for e in entries] == [12, 4, 4, 4]
    again = read_rig(tmp_path / "rig.json")
    for one, other in zip(rig.cameras, again.cameras, strict=True):
        np.testing.assert_array_equal(one.intrinsics, other.intrinsics)
    assert rig_bytes(again) == rig_bytes(rig)


NOT_EXACT_PX = {"maps": 1e-3, "mrcal-splined": 0.01}


@pytest.mark.parametrize("name", FORMATS)
def test_exports_hold_fisheye_lenses_or_refuse_them(tmp_path: Path, name: str) -> None:
    rig = wide_rig()
    if FORMATS[name].fisheye:
        assert export_rig(rig, name, tmp_path / "x", max_loss_px=1).largest_difference_px < 0.1  # of the Brown lens
        wide = replace(rig, cameras=rig.cameras[1:], reference_camera=rig.cameras[1].id)
        assert export_rig(wide, name, tmp_path / "y").largest_difference_px < NOT_EXACT_PX.get(name, 1e-6)
    else:
        with pytest.raises(InputError, match=f"has no fisheye model, which .* {rig.cameras[1].id}") as caught:
            export_rig(rig, name, tmp_path / "x")
        assert "opencv" in str(caught.value)
        assert not (tmp_path / "x").exists()


def session_file(folder: Path, **camera: object) -> Path:
    folder.mkdir()
    entry = {"id": "C1", "image_size": list(SIZE), "pixel_pitch_um": 3.45, "focal_length_mm": 2.9, **camera}
    document = {"format": "spherecal/session", "version": 1, "cameras": [entry, {**entry, "id": "C2"}]}
    (folder / "session.json").write_text(json.dumps(document))
    return folder


PRIOR = {"matrix": [[840.0, 0, 1030.0], [0, 841.0, 770.0], [0, 0, 1]]}


def test_sessions_name_the_lens_model(tmp_path: Path) -> None:
    nominal = read_session(session_file(tmp_path / "a", lens_model="fisheye")).cameras[0]
    assert nominal.lens_model == "fisheye"
    np.testing.assert_array_equal(nominal.prior[4:], [0] * 11 + [FISHEYE_MARK])
    given = read_session(
        session_file(tmp_path / "b", lens_model="fisheye", prior=PRIOR | {"distortion": [1e-2, 0, 0, 1e-4]})
    )
    np.testing.assert_array_equal(given.cameras[1].prior[:8], [840, 841, 1030, 770, 1e-2, 0, 0, 1e-4])
    plain = read_session(session_file(tmp_path / "c", prior=PRIOR | {"distortion": [1e-2, 0, 0, 1e-4]})).cameras[0]
    assert (plain.lens_model, bool(is_fisheye(plain.prior))) == ("brown", False)
    rational = read_session(session_file(tmp_path / "d", lens_model="rational")).cameras[0]
    assert (rational.lens_model, bool(is_fisheye(rational.prior))) == ("rational", False)
    with pytest.raises(InputError, match="lens_model"):
        read_session(session_file(tmp_path / "e", lens_model="pinhole"))
    shared = json.loads((tmp_path / "a" / "session.json").read_text())
    for c, model in zip(shared["cameras"], ("brown", "fisheye"), strict=True):
        c |= {"intrinsics_group": "one", "lens_model": model}
    (tmp_path / "a" / "session.json").write_text(json.dumps(shared))
    with pytest.raises(InputError, match="lens models differ"):
        read_session(tmp_path / "a")


def test_priors_of_another_model_are_replaced_by_the_nearest_lens(tmp_path: Path) -> None:
    true = fisheye_vector(np.array(PRIOR["matrix"]), [0.02, -0.003, 0.001, 0])
    rational = fit_lens(true, image_field(SIZE), "rational")
    assert rational is not None
    prior = {"matrix": camera_matrix(rational.intrinsics).tolist(), "distortion": rational.intrinsics[4:12].tolist()}
    read = read_session(session_file(tmp_path / "a", lens_model="fisheye", prior=prior)).cameras[0]
    x = rays(np.random.default_rng(7), 100, 65.0)
    np.testing.assert_allclose(project(x, read.prior), project(x, true), atol=0.05)
    session = read_session(session_file(tmp_path / "b", prior=prior))
    forced = with_lens_model(session, "fisheye").cameras[1]
    assert forced.lens_model == "fisheye"
    np.testing.assert_allclose(forced.prior, read.prior, rtol=1e-9, atol=1e-9)
    folding = PRIOR | {"distortion": [-2e6, 0, 0, 0, 0]}
    with pytest.raises(InputError, match='camera "C1" folds over'):
        read_session(session_file(tmp_path / "c", lens_model="fisheye", prior=folding))


def test_lenses_of_other_programs_become_priors(tmp_path: Path) -> None:
    rig = wide_rig()
    rig = replace(rig, cameras=rig.cameras[1:3], reference_camera=rig.cameras[1].id)
    for name, read in (("opencv", read_opencv), ("kalibr", read_kalibr), ("colmap", read_colmap)):
        export_rig(rig, name, tmp_path / name)
        for found, camera in zip(read(tmp_path / name), rig.cameras, strict=True):
            np.testing.assert_allclose(found.intrinsics, camera.intrinsics, rtol=1e-12)
    names: list[str] = ["C1", "C2"]
    lenses = dict(zip(names, read_kalibr(tmp_path / "kalibr"), strict=True))
    with_places = session_file(tmp_path / "s")
    write_with_priors(with_places, lenses, tmp_path / "t")
    for spec, camera in zip(read_session(tmp_path / "t").cameras, rig.cameras, strict=True):
        assert spec.lens_model == "fisheye"
        np.testing.assert_array_equal(spec.prior, camera.intrinsics)
