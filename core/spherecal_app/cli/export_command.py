"""`spherecal export`."""

import argparse
from collections.abc import Mapping

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.data.verdict import WORDS, named
from spherecal.files.rig_file import read_rig
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import out, say
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.output import output_file
from spherecal_documents.export.refit import Loss
from spherecal_documents.export.scene_formats import SceneFormat
from spherecal_documents.export.write_export import DEFAULT_MAX_LOSS_PX, export_rig
from spherecal_rigs.frame_file import read_frame
from spherecal_rigs.rig_source import corners_beside, refuse_failed_rig


def export(options: argparse.Namespace) -> int:
    """`spherecal export`."""
    most = DEFAULT_MAX_LOSS_PX if options.max_loss is None else options.max_loss
    if not most >= 0:
        raise InputError(Phrase("error-max-loss"))
    rig = read_rig(options.rig)
    override = refuse_failed_rig(options.rig)
    frame = None if options.frame is None else read_frame(options.frame)
    with output_file(options.output) as place:
        done = export_rig(rig, options.to, place, options.unit, most, frame, corners_beside(options.rig), override)
    answer(
        options,
        {
            "output": options.output,
            "format": done.format.name,
            "cameras": done.ids,
            "unit": done.unit,
            "largest_difference_px": done.largest_difference_px,
            "losses": done.losses,
            "fields_lost": done.fields_lost,
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
