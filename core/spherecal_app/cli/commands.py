"""What runs each command: the one place where modules of commands are loaded, each when its command is asked for."""

import argparse
from collections.abc import Callable
from importlib import import_module

# By the words of the command: a module of this package and the function in it, which returns the exit code.
COMMANDS = {
    "demo": "demo:demo",
    "simulate": "simulate:simulate",
    "targets export": "targets:export",
    "targets sheet": "targets:sheet",
    "detect": "detect:detect",
    "calibrate": "calibrate:calibrate",
    "verify": "verify:verify",
    "report": "report:report",
    "ball export": "ball:export",
    "ball show": "ball:show",
    "bars list": "bars:list_bars",
    "bars show": "bars:show",
    "bars add": "bars_add:add",
    "bars remove": "bars:remove",
    "bars import": "bars_table:import_table",
    "bars export": "bars_table:export_table",
    "bars plan": "bars_plan:plan",
    "check": "check:check",
    "measure": "measure:measure",
    "support-bundle": "bundle:support_bundle",
    "batch": "batch:batch",
    "export": "export:export",
    "import": "import_rig:import_rig",
    "import-priors": "import_rig:import_priors",
    "frame": "frame:frame",
    "limits show": "limits:show",
    "profile save": "profile:save",
    "profile list": "profile:list_profiles",
    "profile show": "profile:show",
    "profile apply": "profile:apply",
    "profile restore": "profile:restore",
    "profile compare": "profile_compare:compare",
    "profile trend": "profile_trend:trend",
    "recalibrate": "recalibrate:recalibrate",
    "guide": "guide:guide",
    "cross-validate": "cross_validate:cross_validate",
    "session new": "session:new",
    "study": "study:study",
    "licences": "about:licences",
    "manual": "about:manual",
    "completion": "completion:completion",
    "compile-kernels": "compile_kernels:compile_kernels",
    "doctor": "doctor:doctor",
    "cameras list": "cameras:list_cameras",
    "cameras show": "cameras:show",
    "cameras set": "cameras:set_up",
    "cameras doctor": "cameras_doctor:doctor",
    "cameras capture": "cameras_capture:capture",
    "cameras trust": "drivers:trust",
    "cameras build-producer": "producer:build_producer",
    "cameras simulate-producer": "producer:simulate_producer",
    "cameras simulate-gige": "gige:simulate",
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
