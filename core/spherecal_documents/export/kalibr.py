"""YAML of Kalibr, a chain of cameras, and of ROS, one camera_info a camera."""

import re
from collections.abc import Mapping
from pathlib import Path
from string import Template

import numpy as np
from scipy.spatial.transform import Rotation

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import resource_path
from spherecal.data.observations import name_problem
from spherecal.geometry.camera import camera_matrix
from spherecal_documents.export.file_cameras import (
    FileCamera,
    FileRig,
    Pose,
    distortion,
    lens_vector,
    number,
    numbers,
    rows,
)
from spherecal_documents.export.format import Format
from spherecal_documents.export.opencv_yaml import read_opencv_file, read_yaml
from spherecal_files.json_file import JsonValue

# Kalibr's own chain and its IMU's differ by how it rounds them; lengths are in metres.
_SAME_POSE = 1e-3


def _write(rig: FileRig) -> Mapping[str, str]:
    world = "the world is the frame of cam0" if rig.reference else "cam0's own is from the world"
    text = f"# {rig.source}\n# T_cn_cnm1 maps the camera before to this one; {world}; metres.\n"
    before = np.eye(4)
    for index, camera in enumerate(rig.reference_first()):
        # cam0's own transform is from the world: the identity, unless the rig has no reference camera
        pose = camera.placed.matrix()
        step = pose @ np.linalg.inv(before)
        before = pose
        text += (
            f"cam{index}:\n  camera_model: pinhole\n  intrinsics: [{numbers(camera.intrinsics[:4])}]\n"
            f"  distortion_model: {'equidistant' if camera.fisheye else 'radtan'}\n"
            f"  distortion_coeffs: [{numbers(distortion(camera, (4,)))}]\n"
            f'  resolution: [{camera.size[0]}, {camera.size[1]}]\n  rostopic: "/{camera.id}/image_raw"\n'
            "  cam_overlaps: []\n"
        )
        if index or not np.array_equal(step, np.eye(4)):
            text += f"  T_cn_cnm1: {rows(step)}\n"
    return {"": text}


def read_kalibr(path: Path) -> list[FileCamera]:
    """The cameras of a camchain by topic; linked by the one before or the IMU, else without a pose."""
    chain = read_yaml(path)
    entries = chain.value if isinstance(chain.value, dict) else {}
    numbered = sorted(int(name[3:]) for name in entries if re.fullmatch(r"cam\d{1,4}", name))
    if "cam0" not in entries:
        raise InputError(Phrase("error-no-cam0", {"path": path}))
    missing = [f"cam{i}" for i in range(numbered[-1]) if i not in numbered]
    if missing:
        raise InputError(
            f"{path}: {', '.join(missing)} is missing between cam0 and cam{numbered[-1]}.",
            "Each camera's pose is from the one before. Name the camchain as Kalibr wrote it.",
        )
    cameras: list[FileCamera] = []
    first, before = None, np.eye(4)
    for value in chain.fields([f"cam{i}" for i in numbered]).values():
        f = value.fields(
            ("camera_model", "intrinsics", "distortion_model", "resolution"),
            ("distortion_coeffs", "T_cn_cnm1", "T_cam_imu", "rostopic"),
        )
        from_imu = np.array(f["T_cam_imu"].matrix(4, 4)) if "T_cam_imu" in f else None
        first = from_imu if value.place == "cam0" else first
        pose = _chained(f, before, value.place == "cam0", first, from_imu)
        before = pose
        width, height = (side.integer(1) for side in f["resolution"].items(2))
        placed = None if pose is None else Pose(pose[:3, :3], pose[:3, 3])
        # what comes before the topic's last part: "/C01/image_raw" names C01
        parts = f["rostopic"].text().strip("/").split("/") if "rostopic" in f else []
        name = parts[-2] if len(parts) > 1 else ""
        cameras.append(FileCamera(value.place if name_problem(name) else name, (width, height), _lens(f), placed))
    if len({camera.id for camera in cameras}) < len(cameras):  # topics that do not distinguish the cameras
        return [FileCamera(f"cam{i}", c.image_size, c.intrinsics, c.pose) for i, c in enumerate(cameras)]
    return cameras


def _chained(
    f: dict[str, JsonValue],
    before: FloatArray | None,
    begins: bool,
    first: FloatArray | None,
    from_imu: FloatArray | None,
) -> FloatArray | None:
    """World to camera (4, 4) by the camera before, else by the IMU's transforms; None where it is not linked."""
    linked = from_imu @ np.linalg.inv(first) if first is not None and from_imu is not None and not begins else None
    if "T_cn_cnm1" not in f:
        return np.eye(4) if begins else linked
    chained = None if before is None else np.array(f["T_cn_cnm1"].matrix(4, 4)) @ before
    if chained is not None and linked is not None and np.abs(chained - linked).max() > _SAME_POSE:
        raise f["T_cn_cnm1"].error("contradicts T_cam_imu: they give this camera two different poses")
    return linked if chained is None else chained


