"""What all pages have in common."""

from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from spherecal_gui.wizard.controller import Controller
from spherecal_gui.workflow import Step, StepState


@dataclass(frozen=True)
class PageAction:
    """The one large button of a page: what it says, whether it can be pressed, and why not (with the step to mend it).

    `done`: the page's work is done, and the space bar goes on to the next step instead.
    """

    text: str
    enabled: bool = True
    why: str = ""
    done: bool = False


class Page(QWidget):
    """A page of the wizard. `action_changed` asks the window to draw its buttons anew."""

    action_changed = Signal()

    def __init__(self, controller: Controller, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.controller = controller
        self.step: Step | None = None

    def enter(self, step: Step) -> None:
        """The page is shown for this step."""
        self.step = step
        self.refresh()

    def leave(self) -> None:
        """Another page is shown."""

    def refresh(self) -> None:
        """Something may have changed."""

    def tick(self) -> None:
        """Called some ten times a second while the page is shown."""

    def dress(self) -> None:
        """The palette has changed."""
        self.refresh()

    def close_page(self) -> None:
        """The program ends."""

    def action(self) -> PageAction | None:
        """What the large button does now; None for no such button."""
        return None

    def act(self) -> None:
        """The large button was pressed."""

    @property
    def state(self) -> StepState | None:
        """The state of the page's step."""
        state = self.controller.state
        return state.of(self.step.id) if state is not None and self.step is not None else None

    @property
    def project(self) -> Any:
        """The open project."""
        return self.controller.project
