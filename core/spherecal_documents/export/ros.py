"""ROS: camera_info of every camera, and the poses as static transforms (camera to world, metres)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from spherecal.base.errors import InputError
from spherecal.geometry.camera import camera_matrix
from spherecal_documents.export.file_cameras import (
    FileCamera,
    FileRig,
    Pose,
    distortion,
    number,
    numbers,
)
from spherecal_documents.export.format import Format
from spherecal_documents.export.opencv_yaml import read_opencv_file
from spherecal_documents.export.yaml_file import read_yaml

_TRANSFORMS = "static_transforms.yaml"
_LAUNCH = "static_transforms.launch.py"
_WORLD = "rig"
_MODELS = {5: "plumb_bob", 8: "rational_polynomial"}
_FISHEYE = "equidistant"


def _names(rig: FileRig) -> list[str]:
    return rig.safe_names(letter_first=True)


def _write(rig: FileRig) -> Mapping[str, str]:
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
    files[_LAUNCH] = _launch(rig, placed)
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


def _launch(rig: FileRig, placed: list[tuple[str, Pose]]) -> str:
    lines = "".join(
        f'    ("{name}_optical_frame", [{numbers(pose.translation)}], [{numbers(_quaternion(pose.rotation))}]),\n'
        for name, pose in placed
    )
    return (
        f"# {rig.source}\n# ros2 launch {_LAUNCH}\n"
        "from launch import LaunchDescription\nfrom launch_ros.actions import Node\n\n"
        f'# frame, x y z in metres, quaternion x y z w: the pose of the frame in "{_WORLD}"\nFRAMES = [\n{lines}]\n\n\n'
        "def generate_launch_description():\n    return LaunchDescription([\n        Node(\n"
        '            package="tf2_ros", executable="static_transform_publisher", name=f"{frame}_publisher",\n'
        "            arguments=[\n"
        '                "--x", str(t[0]), "--y", str(t[1]), "--z", str(t[2]), "--qx", str(q[0]), "--qy", str(q[1]),\n'
        f'                "--qz", str(q[2]), "--qw", str(q[3]), "--frame-id", "{_WORLD}", "--child-frame-id", frame,\n'
        "            ],\n        )\n        for frame, t, q in FRAMES\n    ])\n"
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


FORMAT = Format(
    "ros", "ROS camera_info and static transforms", 8, ("m",), _write, _read, folder=True, ids=_names, fisheye=True
)