def _lens(f: dict[str, JsonValue]) -> np.ndarray:
    f["camera_model"].choice("pinhole")
    model = f["distortion_model"].choice("radtan", "equidistant", "none")
    fu, fv, u0, v0 = f["intrinsics"].numbers(4)
    if min(fu, fv) <= 0:
        raise f["intrinsics"].error("must begin with two focal lengths above 0")
    coefficients = f["distortion_coeffs"].numbers(4) if model != "none" and "distortion_coeffs" in f else []
    matrix = [[fu, 0, u0], [0, fv, v0], [0, 0, 1]]
    return lens_vector(matrix, coefficients, model == "equidistant", f["intrinsics"].place)


KALIBR = Format("kalibr", "Kalibr camchain", 4, ("m",), _write, read_kalibr, fisheye=True)


_TRANSFORMS = "static_transforms.yaml"
_LAUNCH = "static_transforms.launch.py"
_WORLD = "rig"
_MODELS = {5: "plumb_bob", 8: "rational_polynomial"}
_FISHEYE = "equidistant"


def _names(rig: FileRig) -> list[str]:
    return rig.safe_names(letter_first=True)


def _write_ros(rig: FileRig) -> Mapping[str, str]:
    names = _names(rig)
    files = {
        f"{name}.yaml": f"# {rig.source}\n" + _camera_info(name, camera)
        for name, camera in zip(names, rig.cameras, strict=True)
    }
    placed = [(name, camera.placed.inverse()) for name, camera in zip(names, rig.cameras, strict=True)]
    files[_TRANSFORMS] = (
        f"# {rig.source}\n# The pose of each optical frame in the rig's frame (camera to world), metres.\ntransforms:\n"
        + "".join(_transform(name, pose) for name, pose in placed)
    )
    lines = "".join(
        f'    ("{name}_optical_frame", [{numbers(pose.translation)}], [{numbers(_quaternion(pose.rotation))}]),\n'
        for name, pose in placed
    )
    text = Template(resource_path("ros_launch.txt").read_text(encoding="utf-8"))
    files[_LAUNCH] = text.substitute(source=rig.source, name=_LAUNCH, world=_WORLD, frames=lines)
    return files


def _camera_info(name: str, camera: FileCamera) -> str:
    coefficients = distortion(camera, tuple(_MODELS))
    k = camera_matrix(camera.intrinsics)
    entries = (
        ("camera_matrix", k),
        ("distortion_coefficients", np.array([coefficients])),
        ("rectification_matrix", np.eye(3)),
        ("projection_matrix", np.column_stack([k, np.zeros(3)])),
    )
    width, height = camera.size
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: {name}\n"
        f"distortion_model: {_FISHEYE if camera.fisheye else _MODELS[len(coefficients)]}\n"
        + "".join(
            f"{key}:\n  rows: {matrix.shape[0]}\n  cols: {matrix.shape[1]}\n  data: [{numbers(matrix)}]\n"
            for key, matrix in entries
        )
    )


def _quaternion(rotation: np.ndarray) -> list[float]:
    return Rotation.from_matrix(rotation).as_quat(canonical=True).tolist()


def _transform(name: str, pose: Pose) -> str:
    translation = ", ".join(f"{axis}: {number(v)}" for axis, v in zip("xyz", pose.translation, strict=True))
    rotation = ", ".join(f"{axis}: {number(v)}" for axis, v in zip("xyzw", _quaternion(pose.rotation), strict=True))
    return (
        f"  - header: {{frame_id: {_WORLD}}}\n    child_frame_id: {name}_optical_frame\n"
        f"    transform:\n      translation: {{{translation}}}\n      rotation: {{{rotation}}}\n"
    )


def _read(folder: Path) -> list[FileCamera]:
    if not (folder / _TRANSFORMS).is_file():
        raise InputError(
            f"{folder}: has no {_TRANSFORMS}, so the cameras' poses are not known.",
            "camera_info has lenses only: spherecal import-priors takes them.",
        )
    cameras = []
    for transform in read_yaml(folder / _TRANSFORMS).fields(("transforms",))["transforms"].items():
        f = transform.fields(("child_frame_id", "transform"))
        name = f["child_frame_id"].text().removesuffix("_optical_frame")
        parts = f["transform"].fields(("translation", "rotation"))
        translation = parts["translation"].fields("xyz")
        quaternion = parts["rotation"].fields("xyzw")
        turn = [quaternion[axis].number() for axis in "xyzw"]
        if not np.linalg.norm(turn) > 0:
            raise parts["rotation"].error("is no rotation")
        pose = Pose(Rotation.from_quat(turn).as_matrix(), np.array([translation[axis].number() for axis in "xyz"]))
        camera = read_opencv_file(folder / f"{name}.yaml")
        cameras.append(FileCamera(name, camera.image_size, camera.intrinsics, pose.inverse()))
    return cameras


ROS = Format(
    "ros", "ROS camera_info and static transforms", 8, ("m",), _write_ros, _read, folder=True, ids=_names, fisheye=True
)
