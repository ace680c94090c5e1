"""Lenses taken from files of OpenCV, COLMAP and Kalibr into a copy of a session."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spherecal.base.errors import InputError
from spherecal_app.cli.main import main
from spherecal_documents.export.colmap import read_colmap
from spherecal_documents.export.import_rig import matched, read_cameras
from spherecal_documents.export.opencv_yaml import read_yaml
from spherecal_documents.export.write_export import export_rig
from spherecal_files.read_session import read_session
from tests.example_session import VALID, changed, make_session
from tests.export_rigs import make_rig, renamed

RIG = renamed(make_rig(4, 2), ["C01", "C02"])


def session_in(folder: Path, document: object = None) -> Path:
    folder.mkdir()
    return make_session(folder, document)


def import_priors(session: Path, file: Path, output: Path, *more: str) -> int:
    return main(["import-priors", str(file), "--session", str(session), "-o", str(output), *more])


@pytest.mark.parametrize("name", ["opencv", "kalibr", "colmap"])
def test_what_we_export_comes_back_as_priors(tmp_path: Path, name: str) -> None:
    session = session_in(tmp_path / "s")
    path = tmp_path / ("x.yaml" if name == "kalibr" else "x")
    export_rig(RIG, name, path)
    assert import_priors(session, path, tmp_path / "new") == 0
    for spec, camera in zip(read_session(tmp_path / "new").cameras, RIG.cameras, strict=True):
        assert spec.prior_given
        np.testing.assert_allclose(spec.prior, camera.intrinsics, rtol=0, atol=1e-12 if name != "colmap" else 1e-9)


def test_the_copy_keeps_all_else(tmp_path: Path) -> None:
    session = session_in(tmp_path / "s")
    export_rig(RIG, "opencv", tmp_path / "x")
    before, document = read_session(session), json.loads((session / "session.json").read_text())
    original = document["cameras"][0]["prior"]
    assert import_priors(session, tmp_path / "x", tmp_path / "new") == 0
    after = json.loads((tmp_path / "new" / "session.json").read_text())
    for camera in (*document["cameras"], *after["cameras"]):
        camera.pop("prior", None)
    assert after == document
    copy = read_session(tmp_path / "new")
    assert [p.id for p in copy.placements] == [p.id for p in before.placements]
    originals = {p.relative_to(session.absolute()) for p in session.absolute().rglob("*") if p.is_file()}
    named = {p for p in originals if p.name != "session.json" and (tmp_path / "new" / p).is_file()}
    assert all((tmp_path / "new" / p).read_bytes() == (session / p).read_bytes() for p in named)
    assert {p.name for p in named} >= {"observations.csv", "targets.json"}
    assert json.loads((session / "session.json").read_text())["cameras"][0]["prior"] == original


def test_cameras_that_the_file_lacks_stay_as_they_were(tmp_path: Path, capsys) -> None:
    session = session_in(tmp_path / "s")
    export_rig(renamed(RIG, ["C01", "other"]), "colmap", tmp_path / "x")
    assert import_priors(session, tmp_path / "x", tmp_path / "new") == 0
    assert "left as they were: C02" in capsys.readouterr().out
    assert not read_session(tmp_path / "new").cameras[1].prior_given


def test_names_that_do_not_match_need_the_order(tmp_path: Path, capsys) -> None:
    session = session_in(tmp_path / "s")
    export_rig(renamed(RIG, ["left", "right"]), "kalibr", tmp_path / "x.yaml")
    assert import_priors(session, tmp_path / "x.yaml", tmp_path / "new") == 2
    assert "--by-order" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
    assert import_priors(session, tmp_path / "x.yaml", tmp_path / "new", "--by-order") == 0
    found = read_session(tmp_path / "new").cameras
    np.testing.assert_array_equal(found[0].prior, RIG.cameras[0].intrinsics)


def test_lenses_of_another_image_size_are_refused(tmp_path: Path, capsys) -> None:
    document = changed("cameras", 0, "image_size", to=[1032, 772])
    document["cameras"][0]["intrinsics_group"] = "C01"
    session = session_in(tmp_path / "s", document)
    export_rig(RIG, "opencv", tmp_path / "x")
    assert import_priors(session, tmp_path / "x", tmp_path / "new") == 2
    assert 'camera "C01" have 2064 x 1544 pixels, but the session\'s have 1032 x 772' in capsys.readouterr().err


COLMAP = """# Camera list
1 SIMPLE_RADIAL 2064 1544 2300.5 1032 772 -0.05
2 PINHOLE 2064 1544 2300 2310 1030 770
3 RADIAL 2064 1544 2300 1032 772 -0.1 0.02
4 SIMPLE_PINHOLE 2064 1544 2300 1032 772
"""


def test_colmap_s_smaller_models_and_half_pixel(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text(COLMAP)
    (tmp_path / "images.txt").write_text(
        "# Image list\n7 1 0 0 0 0.1 0.2 0.3 1 left/0001.png\n10 20 -1 30 40 -1\n"
        "8 0 1 0 0 0.1 0.2 0.3 2 right/0001.png\n\n9 1 0 0 0 1 2 3 1 left/0002.png\n\n"
    )
    kind, cameras = read_cameras(tmp_path)
    assert kind == "COLMAP"
    assert [camera.id for camera in cameras] == ["left", "right", "camera3", "camera4"]
    np.testing.assert_array_equal(cameras[0].intrinsics[:5], [2300.5, 2300.5, 1031.5, 771.5, -0.05])
    np.testing.assert_array_equal(cameras[1].intrinsics[:4], [2300, 2310, 1029.5, 769.5])
    np.testing.assert_array_equal(cameras[2].intrinsics[4:6], [-0.1, 0.02])
    np.testing.assert_allclose(read_colmap(tmp_path)[1].placed.rotation, np.diag([1, -1, -1]), atol=1e-15)


def test_opencv_s_own_file(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    storage = cv2.FileStorage(str(tmp_path / "C01.yml"), cv2.FILE_STORAGE_WRITE)
    k = np.array([[2318.1, 0, 1031.2], [0, 2319.3, 770.4], [0, 0, 1]])
    storage.write("calibration_time", "Mon 1 Jan 2024")
    storage.write("image_width", 2064)
    storage.write("image_height", 1544)
    storage.write("camera_matrix", k)
    storage.write("distortion_coefficients", np.array([[-0.1], [0.1], [1e-4], [-1e-5], [0.0]]))
    storage.release()
    kind, (camera,) = read_cameras(tmp_path / "C01.yml")
    assert (kind, camera.id, camera.image_size, camera.pose) == ("OpenCV", "C01", (2064, 1544), None)
    np.testing.assert_array_equal(camera.intrinsics[:9], [2318.1, 2319.3, 1031.2, 770.4, -0.1, 0.1, 1e-4, -1e-5, 0])


CAM0 = """cam0:
  camera_model: {model}
  intrinsics: [461.6, 460.2, 362.7, 246.0]
  distortion_model: {lens}
  distortion_coeffs: [-0.28, 0.07, 0.0009, 0.0001]
  resolution: [752, 480]
