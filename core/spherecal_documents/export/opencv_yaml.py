"""OpenCV's FileStorage and its YAML: one file a camera, poses world to camera; a stereo pair."""

import json
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.geometry.camera import camera_matrix
from spherecal.geometry.rotation import exp_rotation
from spherecal_documents.export import file_cameras
from spherecal_documents.export.file_cameras import numbers
from spherecal_documents.export.format import Format
from spherecal_files.json_file import JsonValue, decode, read_bytes

# A camchain of 100 cameras has 100 kB and 9,000 values; 50,000 take 3 s to read.
_MOST_BYTES = 8 << 20
_MOST_EVENTS, _DEEPEST = 50_000, 50
_LONGEST = 2000  # of one value: numbers have 24 characters, names 100; Python writes no whole number of 4300 digits
_QUICK = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # where libyaml was built in


class _Loader(yaml.SafeLoader):
    """The safe loader, plus OpenCV's matrices."""


def _mapping(loader: yaml.SafeLoader, node: yaml.Node) -> object:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.YAMLError("a matrix of OpenCV's must have rows, cols, dt and data")
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _mapping)


def read_yaml(path: Path) -> JsonValue:
    """What a YAML file holds, OpenCV's `%YAML:1.0` included."""
    text = decode(path, read_bytes(path, _MOST_BYTES))
    if text.startswith("%YAML:"):
        text = text.partition("\n")[2]
    try:
        # not what cameras need: anchors (a small file can expand to a huge one), size, depth
        depth = 0
        for number, event in enumerate(yaml.parse(text, _QUICK)):
            if isinstance(event, yaml.AliasEvent):
                raise yaml.YAMLError("it uses anchors and aliases, which camera files do not need")
            if isinstance(event, yaml.ScalarEvent) and len(event.value) > _LONGEST:
                raise yaml.YAMLError(f"it has a value of {len(event.value)} characters")
            if number > _MOST_EVENTS:
                raise yaml.YAMLError(f"it has more than {_MOST_EVENTS} values")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                raise yaml.YAMLError("its lists and objects are nested too deeply")
        value = _named(yaml.load(text, _Loader))
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark is not None else ""
        problem = getattr(error, "problem", None) or str(error)
        raise InputError(f"{path}: is not valid YAML ({where}{problem}).") from None
    return JsonValue(value, path)


def read_other_json(path: Path) -> JsonValue:
    """What a JSON file holds."""
    try:
        return JsonValue(json.loads(decode(path, read_bytes(path, _MOST_BYTES))), path)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not valid JSON ({error}).") from None


def _named(value: object) -> object:
    """The value with texts for all keys, as in JSON: YAML also has numbers and dates there."""
    if isinstance(value, dict):
        return {str(key): _named(item) for key, item in value.items()}
    return [_named(item) for item in value] if isinstance(value, list) else value


def opencv_matrix(value: JsonValue) -> FloatArray:
    """A matrix as OpenCV's FileStorage or ROS writes it (rows, cols, data), or a list of lists; (rows, columns)."""
    if isinstance(value.value, list):
        nested = value.items(least=1)
        if isinstance(nested[0].value, list):
            return np.array(value.matrix(len(nested), len(nested[0].items(least=1))))
        return np.array([[item.number() for item in nested]])
    f = value.fields(("rows", "cols", "data"))
    shape = f["rows"].integer(1, 100), f["cols"].integer(1, 100)
    data, count = f["data"], shape[0] * shape[1]
    if isinstance(data.value, list) and len(data.value) == 1 and isinstance(data.value[0], str):
        # camera_calibration of ROS wrote numbers without commas between them (its issue 533)
        data = data.at(0, [_number(text) for text in data.value[0].split()])
    return np.array(data.numbers(count)).reshape(shape)


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


