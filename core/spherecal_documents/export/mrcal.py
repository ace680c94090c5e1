"""Files of mrcal, MC-Calib and multical."""

import ast
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import splu

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.geometry.camera import camera_matrix, undistort
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal_documents.export import file_cameras
from spherecal_documents.export.file_cameras import FileCamera, FileRig, numbers
from spherecal_documents.export.format import Format
from spherecal_documents.export.opencv_yaml import opencv_matrix, opencv_node, read_other_json, read_yaml
from spherecal_documents.export.refit import pixel_grid
from spherecal_files.json_file import JsonValue, decode, read_bytes

ENDING = ".cameramodel"
_LENSMODEL = "LENSMODEL_OPENCV"
_MOST_BYTES = 64 << 20  # a model may hold all observations that it was made of


def _write(rig: file_cameras.FileRig) -> Mapping[str, str]:
    files = {}
    for name, camera in zip(rig.safe_names(), rig.cameras, strict=True):
        coefficients = file_cameras.distortion(camera, (4, 5, 8, 12))
        lens = f"{numbers(camera.intrinsics[:4])}, {numbers(coefficients)}"
        files[f"{name}{ENDING}"] = cameramodel(camera, rig, f"{_LENSMODEL}{len(coefficients)}", lens)
    return files


def cameramodel(camera: file_cameras.FileCamera, rig: file_cameras.FileRig, model: str, lens: str) -> str:
    """The text of a camera model file with a lens model and its numbers."""
    pose = f"{numbers(log_rotation(camera.placed.rotation))}, {numbers(camera.placed.translation)}"
    return (
        f"# {rig.source}\n# {camera.id}; lengths in {rig.unit}\n{{\n"
        f"    'lensmodel': '{model}',\n"
        f"    'intrinsics': [{lens}],\n"
        f"    'rt_cam_ref': [{pose}],\n"
        f"    'extrinsics': [{pose}],  # the same for mrcal before 2.5\n"
        f"    'imagersize': [{camera.size[0]}, {camera.size[1]}],\n}}\n"
    )


def _read(path: Path) -> list[file_cameras.FileCamera]:
    if path.is_file():
        return [_read_model(path)]
    return [_read_model(file) for file in sorted(path.glob(f"*{ENDING}"))]


def read_model(path: Path) -> JsonValue:
    """The contents of a camera model file."""
    try:
        return JsonValue(ast.literal_eval(decode(path, read_bytes(path, _MOST_BYTES))), path)
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        raise InputError(f"{path}: is not a camera model.") from None


def _read_model(path: Path) -> file_cameras.FileCamera:
    value = read_model(path)
    given = value.as_object()
    # before 2.5 the pose was called otherwise, in older files the lens model too
    named = {key: value.at(key, given[key]) for key in ("lensmodel", "lens_model", "distortion_model") if key in given}
    posed = [value.at(key, given[key]) for key in ("rt_cam_ref", "extrinsics") if key in given]
    f = value.fields(("intrinsics", "imagersize"))
    if not named:
        raise value.error("names no lensmodel")
    count = _coefficients(next(iter(named.values())))
    found = f["intrinsics"].numbers(4 + count)
    fu, fv, u0, v0 = found[:4]
    where = f"{path}: the camera"
    lens = file_cameras.lens_vector([[fu, 0, u0], [0, fv, v0], [0, 0, 1]], found[4:], False, where)
    width, height = (side.integer(1) for side in f["imagersize"].items(2))
    placed = read_pose(posed[0]) if posed else None
    return file_cameras.FileCamera(path.name.removesuffix(ENDING), (width, height), lens, placed)


def read_pose(value: JsonValue) -> file_cameras.Pose:
    """A pose (rotation vector, translation) of a camera model."""
    pose = np.array(value.numbers(6))
    return file_cameras.Pose(exp_rotation(pose[:3]), pose[3:])


