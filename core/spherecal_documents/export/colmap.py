"""COLMAP model with its rig, read as text or binary: (0.5, 0.5) is the first pixel's centre, poses world to camera."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.geometry.camera import FISHEYE_MARK, N_INTRINSICS
from spherecal_documents.export import colmap_model
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, Reading, distortion, numbers
from spherecal_documents.export.format import Format

# Ours (the centre of the first pixel is 0) to COLMAP's (it is 0.5).
_PIXEL_CENTRE = 0.5
_MODELS = {4: "OPENCV", 8: "FULL_OPENCV"}
_FISHEYE = "OPENCV_FISHEYE"
# Where a COLMAP model's parameters are in our 16: a tuple where one of theirs serves two of ours.
_PARAMETERS: dict[str, tuple[tuple[int, ...], ...]] = {
    "SIMPLE_PINHOLE": ((0, 1), (2,), (3,)),
    "PINHOLE": ((0,), (1,), (2,), (3,)),
    "SIMPLE_RADIAL": ((0, 1), (2,), (3,), (4,)),
    "RADIAL": ((0, 1), (2,), (3,), (4,), (5,)),
    "OPENCV": tuple((i,) for i in range(8)),
    "FULL_OPENCV": tuple((i,) for i in range(12)),
    _FISHEYE: tuple((i,) for i in range(8)),
    "SIMPLE_FISHEYE": ((0, 1), (2,), (3,)),
    "FISHEYE": ((0,), (1,), (2,), (3,)),
    "SIMPLE_RADIAL_FISHEYE": ((0, 1), (2,), (3,), (4,)),
    "RADIAL_FISHEYE": ((0, 1), (2,), (3,), (4,), (5,)),
}
_COUNTS = {model: len(places) for model, places in _PARAMETERS.items()}
# Images of one moment that were adjusted without a rig agree to 0.1 % and 0.1 degrees; those of a moving camera do not.
_MOST_TURN_DEG, _MOST_SHIFT = 2.0, 0.05


def _model(camera: FileCamera) -> tuple[str, FloatArray]:
    coefficients = distortion(camera, tuple(_MODELS))
    centre = camera.intrinsics[2:4] + _PIXEL_CENTRE
    return _FISHEYE if camera.fisheye else _MODELS[len(coefficients)], np.concatenate(
        [camera.intrinsics[:2], centre, coefficients]
    )


def _seven(pose: Pose) -> list[float]:
    """Quaternion w x y z and translation."""
    x, y, z, w = Rotation.from_matrix(pose.rotation).as_quat(canonical=True).tolist()
    return [w, x, y, z, *pose.translation.tolist()]


def _from_reference(camera: FileCamera, reference: FileCamera) -> Pose:
    matrix = camera.placed.matrix() @ np.linalg.inv(reference.placed.matrix())
    return Pose(matrix[:3, :3], matrix[:3, 3])


def _write(rig: FileRig) -> Mapping[str, str]:
    cameras = rig.cameras
    names, reference = rig.safe_names(), rig.reference_first()[0]
    place = {camera.id: i + 1 for i, camera in enumerate(cameras)}
    first = place[reference.id]
    head = f"# {rig.source}\n# lengths in {rig.unit}\n"
    lenses, images, sensors = "", "", ""
    for camera, name in zip(cameras, names, strict=True):
        number = place[camera.id]
        model, parameters = _model(camera)
        lenses += f"{number} {model} {camera.size[0]} {camera.size[1]} {numbers(parameters, ' ')}\n"
        images += f"{number} {numbers(_seven(camera.placed), ' ')} {number} {name}/rig.png\n\n"
        if camera is not reference:
            sensors += f" CAMERA {number} 1 {numbers(_seven(_from_reference(camera, reference)), ' ')}"
    data = " ".join(f"CAMERA {number} {number}" for number in place.values())
    frame = f"1 1 {numbers(_seven(reference.placed), ' ')} {len(cameras)} {data}\n"
    return {
        "cameras.txt": f"{head}# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n{lenses}",
        "images.txt": f"{head}# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and an empty line\n{images}",
        "points3D.txt": f"{head}# no points\n",
        "rigs.txt": f"{head}# RIG_ID NUM_SENSORS REF_TYPE REF_ID (TYPE ID HAS_POSE QW QX QY QZ TX TY TZ)\n"
        f"1 {len(cameras)} CAMERA {first}{sensors}\n",
        "frames.txt": f"{head}# FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA (TYPE SENSOR_ID DATA_ID)\n{frame}",
        "rig_config.json": json.dumps([{"cameras": _rig_config(rig, names, reference)}], indent=1) + "\n",
    }


def _rig_config(rig: FileRig, names: Sequence[str], reference: FileCamera) -> list[dict[str, object]]:
    """For `colmap rig_configurator`: images of a camera are in the folder of its name."""
    entries: list[dict[str, object]] = []
    for camera, name in zip(rig.cameras, names, strict=True):
        model, parameters = _model(camera)
        entry: dict[str, object] = {"image_prefix": f"{name}/", "camera_model_name": model}
        entry["camera_params"] = parameters.tolist()
        if camera is reference:
            entry["ref_sensor"] = True
        else:
            seven = _seven(_from_reference(camera, reference))
            entry["cam_from_rig_rotation"], entry["cam_from_rig_translation"] = seven[:4], seven[4:]
        entries.append(entry)
    return entries


def read_colmap_lenses(folder: Path) -> list[FileCamera]:
    """The cameras of a model without poses, named after the folder of their images where that is one name a camera."""
    images = list(colmap_model.read_model_images(folder))
    return [_camera(row, images) for row in colmap_model.read_model_cameras(folder, _COUNTS)]


def read_colmap(folder: Path) -> Reading:
    """The cameras of a model, posed by its rig, else by the images of a moment; refused where moments contradict."""
    folder = folder.parent if folder.is_file() else folder
    rows, images = colmap_model.read_model_cameras(folder, _COUNTS), list(colmap_model.read_model_images(folder))
    numbers = [row.number for row in rows]
    poses, why = _by_rig(folder, numbers, images) or _by_moments(folder, numbers, images)
    cameras = [(row, _camera(row, images)) for row in rows]
    left_out = {camera.id: why.get(row.number, _UNSEEN) for row, camera in cameras if row.number not in poses}
    return Reading(tuple(replace(c, pose=poses[row.number]) for row, c in cameras if row.number in poses), left_out)


def _camera(row: colmap_model.ModelCamera, images: Sequence[colmap_model.ModelImage]) -> FileCamera:
    """The lens of a row, and its name."""
    lens = np.zeros(N_INTRINSICS)
    for value, targets in zip(row.parameters, _PARAMETERS[row.model], strict=True):
        lens[list(targets)] = value
    if row.model.endswith("FISHEYE"):
        lens[15] = FISHEYE_MARK
    if min(lens[0], lens[1], *row.size) <= 0:
        raise InputError(f"{row.where}: the image size and the focal length must be above 0.")
    lens[2:4] -= _PIXEL_CENTRE
    own = {image.name.rpartition("/")[0] for image in images if image.camera == row.number}
    name = next(iter(own)).replace("/", "_") if len(own) == 1 else ""
    return FileCamera(name or f"camera{row.number}", row.size, lens, None)


_Posed = tuple[dict[int, Pose], dict[int, str]]  # poses by camera, and why others have none
_UNSEEN = "has no image with a pose"


def _by_rig(folder: Path, cameras: Sequence[int], images: Sequence[colmap_model.ModelImage]) -> _Posed | None:
    """The poses of a rig with several cameras, in the world of its reference camera's first image."""
    rigs = colmap_model.read_model_rigs(folder)
    if not rigs:
        return None
    rig = max(rigs, key=lambda one: len(one.others))
    first = next((image.pose for image in images if image.camera == rig.reference), Pose(np.eye(3), np.zeros(3)))
    found = {rig.reference: first}
    for camera, pose in rig.others.items():
        if pose is not None:
            found[camera] = Pose(pose.rotation @ first.rotation, pose.rotation @ first.translation + pose.translation)
    known = {camera: pose for camera, pose in found.items() if camera in cameras}
    why = dict.fromkeys(rig.others, "has no pose in the rig")
    return known, {camera: why.get(camera, "is of another rig") for camera in cameras if camera not in known}


