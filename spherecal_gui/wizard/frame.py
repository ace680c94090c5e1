"""The window's frame: what is where, how it looks, what it remembers."""

from pathlib import Path

from PySide6.QtCore import QByteArray, QEvent, QObject, QSignalBlocker, QSize, Qt
from PySide6.QtGui import QAction, QResizeEvent
from PySide6.QtWidgets import (
    QApplication,
    QDockWidget,
    QFrame,
    QHBoxLayout,
    QMainWindow,
    QPlainTextEdit,
    QScrollArea,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from spherecal_gui import languages, theme
from spherecal_gui.pages.start_page import StartPage
from spherecal_gui.sounds import Sounds
from spherecal_gui.widgets.basic import Banner, add, bare, label, named, spaced
from spherecal_gui.widgets.icons import dress_icons
from spherecal_gui.widgets.rail import Rail
from spherecal_gui.wizard.dialogs import about_dialog
from spherecal_gui.wizard.header import Footer, Header
from spherecal_gui.wizard.window_settings import default_projects, window_settings


class _Pages(QStackedWidget):
    """As large as the page shown, not as the largest."""

    def minimumSizeHint(self) -> QSize:
        """The page's."""
        page = self.currentWidget()
        return super().minimumSizeHint() if page is None else page.minimumSizeHint()


class _PageArea(QScrollArea):
    """Scrolls a page larger than a small screen, which the window would outgrow; Qt's own resizing scrolls too soon."""

    def __init__(self, pages: _Pages) -> None:
        super().__init__()
        self._pages = pages
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setWidget(pages)
        pages.currentChanged.connect(self._fit)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """The window has another size."""
        super().resizeEvent(event)
        self._fit()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The page asks for another size."""
        if event.type() == QEvent.Type.LayoutRequest:
            self._fit()
        return super().eventFilter(watched, event)

    def _fit(self) -> None:
        page = self._pages.currentWidget()
        if page is None:
            return
        room, needed = self.maximumViewportSize(), page.minimumSizeHint()
        if needed.height() > room.height():  # its scroll bar takes some of the width
            room.setWidth(room.width() - self.verticalScrollBar().sizeHint().width())
        self._pages.resize(room.expandedTo(needed))


class WindowFrame(QMainWindow):
    """All parts of the window around the page; what they do is connected by the window itself."""

    goes_on_at_first = True  # unless the settings say otherwise

    def __init__(self, projects: Path | None = None) -> None:
        super().__init__()
        self.projects = projects or default_projects()
        self.settings = window_settings()
        self.sounds = Sounds()
        self._dressed: tuple[bool, bool] | None = None
        self.setWindowTitle("SphereCal")
        application = QApplication.instance()
        assert isinstance(application, QApplication)
        # before there are widgets: those that exist keep the font that they were made with
        theme.apply(application, self._remembered("dark"), self._remembered("far"))
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._build()

    def _build(self) -> None:
        self.header = Header(languages.now())
        self.header.toggled.connect(self._toggled)
        self.header.about.triggered.connect(lambda: about_dialog(self))
        self.source, self.validity, self.doing = self.header.source, self.header.validity, self.header.doing
        middle = QWidget()
        outer = add(bare(QVBoxLayout(middle), 0), self.header)
        self.rail = Rail()
        self.stack = _Pages()
        self.start = StartPage(self.projects)
        self.header.validity.clicked.connect(self.start.show_profile)
        self.header.training.connect(self.start.train)
        self.stack.addWidget(self.start)
        self.footer = Footer()
        self.title, self.task = label("", "title", wrap=False), label("", "task")
        self._heading = QWidget()
        add(bare(QHBoxLayout(self._heading)), self.title, 16, (self.task, 1))
        head = add(spaced(QVBoxLayout(), theme.SMALL), self._heading)
        head.setContentsMargins(theme.PAD, theme.SMALL, theme.PAD, 0)
        column = add(bare(QVBoxLayout(), 0), head, (_PageArea(self.stack), 1), self.footer)
        outer.addLayout(add(spaced(QHBoxLayout(), 0), self.rail, (column, 1)), 1)
        self.setCentralWidget(middle)
        self.banner = Banner(middle)
        self.lines = named(QPlainTextEdit(readOnly=True, maximumBlockCount=5000), "", self.tr("Log"))
        self.log_dock = named(QDockWidget(self.tr("Log"), self), "log-dock")
        self.log_dock.setWidget(self.lines)
        self.log_dock.hide()
        self.addDockWidget(Qt.DockWidgetArea.BottomDockWidgetArea, self.log_dock)

    def show_compiling(self, percent: int) -> None:
        """How far the kernels are compiled in the background; nothing at 100."""
        words = self.tr("Preparing computations: {percent} %").format(percent=percent)
        details = self.tr("Once after the installation, while the computer has time. Everything works already.")
        self.header.compiling.show_state(words if percent < 100 else "", "none", details)
        self.header.compiling.setVisible(percent < 100 and self.stack.currentWidget() is self.start)

    def _restore(self) -> None:
        geometry = self.settings.value("geometry")
        if not isinstance(geometry, QByteArray) or not self.restoreGeometry(geometry):
            self.resize(1280, 800)
            self.setWindowState(Qt.WindowState.WindowMaximized)
        for name, one in self._options().items():
            with QSignalBlocker(one):
                one.setChecked(self._remembered(name))
        self._dress()

    def _remembered(self, name: str) -> bool:
        """Whether an option is on: as it was left, else as it is at first."""
        at_first = name == "dark" or (name == "goes-on" and self.goes_on_at_first)
        return bool(self.settings.value(name, at_first, type=bool))

    def _options(self) -> dict[str, QAction]:
        head = self.header
        return {"dark": head.dark, "far": head.far, "mute": head.mute, "goes-on": head.goes_on}

    def _toggled(self) -> None:
        self.log_dock.setVisible(self.header.show_log.isChecked())
        for name, one in self._options().items():
            self.settings.setValue(name, one.isChecked())
        self._dress()

    def _dress(self) -> None:
        application = QApplication.instance()
        assert isinstance(application, QApplication)
        was_muted, self.sounds.muted = self.sounds.muted, self.header.mute.isChecked()
        if was_muted and not self.sounds.muted and self._dressed is not None:
            self.sounds.play("good")  # this is how it sounds
        wanted = (self.header.dark.isChecked(), self.header.far.isChecked())
        if wanted == self._dressed:
            return
        self._dressed = wanted
        theme.apply(application, *wanted)
        self.rail.fit()
        dress_icons(self)
        self.header.dress()
        self.banner.dress()
        self.redraw()

    def redraw(self) -> None:
        """The colours or sizes are others."""
