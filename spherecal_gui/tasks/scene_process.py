"""The one process that renders scenes (scene_renderer), for all views of the window; a thread talks to it."""

import contextlib
import logging
import threading
from dataclasses import dataclass

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QImage

from spherecal_documents.scene.eye import Eye
from spherecal_documents.scene.model import SceneData
from spherecal_documents.scene.renderer import PictureProcess
from spherecal_documents.scene.shapes import SceneStyle

log = logging.getLogger("spherecal.gui")


@dataclass(frozen=True, eq=False)
class RequestedPicture:
    """One picture that a view wants: `view` and `version` name the scene, which is sent only where it is another."""

    view: int
    version: int
    data: SceneData
    style: SceneStyle
    eye: Eye
    fine: bool
    number: int


class SceneProcess(QObject):
    """Renders the newest wish of all views. `rendered` (view, number, QImage); `failed` once, with the reason."""

    rendered = Signal(int, int, QImage)
    failed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._wish: RequestedPicture | None = None
        self._news = threading.Condition()
        self._closing = False
        self.pid: int | None = None
        self._thread = threading.Thread(target=self._run, name="scene", daemon=True)
        self._thread.start()

    def want(self, wish: RequestedPicture) -> None:
        """Render this next; a wish that has not begun is left out."""
        with self._news:
            self._wish = wish
            self._news.notify()

    def close(self) -> None:
        """End the process."""
        with self._news:
            self._closing = True
            self._news.notify()

    def wait(self, seconds: float) -> bool:
        """Whether the process has ended within so many seconds."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            with PictureProcess(patience_s=None) as renderer:
                self.pid = renderer.pid
                if reason := renderer.trouble():
                    self._fail(reason)
                while not reason and (wish := self._next()) is not None:
                    scene = wish.view, wish.version
                    pixels = renderer.picture(wish.data, wish.style, wish.eye, wish.fine, scene)
                    height, width, _ = pixels.shape
                    image = QImage(pixels.data, width, height, 3 * width, QImage.Format.Format_RGB888).copy()
                    with contextlib.suppress(RuntimeError):
                        self.rendered.emit(wish.view, wish.number, image)
        except (EOFError, OSError) as error:
            if not self._closing:
                self._fail(f"the process has ended: {error}")

    def _fail(self, reason: str) -> None:
        log.warning("the 3-D view is painted without pyvista: %s", reason)
        with contextlib.suppress(RuntimeError):  # the window is gone already
            self.failed.emit(reason)

    def _next(self) -> RequestedPicture | None:
        with self._news:
            self._news.wait_for(lambda: self._wish is not None or self._closing)
            wish, self._wish = self._wish, None
            return None if self._closing else wish


_shared: list[SceneProcess] = []  # the one process that all views share, once for each of them


def take() -> SceneProcess:
    """The process that all views share; begun by the first."""
    _shared.append(_shared[0] if _shared else SceneProcess())
    return _shared[0]


def give_back() -> None:
    """One view has closed; the last one ends the process."""
    process = _shared.pop()
    if not _shared:
        process.close()
