"""caliscope's camera_array.toml: cameras by number, poses world to camera, metres."""

import re
from collections.abc import Mapping
from pathlib import Path

from spherecal_documents.export.anipose import read_toml, read_toml_camera, toml_lens_and_pose
from spherecal_documents.export.file_cameras import FileRig, Reading
from spherecal_documents.export.format import Format


def _write(rig: FileRig) -> Mapping[str, str]:
    text = f"# {rig.source}\n# rotation (Rodrigues) and translation map world to camera, metres\n"
    for i, camera in enumerate(rig.cameras):
        text += f"\n# {camera.id}\n[cameras.{i}]\ncam_id = {i}\n{toml_lens_and_pose(camera)}rotation_count = 0\n"
    return {"": text}


def _read(path: Path) -> Reading:
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
    return Reading(tuple(cameras), left_out)


FORMAT = Format(
    "caliscope",
    "caliscope TOML",
    12,
    ("m",),
    _write,
    _read,
    ids=lambda rig: list(map(str, range(len(rig.cameras)))),
    fisheye=True,
)
