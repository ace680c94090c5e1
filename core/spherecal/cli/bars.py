"""`spherecal bars list|add|show|remove|import|export|plan`: the owner's reference bars, and where to lay one."""

import argparse
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spherecal.base.messages.values import Phrase
from spherecal.cli.answer import answer
from spherecal.data.findings import counted

if TYPE_CHECKING:
    from spherecal.files.bar_registry import RegisteredBar


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's actions and their options."""
    bars = add("bars", "Your reference bars by serial number, with their certificates; where to lay one to verify.")
    actions = bars.add_subparsers(dest="action", required=True, metavar="ACTION")

    def action(name: str, text: str) -> argparse.ArgumentParser:
        one = actions.add_parser(name, help=text, description=text)
        one.add_argument("--registry", type=Path, metavar="FILE", help="instead of your own (or $SPHERECAL_BARS)")
        return one

    action("list", "All bars with their longest length and the state of their certificates.")
    show = action("show", "One bar with its marks and certified lengths.")
    show.add_argument("serial", metavar="SERIAL", help="its serial number")
    remove = action("remove", "Take a bar out of the registry.")
    remove.add_argument("serial", metavar="SERIAL", help="its serial number")
    plan = action("plan", "Where to lay a bar to verify a rig: seven lines over its volume (VDI/VDE 2634-1, reduced).")
    plan.add_argument("result", type=Path, metavar="RESULT", help="result or profile folder, or rig.json")
    plan.add_argument("serial", metavar="SERIAL", nargs="?", help="a bar of the registry")
    plan.add_argument("--session", type=Path, metavar="SESSION", help="take the check bars of this session instead")
    table = action("import", "Enter the bars of a table (CSV): one certified length a line, columns by their headings.")
    table.add_argument("table", type=Path, metavar="FILE", help="as a spreadsheet writes it; export gives a model")
    table.add_argument("--replace", action="store_true", help="also bars that the registry has with other figures")
    export = action("export", "Write all bars as such a table.")
    export.add_argument("table", type=Path, metavar="FILE", help="the file to write, - for standard output")
    _add_add(action("add", "Enter a bar, or with --replace new figures of one, from its certificate."))


def _add_add(add: argparse.ArgumentParser) -> None:
    add.add_argument("serial", metavar="SERIAL", help="the bar's serial number")
    add.add_argument("--from-session", type=Path, metavar="SESSION", help="take marks and lengths from its bar ...")
    add.add_argument("--bar", metavar="ID", help="... of this id (needed where it has several)")
    add.add_argument(
        "--mark",
        action="append",
        default=[],
        metavar="NAME=TARGET[:POINT]",
        help="a mark and its target's number; the point is 'centre' unless given; may be given again",
    )
    add.add_argument(
        "--length",
        action="append",
        default=[],
        metavar="A,B,MM,U[,K]",
        help="certified length between two marks, its expanded uncertainty in mm and k (2); may be given again",
    )
    add.add_argument(
        "--nominal",
        action="append",
        default=[],
        metavar="A,B,MM",
        help="what that length is called by, such as A1,A2,500; a certified length more than 1 %% from it is refused",
    )
    add.add_argument("--expansion", type=float, metavar="PER_KELVIN", help="coefficient, such as 1.15e-5 for steel")
    add.add_argument("--reference-temperature", type=float, metavar="C", help="of the lengths (default 20)")
    add.add_argument("--certificate", metavar="NUMBER", help="the certificate's number")
    add.add_argument("--laboratory", metavar="NAME", help="who issued it")
    add.add_argument("--date", metavar="YYYY-MM-DD", help="of the certificate")
    add.add_argument("--valid-until", metavar="YYYY-MM-DD", help="when the bar must be calibrated again")
    add.add_argument("--description", default="", metavar="TEXT", help="what the bar is, for people")
    add.add_argument("--replace", action="store_true", help="also if the registry has this serial already")


def bars(options: argparse.Namespace) -> int:
    """`spherecal bars`."""
    from spherecal.cli.main import DONE

    act = {
        "list": _list, "show": _show, "add": _add, "remove": _remove, "import": _import, "export": _export,
        "plan": _plan,
    }[options.action]  # fmt: skip
    code = act(options)
    return DONE if code is None else code


def _say(*lines: str) -> None:
    from spherecal.cli.commands import out

    for line in lines:
        out.print(line, markup=False)


