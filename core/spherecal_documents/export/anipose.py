"""TOML of Anipose, which Pose2Sim reads too, and of caliscope: poses world to camera."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.geometry.camera import camera_matrix
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal_documents.export import file_cameras
from spherecal_documents.export.file_cameras import numbers
from spherecal_documents.export.format import Format
from spherecal_files.json_file import JsonValue, decode, read_bytes
from spherecal_files.toml_text import toml_of

_MOST_BYTES = 8 << 20


def toml_lens_and_pose(camera: file_cameras.FileCamera) -> str:
    """The lines that Anipose's and caliscope's cameras have in common."""
    pose = camera.placed
    return (
        f"size = [{camera.size[0]}, {camera.size[1]}]\n"
        f"matrix = {file_cameras.rows(camera_matrix(camera.intrinsics))}\n"
        f"distortions = [{numbers(file_cameras.distortion(camera, (5, 8, 12)))}]\n"
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


def read_toml_camera(section: JsonValue, name: str) -> file_cameras.FileCamera | None:
    """The camera of a section, world to camera; None without a lens. `rotation`: a vector, in old files a matrix."""
    f = section.fields(("size",), ("matrix", "distortions", "rotation", "translation", "fisheye"))
    if "matrix" not in f:
        return None
    width, height = (side.integer(1) for side in f["size"].items(2))
    coefficients = file_cameras.flat(f["distortions"]) if "distortions" in f else []
    wide = "fisheye" in f and f["fisheye"].boolean()
    where = f'{section.file}: camera "{name}"'
    lens = file_cameras.lens_vector(f["matrix"].matrix(3, 3), coefficients, wide, where)
    return file_cameras.FileCamera(
        name, (width, height), lens, _pose(f) if {"rotation", "translation"} <= set(f) else None
    )


def _pose(f: Mapping[str, JsonValue]) -> file_cameras.Pose:
    turn = np.array(file_cameras.flat(f["rotation"]))
    return file_cameras.Pose(
        turn.reshape(3, 3) if turn.size == 9 else exp_rotation(_three(f["rotation"])), _three(f["translation"])
    )


def _three(value: JsonValue) -> FloatArray:
    """Three numbers, as a list, a row or a column."""
    numbers = np.array(file_cameras.flat(value))
    if numbers.size != 3:
        raise value.error(f"must be 3 numbers, but is {numbers.size}")
    return numbers


def _write(rig: file_cameras.FileRig) -> Mapping[str, str]:
    digits = max(2, len(str(len(rig.cameras) - 1)))
    text = f"# {rig.source}\n# rotation (Rodrigues) and translation map world to camera, lengths in {rig.unit}\n"
    for i, camera in enumerate(rig.cameras):
        text += f'\n[cam_{i:0{digits}d}]\nname = "{camera.id}"\n{toml_lens_and_pose(camera)}'
    return {"": f"{text}\n[metadata]\nadjusted = false\nerror = 0.0\n"}


def _read(path: Path) -> file_cameras.Reading:
    cameras, left_out = [], {}
    sections = read_toml(path).entries()
    for name, section in sections.items():
        if not isinstance(section.value, dict) or not {"size", "matrix"} & set(section.value):
            continue  # metadata, or the board
        own = section.fields((), ("name",))
        camera = read_toml_camera(section, own["name"].name() if "name" in own else name)
        if camera is None:
            left_out[name] = "has no lens"
        else:
            cameras.append(camera)
    return file_cameras.Reading(tuple(cameras), left_out, _unit(sections.get("metadata")))


def _unit(metadata: JsonValue | None) -> file_cameras.Unit | None:
    """FreeMoCap's files have its board's square in them: one of 54 can be in mm only, one of 0.054 in m only."""
    known = metadata.value if metadata is not None and isinstance(metadata.value, dict) else {}
    square = known.get("charuco_square_size")
    if not isinstance(square, (int, float)) or not square > 0:
        return None
    return "mm" if square >= 1 else "m"


ANIPOSE = Format("anipose", "Anipose and Pose2Sim TOML", 12, ("m", "mm"), _write, _read, fisheye=True)


def _write_caliscope(rig: file_cameras.FileRig) -> Mapping[str, str]:
    text = f"# {rig.source}\n# rotation (Rodrigues) and translation map world to camera, metres\n"
    for i, camera in enumerate(rig.cameras):
        text += f"\n# {camera.id}\n[cameras.{i}]\ncam_id = {i}\n{toml_lens_and_pose(camera)}rotation_count = 0\n"
    return {"": text}


def _read_caliscope(path: Path) -> file_cameras.Reading:
    document = read_toml(path)
    given = document.as_object()
    if "cameras" in given:
        sections = document.at("cameras", given["cameras"]).entries()
    else:  # config.toml, before camera_array.toml
        sections = {name[4:]: document.at(name, value) for name, value in given.items() if re.match(r"cam_\d+$", name)}
    cameras, left_out = [], {}
    for name, section in sections.items():
        camera = None if section.as_object().get("ignore") is True else read_toml_camera(section, name)
        if camera is None:
            left_out[name] = "is ignored there" if section.as_object().get("ignore") is True else "is not calibrated"
        else:
            cameras.append(camera)
    return file_cameras.Reading(tuple(cameras), left_out)


CALISCOPE = Format(
    "caliscope", "caliscope TOML", 12, ("m",), _write_caliscope, _read_caliscope,
    ids=lambda rig: list(map(str, range(len(rig.cameras)))), fisheye=True,
)  # fmt: skip
