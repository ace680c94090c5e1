"""`spherecal frame`: the user's frame of a result, for exports and for measured points."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from spherecal.geometry.user_frame import UserFrame


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's options."""
    frame = add("frame", "Define the user's frame of a result: origin, +X and the XY plane by three places.")
    frame.add_argument("result", type=Path, metavar="RESULT", help="the result folder")
    frame.add_argument("-o", "--output", type=Path, required=True, metavar="frame.json", help="the file to write")
    for option, what in (("origin", "the origin"), ("x", "a place on the +X axis"), ("xy", "in the XY plane, +Y side")):
        frame.add_argument(
            f"--{option}",
            metavar="PLACE",
            help=f"{what}: a placement (the ball's centre there), POSE/MARK of a verified bar, or "
            "PLACEMENT/TARGET/POINT",
        )
    frame.add_argument(
        "--offset",
        type=float,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X_MM", "Y_MM", "Z_MM"),
        help="where the origin's place lies in the frame, before any turn",
    )
    frame.add_argument(
        "--turn",
        nargs="+",
        default=[],
        metavar="TURN",
        help="turns of the axes about themselves, one after the other: x90, x-90, y90, y-90, z90, z-90",
    )


def frame(options: argparse.Namespace) -> int:
    """`spherecal frame`."""
    from spherecal.cli.answer import answer
    from spherecal.cli.commands import out
    from spherecal.cli.main import DONE
    from spherecal.cli.parsing import output_file
    from spherecal.export.frame import define_frame
    from spherecal.files.frame_file import frame_entry, write_frame
    from spherecal.geometry.user_frame import FrameDefinition

    x, y, z = options.offset
    made = define_frame(
        options.result, FrameDefinition(options.origin, options.x, options.xy, (x, y, z), tuple(options.turn))
    )
    with output_file(options.output) as place:
        write_frame(made, place)
    answer(options, {"output": options.output, **frame_entry(made)})
    for line in _said(made):
        out.print(line, markup=False)
    out.print(f"Frame in {options.output}.", markup=False)
    return DONE


def _said(made: "UserFrame") -> list[str]:
    lines = [f"User's frame: {made.definition.words()}."]
    if made.distance_mm is not None:
        lines.append(
            f"From the origin to +X {made.distance_mm:.3f} mm; the third place {made.angle_deg:.2f} degrees off."
        )
    if made.origin_sigma_mm is not None and made.axes_sigma_deg is not None:
        origin, axes = (", ".join(f"{s:.2g}" for s in v) for v in (made.origin_sigma_mm, made.axes_sigma_deg))
        lines.append(f"Standard uncertainty: origin {origin} mm along X, Y, Z; axes {axes} degrees about X, Y, Z.")
    return lines
