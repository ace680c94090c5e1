"""The window's head: the way back to the start, the project's name, and how everything looks and sounds."""

from PySide6.QtCore import Signal
from PySide6.QtGui import QAction, QActionGroup
from PySide6.QtWidgets import QFrame, QHBoxLayout, QMenu, QPushButton, QWidget

from spherecal_gui.languages import LANGUAGES
from spherecal_gui.widgets.basic import Elided, button, plain


class Header(QFrame):
    """Buttons that are there on every page; `toggled` when one that stays pressed has changed."""

    toggled = Signal()
    language_chosen = Signal(str)
    about = Signal()
    bundle = Signal()
    limits = Signal()
    bench = Signal()

    def __init__(self, language: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("header")
        row = QHBoxLayout(self)
        row.setContentsMargins(14, 6, 14, 6)
        self.home = button(self.tr("Start page"), "home")
        self.name = Elided("SphereCal", "big")
        row.addWidget(self.home)
        row.addWidget(self.name, 1)
        self.far = self._toggle(self.tr("Read from afar"), "far", self.tr("Larger letters, to read from three metres."))
        self.dark = self._toggle(self.tr("Dark"), "dark", self.tr("Light letters on a dark ground."))
        self.mute = self._toggle(self.tr("Mute"), "mute", self.tr("No sounds for accepted, rejected and done."))
        self.show_log = self._toggle(self.tr("Log"), "log", self.tr("What the program has done, line by line."))
        self.help = button(self.tr("Help  F1"), "help")
        self.more = button(self.tr("More"), "menu")
        self.more.setMenu(self._menu(language))
        for one in (self.far, self.dark, self.mute, self.show_log, self.help, self.more):
            row.addWidget(one)

    def _toggle(self, text: str, name: str, tip: str) -> QPushButton:
        one = button(text, name)
        one.setCheckable(True)
        one.setToolTip(plain(tip))
        one.toggled.connect(self.toggled)
        return one

    def _menu(self, language: str) -> QMenu:
        menu = QMenu(self)
        group = QActionGroup(menu)
        for code, name in LANGUAGES.items():
            action = QAction(name, menu, checkable=True)
            action.setChecked(code == language)
            action.setData(code)
            group.addAction(action)
            menu.addAction(action)
        group.triggered.connect(self._language)
        menu.addSeparator()
        menu.addAction(self.tr("Bench, bars and balls"), self.bench.emit)
        menu.addAction(self.tr("Limits"), self.limits.emit)
        menu.addAction(self.tr("Save a support bundle"), self.bundle.emit)
        menu.addAction(self.tr("About SphereCal"), self.about.emit)
        return menu

    def _language(self, action: QAction) -> None:
        self.language_chosen.emit(str(action.data()))
