"""`spherecal cross-validate`."""

import argparse

from rich.table import Table

from spherecal.cross_validate import cross_validate as run
from spherecal.files.read_session import read_session
from spherecal_app.cli.answer import answer
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.console import out
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_app.cli.progress import shown_progress


def cross_validate(options: argparse.Namespace) -> int:
    """`spherecal cross-validate`."""
    with shown_progress() as context:
        session = read_session(options.session)
        compile_first(context)
        whole, found = run(session, None, context)
    answer(options, found)
    table = Table("left out", "dots", "rms px", "shape rms mm", "size, ppm", box=None)
    for one in found:
        cells = [
            "-" if value is None else text
            for value, text in (
                (one.rms_px, f"{one.rms_px or 0:.4f}"),
                (one.shape_rms_mm, f"{one.shape_rms_mm or 0:.4f}"),
                (one.length_error, f"{1e6 * (one.length_error or 0):.0f}"),
            )
        ]
        table.add_row(one.placement, str(one.dots), *cells)
    out.print(table)
    return DONE if whole.rig.quality.valid else NOT_VALID