def _list(options: argparse.Namespace) -> None:
    from spherecal.files.bar_registry import read_registry, registry_path

    path = options.registry or registry_path()
    found = read_registry(path)
    answer(options, [_entry_with_state(bar) for bar in found.values()])
    if not found:
        _say(f"There are no bars in {path}.", "Enter one: spherecal bars add SERIAL --mark ... --length ...")
    for bar in found.values():
        longest = max(bar.lengths, key=lambda length: length.length_mm)
        shown = f"{_nominal(longest.nominal_mm)}{longest.length_mm:.3f} mm, {counted(len(bar.lengths), 'length')}"
        _say(f"{bar.serial}: {shown}, {_state(bar)[1]}  {bar.description}".rstrip())


def _entry_with_state(bar: "RegisteredBar") -> dict[str, Any]:
    from spherecal.files.bar_registry import bar_entry

    return {**bar_entry(bar), "state": _state(bar)[0]}


def _state(bar: "RegisteredBar") -> tuple[str, str]:
    """A word for programs, and what a person reads."""
    from spherecal.base.messages.catalogue import phrase
    from spherecal.files.bar_registry import expiry

    said = expiry(bar.certificate, date.today())
    if said is not None:
        word, state = said
        return word, ("WARNING: " if word in ("expired", "not-yet") else "") + phrase(state)
    assert bar.certificate is not None
    until = f", valid until {bar.certificate.valid_until}" if bar.certificate.valid_until else ""
    return "ok", f"certificate {bar.certificate.number}{until}"


def _show(options: argparse.Namespace) -> None:
    from spherecal.files.bar_registry import find_bar

    bar = find_bar(options.serial, options.registry)
    answer(options, _entry_with_state(bar))
    _say(f"{bar.serial}  {bar.description}".rstrip(), f"  {_state(bar)[1]}")
    if bar.certificate is not None and (bar.certificate.laboratory or bar.certificate.date):
        _say(f"  calibrated by {bar.certificate.laboratory or '-'} on {bar.certificate.date or '-'}")
    _say(f"  expansion {bar.expansion_per_kelvin:g} per kelvin, lengths at {bar.reference_temperature_c:g} °C")
    for name, mark in bar.marks.items():
        _say(f"  mark {name}: {mark.point} of target {mark.target}")
    for x in bar.lengths:
        _say(
            f"  {x.from_mark} to {x.to_mark}: {_nominal(x.nominal_mm)}{x.length_mm:.4f} mm, "
            f"U = {x.expanded_uncertainty_mm:g} mm (k = {x.coverage_factor:g})"
        )


def _nominal(nominal_mm: float | None) -> str:
    return "" if nominal_mm is None else f"nominal {nominal_mm:g} mm, certified "


def _add(options: argparse.Namespace) -> None:
    from spherecal.base.errors import InputError
    from spherecal.files.bar_registry import (
        changing_registry,
        read_registered_bar,
        read_registry,
        registry_path,
        write_registry,
    )
    from spherecal.files.json_file import JsonValue

    path = options.registry or registry_path()
    bar = read_registered_bar(JsonValue(_entry(options), Path("the bar")))
    with changing_registry(path):
        known = read_registry(path)
        if options.serial in known and not options.replace:
            raise InputError(Phrase("error-bar-registered", {"serial": options.serial}))
        write_registry({**known, bar.serial: bar}, path)
    answer(options, {"registry": path, "bar": _entry_with_state(bar)})
    _say(f"Bar {bar.serial} is in {path}: {counted(len(bar.lengths), 'length')}, {_state(bar)[1]}.")


def _entry(options: argparse.Namespace) -> dict[str, Any]:
    """The bar as a file would have it, so that it is checked as a file is."""
    from spherecal.base.errors import InputError

    entry: dict[str, Any] = {"serial": options.serial, "description": options.description}
    if options.from_session is not None:
        entry |= _of_session(options.from_session, options.bar)
    if options.mark:
        entry["marks"] = dict(_mark(text) for text in options.mark)
    if options.length:
        entry["lengths"] = [_length(text) for text in options.length]
    for text in options.nominal:
        _set_nominal(entry.get("lengths", []), text)
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


def _of_session(folder: Path, wanted: str | None) -> dict[str, Any]:
    from spherecal.base.errors import InputError
    from spherecal.files.bar_registry import CERTIFICATE, LENGTHS
    from spherecal.files.read_session import read_session

    found = read_session(folder).bars
    bar = next((bar for bar in found if bar.id == wanted), found[0] if len(found) == 1 and wanted is None else None)
    if bar is None:
        values = {"folder": folder, "bar": wanted, "bars": [bar.id for bar in found] or Phrase("nothing")}
        raise InputError(Phrase("error-session-no-bar" if wanted else "error-session-bars", values))
    entry: dict[str, Any] = {
        "marks": {name: {"target": mark.target, "point": mark.point} for name, mark in bar.marks.items()},
        "lengths": LENGTHS.entry(bar.lengths),
        "expansion_per_kelvin": bar.expansion_per_kelvin,
        "reference_temperature_c": bar.reference_temperature_c,
    }
    return entry if bar.certificate is None else {**entry, "certificate": CERTIFICATE.entry(bar.certificate)}


