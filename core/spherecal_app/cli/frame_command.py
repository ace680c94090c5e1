"""`spherecal frame`: the user's frame of a result, for exports and for measured points."""

import argparse

from spherecal.geometry.user_frame import FrameDefinition, UserFrame
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.output import output_file
from spherecal_rigs.frame_file import frame_entry, write_frame
from spherecal_rigs.framed_rig import define_frame


def frame(options: argparse.Namespace) -> int:
    """`spherecal frame`."""
    x, y, z = options.offset
    made = define_frame(
        options.result, FrameDefinition(options.origin, options.x, options.xy, (x, y, z), tuple(options.turn))
    )
    with output_file(options.output) as place:
        write_frame(made, place)
    answer(options, {"output": options.output, **frame_entry(made)})
    for line in _said(made):
        say(line)
    say(f"Frame in {options.output}.")
    return DONE


def _said(made: UserFrame) -> list[str]:
    lines = [f"User's frame: {made.definition.words()}."]
    if made.distance_mm is not None:
        lines.append(
            f"From the origin to +X {made.distance_mm:.3f} mm; the third place {made.angle_deg:.2f} degrees off."
        )
    if made.origin_sigma_mm is not None and made.axes_sigma_deg is not None:
        origin, axes = (", ".join(f"{s:.2g}" for s in v) for v in (made.origin_sigma_mm, made.axes_sigma_deg))
        lines.append(f"Standard uncertainty: origin {origin} mm along X, Y, Z; axes {axes} degrees about X, Y, Z.")
    return lines
