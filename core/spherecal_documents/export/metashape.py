"""Agisoft Metashape's cameras XML: centre as offset from the image's middle, poses camera to chunk, metres.

Formulas of the Agisoft Metashape User Manual, appendix "Camera models", with the image spanning 0 .. w:

    u = w/2 + cx + x' f + x' b1 + y' b2
    v = h/2 + cy + y' f

There x' holds p1 (r^2 + 2 x^2) + 2 p2 x y, so that p1, p2 are OpenCV's p2, p1. Its k4 is the factor of r^8, where our
k4 is a denominator.
"""

import re
from collections.abc import Mapping
from pathlib import Path, PureWindowsPath
from xml.etree import ElementTree

import numpy as np

from spherecal.base.errors import InputError
from spherecal_documents.export import file_cameras
from spherecal_documents.export.format import Format
from spherecal_files.json_file import read_bytes

_PIXEL_CENTRE = 0.5
_MOST_BYTES = 8 << 20
_TERMS = ("f", "cx", "cy", "b1", "k1", "k2", "k3", "p1", "p2")
_NO_TERMS = ("resolution", "date", "covariance", "black_level", "sensitivity", "pixel_width", "pixel_height")
_TRANSFORM = (("rotation", file_cameras.numbers(np.eye(3), " ")), ("translation", "0 0 0"), ("scale", "1"))


def _add(parent: ElementTree.Element, name: str, text: str | None = None, **attributes: str) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, name, attributes)
    child.text = text
    return child


def _write(rig: file_cameras.FileRig) -> Mapping[str, str]:
    document = ElementTree.Element("document", version="2.0.0")
    source = re.sub("-+", "-", rig.source).replace(">", " ")  # without what would end a comment
    document.append(ElementTree.Comment(f" {source} "))
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
    for i, (camera, name) in enumerate(zip(rig.cameras, rig.safe_names(), strict=True)):
        _sensor(sensors, str(i), camera)
        entry = _add(cameras, "camera", id=str(i), sensor_id=str(i), component_id="0", label=name, enabled="true")
        _add(entry, "transform", file_cameras.numbers(camera.placed.inverse().matrix(), " "))
        _add(entry, "orientation", "1")
    ElementTree.indent(document)
    return {"": ElementTree.tostring(document, encoding="unicode", xml_declaration=False) + "\n"}


def _sensor(sensors: ElementTree.Element, key: str, camera: file_cameras.FileCamera) -> None:
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
        _add(calibration, name, file_cameras.number(value))


def _read(path: Path) -> file_cameras.Reading:
    """A document of cameras: ElementTree knows no external entities, and expat limits how far internal ones expand."""
    try:
        document = ElementTree.fromstring(read_bytes(path, _MOST_BYTES))
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: is not valid XML ({error}).") from None
    chunks = [chunk for chunk in document.iter("chunk") if chunk.find("cameras") is not None]
    if len(chunks) > 1:
        raise InputError(f"{path}: holds {len(chunks)} chunks, each with cameras.", "Export the cameras of one chunk.")
    if not chunks:
        raise InputError(
            f"{path}: has no chunk with cameras.", "In Metashape: File, Export, Export Cameras, Agisoft XML."
        )
    try:
        return _cameras_of(path, chunks[0])
    except ValueError as error:
        problem = str(error).replace("could not convert string to float:", "not a number:")
        raise InputError(f"{path}: is not a Metashape file that can be read ({problem}).") from None


