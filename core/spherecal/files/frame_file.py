"""frame.json: a user's frame, written whole, checked when read."""

from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal.files.json_file import JsonValue, finite, json_bytes, read_json, software_entry
from spherecal.files.rig_file import read_rotation
from spherecal.geometry.user_frame import TURNS, FrameDefinition, UserFrame

FORMAT = "spherecal/frame"
VERSION = 1
_OPTIONAL = (
    "reference_camera", "input_sha256", "distance_mm", "angle_deg", "origin_sigma_mm", "axes_sigma_deg"
)  # fmt: skip


def write_frame(frame: UserFrame, path: Path) -> None:
    """Write the file whole; OutputError where that fails."""
    document = {"format": FORMAT, "version": VERSION, **frame_entry(frame), "software": software_entry(None)}
    write_file_whole(path, json_bytes(document))


def frame_entry(frame: UserFrame) -> dict[str, Any]:
    """A frame as files have it."""
    d = frame.definition
    return {
        "rotation": finite(frame.rotation),
        "translation_mm": finite(frame.translation_mm),
        "definition": {
            "origin": d.origin,
            "x": d.x,
            "xy": d.xy,
            "offset_mm": list(d.offset_mm),
            "turns": list(d.turns),
        },
        "reference_camera": frame.reference_camera,
        "input_sha256": frame.input_sha256,
        "distance_mm": finite(frame.distance_mm),
        "angle_deg": finite(frame.angle_deg),
        "origin_sigma_mm": finite(frame.origin_sigma_mm),
        "axes_sigma_deg": finite(frame.axes_sigma_deg),
    }


def read_frame(path: Path) -> UserFrame:
    """The frame in a file; InputError names the place that is not as docs/formats.md says."""
    f = read_json(path, FORMAT, VERSION).fields(("rotation", "translation_mm", "definition"), _OPTIONAL)
    return UserFrame(
        read_rotation(f["rotation"]),
        np.array(f["translation_mm"].numbers(3)),
        _definition(f["definition"]),
        f["reference_camera"].name() if "reference_camera" in f else None,
        f["input_sha256"].text() if "input_sha256" in f else "",
        f["distance_mm"].number(0) if "distance_mm" in f else None,
        f["angle_deg"].number(0, 180, "°") if "angle_deg" in f else None,
        _sigma(f.get("origin_sigma_mm")),
        _sigma(f.get("axes_sigma_deg")),
    )


def _sigma(value: JsonValue | None) -> FloatArray | None:
    return None if value is None else np.array([item.number(0) for item in value.items(3)])


def _definition(value: JsonValue) -> FrameDefinition:
    f = value.fields((), ("origin", "x", "xy", "offset_mm", "turns"))
    names = {key: f[key].text() for key in ("origin", "x", "xy") if key in f}
    if len(names) not in (0, 3):
        raise value.error(Phrase("problem-three-places"))
    x, y, z = f["offset_mm"].numbers(3) if "offset_mm" in f else (0.0, 0.0, 0.0)
    turns = tuple(item.choice(*TURNS) for item in f["turns"].items()) if "turns" in f else ()
    return FrameDefinition(names.get("origin"), names.get("x"), names.get("xy"), (x, y, z), turns)
