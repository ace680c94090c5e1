"""capture.json beside a session: what the cameras noted while it was recorded."""

from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from spherecal.files.json_file import JsonValue, read_json

CAPTURE_FILE = "capture.json"
FORMAT = "spherecal/capture"
VERSION = 1
_STAMPS = 2**64  # nanoseconds; some cameras count since 1970


@dataclass(frozen=True)
class CapturedFrame:
    """What a camera noted of one image: its frame number, its own clock, and when the host says it was exposed."""

    frame_id: int | None = None
    time_stamp_ns: int | None = None
    exposed: datetime | None = None


@dataclass(frozen=True)
class CapturedSet:
    """One set of images: its id, when it was taken, and the temperatures of cameras (by id) where they reported them.

    `frames`: what each camera (by id) noted of its image.
    """

    id: str
    taken: datetime | None
    temperatures_c: dict[str, float]
    frames: dict[str, CapturedFrame] = field(default_factory=dict)


def read_captured_sets(session: Path) -> tuple[CapturedSet, ...]:
    """The sets of the capture.json beside a session, none where there is none; InputError where it is broken."""
    path = session / CAPTURE_FILE
    if not path.is_file():
        return ()
    return tuple(_read_set(one) for one in read_json(path, FORMAT, VERSION).fields(("sets",))["sets"].items())


def last_taken(sets: Collection[CapturedSet]) -> datetime | None:
    """When the last of some sets was taken."""
    return max((one.taken for one in sets if one.taken is not None), default=None)


def _read_set(one: JsonValue) -> CapturedSet:
    f = one.fields(("id",), ("cameras", "taken"))
    warm, frames = {}, {}
    for name, about in (f["cameras"].entries() if "cameras" in f else {}).items():
        known = about.fields((), ("temperature_c", "frame_id", "time_stamp_ns", "exposed"))
        if "temperature_c" in known:
            warm[name] = known["temperature_c"].celsius()
        frames[name] = CapturedFrame(
            known["frame_id"].integer() if "frame_id" in known else None,
            known["time_stamp_ns"].integer(-_STAMPS, _STAMPS) if "time_stamp_ns" in known else None,
            known["exposed"].time() if "exposed" in known else None,
        )
    return CapturedSet(f["id"].id(), f["taken"].time() if "taken" in f else None, warm, frames)
