"""The window: header, rail, page, the large buttons, status bar, log."""

from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QCloseEvent, QFocusEvent, QGuiApplication, QKeyEvent, QKeySequence, QShortcut, QShowEvent
from PySide6.QtWidgets import QApplication, QDialog, QWidget

from spherecal.base.errors import SpherecalError
from spherecal_gui import languages, theme
from spherecal_gui.controllers.camera_controller import DriverQuestion
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import error_text, reason_text, step_title
from spherecal_gui.pages.limits_dialog import LimitsDialog
from spherecal_gui.pages.wizard_page import Page, load_pages, loaded, page_class
from spherecal_gui.presenters.limits_presenter import load_limits
from spherecal_gui.presenters.look_presenter import bump_text
from spherecal_gui.presenters.start_presenter import source_word, validity_of
from spherecal_gui.project_folder import is_project, load_project, profile_shown, rig_bench, write_bench
from spherecal_gui.standing import camera_level
from spherecal_gui.tasks.task import BackgroundTask
from spherecal_gui.wizard.dialogs import bundle_dialog, driver_dialog, help_dialog, versions
from spherecal_gui.wizard.frame import WindowFrame
from spherecal_gui.wizard.keys import Guard, Keys, Onward
from spherecal_gui.wizard.window_settings import expected_s, pace_key, read_durations, with_duration
from spherecal_gui.workflow import Status, Step, StepKind

_TICK_MS = 100
_LOOK_EVERY = 10  # ticks between two looks for the project's folder
_PATIENCE_MS = 5000
# Reasons that a headline has.
_SAID_BY_PAGES = ("inconsistent", "taken without", "taken moving", "not valid", "recalibrate")


