"""A scene as a glTF 2.0 file (Khronos; .glb, KHR_materials_unlit): y up, metres, vertex colours."""

import io
import json
import struct

import numpy as np
from numpy.typing import ArrayLike

from spherecal.base.arrays import FloatArray, IntArray
from spherecal_documents.scene.model import SceneData
from spherecal_documents.scene.shapes import ByteArray, Lines, Mesh, Picture, SceneStyle, scene_shapes

_FLOAT, _UINT32, _UINT8 = 5126, 5125, 5121
_DTYPES = {_FLOAT: "<f4", _UINT32: "<u4", _UINT8: "u1"}
_ARRAY, _ELEMENTS = 34962, 34963
_TRIANGLES, _LINES = 4, 1
_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]) / 1000.0  # from z up in mm

_Entry = dict[str, object]  # a JSON object of the file


def scene_glb(data: SceneData, style: SceneStyle) -> bytes:
    """The file's bytes; the same scene gives the same bytes."""
    made = _Maker()
    shapes = scene_shapes(data, style)
    for mesh in shapes.meshes:
        made.add_mesh(mesh)
    for lines in shapes.lines:
        made.add_lines(lines)
    if shapes.picture is not None:
        made.add_picture(shapes.picture)
    return made.whole([{"name": one.id, "translation": (_UP @ one.centre).tolist()} for one in data.scene.cameras])


class _Maker:
    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._length = 0
        self._nodes: list[_Entry] = []
        self._meshes: list[_Entry] = []
        self._accessors: list[_Entry] = []
        self._views: list[_Entry] = []
        self._materials: list[_Entry] = [
            {"name": "lit", "doubleSided": True,
             "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.7}},
            {"name": "unlit", "doubleSided": True, "extensions": {"KHR_materials_unlit": {}}},
        ]  # fmt: skip
        self._images: list[_Entry] = []

    def add_mesh(self, mesh: Mesh) -> None:
        vertices, faces, colours = mesh.vertices, mesh.faces, mesh.colours
        normals = _normals(vertices, faces)
        if not mesh.smooth:  # every face has corners of its own
            colours, vertices = colours[faces.ravel()], vertices[faces.ravel()]
            faces = np.arange(len(vertices)).reshape(-1, 3)
            normals = _normals(vertices, faces)
        attributes = {
            "POSITION": self._places(vertices),
            "NORMAL": self._accessor(normals @ (1000 * _UP).T, _FLOAT, "VEC3"),
            "COLOR_0": self._colours(colours),
        }
        self._node(mesh.name, attributes, self._indices(faces), _TRIANGLES, 1 if mesh.plain else 0)

    def add_lines(self, lines: Lines) -> None:
        attributes = {
            "POSITION": self._places(lines.ends.reshape(-1, 3)),
            "COLOR_0": self._colours(np.repeat(lines.colours, 2, axis=0)),
        }
        self._node(lines.name, attributes, self._indices(np.arange(2 * len(lines.ends))), _LINES, 1)

    def add_picture(self, picture: Picture) -> None:
        from PIL import Image

        file = io.BytesIO()
        Image.fromarray(np.asarray(picture.image, dtype=np.uint8)).save(file, "PNG")
        self._images.append({"bufferView": self._view(file.getvalue(), None), "mimeType": "image/png"})
        texture = {"baseColorTexture": {"index": 0}}
        self._materials.append({**self._materials[1], "name": "images", "pbrMetallicRoughness": texture})
        first = 4 * np.arange(len(picture.corners))[:, None]
        faces = np.concatenate([first + np.array(corners) for corners in ((0, 1, 2), (0, 2, 3))])
        attributes = {
            "POSITION": self._places(picture.corners.reshape(-1, 3)),
            "TEXCOORD_0": self._accessor(picture.uv.reshape(-1, 2), _FLOAT, "VEC2"),
        }
        self._node("images", attributes, self._indices(faces), _TRIANGLES, 2)

    def whole(self, places: list[_Entry]) -> bytes:
        """Header, JSON, and the arrays; `places` are nodes with nothing but a name and where they are."""
        nodes = self._nodes + places
        document: _Entry = {
            "asset": {"version": "2.0", "generator": "SphereCal"}, "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes,
            "meshes": self._meshes, "accessors": self._accessors, "bufferViews": self._views,
            "materials": self._materials,
        }  # fmt: skip
        if self._images:
            document |= {"images": self._images, "textures": [{"source": 0}]}
        document["buffers"] = [{"byteLength": self._length}]
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        data = b"".join(self._parts)
        head = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(data))
        return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data

    def _node(self, name: str, attributes: dict[str, int], indices: int, mode: int, material: int) -> None:
        primitive = {"attributes": attributes, "indices": indices, "mode": mode, "material": material}
        self._meshes.append({"name": name, "primitives": [primitive]})
        self._nodes.append({"name": name, "mesh": len(self._meshes) - 1})

    def _places(self, places: FloatArray) -> int:
        own = (places @ _UP.T).astype("<f4")
        return self._accessor(own, _FLOAT, "VEC3", min=own.min(axis=0).tolist(), max=own.max(axis=0).tolist())

    def _colours(self, colours: ByteArray) -> int:
        """Linear light, as glTF asks of vertex colours, in four bytes a vertex."""
        part = np.asarray(colours, dtype=float) / 255
        linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
        every = np.column_stack([(255 * linear).round(), np.full(len(part), 255)]).astype(np.uint8)
        return self._accessor(every, _UINT8, "VEC4", normalized=True)

    def _indices(self, faces: IntArray) -> int:
        return self._accessor(np.ravel(faces), _UINT32, "SCALAR", _ELEMENTS)

    def _accessor(self, table: ArrayLike, kind: int, shape: str, target: int = _ARRAY, **more: object) -> int:
        data = np.asarray(table, dtype=_DTYPES[kind])
        entry: _Entry = {"bufferView": self._view(data.tobytes(), target), "componentType": kind, "count": len(data)}
        self._accessors.append(entry | {"type": shape} | more)
        return len(self._accessors) - 1

    def _view(self, data: bytes, target: int | None) -> int:
        entry: _Entry = {"buffer": 0, "byteOffset": self._length, "byteLength": len(data)}
        self._views.append(entry | ({} if target is None else {"target": target}))
        data += b"\0" * (-len(data) % 4)
        self._parts.append(data)
        self._length += len(data)
        return len(self._views) - 1


def _normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """The mean direction of the faces at each vertex, (n, 3)."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    summed = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(summed, faces[:, i], across)
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    return np.where(length > 1e-12, summed / np.maximum(length, 1e-12), [0.0, 0.0, 1.0])
