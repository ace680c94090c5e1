"""One measurement from its sets to its end: what the command line, the window and Python call."""

from collections.abc import Callable, Iterable
from pathlib import Path

from spherecal.base.context import Context
from spherecal_measuring.measured_sets import MeasuredSet, ObservedSet
from spherecal_measuring.measurer import Measurer, measure_sets
from spherecal_measuring.series_file import TableKind, write_series


def run(
    sets: Iterable[ObservedSet],
    measurer: Measurer,
    seen: Callable[[MeasuredSet], None],
    output: Path | None = None,
    table: TableKind = "csv",
    context: Context | None = None,
) -> int:
    """Measure all sets, give each to `seen` and record them in `output`; how many there were.

    What ends it early is raised again after the sets so far are written.
    """
    measured = measure_sets(sets, measurer, context)
    if output is not None:
        return write_series(measured, measurer, output, table, seen)
    count = 0
    for one in measured:
        seen(one)
        count += 1
    return count
