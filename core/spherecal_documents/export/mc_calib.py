"""MC-Calib's calibrated_cameras_data.yml: poses camera to world in the frame of camera 0."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.geometry.camera import camera_matrix
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, Reading, distortion, lens_vector
from spherecal_documents.export.format import Format
from spherecal_documents.export.opencv_yaml import opencv_node
from spherecal_documents.export.yaml_file import opencv_matrix, read_yaml

_BROWN, _KANNALA = 0, 1  # its names; the second is cv::fisheye


def _write(rig: FileRig) -> Mapping[str, str]:
    cameras = rig.reference_first()
    text = (
        f"%YAML:1.0\n---\n# {rig.source}\n# camera_pose_matrix: camera to world, lengths in {rig.unit}\n"
        f"nb_camera: {len(cameras)}\n"
    )
    for i, camera in enumerate(cameras):
        width, height = camera.size
        text += (
            f"camera_{i}: # {camera.id}\n"
            + opencv_node("camera_matrix", camera_matrix(camera.intrinsics), "   ")
            + opencv_node("distortion_vector", np.array([distortion(camera, (5,))]), "   ")
            + f"   distortion_type: {_KANNALA if camera.fisheye else _BROWN}\n"
            + f"   camera_group: 0\n   img_width: {width}\n   img_height: {height}\n"
            + opencv_node("camera_pose_matrix", camera.placed.inverse().matrix(), "   ")
        )
    return {"": text}


def _read(path: Path) -> Reading:
    document = read_yaml(path)
    count = document.fields(("nb_camera",))["nb_camera"].integer(0, 10_000)
    groups: dict[int, list[FileCamera]] = {}
    for name, value in document.fields([f"camera_{i}" for i in range(count)]).items():
        f = value.fields(
            ("camera_matrix", "distortion_vector", "distortion_type", "camera_pose_matrix", "img_width", "img_height"),
            ("camera_group",),
        )
        wide = f["distortion_type"].integer(_BROWN, _KANNALA) == _KANNALA
        matrix, coefficients = opencv_matrix(f["camera_matrix"]), opencv_matrix(f["distortion_vector"])
        lens = lens_vector(matrix, coefficients, wide, f'{path}: camera "{name}"')
        pose = opencv_matrix(f["camera_pose_matrix"])
        if pose.shape != (4, 4):
            raise f["camera_pose_matrix"].error("must be a 4 x 4 matrix")
        size = f["img_width"].integer(1), f["img_height"].integer(1)
        group = f["camera_group"].integer(0) if "camera_group" in f else 0
        camera = FileCamera(name, size, lens, Pose(pose[:3, :3], pose[:3, 3]).inverse())
        groups.setdefault(group, []).append(camera)
    # each group has a frame of its own: only one can be a rig
    largest = max(groups, key=lambda group: (len(groups[group]), -group), default=0)
    others = {c.id: f"is of group {g}, not linked" for g, own in groups.items() if g != largest for c in own}
    return Reading(tuple(groups.get(largest, ())), others)


def _ids(rig: FileRig) -> list[str]:
    place = {camera.id: f"camera_{i}" for i, camera in enumerate(rig.reference_first())}
    return [place[camera.id] for camera in rig.cameras]


FORMAT = Format("mc-calib", "MC-Calib YAML", 5, ("mm", "m"), _write, _read, ids=_ids, fisheye=True)
