"""A rig as a scene for 3-D programs: glTF, PLY, and a script for Blender; for looking and rendering, not for measuring.

None of them holds a lens's distortion. Sources: glTF 2.0 specification (Khronos), 3.10 Cameras: x right, y up, looking
along -z, metres; Blender manual, Cameras: sensor, lens and shift, the same axes, z up in the world.
"""

import base64
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.resources import resource_path
from spherecal.geometry.camera import undistort
from spherecal_documents.export.file_cameras import MM_PER, FileRig, Unit, numbers
from spherecal_files.json_file import decode, parse_json, read_bytes

_MOST_BYTES = 64 << 20
_FLIP = np.diag([1.0, -1.0, -1.0])  # between x right, y down, z forward and x right, y up, looking along -z
_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # of a world with y down to one with z up
_FRUSTUM = 0.25  # its length over the median distance of the cameras from their middle
_SENSOR_MM = 36.0  # Blender's usual one; only the ratio to the lens counts
_EDGES = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1))
_FLOAT, _UINT, _LINES = 5126, 5125, 1


@dataclass(frozen=True)
class SceneFormat:
    """A format of frusta (c, 5, 3): written and read back in the file's world, which `world` turns the rig's into."""

    name: str
    title: str
    unit: Unit
    write: Callable[[FileRig], str]
    frusta: Callable[[Path], FloatArray]
    world: Callable[[FileRig], FloatArray]


def frusta(rig: FileRig) -> FloatArray:
    """Centre and the four corners of the image in space, (c, 5, 3) in the rig's world, of every camera."""
    centres = np.array([camera.placed.inverse().translation for camera in rig.cameras])
    spread = float(np.median(np.linalg.norm(centres - centres.mean(axis=0), axis=1)))
    depth = _FRUSTUM * (spread or 1000.0 / MM_PER[rig.unit])
    out = np.empty((len(centres), 5, 3))
    for i, camera in enumerate(rig.cameras):
        width, height = camera.size
        uv = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
        xy, good = undistort(uv, camera.intrinsics)
        if not good.all():  # beyond where the lens has an inverse: as without distortion
            fu, fv, u0, v0 = camera.intrinsics[:4]
            xy = np.where(good[:, None], xy, (uv - (u0, v0)) / (fu, fv))
        pose = camera.placed
        corners = np.column_stack([xy, np.ones(4)]) * depth
        out[i] = np.vstack([centres[i], (corners - pose.translation) @ pose.rotation])
    return out


def largest_difference_px(form: SceneFormat, path: Path, rig: FileRig) -> float:
    """The largest error in px of a file's frusta: corners, and centres seen at their distance; infinite behind."""
    read = form.frusta(path) @ form.world(rig)  # transposed inverse of a rotation
    largest = 0.0
    for camera, places in zip(rig.cameras, read, strict=True):
        width, height = camera.size
        uv = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
        ahead = (places[1:] @ camera.placed.rotation.T + camera.placed.translation)[:, 2] > 0  # not of a NaN
        if not (ahead.all() and np.isfinite(places).all()):
            return np.inf
        off = np.nan_to_num(np.linalg.norm(camera.project(places[1:]) - uv, axis=1), nan=0.0)
        scale = camera.intrinsics[0] / max(float(np.linalg.norm(places[1:] - places[0], axis=1).min()), 1e-12)
        moved = np.linalg.norm(places[0] - camera.placed.inverse().translation) * scale
        largest = max(largest, float(off.max()), float(moved))
    return largest


def _y_up(rig: FileRig) -> FloatArray:
    """Of the user's frame z is up, of a camera's y down."""
    return _FLIP if rig.first is None else _Z_UP


