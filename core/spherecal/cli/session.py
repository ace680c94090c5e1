"""`spherecal session new`: a session folder of images or videos that another program recorded."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.data.findings import counted

if TYPE_CHECKING:
    from spherecal.files.new_session import NewSession


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's actions and their options."""
    session = add("session", "Session folders: make one from images or videos that you have.")
    actions = session.add_subparsers(dest="action", required=True, metavar="ACTION")
    text = "Make a session folder from images or synchronised videos, by their names, sizes and EXIF."
    new = actions.add_parser("new", help=text, description=text)
    new.add_argument("folder", type=Path, metavar="FOLDER", help="the session folder to write")
    new.add_argument(
        "--images",
        type=Path,
        required=True,
        metavar="DIR",
        help="the images (cam1/0001.png, 0001/cam1.png, cam1_0001.png) or one video of each camera; they are copied "
        "unless they lie in FOLDER",
    )
    new.add_argument(
        "--pattern",
        metavar="PATTERN",
        help='how their paths below DIR name camera and placement, such as "{camera}_{placement}.png"; * is any text',
    )
    new.add_argument(
        "--board",
        metavar="BOARD",
        help="the board that they show: chessboard,rows=6,columns=9,pitch_mm=20, with the fields of the manual's page "
        "on boards, or a JSON file with them",
    )
    new.add_argument("--targets", type=Path, metavar="targets.json", help="the coded targets that they show")
    new.add_argument("--sphere", type=float, metavar="MM", help="the ball's nominal diameter")
    new.add_argument("--focal-length", type=float, metavar="MM", help="of all lenses, instead of what EXIF says")
    new.add_argument("--pixel-pitch", type=float, metavar="UM", help="of all sensors, instead of what EXIF says")
    new.add_argument("--lens", choices=("brown", "rational", "fisheye"), help="the lens model (default brown)")
    new.add_argument("--frames", type=int, default=30, metavar="N", help="of videos: at most this many (default 30)")


def session(options: argparse.Namespace) -> int:
    """`spherecal session`."""
    from spherecal.cli.answer import answer
    from spherecal.cli.main import DONE
    from spherecal.cli.progress import shown_progress
    from spherecal.uses.use_cases import new_session

    with shown_progress() as context:
        made = new_session(
            options.folder,
            options.images,
            pattern=options.pattern,
            board=options.board,
            targets=options.targets,
            sphere_diameter_mm=options.sphere,
            focal_length_mm=options.focal_length,
            pixel_pitch_um=options.pixel_pitch,
            lens_model=options.lens,
            frames=options.frames,
            context=context,
        )
    answer(options, _summary(made))
    _show(made, options.folder)
    return DONE


def _summary(made: "NewSession") -> dict[str, object]:
    return {
        "layout": made.layout,
        "pattern": made.pattern,
        "cameras": [
            {
                "id": camera.id,
                "images": camera.images,
                "image_size": list(camera.image_size),
                "focal_px": round(camera.focal_px, 3),
                "focal_from": camera.focal_from,
                "model": camera.model,
                "serial": camera.serial,
            }
            for camera in made.cameras
        ],
        "placements": [placement.id for placement in made.session.placements],
        "assumed": list(made.assumed),
        "missing": list(made.missing),
        "left_out": list(made.left_out),
    }


def _show(made: "NewSession", folder: Path) -> None:
    from rich.markup import escape
    from rich.table import Table

    from spherecal.cli.commands import out

    places = [placement.id for placement in made.session.placements]
    span = places[0] if len(places) == 1 else f"{places[0]} ... {places[-1]}"
    out.print(
        f"{counted(len(made.cameras), 'camera')}, {counted(len(places), 'placement')} ({span}), read as "
        f"{made.layout}: {made.pattern}",
        markup=False,
    )
    table = Table("camera", box=None)
    for heading in ("images", "size px", "f px"):
        table.add_column(heading, justify="right")
    for heading in ("from", "model", "serial"):
        table.add_column(heading)
    for c in made.cameras:
        size = f"{c.image_size[0]} x {c.image_size[1]}"
        words = (c.focal_from, c.model or "-", c.serial or "-")
        table.add_row(escape(c.id), str(c.images), size, f"{c.focal_px:.0f}", *map(escape, words))
    out.print(table)
    for heading, lines in (("Assumed", made.assumed), ("Missing", made.missing)):
        for line in lines:
            out.print(f"{heading}: {line}.", markup=False)
    if made.left_out:
        shown = ", ".join(made.left_out[:4]) + (", ..." if len(made.left_out) > 4 else "")
        out.print(f"Left out: {counted(len(made.left_out), 'file')} ({shown}).", markup=False)
    out.print(f"Session in {folder}.", markup=False)
