"""`spherecal bars`: the owner's reference bars by serial number, from certificates or a table, and where to lay one."""

import argparse
from datetime import date
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal_app.cli.console import answer, output_file, say
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_files import bar_registry
from spherecal_files.json_file import JsonValue, plain_fields
from spherecal_files.read_session import read_session
from spherecal_rigs.bars_table import arrivals, read_bars_table, write_bars_table
from spherecal_rigs.pose_plan import LINE_NAMES, BarMarks, plan_poses
from spherecal_rigs.rig_source import read_source, volume_of
from spherecal_verify.departures import LEAST_LENGTHS
from spherecal_verify.expiry import expiry


def list_bars(options: argparse.Namespace) -> int:
    """`spherecal bars list`."""
    path = options.registry or bar_registry.BAR_REGISTRY.path()
    found = bar_registry.BAR_REGISTRY.read(path)
    answer(options, [entry_with_state(bar) for bar in found.values()])
    if not found:
        say(f"There are no bars in {path}.", "Enter one: spherecal bars add SERIAL --mark ... --length ...")
    for bar in found.values():
        longest = max(bar.lengths, key=lambda length: length.length_mm)
        shown = f"{_nominal(longest.nominal_mm)}{longest.length_mm:.3f} mm, {counted(len(bar.lengths), 'length')}"
        say(f"{bar.serial}: {shown}, {state(bar)[1]}  {bar.description}".rstrip())
    return DONE


def entry_with_state(bar: bar_registry.RegisteredBar) -> dict[str, object]:
    """The bar as the registry has it, with a word on its certificate."""
    return {**bar_registry.REGISTERED_BAR.entry(bar), "state": state(bar)[0]}


def state(bar: bar_registry.RegisteredBar) -> tuple[str, str]:
    """What is said of a bar's certificate: a word for programs, and what a person reads."""
    said = expiry(bar.certificate, date.today())
    if said is not None:
        word, state = said
        return word, ("WARNING: " if word in ("expired", "not-yet") else "") + phrase(state)
    assert bar.certificate is not None
    until = f", valid until {bar.certificate.valid_until}" if bar.certificate.valid_until else ""
    return "ok", f"certificate {bar.certificate.number}{until}"


def show(options: argparse.Namespace) -> int:
    """`spherecal bars show`."""
    bar = bar_registry.find_bar(options.serial, options.registry)
    answer(options, entry_with_state(bar))
    say(f"{bar.serial}  {bar.description}".rstrip(), f"  {state(bar)[1]}")
    if bar.certificate is not None and (bar.certificate.laboratory or bar.certificate.date):
        say(f"  calibrated by {bar.certificate.laboratory or '-'} on {bar.certificate.date or '-'}")
    say(f"  expansion {bar.expansion_per_kelvin:g} per kelvin, lengths at {bar.reference_temperature_c:g} °C")
    for name, mark in bar.marks.items():
        say(f"  mark {name}: {mark.point} of target {mark.target}")
    for x in bar.lengths:
        say(
            f"  {x.from_mark} to {x.to_mark}: {_nominal(x.nominal_mm)}{x.length_mm:.4f} mm, "
            f"U = {x.expanded_uncertainty_mm:g} mm (k = {x.coverage_factor:g})"
        )
    return DONE


def _nominal(nominal_mm: float | None) -> str:
    return "" if nominal_mm is None else f"nominal {nominal_mm:g} mm, certified "


def remove(options: argparse.Namespace) -> int:
    """`spherecal bars remove`."""
    path = options.registry or bar_registry.BAR_REGISTRY.path()
    with bar_registry.BAR_REGISTRY.changing(path):
        gone = bar_registry.find_bar(options.serial, path)
        bar_registry.BAR_REGISTRY.write(
            {key: bar for key, bar in bar_registry.BAR_REGISTRY.read(path).items() if key != gone.serial}, path
        )
    answer(options, {"registry": path, "removed": gone.serial})
    say(f"Bar {gone.serial} is no longer in {path}.")
    return DONE


def add(options: argparse.Namespace) -> int:
    """`spherecal bars add`."""
    path = options.registry or bar_registry.BAR_REGISTRY.path()
    bar = bar_registry.REGISTERED_BAR.read(JsonValue(_entry(options), Path("the bar")))
    with bar_registry.BAR_REGISTRY.changing(path):
        known = bar_registry.BAR_REGISTRY.read(path)
        if options.serial in known and not options.replace:
            raise InputError(Phrase("error-bar-registered", {"serial": options.serial}))
        bar_registry.BAR_REGISTRY.write({**known, bar.serial: bar}, path)
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
    material = {"expansion_per_kelvin": options.expansion, "reference_temperature_c": options.reference_temperature}
    entry |= {key: value for key, value in material.items() if value is not None}
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
    material = plain_fields(bar, "expansion_per_kelvin reference_temperature_c")
    return bar_registry.figures_entry(bar) | material  # what the session only assumes counts as stated here


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
    keys = ("from", "to", "length_mm", "expanded_uncertainty_mm", "coverage_factor")
    return dict(zip(keys, (*parts[:2], *numbers, 2.0), strict=False))


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


