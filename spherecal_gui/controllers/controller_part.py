"""What the controller's parts have in common."""

from typing import TYPE_CHECKING

from PySide6.QtCore import QObject

from spherecal_gui.project import Project
from spherecal_gui.tasks.task import Runner

if TYPE_CHECKING:  # which makes the parts
    from spherecal_gui.controllers.controller import Controller


class ControllerPart(QObject):
    """A role of the controller; `main` has the open project, the running work, and the other parts."""

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.main = main

    @property
    def project(self) -> Project | None:
        """The open project."""
        return self.main.project

    @property
    def runner(self) -> Runner:
        """Runs the one piece of work that the steps wait for."""
        return self.main.runner
