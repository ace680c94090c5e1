"""Anipose and Pose2Sim TOML: poses world to camera, sections named so that sorting keeps the cameras' order."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.files.json_file import JsonValue, decode, read_bytes
from spherecal.files.toml_text import toml_of
from spherecal.geometry.camera import camera_matrix
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, distortion, lens_vector, numbers, rows
from spherecal_documents.export.format import Format

_MOST_BYTES = 8 << 20


def toml_lens_and_pose(camera: FileCamera) -> str:
    """The lines that Anipose's and caliscope's cameras have in common."""
    pose = camera.placed
    return (
        f"size = [{camera.size[0]}, {camera.size[1]}]\n"
        f"matrix = {rows(camera_matrix(camera.intrinsics))}\n"
        f"distortions = [{numbers(distortion(camera, (5, 8, 12)))}]\n"
        f"rotation = [{numbers(log_rotation(pose.rotation))}]\n"
        f"translation = [{numbers(pose.translation)}]\n"
        f"fisheye = {'true' if camera.fisheye else 'false'}\n"
    )


def read_toml(path: Path) -> JsonValue:
    """What a TOML file holds."""
    text = decode(path, read_bytes(path, _MOST_BYTES))
    try:
        return JsonValue(toml_of(text), path)
    except ValueError as error:
        raise InputError(f"{path}: is not valid TOML ({error}).") from None


def read_toml_camera(section: JsonValue, name: str) -> FileCamera:
    """The camera of one section, pose world to camera, lengths as the file has them."""
    f = section.fields(("size", "matrix", "distortions", "rotation", "translation"), ("fisheye",))
    width, height = (side.integer(1) for side in f["size"].items(2))
    coefficients = [item.number() for item in f["distortions"].items()]
    pose = Pose(exp_rotation(np.array(f["rotation"].numbers(3))), np.array(f["translation"].numbers(3)))
    wide = "fisheye" in f and f["fisheye"].boolean()
    lens = lens_vector(np.array(f["matrix"].matrix(3, 3)), coefficients, wide)
    return FileCamera(name, (width, height), lens, pose)


def _write(rig: FileRig) -> Mapping[str, str]:
    digits = max(2, len(str(len(rig.cameras) - 1)))
    text = f"# {rig.source}\n# rotation (Rodrigues) and translation map world to camera, lengths in {rig.unit}\n"
    for i, camera in enumerate(rig.cameras):
        text += f'\n[cam_{i:0{digits}d}]\nname = "{camera.id}"\n{toml_lens_and_pose(camera)}'
    return {"": f"{text}\n[metadata]\nadjusted = false\nerror = 0.0\n"}


def _read(path: Path) -> list[FileCamera]:
    sections = read_toml(path).entries()
    return [
        read_toml_camera(section, section.fields(("name",))["name"].name())
        for name, section in sections.items()
        if name != "metadata"
    ]


FORMAT = Format("anipose", "Anipose and Pose2Sim TOML", 12, ("m", "mm"), _write, _read, fisheye=True)
