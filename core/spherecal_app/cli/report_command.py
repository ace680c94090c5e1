"""`spherecal report`."""

import argparse

from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.progress import shown_progress
from spherecal_documents.report.write_report import write_report
from spherecal_documents.scene.picture import scene_picture


def report(options: argparse.Namespace) -> int:
    """`spherecal report`."""
    o = options
    with shown_progress() as context:
        context.report("drawing the report", 0.0)
        write_report(o.result, o.output, o.session, o.page, o.issuer, o.language, render=scene_picture)
    answer(options, {"output": options.output})
    say(f"Report in {options.output}.")
    return DONE
