"""The window's foot: back, why not, the one large button, next."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QApplication, QFrame, QHBoxLayout, QPushButton, QWidget

from spherecal_gui import theme
from spherecal_gui.pages.wizard_page import PageAction
from spherecal_gui.standing import Standing
from spherecal_gui.texts import reason_text
from spherecal_gui.widgets.basic import button, enable, label, once
from spherecal_gui.workflow import WorkflowState


class Footer(QFrame):
    """The large buttons; `asked_for` a step when somebody wants to see why."""

    asked_for = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("footer")
        self._running = False
        row = QHBoxLayout(self)
        row.setContentsMargins(theme.PAD, theme.SMALL, theme.PAD, theme.SMALL)
        self.back = once(button(self.tr("Back"), "back"))
        self.why = label("", "soft")
        self.show_me = button(self.tr("Show me"), "show-me", "link")
        self.show_me.clicked.connect(self._show_me)
        self.action = once(button("", "action", "primary"))
        self.next = once(button(self.tr("Next"), "next", "primary"))
        row.addWidget(self.back)
        row.addSpacing(12)
        row.addWidget(self.why, 1)
        row.addWidget(self.show_me)
        row.addWidget(self.action)
        row.addWidget(self.next)

    def _show_me(self) -> None:
        goal = str(self.show_me.property("goal"))
        if goal:
            self.asked_for.emit(goal)

    @property
    def default(self) -> str:
        """Which button is drawn as the one to press: `action`, `next` or none."""
        shown = [
            name
            for name, one in (("action", self.action), ("next", self.next))
            if one.objectName() == "primary" and one.isEnabled() and not one.isHidden()
        ]
        return shown[0] if shown else ""

    def show_action(self, action: PageAction | None, state: WorkflowState, running: bool, standing: Standing) -> None:
        """Show what can be done, what comes next, and why not.

        `action` None where it has none.
        """
        had_focus = QApplication.focusWidget() in (self.action, self.next, self.back, self.window(), None)
        self.action.setVisible(action is not None and not (action.done and not action.enabled))
        if action is not None:
            self.action.setText(action.text)
            self.action.setAccessibleName(action.text)
            enable(self.action, action.enabled, action.why)
        after = state.after(state.current)
        can_go = after is not None and after.open
        reason = None if can_go or after is None else after.reason
        enable(self.next, can_go, reason_text(reason))
        self.next.setVisible(after is not None)
        self._set_kind(self.next, "primary" if standing.default == "next" else "plain")
        self._set_kind(self.action, "primary" if standing.default == "action" else "plain")
        enable(self.back, state.before(state.current) is not None, self.tr("This is the first step."))
        blocked = action.why if action is not None and not action.enabled and not action.done else ""
        self.why.setText(blocked or ("" if running else reason_text(reason)))
        goal = reason.go_to if reason is not None and not blocked else None
        goal = goal if goal not in (None, state.current) and not running else None
        self.show_me.setVisible(goal is not None)
        self.show_me.setProperty("goal", goal or "")
        self._running = running
        if had_focus:
            self.take_focus()

    def take_focus(self) -> None:
        """Give the focus to the button to press; while work runs to the window, else space would press "Cancel"."""
        best = {"next": self.next, "action": self.action}.get(self.default)
        usable = best is not None and best.isVisible() and not self._running
        (best if best is not None and usable else self.window()).setFocus()

    @staticmethod
    def _set_kind(one: QPushButton, kind: str) -> None:
        if one.objectName() != kind:
            one.setObjectName(kind)
            one.style().unpolish(one)
            one.style().polish(one)
