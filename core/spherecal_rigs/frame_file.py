"""frame.json: a user's frame, written whole, checked when read."""

from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal.files.codec import (
    FileFormat,
    choice,
    field,
    items,
    name,
    number,
    numbers,
    optional,
    record,
    software,
    text,
)
from spherecal.files.json_file import JsonValue
from spherecal.files.rig_file import rotation
from spherecal.geometry.user_frame import TURNS, FrameDefinition, UserFrame


def _check_places(made: FrameDefinition, value: JsonValue) -> None:
    if (made.origin, made.x, made.xy).count(None) not in (0, 3):
        raise value.error(Phrase("problem-three-places"))


_DEFINITION = record(
    "How it was defined; `origin`, `x` and `xy` are all given or none.",
    FrameDefinition,
    optional("origin", text("The place of the origin.")),
    optional("x", text("A place on the x axis.")),
    optional("xy", text("A place in the xy plane.")),
    optional("offset_mm", numbers("Shift of the origin.", 3)),
    optional("turns", items("Turns by 90 degrees.", choice("", TURNS))),
).checked(_check_places)
_SIGMAS = items("", number("", 0), length=3).mapped(np.array)
FIELDS = (
    field("rotation", rotation("x_user = R x_world + t.")),
    field("translation_mm", numbers("The same.", 3).mapped(np.array)),
    field("definition", _DEFINITION),
    optional("reference_camera", name("The reference camera of the calibration.")),
    optional("input_sha256", text("`input_sha256` of the calibration.")),
    optional("distance_mm", number("Distance from the origin to the place on the x axis.", 0)),
    optional("angle_deg", number("Between the two places, seen from the origin.", 0, 180, "°")),
    optional("origin_sigma_mm", _SIGMAS.described("Standard uncertainties of the origin.")),
    optional("axes_sigma_deg", _SIGMAS.described("Standard uncertainties of the axes.")),
)
FRAME = FileFormat(
    "spherecal/frame",
    "frame.json",
    "The user's frame.",
    record("", UserFrame, *FIELDS, software()),
    ("The rotation is orthogonal within 1e-5.",),
    more="exports.md#the-users-frame",
)


def write_frame(frame: UserFrame, path: Path) -> None:
    """Write the file whole."""
    write_file_whole(path, FRAME.bytes(frame))


def frame_entry(frame: UserFrame) -> dict[str, Any]:
    """A frame as files have it."""
    return record("", UserFrame, *FIELDS).entry(frame)


def read_frame(path: Path) -> UserFrame:
    """The frame in a file."""
    return FRAME.read(path)
