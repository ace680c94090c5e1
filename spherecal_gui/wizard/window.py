"""The window: header, rail, page, the large buttons, status bar, log."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QCloseEvent, QKeyEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QApplication,
    QDialog,
    QDockWidget,
    QFrame,
    QHBoxLayout,
    QMainWindow,
    QPlainTextEdit,
    QPushButton,
    QStackedWidget,
    QTextBrowser,
    QVBoxLayout,
    QWidget,
)

import spherecal
from spherecal.errors import SpherecalError
from spherecal.resources import resource_path
from spherecal_gui import theme
from spherecal_gui.pages.base import Page
from spherecal_gui.pages.start import StartPage
from spherecal_gui.presenters.start import source_word, validity_of
from spherecal_gui.sounds import Sounds
from spherecal_gui.texts import error_text, reason_text, step_task, step_title
from spherecal_gui.widgets.basic import Banner, Chip, button, enable, label
from spherecal_gui.widgets.rail import Rail
from spherecal_gui.wizard.controller import Controller
from spherecal_gui.wizard.settings import WindowSettings, default_projects
from spherecal_gui.workflow import Status, Step

_TICK_MS = 100
_PATIENCE_MS = 5000


def _page_class(kind: str) -> Callable[[Controller], Page]:
    """The page of a kind of step; imported when it is first needed, so that the window opens at once."""
    if kind == "connect":
        from spherecal_gui.pages.connect import ConnectPage as Made
    elif kind == "look":
        from spherecal_gui.pages.look import LookPage as Made
    elif kind == "placement":
        from spherecal_gui.pages.placement import PlacementPage as Made
    elif kind == "scale":
        from spherecal_gui.pages.bars import ScalePage as Made
    elif kind == "calibrate":
        from spherecal_gui.pages.calibrate import CalibratePage as Made
    elif kind == "results":
        from spherecal_gui.pages.results import ResultsPage as Made
    elif kind == "verify":
        from spherecal_gui.pages.bars import VerifyPage as Made
    else:
        from spherecal_gui.pages.save import SavePage as Made
    return Made


class WizardWindow(QMainWindow):
    """The whole wizard."""

    def __init__(self, projects: Path | None = None, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.projects = projects or default_projects()
        self.settings = WindowSettings()
        self.controller = Controller(self)
        self.sounds = Sounds()
        self.pages: dict[str, Page] = {}
        self.page: Page | None = None
        self._shown_step: Step | None = None
        self.setWindowTitle("SphereCal")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._build()
        self.controller.changed.connect(self.refresh)
        self.controller.said.connect(self._say)
        self.controller.logged.connect(self.lines.appendPlainText)
        self.controller.result_changed.connect(self.refresh)
        self.controller.runner.started.connect(self._work)
        self._timer = QTimer(self)
        self._timer.setInterval(_TICK_MS)
        self._timer.timeout.connect(self._tick)
        self._timer.start()
        self._restore()
        self.show_start()

    # --- building ----------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        middle = QWidget()
        outer = QVBoxLayout(middle)
        outer.setContentsMargins(0, 0, 0, 0)
        outer.setSpacing(0)
        outer.addWidget(self._header())
        row = QHBoxLayout()
        row.setSpacing(0)
        self.rail = Rail()
        self.rail.chosen.connect(self._rail_chosen)
        row.addWidget(self.rail)
        column = QVBoxLayout()
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        head = QVBoxLayout()
        head.setContentsMargins(18, 10, 18, 0)
        head.setSpacing(8)
        self.banner = Banner()
        self.title, self.task = label("", "title", wrap=False), label("", "task")
        head.addWidget(self.banner)
        self._heading = QWidget()
        heading = QHBoxLayout(self._heading)
        heading.setContentsMargins(0, 0, 0, 0)
        heading.addWidget(self.title)
        heading.addSpacing(16)
        heading.addWidget(self.task, 1)
        head.addWidget(self._heading)
        column.addLayout(head)
        self.stack = QStackedWidget()
        self.start = StartPage(self.projects)
        self.start.wanted.connect(self.new_project)
        self.start.opened.connect(self.open_project)
        self.stack.addWidget(self.start)
        column.addWidget(self.stack, 1)
        column.addWidget(self._footer())
        row.addLayout(column, 1)
        outer.addLayout(row, 1)
        self.setCentralWidget(middle)
        self._status_bar()
        self._log()
        for key, act in (
            (Qt.Key.Key_PageDown, self.advance), (Qt.Key.Key_PageUp, self.go_back), (Qt.Key.Key_F1, self.show_help),
        ):  # fmt: skip
            QShortcut(QKeySequence(key), self).activated.connect(act)

    def _header(self) -> QWidget:
        frame = QFrame()
        frame.setObjectName("header")
        row = QHBoxLayout(frame)
        row.setContentsMargins(14, 6, 14, 6)
        self.home = button(self.tr("Start page"), "home")
        self.home.clicked.connect(self.show_start)
        self.name = label("SphereCal", "big", wrap=False)
        row.addWidget(self.home)
        row.addWidget(self.name)
        row.addStretch(1)
        self.far = self._toggle(self.tr("Read from afar"), "far", self.tr("Larger letters, to read from three metres."))
        self.dark = self._toggle(self.tr("Dark"), "dark", self.tr("Light letters on a dark ground."))
        self.mute = self._toggle(self.tr("Mute"), "mute", self.tr("No sounds for accepted, rejected and done."))
        self.show_log = self._toggle(self.tr("Log"), "log", self.tr("What the program has done, line by line."))
        self.help = button(self.tr("Help  F1"), "help")
        self.help.clicked.connect(self.show_help)
        for one in (self.far, self.dark, self.mute, self.show_log, self.help):
            row.addWidget(one)
        return frame

    def _toggle(self, text: str, name: str, tip: str) -> QPushButton:
        one = button(text, name)
        one.setCheckable(True)
        one.setToolTip(tip)
        one.toggled.connect(self._toggled)
        return one

    def _footer(self) -> QWidget:
        self.footer = QFrame()
        self.footer.setObjectName("footer")
        row = QHBoxLayout(self.footer)
        row.setContentsMargins(18, 8, 18, 8)
        self.back = button(self.tr("Back"), "back")
        self.back.clicked.connect(self.go_back)
        self.why = label("", "soft")
        self.show_me = button(self.tr("Show me"), "show-me", "link")
        self.show_me.clicked.connect(self._show_me)
        self.action = button("", "action", "primary")
        self.action.clicked.connect(self._act)
        self.next = button(self.tr("Next"), "next", "primary")
        self.next.clicked.connect(self.go_next)
        row.addWidget(self.back)
        row.addSpacing(12)
        row.addWidget(self.why, 1)
        row.addWidget(self.show_me)
        row.addWidget(self.action)
        row.addWidget(self.next)
        return self.footer

    def _status_bar(self) -> None:
        self.source, self.validity = Chip(), Chip()
        self.doing = label("", "soft", wrap=False)
        bar = self.statusBar()
        bar.setSizeGripEnabled(False)
        bar.addWidget(self.source)
        bar.addWidget(self.validity)
        bar.addWidget(self.doing, 1)
        bar.addPermanentWidget(label(f"SphereCal {spherecal.__version__}", "soft", wrap=False))

    def _log(self) -> None:
        self.lines = QPlainTextEdit()
        self.lines.setReadOnly(True)
        self.lines.setMaximumBlockCount(5000)
        self.lines.setAccessibleName(self.tr("Log"))
        self.log_dock = QDockWidget(self.tr("Log"), self)
        self.log_dock.setObjectName("log-dock")
        self.log_dock.setWidget(self.lines)
        self.log_dock.hide()
        self.addDockWidget(Qt.DockWidgetArea.BottomDockWidgetArea, self.log_dock)

    def _restore(self) -> None:
        geometry = self.settings.geometry
        if geometry is None or not self.restoreGeometry(geometry):
            self.resize(1280, 800)
        hints = QApplication.styleHints()
        system_dark = hints is not None and hints.colorScheme() == Qt.ColorScheme.Dark
        for one, name, default in (
            (self.dark, "dark", system_dark),
            (self.far, "far", False),
            (self.mute, "mute", False),
        ):
            one.blockSignals(True)
            one.setChecked(self.settings.flag(name, default))
            one.blockSignals(False)
        self._dress()

    # --- look --------------------------------------------------------------------------------------------------------

    def _toggled(self) -> None:
        self.log_dock.setVisible(self.show_log.isChecked())
        for one, name in ((self.dark, "dark"), (self.far, "far"), (self.mute, "mute")):
            self.settings.set_flag(name, one.isChecked())
        self._dress()

    def _dress(self) -> None:
        application = QApplication.instance()
        assert isinstance(application, QApplication)
        self.sounds.muted = self.mute.isChecked()
        wanted = (self.dark.isChecked(), self.far.isChecked())
        if wanted == getattr(self, "_dressed", None):
            return
        self._dressed = wanted
        theme.apply(application, *wanted)
        self.rail.fit()
        for page in self.pages.values():
            if page is self.page:
                page.dress()
        self.refresh()

    # --- what is shown -----------------------------------------------------------------------------------------------

    def show_start(self) -> None:
        """The start page; the project is saved as it is."""
        if self.controller.project is not None:
            if self.controller.runner.running:
                self._say("info", self.tr("Work is running; wait for it or cancel it."), "")
                return
            self.controller.close_project()
        self.refresh()

    def new_project(self, source: str) -> None:
        """A new calibration with images from this source."""
        self._try(lambda: self.controller.new_project(source, self.projects))

    def open_project(self, folder: str, step: str = "") -> None:
        """Go on with a project."""
        self._try(lambda: self.controller.open_project(Path(folder)))
        if step:
            self.controller.go(step)

    def _try(self, act: Callable[[], None]) -> None:
        try:
            act()
        except SpherecalError as error:
            self._say("bad", *error_text(error))

    def refresh(self) -> None:
        """Show the state as it is."""
        state = self.controller.state
        self.rail.setVisible(state is not None)
        self.footer.setVisible(state is not None)
        self._heading.setVisible(state is not None)
        self.home.setVisible(state is not None)
        self._show_status()
        if state is None:
            if self.page is not None:
                self.page.leave()
            self.page, self._shown_step = None, None
            self.name.setText("SphereCal")
            self.start.refresh()
            self.stack.setCurrentWidget(self.start)
            return
        assert self.controller.project is not None
        self.name.setText(self.controller.project.folder.name)
        self.rail.show_state(state)
        self._show_step(state.now.step)
        self._show_buttons()

    def _show_step(self, step: Step) -> None:
        if step == self._shown_step:
            if self.page is not None:
                self.page.refresh()
            return
        if self.page is not None:
            self.page.leave()
        self._shown_step = step
        self.title.setText(step_title(step))
        self.task.setText(step_task(step))
        page = self.pages.get(step.kind)
        if page is None:
            page = _page_class(step.kind)(self.controller)
            page.action_changed.connect(self._show_buttons)
            self.pages[step.kind] = page
            self.stack.addWidget(page)
        self.page = page
        self.stack.setCurrentWidget(page)
        page.enter(step)
        self.setFocus()

    def _show_buttons(self) -> None:
        state = self.controller.state
        if state is None or self.page is None or self._shown_step is None or state.current != self._shown_step.id:
            return
        had_focus = QApplication.focusWidget() in (self.action, self.next, self.back, self, None)
        action = self.page.action()
        self.action.setVisible(action is not None and not (action.done and not action.enabled))
        if action is not None:
            self.action.setText(action.text)
            self.action.setAccessibleName(action.text)
            enable(self.action, action.enabled, action.why)
        after = state.after(state.current)
        running = self.controller.runner.running
        can_go = after is not None and after.open
        reason = None if can_go or after is None else after.reason
        enable(self.next, can_go, reason_text(reason))
        self.next.setVisible(after is not None)
        done = state.now.status is Status.DONE or (action is not None and action.done)
        self._set_kind(self.next, "primary" if done else "plain")
        self._set_kind(self.action, "plain" if action is not None and action.done else "primary")
        enable(self.back, state.before(state.current) is not None, self.tr("This is the first step."))
        blocked = action.why if action is not None and not action.enabled and not action.done else ""
        self.why.setText(blocked or ("" if running else reason_text(reason)))
        goal = reason.go_to if reason is not None and not blocked else None
        goal = goal if goal not in (None, state.current) and not running else None
        self.show_me.setVisible(goal is not None)
        self.show_me.setProperty("goal", goal or "")
        if had_focus:
            best = self.next if done and can_go else self.action
            (best if best.isEnabled() and best.isVisible() else self).setFocus()

    @staticmethod
    def _set_kind(one: QPushButton, kind: str) -> None:
        if one.objectName() != kind:
            one.setObjectName(kind)
            one.style().unpolish(one)
            one.style().polish(one)

    def _show_status(self) -> None:
        project, connection = self.controller.project, self.controller.connection
        self.source.setVisible(project is not None)
        if project is not None:
            word = source_word(project.source)
            found = (
                f"{len(connection.names)} " + self.tr("cameras") if connection is not None else self.tr("not connected")
            )
            live = project.source.startswith("genicam")
            level = "bad" if connection is None else "good" if live else "caution"
            self.source.show_state(
                f"{word} · {found}", level, connection.source.label if connection is not None else ""
            )
        word, level, details = validity_of(self.projects / "rig-profile")
        self.validity.show_state(word, level, details)
        self.start.validity.show_state(word, level, details)

    def _say(self, kind: str, text: str, hint: str) -> None:
        if kind == "good" or (kind == "bad" and self._page_tells()):  # a message would only push the page about
            self.banner.hide()
        else:
            self.banner.tell(kind, text, hint)
        state = self.controller.state
        finished = kind == "good" and state is not None and state.current in ("calibrate", "verify", "save")
        self.sounds.play("done" if finished else kind)

    def _page_tells(self) -> bool:
        """Whether the page itself shows the error, large."""
        state = self.controller.state
        return state is not None and state.current in ("connect", "calibrate") and state.now.status is Status.FAILED

    def _work(self, _: str) -> None:
        if self.banner.isVisible():
            self.banner.hide()

    def _tick(self) -> None:
        if self.page is not None:
            self.page.tick()
        task = self.controller.runner.task
        if task is None:
            self.doing.setText("")
        elif task.name != "calibrate":
            news = task.take_news()
            if news:
                self.doing.setText(f"{news[-1].stage} {news[-1].message}".strip())
        live = self.controller.live
        if live is not None and live.problem is not None:
            problem, live.problem = live.problem, None
            self._say("bad", *error_text(problem))

    # --- what is done ------------------------------------------------------------------------------------------------

    def _rail_chosen(self, step: str) -> None:
        state = self.controller.state
        if state is None:
            return
        wanted = state.of(step)
        if wanted.open:
            self.controller.go(step)
        else:
            self._say("info", f"{step_title(wanted.step)}: {reason_text(wanted.reason)}", "")

    def _act(self) -> None:
        if self.page is not None:
            action = self.page.action()
            if action is not None and action.enabled:
                self.page.act()

    def go_next(self) -> None:
        """The next step, if it is open."""
        state = self.controller.state
        after = state.after(state.current) if state is not None else None
        if after is not None and after.open:
            self.banner.hide()
            self.controller.go(after.step.id)

    def go_back(self) -> None:
        """The step before."""
        state = self.controller.state
        before = state.before(state.current) if state is not None else None
        if before is not None and before.open:
            self.banner.hide()
            self.controller.go(before.step.id)

    def advance(self) -> None:
        """Space bar, foot switch, presenter remote: the page's work, or on when it is done; it never cancels."""
        if self.page is None:
            return
        action = self.page.action()
        if action is not None and action.enabled and not action.done:
            if self.controller.runner.running is None:
                self.page.act()
        elif action is None or action.done:
            self.go_next()

    def _show_me(self) -> None:
        goal = str(self.show_me.property("goal"))
        if goal:
            self.controller.go(goal)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """The space bar, where nothing else wants it."""
        if event.key() in (Qt.Key.Key_Space, Qt.Key.Key_Return, Qt.Key.Key_Enter) and not event.isAutoRepeat():
            self.advance()
        else:
            super().keyPressEvent(event)

    def show_help(self) -> QDialog:
        """Help for the step, offline."""
        kind = self._shown_step.kind if self._shown_step is not None else "start"
        dialog = QDialog(self)
        dialog.setWindowTitle(self.tr("Help"))
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        text = QTextBrowser()
        text.setOpenExternalLinks(False)
        path = resource_path("help", "en", f"{kind}.html")
        text.setHtml(path.read_text(encoding="utf-8") if path.is_file() else self.tr("There is no help for this step."))
        column = QVBoxLayout(dialog)
        column.addWidget(text)
        dialog.resize(720, 560)
        dialog.show()
        return dialog

    def closeEvent(self, event: QCloseEvent) -> None:
        """Everything is on disk: stop what runs, let go of the cameras."""
        self._timer.stop()
        self.settings.geometry = self.saveGeometry()
        self.settings.sync()
        if not self.controller.runner.close(_PATIENCE_MS):
            self._timer.start()
            self._say("info", self.tr("The computation is still stopping; close the window again in a moment."), "")
            event.ignore()
            return
        if self.page is not None:
            self.page.leave()
        for page in self.pages.values():
            page.close_page()
        self.controller.changed.disconnect(self.refresh)
        self.controller.close_project()
        self.sounds.close()
        event.accept()
