"""The keyboard: what the space bar and Enter do wherever the focus is, and when they do nothing."""

import time
from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QWindow
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSpinBox,
    QCheckBox,
    QComboBox,
    QLineEdit,
    QPlainTextEdit,
    QTextEdit,
    QWidget,
)

from spherecal_gui.standing import Standing
from spherecal_gui.workflow import Step, StepKind

# Somebody who presses twice means the page that was in sight at the first press; to read a new one takes a second.
SEEN_S = 1.0
# Steps at which there is nothing more to do or to read once they are done well; Verify is there to be read.
GOES_ON: tuple[StepKind, ...] = ("connect", "look", "placement", "scale", "calibrate", "results")
_FIELDS = (QLineEdit, QAbstractSpinBox, QPlainTextEdit, QTextEdit)


class Guard:
    """Whether the space bar may act: on a page that was seen for a second as it is, so never twice within one."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._page: str | None = None
        self._seen_from_s = -SEEN_S

    def enter(self, page: str | None) -> None:
        """A page comes into sight."""
        if page != self._page:
            self._page, self._seen_from_s = page, self._clock()

    def acted(self) -> None:
        """A press has acted: what the page says now has to be seen first."""
        self._seen_from_s = self._clock()

    def allows(self) -> bool:
        """Whether a press acts now."""
        return self._clock() - self._seen_from_s >= SEEN_S


class Onward:
    """Whether the window goes on by itself: from a step that was done well while it was in sight, after a second."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._step = ""
        self._open = False  # it was not done yet when it came into sight: nobody is sent on from a step gone back to
        self._done_s: float | None = None

    def feed(self, step: Step, standing: Standing) -> bool:
        """Whether to go on now; called while nothing runs."""
        done = standing.default == "next" and standing.level == "good"
        if step.id != self._step:
            self._step, self._open, self._done_s = step.id, False, None
        self._open = self._open or not done
        if not (done and self._open and step.kind in GOES_ON):
            self._done_s = None
        elif self._done_s is None:
            self._done_s = self._clock()
        return self._done_s is not None and self._clock() - self._done_s >= SEEN_S


class Keys(QObject):
    """Hears the keys of one window before its widgets do; the space bar never presses buttons in `options`."""

    def __init__(self, window: QWidget, options: QWidget, press: Callable[[], None]) -> None:
        super().__init__(window)
        self._window, self._options, self._press = window, options, press
        self.on_start_page = True
        self._heard: QWindow | None = None

    def listen(self) -> None:
        """Hear the keys at the shown window's platform window: at the application all events would pass Python."""
        handle = self._window.windowHandle()
        if handle is not None and handle is not self._heard:
            self._heard = handle
            handle.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Whether the key goes no further."""
        if event.type() != QEvent.Type.KeyPress or not isinstance(event, QKeyEvent):
            return False
        focus = self._window.focusWidget() or self._window  # to which Qt would hand it
        if event.key() == Qt.Key.Key_Space:
            return self._space(focus, event.isAutoRepeat())
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and isinstance(focus, QAbstractButton):
            if not event.isAutoRepeat():  # presses the button that has the focus; in a field it only commits the field
                focus.click()
            return True
        return False

    def _space(self, watched: QWidget, again: bool) -> bool:
        if isinstance(watched, _FIELDS):
            return False
        if self.on_start_page:
            return True
        is_option = isinstance(watched, (QCheckBox, QComboBox)) or self._options.isAncestorOf(watched)
        if isinstance(watched, QAbstractButton) and not is_option and watched.property("key") not in ("action", "next"):
            return again  # somebody has gone to this button with the Tab key
        if not again:
            self._press()
        return True