# As OpenCV's own samples, ROS users and others call them.
_MATRIX_KEYS = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M", "mtx")
_DISTORTION_KEYS = (
    "distortion_coefficients", "dist_coeffs", "distCoeffs", "distortionCoefficients", "Distortion_Coefficients",
    "D", "dist",
)  # fmt: skip
_PAIR_MATRIX = ("M{}", "K{}", "cameraMatrix{}", "camera_matrix_{}", "camera_matrix{}", "K_{}", "mtx{}")
_PAIR_DISTORTION = ("D{}", "distCoeffs{}", "dist_coeffs_{}", "dist_coeffs{}", "D_{}", "dist{}")
_SIZE_KEYS = ("image_width", "image_height", "image_size", "imageSize", "img_size", "size")
_ROS_FISHEYE = ("equidistant", "fisheye")
_ROS_MODELS = ("plumb_bob", "rational_polynomial", *_ROS_FISHEYE)
_LENGTHS = (4, 5, 8, 12, 14)
_FISHEYE = "fisheye_model"  # as OpenCV's calibration sample calls it: 1 for cv::fisheye


def opencv_node(name: str, matrix: FloatArray, indent: str = "") -> str:
    """A matrix (rows, columns) as FileStorage writes it."""
    shape = "".join(
        f"{indent}   {key}: {value}\n" for key, value in (("rows", matrix.shape[0]), ("cols", matrix.shape[1]))
    )
    return f"{indent}{name}: !!opencv-matrix\n{shape}{indent}   dt: d\n{indent}   data: [ {numbers(matrix)} ]\n"


def _write(rig: file_cameras.FileRig) -> Mapping[str, str]:
    return {f"{name}.yml": _camera(camera, rig) for name, camera in zip(rig.safe_names(), rig.cameras, strict=True)}


def _camera(camera: file_cameras.FileCamera, rig: file_cameras.FileRig) -> str:
    width, height = camera.size
    return (
        f"%YAML:1.0\n---\n# {rig.source}\n# x_camera = R x_world + T; (0, 0) is the centre of the first pixel\n"
        f'camera_name: "{camera.id}"\nlength_unit: "{rig.unit}"\nimage_width: {width}\nimage_height: {height}\n'
        + opencv_node("camera_matrix", camera_matrix(camera.intrinsics))
        + (f"{_FISHEYE}: 1\n" if camera.fisheye else "")
        + opencv_node("distortion_coefficients", np.array([file_cameras.distortion(camera, _LENGTHS)]))
        + opencv_node("R", camera.placed.rotation)
        + opencv_node("T", camera.placed.translation[:, None])
    )


def read_opencv_file(path: Path) -> file_cameras.FileCamera:
    """The camera of one file."""
    return _one_camera(_document(path), path.stem)


def _document(path: Path) -> JsonValue:
    """What a file of FileStorage holds, by its ending: XML, JSON, else YAML."""
    if path.suffix.lower() == ".xml":
        try:
            root = ElementTree.fromstring(read_bytes(path, _MOST_BYTES))
            return JsonValue({node.tag: _plain(node) for node in root}, path)
        except (ElementTree.ParseError, ValueError, RecursionError) as error:
            raise InputError(f"{path}: is not XML as OpenCV writes it ({error}).") from None
    return read_other_json(path) if path.suffix.lower() == ".json" else read_yaml(path)


def _plain(node: ElementTree.Element) -> object:
    """A node of FileStorage's XML as its YAML has it."""
    text = (node.text or "").strip()
    if node.get("type_id") == "opencv-matrix":
        data = [float(one) for one in (node.findtext("data") or "").split()]
        return {"rows": int(node.findtext("rows") or 0), "cols": int(node.findtext("cols") or 0), "data": data}
    if len(node):
        return [_plain(one) for one in node] if node[0].tag == "_" else {one.tag: _plain(one) for one in node}
    values = [_scalar(one) for one in text.split()]
    return values[0] if len(values) == 1 else text.strip('"') if any(isinstance(v, str) for v in values) else values


def _scalar(text: str) -> float | int | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text.strip('"')