def plan(options: argparse.Namespace) -> int:
    """`spherecal bars plan`."""
    if (options.serial is None) == (options.session is None):
        raise InputError(Phrase("error-bar-or-session"))
    if options.session is None:
        known = [bar_registry.find_bar(options.serial, options.registry)]
        marks = [BarMarks.of(bar.serial, bar.lengths) for bar in known]
    else:
        marks = [BarMarks.of(bar.id, bar.lengths) for bar in read_session(options.session).bars if bar.role == "check"]
    source = read_source(options.result)
    box = volume_of(source)
    plan = plan_poses(source.rig, marks, (box.low_mm, box.high_mm))
    answer(options, plan.as_json())
    half = 2 * plan.box.half
    lines = [f"Volume {half[0]:.0f} x {half[1]:.0f} x {half[2]:.0f} mm, space diagonal {plan.box.diagonal_mm:.0f} mm."]
    for pose in plan.poses:
        start, end = (", ".join(f"{x:.0f}" for x in place) for place in (pose.start_mm, pose.end_mm))
        weak = "" if pose.good else "  (two cameras only at a mark)"
        lines.append(
            f"{pose.id}  bar {pose.bar} on {LINE_NAMES[pose.line]}: from near {pose.near[0]} to near {pose.near[1]}, "
            f"({start}) to ({end}) mm; {counted(len(pose.cameras), 'camera')} in sight of all of it{weak}"
        )
    short = [f"{n} ({c})" for n, c in zip(LINE_NAMES, plan.lengths_on_line, strict=True) if c < LEAST_LENGTHS]
    if short:
        lines.append(f"Fewer than {LEAST_LENGTHS} lengths on: {', '.join(short)}.")
    if plan.cameras_left_out:
        names = ", ".join(plan.cameras_left_out)
        lines.append(f"No place in the volume shows a whole bar to {names} and another camera.")
    if plan.missing:
        lines.append(f"No place seen by two cameras on: {', '.join(plan.missing)}.")
    say(*lines)
    return DONE


def import_table(options: argparse.Namespace) -> int:
    """`spherecal bars import`: enter what can be used; say what cannot, line by line. Bars with other figures stay."""
    table = read_bars_table(options.table)
    path = options.registry or bar_registry.BAR_REGISTRY.path()
    with bar_registry.BAR_REGISTRY.changing(path):
        known = bar_registry.BAR_REGISTRY.read(path)
        found = arrivals(table, known)
        entered = found.new + (found.other if options.replace else ())
        if entered:
            bar_registry.BAR_REGISTRY.write({**known, **{bar.serial: bar for bar in entered}}, path)
    kept = () if options.replace else found.other
    groups = {"entered": entered, "same": found.same, "kept": kept}
    record = {
        "registry": path,
        **{name: [bar.serial for bar in of] for name, of in groups.items()},
        "problems": [{"serial": one.serial, "message": phrase(one.message)} for one in table.problems],
        "ignored_columns": table.ignored,
    }
    answer(options, record)
    for bar in entered:
        say(f"{bar.serial}: entered, {counted(len(bar.lengths), 'length')}, {state(bar)[1]}")
    for bar in found.same:
        say(f"{bar.serial}: as it was")
    for bar in kept:
        say(f"{bar.serial}: not entered, the registry has other figures; --replace enters these")
    for problem in table.problems:
        say(f"{problem.serial or '-'}: {phrase(problem.message)}")
    if table.ignored:
        say(f"Columns that are not known and were left out: {', '.join(table.ignored)}")
    count = counted(len(entered), "bar")
    say(f"{count} entered in {path}, {counted(len(table.problems), 'line')} could not be used.")
    return NOT_VALID if table.problems or kept else DONE


def export_table(options: argparse.Namespace) -> int:
    """`spherecal bars export`."""
    path = options.registry or bar_registry.BAR_REGISTRY.path()
    found = bar_registry.BAR_REGISTRY.read(path)
    with output_file(options.table) as place:
        write_bars_table(tuple(found.values()), place)
    answer(options, {"registry": path, "output": options.table, "bars": list(found)})
    say(f"{counted(len(found), 'bar')} of {path} written to {options.table}.")
    return DONE
