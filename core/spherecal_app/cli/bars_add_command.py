"""`spherecal bars add`: a bar from its certificate, by options or out of a session."""

import argparse
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.files.bar_registry import BAR_REGISTRY, CERTIFICATE, LENGTHS, read_registered_bar
from spherecal.files.json_file import JsonValue
from spherecal.files.read_session import read_session
from spherecal_app.cli.answer import answer
from spherecal_app.cli.bars_command import entry_with_state, state
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE


def add(options: argparse.Namespace) -> int:
    """`spherecal bars add`."""
    path = options.registry or BAR_REGISTRY.path()
    bar = read_registered_bar(JsonValue(_entry(options), Path("the bar")))
    with BAR_REGISTRY.changing(path):
        known = BAR_REGISTRY.read(path)
        if options.serial in known and not options.replace:
            raise InputError(Phrase("error-bar-registered", {"serial": options.serial}))
        BAR_REGISTRY.write({**known, bar.serial: bar}, path)
    answer(options, {"registry": path, "bar": entry_with_state(bar)})
    say(f"Bar {bar.serial} is in {path}: {counted(len(bar.lengths), 'length')}, {state(bar)[1]}.")
    return DONE


def _entry(options: argparse.Namespace) -> dict[str, object]:
    """The bar as a file would have it, so that it is checked as a file is."""
    entry: dict[str, object] = {"serial": options.serial, "description": options.description}
    if options.from_session is not None:
        entry |= _of_session(options.from_session, options.bar)
    if options.mark:
        entry["marks"] = dict(_mark(text) for text in options.mark)
    if options.length:
        entry["lengths"] = [_length(text) for text in options.length]
    lengths = entry.get("lengths", [])
    assert isinstance(lengths, list)
    for text in options.nominal:
        _set_nominal(lengths, text)
    for key, value in (
        ("expansion_per_kelvin", options.expansion),
        ("reference_temperature_c", options.reference_temperature),
    ):
        if value is not None:
            entry[key] = value
    for key, option in (("marks", "--mark"), ("lengths", "--length"), ("expansion_per_kelvin", "--expansion")):
        if key not in entry:
            raise InputError(Phrase("error-bar-lacks", {"option": option}))
    certificate = {
        "number": options.certificate, "laboratory": options.laboratory, "date": options.date,
        "valid_until": options.valid_until,
    }  # fmt: skip
    if any(certificate.values()):
        if options.certificate is None:
            raise InputError(Phrase("error-certificate-number"))
        entry["certificate"] = certificate
    return entry


def _of_session(folder: Path, wanted: str | None) -> dict[str, object]:
    found = read_session(folder).bars
    bar = next((bar for bar in found if bar.id == wanted), found[0] if len(found) == 1 and wanted is None else None)
    if bar is None:
        values = {"folder": folder, "bar": wanted, "bars": [bar.id for bar in found] or Phrase("nothing")}
        raise InputError(Phrase("error-session-no-bar" if wanted else "error-session-bars", values))
    entry: dict[str, object] = {
        "marks": {name: {"target": mark.target, "point": mark.point} for name, mark in bar.marks.items()},
        "lengths": LENGTHS.entry(bar.lengths),
        "expansion_per_kelvin": bar.expansion_per_kelvin,
        "reference_temperature_c": bar.reference_temperature_c,
    }
    return entry if bar.certificate is None else {**entry, "certificate": CERTIFICATE.entry(bar.certificate)}


def _mark(text: str) -> tuple[str, dict[str, object]]:
    name, _, place = text.partition("=")
    target, _, point = place.partition(":")
    if not name or not target.isdecimal():
        raise InputError(Phrase("error-no-mark", {"text": text}))
    return name, {"target": int(target), "point": point or "centre"}


def _length(text: str) -> dict[str, object]:
    parts = text.split(",")
    try:
        numbers = [float(part) for part in parts[2:]]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise InputError(Phrase("error-no-length", {"text": text}))
    return {
        "from": parts[0],
        "to": parts[1],
        "length_mm": numbers[0],
        "expanded_uncertainty_mm": numbers[1],
        "coverage_factor": numbers[2] if len(numbers) == 3 else 2.0,
    }


def _set_nominal(lengths: list[dict[str, object]], text: str) -> None:
    """Give the length between two marks its nominal value."""
    parts = text.split(",")
    try:
        nominal_mm = float(parts[2]) if len(parts) == 3 else None
    except ValueError:
        nominal_mm = None
    if nominal_mm is None:
        raise InputError(Phrase("error-no-nominal", {"text": text}))
    own = [length for length in lengths if {length["from"], length["to"]} == set(parts[:2])]
    if not own:
        raise InputError(Phrase("error-nominal-alone", {"text": text}))
    for length in own:
        length["nominal_mm"] = nominal_mm
