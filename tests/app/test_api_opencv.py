"""Rigs in OpenCV's terms: the same projections both ways, images undistorted, what is refused, how a rig prints."""

import sys

import cv2
import numpy as np
import pytest

import spherecal

SIZE = (1280, 960)
K = np.array([[1210.0, 0.0, 633.5], [0.0, 1195.0, 488.25], [0.0, 0.0, 1.0]])
COEFFICIENTS = np.array([-0.21, 0.09, 8e-4, -5e-4, -0.03, 0.02, -0.01, 0.004, 6e-4, -2e-4, 3e-4, 1e-4])


def poses() -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses whose rotations reach from none to half a turn, that look at (0, 0, 1500) from 1.5 m."""
    found = []
    for rvec in ([0, 0, 0], [0.2, -0.4, 0.1], [0, np.pi, 0], [np.pi * 0.6, 0.0, -np.pi * 0.8], [1e-9, 0, 0]):
        R = cv2.Rodrigues(np.array(rvec, dtype=float))[0]
        found.append((np.array(rvec, dtype=float), np.array([0, 0, 1500.0]) - R @ [0, 0, 1500.0]))
    return found


def points(spread: float) -> np.ndarray:
    return np.array([0, 0, 1500.0]) + np.random.default_rng(3).uniform(-spread, spread, (200, 3))


@pytest.mark.parametrize("count", [0, 4, 5, 8, 12])
def test_projections_are_opencvs(count: int) -> None:
    dist = COEFFICIENTS[:count] if count else None
    rig = spherecal.Rig.from_opencv({f"c{i}": (K, dist, r, t) for i, (r, t) in enumerate(poses())}, SIZE)
    world = points(350)
    for i, (rvec, tvec) in enumerate(poses()):
        expected, _ = cv2.projectPoints(world, rvec, tvec, K, dist)
        assert np.abs(rig[f"c{i}"].project(world) - expected[:, 0]).max() < 1e-6
        camera = rig[f"c{i}"]  # and back, as OpenCV would be given it
        again, _ = cv2.projectPoints(world, camera.rvec, camera.tvec, camera.K, camera.dist)
        assert np.abs(again - expected).max() < 1e-6
        assert camera.dist.shape == (12,) and camera.lens_model == ("rational" if count > 5 else "brown")


def test_fisheye_projections_are_opencvs() -> None:
    k = np.array([0.05, -0.01, 0.004, -0.001])
    given = {f"c{i}": (K, k, r, t) for i, (r, t) in enumerate(poses())}
    rig = spherecal.Rig.from_opencv(given, SIZE, fisheye=True)
    world = points(700)
    for i, (rvec, tvec) in enumerate(poses()):
        expected, _ = cv2.fisheye.projectPoints(world[:, None], rvec, tvec, K, k)
        camera = rig[f"c{i}"]
        assert np.abs(camera.project(world) - expected[:, 0]).max() < 1e-6
        again, _ = cv2.fisheye.projectPoints(world[:, None], camera.rvec, camera.tvec, camera.K, camera.dist)
        assert np.abs(again - expected).max() < 1e-6
        assert camera.lens_model == "fisheye"
        theirs = cv2.fisheye.undistortPoints(expected, K, k, P=K)[:, 0]
        assert np.abs(camera.undistort(expected[:, 0]) - theirs).max() < 1e-4, "their iteration ends at 1e-8 rad"
    mixed = spherecal.Rig.from_opencv(given, SIZE, fisheye=["c1"])
    assert [camera.lens_model for camera in mixed] == ["brown", "fisheye", "brown", "brown", "brown"]


def test_shapes_that_opencv_hands_out_are_taken() -> None:
    R = cv2.Rodrigues(np.array([0.1, 0.2, 0.3]))[0]
    forms = [
        (K, COEFFICIENTS[:5], np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0])),
        (K.tolist(), COEFFICIENTS[None, :5], np.array([[0.1], [0.2], [0.3]]), np.array([[1.0], [2.0], [3.0]])),
        (K, COEFFICIENTS[:5, None], R, [[1.0, 2.0, 3.0]]),
    ]
    rigs = [spherecal.Rig.from_opencv({"c": form}, {"c": SIZE}) for form in forms]
    for rig in rigs[1:]:
        assert np.abs(rig["c"].rotation - rigs[0]["c"].rotation).max() < 1e-12
        assert np.array_equal(rig["c"].intrinsics, rigs[0]["c"].intrinsics)
        assert np.array_equal(rig["c"].tvec, [1, 2, 3])
    metres = spherecal.Rig.from_opencv({"c": forms[0]}, SIZE, unit="m")
    assert np.array_equal(metres["c"].translation_mm, [1000, 2000, 3000])


def test_the_projection_matrix_is_that_of_undistorted_points() -> None:
    rvec, tvec = poses()[1]
    camera = spherecal.Rig.from_opencv({"c": (K, COEFFICIENTS, rvec, tvec)}, SIZE)["c"]
    world = points(250)
    homogeneous = np.column_stack([world, np.ones(len(world))]) @ camera.P.T
    assert np.abs(homogeneous[:, :2] / homogeneous[:, 2:] - camera.undistort(camera.project(world))).max() < 1e-8


@pytest.mark.parametrize("channels", [(), (3,)])
def test_images_are_undistorted_as_by_opencv(channels: tuple[int, ...]) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (*SIZE[::-1], *channels), dtype=np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 3)
    rig = spherecal.Rig.from_opencv({"c": (K, COEFFICIENTS, np.zeros(3), np.zeros(3))}, SIZE)
    ours, theirs = rig["c"].undistort(image), cv2.undistort(image, K, COEFFICIENTS)
    assert ours.dtype == image.dtype and ours.shape == image.shape
    inner = np.s_[5:-5, 5:-5]
    difference = np.abs(ours[inner].astype(int) - theirs[inner])
    assert difference.max() <= 2 and difference.mean() < 0.2, "OpenCV's remap rounds places to 1/32 px"
    deep = rig["c"].undistort(image[..., :].astype(np.uint16) * 256)
    assert deep.dtype == np.uint16
    new = K * [[0.8], [0.8], [1.0]]
    other = cv2.undistort(image, K, COEFFICIENTS, None, new)
    assert np.abs(rig["c"].undistort(image, new)[200:700, 300:900].astype(int) - other[200:700, 300:900]).max() <= 2


def test_points_without_an_inverse_are_nan_and_shapes_stay() -> None:
    rig = spherecal.Rig.from_opencv({"c": (K, [-2.5, 0, 0, 0], np.zeros(3), np.zeros(3))}, SIZE)
    uv = rig["c"].undistort([[[633.5, 488.25], [0.0, 0.0]]])
    assert uv.shape == (1, 2, 2)
    assert np.allclose(uv[0, 0], [633.5, 488.25]) and np.isnan(uv[0, 1]).all()
    assert np.isnan(rig["c"].project([0, 0, -5.0])).all()
    with pytest.raises(spherecal.InputError, match="neither an image of camera c, 960 x 1280, nor image points"):
        rig["c"].undistort(np.zeros((10, 12)))


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ((K, np.zeros(14), np.zeros(3), np.zeros(3)), "14 numbers: the last two tilt the sensor"),
        ((K, np.zeros(6), np.zeros(3), np.zeros(3)), "4, 5, 8 or 12 numbers, but has 6"),
        ((K, [np.nan] * 5, np.zeros(3), np.zeros(3)), "not finite"),
        ((K.T, None, np.zeros(3), np.zeros(3)), "must have the form"),
        ((K[:2], None, np.zeros(3), np.zeros(3)), r"shape \(3, 3\)"),
        ((K, None, np.diag([1, 1, -1.0]), np.zeros(3)), "not a rotation matrix"),
        ((K, None, np.eye(3) * 2, np.zeros(3)), "not a rotation matrix"),
        ((K, None, np.zeros(4), np.zeros(3)), "3 numbers"),
        ((K, None, np.zeros(3), "far"), "must be an array of numbers"),
        ((K, None, np.zeros(3)), r"\(K, dist, rvec, tvec\)"),
    ],
)
def test_what_cannot_be_used_is_named(camera: tuple, message: str) -> None:
    with pytest.raises(spherecal.InputError, match=message) as error:
        spherecal.Rig.from_opencv({"left": camera}, SIZE)
    assert "left" in str(error.value)


@pytest.mark.parametrize("size", [None, (1280,), (0, 960), (1280.5, 960), {"right": SIZE}])
def test_an_image_size_is_two_whole_numbers(size: object) -> None:
    with pytest.raises(spherecal.InputError, match='image size of camera "left"'):
        spherecal.Rig.from_opencv({"left": (K, None, np.zeros(3), np.zeros(3))}, size)  # type: ignore[arg-type]


def stereo() -> spherecal.Rig:
    """As from cv2.stereoCalibrate."""
    left, right = (K, COEFFICIENTS[:5], np.eye(3), np.zeros(3)), (K, COEFFICIENTS[:5], [0, -0.3, 0], [-450.0, 0, 60.0])
    return spherecal.Rig.from_opencv({"left": left, "right": right}, SIZE)


def test_nothing_is_known_of_its_accuracy_and_that_is_said() -> None:
    rig = stereo()
    assert rig.reference_camera == "left"
    assert rig.quality.valid and rig.quality.verdict == "use-with-care"
    assert [f.code for f in rig.quality.findings] == ["rig-incomplete"] and rig.quality.findings[0].severity == "info"
    world = points(100)
    measured = spherecal.triangulate_points(rig, spherecal.project_points(rig, world))
    assert np.abs(measured.points_mm - world).max() < 1e-6


def test_a_rig_goes_through_its_file(tmp_path) -> None:
    rig = stereo()
    spherecal.save_rig(rig, tmp_path / "mine.json")
    assert spherecal.load_rig(tmp_path / "mine.json") == rig
    spherecal.save_rig(rig, tmp_path)
    assert spherecal.load_rig(tmp_path) == rig
    for name in ("opencv", "mrcal", "csv"):
        spherecal.export_rig(rig, name, tmp_path / name)


def test_cameras_by_name() -> None:
    rig = stereo()
    assert rig["right"].id == "right" and [camera.id for camera in rig] == ["left", "right"]
    assert "left" in rig and "middle" not in rig
    with pytest.raises(KeyError, match='no camera "middle"; the rig has left, right'):
        rig["middle"]


def test_equal_by_value() -> None:
    assert stereo() == stereo() and stereo()["left"] == stereo()["left"]
    other = spherecal.Rig.from_opencv({"left": (K, None, np.eye(3), np.zeros(3))}, SIZE)
    assert stereo() != other and stereo()["left"] != other["left"]
    assert stereo() != "a rig"
    with pytest.raises(TypeError, match="unhashable"):
        hash(stereo())


def test_prints_are_short() -> None:
    said = repr(stereo())
    assert said == "<Rig: 2 cameras (left, right), USE WITH CARE; scale: given; reference left>"
    assert len(repr(stereo()["left"])) < 300
    page = stereo()._repr_html_()
    assert "<table>" in page and page.count("<tr>") == 3 and "USE WITH CARE" in page
    many = {f"c{i:03}": (K, None, np.zeros(3), [float(i), 0, 0]) for i in range(100)}
    assert len(repr(spherecal.Rig.from_opencv(many, SIZE))) < 120


def test_a_data_frame_where_there_is_pandas() -> None:
    pandas = pytest.importorskip("pandas")
    table = stereo().to_dataframe()
    assert isinstance(table, pandas.DataFrame) and list(table.index) == ["left", "right"]
    assert table.loc["right", "tvec_x_mm"] == -450.0 and table.loc["left", "k1"] == -0.21
    assert table.loc["left", "width_px"] == 1280


def test_without_pandas_it_is_said_what_is_missing(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)  # as Python itself marks a package that cannot be imported
    with pytest.raises(spherecal.MissingPackage, match=r"needs pandas\. Install it"):
        stereo().to_dataframe()
    with pytest.raises(ImportError):
        stereo().to_dataframe()
    assert stereo()._table()["tvec_x_mm"] == [0.0, -450.0]


def test_a_covariance_of_another_rig_is_not_written_over(tmp_path) -> None:
    few = spherecal.SimulationOptions(targets=80)
    mine, other = (spherecal.calibrate_session(spherecal.simulate_session("demo", k, few)[0]).rig for k in (1, 2))
    spherecal.save_rig(mine, tmp_path / "rig.json")
    kept = spherecal.load_rig(tmp_path)  # the map of uncertainties is rounded in the file
    assert (kept.cameras, kept.covariance, kept.quality) == (mine.cameras, mine.covariance, mine.quality)
    with pytest.raises(spherecal.OutputError, match="belongs to another rig"):
        spherecal.save_rig(other, tmp_path / "other.json")
    assert spherecal.load_rig(tmp_path) == kept
    spherecal.save_rig(stereo(), tmp_path / "bare.json")
    # a file without a covariance does not own it
    with pytest.raises(spherecal.OutputError, match="belongs to another rig"):
        spherecal.save_rig(other, tmp_path / "bare.json")
    assert spherecal.load_rig(tmp_path) == kept
    spherecal.save_rig(other, tmp_path / "rig.json")
    assert spherecal.load_rig(tmp_path).covariance == other.covariance
