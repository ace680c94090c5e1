"""`spherecal export`, `spherecal import` and `spherecal import-priors`."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.messages.values import Phrase
from spherecal.cli.parsing import rig_file
from spherecal.data.findings import counted

if TYPE_CHECKING:
    from spherecal.export.refit import Loss


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The commands' options."""
    export = add("export", "Write a calibrated rig in the format of another program.")
    export.add_argument("rig", type=rig_file, metavar="rig.json", help="the rig, or the folder of its result")
    export.add_argument(
        "--to",
        "--format",
        required=True,
        metavar="FORMAT",
        dest="to",
        help="opencv, ros, kalibr, colmap, metashape, anipose (also for Pose2Sim), caliscope, mc-calib, multical, "
        "mrcal, csv; scenes to look at: gltf, ply, blender",
    )
    export.add_argument("-o", "--output", type=Path, required=True, metavar="PATH", help="the file or folder to write")
    export.add_argument("--unit", choices=("mm", "m"), help="unit of lengths, where the format leaves it open")
    export.add_argument(
        "--max-loss",
        type=float,
        metavar="PX",
        help="how much a lens may change to fit the format's smaller lens model (default 0.1 px)",
    )
    export.add_argument(
        "--frame", type=Path, metavar="frame.json", help="give all poses in this user's frame (spherecal frame)"
    )

    bring = add("import", "Make a rig.json of a rig with poses that another program calibrated.")
    bring.add_argument("file", type=Path, metavar="FILE", help="the other program's file, or folder of files")
    bring.add_argument(
        "--format",
        required=True,
        metavar="FORMAT",
        help="opencv, ros, kalibr, colmap, metashape, anipose, caliscope, mc-calib, multical, mrcal, csv, matlab",
    )
    bring.add_argument(
        "-o", "--output", type=Path, required=True, metavar="rig.json", help="the file to write, - for standard output"
    )
    bring.add_argument(
        "--unit", choices=("mm", "m"), help="unit of the file's lengths, where the format leaves it open"
    )
    bring.add_argument(
        "--ids", metavar="ID,ID,...", help="names for its cameras in the file's order, such as those of your session"
    )

    priors = add("import-priors", "Copy a session and give its cameras the lenses of a file of another program.")
    priors.add_argument(
        "file", type=Path, metavar="FILE", help="OpenCV YAML (a file or a folder of them), Kalibr camchain, COLMAP text"
    )
    priors.add_argument("--session", type=Path, required=True, metavar="SESSION", help="the session to copy")
    priors.add_argument(
        "-o", "--output", type=Path, required=True, metavar="NEW_SESSION", help="the session folder to write"
    )
    priors.add_argument("--by-order", action="store_true", help="match cameras by order instead of by name")


def export(options: argparse.Namespace) -> int:
    """`spherecal export`."""
    from spherecal.base.errors import InputError
    from spherecal.cli.answer import answer
    from spherecal.cli.commands import out
    from spherecal.cli.main import DONE
    from spherecal.cli.parsing import output_file
    from spherecal.data.verdict import WORDS, named
    from spherecal.export.scene import SceneFormat
    from spherecal.export.write_export import DEFAULT_MAX_LOSS_PX, export_rig
    from spherecal.files.frame_file import read_frame
    from spherecal.files.rig_file import read_rig
    from spherecal.profile.source import corners_beside

    most = DEFAULT_MAX_LOSS_PX if options.max_loss is None else options.max_loss
    if not most >= 0:
        raise InputError(Phrase("error-max-loss"))
    rig = read_rig(options.rig)
    frame = None if options.frame is None else read_frame(options.frame)
    with output_file(options.output) as place:
        done = export_rig(rig, options.to, place, options.unit, most, frame, corners_beside(options.rig))
    answer(
        options,
        {
            "output": options.output,
            "format": done.format.name,
            "cameras": done.ids,
            "unit": done.unit,
            "largest_difference_px": done.largest_difference_px,
            "losses": done.losses,
            "verdict": rig.quality.verdict,
        },
    )
    unit = (
        done.unit
        if rig.scale.source != "none"
        else f"arbitrary units (the rig has no scale), written as if {done.unit}"
    )
    over = "at the corners" if isinstance(done.format, SceneFormat) else "over 1000 points in each image"
    out.print(
        f"{done.format.name}: {counted(len(done.ids), 'camera')} in {options.output}, lengths in {unit}; "
        f"largest difference {done.largest_difference_px:.2g} px {over}, read back.",
        markup=False,
    )
    if isinstance(done.format, SceneFormat):
        out.print("A scene to look at: its cameras have no distortion.")
    elif done.losses:
        turned = max(one.turned_deg for one in done.losses.values())
        also = f"; cameras turned about their centres by up to {turned:.2g} deg for it." if turned else "."
        out.print(
            f"The format has {done.format.coefficients} distortion coefficients: "
            f"{counted(len(done.losses), 'lens was', 'lenses were')} fitted to it, which costs at most "
            f"{' and '.join(_costs(done.losses))}{also}",
            markup=False,
        )
    if frame is not None:
        out.print(f"Poses are given in the user's frame: {frame.definition.words()}.", markup=False)
        if frame.input_sha256 != rig.input_sha256:
            out.print(
                "The frame was defined on another calibration: it holds only if the reference camera "
                f"{rig.reference_camera} has not moved since.",
                markup=False,
            )
    if rig.quality.verdict != "valid":
        concerned = f": {named(rig.quality.affected)}" if rig.quality.valid else ", and the export says so"
        out.print(f"The calibration is {WORDS[rig.quality.verdict]}{concerned}. See its findings.", markup=False)
    return DONE