def _coefficients(named: JsonValue) -> int:
    """How many distortion coefficients a lens model has; InputError for those that are none of OpenCV's."""
    name = named.text().removeprefix("LENSMODEL_").removeprefix("DISTORTION_")
    known = {"PINHOLE": 0, "NONE": 0, **{f"OPENCV{n}": n for n in (4, 5, 8, 12)}}
    if name not in known:
        raise InputError(
            f"{named.file}: the lens model {name} cannot be used.",
            "Usable: PINHOLE and OPENCV4, 5, 8, 12. Convert it: mrcal-convert-lensmodel LENSMODEL_OPENCV8.",
        )
    return known[name]


MRCAL = Format(
    "mrcal", "mrcal cameramodel", 12, ("m", "mm"), _write, _read, folder=True, ids=file_cameras.FileRig.safe_names
)


_BROWN, _KANNALA = 0, 1  # its names; the second is cv::fisheye


def _write_mc_calib(rig: file_cameras.FileRig) -> Mapping[str, str]:
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
            + opencv_node("distortion_vector", np.array([file_cameras.distortion(camera, (5,))]), "   ")
            + f"   distortion_type: {_KANNALA if camera.fisheye else _BROWN}\n"
            + f"   camera_group: 0\n   img_width: {width}\n   img_height: {height}\n"
            + opencv_node("camera_pose_matrix", camera.placed.inverse().matrix(), "   ")
        )
    return {"": text}


def _read_mc_calib(path: Path) -> file_cameras.Reading:
    document = read_yaml(path)
    count = document.fields(("nb_camera",))["nb_camera"].integer(0, 10_000)
    groups: dict[int, list[file_cameras.FileCamera]] = {}
    for name, value in document.fields([f"camera_{i}" for i in range(count)]).items():
        f = value.fields(
            ("camera_matrix", "distortion_vector", "distortion_type", "camera_pose_matrix", "img_width", "img_height"),
            ("camera_group",),
        )
        wide = f["distortion_type"].integer(_BROWN, _KANNALA) == _KANNALA
        matrix, coefficients = opencv_matrix(f["camera_matrix"]), opencv_matrix(f["distortion_vector"])
        lens = file_cameras.lens_vector(matrix, coefficients, wide, f'{path}: camera "{name}"')
        pose = opencv_matrix(f["camera_pose_matrix"])
        if pose.shape != (4, 4):
            raise f["camera_pose_matrix"].error("must be a 4 x 4 matrix")
        size = f["img_width"].integer(1), f["img_height"].integer(1)
        group = f["camera_group"].integer(0) if "camera_group" in f else 0
        camera = file_cameras.FileCamera(name, size, lens, file_cameras.Pose(pose[:3, :3], pose[:3, 3]).inverse())
        groups.setdefault(group, []).append(camera)
    # each group has a frame of its own: only one can be a rig
    largest = max(groups, key=lambda group: (len(groups[group]), -group), default=0)
    others = {c.id: f"is of group {g}, not linked" for g, own in groups.items() if g != largest for c in own}
    return file_cameras.Reading(tuple(groups.get(largest, ())), others)


def _ids(rig: file_cameras.FileRig) -> list[str]:
    place = {camera.id: f"camera_{i}" for i, camera in enumerate(rig.reference_first())}
    return [place[camera.id] for camera in rig.cameras]


MC_CALIB = Format("mc-calib", "MC-Calib YAML", 5, ("mm", "m"), _write_mc_calib, _read_mc_calib, ids=_ids, fisheye=True)


_MODELS = {5: "standard", 8: "rational", 12: "thin_prism"}
_OTHER_MODELS = ("tilted", "fix_k1", "fix_k2", "fix_k3", "fix_k4")
_FISHEYE_LENGTH = 4


def _names(rig: file_cameras.FileRig) -> list[str]:
    """Names without "_to_", by which multical separates a transform's two cameras."""
    return [name.replace("_to_", "-to-") for name in rig.safe_names()]


def _write_multical(rig: file_cameras.FileRig) -> Mapping[str, str]:
    names = dict(zip(rig.ids(), _names(rig), strict=True))
    master = rig.reference
    cameras, poses = {}, {}
    for camera in rig.cameras:
        coefficients = file_cameras.distortion(camera, tuple(_MODELS))
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


