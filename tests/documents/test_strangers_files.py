"""Files as other programs and other people write them: read right, or refused in one plain line."""

import json
import pickle
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import spherecal
from spherecal.base.errors import InputError
from spherecal.data.rig import Rig
from spherecal_app.cli.main import main
from spherecal_documents.export.import_rig import READABLE, import_rig
from spherecal_documents.export.write_export import export_rig
from tests.export_rigs import make_rig

# --- the shared table, row by row ------------------------------------------------------------------------------------

# file, format, unit -> ids, the cameras' distance in mm, what else is said
READ = {
    "anipose-mm/anipose_mm.toml": ("anipose", None, ["A", "B"], 333_300, "import it with --unit mm"),
    "anipose-mm/anipose_mm.toml#mm": ("anipose", "mm", ["A", "B"], 333.3, None),
    "anipose-mm/freemocap.toml": ("anipose", None, ["cam_0", "cam_1"], 1337.0, None),
    "metashape-wrong/ms_ok.xml": ("metashape", None, ["C01", "C02"], 1513.3, None),
    "metashape-wrong/ms_scaled.xml": ("metashape", None, ["C01", "C02"], 378.3, None),
    "metashape-wrong/ms_nob1.xml": ("metashape", None, ["C01", "C02"], 1513.3, None),
    "metashape-wrong/ms_unaligned.xml": ("metashape", None, ["C01", "C02"], 1513.3, "C03 is not aligned"),
    "crash-mrcal-splined/mr_pinhole": ("mrcal", None, ["cam0", "cam1"], 501.0, None),
    "colmap-poses/colmap_frames": ("colmap", "m", ["cam1", "cam2"], 500.0, None),
    "mccalib-groups/mccalib_groups.yml": ("mc-calib", "m", ["camera_0", "camera_1"], 500.0, "camera_3 is of group 1"),
    "lens-misread/ani0.toml": ("anipose", "mm", ["A", "B"], 333.3, None),
    "caliscope-uncalibrated/caliscope.toml": ("caliscope", None, ["1", "2"], 1691.0, "0 is ignored there"),
    "opencv-files/C01.xml": ("opencv", None, ["C01"], None, None),
    "zero-cameras/cam0.cameramodel": ("mrcal", None, ["cam0"], None, None),
}
REFUSED = {
    "metashape-wrong/ms_k4.xml": ("metashape", "its lens has k4"),
    "metashape-wrong/ms_fisheye.xml": ("metashape", "its lens is of the type fisheye"),
    "crash-14-coefficients/ani14.toml": ("anipose", "tilted sensor"),
    "crash-14-coefficients/mc14.yml": ("mc-calib", "tilted sensor"),
    "crash-mrcal-splined/mr_splined": ("mrcal", "SPLINED_STEREOGRAPHIC"),
    "colmap-poses/colmap_bin": ("colmap", "ends too early"),  # binary, and empty
    "kalibr-chain/k_gap.yaml": ("kalibr", "cam1 is missing"),
    "lens-misread/ani_skew.toml": ("anipose", "skewed by 3.5 px"),
    "opencv-files/stereo": ("opencv", "does not give the image size"),
    "opencv-files/ros533/C01.yaml": ("opencv", "C01 has no pose"),
    "zero-cameras/e2.toml": ("anipose", "no camera that can be used"),
    "zero-cameras/e.json": ("multical", "no camera that can be used"),
    "zero-cameras/e.yml": ("mc-calib", "no camera that can be used"),
}


@pytest.fixture(scope="module")
def foreign(shared_data: Path) -> Path:
    """The shared table's files; skipped where they are absent."""
    if not (shared_data / "foreign").is_dir():
        pytest.skip(f"no folder foreign in {shared_data}")
    return shared_data / "foreign"


