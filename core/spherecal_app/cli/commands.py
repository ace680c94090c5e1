"""What runs each command: the one place where modules of commands are loaded, each when its command is asked for."""

import argparse
from collections.abc import Callable
from importlib import import_module

# By the words of the command: a module of this package and the function in it, which returns the exit code.
COMMANDS = {
    "demo": "demo:demo",
    "simulate": "demo:simulate",
    "targets export": "targets_command:export",
    "targets sheet": "targets_command:sheet",
    "detect": "targets_command:detect",
    "calibrate": "calibrate_command:calibrate",
    "verify": "verify_command:verify",
    "override": "verify_command:override",
    "report": "documents_command:report",
    "ball export": "ball_command:export",
    "ball show": "ball_command:show",
    "bars list": "bars_command:list_bars",
    "bars show": "bars_command:show",
    "bars add": "bars_command:add",
    "bars remove": "bars_command:remove",
    "bars import": "bars_command:import_table",
    "bars export": "bars_command:export_table",
    "bars plan": "bars_command:plan",
    "check": "check_command:check",
    "measure": "measure_command:measure",
    "support-bundle": "documents_command:support_bundle",
    "batch": "study_command:batch",
    "export": "export_command:export",
    "import": "export_command:import_rig",
    "import-priors": "export_command:import_priors",
    "frame": "export_command:frame",
    "limits show": "profile_command:show_limits",
    "profile save": "profile_command:save",
    "profile list": "profile_command:list_profiles",
    "profile show": "profile_command:show",
    "profile apply": "profile_command:apply",
    "profile restore": "profile_command:restore",
    "profile compare": "profile_command:compare",
    "profile trend": "profile_command:trend",
    "recalibrate": "recalibrate_command:recalibrate",
    "guide": "recalibrate_command:guide",
    "cross-validate": "recalibrate_command:cross_validate",
    "session new": "session_command:new",
    "study": "study_command:study",
    "licences": "documents_command:licences",
    "manual": "documents_command:manual",
    "completion": "completion:completion",
    "compile-kernels": "compile_kernels:compile_kernels",
    "doctor": "doctor_command:doctor",
    "cameras list": "cameras_command:list_cameras",
    "cameras show": "cameras_command:show",
    "cameras set": "cameras_command:set_up",
    "cameras doctor": "cameras_doctor_command:doctor",
    "cameras capture": "cameras_capture_command:capture",
    "cameras trust": "cameras_source:trust",
    "cameras build-producer": "producer_command:build_producer",
    "cameras simulate-producer": "producer_command:simulate_producer",
    "cameras simulate-gige": "producer_command:simulate_gige",
}

# Commands that give nothing but what they print: they have failed where that cannot be written.
SHOWING = {
    "detect", "ball show", "bars list", "bars show", "limits show", "profile list", "profile show", "profile compare",
    "profile trend", "guide", "cross-validate", "licences", "completion", "doctor", "cameras list", "cameras show",
    "cameras doctor",
}  # fmt: skip

Command = Callable[[argparse.Namespace], int]


def words_of(options: argparse.Namespace) -> str:
    """The words of the command, as in `COMMANDS`."""
    return " ".join(filter(None, (options.command, getattr(options, "action", None))))


def command_of(options: argparse.Namespace) -> Command:
    """The function that runs the command; its module is loaded now, with the parts of the engine that it needs."""
    module, function = COMMANDS[words_of(options)].split(":")
    return getattr(import_module(f"spherecal_app.cli.{module}"), function)