def _read_multical(path: Path) -> list[file_cameras.FileCamera]:
    f = read_other_json(path).fields(("cameras",), ("camera_poses",))
    if "camera_poses" not in f:
        raise InputError(f"{path}: has lenses only.", "Name the calibration.json of all cameras together.")
    poses, masters, known = {}, set(), f["cameras"].as_object()
    for name, value in f["camera_poses"].entries().items():
        pose = value.fields(("R", "T"))
        camera, master = _of_and_from(name, known)
        masters |= {master} - {""}
        poses[camera] = file_cameras.Pose(np.array(pose["R"].matrix(3, 3)), np.array(pose["T"].numbers(3)))
    if len(masters) > 1:
        raise InputError(f"{path}: its poses are from several cameras ({', '.join(sorted(masters))}), not from one.")
    return [_camera(name, value, poses.get(name)) for name, value in f["cameras"].entries().items()]


def _of_and_from(name: str, known: Mapping[str, object]) -> tuple[str, str]:
    """The camera of a pose and the one it is from, "" where it is from none: either may have "_to_" in its name."""
    if name in known:
        return name, ""
    cuts = [(name[: cut.start()], name[cut.end() :]) for cut in re.finditer("_to_", name)]
    return next((cut for cut in cuts if set(cut) <= set(known)), (cuts or [(name, "")])[0])


def _camera(name: str, value: JsonValue, pose: file_cameras.Pose | None) -> file_cameras.FileCamera:
    f = value.fields(("image_size", "K", "dist"), ("model",))
    width, height = (side.integer(1) for side in f["image_size"].items(2))
    if "model" in f and f["model"].text() not in (*_MODELS.values(), *_OTHER_MODELS):
        raise f["model"].error(f'is "{f["model"].text()}", a lens model that is not known here')
    numbers = file_cameras.flat(f["dist"])
    fisheye = len(numbers) == _FISHEYE_LENGTH
    lens = file_cameras.lens_vector(f["K"].matrix(3, 3), numbers, fisheye, f'{value.file}: camera "{name}"')
    return file_cameras.FileCamera(name, (width, height), lens, pose)


MULTICAL = Format("multical", "multical JSON", 12, ("mm", "m"), _write_multical, _read_multical, ids=_names)


# Columns of control points, until the fit is good enough. A field of 0.3 px, two periods per image, needs 24.
_COLUMNS = (16, 24, 36, 54)
MOST_PX = 0.01
_SAMPLES = 4  # rays between two control points along an axis
_RIDGE = 1e-9  # of the normal equations: for control points beyond the image, which no ray asks for
_NAME = re.compile(r"LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=(\d+)_Ny=(\d+)_fov_x_deg=(\d+)")


@dataclass(frozen=True)
class Spline:
    """A splined model: control points (rows, columns, 2) of u about 0, and how far it reaches to either side."""

    points: FloatArray
    fov_x_deg: int

    @property
    def name(self) -> str:
        """The model's name as mrcal has it."""
        rows, columns, _ = self.points.shape
        return f"LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx={columns}_Ny={rows}_fov_x_deg={self.fov_x_deg}"

    def design(self, u: FloatArray) -> csr_array:
        """Weights (n, rows * columns) of the control points at stereographic projections (n,2)."""
        rows, columns, _ = self.points.shape
        pitch = 4 * np.tan(np.deg2rad(self.fov_x_deg) / 4) / (columns - 3)
        parts = []
        for along, count in ((u[:, 1], rows), (u[:, 0], columns)):
            at = np.clip(along / pitch + (count - 1) / 2, 1, count - 2 - 1e-12)
            parts.append(BSpline.design_matrix(at, np.arange(-2.0, count + 2), 3).toarray())
        return csr_array((parts[0][:, :, None] * parts[1][:, None, :]).reshape(len(u), -1))


@dataclass(frozen=True)
class SplinedCamera(FileCamera):
    """A camera whose lens is a splined model; of `intrinsics` focal lengths and principal point count alone."""

    spline: Spline | None = None

    def project(self, world: FloatArray) -> FloatArray:
        """Image points (n, 2) px of world points (n, 3)."""
        assert self.spline is not None
        u = stereographic(world @ self.placed.rotation.T + self.placed.translation)
        bent = u + self.spline.design(u) @ self.spline.points.reshape(-1, 2)
        return bent * self.intrinsics[:2] + self.intrinsics[2:4]


