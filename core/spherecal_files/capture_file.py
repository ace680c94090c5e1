"""capture.json beside a session: what the cameras noted while it was recorded."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from spherecal.data.session import CapturedFrame, CapturedSet
from spherecal_files import codec
from spherecal_files.json_file import read_json
from spherecal_files.session_file import named_file

CAPTURE_FILE = "capture.json"
FORMAT = "spherecal/capture"
VERSION = 1
_STAMPS = 2**64  # nanoseconds; some cameras count since 1970


def read_captured_sets(session: Path) -> tuple[CapturedSet, ...]:
    """The sets of the capture.json beside a session; none where there is none."""
    path = session / CAPTURE_FILE
    if not path.is_file():
        return ()
    return SETS.read(read_json(path, FORMAT, VERSION).fields(("sets",))["sets"])


def last_taken(sets: Collection[CapturedSet]) -> datetime | None:
    """When the last of some sets was taken."""
    return max((one.taken for one in sets if one.taken is not None), default=None)


def _set(id: str, taken: datetime | None = None, cameras: Mapping[str, Any] | None = None, **_: Any) -> CapturedSet:
    noted = {} if cameras is None else cameras
    warm = {camera: one["temperature_c"] for camera, one in noted.items() if "temperature_c" in one}
    frames = {
        camera: CapturedFrame(one.get("frame_id"), one.get("time_stamp_ns"), one.get("exposed"))
        for camera, one in noted.items()
    }
    return CapturedSet(id, taken, warm, frames)


_FRAME = codec.record(
    "",
    dict,
    codec.optional("frame_id", codec.integer("Number of the frame.")),
    codec.optional("time_stamp_ns", codec.integer("The camera's own clock.", -_STAMPS, _STAMPS)),
    codec.optional("exposed", codec.time("When it was exposed.")),
    codec.optional("temperature_c", codec.celsius("The camera's temperature in degrees Celsius.")),
    codec.unread("exposure_us", "Exposure time."),
    codec.unread("gain_db", "Gain."),
    codec.unread("pixel_format", "Pixel format."),
    codec.unread("bits", "Significant bits."),
    codec.unread("averaged", "How many frames were averaged."),
    codec.unread("dots", "Dots that were found."),
    codec.unread("motion_px", "How far they moved between frames."),
    codec.unread("noise_px", "Their noise between frames."),
)
CAPTURED_CAMERAS = codec.items(
    "The cameras.",
    codec.record(
        "",
        dict,
        codec.field("id", codec.identifier("Its id.")),
        codec.field("serial", codec.serial("Its serial number.")),
    ),
)
_SET = codec.record(
    "",
    _set,
    codec.field("id", codec.identifier("The placement or bar pose.")),
    replace(
        codec.field("taken", codec.time("When it was taken.")), is_needed=False
    ),  # files of the first versions lack both
    replace(codec.field("images", codec.entries("Image files by camera.", named_file(""))), is_needed=False),
    codec.unread("attempts", "How often it was tried."),
    codec.unread("seconds", "How long it took."),
    codec.unread("spread_s", "Between the first and the last exposure."),
    codec.unread("late", "Cameras whose images came too late."),
    codec.unread("missing", "Cameras without an image, with the cause."),
    codec.optional("cameras", codec.entries("What was recorded with the image of each camera.", _FRAME)),
)
SETS = codec.items(
    "The sets of images, in the order in which they were taken.",
    replace(_SET, schema=_SET.schema | {"required": ["id", "taken", "images"]}),
)
PLANNED = codec.items(
    "The sets that are to be taken, in order.",
    codec.record(
        "",
        dict,
        codec.field("id", codec.identifier("The placement or bar pose.")),
        codec.optional("bar", codec.identifier("The bar of a pose.")),
        codec.optional("temperature_c", codec.celsius("Temperature of the bar in degrees Celsius.")),
    ),
)
CAPTURE = codec.FileFormat(
    FORMAT,
    CAPTURE_FILE,
    "When and how a session was captured, beside its session.json.",
    codec.record(
        "",
        dict,
        codec.unread("source", "The source of the images: `kind`, `label`, `simulated`."),
        codec.optional("planned", PLANNED),
        codec.field("cameras", CAPTURED_CAMERAS),
        codec.field("sets", SETS),
    ),
)
