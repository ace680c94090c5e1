"""The owner's reference bars by serial number: marks, certified lengths, certificate; one JSON file per user.

A session's bar may name a serial instead of its lengths; they are then taken from here when the session is read.
"""

import math
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Bar, BarLength, Certificate, Mark
from spherecal.files.atomic import make_parent, write_file_whole
from spherecal.files.json_file import JsonValue, json_bytes, printable, read_json, unique
from spherecal.files.lock import locked

FORMAT = "spherecal/bars"
VERSION = 1
# An expanded uncertainty above 5 % of its length is no certificate; micrometres given for millimetres are.
_WORST_RELATIVE_UNCERTAINTY = 0.05
# Rounded to whole millimetres a length of 50 mm is still called by what it is within 1 %; a slip in the digits before
# the millimetres, or inches for millimetres, is further away.
_WORST_RELATIVE_NOMINAL = 0.01
# From about 1 (k = 1) to Student's t for one degree of freedom, 95.45 %.
_COVERAGE_FACTORS = (1.0, 14.0)
# Plastics expand by 2e-4 per kelvin at most, some composites shrink by 1e-5; 11.5 instead of 1.15e-5 is refused.
_EXPANSIONS_PER_KELVIN = (-1e-4, 1e-3)
_REFERENCE_TEMPERATURES_C = (-50.0, 100.0)
# A shop needs a few weeks to send a bar away and have it back.
_SOON_DAYS = 30
_PER_BAR = (
    ("serial", "marks", "lengths"),
    ("description", "expansion_per_kelvin", "reference_temperature_c", "certificate"),
)
# Of a bar whose material is not stated: steel's, and anything from none (carbon fibre, Invar) to twice that (aluminium;
# verify/uncertainty.py).
ASSUMED_EXPANSION_PER_KELVIN = 1.15e-5
ASSUMED_TEMPERATURE_C = 20.0  # ISO 1
ASSUMED_FACTOR = 2.0
# Of a length whose uncertainty is not stated: the limits of a class II rule, a + b L (Directive 2014/32/EU, MI-008), as
# +-limits of an even distribution.
_RULE_MM, _RULE_RELATIVE = 0.3, 0.2e-3


@dataclass(frozen=True)
class RegisteredBar:
    """A bar as its owner knows it."""

    serial: str
    marks: dict[str, Mark]
    lengths: tuple[BarLength, ...]
    expansion_per_kelvin: float
    reference_temperature_c: float = 20.0
    description: str = ""
    certificate: Certificate | None = None
    assumed: tuple[str, ...] = ()


def registry_path() -> Path:
    """The file: `SPHERECAL_BARS`, else bars.json in the user's settings."""
    from platformdirs import user_config_path

    named = os.environ.get("SPHERECAL_BARS")
    return Path(named) if named else user_config_path("spherecal", appauthor=False) / "bars.json"


def read_registry(path: Path | None = None) -> dict[str, RegisteredBar]:
    """The bars by serial, in the file's order, none where there is no file; InputError where it is broken."""
    path = path or registry_path()
    if not path.exists():
        return {}
    values = read_json(path, FORMAT, VERSION).fields(("bars",))["bars"].items()
    bars = [read_registered_bar(value) for value in values]
    unique(values, [bar.serial for bar in bars], "serial")
    return {bar.serial: bar for bar in bars}


def read_registered_bar(value: JsonValue) -> RegisteredBar:
    """One bar of the registry; InputError names the place and what is wrong."""
    f = value.fields(*_PER_BAR)
    marks = read_marks(f["marks"])
    return RegisteredBar(
        serial=read_serial(f["serial"]),
        marks=marks,
        lengths=read_lengths(f["lengths"], marks),
        expansion_per_kelvin=read_expansion(f.get("expansion_per_kelvin")),
        reference_temperature_c=read_reference_temperature(f.get("reference_temperature_c")),
        description=f["description"].text() if "description" in f else "",
        certificate=read_certificate(f["certificate"]) if "certificate" in f else None,
        assumed=assumed_of(f),
    )


