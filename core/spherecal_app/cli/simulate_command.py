"""`spherecal simulate`."""

import argparse

from rich.markup import escape

from spherecal.data.findings import counted
from spherecal.files.atomic import SESSION
from spherecal_app.cli.console import answer, check_output_folder, out
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.progress import shown_progress
from spherecal_sim.render_session import render_session
from spherecal_sim.session_folder import write_session
from spherecal_sim.simulate_session import simulate_session


def simulate(options: argparse.Namespace) -> int:
    """`spherecal simulate`."""
    check_output_folder(options.output, SESSION)
    with shown_progress() as context:
        if options.observations_only:
            context.report("simulating", 0.0)
            session, truth = simulate_session(options.preset, options.seed)
            write_session(session, truth, options.output)
        else:
            truth = render_session(options.preset, options.seed, options.output, context)
    record = {
        "session": options.output,
        "preset": options.preset,
        "cameras": [camera.id for camera in truth.cameras],
        "placements": truth.placements,
        "bar_poses": [pose.id for pose in truth.bar_poses],
    }
    answer(options, record)
    out.print(
        f"Simulated {options.preset}: {counted(len(truth.cameras), 'camera')}, "
        f"{counted(len(truth.placements), 'placement')}, {counted(len(truth.bar_poses), 'bar pose')}, in "
        f"{escape(str(options.output))}."
    )
    return DONE
