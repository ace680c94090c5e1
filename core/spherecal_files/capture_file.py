"""capture.json beside a session: what the cameras noted while it was recorded."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from spherecal.data.session import CapturedFrame, CapturedSet
from spherecal_files.codec import (
    FileFormat,
    celsius,
    entries,
    field,
    identifier,
    integer,
    items,
    optional,
    record,
    serial,
    time,
    unread,
)
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


_FRAME = record(
    "",
    dict,
    optional("frame_id", integer("Number of the frame.")),
    optional("time_stamp_ns", integer("The camera's own clock.", -_STAMPS, _STAMPS)),
    optional("exposed", time("When it was exposed.")),
    optional("temperature_c", celsius("The camera's temperature in degrees Celsius.")),
    unread("exposure_us", "Exposure time."),
    unread("gain_db", "Gain."),
    unread("pixel_format", "Pixel format."),
    unread("bits", "Significant bits."),
    unread("averaged", "How many frames were averaged."),
    unread("dots", "Dots that were found."),
    unread("motion_px", "How far they moved between frames."),
    unread("noise_px", "Their noise between frames."),
)
CAMERAS = items(
    "The cameras.", record("", dict, field("id", identifier("Its id.")), field("serial", serial("Its serial number.")))
)
_SET = record(
    "",
    _set,
    field("id", identifier("The placement or bar pose.")),
    replace(field("taken", time("When it was taken.")), is_needed=False),  # files of the first versions lack both
    replace(field("images", entries("Image files by camera.", named_file(""))), is_needed=False),
    unread("attempts", "How often it was tried."),
    unread("seconds", "How long it took."),
    unread("spread_s", "Between the first and the last exposure."),
    unread("late", "Cameras whose images came too late."),
    unread("missing", "Cameras without an image, with the cause."),
    optional("cameras", entries("What was recorded with the image of each camera.", _FRAME)),
)
SETS = items(
    "The sets of images, in the order in which they were taken.",
    replace(_SET, schema=_SET.schema | {"required": ["id", "taken", "images"]}),
)
PLANNED = items(
    "The sets that are to be taken, in order.",
    record(
        "",
        dict,
        field("id", identifier("The placement or bar pose.")),
        optional("bar", identifier("The bar of a pose.")),
        optional("temperature_c", celsius("Temperature of the bar in degrees Celsius.")),
    ),
)
CAPTURE = FileFormat(
    FORMAT,
    CAPTURE_FILE,
    "When and how a session was captured, beside its session.json.",
    record(
        "",
        dict,
        unread("source", "The source of the images: `kind`, `label`, `simulated`."),
        optional("planned", PLANNED),
        field("cameras", CAMERAS),
        field("sets", SETS),
    ),
)
