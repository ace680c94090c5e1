"""The one process that renders scenes (scene_renderer), for all views of the window; a thread talks to it."""

import contextlib
import logging
import multiprocessing
import threading
from dataclasses import dataclass
from multiprocessing import shared_memory
from typing import Any

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QImage

from spherecal_documents.scene.eye import Eye
from spherecal_documents.scene.model import SceneData
from spherecal_documents.scene.renderer import serve
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
        self._memory: shared_memory.SharedMemory | None = None
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
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs,), daemon=True, name="spherecal-scene")
        try:
            process.start()
            self.pid = process.pid
            theirs.close()
            word, reason = ours.recv()
            if word == "ready":
                self._serve(ours)
            else:
                self._fail(reason)
        except (EOFError, OSError) as error:
            if not self._closing:
                self._fail(f"the process has ended: {error}")
        finally:
            ours.close()
            if self._memory is not None:
                self._memory.close()
                self._memory.unlink()
            if process.pid is not None:
                process.join(1.0)
                if process.is_alive():
                    process.terminate()

    def _fail(self, reason: str) -> None:
        log.warning("the 3-D view is painted without pyvista: %s", reason)
        with contextlib.suppress(RuntimeError):  # the window is gone already
            self.failed.emit(reason)

    def _serve(self, pipe: Any) -> None:  # of each system another class
        shown: tuple[int, int] | None = None
        while (wish := self._next()) is not None:
            if (wish.view, wish.version) != shown:
                pipe.send(("scene", (wish.data, wish.style)))
                shown = wish.view, wish.version
            memory = self._room(wish.eye)
            pipe.send(("eye", (memory.name, wish.number, wish.eye, wish.fine)))
            _, frame = pipe.recv()
            assert memory.buf is not None
            image = QImage(memory.buf, frame.width, frame.height, 3 * frame.width, QImage.Format.Format_RGB888).copy()
            with contextlib.suppress(RuntimeError):
                self.rendered.emit(wish.view, wish.number, image)
            del image

    def _next(self) -> RequestedPicture | None:
        with self._news:
            self._news.wait_for(lambda: self._wish is not None or self._closing)
            wish, self._wish = self._wish, None
            return None if self._closing else wish

    def _room(self, eye: Eye) -> shared_memory.SharedMemory:
        size = 3 * eye.width * eye.height
        if self._memory is None or self._memory.size < size:
            if self._memory is not None:
                self._memory.close()
                self._memory.unlink()
            self._memory = shared_memory.SharedMemory(create=True, size=size + size // 2)
        return self._memory


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
