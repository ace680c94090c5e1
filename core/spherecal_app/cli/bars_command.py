"""`spherecal bars list|show|remove`: the owner's reference bars by serial number."""

import argparse
from datetime import date

from spherecal.base.messages.catalogue import phrase
from spherecal.data.findings import counted
from spherecal.files.bar_registry import BAR_REGISTRY, RegisteredBar, bar_entry, expiry, find_bar
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE


def list_bars(options: argparse.Namespace) -> int:
    """`spherecal bars list`."""
    path = options.registry or BAR_REGISTRY.path()
    found = BAR_REGISTRY.read(path)
    answer(options, [entry_with_state(bar) for bar in found.values()])
    if not found:
        say(f"There are no bars in {path}.", "Enter one: spherecal bars add SERIAL --mark ... --length ...")
    for bar in found.values():
        longest = max(bar.lengths, key=lambda length: length.length_mm)
        shown = f"{_nominal(longest.nominal_mm)}{longest.length_mm:.3f} mm, {counted(len(bar.lengths), 'length')}"
        say(f"{bar.serial}: {shown}, {state(bar)[1]}  {bar.description}".rstrip())
    return DONE


def entry_with_state(bar: RegisteredBar) -> dict[str, object]:
    """The bar as the registry has it, with a word on its certificate."""
    return {**bar_entry(bar), "state": state(bar)[0]}


def state(bar: RegisteredBar) -> tuple[str, str]:
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
    bar = find_bar(options.serial, options.registry)
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
    path = options.registry or BAR_REGISTRY.path()
    with BAR_REGISTRY.changing(path):
        gone = find_bar(options.serial, path)
        BAR_REGISTRY.write({key: bar for key, bar in BAR_REGISTRY.read(path).items() if key != gone.serial}, path)
    answer(options, {"registry": path, "removed": gone.serial})
    say(f"Bar {gone.serial} is no longer in {path}.")
    return DONE
