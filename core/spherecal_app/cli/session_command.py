"""`spherecal session new`: a session folder of images or videos that another program recorded."""

import argparse

from rich.markup import escape

from spherecal.data.findings import counted
from spherecal_app.api import new_session
from spherecal_app.cli.console import answer, figures, out, say, shown_progress
from spherecal_app.cli.exit_codes import DONE
from spherecal_files.json_file import plain_fields


def new(options: argparse.Namespace) -> int:
    """`spherecal session new`."""
    with shown_progress() as context:
        made = new_session(
            options.folder, options.images, pattern=options.pattern, board=options.board, targets=options.targets,
            sphere_diameter_mm=options.sphere, spacing_mm=options.spacing, focal_length_mm=options.focal_length,
            pixel_pitch_um=options.pixel_pitch, lens_model=options.lens, frames=options.frames, context=context,
        )  # fmt: skip
    answer(
        options,
        {
            "layout": made.layout,
            "pattern": made.pattern,
            "cameras": [
                {
                    **plain_fields(camera, "id images image_size"),
                    "focal_px": round(camera.focal_px, 3),
                    **plain_fields(camera, "focal_from model serial"),
                }
                for camera in made.cameras
            ],
            "placements": [placement.id for placement in made.session.placements],
            "assumed": list(made.assumed),
            "missing": list(made.missing),
            "left_out": list(made.left_out),
        },
    )
    places = [placement.id for placement in made.session.placements]
    span = places[0] if len(places) == 1 else f"{places[0]} ... {places[-1]}"
    say(
        f"{counted(len(made.cameras), 'camera')}, {counted(len(places), 'placement')} ({span}), read as "
        f"{made.layout}: {made.pattern}"
    )
    table = figures("camera", "images", "size px", "f px")
    for heading in ("from", "model", "serial"):
        table.add_column(heading)
    for c in made.cameras:
        size = f"{c.image_size[0]} x {c.image_size[1]}"
        words = (c.focal_from, c.model or "-", c.serial or "-")
        table.add_row(escape(c.id), str(c.images), size, f"{c.focal_px:.0f}", *map(escape, words))
    out.print(table)
    for heading, lines in (("Assumed", made.assumed), ("Missing", made.missing)):
        for line in lines:
            say(f"{heading}: {line}.")
    if made.left_out:
        shown = ", ".join(made.left_out[:4]) + (", ..." if len(made.left_out) > 4 else "")
        say(f"Left out: {counted(len(made.left_out), 'file')} ({shown}).")
    say(f"Session in {options.folder}.")
    return DONE
