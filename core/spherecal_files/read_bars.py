"""Reading the reference bars of a session."""

from spherecal.base.messages.values import Phrase
from spherecal.data.session import Bar
from spherecal_files.bar_registry import FIGURES, REGISTERED_BAR, SERIAL, find_bar, read_lengths, with_assumed
from spherecal_files.codec import choice, field, identifier, optional, record
from spherecal_files.json_file import JsonValue, json_bytes, unique

_FIGURES = [one.key for one in FIGURES]
_OWN = _FIGURES[:2]
_WHOLE = record(
    "",
    with_assumed(Bar),
    field("id", identifier("Its id.")),
    field("role", choice("Whether it gives the scale or checks it.", ("scale", "check"))),
    optional("serial", SERIAL),
    *FIGURES,
    check=lambda bar, f: read_lengths(f["lengths"], bar.marks),
)


def read_bars(bars: JsonValue) -> tuple[tuple[Bar, ...], dict[str, bytes]]:
    """The reference bars in order, and the registry's entries that were taken over, by serial."""
    values = bars.items()
    registered: dict[str, bytes] = {}
    found = tuple(_read_bar(value, registered) for value in values)
    unique(values, [bar.id for bar in found], "id")
    return found, registered


def _read_bar(bar: JsonValue, registered: dict[str, bytes]) -> Bar:
    if isinstance(bar.value, dict) and bar.value.get("serial") is not None:
        f = bar.fields(("id", "role"), ("serial", *_FIGURES))
        if not all(key in f for key in _OWN):
            return _from_registry(f, SERIAL.read(f["serial"]), registered)
    return _WHOLE.read(bar)


def _from_registry(f: dict[str, JsonValue], serial: str, registered: dict[str, bytes]) -> Bar:
    """The registry's bar; a bar gives all of its figures itself or none, so that none can contradict another."""
    for key in _FIGURES:
        if key in f:
            raise f[key].error(Phrase("problem-beside-serial", {"serial": serial, "fields": _FIGURES[:-1]}))
    own = find_bar(serial)
    registered[serial] = json_bytes(REGISTERED_BAR.entry(own))
    figures = {key: getattr(own, key) for key in (*_FIGURES, "assumed")}
    return Bar(f["id"].id(), f["role"].choice("scale", "check"), serial=serial, **figures)
