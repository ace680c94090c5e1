"""What the controller's parts have in common."""

from PySide6.QtCore import QObject

from spherecal_gui.controllers.project_controller import ProjectController
from spherecal_gui.project import Project
from spherecal_gui.tasks.task import Runner


class ControllerPart(QObject):
    """A role of the controller; `main` has the open project and the running work."""

    def __init__(self, main: ProjectController) -> None:
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