def _by_moments(folder: Path, cameras: Sequence[int], images: Sequence[colmap_model.ModelImage]) -> _Posed:
    """The poses at the moment that most cameras saw; others are linked by moments that they share with these."""
    moments: dict[str, dict[int, Pose]] = {}
    single = len({image.camera for image in images}) == len(images)
    for image in images:
        own = moments.setdefault("" if single else _moment(image.name), {})
        if image.camera in own:
            raise _no_moments(folder)
        own[image.camera] = image.pose
    if not single and max(map(len, moments.values())) == 1:
        raise _no_moments(folder)
    placed: dict[int, Pose] = {}
    for own in sorted(moments.values(), key=len, reverse=True):
        shared = sorted(set(own) & set(placed))
        if placed and not shared:
            continue
        for camera, pose in own.items():
            placed.setdefault(camera, pose if not shared else _moved(pose, own[shared[0]], placed[shared[0]]))
    centres = np.array([pose.inverse().translation for pose in placed.values()]).reshape(-1, 3)
    spread = float(np.linalg.norm(np.ptp(centres, axis=0))) if len(centres) else 0.0
    for moment, own in moments.items():
        _refuse_contradiction(folder, moment, own, placed, spread)
    return placed, {camera: "shares no moment with the others" for camera in {i.camera for i in images} - set(placed)}


