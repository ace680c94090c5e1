"""Look: the wall of all cameras."""

from PySide6.QtWidgets import QVBoxLayout, QWidget

from spherecal_gui.pages.base import PageAction
from spherecal_gui.pages.live_page import LivePage
from spherecal_gui.presenters.look import summary
from spherecal_gui.widgets.basic import label, set_level
from spherecal_gui.widgets.tile import Wall
from spherecal_gui.wizard.controller import Controller
from spherecal_gui.workflow import Status, Step


class LookPage(LivePage):
    """Every camera's live image with its dots, its light and its focus."""

    def __init__(self, controller: Controller, parent: QWidget | None = None) -> None:
        super().__init__(controller, parent)
        column = QVBoxLayout(self)
        self.summary = label("", "huge")
        self.summary.setObjectName("huge")
        column.addWidget(self.summary)
        self.wall = Wall()
        column.addWidget(self.wall, 1)
        self._seen_all = False

    def enter(self, step: Step) -> None:
        """Show the ball's first place, where nobody moves it by hand."""
        super().enter(step)
        poses = self.controller.staged_poses
        if poses:
            self.controller.show_pose(poses[0])

    def refresh(self) -> None:
        """Show the cameras that are open."""
        self.show_cameras()
        self.tick()
        self.action_changed.emit()

    def tick(self) -> None:
        """Follow the cameras."""
        states = self.follow()
        if not states:
            return
        text, level = summary(states)
        self.summary.setText(text)
        set_level(self.summary, level)
        seen = not any(state.level == "none" for state in states)
        if seen != self._seen_all:
            self._seen_all = seen
            self.action_changed.emit()

    def action(self) -> PageAction:
        """Accept what is seen."""
        state = self.state
        done = state is not None and state.status is Status.DONE
        text = self.tr("The images are good")
        if done:
            return PageAction(text, False, self.tr("They were accepted already."), done=True)
        if not self._seen_all:
            return PageAction(text, False, self.tr("Not every camera has sent an image yet."))
        return PageAction(text)

    def act(self) -> None:
        """Accept."""
        self.controller.accept_look()