def find_bar(serial: str, path: Path | None = None) -> RegisteredBar:
    """The bar with this serial; InputError lists those there are."""
    bars = read_registry(path)
    if serial not in bars:
        raise InputError(
            Phrase("error-no-registered-bar", {"file": path or registry_path(), "serial": printable(serial)}),
            Phrase("registered-bars", {"bars": list(bars)}) if bars else Phrase("registered-none"),
        )
    return bars[serial]


def changing_registry(path: Path) -> AbstractContextManager[None]:
    """Hold the registry from reading to writing, so that no other program's change is lost; OutputError."""
    make_parent(path, Phrase("error-set-bars"))
    return locked(path)


def write_registry(bars: Mapping[str, RegisteredBar], path: Path | None = None) -> None:
    """Write the file whole; OutputError where that fails."""
    path = path or registry_path()
    document = {"format": FORMAT, "version": VERSION, "bars": [bar_entry(bar) for bar in bars.values()]}
    make_parent(path, Phrase("error-set-bars"))
    write_file_whole(path, json_bytes(document))


def bar_entry(bar: RegisteredBar) -> dict[str, Any]:
    """A bar as the file has it."""
    entry: dict[str, Any] = {
        "serial": bar.serial,
        "description": bar.description,
        "marks": {name: {"target": mark.target, "point": mark.point} for name, mark in bar.marks.items()},
        "lengths": [length_entry(length) for length in bar.lengths],
        **temperature_entry(bar),
    }
    if bar.certificate is not None:
        entry["certificate"] = certificate_entry(bar.certificate)
    return entry


def temperature_entry(bar: RegisteredBar | Bar) -> dict[str, Any]:
    """A bar's expansion and reference temperature as files have them, without what was assumed."""
    entry = {"expansion_per_kelvin": bar.expansion_per_kelvin, "reference_temperature_c": bar.reference_temperature_c}
    return {key: value for key, value in entry.items() if key not in bar.assumed}


def length_entry(length: BarLength) -> dict[str, Any]:
    """A certified length as files have it, without what was assumed."""
    entry: dict[str, Any] = {
        "from": length.from_mark,
        "to": length.to_mark,
        "length_mm": length.length_mm,
        "expanded_uncertainty_mm": length.expanded_uncertainty_mm,
        "coverage_factor": length.coverage_factor,
    }
    entry = {key: value for key, value in entry.items() if key not in length.assumed}
    return entry if length.nominal_mm is None else {**entry, "nominal_mm": length.nominal_mm}


def certificate_entry(certificate: Certificate) -> dict[str, Any]:
    """A certificate as files have it."""
    entry = {
        "number": certificate.number,
        "laboratory": certificate.laboratory or None,
        "date": certificate.date and certificate.date.isoformat(),
        "valid_until": certificate.valid_until and certificate.valid_until.isoformat(),
    }
    return {key: value for key, value in entry.items() if value is not None}


def read_serial(value: JsonValue) -> str:
    """A bar's serial number: a name, or a whole number as its digits."""
    return replace(value, value=value.serial()).name()


def read_marks(marks: JsonValue) -> dict[str, Mark]:
    """A bar's marks by name."""
    found = {}
    for name, mark in marks.entries().items():
        f = mark.fields(("target", "point"))
        found[name] = Mark(f["target"].integer(), f["point"].name())
    return found


def read_lengths(lengths: JsonValue, marks: Mapping[str, Mark]) -> tuple[BarLength, ...]:
    """A bar's certified lengths, at least one."""
    return tuple(_read_length(length, marks) for length in lengths.items(least=1))