def _no_moments(folder: Path) -> InputError:
    return InputError(
        f"{folder}: a camera has several images at different poses, and their names do not tell which images of the "
        "cameras are of one moment.",
        "A rig is needed: name images CAMERA/MOMENT.png, or configure one (colmap rig_configurator).",
    )


def _moment(name: str) -> str:
    """What names the moment of an image: its file's name in the folder of a camera, else the number at its end."""
    stem = name.rpartition("/")[2].rpartition(".")[0]
    number = re.search(r"\d+$", stem)
    return stem if "/" in name or number is None else number[0]


def _moved(pose: Pose, shared: Pose, placed: Pose) -> Pose:
    """A camera's pose at one moment, brought to the world in which the shared camera is placed."""
    matrix = pose.matrix() @ np.linalg.inv(shared.matrix()) @ placed.matrix()
    return Pose(matrix[:3, :3], matrix[:3, 3])


def _refuse_contradiction(
    folder: Path, moment: str, own: Mapping[int, Pose], placed: Mapping[int, Pose], spread: float
) -> None:
    shared = sorted(set(own) & set(placed))
    for camera in shared[1:]:
        here = _moved(own[camera], own[shared[0]], placed[shared[0]])
        turn = np.rad2deg(np.arccos(np.clip((np.trace(here.rotation @ placed[camera].rotation.T) - 1) / 2, -1, 1)))
        shift = float(np.linalg.norm(here.inverse().translation - placed[camera].inverse().translation))
        if turn > _MOST_TURN_DEG or shift > _MOST_SHIFT * spread:
            raise InputError(
                f'{folder}: cameras {shared[0]} and {camera} are not fixed to each other: at the moment "{moment}" '
                f"they are turned by {turn:.2g} degrees and shifted by {shift:.3g} (file units) against another one.",
                "Only a rig can be imported. Reconstruct it with a rig (colmap rig_configurator).",
            )


COLMAP = Format(
    "colmap", "COLMAP text model with rig", 8, ("mm", "m"), _write, read_colmap, folder=True, ids=FileRig.safe_names,
    fisheye=True,
)  # fmt: skip
