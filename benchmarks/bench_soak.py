"""A working day at a raised rate in one process: memory, open files, threads and children must not grow.

`python3 dev.py bench soak --hours 8`: a working day is taken to be, each hour, two checks and one calibration with
verification, report, export and saving in the profile; a window opened, shown and closed six times; and the targets
looked for in 1200 live images (a set of six cameras every eighteen seconds). All that one after another, without the
waiting. Live cameras have a soak of their own (`dev.py studies cameras`), so has the wall of tiles (`bench wizard`).
"""

import argparse
import gc
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.figures import Figures  # noqa: E402

IMAGES, WINDOWS, CHECKS = 1200, 6, 2
# Of a day of 8 hours in the second half: fragments and caches of the libraries, not a leak that fills a week.
MOST_MB, MOST_HANDLES = 20.0, 2


@dataclass(frozen=True)
class State:
    """What must not grow: resident MB, open files and sockets, threads, child processes, files left behind."""

    mb: float
    handles: int
    threads: int
    children: int
    left_behind: int


def state(temporary: Path) -> State:
    """Of this process now, after a collection of garbage."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    children = sum(len(path.read_text().split()) for path in Path("/proc/self/task").glob("*/children"))
    return State(
        pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        len(os.listdir("/proc/self/fd")),
        threading.active_count(),
        children,
        sum(1 for _ in temporary.rglob("*")),
    )


def command(*words: object) -> None:
    """A command in this process, silent; RuntimeError where it fails."""
    from spherecal_app.cli.main import main

    with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        code = main([str(word) for word in words])
    if code not in (0, 3):
        raise RuntimeError(f"spherecal {' '.join(map(str, words))}: exit code {code}")


def hour(home: Path, window: Callable[[], None], look: Callable[[], None], share: float) -> None:
    """The work of one hour; `share` of the images and windows."""
    session, result, profile = home / "session", home / "result", home / "profile"
    command("calibrate", session, "-o", result)
    command("verify", session, "--rig", result / "rig.json", "-o", result)
    command("report", result, "-o", home / "report.pdf")
    command("export", result / "rig.json", "--to", "opencv", "-o", home / "export")
    command("profile", "save", result, "--to", profile, "--apply")
    for _ in range(CHECKS):
        command("check", session, "--profile", profile, "--only", "P1", "--not-kept")
    for _ in range(max(1, round(WINDOWS * share))):
        window()
    for _ in range(max(1, round(IMAGES * share))):
        look()


def window_maker(home: Path) -> Callable[[], None]:
    """Opens, shows and closes the wizard's window."""
    from PySide6.QtCore import QCoreApplication, QEvent
    from PySide6.QtWidgets import QApplication

    from spherecal_gui import app

    application = QApplication.instance() or QApplication(["soak"])

    def open_and_close() -> None:
        made = app.make_window(home / "projects")
        made.show()
        application.processEvents()
        made.close()
        made.deleteLater()
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
        application.processEvents()

    return open_and_close


def looker() -> Callable[[], None]:
    """Looks for targets in a live image of the ball, each with noise of its own."""
    from spherecal.targets.detection import Detector
    from spherecal_cameras.simulated.draw import digitise
    from spherecal_cameras.simulated.stage import Stage, StageView

    stage = Stage("demo")
    assert stage.session.target_set is not None
    detector, picture, rng = Detector(stage.session.target_set), stage.picture(0, StageView()), np.random.default_rng(1)

    def look() -> None:
        if not len(detector.detect(digitise(picture, 8, 1.0, rng)).target_ids):
            raise RuntimeError("no target was found in a live image")

    return look


def main() -> int:
    """Work, measure, judge; 1 where something grew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=int, default=8, help="of the working day (default 8)")
    parser.add_argument("--share", type=float, default=1.0, help="of an hour's images and windows (default 1)")
    parser.add_argument("--save", action="store_true", help="write the figures into baseline.json")
    options = parser.parse_args()
    os.environ |= {"QT_QPA_PLATFORM": "offscreen", "SPHERECAL_3D": "2d"}
    with tempfile.TemporaryDirectory() as folder:
        home, temporary = Path(folder) / "home", Path(folder) / "temporary"
        home.mkdir()
        temporary.mkdir()
        os.environ |= {"SPHERECAL_SETTINGS": str(home / "settings.ini"), "XDG_CONFIG_HOME": str(home)}
        tempfile.tempdir = str(temporary)
        command("simulate", "demo", "--observations-only", "-o", home / "session")
        window, look, began = window_maker(home), looker(), time.perf_counter()
        print("hour  seconds      MB  handles  threads  children  left behind")
        states: list[State] = []
        for number in range(options.hours + 1):
            hour(home, window, look, options.share)  # the first one is not counted: everything is loaded by it
            states.append(state(temporary))
            line = "{:7.1f}  {:7d}  {:7d}  {:8d}  {:11d}".format(*astuple(states[-1]))
            print(f"{number:4d}  {time.perf_counter() - began:7.0f}  {line}", flush=True)
    middle, last = states[len(states) // 2], states[-1]
    good = last.mb - middle.mb <= MOST_MB and last.handles - middle.handles <= MOST_HANDLES
    good &= last.threads <= states[0].threads and last.children <= states[0].children
    good &= last.left_behind <= states[0].left_behind
    growth = f"{last.mb - middle.mb:+.1f} MB, {last.handles - middle.handles:+d} handles"
    print(f"second half: {growth}: {'ok' if good else 'BAD'}")
    values: dict[str, object] = {
        "hours": options.hours,
        "share": options.share,
        "seconds": time.perf_counter() - began,
        "first_mb": states[0].mb,
        "middle_mb": middle.mb,
        "last_mb": last.mb,
        "handles": last.handles,
    }
    Figures("soak", values).save(options)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