def _cameras_of(path: Path, chunk: ElementTree.Element) -> file_cameras.Reading:
    sensors = {sensor.get("id"): sensor for sensor in chunk.iterfind("sensors//sensor")}
    placed: dict[str | None, list[file_cameras.FileCamera]] = {}  # by component: each has a frame of its own
    lost: dict[str, str] = {}
    for entry in chunk.iterfind("cameras//camera"):  # they may be in groups
        label = entry.get("label") or f"camera{entry.get('id')}"
        name = PureWindowsPath(label).stem if {"/", "\\"} & set(label) else label  # some label by the image's path
        found = entry.findtext("transform")
        if found is None:
            master = entry.get("master_id")  # of a multi-camera system: its pose is in its sensor
            lost[name] = (
                "is not aligned" if master is None else f"has no pose of its own, only one from camera {master}"
            )
            continue
        sensor = sensors.get(entry.get("sensor_id"))
        if sensor is None:
            raise InputError(f'{path}: camera "{name}" is of a sensor that the file does not have.')
        size, lens = _read_sensor(sensor, f'{path}: camera "{name}"')
        matrix = _floats(found, 16).reshape(4, 4)
        component = entry.get("component_id")
        scale, place = _placement(chunk, component)
        centre = scale * place.rotation @ matrix[:3, 3] + place.translation
        pose = file_cameras.Pose(place.rotation @ matrix[:3, :3], centre).inverse()
        placed.setdefault(component, []).append(file_cameras.FileCamera(name, size, lens, pose))
    largest = max(placed, key=lambda component: len(placed[component]), default=None)
    others = {c.id: f"is of component {key}, not linked" for key, own in placed.items() if key != largest for c in own}
    notes = () if chunk.find("transform") is not None else ("its chunk has no scale, so lengths are arbitrary",)
    return file_cameras.Reading(tuple(placed.get(largest, ())), {**lost, **others}, notes=notes)


def _placement(chunk: ElementTree.Element, component: str | None) -> tuple[float, file_cameras.Pose]:
    """Chunk (or component) to world: x_world = scale * rotation @ x + translation."""
    own = chunk.find(f"components/component[@id='{component}']/transform") if component is not None else None
    transform = own if own is not None and own.find("scale") is not None else chunk.find("transform")
    if transform is None:
        return 1.0, file_cameras.Pose(np.eye(3), np.zeros(3))
    if len(transform) == 0:  # as one matrix
        matrix = _floats(transform.text or "", 16).reshape(4, 4)
        scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
        if not scale > 0:
            raise ValueError("its transform has no scale above 0")
        return scale, file_cameras.Pose(matrix[:3, :3] / scale, matrix[:3, 3])
    turn, shift, scale = (_floats(transform.findtext(name) or text, text.count(" ") + 1) for name, text in _TRANSFORM)
    if not scale[0] > 0:
        raise ValueError("its transform has no scale above 0")
    return float(scale[0]), file_cameras.Pose(turn.reshape(3, 3), shift)


def _floats(text: str, count: int) -> np.ndarray:
    values = np.array(text.split(), dtype=float)
    if values.size != count or not np.isfinite(values).all():
        raise ValueError(f"{count} finite numbers were expected, not {values.size}")
    return values


def _read_sensor(sensor: ElementTree.Element, where: str) -> tuple[tuple[int, int], np.ndarray]:
    """Image size and lens of a sensor as adjusted; a term that is not there was not fitted and is 0."""
    kind = sensor.get("type", "frame")
    calibrations = sensor.findall("calibration")
    adjusted = [one for one in calibrations if one.get("class") == "adjusted"] or calibrations
    if not adjusted:
        raise InputError(f"{where}: its sensor has no calibration.")
    kinds = {kind, adjusted[-1].get("type", kind)}
    if kinds != {"frame"}:
        raise InputError(
            f"{where}: its lens is of the type {' '.join(sorted(kinds - {'frame'}))}, which cannot be used."
        )
    f = {entry.tag: float(entry.text or 0) for entry in adjusted[-1] if entry.tag not in _NO_TERMS}
    if more := sorted(name for name, value in f.items() if name not in _TERMS and value != 0):
        raise InputError(
            f"{where}: its lens has {', '.join(more)}, which no lens model here has.",
            "Optimise the cameras without these terms, and export again.",
        )
    resolution = sensor.find("resolution")
    resolution = adjusted[-1].find("resolution") if resolution is None else resolution
    width, height = (int((resolution.get(side) if resolution is not None else "") or 0) for side in ("width", "height"))
    if min(width, height) <= 0:
        raise InputError(f"{where}: its sensor has no resolution.")
    term = {name: f.get(name, 0.0) for name in _TERMS}
    centre = width / 2 + term["cx"] - _PIXEL_CENTRE, height / 2 + term["cy"] - _PIXEL_CENTRE
    matrix = [[term["f"] + term["b1"], 0, centre[0]], [0, term["f"], centre[1]], [0, 0, 1]]
    coefficients = [term[name] for name in ("k1", "k2", "p2", "p1", "k3")]
    return (width, height), file_cameras.lens_vector(matrix, coefficients, False, where)


METASHAPE = Format("metashape", "Agisoft Metashape XML", 5, ("m",), _write, _read, ids=file_cameras.FileRig.safe_names)
