"""Programs killed in the middle of a step: a server that has loaded them forks each, which saves 2 s a time."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from PySide6.QtCore import QCoreApplication

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.recorded_sets import RecordedSession
from tests.disk_faults import at_call
from tests.gui_still import images_at_rest
from tests.gui_walking import PATIENCE_S, WORK, begun, pump, settle, take

# What the program loads in its threads.
_LOADED = (
    "spherecal.calibrate", "spherecal_rigs.save_entry", "spherecal_rigs.result_folder", "spherecal_verify.verify_bars",
    "spherecal_gui.tasks.kept_check", "spherecal_gui.tasks.live_detection",
)  # fmt: skip


def exit_code_of(program: Callable[..., None], *words: str) -> int | None:
    """How a program ended that ran in a process of its own, with the environment of now."""
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload([__name__, *_LOADED])
    process = server.Process(target=_run, args=(program, words, dict(os.environ)))
    process.start()
    process.join(PATIENCE_S)
    code = process.exitcode
    process.kill()
    return code


def _run(program: Callable[..., None], words: tuple[str, ...], environment: Mapping[str, str]) -> None:
    os.environ.update(environment)
    application = QCoreApplication([])
    with images_at_rest():
        program(*words)
    application.quit()


def die(*_: object) -> None:
    """The program is killed."""
    os.kill(os.getpid(), signal.SIGKILL)


def killed_in_step(folder: str, step: str) -> None:
    """Killed while the step's work runs, or right after it where there is nothing to wait for."""
    made = Controller()
    made.cameras.live_hz = 1.0
    made.open_project(Path(folder))
    settle(made)
    settle(made)
    assert made.state is not None and made.state.current == step
    WORK[step](made)
    if made.runner.running is not None:  # in the middle of it
        news: list[object] = []
        pump(lambda: made.runner.running is None or news.extend(made.runner.task.take_news()) or len(news) > 3)
    die()


def killed_while_taking(home: str, where: str) -> None:
    """Killed while P2 is taken: `before the images` are written, `before the metadata` are, or `after all`."""
    made = begun(Path(home))
    take(made, "P1")
    with pytest.MonkeyPatch.context() as patch:
        if where == "before the images":
            patch.setattr("spherecal_cameras.capture.png_bytes", die)
        elif where == "before the metadata":
            patch.setattr(RecordedSession, "_write_metadata", die)
        take(made, "P2")
        die()


def killed_while_saving(folder: str, number: str) -> None:
    """Killed at this call among those that change the disk, while the calibration is saved in its profile and used."""
    made = Controller()
    made.cameras.live_hz = 1.0
    made.open_project(Path(folder))
    settle(made)
    assert made.profile_folder is not None
    with at_call(int(number), die):
        made.saving.save_profile(made.profile_folder, True, "by the tests")
        settle(made)
    made.close_project()
