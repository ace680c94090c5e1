"""The window's foot: back, why not, the one large button, next."""

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QApplication, QFrame, QHBoxLayout, QPushButton

from spherecal_gui import theme
from spherecal_gui.standing import Button, Standing
from spherecal_gui.texts import reason_text
from spherecal_gui.widgets.basic import add, button, enable, label, once
from spherecal_gui.workflow import WorkflowState

QUIET_S = 0.35  # a finger on its way cannot be called back: so long a press is not heard after a change of meaning
AFTER_CANCEL_S = 1.0  # ... and what would begin anew where "Cancel" was cannot be pressed for a second


class Footer(QFrame):
    """The large buttons; `asked_for` a step when somebody wants to see why."""

    asked_for = Signal(str)
    acted = Signal()  # the large button was pressed by somebody who saw what it does
    settled = Signal()  # what it does has been seen for a moment

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("footer")
        self._running = False
        row = QHBoxLayout(self)
        row.setContentsMargins(theme.PAD, theme.SMALL, theme.PAD, theme.SMALL)
        self.back = once(button(self.tr("Back"), "back"))
        self.why = label("", "soft")
        self.show_me = button(self.tr("Show me"), "show-me", "link", act=lambda: self.asked_for.emit(self._goal))
        self._goal = ""  # the step that it shows
        self.action = once(button("", "action", "primary", act=self._pressed))
        self.action.pressed.connect(self._finger_down)
        self._meaning = ("", "")  # the step, and what the large button does
        self._meant: tuple[str, str] | None = None  # when it was pressed
        self._cancelled = False
        self._quiet = QTimer(self, singleShot=True)
        self._quiet.timeout.connect(self._settle)
        self.next = once(button(self.tr("Next"), "next", "primary"))
        for one in (self.action, self.next):  # the others keep their places when one goes
            policy = one.sizePolicy()
            policy.setRetainSizeWhenHidden(True)
            one.setSizePolicy(policy)
        add(row, self.back, 12, (self.why, 1), self.show_me, self.action, self.next)

    @property
    def default(self) -> str:
        """Which button is drawn as the one to press: `action`, `next` or none."""
        for name, one in (("action", self.action), ("next", self.next)):
            if one.objectName() == "primary" and one.isEnabled() and not one.isHidden():
                return name
        return ""

    def show_standing(self, standing: Standing, state: WorkflowState, running: bool) -> None:
        """Show what can be done, what comes next, and why not."""
        had_focus = QApplication.focusWidget() in (self.action, self.next, self.back, self.window(), None)
        button, after = standing.said.button, state.after(state.current)
        self.action.setVisible(button is not None and not (button.done and not button.enabled))
        self._mean(button, state.current)
        stay = standing.said.stay
        can_go = after is not None and after.open and not stay
        reason = None if can_go or after is None or stay else after.reason
        enable(self.next, can_go, stay or reason_text(reason))
        self.next.setVisible(after is not None)
        self._set_kind(self.next, "primary" if standing.default == "next" else "plain")
        self._set_kind(self.action, "primary" if standing.default == "action" else "plain")
        enable(self.back, state.before(state.current) is not None, self.tr("This is the first step."))
        blocked = button.why if button is not None and not button.enabled and not button.done else ""
        why = blocked or stay or ("" if running else reason_text(reason))
        self.why.setText("" if why == standing.text else why)  # the headline says it
        goal = reason.go_to if reason is not None and not blocked else None
        goal = goal if goal not in (None, state.current) and not running else None
        self.show_me.setVisible(goal is not None)
        self._goal = goal or ""
        self._running = running
        if had_focus:
            self.take_focus()

    def _mean(self, button: Button | None, step: str) -> None:
        """Have the large button say and do this; what has just changed its meaning cannot be pressed for a moment."""
        meaning = (step, button.does if button is not None else "")
        if meaning != self._meaning:
            quiet_s = AFTER_CANCEL_S if self._meaning[1] == "cancel" else QUIET_S
            self._meaning, self._cancelled = meaning, self._meaning[1] == "cancel"
            self._quiet.start(round(1000 * quiet_s))
            self.action.setProperty("quiet", True)
        if button is None:
            return
        self.action.setText(button.text)
        self.action.setAccessibleName(button.text)
        enable(self.action, button.enabled and not (self._cancelled and self.is_quiet), button.why)

    def _settle(self) -> None:
        self.action.setProperty("quiet", False)
        self.settled.emit()

    @property
    def is_quiet(self) -> bool:
        """Whether the large button changed its meaning a moment ago: a finger may be on its way to the old one."""
        return self._quiet.isActive()

    def _pressed(self) -> None:
        """It counts where it means what it meant when the finger went down."""
        if not self.is_quiet and self._meant in (None, self._meaning):
            self.acted.emit()
        self._meant = None

    def _finger_down(self) -> None:
        self._meant = self._meaning

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
