"""The options of `bars`."""

import argparse

from spherecal_app.cli.parsers.shared import flag, number, path, repeated, result, word
from spherecal_app.cli.parsing import Add, commands_below


def add_bars(add: Add) -> None:
    """`spherecal bars list|show|remove|plan|import|export|add`."""
    bars = add("bars", "Your reference bars by serial number, with their certificates; where to lay one to verify.")
    below = commands_below(bars)

    def action(name: str, text: str) -> argparse.ArgumentParser:
        one = below(name, text)
        path(one, "--registry", "FILE", "the registry, instead of your own (or $SPHERECAL_BARS)")
        return one

    action("list", "List all bars with their longest length and the state of their certificates.")
    for name, text in (
        ("show", "Show one bar with its marks and certified lengths."),
        ("remove", "Remove a bar from the registry."),
    ):
        action(name, text).add_argument("serial", metavar="SERIAL", help="its serial number")
    plan = action("plan", "Plan poses of a bar to verify a rig: seven lines over its volume (VDI/VDE 2634-1, reduced).")
    result(plan, "result or profile folder, or rig.json")
    plan.add_argument("serial", metavar="SERIAL", nargs="?", help="a bar of the registry")
    path(plan, "--session", "SESSION", "use the check bars of this session instead")
    table = action("import", "Enter the bars of a table (CSV): one certified length a line, columns by their headings.")
    path(table, "table", "FILE", "CSV as a spreadsheet writes it; `bars export` writes an example")
    flag(table, "--replace", "replace bars that the registry has with other figures")
    export = action("export", "Write all bars as a table (CSV).")
    path(export, "table", "FILE", "the file to write, - for standard output")
    _add_add(action("add", "Enter a bar, or with --replace new figures of one, from its certificate."))


def _add_add(add: argparse.ArgumentParser) -> None:
    add.add_argument("serial", metavar="SERIAL", help="the bar's serial number")
    path(add, "--from-session", "SESSION", "take marks and lengths from a bar of this session")
    word(add, "--bar", "ID", "the bar's id in the session (needed if there are several)")
    text = "a mark and its target's number; the point is 'centre' unless given; may be given again"
    repeated(add, "--mark", "NAME=TARGET[:POINT]", text)
    text = "certified length between two marks, its expanded uncertainty in mm and k (2); may be given again"
    repeated(add, "--length", "A,B,MM,U[,K]", text)
    text = "nominal length between two marks, such as A1,A2,500; certified lengths that differ by over 1 %% are refused"
    repeated(add, "--nominal", "A,B,MM", text)
    number(add, "--expansion", "PER_KELVIN", "coefficient of expansion, such as 1.15e-5 for steel")
    number(add, "--reference-temperature", "C", "temperature of the certified lengths in degrees Celsius (default 20)")
    word(add, "--certificate", "NUMBER", "the certificate's number")
    word(add, "--laboratory", "NAME", "the laboratory that issued it")
    word(add, "--date", "YYYY-MM-DD", "date of the certificate")
    word(add, "--valid-until", "YYYY-MM-DD", "when the bar must be calibrated again")
    word(add, "--description", "TEXT", "a description of the bar", default="")
    flag(add, "--replace", "replace a bar with this serial number")