@pytest.mark.parametrize("row", READ)
def test_a_row_of_the_table_is_read(row: str, foreign: Path, tmp_path: Path, capsys) -> None:
    form, unit, ids, apart_mm, said = READ[row]
    words = ["import", str(foreign / row.partition("#")[0]), "--format", form]
    words += ["--unit", unit] if unit else []
    assert main([*words, "-o", str(tmp_path / "rig.json")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    rig = spherecal.load_rig(tmp_path / "rig.json")
    assert [camera.id for camera in rig] == ids
    assert "Lengths in the file are" in printed and "Lens:" in printed
    assert said is None or said in printed
    assert ("Warning" in printed) == (said is not None and "unit" in said)
    if apart_mm is not None:
        assert np.linalg.norm(rig.cameras[0].centre_mm - rig.cameras[1].centre_mm) == pytest.approx(apart_mm, rel=1e-3)
        assert "mm apart" in printed


@pytest.mark.parametrize("row", REFUSED)
def test_a_row_of_the_table_is_refused(row: str, foreign: Path, tmp_path: Path, capsys) -> None:
    form, said = REFUSED[row]
    words = ["import", str(foreign / row), "--format", form, "-o", str(tmp_path / "rig.json")]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert said in error and "Traceback" not in error and error.count("\n") == 1
    assert not (tmp_path / "rig.json").exists()


def test_the_model_of_a_camera_info_is_honoured(foreign: Path, tmp_path: Path) -> None:
    folder = foreign / "lens-misread"
    words = ["import-priors", str(folder / "rosfish"), "--session", str(folder / "session"), "-o", str(tmp_path / "s")]
    assert main(words) == 0
    camera = json.loads((tmp_path / "s" / "session.json").read_text())["cameras"][0]
    assert camera["lens_model"] == "fisheye"
    assert camera["prior"]["distortion"] == [-0.034, 0.0268, 0.0008, -0.0027]


# --- more kinds ------------------------------------------------------------------------------------------------------

RIG = make_rig(4, 4)
FISHEYE = "fisheye = true"


def exported(tmp_path: Path, form: str, rig: Rig = RIG) -> Path:
    """The rig as this program writes it in a format: what the edits below start from."""
    path = tmp_path / f"x.{form}"
    export_rig(rig, form, path)
    return path


def edited(form: str, *edits: tuple[str, str], file: str = "", count: int = 1) -> Callable[[Path], Path]:
    """A file of the format in which texts are replaced."""

    def make(tmp_path: Path) -> Path:
        path = exported(tmp_path, form)
        target = path / file if file else path
        text = target.read_text()
        for old, new in edits:
            assert old in text, old
            text = text.replace(old, new, count)
        target.write_text(text)
        return path

    return make


def one(name: str, text: str) -> Callable[[Path], Path]:
    """A file of this text."""

    def make(tmp_path: Path) -> Path:
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return make


TOML = """[cam_0]
name = "A"
size = [ 1280.0, 720.0,]
matrix = [ [ 822.4, 0.0, 639.5,], [ 0.0, 822.4, 359.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ {distortions} ]
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]
{more}
[cam_1]
name = "B"
size = [ 1280.0, 720.0,]
matrix = [ [ 822.4, 0.0, 639.5,], [ 0.0, 822.4, 359.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ 0.0, 0.0, 0.0, 0.0 ]
rotation = [ 0.0, 0.1, 0.0,]
translation = [ {shift} ]
"""
CALISCOPE = """CreationDate = 2023-03-31T09:56:43.193358
[cam_0]
port = 0
size = [ 1280, 720,]
rotation_count = 0
matrix = [ [ 822.4, 0.0, 639.5,], [ 0.0, 822.4, 359.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.1, 0.02, 0.0, 0.0, 0.0,]
ignore = false
translation = [ 0.0, 0.0, 0.0,]
rotation = [ [ 1.0, 0.0, 0.0,], [ 0.0, 1.0, 0.0,], [ 0.0, 0.0, 1.0,],]
[cam_1]
port = 1
size = [ 1280, 720,]
matrix = [ [ 822.4, 0.0, 639.5,], [ 0.0, 822.4, 359.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.1, 0.02, 0.0, 0.0, 0.0,]
translation = [ 0.5, 0.0, 0.0,]
rotation = [ [ 1.0, 0.0, 0.0,], [ 0.0, 1.0, 0.0,], [ 0.0, 0.0, 1.0,],]
[cam_2]
port = 2
size = [ 1280, 720,]
rotation_count = 0
[charuco]
columns = 4
rows = 5
"""
CHAIN = """cam0:
  camera_model: {model}
  intrinsics: [458.0, 457.0, 367.0, 248.0]
  distortion_model: radtan
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  T_cam_imu: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
cam1:
  camera_model: pinhole
  intrinsics: [458.0, 457.0, 367.0, 248.0]
  distortion_model: {distortion}
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
{linked}
"""
IMU = "  T_cam_imu: [[1.0, 0.0, 0.0, -0.11], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]"
BEFORE = IMU.replace("T_cam_imu", "T_cn_cnm1")
OTHER = BEFORE.replace("0.11", "0.2")
MULTICAL = {
    "cameras": {
        name: {
            "model": "standard",
            "image_size": [1280, 720],
            "K": [[822.4, 0, 639.5], [0, 822.4, 359.5], [0, 0, 1]],
            "dist": [[-0.1, 0.02, 0.0, 0.0, 0.0]],
        }
        for name in ("a", "b")
    },
    "camera_poses": {
        "a": {"R": np.eye(3).tolist(), "T": [0, 0, 0]},
        "b_to_a": {"R": np.eye(3).tolist(), "T": [0.3, 0, 0]},
    },
    "image_sets": {"rgb": []},
}


def multical(**changes: object) -> Callable[[Path], Path]:
    """A file of multical's with fields of camera b, or of the document, replaced."""
    document = json.loads(json.dumps(MULTICAL))
    for name, value in changes.items():
        (document["cameras"]["b"] if name in document["cameras"]["b"] else document)[name] = value
    return one("calibration.json", json.dumps(document))


PAIR = """%YAML:1.0
---
imageSize: [ 640, 480 ]
cameraMatrix1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 533., 0., 342., 0., 533., 235., 0., 0., 1. ]
distCoeffs1: !!opencv-matrix
   rows: 1
   cols: 14
   dt: d
   data: [ -0.28, 0.07, 0., 0., 0., 0., 0., 0.1, 0., 0., 0., 0., 0., 0. ]
cameraMatrix2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 535., 0., 335., 0., 535., 240., 0., 0., 1. ]
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ -83., 0., 0. ]
"""
INFO = """image_width: 640
image_height: 480
camera_name: C01
camera_matrix: {{rows: 3, cols: 3, data: [533.0, 0.0, 342.0, 0.0, 533.0, 235.0, 0.0, 0.0, 1.0]}}
distortion_model: {model}
distortion_coefficients: {{rows: 1, cols: {n}, data: {data}}}
R: [0.0, 0.0, 0.0]
T: [0.0, 0.0, 0.0]
"""
CAHVOR = "{{ 'lensmodel': '{model}', 'intrinsics': [{values}], {pose} 'imagersize': [1280, 1024] }}"
POSE = "'rt_cam_ref': [0, 0, 0, 0.1, 0, 0],"


def metashape(sensor: str = "", cameras: str = "", chunk: str = "") -> Callable[[Path], Path]:
    """A Metashape document of two cameras: with other terms of the lens, cameras in a group, another placement."""
    lens = sensor or "<f>1660</f>"
    place = chunk or "<transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>0 0 0</translation></transform>"
    made = "".join(
        f'<camera id="{i}" sensor_id="0" label="C{i}"><transform>1 0 0 {x} 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera>'
        for i, x in ((0, 0), (1, 1.5))
    )
    return one(
        "cameras.xml",
        '<document version="1.5.0"><chunk><sensors><sensor id="0" type="frame"><resolution width="1280" height="1024"/>'
        f'<calibration type="frame" class="adjusted">{lens}</calibration></sensor></sensors>'
        f"<cameras>{cameras.format(made) if cameras else made}</cameras>{place}</chunk></document>",
    )


def with_paths(path: Path) -> Path:
    """The same with the images' paths as labels, as Metashape's own files may have them."""
    path.write_text(path.read_text().replace('label="C', f'label="/home/user/{"image_sets/" * 8}C'))
    return path


def colmap(cameras: str, images: str, **tables: str) -> Callable[[Path], Path]:
    """A COLMAP text model."""

    def make(tmp_path: Path) -> Path:
        for name, text in {"cameras": cameras, "images": images, **tables}.items():
            (tmp_path / f"{name}.txt").write_text(text)
        return tmp_path

    return make


TWO = "1 OPENCV 1280 1024 1660 1661 640 512 -0.1 0.02 0 0\n2 OPENCV 1280 1024 1660 1661 640 512 -0.1 0.02 0 0\n"


def seen(*rows: tuple[float, int, str]) -> str:
    """images.txt of images without rotation: shift along x, camera, name."""
    return "".join(f"{i} 1 0 0 0 {x} 0 0 {camera} {name}\n\n" for i, (x, camera, name) in enumerate(rows, 1))


# file, format -> the cameras' largest distance in mm, or a part of the refusal
MORE: dict[str, tuple[Callable[[Path], Path], str, float | str | None]] = {
    "sizes with a point, four coefficients (Pose2Sim)": (
        one("Calib.toml", TOML.format(distortions="-0.05, 0.1, 0, 0", more="fisheye = false", shift="0.5, 0, 0")),
        "anipose", 500.0,
    ),
    "fisheye with five coefficients": (
        one("a.toml", TOML.format(distortions="0.1, 0.0, 0.0, 0.0, 0.0", more=FISHEYE, shift="0.5, 0, 0")),
        "anipose", "a fisheye lens has 4",
    ),
    "one coefficient": (
        one("a.toml", TOML.format(distortions="0.1", more="", shift="0.5, 0, 0")), "anipose", "has 1 distortion",
    ),
    "six coefficients": (
        one("a.toml", TOML.format(distortions="0.1, 0, 0, 0, 0, 0", more="", shift="0.5, 0, 0")),
        "anipose", "has 6 distortion coefficients",
    ),
    "fourteen of which the last two are 0": (
        one("a.toml", TOML.format(distortions="-0.1" + ", 0.0" * 13, more="", shift="0.5, 0, 0")), "anipose", 500.0,
    ),
    "a shift that is not finite": (
        one("a.toml", TOML.format(distortions="0, 0, 0, 0", more="", shift="nan, 0.0, 0.0")), "anipose", "but is nan",
    ),
    "a camera without pose": (
        edited("anipose", ("translation = ", "translation_was = ")), "anipose", 2000.0,
    ),
    "a focal length of 0": (
        one("a.toml", TOML.format(distortions="", more="", shift="0.5, 0, 0").replace("822.4", "0.0")),
        "anipose", "not both above 0",
    ),
    "caliscope's config.toml, rotations as matrices": (one("config.toml", CALISCOPE), "caliscope", 500.0),
    "all cameras ignored": (
        one("c.toml", "[cameras.0]\nignore = true\nsize = [640, 480]\n"), "caliscope", "0 is ignored there",
    ),
    "another program's TOML": (one("c.toml", 'title = "x"\n'), "caliscope", "no camera that can be used"),
    "a camchain of the IMU": (
        one("c.yaml", CHAIN.format(model="pinhole", distortion="radtan", linked=IMU)), "kalibr", 110.0,
    ),
    "a camchain that contradicts its IMU": (
        one("c.yaml", CHAIN.format(model="pinhole", distortion="radtan", linked=f"{IMU}\n{OTHER}")),
        "kalibr", "contradicts T_cam_imu",
    ),
    "a camera that is not linked": (
        one("c.yaml", CHAIN.format(model="pinhole", distortion="radtan", linked="")), "kalibr", None,
    ),
    "an omnidirectional camera": (
        one("c.yaml", CHAIN.format(model="omni", distortion="radtan", linked=BEFORE)), "kalibr", "camera_model",
    ),
    "fov distortion": (
        one("c.yaml", CHAIN.format(model="pinhole", distortion="fov", linked=BEFORE)), "kalibr", "distortion_model",
    ),
    "multical as it is": (multical(), "multical", 0.3),
    "multical, coefficients without brackets": (multical(dist=[-0.1, 0.02, 0, 0, 0]), "multical", 0.3),
    "multical, tilted": (multical(dist=[[0.1] * 14], model="tilted"), "multical", "tilted sensor"),
    "multical, skewed": (multical(K=[[800, 2, 640], [0, 800, 360], [0, 0, 1]]), "multical", "skewed by 2 px"),
    "multical, one camera without pose": (
        multical(camera_poses={"a": MULTICAL["camera_poses"]["a"]}), "multical", None,
    ),
    "multical, chained": (
        multical(camera_poses={"b_to_a": MULTICAL["camera_poses"]["b_to_a"], "c_to_b": MULTICAL["camera_poses"]["a"]}),
        "multical", "from several cameras",
    ),
    "multical, lenses only": (
        one("c.json", json.dumps({"cameras": MULTICAL["cameras"]})), "multical", "lenses only",
    ),
    "a stereo pair in one file with its size": (one("s.yml", PAIR), "opencv", 83.0),
    "a stereo pair without R and T": (
        one("s.yml", PAIR.partition("R: !!")[0]), "opencv", None,
    ),
    "camera_info of a model that is unknown": (
        one("C01.yaml", INFO.format(model="double_sphere", n=5, data=[0] * 5)), "opencv", 'is "double_sphere"',
    ),
    "camera_info, equidistant with five": (
        one("C01.yaml", INFO.format(model="equidistant", n=5, data=[0] * 5)), "opencv", "a fisheye lens has 4",
    ),
    "camera_info, no commas": (
        one("C01.yaml", INFO.format(model="plumb_bob", n=5, data="[-0.034062 0.026819 0.000826 -0.002720 0.000000]")),
        "opencv", None,
    ),
    "camera_info, not calibrated": (
        one("C01.yaml", INFO.format(model="plumb_bob", n=5, data=[0] * 5).replace("533.0", "0.0")),
        "opencv", "not both above 0",
    ),
    "FileStorage as JSON": (
        one("C01.json", json.dumps({"camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d",
            "data": [533.0, 0, 342, 0, 533, 235, 0, 0, 1]}, "image_width": 640, "image_height": 480,
            "R": [0.0, 0, 0], "T": [0.0, 0, 0]})), "opencv", None,
    ),
    "XML that is not OpenCV's": (one("C01.xml", "<a><b>x</b></a>"), "opencv", "no camera_matrix"),
    "mrcal's fisheye": (
        one("c.cameramodel", CAHVOR.format(model="LENSMODEL_CAHVORE_linearity=0.34", values="1," * 12, pose=POSE)),
        "mrcal", "CAHVORE",
    ),
    "mrcal, too few intrinsics": (
        one("c.cameramodel", CAHVOR.format(model="LENSMODEL_OPENCV8", values="1660, 1660, 640, 512, 0, 0", pose=POSE)),
        "mrcal", "intrinsics",
    ),
    "mrcal, a lens alone": (
        one("c.cameramodel", CAHVOR.format(model="LENSMODEL_PINHOLE", values="1660, 1660, 640, 512", pose="")),
        "mrcal", "has no pose",
    ),
    "mrcal, a lens model by its old name": (
        one("c.cameramodel", CAHVOR.replace("lensmodel", "lens_model").format(
            model="LENSMODEL_PINHOLE", values="1660, 1660, 640, 512", pose=POSE)), "mrcal", None,
    ),
    "mrcal, an empty folder": (lambda tmp_path: tmp_path, "mrcal", "no camera that can be used"),
    "Metashape, labels that are paths": (
        lambda tmp_path: with_paths(metashape()(tmp_path)), "metashape", 1500.0,
    ),
    "Metashape, cameras in groups": (metashape(cameras='<group id="0" label="g">{}</group>'), "metashape", 1500.0),
    "Metashape, a transform as one matrix": (
        metashape(chunk="<transform>0 -2 0 1 2 0 0 1 0 0 2 1 0 0 0 1</transform>"), "metashape", 3000.0,
    ),
    "Metashape, b2": (metashape("<f>1660</f><b2>0.7</b2>"), "metashape", "its lens has b2"),
    "Metashape, k4 that is 0": (metashape("<f>1660</f><k4>0</k4>"), "metashape", 1500.0),
    "Metashape, no focal length": (metashape("<cx>3</cx>"), "metashape", "not both above 0"),
    "Metashape, two chunks": (
        one("a.xml", "<a><chunk><cameras/></chunk><chunk><cameras/></chunk></a>"), "metashape", "2 chunks",
    ),
    "COLMAP, a moving pair that is not rigid": (
        colmap(TWO, seen((0, 1, "a/1.png"), (-0.3, 2, "b/1.png"), (0, 1, "a/2.png"), (-0.9, 2, "b/2.png"))),
        "colmap", "not fixed to each other",
    ),
    "COLMAP, one camera that moved": (
        colmap(TWO[: TWO.index("\n") + 1], seen((0, 1, "IMG_A.jpg"), (1, 1, "IMG_B.jpg"))), "colmap", "several images",
    ),
    "COLMAP, names that end in numbers": (
        colmap(TWO, seen((0, 1, "left_07.png"), (-0.4, 2, "right_07.png"), (-1, 1, "left_08.png"))), "colmap", 0.4,
    ),
    "COLMAP, a camera without images": (colmap(TWO, seen((0, 1, "a/1.png"))), "colmap", None),
    "COLMAP, a rig": (
        colmap(TWO, seen((0, 1, "a/1.png"), (-9, 2, "b/1.png")), rigs="1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 -0.7 0 0\n"),
        "colmap", 0.7,
    ),
    "COLMAP, division lenses": (
        colmap("1 SIMPLE_DIVISION 640 480 500 320 240 0.1\n", ""), "colmap", 'model "SIMPLE_DIVISION" cannot be used',
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", MORE)
def test_more_kinds(kind: str, tmp_path: Path) -> None:
    make, form, expected = MORE[kind]
    path = make(tmp_path)
    if isinstance(expected, str):
        with pytest.raises(InputError) as refused:
            import_rig(path, form)
        assert expected in str(refused.value)
        assert "\n" not in str(refused.value)
        return
    done = import_rig(path, form)
    assert (done.farthest_mm is None) == (expected is None)
    if kind == "a camera without pose":
        assert len(done.rig.cameras) == 3 and done.left_out == {"C1": "has no pose"}
    elif expected is not None:
        assert done.farthest_mm == pytest.approx(expected, rel=1e-6)


ENCODED = {
    "kalibr": "", "anipose": "", "caliscope": "", "mc-calib": "", "multical": "", "metashape": "", "csv": "",
    "opencv": "C1.yml", "ros": "C1.yaml", "colmap": "cameras.txt", "mrcal": "C1.cameramodel",
}  # fmt: skip


@pytest.mark.parametrize("form", ENCODED)
def test_text_as_other_editors_save_it(form: str, tmp_path: Path) -> None:
    """Line ends of Windows and a byte order mark change nothing; UTF-16 (read as XML alone) is refused in one line."""
    export_rig(RIG, form, tmp_path / "x", max_loss_px=1e3)
    path = tmp_path / "x" / ENCODED[form] if ENCODED[form] else tmp_path / "x"
    text, expected = path.read_text(encoding="utf-8"), import_rig(tmp_path / "x", form).rig
    for data in (text.replace("\n", "\r\n").encode(), text.encode("utf-8-sig")):
        path.write_bytes(data)
        assert import_rig(tmp_path / "x", form).rig == expected
    for encoding in ("utf-16", "utf-16-le", "utf-16-be"):
        path.write_bytes(text.encode(encoding))
        if form == "metashape":
            assert import_rig(path, form).rig == expected
            continue
        with pytest.raises(InputError) as refused:
            import_rig(tmp_path / "x", form)
        assert str(refused.value).endswith("line 1 is not UTF-8 text. Save the file with the encoding UTF-8.")


OTHERS = ("cal.npz", "cal.pkl", "detections.jsonl", "calib.io.json", "camera_info.yaml", "empty.txt")


def others(folder: Path, name: str) -> Path:
    """A file of a kind that is not read: numpy's, a pickle, JSON Lines, calib.io's JSON, a lens alone."""
    path = folder / name
    model = {
        "polymorphic_name": "libCalib::CameraModelOpenCV",
        "ptr_wrapper": {"data": {"parameters": {"f": {"val": 9}}}},
    }
    if name == "cal.npz":
        np.savez(path, mtx=np.eye(3), dist=np.zeros(5), rvecs=np.zeros((2, 3)), tvecs=np.zeros((2, 3)))
        return path
    row = {"camera": "cam1", "frame": 0, "ids": [1], "uv": [[3.0, 4.0]]}
    info = INFO.format(model="plumb_bob", n=5, data=[-0.28, 0.07, 0, 0, 0]).partition("\nR: ")[0]
    texts = {
        "detections.jsonl": f"{json.dumps(row)}\n{json.dumps(row)}\n", "camera_info.yaml": info, "empty.txt": "",
        "calib.io.json": json.dumps({"Calibration": {"cameras": [{"model": model, "transform": {"rotation": {}}}]}}),
    }  # fmt: skip
    path.write_bytes(pickle.dumps({"mtx": np.eye(3)}) if name == "cal.pkl" else texts[name].encode())
    return path


@pytest.mark.parametrize("form", READABLE)
@pytest.mark.parametrize("name", OTHERS)
def test_what_no_format_reads_is_refused_in_one_line(name: str, form: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        import_rig(others(tmp_path, name), form)
    said = str(refused.value)
    assert ("cameras.txt" if form == "colmap" else name) in said and "\n" not in said and "Error" not in said


def test_a_metashape_file_with_decimal_commas(tmp_path: Path) -> None:
    path = exported(tmp_path, "metashape")
    path.write_text(path.read_text().replace(".", ","))
    with pytest.raises(InputError, match=r"not a number: '\d+,\d+'"):
        import_rig(path, "metashape")


def test_one_file_of_a_colmap_model_is_the_model(tmp_path: Path) -> None:
    path = exported(tmp_path, "colmap")
    assert import_rig(path / "cameras.txt", "colmap").rig == import_rig(path, "colmap").rig


def test_colmaps_own_binary_model(tmp_path: Path) -> None:
    """Written by COLMAP itself: the same cameras and poses, by its rig, as from its text."""
    pycolmap = pytest.importorskip("pycolmap")
    rig = make_rig(8, 5)
    export_rig(rig, "colmap", tmp_path / "text")
    model = pycolmap.Reconstruction(str(tmp_path / "text"))
    (tmp_path / "binary").mkdir()
    model.write_binary(str(tmp_path / "binary"))
    assert (tmp_path / "binary" / "rigs.bin").is_file()
    read = import_rig(tmp_path / "binary", "colmap").rig
    for ours, theirs in zip(read, rig, strict=True):
        np.testing.assert_allclose(ours.centre_mm, theirs.centre_mm, atol=1e-6)
        np.testing.assert_allclose(ours.rotation, theirs.rotation, atol=1e-9)
        np.testing.assert_allclose(ours.intrinsics, theirs.intrinsics, atol=1e-9)
    (tmp_path / "binary" / "rigs.bin").unlink()
    (tmp_path / "binary" / "frames.bin").unlink()
    by_images = import_rig(tmp_path / "binary", "colmap").rig
    np.testing.assert_allclose([c.centre_mm for c in by_images], [c.centre_mm for c in read], atol=1e-6)


@pytest.mark.parametrize("length", [0, 7, 8, 30, 100])
def test_a_binary_model_that_is_cut_off(tmp_path: Path, length: int) -> None:
    row = struct.pack("<QIiQQ8d", 1, 1, 4, 640, 480, 500, 500, 320, 240, 0, 0, 0, 0)
    (tmp_path / "cameras.bin").write_bytes(row[:length])
    (tmp_path / "images.bin").write_bytes(b"")
    with pytest.raises(InputError, match="ends too early"):
        import_rig(tmp_path, "colmap")


def test_what_was_taken_is_said(tmp_path: Path, capsys) -> None:
    path = exported(tmp_path, "anipose")
    assert main(["import", str(path), "--format", "anipose", "--json", "-o", str(tmp_path / "rig.json")]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["unit"], said["unit_from"], said["warnings"]) == ("m", "the format", [])
    assert said["lenses"] == {"Brown (k1 k2 p1 p2 k3)": ["C1", "C2", "C3", "C4"]}
    assert 0 < said["nearest_mm"] <= said["farthest_mm"] < 5000
