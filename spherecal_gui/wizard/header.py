"""The window's head: the way back, project, state of cameras and calibration, help, and a menu with the rest."""

from PySide6.QtCore import Signal
from PySide6.QtGui import QAction, QActionGroup
from PySide6.QtWidgets import QFrame, QHBoxLayout, QMenu

from spherecal_gui import theme
from spherecal_gui.languages import LANGUAGES, word
from spherecal_gui.presenters.start_presenter import FAULTS, SURPRISE
from spherecal_gui.widgets.basic import Chip, Elided, add, button, spaced
from spherecal_gui.widgets.icons import menu_icon


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
        self.studies = self._action(self.tr("Compare methods"), "chart-bar")
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