def _gltf(rig: FileRig) -> str:
    turned = frusta(rig) @ _y_up(rig).T
    points = turned.reshape(-1, 3).astype("<f4")
    lines = (np.array(_EDGES) + 5 * np.arange(len(turned))[:, None, None]).astype("<u4")
    data = points.tobytes() + lines.tobytes()
    nodes: list[dict[str, Any]] = [{"name": "frusta", "mesh": 0}]
    cameras = []
    for i, camera in enumerate(rig.cameras):
        pose = camera.placed.inverse()
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = _y_up(rig) @ pose.rotation @ _FLIP, _y_up(rig) @ pose.translation
        width, height = camera.size
        yfov = 2 * float(np.arctan(height / 2 / camera.intrinsics[1]))
        ratio = width / height * float(camera.intrinsics[1] / camera.intrinsics[0])
        lens = {"yfov": min(yfov, 3.1), "aspectRatio": ratio, "znear": 0.01}
        cameras.append({"name": camera.id, "type": "perspective", "perspective": lens})
        nodes.append({"name": camera.id, "camera": i, "matrix": matrix.T.ravel().tolist()})
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": points.nbytes, "target": 34962},
        {"buffer": 0, "byteOffset": points.nbytes, "byteLength": lines.nbytes, "target": 34963},
    ]
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    document = {
        "asset": {"version": "2.0", "generator": rig.source},
        "scene": 0,
        "scenes": [{"name": "rig", "nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "cameras": cameras,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": _LINES}]}],
        "accessors": [
            {"bufferView": 0, "componentType": _FLOAT, "count": len(points), "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": _UINT, "count": lines.size, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [
            {"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}
        ],
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _read_gltf(path: Path) -> FloatArray:
    """The frusta of the mesh."""
    document: Any = parse_json(read_bytes(path, _MOST_BYTES))
    try:
        first, count = document["bufferViews"][0], document["accessors"][0]["count"]
        data = base64.b64decode(document["buffers"][0]["uri"].split(",", 1)[1])
        return np.frombuffer(data, "<f4", 3 * count, first["byteOffset"]).astype(float).reshape(-1, 5, 3)
    except (KeyError, IndexError, TypeError, ValueError):
        raise InputError(f"{path}: is no glTF file of a rig.") from None


def _ply(rig: FileRig) -> str:
    points = frusta(rig).reshape(-1, 3)
    count = len(rig.cameras)
    head = [
        "ply",
        "format ascii 1.0",
        f"comment {rig.source}",
        f"comment unit {rig.unit}; of each camera centre, corners",
        *(f"comment camera {camera.id}" for camera in rig.cameras),
        f"element vertex {len(points)}",
        "property double x",
        "property double y",
        "property double z",
        f"element face {4 * count}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    sides = ((0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 1, 4))
    faces = [f"3 {5 * i + a} {5 * i + b} {5 * i + c}" for i in range(count) for a, b, c in sides]
    return "\n".join([*head, *(numbers(point, " ") for point in points), *faces]) + "\n"


def _read_ply(path: Path) -> FloatArray:
    lines = decode(path, read_bytes(path, _MOST_BYTES)).splitlines()
    try:
        count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
        begin = lines.index("end_header") + 1
        return np.array([[float(x) for x in line.split()] for line in lines[begin : begin + count]]).reshape(-1, 5, 3)
    except (StopIteration, ValueError, IndexError):
        raise InputError(f"{path}: is no PLY file of a rig.") from None


_SCRIPT = resource_path("blender_rig.txt").read_text(encoding="utf-8")


def _z_up(rig: FileRig) -> FloatArray:
    return _Z_UP if rig.first is None else np.eye(3)


def _blender(rig: FileRig) -> str:
    places = frusta(rig) @ _z_up(rig).T
    entries = []
    for camera, own in zip(rig.cameras, places, strict=True):
        pose = camera.placed.inverse()
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = _z_up(rig) @ pose.rotation @ _FLIP, _z_up(rig) @ pose.translation
        (fu, _, u0, v0), (width, height) = camera.intrinsics[:4].tolist(), camera.size
        entries.append(
            {
                "id": camera.id,
                "image_size": list(camera.size),
                "sensor_width_mm": _SENSOR_MM,
                "lens_mm": _SENSOR_MM * fu / width,
                "shift_x": ((width - 1) / 2 - u0) / width,
                "shift_y": (v0 - (height - 1) / 2) / width,
                "matrix_world": matrix.tolist(),
                "frustum_m": own.tolist(),
            }
        )
    data = json.dumps({"name": "rig", "cameras": entries}, indent=1).replace('"""', "")
    source = rig.source.replace("\\", "/").replace('"', "'")
    return _SCRIPT.replace("{source}", source).replace("{name}", "rig.py").replace("{data}", data)


def _read_blender(path: Path) -> FloatArray:
    text = decode(path, read_bytes(path, _MOST_BYTES))
    document: Any = parse_json(text.partition('json.loads(r"""')[2].partition('"""')[0].encode())
    try:
        return np.array([camera["frustum_m"] for camera in document["cameras"]]).reshape(-1, 5, 3)
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path}: is no script of a rig.") from None


_MADE = (
    SceneFormat("gltf", "glTF", "m", _gltf, _read_gltf, _y_up),
    SceneFormat("ply", "PLY", "mm", _ply, _read_ply, lambda _: np.eye(3)),
    SceneFormat("blender", "Blender script", "m", _blender, _read_blender, _z_up),
)
SCENES: Mapping[str, SceneFormat] = {form.name: form for form in _MADE}
