"""The window of this version: it says what works today and how to reach it."""

import sys

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QLabel, QMainWindow

import spherecal

COMMANDS = {
    "spherecal demo": "a simulated rig, calibrated and verified",
    "spherecal simulate rigA -o SESSION": "a simulated recording with its truth",
    "spherecal calibrate SESSION -o RESULT": "from a recording to a calibrated rig",
    "spherecal verify SESSION --rig rig.json -o RESULT": "check a rig with reference bars",
    "spherecal export rig.json --to FORMAT -o PATH": "the rig in another program's format",
    "spherecal import-priors FILE --session SESSION -o NEW": "lenses known elsewhere as start values",
    "spherecal profile save RESULT --to PROFILE": "a rig's calibrations over time: apply, restore, compare, trend",
    "spherecal report RESULT -o report.pdf": "the result on paper",
    "spherecal doctor": "what this machine has and lacks",
}


def welcome_text() -> str:
    """What the window says, as simple HTML."""
    rows = "".join(
        f"<tr><td><code>{command}</code></td><td style='padding-left: 24px'>{meaning}</td></tr>"
        for command, meaning in COMMANDS.items()
    )
    return (
        f"<h2>SphereCal {spherecal.__version__}</h2>"
        "<p>This version works on the command line; the guided wizard is not part of it yet.</p>"
        f"<table cellspacing='6'>{rows}</table>"
        "<p>Each command explains itself with <code>--help</code>.</p>"
    )


def make_window() -> QMainWindow:
    """Build the window without showing it; a QApplication must exist."""
    text = QLabel(welcome_text())
    text.setTextFormat(Qt.TextFormat.RichText)
    text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    text.setMargin(24)
    window = QMainWindow()
    window.setWindowTitle("SphereCal")
    window.setCentralWidget(text)
    return window


def main(arguments: list[str] | None = None) -> int:
    """Show the window until it is closed; the exit code."""
    application = QApplication(sys.argv if arguments is None else arguments)
    window = make_window()
    window.show()
    return application.exec()
