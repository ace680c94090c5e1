"""The window's head: the way back, project, states, help, menu; its foot: back, why not, the one large button, next."""

from PySide6.QtCore import QTimer, Signal
from PySide6.QtGui import QAction, QActionGroup
from PySide6.QtWidgets import QApplication, QFrame, QHBoxLayout, QMenu, QPushButton

from spherecal_gui import theme
from spherecal_gui.languages import LANGUAGES, reason_text, word
from spherecal_gui.presenters.start_presenter import FAULTS, SURPRISE
from spherecal_gui.standing import Button, Standing
from spherecal_gui.widgets.basic import Chip, Elided, add, button, enable, label, once, spaced
from spherecal_gui.widgets.icons import menu_icon
from spherecal_gui.workflow import WorkflowState


class Header(QFrame):
    """Buttons that are there on every page; `toggled` when an option of the menu has changed."""

    toggled = Signal()
    language_chosen = Signal(str)
    training = Signal(str)  # with this fault

    def __init__(self, language: str) -> None:
        super().__init__()
        self.setObjectName("header")
        row = spaced(QHBoxLayout(self), theme.SMALL)
        row.setContentsMargins(theme.PAD, theme.SMALL - 2, theme.PAD, theme.SMALL - 2)
        self.home = button(self.tr("Start page"), "home", tip=self.tr("Start page"), icon="home")
        self.name = Elided("SphereCal", "big")
        self.doing = Elided("", "soft")
        self.compiling, self.source, self.validity = Chip(), Chip(), Chip()
        self.compiling.hide()
        self.help = button(self.tr("Help  F1"), "help", icon="help")
        self.more = button(self.tr("Menu"), "menu", icon="menu-2")
        self.menu = QMenu(self)
        self.menu.setToolTipsVisible(True)
        self._icons: dict[QAction, str] = {}
        self.dark = self._option(self.tr("Dark"), self.tr("Light letters on a dark ground."))
        self.far = self._option(self.tr("Large text"), self.tr("Larger letters, to read from three metres."))
        self.mute = self._option(self.tr("Mute"), self.tr("No sounds for accepted, rejected and done."))
        self.goes_on = self._option(
            self.tr("Go on by itself"), self.tr("On to the next step a second after one is done and nothing is wrong.")
        )
        self.show_log = self._option(self.tr("Log"), self.tr("What the program has done, line by line."))
        self.menu.addMenu(self._languages(language))
        self.menu.addSeparator()
        self.copy = self._action(self.tr("Copy as command"), "terminal-2")
        self.bench = self._action(self.tr("Bench, bars and balls"), "sphere")
        self.sound_test = self._action(self.tr("Test the sound"), "volume")
        self.limits = self._action(self.tr("Limits"), "ruler-2")
        self.menu.addMenu(self._training())
        self.menu.addSeparator()
        self.bundle = self._action(self.tr("Save a support bundle"), "package")
        self.about = self._action(self.tr("About SphereCal"), "info-circle")
        self.more.setMenu(self.menu)
        add(row, self.home, theme.SMALL, (self.name, 3), (self.doing, 2), self.compiling, self.source, self.validity)
        add(row, self.help, self.more)
        self.dress()

    def dress(self) -> None:
        """The menu's icons in the colours of now; large text needs the room of a word that an icon says as well."""
        self.home.setText("" if theme.is_far() else self.tr("Start page"))
        for action, name in self._icons.items():
            action.setIcon(menu_icon(name))

    def _action(self, text: str, icon: str) -> QAction:
        action = self.menu.addAction(text)
        self._icons[action] = icon
        return action

    def _option(self, text: str, tip: str) -> QAction:
        """A line of the menu that is on or off."""
        action = QAction(text, self.menu, checkable=True)
        action.setToolTip(tip)
        action.toggled.connect(self.toggled)
        self.menu.addAction(action)  # without an icon, which would stand where its check mark is
        return action

    def _languages(self, language: str) -> QMenu:
        menu = QMenu(self.tr("Language"), self)
        group = QActionGroup(menu)
        for code, name in LANGUAGES.items():
            action = QAction(name, menu, checkable=True)
            action.setChecked(code == language)
            action.setData(code)
            group.addAction(action)
            menu.addAction(action)
        group.triggered.connect(lambda action: self.language_chosen.emit(str(action.data())))
        self._icons[menu.menuAction()] = "language"
        return menu

    def _training(self) -> QMenu:
        """The walk on a simulated rig, with what goes wrong in it."""
        menu = QMenu(self.tr("Train on a simulated rig"), self)
        for fault in FAULTS:
            menu.addAction(word("faults", fault.partition(":")[0])).setData(fault)
        menu.addAction(self.tr("a surprise")).setData(SURPRISE)
        menu.triggered.connect(lambda action: self.training.emit(str(action.data())))
        self._icons[menu.menuAction()] = "school"
        return menu


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