def _mark(text: str) -> tuple[str, dict[str, Any]]:
    from spherecal.base.errors import InputError

    name, _, place = text.partition("=")
    target, _, point = place.partition(":")
    if not name or not target.isdecimal():
        raise InputError(Phrase("error-no-mark", {"text": text}))
    return name, {"target": int(target), "point": point or "centre"}


def _length(text: str) -> dict[str, Any]:
    from spherecal.base.errors import InputError

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


def _set_nominal(lengths: list[dict[str, Any]], text: str) -> None:
    """Give the length between two marks its nominal value."""
    from spherecal.base.errors import InputError

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


def _remove(options: argparse.Namespace) -> None:
    from spherecal.files.bar_registry import changing_registry, find_bar, read_registry, registry_path, write_registry

    path = options.registry or registry_path()
    with changing_registry(path):
        gone = find_bar(options.serial, path)
        write_registry({key: bar for key, bar in read_registry(path).items() if key != gone.serial}, path)
    answer(options, {"registry": path, "removed": gone.serial})
    _say(f"Bar {gone.serial} is no longer in {path}.")


def _import(options: argparse.Namespace) -> int:
    """Enter what can be used; say what cannot, line by line. Bars with other figures stay as they are."""
    from spherecal.base.messages.catalogue import phrase
    from spherecal.cli.main import DONE, NOT_VALID
    from spherecal.files.bar_registry import changing_registry, read_registry, registry_path, write_registry
    from spherecal.files.bars_table import arrivals, read_bars_table

    table = read_bars_table(options.table)
    path = options.registry or registry_path()
    with changing_registry(path):
        known = read_registry(path)
        found = arrivals(table, known)
        entered = found.new + (found.other if options.replace else ())
        if entered:
            write_registry({**known, **{bar.serial: bar for bar in entered}}, path)
    kept = () if options.replace else found.other
    record = {
        "registry": path,
        **{
            name: [bar.serial for bar in of]
            for name, of in (("entered", entered), ("same", found.same), ("kept", kept))
        },
        "problems": [{"serial": one.serial, "message": phrase(one.message)} for one in table.problems],
        "ignored_columns": table.ignored,
    }
    answer(options, record)
    for bar in entered:
        _say(f"{bar.serial}: entered, {counted(len(bar.lengths), 'length')}, {_state(bar)[1]}")
    for bar in found.same:
        _say(f"{bar.serial}: as it was")
    for bar in kept:
        _say(f"{bar.serial}: not entered, the registry has other figures; --replace enters these")
    for problem in table.problems:
        _say(f"{problem.serial or '-'}: {phrase(problem.message)}")
    if table.ignored:
        _say(f"Columns that are not known and were left out: {', '.join(table.ignored)}")
    count = counted(len(entered), "bar")
    _say(f"{count} entered in {path}, {counted(len(table.problems), 'line')} could not be used.")
    return NOT_VALID if table.problems or kept else DONE


def _export(options: argparse.Namespace) -> None:
    from spherecal.cli.parsing import output_file
    from spherecal.files.bar_registry import read_registry, registry_path
    from spherecal.files.bars_table import write_bars_table

    path = options.registry or registry_path()
    found = read_registry(path)
    with output_file(options.table) as place:
        write_bars_table(tuple(found.values()), place)
    answer(options, {"registry": path, "output": options.table, "bars": list(found)})
    _say(f"{counted(len(found), 'bar')} of {path} written to {options.table}.")


def _plan(options: argparse.Namespace) -> None:
    from spherecal.base.errors import InputError
    from spherecal.files.bar_registry import find_bar
    from spherecal.files.read_session import read_session
    from spherecal.profile.source import read_source, volume_of
    from spherecal.verify.pose_plan import BarMarks, plan_poses, plan_words

    if (options.serial is None) == (options.session is None):
        raise InputError(Phrase("error-bar-or-session"))
    if options.session is None:
        known = [find_bar(options.serial, options.registry)]
        marks = [BarMarks.of(bar.serial, bar.lengths) for bar in known]
    else:
        marks = [BarMarks.of(bar.id, bar.lengths) for bar in read_session(options.session).bars if bar.role == "check"]
    source = read_source(options.result)
    box = volume_of(source)
    plan = plan_poses(source.rig, marks, (box.low_mm, box.high_mm))
    answer(options, plan.as_json())
    _say(*plan_words(plan))