"""
MATRIX = "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {} ]\n"

HOSTILE = {
    "fov.yaml": (CAM0.format(model="pinhole", lens="fov"), "must be"),
    "wide.yml": (
        MATRIX.format("9., 0., 5., 0., 9., 5., 0., 0., 1.") + "fisheye_model: 1\nD: [0,0,0,0,0]\n",
        "a fisheye lens has 4",
    ),
    "omni.yaml": (CAM0.format(model="omni", lens="radtan"), "must be"),
    "deep.yaml": ("cam0: " + "[" * 5000 + "]" * 5000, "nested too deeply"),
    "bomb.yaml": ("a: &a [x, x]\nb: &b [*a, *a]\ncam0: [*b, *b]\n", "anchors"),
    "code.yaml": ("cam0: !!python/object/apply:os.system ['true']\n", "not valid YAML"),
    "type.yaml": ("cam0: 7\n", "must be an object"),
    "numbers.yaml": ("cam0: {1: 2, 3: 4, null: {}}\n2024-01-01: 1\n", "lacks"),
    "none.yaml": ("hello\n", "no camera_matrix"),
    "empty.yaml": ("", "no camera_matrix"),
    "huge.yml": ("%YAML:1.0\n---\ncamera_matrix: {rows: 1000000, cols: 1000000, data: []}\n", "from 1 to 100"),
    "short.yml": (MATRIX.format("1, 2"), "must have 9 values"),
    "nan.yml": (MATRIX.format(".nan, 0, 1, 0, 1, 1, 0, 0, 1"), "must be"),
    "skew.yml": (MATRIX.format("9., 1., 5., 0., 9., 5., 0., 0., 1."), "skewed by 1 px"),
    "tilt.yml": (MATRIX.format("9., 0., 5., 0., 9., 5., 0., 0., 1.") + "D: [" + "0," * 12 + "0.1, 0]\n", "tilted"),
    "binary.yaml": ("cam0: \x00", "not UTF-8 text"),
    "pic.png": ("x", "from which lenses"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_in_plain_words(tmp_path: Path, name: str) -> None:
    text, expected = HOSTILE[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=expected) as caught:
        read_cameras(tmp_path / name)
    assert name in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 THIN_PRISM_FISHEYE 10 10 1 1 1 1 0 0 0 0 0 0 0 0\n", "THIN_PRISM_FISHEYE"),
        ("1 OPENCV_FISHEYE 10 10 1 1 1 1 0 0 0\n", "11 finite numbers"),
        ("1 PINHOLE 10 10 5 5 x 5\n", "line 1"),
        ("1 PINHOLE 10 10 5 5 nan 5\n", "line 1"),
        ("1 PINHOLE 10 10 5\n", "line 1"),
        ("1 PINHOLE 0 10 5 5 5 5\n", "above 0"),
        ("1\n", "camera model"),
    ],
)
def test_hostile_colmap_files(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "cameras.txt").write_text(text)
    with pytest.raises(InputError, match=expected):
        read_cameras(tmp_path)


def test_missing_files_and_double_names(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_cameras(tmp_path / "none")
    with pytest.raises(InputError, match=r"no \.yml"):
        read_cameras(tmp_path)
    session = read_session(session_in(tmp_path / "s"))
    export_rig(RIG, "opencv", tmp_path / "x")
    cameras = read_cameras(tmp_path / "x")[1]
    with pytest.raises(InputError, match='two cameras called "C01"'):
        matched(session, [cameras[0], cameras[0]], False)
    with pytest.raises(InputError, match="has 1 camera and the session 2"):
        matched(session, cameras[:1], True)


def read_or_refuse(read: Callable[[Path], object], path: Path) -> None:
    refusal = None
    try:
        read(path)
    except InputError as error:
        refusal = str(error)
    assert refusal is None or str(path) in refusal


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=8,
)
KEYS = ("camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "resolution", "T_cn_cnm1", "rostopic",
        "camera_matrix", "D", "rows", "cols", "data", "image_width", "R", "T")  # fmt: skip


@given(st.dictionaries(st.sampled_from(KEYS), values, max_size=6), values)
def test_any_document_is_read_or_refused(tmp_path_factory, fields, other) -> None:
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    for document in ({"cam0": fields}, {"cam0": other}, fields, {**fields, "camera_matrix": other}):
        path.write_text(json.dumps(document), encoding="utf-8")
        read_or_refuse(read_cameras, path)


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(tmp_path_factory, text) -> None:
    path = tmp_path_factory.getbasetemp() / "text.yaml"
    path.write_text(text, encoding="utf-8", errors="replace")
    read_or_refuse(read_yaml, path)


def test_the_example_session_is_what_these_tests_take_it_for():
    assert [camera["id"] for camera in VALID["cameras"]] == ["C01", "C02"]
