"""The limits in the window: read when it is made, the dialog that shows them, what was changed in the log."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtWidgets import QWidget

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import translate
from spherecal_gui.pages.limits_dialog import LimitsDialog
from spherecal_gui.presenters.limits_presenter import load_limits
from spherecal_gui.project_folder import profile_shown
from spherecal_gui.widgets.basic import Banner


def take_over_limits(controller: Controller, banner: Banner) -> None:
    """Use the limits that are kept; where their file is damaged it is said."""
    damaged = load_limits()
    if damaged:
        controller.note(damaged)
        banner.tell("bad", damaged)


def show_limits(controller: Controller, projects: Path, window: QWidget, redraw: Callable[[], None]) -> LimitsDialog:
    """The dialog with the limits, which is shown."""

    def changed(lines: list[str]) -> None:
        for line in lines:
            controller.note(translate("Limits", "Limit changed: {line}").format(line=line))
        redraw()

    dialog = LimitsDialog(controller.profile_folder or profile_shown(projects), window)
    dialog.changed.connect(changed)
    dialog.open()
    return dialog
