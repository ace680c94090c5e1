"""`spherecal recalibrate`, `guide` and `cross-validate`: what follows a calibration, or leads to it."""

import argparse
import time

from rich.markup import escape
from rich.table import Table

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.calibrate import calibrate
from spherecal.detect.session_images import observed
from spherecal_app.cli.calibrate_command import calibration_summary, show_calibration
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.console import answer, check_output_folder, out, shown_progress
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_files.atomic import RESULT
from spherecal_files.json_file import plain_fields
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig
from spherecal_files.write_result import write_result
from spherecal_rigs.next_placement import advise
from spherecal_rigs.recalibrate import Selection
from spherecal_rigs.recalibrate import cross_validate as run_without
from spherecal_rigs.recalibrate import recalibrate as run


def recalibrate(options: argparse.Namespace) -> int:
    """`spherecal recalibrate`."""
    check_output_folder(options.output, RESULT)
    began = time.perf_counter()
    cameras = tuple(name for name in options.only.split(",") if name)
    with shown_progress() as context:
        rig = read_rig(options.rig)
        session = read_session(options.session)
        compile_first(context)
        calibration = run(session, rig, Selection(cameras, options.estimate), None, context)
        details = {"method": "selected", "only": list(cameras), "estimate": options.estimate}
        write_result(calibration, options.output, details)
    answer(options, calibration_summary(calibration))
    show_calibration(calibration, options.output, time.perf_counter() - began)
    return DONE if calibration.rig.quality.valid else NOT_VALID


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
        from spherecal_documents.report.trend_chart import save_guidance_picture  # here, since it loads matplotlib

        save_guidance_picture(calibration.rig, guidance, calibration.spheres[0].radius_mm, options.picture)
    answer(
        options,
        {
            "length_mm": 500.0,
            "coverage_factor": 2.0,
            "now_mm": guidance.now_mm,
            "words": guidance.words(),
            "candidates": [
                {
                    "centre_mm": [round(float(x), 3) for x in c.centre_mm],
                    "turn_deg": c.turn_deg,
                    "axis": None if c.axis is None else [round(float(x), 6) for x in c.axis],
                    **plain_fields(c, "expanded_mm cameras nearest fewest_dots"),
                }
                for c in guidance.candidates
            ],
        },
    )
    out.print(escape(guidance.words()))
    table = Table("place (mm, rig frame)", "turn", "towards", "cameras", "500 mm, k = 2", box=None)
    for c in guidance.candidates[:6]:
        place = ", ".join(f"{x:.0f}" for x in c.centre_mm)
        turn = "none" if c.axis is None else f"{c.turn_deg:.0f} deg about " + ", ".join(f"{x:.2f}" for x in c.axis)
        table.add_row(place, turn, c.nearest, str(c.cameras), f"{c.expanded_mm:.3f} mm")
    out.print(table)
    return DONE


def cross_validate(options: argparse.Namespace) -> int:
    """`spherecal cross-validate`."""
    with shown_progress() as context:
        session = read_session(options.session)
        compile_first(context)
        whole, found = run_without(session, None, context)
    answer(options, found)
    table = Table("left out", "dots", "rms px", "shape rms mm", "size, ppm", box=None)
    for one in found:
        cells = [
            "-" if value is None else text
            for value, text in (
                (one.rms_px, f"{one.rms_px or 0:.4f}"),
                (one.shape_rms_mm, f"{one.shape_rms_mm or 0:.4f}"),
                (one.length_error, f"{1e6 * (one.length_error or 0):.0f}"),
            )
        ]
        table.add_row(one.placement, str(one.dots), *cells)
    out.print(table)
    return DONE if whole.rig.quality.valid else NOT_VALID