def _read_length(length: JsonValue, marks: Mapping[str, Mark]) -> BarLength:
    optional = ("expanded_uncertainty_mm", "coverage_factor")
    f = length.fields(("from", "to", "length_mm"), (*optional, "nominal_mm"))
    ends = [f[end].name() for end in ("from", "to")]
    for end, name in zip(("from", "to"), ends, strict=True):
        if name not in marks:
            raise f[end].error(Phrase("problem-unknown-mark", {"mark": name}))
    if marks[ends[0]] == marks[ends[1]]:
        raise f["to"].error(Phrase("problem-same-mark"))
    length_mm = f["length_mm"].positive("mm")
    most = _WORST_RELATIVE_UNCERTAINTY * length_mm
    factor = f["coverage_factor"].number(*_COVERAGE_FACTORS) if "coverage_factor" in f else ASSUMED_FACTOR
    return BarLength(
        ends[0],
        ends[1],
        length_mm,
        f["expanded_uncertainty_mm"].number(0, most, Phrase("mm-of-length"))
        if "expanded_uncertainty_mm" in f
        else factor * (_RULE_MM + _RULE_RELATIVE * length_mm) / math.sqrt(3),
        factor,
        _read_nominal(f["nominal_mm"], length_mm) if "nominal_mm" in f else None,
        tuple(key for key in optional if key not in f),
    )


def _read_nominal(value: JsonValue, certified_mm: float) -> float:
    nominal_mm = value.positive("mm")
    if abs(certified_mm - nominal_mm) > _WORST_RELATIVE_NOMINAL * nominal_mm:
        raise value.error(Phrase("problem-nominal", {"nominal_mm": nominal_mm, "certified_mm": certified_mm}))
    return nominal_mm


def assumed_of(fields: Mapping[str, JsonValue]) -> tuple[str, ...]:
    """Which figures about temperature a bar does not state."""
    return tuple(key for key in ("expansion_per_kelvin", "reference_temperature_c") if key not in fields)


def read_expansion(value: JsonValue | None) -> float:
    """A coefficient of linear expansion; steel's where none is stated."""
    if value is None:
        return ASSUMED_EXPANSION_PER_KELVIN
    return value.number(*_EXPANSIONS_PER_KELVIN, unit="1/K")


def read_reference_temperature(value: JsonValue | None) -> float:
    """The temperature that certified lengths refer to; 20 degrees Celsius where none is stated."""
    return ASSUMED_TEMPERATURE_C if value is None else value.number(*_REFERENCE_TEMPERATURES_C, unit="°C")


def read_certificate(value: JsonValue) -> Certificate:
    """A certificate's number, laboratory and dates; a text alone is its number."""
    if isinstance(value.value, str):
        return Certificate(value.text())
    f = value.fields(("number",), ("laboratory", "date", "valid_until"))
    issued = _read_date(f["date"]) if "date" in f else None
    until = _read_date(f["valid_until"]) if "valid_until" in f else None
    if issued is not None and until is not None and until < issued:
        raise f["valid_until"].error(Phrase("problem-before-date", {"date": issued.isoformat()}))
    return Certificate(f["number"].text(), f["laboratory"].text() if "laboratory" in f else "", issued, until)


def _read_date(value: JsonValue) -> date:
    try:
        return date.fromisoformat(value.text())
    except ValueError:
        raise value.error(Phrase("problem-date")) from None


def expiry(certificate: Certificate | None, today: date) -> tuple[str, Phrase] | None:
    """`expired`, `expires-soon`, `not-yet` or `no-certificate` with its words; None where nothing is to be said."""
    if certificate is None:
        return "no-certificate", Phrase("has-no-certificate")
    if certificate.date is not None and certificate.date > today:
        return "not-yet", Phrase("certificate-from", {"date": str(certificate.date)})
    until = certificate.valid_until
    if until is None:
        return None
    values = {"number": certificate.number, "date": str(until)}
    if until < today:
        return "expired", Phrase("certificate-until", values)
    if (until - today).days <= _SOON_DAYS:
        return "expires-soon", Phrase("certificate-still-until", values)
    return None
