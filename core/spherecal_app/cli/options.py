"""The options of all commands."""

from spherecal import __version__
from spherecal_app.cli.parsers import calibrate_options as calibrating
from spherecal_app.cli.parsers import program_options as program
from spherecal_app.cli.parsers import recording_options as recording
from spherecal_app.cli.parsers import rig_options as rigs
from spherecal_app.cli.parsing import Parser, add_common, commands_below, main_parser

# in the order of the help
_COMMANDS = (
    program.add_help, program.add_demo, program.add_simulate, recording.add_targets, recording.add_detect,
    calibrating.add_calibrate, calibrating.add_verify, calibrating.add_override, calibrating.add_report,
    rigs.add_ball, rigs.add_bars, calibrating.add_check, rigs.add_measure, recording.add_support_bundle,
    calibrating.add_batch, rigs.add_export, rigs.add_import, rigs.add_import_priors, rigs.add_frame, rigs.add_limits,
    rigs.add_profile, calibrating.add_recalibrate, calibrating.add_guide, calibrating.add_cross_validate,
    recording.add_session, program.add_study, program.add_licences, program.add_manual, program.add_completion,
    program.add_compile_kernels, program.add_doctor, recording.add_cameras,
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
