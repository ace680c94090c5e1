"""`spherecal recalibrate`."""

import argparse
import time

from spherecal.files.atomic import RESULT
from spherecal.files.read_session import read_session
from spherecal.files.rig_file import read_rig
from spherecal.files.write_result import write_result
from spherecal_app.cli.answer import answer
from spherecal_app.cli.calibrate_command import calibration_summary, show_calibration
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_app.cli.output import check_output_folder
from spherecal_app.cli.progress import shown_progress
from spherecal_rigs.recalibrate import Selection
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
