"""`spherecal targets export|sheet`."""

import argparse

from rich.markup import escape

from spherecal.data.findings import counted
from spherecal.files.target_set_file import write_target_set
from spherecal.targets.family import make_target_set
from spherecal.targets.marker_set import make_marker_set, marker_count
from spherecal.targets.target_set import TargetSet
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import out, say
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.output import output_file
from spherecal_documents.sheets.sticker_sheet import scaled, write_sheet


def export(options: argparse.Namespace) -> int:
    """`spherecal targets export`."""
    made = _wanted(options)
    with output_file(options.output) as place:
        write_target_set(place, made)
    return _done(options, made)


def sheet(options: argparse.Namespace) -> int:
    """`spherecal targets sheet`."""
    if options.board is not None:
        from spherecal_app.api import write_board_sheet  # here, since it loads the whole engine

        with output_file(options.output) as place:
            drawn = write_board_sheet(options.board, place, options.page)
        answer(options, {"output": options.output, "board": drawn})
        say(f"Board in {options.output}: --board {drawn}")
        return DONE
    made = _wanted(options)
    with output_file(options.output) as place:
        write_sheet(place, made, options.page)
    return _done(options, made)


def _wanted(options: argparse.Namespace) -> TargetSet:
    """The targets or markers that were asked for, in the size that the printed rulers have."""
    if options.markers is not None:
        made = _markers(options)
    else:
        count = 200 if options.count is None else options.count
        first = 1 if options.first_id is None else options.first_id
        made = make_target_set(count, options.size, options.polarity or "light-on-dark", first)
    return scaled(made, *options.measured) if options.measured else made


def _done(options: argparse.Namespace, made: TargetSet) -> int:
    """Say what was written."""
    record = {"output": options.output, "family": made.family, "size_mm": made.size_mm, "ids": list(made.layouts)}
    answer(options, record)
    out.print(f"{counted(len(made.layouts), 'target')} in {escape(str(options.output))}.")
    return DONE


def _markers(options: argparse.Namespace) -> TargetSet:
    """The markers that `--markers` names: from the first id, as many as asked for."""
    first = options.first_id or 0
    count = marker_count(options.markers) - first if options.count is None else options.count
    ids = range(first, first + count)
    return make_marker_set(options.markers, options.size, ids, options.polarity or "dark-on-light")
