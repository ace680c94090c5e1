"""The traps of each format's conventions, each checked with numbers that stand in the file."""

import json
import re
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from spherecal.data.rig import RigCamera
from spherecal_documents.export.file_cameras import number, safe_names
from spherecal_documents.export.write_export import export_rig
from tests.export_rigs import make_rig, renamed

RIG = make_rig(4)
CAMERA = RIG.cameras[0]  # C1; the reference is C5


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The text of an export, by format and file name."""
    folder = tmp_path_factory.mktemp("exports")

    def text(name: str, file: str = "") -> str:
        path = folder / name
        if not path.exists():
            export_rig(RIG, name, path)
        return (path / file if file else path).read_text(encoding="utf-8")

    return text


def pose_matrix(camera: RigCamera, metres: bool) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = camera.rotation, camera.translation_mm * (1e-3 if metres else 1)
    return matrix


def test_colmap_counts_pixels_from_the_corner(written):
    row = next(line for line in written("colmap", "cameras.txt").splitlines() if line.startswith("1 "))
    values = [float(value) for value in row.split()[4:]]
    assert row.split()[1] == "OPENCV"
    np.testing.assert_array_equal(values[2:4], CAMERA.intrinsics[2:4] + 0.5)
    config = json.loads(written("colmap", "rig_config.json"))[0]["cameras"]
    assert config[0]["camera_params"] == values
    assert [entry["image_prefix"] for entry in config if entry.get("ref_sensor")] == ["C5/"]


def test_colmap_poses_are_world_to_camera_with_w_first_and_a_line_for_points(written):
    lines = written("colmap", "images.txt").splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("1 "))
    values = [float(value) for value in lines[at].split()[1:8]]
    np.testing.assert_allclose(Rotation.from_quat([*values[1:4], values[0]]).as_matrix(), CAMERA.rotation, atol=1e-14)
    np.testing.assert_array_equal(values[4:], CAMERA.translation_mm)
    assert lines[at + 1] == ""
    assert lines[at + 2].startswith("2 ")


def test_metashape_offsets_from_the_middle_swaps_tangential_and_inverts_poses(written):
    chunk = ElementTree.fromstring(written("metashape")).find("chunk")
    assert chunk is not None
    c = {
        entry.tag: float(entry.text or 0)
        for entry in chunk.iterfind("sensors/sensor[@id='0']/calibration/*")
        if entry.tag != "resolution"
    }
    fu, fv, u0, v0, _, _, p1, p2 = CAMERA.intrinsics[:8]
    assert c["cx"] == pytest.approx(u0 + 0.5 - 2064 / 2, abs=1e-12)
    assert c["cy"] == pytest.approx(v0 + 0.5 - 1544 / 2, abs=1e-12)
    assert (c["p1"], c["p2"], c["f"]) == (p2, p1, fv)
    assert c["b1"] == pytest.approx(fu - fv, abs=1e-12)
    transform = np.array(chunk.findtext("cameras/camera[@id='0']/transform", "").split(), dtype=float).reshape(4, 4)
    np.testing.assert_allclose(transform[:3, 3], CAMERA.centre_mm / 1000, atol=1e-12)
    np.testing.assert_array_equal(transform[:3, :3], CAMERA.rotation.T)


def test_kalibr_chains_from_the_camera_before_and_begins_with_the_reference(written):
    chain = yaml.safe_load(written("kalibr"))
    names = [chain[f"cam{i}"]["rostopic"].split("/")[1] for i in range(len(chain))]
    assert names == ["C5", "C1", "C2", "C3", "C4", "C6", "C7", "C8", "C9", "C10", "C11", "C12"]
    assert "T_cn_cnm1" not in chain["cam0"]
    by_name = {camera.id: camera for camera in RIG.cameras}
    for i in range(1, len(chain)):
        step = pose_matrix(by_name[names[i]], True) @ np.linalg.inv(pose_matrix(by_name[names[i - 1]], True))
        np.testing.assert_allclose(chain[f"cam{i}"]["T_cn_cnm1"], step, atol=1e-12)


def test_ros_transforms_are_camera_to_world_in_metres_with_w_last(written):
    transforms = yaml.safe_load(written("ros", "static_transforms.yaml"))["transforms"]
    first = transforms[0]
    assert (first["header"]["frame_id"], first["child_frame_id"]) == ("rig", "C1_optical_frame")
    shift = [first["transform"]["translation"][axis] for axis in "xyz"]
    np.testing.assert_allclose(shift, CAMERA.centre_mm / 1000, atol=1e-12)
    turn = Rotation.from_quat([first["transform"]["rotation"][axis] for axis in "xyzw"]).as_matrix()
    np.testing.assert_allclose(turn, CAMERA.rotation.T, atol=1e-14)
    info = yaml.safe_load(written("ros", "C1.yaml"))
    assert (info["distortion_model"], info["camera_name"]) == ("plumb_bob", "C1")
    assert info["projection_matrix"]["cols"] == 4
    compile(written("ros", "static_transforms.launch.py"), "launch", "exec")


def test_the_ros_launch_file_publishes_the_same_transforms(written, monkeypatch):
    """Run with stand-ins for the two ROS imports alone: what the file itself computes is what a robot would get."""
    import sys
    from types import ModuleType

    for name, attribute in (("launch", "LaunchDescription"), ("launch_ros.actions", "Node"), ("launch_ros", "x")):
        module = ModuleType(name)
        setattr(module, attribute, (lambda nodes: nodes) if name == "launch" else (lambda **given: given))
        monkeypatch.setitem(sys.modules, name, module)
    space: dict = {}
    exec(compile(written("ros", "static_transforms.launch.py"), "launch", "exec"), space)
    nodes = space["generate_launch_description"]()
    arguments = dict(zip(nodes[0]["arguments"][::2], nodes[0]["arguments"][1::2], strict=True))
    np.testing.assert_allclose([float(arguments[f"--{a}"]) for a in "xyz"], CAMERA.centre_mm / 1000, atol=1e-12)
    assert (arguments["--frame-id"], arguments["--child-frame-id"]) == ("rig", "C1_optical_frame")
    assert len(nodes) == len(RIG.cameras)


def test_anipose_sections_sort_in_camera_order_and_are_in_metres(written):
    document = tomllib.loads(written("anipose"))
    assert [document[name]["name"] for name in sorted(document) if name != "metadata"] == [c.id for c in RIG.cameras]
    np.testing.assert_array_equal(document["cam_00"]["translation"], CAMERA.translation_mm / 1000)
    assert len(document["cam_00"]["distortions"]) == 5


def test_caliscope_numbers_cameras_in_metres(written):
    cameras = tomllib.loads(written("caliscope"))["cameras"]
    assert [int(key) for key in cameras] == list(range(12))
    np.testing.assert_array_equal(cameras["0"]["translation"], CAMERA.translation_mm / 1000)


def test_mc_calib_poses_are_camera_to_camera_0(written):
    text = written("mc-calib")
    assert text.startswith("%YAML:1.0\n---\n")
    assert "camera_0: # C5\n" in text
    document = yaml.safe_load(text.split("\n", 1)[1].replace("!!opencv-matrix", ""))
    np.testing.assert_array_equal(np.reshape(document["camera_0"]["camera_pose_matrix"]["data"], (4, 4)), np.eye(4))
    pose = np.reshape(document["camera_1"]["camera_pose_matrix"]["data"], (4, 4))  # C1
    np.testing.assert_allclose(pose[:3, 3], CAMERA.centre_mm, atol=1e-9)


def test_multical_calls_world_to_camera_camera_to_reference(written):
    poses = json.loads(written("multical"))["camera_poses"]
    assert "C5" in poses
    np.testing.assert_array_equal(poses["C1_to_C5"]["T"], CAMERA.translation_mm)
    np.testing.assert_array_equal(poses["C1_to_C5"]["R"], CAMERA.rotation)


def test_mrcal_has_both_names_of_the_pose_and_metres(written):
    text = written("mrcal", "C1.cameramodel")
    new, old = (re.search(rf"'{key}': (\[.*?\])", text) for key in ("rt_cam_ref", "extrinsics"))
    assert new is not None and old is not None and new[1] == old[1]
    np.testing.assert_array_equal(json.loads(new[1])[3:], CAMERA.translation_mm / 1000)
    assert "'LENSMODEL_OPENCV4'" in text


def test_opencv_poses_are_world_to_camera(written):
    text = written("opencv", "C1.yml").split("\n", 1)[1].replace("!!opencv-matrix", "")
    document = yaml.safe_load(text)
    np.testing.assert_array_equal(document["T"]["data"], CAMERA.translation_mm)
    np.testing.assert_array_equal(document["camera_matrix"]["data"][2], CAMERA.intrinsics[2])


@pytest.mark.parametrize("value", [1e-5, -2e-16, 1e22, 0.1 + 0.2, 5e-324, 0.0, 1234567.0])
def test_numbers_are_numbers_in_every_language(value):
    text = number(value)
    assert yaml.safe_load(text) == value  # YAML 1.1 takes 1e-05 for a text
    assert isinstance(yaml.safe_load(text), float)
    assert tomllib.loads(f"x = {text}")["x"] == value
    assert json.loads(text) == value


def test_safe_names_stay_different_also_without_capitals():
    assert safe_names(["a", "A", "a b", "a_b", "ä"]) == ["a", "A_2", "a_b", "a_b_2", "_"]
    assert safe_names(["1", "_x"], letter_first=True) == ["cam_1", "cam__x"]


def test_a_hostile_camera_name_cannot_leave_the_folder(tmp_path: Path) -> None:
    names = ["..a", "C:", "..x", "a", "b", "c", "d", "e", "f", "g", "h", "CON"]
    export_rig(renamed(RIG, names), "opencv", tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]
    files = sorted(path.stem for path in (tmp_path / "out").glob("*.yml"))
    assert files == ["C_", "__a", "__x", "a", "b", "c", "cam_CON", "d", "e", "f", "g", "h"]
