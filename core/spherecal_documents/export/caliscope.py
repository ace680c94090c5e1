"""caliscope's camera_array.toml: cameras by number, poses world to camera, metres."""

from collections.abc import Mapping
from pathlib import Path

from spherecal_documents.export.anipose import read_toml, read_toml_camera, toml_lens_and_pose
from spherecal_documents.export.file_cameras import FileCamera, FileRig
from spherecal_documents.export.format import Format


def _write(rig: FileRig) -> Mapping[str, str]:
    text = f"# {rig.source}\n# rotation (Rodrigues) and translation map world to camera, metres\n"
    for i, camera in enumerate(rig.cameras):
        text += f"\n# {camera.id}\n[cameras.{i}]\ncam_id = {i}\n{toml_lens_and_pose(camera)}rotation_count = 0\n"
    return {"": text}


def _read(path: Path) -> list[FileCamera]:
    cameras = read_toml(path).fields(("cameras",))["cameras"].entries()
    return [read_toml_camera(section, number) for number, section in cameras.items()]


def _ids(rig: FileRig) -> list[str]:
    return [str(i) for i in range(len(rig.cameras))]


FORMAT = Format("caliscope", "caliscope TOML", 12, ("m",), _write, _read, ids=_ids, fisheye=True)
