"""The options of what concerns the program itself: help, licences, manual, completion, kernels, doctor."""

from spherecal.cli.parsers.shared import choice, flag, path
from spherecal.cli.parsing import Add


def add_help(add: Add) -> None:
    """`spherecal help`."""
    helping = add("help", "Help on a command, as its --help prints it.")
    helping.add_argument("words", nargs="*", metavar="COMMAND", help="such as `calibrate` or `profile save`")


def add_licences(add: Add) -> None:
    """`spherecal licences`."""
    licences = add("licences", "The parts of others in this program, and their licences.")
    path(licences, "--texts", "FILE", "write all licence texts to this file")
    path(licences, "--sbom", "FILE", "write a bill of materials (CycloneDX JSON)")


def add_manual(add: Add) -> None:
    """`spherecal manual`."""
    manual = add("manual", "Where the manual is on this computer.")
    choice(manual, "--language", ("en", "de", "zh"), "of the manual (default en)", "en")
    flag(manual, "--open", "open it in the web browser")


def add_completion(add: Add) -> None:
    """`spherecal completion`."""
    completion = add("completion", "Print a script that completes commands and options in your shell.")
    choice(completion, "shell", ("bash", "zsh", "fish"), 'for example: eval "$(spherecal completion bash)"')


def add_compile_kernels(add: Add) -> None:
    """`spherecal compile-kernels`."""
    one = add("compile-kernels", "Compile the numeric kernels now, instead of during the first calibration.")
    flag(one, "--idle", "only while the processor has nothing else to do")
    flag(one, "--json", "a line of JSON for every step: how many of how many")


def add_doctor(add: Add) -> None:
    """`spherecal doctor`."""
    add("doctor", "What this machine has and lacks.")