def _costs(losses: Mapping[str, "Loss"]) -> list[str]:
    """What fitting lenses cost at most: of those fitted over the image, and of those fitted over the volume."""
    said = []
    for over_volume in (False, True):
        own = {name: loss for name, loss in losses.items() if (loss.image_px is not None) == over_volume}
        if not own:
            continue
        worst = max(own, key=lambda name: own[name].max_px)
        loss, where = own[worst], "the image"
        if over_volume:
            elsewhere = max(one.image_px or 0.0 for one in own.values())
            where = f"the calibrated volume (up to {elsewhere:.2g} px elsewhere in the image)"
        said.append(f"{loss.max_px:.2g} px (rms {loss.rms_px:.2g} px) over {where}, camera {worst}")
    return said


def import_rig(options: argparse.Namespace) -> int:
    """`spherecal import`."""
    from spherecal.base.errors import OutputError
    from spherecal.cli.answer import answer
    from spherecal.cli.commands import out
    from spherecal.cli.main import DONE
    from spherecal.cli.parsing import to_output
    from spherecal.export.import_rig import import_rig as run
    from spherecal.files.rig_file import rig_bytes

    ids = None if options.ids is None else [one.strip() for one in options.ids.split(",")]
    rig = run(options.file, options.format, options.unit, ids)
    output = options.output / "rig.json" if options.output.is_dir() else options.output
    if output != options.output and output.exists():
        raise OutputError(Phrase("error-has-rig", {"folder": options.output, "file": output}))
    to_output(output, rig_bytes(rig))
    cameras = [camera.id for camera in rig]
    answer(options, {"output": output, "cameras": cameras, "reference_camera": rig.reference_camera})
    if str(output) != "-":
        names = ", ".join(cameras[:8]) + (", ..." if len(cameras) > 8 else "")
        out.print(f"{counted(len(cameras), 'camera')} ({names}) in {output}.", markup=False)
        out.print("How accurate they are is not known: verify the rig with a bar.")
    return DONE


def import_priors(options: argparse.Namespace) -> int:
    """`spherecal import-priors`."""
    from spherecal.cli.answer import answer
    from spherecal.cli.commands import out
    from spherecal.cli.main import DONE
    from spherecal.cli.parsing import check_output_folder
    from spherecal.export.priors import matched, read_cameras, write_with_priors
    from spherecal.files.atomic import SESSION
    from spherecal.files.read_session import read_session

    check_output_folder(options.output, SESSION)
    session = read_session(options.session)
    kind, cameras = read_cameras(options.file)
    priors = matched(session, cameras, options.by_order)
    write_with_priors(options.session, priors, options.output)
    without = [spec.id for spec in session.cameras if spec.id not in priors]
    answer(options, {"output": options.output, "format": kind, "cameras": list(priors), "left_as_they_were": without})
    out.print(f"{kind}: lenses of {counted(len(priors), 'camera')} are priors in {options.output}.", markup=False)
    if without:
        out.print(f"Not in the file, left as they were: {', '.join(without)}.", markup=False)
    return DONE
