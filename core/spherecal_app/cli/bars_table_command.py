"""`spherecal bars import|export`: the registry's bars as a table."""

import argparse

from spherecal.base.messages.catalogue import phrase
from spherecal.data.findings import counted
from spherecal.files.bar_registry import BAR_REGISTRY
from spherecal_app.cli.answer import answer
from spherecal_app.cli.bars_command import state
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_app.cli.output import output_file
from spherecal_rigs.bars_table import arrivals, read_bars_table, write_bars_table


def import_table(options: argparse.Namespace) -> int:
    """`spherecal bars import`: enter what can be used; say what cannot, line by line. Bars with other figures stay."""
    table = read_bars_table(options.table)
    path = options.registry or BAR_REGISTRY.path()
    with BAR_REGISTRY.changing(path):
        known = BAR_REGISTRY.read(path)
        found = arrivals(table, known)
        entered = found.new + (found.other if options.replace else ())
        if entered:
            BAR_REGISTRY.write({**known, **{bar.serial: bar for bar in entered}}, path)
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
    path = options.registry or BAR_REGISTRY.path()
    found = BAR_REGISTRY.read(path)
    with output_file(options.table) as place:
        write_bars_table(tuple(found.values()), place)
    answer(options, {"registry": path, "output": options.table, "bars": list(found)})
    say(f"{counted(len(found), 'bar')} of {path} written to {options.table}.")
    return DONE
