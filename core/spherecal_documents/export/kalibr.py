"""Kalibr camchain: cameras in a chain, each with the transform from the one before it, metres."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import name_problem
from spherecal.files.json_file import JsonValue
from spherecal.geometry.camera import FISHEYE_MARK, N_INTRINSICS
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, distortion, numbers, rows
from spherecal_documents.export.format import Format
from spherecal_documents.export.yaml_file import read_yaml


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
    """The cameras of a camchain in its order, named after their ROS topic where there is one."""
    chain = read_yaml(path)
    entries = chain.value if isinstance(chain.value, dict) else {}
    if "cam0" not in entries:
        raise InputError(Phrase("error-no-cam0", {"path": path}))
    count = next(i for i in range(len(entries) + 1) if f"cam{i}" not in entries)
    fields = chain.fields([f"cam{i}" for i in range(count)])
    cameras: list[FileCamera] = []
    for value in fields.values():
        f = value.fields(
            ("camera_model", "intrinsics", "distortion_model", "resolution"),
            ("distortion_coeffs", "T_cn_cnm1", "rostopic"),
        )
        before = cameras[-1].placed.matrix() if cameras else np.eye(4)
        step = np.array(f["T_cn_cnm1"].matrix(4, 4)) if "T_cn_cnm1" in f else np.eye(4)
        pose = step @ before
        width, height = (side.integer(1) for side in f["resolution"].items(2))
        cameras.append(FileCamera(_name(f, value.place), (width, height), _lens(f), Pose(pose[:3, :3], pose[:3, 3])))
    if len({camera.id for camera in cameras}) < count:  # topics that do not distinguish the cameras
        return [FileCamera(f"cam{i}", c.image_size, c.intrinsics, c.pose) for i, c in enumerate(cameras)]
    return cameras


def _name(f: dict[str, JsonValue], place: str) -> str:
    """What comes before the topic's last part: "/C01/image_raw" names C01."""
    parts = f["rostopic"].text().strip("/").split("/") if "rostopic" in f else []
    name = parts[-2] if len(parts) > 1 else ""
    return place if name_problem(name) else name


def _lens(f: dict[str, JsonValue]) -> np.ndarray:
    f["camera_model"].choice("pinhole")
    model = f["distortion_model"].choice("radtan", "equidistant", "none")
    lens = np.zeros(N_INTRINSICS)
    lens[:4] = f["intrinsics"].numbers(4)
    if min(lens[:2]) <= 0:
        raise f["intrinsics"].error("must begin with two focal lengths above 0")
    if model != "none" and "distortion_coeffs" in f:
        lens[4:8] = f["distortion_coeffs"].numbers(4)
    if model == "equidistant":
        lens[15] = FISHEYE_MARK
    return lens


FORMAT = Format("kalibr", "Kalibr camchain", 4, ("m",), _write, read_kalibr, fisheye=True)
