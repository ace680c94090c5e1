"""Kalibr camchain: cameras in a chain, each with the transform from the one before it, metres."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import name_problem
from spherecal.files.json_file import JsonValue
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, distortion, lens_vector, numbers, rows
from spherecal_documents.export.format import Format
from spherecal_documents.export.yaml_file import read_yaml

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
    """The cameras of a camchain in its order, named after their ROS topic where there is one.

    A camera that is not linked to the one before has no pose. The IMU's transforms serve where the chain has none.
    """
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
        cameras.append(FileCamera(_name(f, value.place), (width, height), _lens(f), placed))
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
    """World to camera (4, 4) by the camera before, else by the IMU; None where the camera is not linked.

    `first` and `from_imu`: IMU to cam0 and to this camera.
    """
    linked = from_imu @ np.linalg.inv(first) if first is not None and from_imu is not None and not begins else None
    if "T_cn_cnm1" not in f:
        return np.eye(4) if begins else linked
    chained = None if before is None else np.array(f["T_cn_cnm1"].matrix(4, 4)) @ before
    if chained is not None and linked is not None and np.abs(chained - linked).max() > _SAME_POSE:
        raise f["T_cn_cnm1"].error("contradicts T_cam_imu: they give this camera two different poses")
    return linked if chained is None else chained


def _name(f: dict[str, JsonValue], place: str) -> str:
    """What comes before the topic's last part: "/C01/image_raw" names C01."""
    parts = f["rostopic"].text().strip("/").split("/") if "rostopic" in f else []
    name = parts[-2] if len(parts) > 1 else ""
    return place if name_problem(name) else name


def _lens(f: dict[str, JsonValue]) -> np.ndarray:
    f["camera_model"].choice("pinhole")
    model = f["distortion_model"].choice("radtan", "equidistant", "none")
    fu, fv, u0, v0 = f["intrinsics"].numbers(4)
    if min(fu, fv) <= 0:
        raise f["intrinsics"].error("must begin with two focal lengths above 0")
    coefficients = f["distortion_coeffs"].numbers(4) if model != "none" and "distortion_coeffs" in f else []
    matrix = [[fu, 0, u0], [0, fv, v0], [0, 0, 1]]
    return lens_vector(matrix, coefficients, model == "equidistant", f["intrinsics"].place)


FORMAT = Format("kalibr", "Kalibr camchain", 4, ("m",), _write, read_kalibr, fisheye=True)