def _one_camera(value: JsonValue, name: str) -> file_cameras.FileCamera:
    matrix_key, distortion_key = (_first_key(value, keys) for keys in (_MATRIX_KEYS, _DISTORTION_KEYS))
    if matrix_key is None:
        raise InputError(Phrase("error-no-camera-matrix", {"path": value.file}))
    known = ("camera_name", "R", "T", _FISHEYE, "distortion_model", *_SIZE_KEYS, matrix_key, distortion_key or "D")
    given = value.as_object()
    f = {key: value.at(key, given[key]) for key in known if given.get(key) is not None}
    numbers = opencv_matrix(f[distortion_key]) if distortion_key in f else np.zeros(0)
    own = f["camera_name"].name() if "camera_name" in f else name
    lens = file_cameras.lens_vector(
        opencv_matrix(f[matrix_key]), numbers, _is_fisheye(f), f'{value.file}: camera "{own}"'
    )
    pose = _pose(f["R"], f["T"]) if "R" in f and "T" in f else None
    return file_cameras.FileCamera(own, _image_size(f), lens, pose)


def _is_fisheye(f: Mapping[str, JsonValue]) -> bool:
    """By OpenCV's own key, or by ROS's name of the model."""
    if "distortion_model" in f:
        model = f["distortion_model"].text()
        if model not in (*_ROS_MODELS, ""):
            raise f["distortion_model"].error(f'is "{model}", a lens model that is not known here')
        if model in _ROS_FISHEYE:
            return True
    return _FISHEYE in f and f[_FISHEYE].value not in (0, False)


def _image_size(f: Mapping[str, JsonValue]) -> tuple[int, int] | None:
    if "image_width" in f and "image_height" in f:
        return f["image_width"].integer(1), f["image_height"].integer(1)
    sizes = [f[key] for key in _SIZE_KEYS[2:] if key in f]
    if not sizes:
        return None
    width, height = opencv_matrix(sizes[0]).ravel().tolist() if sizes[0].value else (0, 0)
    if min(width, height) < 1:
        raise sizes[0].error("must be width and height in px")
    return int(width), int(height)


def _first_key(value: JsonValue, keys: tuple[str, ...]) -> str | None:
    present = value.value if isinstance(value.value, dict) else {}
    return next((key for key in keys if present.get(key) is not None), None)


def _pose(rotation: JsonValue, translation: JsonValue) -> file_cameras.Pose:
    r, t = opencv_matrix(rotation), opencv_matrix(translation)
    if t.size != 3 or r.size not in (3, 9):
        raise rotation.error("and T must be a rotation matrix or vector and three numbers")
    return file_cameras.Pose(exp_rotation(r.ravel()) if r.size == 3 else r.reshape(3, 3), t.ravel())


def read_opencv(path: Path) -> list[file_cameras.FileCamera]:
    """The cameras of a folder with one file each, or of one such file; or the pair of a stereo calibration."""
    files = [path]
    if path.is_dir():
        files = sorted(file for ending in ("*.yml", "*.yaml", "*.xml") for file in path.glob(ending))
    if not files:
        raise InputError(Phrase("error-no-yaml-file", {"path": path}))
    documents = [_document(file) for file in files]
    if any(_of_pair(document, 2) for document in documents):
        beside = [file for file in path.parent.glob("extrinsics.*") if file != path] if path.is_file() else []
        joined: dict[str, object] = {}
        for document in [*documents, *map(_document, sorted(beside))]:
            joined |= document.as_object()
        value = JsonValue(joined, path)
        cameras = []
        for side in (1, 2):
            matrix = _of_pair(value, side)
            if matrix is None:
                raise InputError(f"{path}: has the second camera of a pair but not the first.")
            distortion_key = _first_key(value, tuple(key.format(side) for key in _PAIR_DISTORTION))
            own = {key: joined[key] for key in (*_SIZE_KEYS, _FISHEYE) if key in joined} | {"K": joined[matrix]}
            own |= {"D": joined[distortion_key]} if distortion_key else {}
            if side == 2:
                own |= {key: joined[key] for key in ("R", "T") if key in joined}
            else:
                own |= {"R": [0.0, 0.0, 0.0], "T": [0.0, 0.0, 0.0]}
            cameras.append(_one_camera(JsonValue(own, path), f"cam{side}"))
        return cameras
    return [_one_camera(document, document.file.stem) for document in documents]


def _of_pair(value: JsonValue, side: int) -> str | None:
    """The key of the matrix of one camera of a pair."""
    return _first_key(value, tuple(key.format(side) for key in _PAIR_MATRIX))


OPENCV = Format("opencv", "OpenCV YAML", 12, ("mm", "m"), _write, read_opencv, folder=True, fisheye=True)
