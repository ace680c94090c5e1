"""Walking through the wizard in tests: letting the window live, a controller begun, sets taken."""

import os
import time
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QCoreApplication, QEventLoop
from PySide6.QtWidgets import QAbstractButton, QLabel, QTabBar, QWidget

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.workflow import Status

# For an idle machine; where others work too, everything takes longer by about the load of a core.
PATIENCE_S = 240.0 * (max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1)) if hasattr(os, "getloadavg") else 1.0)


def pump(done: Callable[[], object], seconds: float = PATIENCE_S) -> None:
    """Let the window live until something has happened."""
    until = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < until, "waited in vain"
        QCoreApplication.processEvents(QEventLoop.ProcessEventsFlag.AllEvents, 20)
        time.sleep(0.005)


def words_shown(window: QWidget) -> str:
    """All that labels, buttons and tabs of a window say now, each on a line of its own, without shortcuts."""
    seen = [one for one in window.findChildren(QWidget) if one.isVisible()]
    said = [one.text() for one in seen if isinstance(one, QLabel | QAbstractButton)]
    said += [one.tabText(i) for one in seen if isinstance(one, QTabBar) for i in range(one.count())]
    return "\n".join(said).replace("&", "")


def settle(controller: Controller) -> None:
    """Until no work runs and what it left in the queue is done."""
    pump(lambda: controller.runner.running is None)
    QCoreApplication.processEvents()


def at_rest(controller: Controller) -> bool:
    """Whether it is known of every camera that it stands still: from then on it is noticed when one is moved."""
    live = controller.cameras.live
    seen = dict(live.watch._seen) if live is not None else {}
    connection = controller.cameras.connection
    if connection is None or len(seen) < len(connection.names):
        return False
    return all(one.shift_px is not None for one in seen.values())


def status(controller: Controller, step: str) -> Status:
    """How a step stands."""
    assert controller.state is not None
    return controller.state.of(step).status


def begun(home: Path, source: str = "simulated:demo", bench: str = "") -> Controller:
    """Connected, confirmed, looked at."""
    made = Controller()
    made.cameras.live_hz = 1.0  # leave the cores to the walk
    made.new_project(source, home, bench)
    settle(made)
    made.recording.confirm_bench()
    settle(made)
    made.cameras.accept_look()
    return made


# What each step's large button does.
WORK: dict[str, Callable[[Controller], object]] = {
    "connect": lambda c: c.recording.confirm_bench(),
    "look": lambda c: c.cameras.accept_look(),
    "placement:P2": lambda c: c.sets.take("P2", "placement:P2"),
    "scale": lambda c: c.sets.take(c.project.scale_poses[0], "scale"),
    "calibrate": lambda c: c.computation.calibrate(),
    "results": lambda c: c.computation.accept_results(),
    "verify": lambda c: c.computation.verify(),
    "save": lambda c: c.saving.save_profile(c.profile_folder or c.project.folder, True),
}


def step_of(controller: Controller, name: str) -> str:
    """The step in which a set is taken."""
    assert controller.project is not None
    if name in controller.project.placements:
        return f"placement:{name}"
    return "scale" if name in controller.project.scale_poses else "verify"


def take(controller: Controller, name: str, shown: str = "") -> None:
    """Take a set; `shown` is what stands there instead."""
    step = step_of(controller, name)
    controller.go(step)
    controller.staging.show_pose(shown or name)
    assert controller.sets.take(name, step)
    settle(controller)


def walked_to(home: Path, step: str) -> Controller:
    """A walk on the demo that has come to a step: all before it is done; at Verify one pose of the bar is taken."""
    made = begun(home)
    assert made.project is not None and made.state is not None
    order = [one.step.id for one in made.state.steps]
    until = order.index(step)
    for name in made.project.sets:
        if order.index(step_of(made, name)) < until:
            take(made, name)
    if until > order.index("calibrate"):
        assert made.computation.calibrate()
        settle(made)
        made.computation.accept_results()
    if until >= order.index("verify"):
        take(made, made.project.check_poses[0])
    if until > order.index("verify"):
        assert made.computation.verify()
        settle(made)
    made.go(step)
    return made
