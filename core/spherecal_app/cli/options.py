"""The options of all commands."""

from spherecal import __version__
from spherecal_app.cli.parsers.ball_options import add_ball
from spherecal_app.cli.parsers.bars_options import add_bars
from spherecal_app.cli.parsers.calibrate_options import add_batch, add_calibrate
from spherecal_app.cli.parsers.cameras_options import add_cameras
from spherecal_app.cli.parsers.export_options import add_export, add_frame, add_import, add_import_priors
from spherecal_app.cli.parsers.measure_options import add_measure
from spherecal_app.cli.parsers.network_options import add_cross_validate, add_guide, add_recalibrate
from spherecal_app.cli.parsers.profile_options import add_limits, add_profile
from spherecal_app.cli.parsers.program_options import (
    add_compile_kernels,
    add_completion,
    add_doctor,
    add_help,
    add_licences,
    add_manual,
)
from spherecal_app.cli.parsers.session_options import add_session, add_support_bundle
from spherecal_app.cli.parsers.simulate_options import add_demo, add_simulate
from spherecal_app.cli.parsers.study_options import add_study
from spherecal_app.cli.parsers.targets_options import add_detect, add_targets
from spherecal_app.cli.parsers.verify_options import add_check, add_override, add_report, add_verify
from spherecal_app.cli.parsing import Parser, add_common, commands_below, main_parser

# in the order of the help
_COMMANDS = (
    add_help, add_demo, add_simulate, add_targets, add_detect, add_calibrate, add_verify, add_override, add_report,
    add_ball, add_bars, add_check, add_measure, add_support_bundle, add_batch, add_export, add_import,
    add_import_priors, add_frame, add_limits, add_profile, add_recalibrate, add_guide, add_cross_validate,
    add_session, add_study, add_licences, add_manual, add_completion, add_compile_kernels, add_doctor, add_cameras,
)  # fmt: skip
# How the help groups them.
_SECTIONS = {
    "to begin": ("demo", "help", "manual", "doctor"),
    "recording": ("targets", "cameras", "session", "detect", "guide"),
    "calibrating and verifying": (
        "calibrate", "verify", "check", "recalibrate", "cross-validate", "override", "batch",
    ),
    "using a calibrated rig": ("measure", "report", "export", "frame", "import", "import-priors"),
    "kept from one calibration to the next": ("profile", "bars", "ball", "limits"),
    "simulating": ("simulate", "study"),
    "this program": ("compile-kernels", "completion", "licences", "support-bundle"),
}  # fmt: skip


def make_parser() -> Parser:
    """The parser of all commands."""
    parser = main_parser(
        "spherecal",
        "Calibrate a rig of many cameras with an imperfect ball. Without a command, the window opens.",
        "`spherecal COMMAND --help` says more of a command. "
        "Exit codes: 0 done; 2 bad usage or input; 3 done, but the result is not valid; 130 cancelled.",
    )
    parser.add_argument(
        "-V", "--version", action="version", version=f"spherecal {__version__}", help="print the version and end"
    )
    add = commands_below(parser, "COMMAND", "command", required=False)
    for add_one in _COMMANDS:
        add_one(add)
    parser.sections = _SECTIONS
    add_common(parser)
    return parser
