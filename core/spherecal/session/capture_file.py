"""capture.json beside a session: what the cameras noted while it was recorded."""

from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from spherecal.session.json_file import JsonValue, read_json

CAPTURE_FILE = "capture.json"
FORMAT = "spherecal/capture"
VERSION = 1


@dataclass(frozen=True)
class CapturedSet:
    """One set of images: its id, when it was taken, and the temperatures of cameras (by id) where they told them."""

    id: str
    taken: datetime | None
    temperatures_c: dict[str, float]


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
    warm = {}
    for name, about in (f["cameras"].entries() if "cameras" in f else {}).items():
        known = about.fields((), ("temperature_c",))
        if "temperature_c" in known:
            warm[name] = known["temperature_c"].celsius()
    return CapturedSet(f["id"].id(), f["taken"].time() if "taken" in f else None, warm)
