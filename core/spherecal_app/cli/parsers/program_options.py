"""The options of commands about the program itself: help, licences, manual, completion, kernels, doctor."""

from spherecal_app.cli.parsers.shared import choice, flag, path
from spherecal_app.cli.parsing import Add


def add_help(add: Add) -> None:
    """`spherecal help`."""
    helping = add("help", "Show the help of a command, as its --help does.")
    helping.add_argument("words", nargs="*", metavar="COMMAND", help="such as `calibrate` or `profile save`")


def add_licences(add: Add) -> None:
    """`spherecal licences`."""
    licences = add("licences", "List third-party parts of this program, and their licences.")
    path(licences, "--texts", "FILE", "write all licence texts to this file")
    path(licences, "--sbom", "FILE", "write a bill of materials (CycloneDX JSON)")


def add_manual(add: Add) -> None:
    """`spherecal manual`."""
    manual = add("manual", "Say where the manual is on this computer.")
    choice(manual, "--language", ("en", "de", "zh"), "language of the manual (default en)", "en")
    flag(manual, "--open", "open it in the web browser")


def add_completion(add: Add) -> None:
    """`spherecal completion`."""
    completion = add("completion", "Print a script that completes commands and options in your shell.")
    choice(completion, "shell", ("bash", "zsh", "fish"), 'for example: eval "$(spherecal completion bash)"')


def add_compile_kernels(add: Add) -> None:
    """`spherecal compile-kernels`."""
    one = add("compile-kernels", "Compile the numeric kernels now, instead of during the first calibration.")
    flag(one, "--idle", "only while the processor has nothing else to do")
    flag(one, "--json", "print a line of JSON for every step: `done` and `all`")


def add_doctor(add: Add) -> None:
    """`spherecal doctor`."""
    add("doctor", "Say what this machine has and lacks.")
