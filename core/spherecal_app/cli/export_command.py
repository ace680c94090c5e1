"""`spherecal export`, `frame`, `import` and `import-priors`."""

import argparse
from collections.abc import Mapping

from spherecal.base.errors import InputError, OutputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.data.verdict_words import WORDS, named
from spherecal_app.cli.console import answer, check_output_folder, out, output_file, say, to_output
from spherecal_app.cli.exit_codes import DONE
from spherecal_documents.export.import_rig import import_rig as run
from spherecal_documents.export.import_rig import matched, read_cameras, write_with_priors
from spherecal_documents.export.refit import Loss
from spherecal_documents.export.scene_formats import SceneFormat
from spherecal_documents.export.write_export import DEFAULT_MAX_LOSS_PX, export_rig
from spherecal_files.atomic import SESSION
from spherecal_files.json_file import plain_fields
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig, rig_bytes
from spherecal_rigs.framed_rig import FRAME, define_frame, frame_entry, write_frame
from spherecal_rigs.rig_source import corners_beside, refuse_failed_rig
from spherecal_rigs.user_frame import FrameDefinition


def export(options: argparse.Namespace) -> int:
    """`spherecal export`."""
    most = DEFAULT_MAX_LOSS_PX if options.max_loss is None else options.max_loss
    if not most >= 0:
        raise InputError(Phrase("error-max-loss"))
    rig = read_rig(options.rig)
    override = refuse_failed_rig(options.rig)
    frame = None if options.frame is None else FRAME.read(options.frame)
    with output_file(options.output) as place:
        done = export_rig(rig, options.to, place, options.unit, most, frame, corners_beside(options.rig), override)
    answer(
        options,
        {
            "output": options.output,
            "format": done.format.name,
            "cameras": done.ids,
            **plain_fields(done, "unit largest_difference_px losses fields_lost"),
            "verdict": rig.quality.verdict,
        },
    )
    unit = (
        done.unit
        if rig.scale.source != "none"
        else f"arbitrary units (the rig has no scale), written as if {done.unit}"
    )
    over = "at the corners" if isinstance(done.format, SceneFormat) else "over 1000 points in each image"
    say(
        f"{done.format.name}: {counted(len(done.ids), 'camera')} in {options.output}, lengths in {unit}; "
        f"largest difference {done.largest_difference_px:.2g} px {over}, read back."
    )
    if isinstance(done.format, SceneFormat):
        out.print("A scene to look at: its cameras have no distortion.")
    elif done.losses:
        turned = max(one.turned_deg for one in done.losses.values())
        also = f"; cameras turned about their centres by up to {turned:.2g} deg for it." if turned else "."
        say(
            f"The format has {done.format.coefficients} distortion coefficients: "
            f"{counted(len(done.losses), 'lens was', 'lenses were')} fitted to it, which costs at most "
            f"{' and '.join(_costs(done.losses))}{also}"
        )
    if done.fields_lost:
        worst = max(done.fields_lost, key=lambda name: done.fields_lost[name].max_px)
        loss = done.fields_lost[worst]
        say(
            f"The format cannot hold the {counted(len(done.fields_lost), 'correction field')} of the lenses: up to "
            f"{loss.max_px:.2g} px is lost ({loss.max_mm:.2g} mm at the distance of the rig, camera {worst}). "
            "The format maps holds them."
        )
    if frame is not None:
        say(f"Poses are given in the user's frame: {frame.definition.words()}.")
        if frame.input_sha256 != rig.input_sha256:
            say(
                "The frame was defined on another calibration: it holds only if the reference camera "
                f"{rig.reference_camera} has not moved since."
            )
    if rig.quality.verdict != "valid":
        concerned = f": {named(rig.quality.affected)}" if rig.quality.valid else ", and the export says so"
        say(f"The calibration is {WORDS[rig.quality.verdict]}{concerned}. See its findings.")
    if override is not None:
        say(
            f"Its verification FAILED; it is used all the same by {override.by}: {override.reason}. The export says so."
        )
    return DONE


def _costs(losses: Mapping[str, Loss]) -> list[str]:
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


def frame(options: argparse.Namespace) -> int:
    """`spherecal frame`."""
    x, y, z = options.offset
    made = define_frame(
        options.result, FrameDefinition(options.origin, options.x, options.xy, (x, y, z), tuple(options.turn))
    )
    with output_file(options.output) as place:
        write_frame(made, place)
    answer(options, {"output": options.output, **frame_entry(made)})
    lines = [f"User's frame: {made.definition.words()}."]
    if made.distance_mm is not None:
        lines.append(
            f"From the origin to +X {made.distance_mm:.3f} mm; the third place {made.angle_deg:.2f} degrees off."
        )
    if made.origin_sigma_mm is not None and made.axes_sigma_deg is not None:
        origin, axes = (", ".join(f"{s:.2g}" for s in v) for v in (made.origin_sigma_mm, made.axes_sigma_deg))
        lines.append(f"Standard uncertainty: origin {origin} mm along X, Y, Z; axes {axes} degrees about X, Y, Z.")
    for line in lines:
        say(line)
    say(f"Frame in {options.output}.")
    return DONE


def import_rig(options: argparse.Namespace) -> int:
    """`spherecal import`."""
    ids = None if options.ids is None else [one.strip() for one in options.ids.split(",")]
    done = run(options.file, options.format, options.unit, ids)
    rig = done.rig
    output = options.output / "rig.json" if options.output.is_dir() else options.output
    if output != options.output and output.exists():
        raise OutputError(Phrase("error-has-rig", {"folder": options.output, "file": output}))
    to_output(output, rig_bytes(rig))
    cameras = [camera.id for camera in rig]
    taken = {
        **plain_fields(done, "unit unit_from nearest_mm farthest_mm"),
        "lenses": {words: list(own) for words, own in done.lenses.items()},
        "left_out": dict(done.left_out),
        "warnings": list(done.warnings),
    }
    answer(options, {"output": output, "cameras": cameras, "reference_camera": rig.reference_camera, **taken})
    if str(output) != "-":
        names = ", ".join(cameras[:8]) + (", ..." if len(cameras) > 8 else "")
        say(f"{counted(len(cameras), 'camera')} ({names}) in {output}.")
        apart = ""
        if done.nearest_mm is not None and done.farthest_mm is not None:
            apart = f"; the cameras are {done.nearest_mm:.4g} to {done.farthest_mm:.4g} mm apart"
        say(f"Lengths in the file are {done.unit} (from {done.unit_from}){apart}.".replace("from given", "given"))
        for words, own in done.lenses.items():
            say(f"Lens: {words}, of {counted(len(own), 'camera')}.")
        for camera, why in done.left_out.items():
            say(f"Left out: {camera} {why}.")
        for warning in done.warnings:
            say(f"Warning: {warning}.")
        say("How accurate they are is not known: verify the rig with a bar.")
    return DONE


def import_priors(options: argparse.Namespace) -> int:
    """`spherecal import-priors`."""
    check_output_folder(options.output, SESSION)
    session = read_session(options.session)
    kind, cameras = read_cameras(options.file)
    priors = matched(session, cameras, options.by_order)
    write_with_priors(options.session, priors, options.output)
    without = [spec.id for spec in session.cameras if spec.id not in priors]
    answer(options, {"output": options.output, "format": kind, "cameras": list(priors), "left_as_they_were": without})
    say(f"{kind}: lenses of {counted(len(priors), 'camera')} are priors in {options.output}.")
    if without:
        say(f"Not in the file, left as they were: {', '.join(without)}.")
    return DONE
