"""The bench editor over the window: what it begins with, what becomes of what it saves."""

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QWidget

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import translate

if TYPE_CHECKING:  # the window is shown before these are loaded
    from spherecal_gui.pages.bench_dialog import BenchDialog


def _holds(controller: Controller) -> str:
    """For what the bench counts once it is saved."""
    project = controller.project
    if project is not None and project.simulated:
        return translate("Bench", "It holds for the real rig, not for this training.")
    if project is not None and project.taken:
        return translate("Bench", "It applies to the next calibration: this one already has images.")
    if project is not None:
        return translate("Bench", "It holds for this calibration and the next ones.")
    return translate("Bench", "It applies to the next calibrations of this rig.")


def show_bench(controller: Controller, projects: Path, window: QWidget) -> "BenchDialog":
    """The editor with what is on the bench now, as far as it is known."""
    from spherecal_gui.controllers.bench_desk import BenchDesk
    from spherecal_gui.pages.bench_dialog import BenchDialog  # needs scipy, as the next

    project, connection = controller.project, controller.cameras.connection
    real = project is not None and not project.simulated and connection is not None
    plan = connection.plan if real and connection is not None and connection.plan.target_set is not None else None
    folder = project.folder.parent if project is not None else projects
    dialog = BenchDialog(BenchDesk(folder, plan), window, _holds(controller))

    def saved(path: str) -> None:
        now = controller.project
        controller.note(translate("Log", "bench saved: {file}").format(file=path or dialog.desk.library))
        if path and now is not None and not now.simulated and not now.taken and controller.runner.running is None:
            controller.cameras.choose_bench(path)
        controller.changed.emit()

    dialog.saved.connect(saved)
    dialog.open()
    return dialog
