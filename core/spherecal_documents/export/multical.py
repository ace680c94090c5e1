"""multical's calibration.json: poses world to camera; "b_to_a" there means x_b = R x_a + T.

Its fisheye cameras have the model of the others there and are told by their four coefficients: it has the others from
OpenCV's calibrateCamera, which returns at least five.
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.files.json_file import JsonValue
from spherecal.geometry.camera import camera_matrix
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, distortion, flat, lens_vector
from spherecal_documents.export.format import Format
from spherecal_documents.export.yaml_file import read_other_json

_MODELS = {5: "standard", 8: "rational", 12: "thin_prism"}
_OTHER_MODELS = ("tilted", "fix_k1", "fix_k2", "fix_k3", "fix_k4")
_FISHEYE_LENGTH = 4


def _names(rig: FileRig) -> list[str]:
    """Names without "_to_", by which multical separates a transform's two cameras."""
    return [name.replace("_to_", "-to-") for name in rig.safe_names()]


def _write(rig: FileRig) -> Mapping[str, str]:
    names = dict(zip(rig.ids(), _names(rig), strict=True))
    master = rig.reference
    cameras, poses = {}, {}
    for camera in rig.cameras:
        coefficients = distortion(camera, tuple(_MODELS))
        cameras[names[camera.id]] = {
            "model": _MODELS[len(coefficients)],
            "image_size": list(camera.size),
            "K": camera_matrix(camera.intrinsics).tolist(),
            "dist": [coefficients],
        }
        own = camera.id == master or master is None
        pose_name = names[camera.id] if own else f"{names[camera.id]}_to_{names[master or '']}"
        poses[pose_name] = {"R": camera.placed.rotation.tolist(), "T": camera.placed.translation.tolist()}
    document = {"source": f"{rig.source}; lengths in {rig.unit}", "cameras": cameras, "camera_poses": poses}
    return {"": json.dumps(document, indent=1, ensure_ascii=False) + "\n"}


def _read(path: Path) -> list[FileCamera]:
    f = read_other_json(path).fields(("cameras",), ("camera_poses",))
    if "camera_poses" not in f:
        raise InputError(f"{path}: has lenses only.", "Name the calibration.json of all cameras together.")
    poses, masters, known = {}, set(), f["cameras"].as_object()
    for name, value in f["camera_poses"].entries().items():
        pose = value.fields(("R", "T"))
        camera, master = _of_and_from(name, known)
        masters |= {master} - {""}
        poses[camera] = Pose(np.array(pose["R"].matrix(3, 3)), np.array(pose["T"].numbers(3)))
    if len(masters) > 1:
        raise InputError(f"{path}: its poses are from several cameras ({', '.join(sorted(masters))}), not from one.")
    return [_camera(name, value, poses.get(name)) for name, value in f["cameras"].entries().items()]


def _of_and_from(name: str, known: Mapping[str, object]) -> tuple[str, str]:
    """The camera of a pose and the one it is from, "" where it is from none: either may have "_to_" in its name."""
    if name in known:
        return name, ""
    cuts = [(name[: cut.start()], name[cut.end() :]) for cut in re.finditer("_to_", name)]
    return next((cut for cut in cuts if set(cut) <= set(known)), (cuts or [(name, "")])[0])


def _camera(name: str, value: JsonValue, pose: Pose | None) -> FileCamera:
    f = value.fields(("image_size", "K", "dist"), ("model",))
    width, height = (side.integer(1) for side in f["image_size"].items(2))
    if "model" in f and f["model"].text() not in (*_MODELS.values(), *_OTHER_MODELS):
        raise f["model"].error(f'is "{f["model"].text()}", a lens model that is not known here')
    numbers = flat(f["dist"])
    fisheye = len(numbers) == _FISHEYE_LENGTH
    lens = lens_vector(f["K"].matrix(3, 3), numbers, fisheye, f'{value.file}: camera "{name}"')
    return FileCamera(name, (width, height), lens, pose)


FORMAT = Format("multical", "multical JSON", 12, ("mm", "m"), _write, _read, ids=_names)