def stereographic(points: FloatArray) -> FloatArray:
    """Projections (n,2) of points (n,3) of the camera's frame: 2 tan(theta / 2) from the axis."""
    return 2 * points[:, :2] / (np.linalg.norm(points, axis=1) + points[:, 2])[:, None]


def _seen(camera: FileCamera, columns: int) -> tuple[FloatArray, FloatArray]:
    """Stereographic projections (n,2), and image points (n,2) px, over the image where the lens can be inverted."""
    width, height = camera.size
    uv = pixel_grid(camera.size, (_SAMPLES * columns, _SAMPLES * int(np.ceil(columns * height / width))))
    xy, good = undistort(uv if camera.field is None else uv - camera.field.at(uv), camera.intrinsics)
    return stereographic(np.column_stack([xy, np.ones(len(xy))])[good]), uv[good]


def fitted(camera: FileCamera) -> tuple[Spline, float]:
    """The nearest splined model of a camera's lens with its field, and the largest difference in px over the image."""
    spline, off = None, np.inf
    for columns in _COLUMNS:
        u, uv = _seen(camera, columns)
        reach = np.abs(u).max(axis=0) * 1.001
        fov = int(np.ceil(np.rad2deg(4 * np.arctan(reach[0] / 2))))
        pitch = 4 * np.tan(np.deg2rad(fov) / 4) / (columns - 3)
        rows = int(np.ceil(2 * reach[1] / pitch)) + 3
        spline = Spline(np.zeros((rows, columns, 2)), fov)
        wanted = (uv - camera.intrinsics[2:4]) / camera.intrinsics[:2] - u
        design = spline.design(u)
        normal = (design.T @ design + _RIDGE * len(u) / columns / rows * eye_array(rows * columns)).tocsc()
        spline = Spline(splu(normal).solve(design.T @ wanted).reshape(rows, columns, 2), fov)
        u, uv = _seen(camera, columns + 1)  # between the rays that it was fitted to
        bent = (u + spline.design(u) @ spline.points.reshape(-1, 2)) * camera.intrinsics[:2] + camera.intrinsics[2:4]
        off = float(np.linalg.norm(bent - uv, axis=1).max())
        if off <= MOST_PX:
            break
    assert spline is not None
    return spline, off


def _write_splined(rig: FileRig) -> Mapping[str, str]:
    files = {}
    for name, camera in zip(rig.safe_names(), rig.cameras, strict=True):
        spline, off = fitted(camera)
        if off > MOST_PX:
            raise InputError(Phrase("error-no-spline", {"camera": camera.id, "max_px": off, "limit_px": MOST_PX}))
        lens = f"{numbers(camera.intrinsics[:4])}, {numbers(spline.points.ravel())}"
        files[f"{name}{ENDING}"] = cameramodel(camera, rig, spline.name, lens)
    return files


def _read_camera(path: Path) -> SplinedCamera:
    f = read_model(path).fields(("lensmodel", "intrinsics", "imagersize", "rt_cam_ref"))
    named = _NAME.fullmatch(f["lensmodel"].text())
    if named is None:
        raise f["lensmodel"].error("is no cubic splined model")
    columns, rows, fov = map(int, named.groups())
    found = f["intrinsics"].numbers(4 + 2 * rows * columns)
    width, height = (side.integer(1) for side in f["imagersize"].items(2))
    lens = np.zeros(16)
    lens[:4] = found[:4]
    spline = Spline(np.reshape(found[4:], (rows, columns, 2)), fov)
    pose = read_pose(f["rt_cam_ref"])
    return SplinedCamera(path.name.removesuffix(ENDING), (width, height), lens, pose, spline=spline)


MRCAL_SPLINED = Format(
    "mrcal-splined",
    "mrcal cameramodel with splines",
    12,
    ("m", "mm"),
    _write_splined,
    lambda folder: [_read_camera(path) for path in sorted(folder.glob(f"*{ENDING}"))],
    folder=True,
    ids=FileRig.safe_names,
    fisheye=True,
    fields=True,
)
