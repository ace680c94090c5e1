"""`spherecal import` and `spherecal import-priors`."""

import argparse

from spherecal.base.errors import OutputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.files.atomic import SESSION
from spherecal.files.read_session import read_session
from spherecal.files.rig_file import rig_bytes
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.output import check_output_folder, to_output
from spherecal_documents.export.import_rig import Imported
from spherecal_documents.export.import_rig import import_rig as run
from spherecal_documents.export.priors import matched, read_cameras, write_with_priors


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
        "unit": done.unit,
        "unit_from": done.unit_from,
        "nearest_mm": done.nearest_mm,
        "farthest_mm": done.farthest_mm,
        "lenses": {words: list(own) for words, own in done.lenses.items()},
        "left_out": dict(done.left_out),
        "warnings": list(done.warnings),
    }
    answer(options, {"output": output, "cameras": cameras, "reference_camera": rig.reference_camera, **taken})
    if str(output) != "-":
        names = ", ".join(cameras[:8]) + (", ..." if len(cameras) > 8 else "")
        say(f"{counted(len(cameras), 'camera')} ({names}) in {output}.")
        _say_taken(done)
        say("How accurate they are is not known: verify the rig with a bar.")
    return DONE


def _say_taken(done: Imported) -> None:
    """What was taken for the rig, and what was not."""
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