class WizardWindow(WindowFrame):
    """The whole wizard."""

    def __init__(self, projects: Path | None = None, controller: Controller | None = None) -> None:
        """A `controller` that is given belongs to another window and is only shown here."""
        super().__init__(projects)
        self.controller = controller or Controller(self)
        self._own = controller is None
        self.pages: dict[str, Page] = {}
        self.page: Page | None = None
        self._shown_step: Step | None = None
        self._closed = False
        self._lost: tuple[str, ...] = ()
        self._alarmed = self._ready = False
        self._ticks = 0
        self.guard = Guard()
        self.onward = Onward()
        self.keys = Keys(self, self.header, self.press)
        self._bumped: Mapping[str, float] = {}
        self._timed: BackgroundTask | None = None  # the work whose time is shown
        self.bench = ""  # what is at the real rig, where the command line names it
        self._connect()
        self._timer = QTimer(self, interval=_TICK_MS)
        self._timer.timeout.connect(self._tick)
        self._timer.start()
        self._restore()
        self.refresh()
        if damaged := load_limits():
            self.controller.note(damaged)
            self.banner.tell("bad", damaged)

    def _connect(self) -> None:
        self.controller.changed.connect(self.refresh)
        self.controller.said.connect(self._say)
        self.controller.logged.connect(self.lines.appendPlainText)
        self.controller.result_changed.connect(self.refresh)
        self.controller.runner.started.connect(self.banner.hide)
        self.controller.runner.lasted.connect(self._remember_pace)
        if self._own:
            self.controller.cameras.driver_asked.connect(self._ask_driver)
            self.controller.cameras.connected.connect(load_pages)
            self.controller.cameras.somebody_answers = True
        self.header.home.clicked.connect(self.show_start)
        self.header.help.clicked.connect(self.show_help)
        self.header.bundle.triggered.connect(self.offer_bundle)
        self.header.copy.triggered.connect(self.copy_command)
        self.header.limits.triggered.connect(self._show_limits)
        self.header.sound_test.triggered.connect(self._test_sound)
        self.header.bench.triggered.connect(self.edit_bench)
        self.start.bench_wanted.connect(self.edit_bench)
        self.rail.chosen.connect(self._rail_chosen)
        self.start.wanted.connect(self.new_project)
        self.start.board_wanted.connect(self.new_board_project)
        self.start.opened.connect(self.open_project)
        self.start.check_wanted.connect(self.new_check)
        self.start.verification_wanted.connect(self.new_verification)
        self.start.said.connect(self._say)
        self.footer.asked_for.connect(self.controller.go)
        self.footer.acted.connect(lambda: self.page.act() if self.page is not None else None)
        self.footer.settled.connect(self._show_buttons)
        self.footer.back.clicked.connect(self.go_back)
        self.footer.next.clicked.connect(self.go_next)
        QShortcut(QKeySequence(Qt.Key.Key_PageDown), self).activated.connect(self.press)
        QShortcut(QKeySequence(Qt.Key.Key_PageUp), self).activated.connect(self.go_back)
        QShortcut(QKeySequence(Qt.Key.Key_F1), self).activated.connect(self.show_help)

    def redraw(self) -> None:
        """The colours or sizes are others."""
        if self.page is not None:
            self.page.dress()
        self.refresh()

    # --- what is shown -----------------------------------------------------------------------------------------------

    def show_start(self) -> None:
        """The start page; the project is saved as it is."""
        if self.controller.project is not None:
            if self.controller.runner.running:
                self._say("info", self.tr("Work is running; wait for it or cancel it."), "")
                return
            self._drop_pages()  # while there is a project in which they can leave what was typed
            self.controller.close_project()
        self.refresh()

    def new_project(self, source: str) -> None:
        """A new calibration with images from this source."""
        own = rig_bench(self.projects)
        bench = (self.bench or (str(own) if own.is_file() else "")) if source == "genicam" else ""
        self._try(lambda: self.controller.new_project(source, self.projects, bench))

    def new_board_project(self, board: dict[str, object], source: str = "genicam") -> None:
        """A new calibration with a board in place of the ball."""
        self._try(lambda: self.controller.new_project(source, self.projects, str(write_bench(self.projects, board))))

    def new_check(self, like: str) -> None:
        """A check of the calibration in use, with cameras and bench of an earlier project."""
        self._try(lambda: self.controller.new_check(load_project(Path(like))))

    def new_verification(self, like: str) -> None:
        """A verification of the calibration in use, with cameras and bench of an earlier project."""
        self._try(lambda: self.controller.new_verification(load_project(Path(like))))

    def open_project(self, folder: str) -> None:
        """Go on with a project; a session is shown as live cameras, a folder of images is imported first."""
        there = Path(folder)
        if is_project(there) or not there.is_dir():
            self._try(lambda: self.controller.open_project(there))
        elif (there / "session.json").is_file():
            self.new_project(f"replay:{folder}")
        else:
            self._import(there)

    def _import(self, images: Path) -> None:
        """Show how a folder of images is read, and make a session of it once somebody agrees."""
        from spherecal_gui.pages.images_dialogs import ImportDialog  # needs scipy and OpenCV

        try:
            self.import_dialog = ImportDialog(images, self.projects, self)
        except SpherecalError as error:
            self._say("bad", *error_text(error))
            return
        self.import_dialog.imported.connect(self._imported)
        self.import_dialog.show()

    def _imported(self, folder: str, assumed: str) -> None:
        self.new_project(f"replay:{folder}")
        if assumed:
            self._say("info", self.tr("Imported. Assumed: {what}.").format(what=assumed), "")

    def copy_command(self) -> None:
        """The command lines that give the same files."""
        commands = self.controller.saving.commands() if self.controller.project is not None else []
        if not commands:
            self._say("info", self.tr("There is no command yet: calibrate first."), "")
            return
        QGuiApplication.clipboard().setText("\n".join(commands))
        self._say("info", self.tr("Copied."), commands[0])

    def _show_limits(self) -> None:
        dialog = LimitsDialog(self.controller.profile_folder or profile_shown(self.projects), self)
        dialog.changed.connect(self._limits_changed)
        dialog.open()

    def _limits_changed(self, lines: list[str]) -> None:
        for line in lines:
            self.controller.note(languages.translate("Limits", "Limit changed: {line}").format(line=line))
        self.redraw()

    def _test_sound(self) -> None:
        """Play it where somebody can hear it, or say why not."""
        wrong = self.sounds.test()
        self._say("bad" if wrong else "info", wrong or self.tr("A sound was played. Was it heard?"), "")

    def edit_bench(self) -> None:
        """Describe ball, bars and limits."""
        from spherecal_gui.pages.bench_dialog import show_bench  # needs scipy

        self.bench_dialog = show_bench(self.controller, self.projects, self)
        self.bench_dialog.limits_wanted.connect(self._show_limits)

    def _try(self, act: Callable[[], None]) -> None:
        """Do it; the first time it loads what takes seconds, so the window says at once that it was heard."""
        self._tell_doing(self.tr("Opening"))
        self.start.setEnabled(False)
        self.repaint()
        QGuiApplication.setOverrideCursor(Qt.CursorShape.WaitCursor)
        try:
            act()
        except SpherecalError as error:
            self._say("bad", *error_text(error))
        finally:
            QGuiApplication.restoreOverrideCursor()
            self.start.setEnabled(True)
            self._tell_doing(self.controller.progress_text())

    def refresh(self) -> None:
        """Show the state as it is."""
        state = self.controller.state
        self.keys.on_start_page = state is None
        self.header.compiling.setVisible(state is None and bool(self.header.compiling.text))
        for part in (self.rail, self.footer, self._heading, self.header.home):
            part.setVisible(state is not None)
        self._show_source()
        self._lost = self.controller.cameras.lost()
        word, level, details = validity_of(self.controller.profile_folder or profile_shown(self.projects))
        self.validity.show_state(word, level, details)
        self.validity.setVisible(self.controller.project is not None)  # the start page says it, large
        self.start.validity.show_state(word, level, details)
        if state is None:
            self._drop_pages()
            self.guard.enter(None)
            self.header.name.setText("SphereCal")
            self.start.refresh()
            self.stack.setCurrentWidget(self.start)
            self.setFocus()
            return
        assert self.controller.project is not None
        self.header.name.setText(self.controller.project.folder.name)
        self._show_step(state.now.step)
        self._show_buttons()

    def _drop_pages(self) -> None:
        """Pages belong to one project: the next one's know nothing of enlarged cameras, scenes and messages of this."""
        if self.page is not None:
            self.page.leave()
        for page in self.pages.values():
            page.close_page()
            self.stack.removeWidget(page)
            page.deleteLater()
        self.pages.clear()
        self.page, self._shown_step = None, None

    def _show_step(self, step: Step) -> None:
        if step == self._shown_step:
            if self.page is not None:
                self.page.refresh()
            return
        if self.page is not None:
            self.page.leave()
        self._shown_step = step
        self.guard.enter(step.id)
        self.start.close_profile()
        self.title.setText(step_title(step))
        self.task.setText(languages.word("tasks", step.kind))
        self.page = page = self._page_of(step.kind)
        self.stack.setCurrentWidget(page)
        page.enter(step)
        self.setFocus()

    def _page_of(self, kind: StepKind) -> Page:
        """The page of a kind of step, made where it is not there yet."""
        page = self.pages.get(kind)
        if page is None:
            page = self.pages[kind] = page_class(kind)(self.controller)
            page.action_changed.connect(self._show_buttons)
            page.finished.connect(self.show_start)
            page.bench_wanted.connect(self.edit_bench)
            page.recording_wanted.connect(self.start.choose_recording)
            if (layout := page.layout()) is not None:  # in one line with heading and footer
                layout.setContentsMargins(theme.PAD, theme.SMALL, theme.PAD, theme.SMALL)
            self.stack.addWidget(page)
        return page

    def _make_ahead(self) -> None:
        """One of the pages to come, while images are captured or computed with: nobody presses anything then."""
        state = self.controller.state
        if state is None or self.controller.runner.running is None:
            return
        for kind in (one.step.kind for one in state.steps):
            if kind not in self.pages and kind in loaded:
                for one in self._page_of(kind).findChildren(QWidget):
                    one.ensurePolished()
                return

    def _show_buttons(self) -> None:
        state = self.controller.state
        if state is None or self.page is None or self._shown_step is None or state.current != self._shown_step.id:
            return
        self.page.alarmed = self.banner.alarms
        self._show_source()
        standing = self.page.standing()
        self.rail.show_state(state, standing)
        # a tone when ball or bar can be captured: somebody may stand at the rig with the back to the screen
        kind = self._shown_step.kind if self._shown_step is not None else None
        ready = kind in ("placement", "scale", "verify") and standing.level == "good" and standing.default == "action"
        if ready and not self._ready:
            self.sounds.play("ready")
        self._ready = ready
        self.footer.show_standing(standing, state, self.controller.runner.running is not None)

    def _show_source(self) -> None:
        project, connection = self.controller.project, self.controller.cameras.connection
        self.source.setVisible(project is not None)
        if project is not None:
            found = self.tr("not connected")
            lost = self.controller.cameras.lost()
            if connection is not None:
                found = self.tr("{count} cameras").format(count=len(connection.names))
            if lost:
                found = self.tr("without {cameras}").format(cameras=languages.listed(lost))
            live = project.source.startswith("genicam")
            state = self.controller.state
            kind = state.now.step.kind if state is not None else None
            says = self.page.said().level if self.page is not None and kind == "connect" else "none"
            level = camera_level(bool(lost), connection is not None, kind, live, says)
            if connection is None and self.controller.runner.running == "connect":
                found, level = self.tr("connecting"), "none"
            details = connection.source.label if connection is not None else ""
            self.source.show_state(f"{source_word(project.source)} · {found}", level, details)

    def _say(self, kind: str, text: str, hint: str) -> None:
        if kind == "good" or (kind == "bad" and self._page_tells(text)):  # a message would only push the page about
            self.banner.hide()
        else:
            self.banner.tell(kind, text, hint)
        state = self.controller.state
        finished = kind == "good" and state is not None and state.current in ("calibrate", "verify", "save", "check")
        self.sounds.play("done" if finished else kind)

    def _page_tells(self, text: str) -> bool:
        """Whether the page itself says it, large: what its step failed with, what is wrong with its set or result."""
        state = self.controller.state
        if state is None or state.now.status is not Status.FAILED or state.now.reason is None:
            return False
        return text in reason_text(state.now.reason) or state.now.reason.code in _SAID_BY_PAGES

    def _tick(self) -> None:
        self._ticks += 1
        if self._ticks % _LOOK_EVERY == 0:
            self.controller.look_for_folder()
            self._make_ahead()
        if self.page is not None:
            self.page.tick()
        if (lost := self.controller.cameras.lost()) != self._lost:
            if set(lost) - set(self._lost):
                self.sounds.play("lost")
            self.refresh()
        if self.banner.alarms != self._alarmed:
            self._alarmed = self.banner.alarms
            self._show_buttons()
            if self.page is not None:
                self.page.show_standing()
        task = self.controller.runner.task
        self._show_doing(task)
        self._go_on()
        live = self.controller.cameras.live
        if live is None:
            return
        if live.problem is not None:
            problem, live.problem = live.problem, None
            self._say("bad", *error_text(problem))
        if (bumped := live.watch.bumped) != self._bumped:
            names = {live.connection.names[serial]: px for serial, px in bumped.items() if serial not in self._bumped}
            self._bumped = bumped
            self.refresh()
            if names:  # the page says it, in its headline
                self.controller.note(" ".join(bump_text(names)))
                self.sounds.play("bad")

    def _show_doing(self, task: BackgroundTask | None) -> None:
        """What runs, in the same words as on its page."""
        if task is not self._timed:
            self._timed = task
            if task is not None:
                task.usual_s = expected_s(read_durations(str(self.settings.value(pace_key(task.name)))))
        self.controller.computation.follow()
        here = task is not None and self._shown_step is not None and task.name == self._shown_step.id
        shown = here or (self.page is not None and self.page.said().left)  # the page says it, large
        self._tell_doing("" if shown else self.controller.progress_text())

    def _tell_doing(self, text: str) -> None:
        """What runs, in the header; without it the project's name has the room."""
        self.doing.setText(text)
        self.doing.setVisible(bool(text))

    def _remember_pace(self, name: str, seconds: float) -> None:
        before = str(self.settings.value(pace_key(name)))
        self.settings.setValue(pace_key(name), with_duration(before, seconds))

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

    def go_next(self) -> None:
        """The next step, if it is open."""
        state = self.controller.state
        after = state.after(state.current) if state is not None else None
        if after is not None and after.open and self.page is not None and not self.page.said().stay:
            self.banner.hide()
            self.controller.go(after.step.id)

    def _go_on(self) -> None:
        """On to the next step by itself; not under a dialog, nor under a finger."""
        if not (self.header.goes_on.isChecked() and self._own) or self.page is None or self._shown_step is None:
            return
        busy = self.controller.runner.running is not None or QApplication.activeModalWidget() is not None
        pressed = QApplication.mouseButtons() != Qt.MouseButton.NoButton
        if not (busy or pressed) and self.onward.feed(self._shown_step, self.page.standing()):
            self.go_next()

    def go_back(self) -> None:
        """The step before."""
        state = self.controller.state
        before = state.before(state.current) if state is not None else None
        if before is not None and before.open:
            self.banner.hide()
            self.controller.go(before.step.id)

    def advance(self) -> bool:
        """The page's work, or on when it is done, as its standing has it; it never cancels. Whether it did either."""
        if self.page is None or self.controller.runner.running is not None:
            return False
        default = self.page.standing().default
        if default == "action":
            self.page.act()
        elif default == "next":
            self.go_next()
        return default != ""

    def press(self) -> None:
        """The space bar, a foot switch, a presenter's remote: advance, unless the page is new or has just acted."""
        if self.guard.allows():
            if self.advance():
                self.guard.acted()
        elif self.page is not None:
            self.page.show_standing()

    def showEvent(self, event: QShowEvent) -> None:
        """From now on there is a window whose keys can be heard."""
        super().showEvent(event)
        self.keys.listen()

    def focusInEvent(self, event: QFocusEvent) -> None:
        """After a click on what keeps no focus, such as an option, or a dialog: the large button has it again."""
        super().focusInEvent(event)
        self.footer.take_focus()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """The space bar where no widget has the focus."""
        if event.key() == Qt.Key.Key_Space and not event.isAutoRepeat():
            self.press()
        else:
            super().keyPressEvent(event)

    def show_help(self) -> QDialog:
        """Help for the step, offline."""
        return help_dialog(self._shown_step.kind if self._shown_step is not None else "start", self)

    def _bundle_of(self, trouble: str) -> tuple[Path | None, str, str]:
        project = self.controller.project
        about = "\n".join(f"{name} {version}" for name, version in versions())
        return project.folder if project is not None else None, f"{self.lines.toPlainText()}\n{trouble}", about

    def offer_bundle(self) -> QDialog | None:
        """Show what a support bundle would hold and what is replaced in it; it is written once somebody agrees."""
        from spherecal_gui.tasks.bundle_task import bundle_files, contents_text  # loads the calibration

        try:
            _, contents = bundle_files(*self._bundle_of(""))
        except SpherecalError as error:
            self._say("bad", *error_text(error))
            return None
        box = bundle_dialog(len(contents.files), contents_text(contents, names=True), self)
        box.accepted.connect(self.save_bundle)
        return box

    def save_bundle(self, trouble: str = "") -> Path | None:
        """What somebody needs to help, without images, with what went wrong; beside the projects; where it is."""
        from spherecal_gui.tasks.bundle_task import make_bundle  # loads the calibration

        output = self.projects / f"support-{datetime.now():%Y-%m-%d-%H%M%S}.zip"
        try:
            make_bundle(output, *self._bundle_of(trouble))
        except SpherecalError as error:
            self._say("bad", *error_text(error))
            return None
        text = self.tr("The support bundle is in {path}. It contains no images.").format(path=output)
        self._say("info", text, "")
        return output

    def _ask_driver(self, question: DriverQuestion) -> None:
        self.question = driver_dialog(question, self)

    def may_close(self) -> bool:
        """Whether nothing runs that somebody waits for; else it is said."""
        if self.controller.runner.running is None:
            return True
        self._say("info", self.tr("Work is running; wait for it or cancel it."), "")
        return False

    def _work_ended(self) -> bool:
        """Stop what runs; whether it has ended. Nobody waits for kernels that are still compiled."""
        if self.controller.runner.close(_PATIENCE_MS):
            return True
        from spherecal_app.kernel_state import state  # needs NumPy, which the work has loaded

        if state() != "to compile":
            return False
        self.controller.runner.abandon(0)
        return True

    def closeEvent(self, event: QCloseEvent) -> None:
        """Everything is on disk: stop what runs, let go of the cameras."""
        if self._closed:
            event.accept()
            return
        if self._own and not self._work_ended():
            self._say("info", self.tr("The computation is still stopping; close the window again in a moment."), "")
            event.ignore()
            return
        self._timer.stop()
        self.controller.changed.disconnect(self.refresh)
        self.controller.runner.lasted.disconnect(self._remember_pace)
        if self._own:
            self.settings.setValue("geometry", self.saveGeometry())
            self.settings.sync()
            self._drop_pages()
            self.controller.close_project()
            self.sounds.close()
        self._closed = True
        event.accept()
