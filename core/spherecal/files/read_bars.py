"""Reading the reference bars of a session."""

from spherecal.base.messages.values import Phrase
from spherecal.data.session import Bar
from spherecal.files.bar_registry import (
    assumed_of,
    bar_entry,
    find_bar,
    read_certificate,
    read_expansion,
    read_lengths,
    read_marks,
    read_reference_temperature,
    read_serial,
)
from spherecal.files.json_file import JsonValue, json_bytes, unique

_OWN = ("marks", "lengths")
_TEMPERATURE = ("expansion_per_kelvin", "reference_temperature_c")


def read_bars(bars: JsonValue) -> tuple[tuple[Bar, ...], dict[str, bytes]]:
    """The reference bars in order, and the registry's entries that were taken over, by serial.

    InputError where a bar is not as the interface says, or is named by a serial that the registry does not have.
    """
    values = bars.items()
    registered: dict[str, bytes] = {}
    found = tuple(_read_bar(value, registered) for value in values)
    unique(values, [bar.id for bar in found], "id")
    return found, registered


def _read_bar(bar: JsonValue, registered: dict[str, bytes]) -> Bar:
    named = isinstance(bar.value, dict) and bar.value.get("serial") is not None
    required, optional = ("id", "role"), ("serial", "certificate", *_TEMPERATURE)
    f = bar.fields((*required, *(() if named else _OWN)), (*optional, *(_OWN if named else ())))
    serial = read_serial(f["serial"]) if named else None
    if serial is not None and not all(key in f for key in _OWN):
        return _from_registry(f, serial, registered)
    marks = read_marks(f["marks"])
    return Bar(
        id=f["id"].id(),
        role=f["role"].choice("scale", "check"),
        marks=marks,
        lengths=read_lengths(f["lengths"], marks),
        expansion_per_kelvin=read_expansion(f.get("expansion_per_kelvin")),
        reference_temperature_c=read_reference_temperature(f.get("reference_temperature_c")),
        serial=serial,
        certificate=read_certificate(f["certificate"]) if "certificate" in f else None,
        assumed=assumed_of(f),
    )


def _from_registry(f: dict[str, JsonValue], serial: str, registered: dict[str, bytes]) -> Bar:
    """The registry's bar; a bar gives all of its figures itself or none, so that none can contradict another."""
    for key in (*_OWN, *_TEMPERATURE, "certificate"):
        if key in f:
            raise f[key].error(Phrase("problem-beside-serial", {"serial": serial, "fields": [*_OWN, *_TEMPERATURE]}))
    own = find_bar(serial)
    registered[serial] = json_bytes(bar_entry(own))
    return Bar(
        f["id"].id(),
        f["role"].choice("scale", "check"),
        own.marks,
        own.lengths,
        own.expansion_per_kelvin,
        own.reference_temperature_c,
        serial,
        own.certificate,
        own.assumed,
    )
