"""`spherecal guide`: where to put the ball next."""

import argparse

from rich.markup import escape
from rich.table import Table

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.calibrate import calibrate
from spherecal.detect.session_images import observed
from spherecal.files.read_session import read_session
from spherecal_app.cli.answer import answer
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.console import out
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.progress import shown_progress
from spherecal_rigs.next_placement import Guidance, advise


def guide(options: argparse.Namespace) -> int:
    """`spherecal guide`."""
    if options.picture is not None and options.picture.suffix.lower() != ".png":
        raise InputError(Phrase("error-picture-kind", {"file": options.picture}))
    with shown_progress() as context:
        recorded = read_session(options.session)
        compile_first(context)
        session = observed(recorded, context)
        calibration = calibrate(session, None, context)
        guidance = advise(session, calibration, context)
    if guidance is None:
        raise InputError(Phrase("error-no-network-yet", {"folder": options.session}))
    if options.picture is not None:
        from spherecal_documents.report.guidance_picture import save_guidance_picture  # here, since it loads matplotlib

        save_guidance_picture(calibration.rig, guidance, calibration.spheres[0].radius_mm, options.picture)
    answer(options, _as_json(guidance))
    out.print(escape(guidance.words()))
    table = Table("place (mm, rig frame)", "turn", "towards", "cameras", "500 mm, k = 2", box=None)
    for c in guidance.candidates[:6]:
        place = ", ".join(f"{x:.0f}" for x in c.centre_mm)
        turn = "none" if c.axis is None else f"{c.turn_deg:.0f} deg about " + ", ".join(f"{x:.2f}" for x in c.axis)
        table.add_row(place, turn, c.nearest, str(c.cameras), f"{c.expanded_mm:.3f} mm")
    out.print(table)
    return DONE


def _as_json(guidance: Guidance) -> dict[str, object]:
    return {
        "length_mm": 500.0,
        "coverage_factor": 2.0,
        "now_mm": guidance.now_mm,
        "words": guidance.words(),
        "candidates": [
            {
                "centre_mm": [round(float(x), 3) for x in c.centre_mm],
                "turn_deg": c.turn_deg,
                "axis": None if c.axis is None else [round(float(x), 6) for x in c.axis],
                "expanded_mm": c.expanded_mm,
                "cameras": c.cameras,
                "nearest": c.nearest,
                "fewest_dots": c.fewest_dots,
            }
            for c in guidance.candidates
        ],
    }
