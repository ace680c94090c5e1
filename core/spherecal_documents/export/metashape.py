"""Agisoft Metashape's cameras XML: centre as offset from the image's middle, poses camera to chunk, metres.

Formulas of the Agisoft Metashape User Manual, appendix "Camera models", with the image spanning 0 .. w:

    u = w/2 + cx + x' f + x' b1 + y' b2
    v = h/2 + cy + y' f

There x' holds p1 (r^2 + 2 x^2) + 2 p2 x y, so that p1, p2 are OpenCV's p2, p1. Its k4 is the factor of r^8, where our
k4 is a denominator.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from spherecal.base.errors import InputError
from spherecal.files.json_file import read_bytes
from spherecal.geometry.camera import N_INTRINSICS
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, number, numbers, safe_names
from spherecal_documents.export.format import Format

_PIXEL_CENTRE = 0.5
_MOST_BYTES = 8 << 20
_TRANSFORM = (("rotation", numbers(np.eye(3), " ")), ("translation", "0 0 0"), ("scale", "1"))


def _comment(text: str) -> str:
    """The text without what would end a comment: no two hyphens in a row, none at the end."""
    return f" {re.sub('-+', '-', text).replace('>', ' ')} "


def _add(parent: ElementTree.Element, name: str, text: str | None = None, **attributes: str) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, name, attributes)
    child.text = text
    return child


def _write(rig: FileRig) -> Mapping[str, str]:
    document = ElementTree.Element("document", version="2.0.0")
    document.append(ElementTree.Comment(_comment(rig.source)))
    chunk = _add(document, "chunk", label="rig", enabled="true")
    count = str(len(rig.cameras))
    sensors = _add(chunk, "sensors", next_id=count)
    components = _add(chunk, "components", next_id="1", active_id="0")
    component = _add(components, "component", id="0", label="Component 1")
    cameras = _add(chunk, "cameras", next_id=count, next_group_id="0")
    for place in (component, chunk):  # the chunk's frame is the rig's world, in metres
        transform = _add(place, "transform")
        for name, text in _TRANSFORM:
            _add(transform, name, text, **({"locked": "true"} if name != "translation" else {}))
    for i, (camera, name) in enumerate(zip(rig.cameras, safe_names([c.id for c in rig.cameras]), strict=True)):
        _sensor(sensors, str(i), camera)
        entry = _add(cameras, "camera", id=str(i), sensor_id=str(i), component_id="0", label=name, enabled="true")
        _add(entry, "transform", numbers(camera.placed.inverse().matrix(), " "))
        _add(entry, "orientation", "1")
    ElementTree.indent(document)
    return {"": ElementTree.tostring(document, encoding="unicode", xml_declaration=False) + "\n"}


def _sensor(sensors: ElementTree.Element, key: str, camera: FileCamera) -> None:
    width, height = camera.size
    fu, fv, u0, v0, k1, k2, p1, p2, k3 = camera.intrinsics[:9]
    sensor = _add(sensors, "sensor", id=key, label=camera.id, type="frame")
    size = {"width": str(width), "height": str(height)}
    _add(sensor, "resolution", **size)
    values = {
        "f": fv,
        "cx": u0 + _PIXEL_CENTRE - width / 2,
        "cy": v0 + _PIXEL_CENTRE - height / 2,
        "b1": fu - fv,
        "k1": k1, "k2": k2, "k3": k3, "p1": p2, "p2": p1,
    }  # fmt: skip
    calibration = _add(sensor, "calibration", **{"type": "frame", "class": "adjusted"})
    _add(calibration, "resolution", **size)
    for name, value in values.items():
        _add(calibration, name, number(value))


def _read(path: Path) -> list[FileCamera]:
    """Our own file again: ElementTree knows no external entities, and expat limits how far internal ones expand."""
    try:
        document = ElementTree.fromstring(read_bytes(path, _MOST_BYTES))
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: is not valid XML ({error}).") from None
    try:
        return _cameras_of(document)
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: is not a Metashape file as this program writes it ({error}).") from None


def _cameras_of(document: ElementTree.Element) -> list[FileCamera]:
    lenses = {sensor.get("id"): _read_sensor(sensor) for sensor in document.iterfind("chunk/sensors/sensor")}
    cameras = []
    for entry in document.iterfind("chunk/cameras/camera"):
        size, lens = lenses[entry.get("sensor_id")]
        matrix = np.array((entry.findtext("transform") or "").split(), dtype=float).reshape(4, 4)
        cameras.append(FileCamera(entry.get("label", ""), size, lens, Pose(matrix[:3, :3], matrix[:3, 3]).inverse()))
    return cameras


def _read_sensor(sensor: ElementTree.Element) -> tuple[tuple[int, int], np.ndarray]:
    f = {entry.tag: float(entry.text or 0) for entry in sensor.iterfind("calibration/*") if entry.tag != "resolution"}
    resolution = sensor.find("resolution")
    if resolution is None:
        raise KeyError("resolution")
    width, height = int(resolution.get("width", 0)), int(resolution.get("height", 0))
    lens = np.zeros(N_INTRINSICS)
    lens[:9] = (
        f["f"] + f["b1"],
        f["f"],
        width / 2 + f["cx"] - _PIXEL_CENTRE,
        height / 2 + f["cy"] - _PIXEL_CENTRE,
        f["k1"],
        f["k2"],
        f["p2"],
        f["p1"],
        f["k3"],
    )
    return (width, height), lens


def _ids(rig: FileRig) -> list[str]:
    return safe_names([camera.id for camera in rig.cameras])


FORMAT = Format("metashape", "Agisoft Metashape XML", 5, ("m",), _write, _read, ids=_ids)
