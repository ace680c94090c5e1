"""The wizard's figures: `python3 dev.py bench wizard`.

Time to the window, a wall of 12 live tiles of 5 MP at 10 images/s, the overlay of detected dots on 12 cameras, how long
the window stalls while it calibrates, how soon a cancel is seen, and memory during live view (--minutes).
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.figures import Figures  # noqa: E402

WIDTH, HEIGHT, CAMERAS, RATE_HZ = 2448, 2048, 12, 10.0
HEARTBEAT_MS = 5

_CHILD = """
import os, sys, time
from PySide6.QtWidgets import QApplication
from spherecal_gui import app
a = QApplication(["x"])
w = app.make_window()
w.show()
a.processEvents()
print(time.time() - float(os.environ["BEGAN"]))
w.close()
"""


def main() -> None:
    """Measure what was asked for, print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=0.5, help="of live view for the memory (default 0.5)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of every other measurement (default 10)")
    parser.add_argument("--cold", action="store_true", help="empty the page cache before the cold start (as root)")
    parser.add_argument("--only", nargs="+", choices=sorted(PARTS), help="only these parts")
    parser.add_argument("--save", action="store_true", help="write the figures into baseline.json")
    options = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    os.environ["SPHERECAL_3D"] = "2d"
    with tempfile.TemporaryDirectory() as home:
        os.environ["SPHERECAL_SETTINGS"] = str(Path(home) / "settings.ini")
        os.environ["SPHERECAL_LIMITS"] = str(Path(home) / "limits.json")
        values: dict[str, object] = {}
        for name in options.only or PARTS:
            found = PARTS[name](options, Path(home))
            values |= found
            for key, value in found.items():
                print(f"{key:42} {value:.4g}" if isinstance(value, float) else f"{key:42} {value}", flush=True)
    Figures("wizard", values).save(options)


# --- start -----------------------------------------------------------------------------------------------------------


def start(options: argparse.Namespace, _: Path) -> dict[str, object]:
    """Seconds from starting the process to the painted window."""
    found: dict[str, object] = {}
    if options.cold:
        os.sync()
        Path("/proc/sys/vm/drop_caches").write_text("1\n")
        found["window cold, s"] = _start_once()
    _start_once()
    found["window warm, s"] = float(np.median([_start_once() for _ in range(3)]))
    return found


def _start_once() -> float:
    env = os.environ | {"BEGAN": str(time.time()), "PYTHONPATH": os.pathsep.join([str(ROOT / "core"), str(ROOT)])}
    done = subprocess.run(
        [sys.executable, "-c", _CHILD], env=env, cwd=ROOT, capture_output=True, text=True, timeout=120, check=True
    )
    return float(done.stdout)


# --- live view -------------------------------------------------------------------------------------------------------


def wall(options: argparse.Namespace, home: Path) -> dict[str, object]:
    """12 tiles of 5 MP, 10 images/s each, no detection: processor time, longest stall, memory over the minutes."""
    application, window = _window(home)
    _connect(window, _still_source())
    window.controller.go("look")
    memory = []
    beat = Heartbeat(application)
    began_cpu, began = time.process_time(), time.perf_counter()
    until = began + max(options.seconds, 60 * options.minutes)
    while time.perf_counter() < until:
        _live(application, 1.0)
        memory.append(_rss_mb())
    wall_s, cpu_s = time.perf_counter() - began, time.process_time() - began_cpu
    beat.stop()
    window.close()
    half = memory[len(memory) // 2 :]
    slope = float(np.polyfit(np.arange(len(half)), half, 1)[0]) if len(half) > 2 else float("nan")  # MB a second
    return {
        "wall of 12 x 5 MP x 10/s: CPU, % of a core": 100 * cpu_s / wall_s,
        "wall: stall p95, ms": beat.percentile(95),
        "wall: longest stall, ms": beat.percentile(100),
        "wall: memory at start, MB": memory[0],
        "wall: memory at the end, MB": memory[-1],
        "wall: memory, growth in the second half, MB": float(half[-1] - half[0]),
        "wall: memory, trend of the second half, MB/h": 3600 * slope,
        "wall: minutes": wall_s / 60,
    }


def overlay(options: argparse.Namespace, home: Path) -> dict[str, object]:
    """Detections a second and camera on a rig of 12 cameras in live view."""
    application, window = _window(home)
    window.controller.new_project("simulated:rigB", home / "overlay")
    _until(application, lambda: window.controller.runner.running is None)
    window.controller.recording.confirm_bench()
    _until(application, lambda: window.controller.runner.running is None)
    window.controller.go("look")
    live = window.controller.cameras.live
    names = window.controller.cameras.connection.names
    _until(application, lambda: all(live.sight(serial) is not None for serial in names), 300)
    beat, counted, seen = Heartbeat(application), 0, dict.fromkeys(names)
    began = time.perf_counter()
    while time.perf_counter() - began < options.seconds:
        _live(application, 0.02)
        for serial in names:
            sight = live.sight(serial)
            counted += sight is not seen[serial]
            seen[serial] = sight
    seconds = time.perf_counter() - began
    beat.stop()
    window.close()
    return {
        "overlay: cameras": len(names),
        "overlay: detections/s, all cameras": counted / seconds,
        "overlay: detections/s, each camera": counted / seconds / len(names),
        "overlay: stall p95, ms": beat.percentile(95),
        "overlay: longest stall, ms": beat.percentile(100),
    }


def scene(options: argparse.Namespace, home: Path) -> dict[str, object]:
    """The live scene of Camera check beside six live cameras: pictures a second at rest and turned, stalls."""
    from PySide6.QtCore import QEvent, QObject, QTimer

    class Painted(QObject):
        count = 0

        def eventFilter(self, watched: QObject, event: QEvent) -> bool:
            self.count += event.type() == QEvent.Type.Paint
            return False

    before = os.environ.pop("SPHERECAL_3D", None)
    application, window = _window(home)
    began = time.perf_counter()
    window.controller.new_project("simulated:demo", home / "scene")
    _until(application, lambda: window.controller.runner.running is None)
    window.controller.recording.confirm_bench()
    window.controller.go("look")
    view = window.page.space.view
    _until(application, lambda: view.isVisible() and view.live.ball is not None and view.rendered)
    shown_s, painted = time.perf_counter() - began, Painted()
    view.installEventFilter(painted)
    found: dict[str, object] = {"scene: from the click to ball and cameras in space, s": shown_s}
    turning = QTimer(view)
    turning.setInterval(1)
    turning.timeout.connect(lambda: view.turn(3.0, 0.0))
    for name in ("at rest", "turned"):
        if name == "turned":
            turning.start()
        painted.count, beat = 0, Heartbeat(application)
        _live(application, options.seconds)
        beat.stop()
        found[f"scene {name}: pictures/s"] = painted.count / options.seconds
        found[f"scene {name}: stall p95, ms"] = beat.percentile(95)
        found[f"scene {name}: longest stall, ms"] = beat.percentile(100)
    turning.stop()
    window.close()
    if before is not None:
        os.environ["SPHERECAL_3D"] = before
    return found


def _still_source() -> Any:
    """12 cameras whose images come from memory: what is measured is the window, not a camera."""
    from spherecal_cameras.in_process import InProcessSource
    from spherecal_cameras.protocol import CameraInfo, CameraSettings, Frame

    class StillSource(InProcessSource):
        kind = "replay"
        label = "REPLAY of still images in memory"

        def __init__(self) -> None:
            super().__init__()
            rng = np.random.default_rng(1)
            self._images = [rng.integers(20, 200, (HEIGHT, WIDTH), np.uint8) for _ in range(2)]
            self._turn = 0

        def camera_infos(self) -> tuple[CameraInfo, ...]:
            size = (WIDTH, HEIGHT)
            return tuple(
                CameraInfo(f"S{i:02d}", "still", "", "memory", "memory", f"C{i:02d}", f"C{i:02d}", image_size=size)
                for i in range(1, CAMERAS + 1)
            )

        def take_image(
            self, serial: str, settings: CameraSettings, number: int, attempt: int, timeout_s: float
        ) -> Frame:
            self._turn += 1
            now = time.perf_counter()
            image = self._images[self._turn % 2]
            return Frame(serial, image, 8, "Mono8", now, now, self.next_frame_id(serial), self.stamp_ns())

    return StillSource()


def _connect(window: Any, source: Any) -> None:
    """Hand the window a source that is open, as connecting would."""
    from dataclasses import replace

    from spherecal_cameras.capture import SessionCamera
    from spherecal_cameras.plan import CapturePlan
    from spherecal_gui.project import Artefacts, Project
    from spherecal_gui.project_folder import save_project
    from spherecal_gui.tasks.live_detection import Connection, LiveView

    discovery = source.discover()
    reports = source.open(discovery.serials, {})
    cameras = tuple(SessionCamera(info.serial, {"id": info.user_name}) for info in discovery.cameras)
    names = {camera.serial: camera.id for camera in cameras}
    controller = window.controller
    project = Project(window.projects / "wall", "replay:memory", cameras=tuple(names), step="look")
    project = replace(project, artefacts=Artefacts("none", "", "", None))
    save_project(project)
    controller.project = project
    controller.cameras.connection = Connection(source, discovery, reports, cameras, CapturePlan((), None, {}), names)
    controller.cameras.live = LiveView(controller.cameras.connection)
    controller.cameras.live.start(RATE_HZ)
    controller.changed.emit()


# --- computing -------------------------------------------------------------------------------------------------------


def calibrate(_: argparse.Namespace, home: Path) -> dict[str, object]:
    """How long the window stalls while the demo is calibrated from images, and how soon a cancel is seen and done."""
    application, window = _window(home)
    controller = window.controller
    controller.new_project("simulated:demo", home / "calibrate")
    _until(application, lambda: controller.runner.running is None)
    controller.recording.confirm_bench()
    controller.cameras.accept_look()
    for name in controller.project.sets:
        step = f"placement:{name}" if name in controller.project.placements else "scale"
        controller.go(step)
        controller.staging.show_pose(name)
        controller.sets.take(name, step)
        _until(application, lambda: controller.runner.running is None)
    _until(application, lambda: controller.advice.planning_s is None)
    controller.go("calibrate")
    controller.computation.calibrate()  # compiles what is not in the cache yet
    _until(application, lambda: controller.runner.running is None)
    beat, began = Heartbeat(application), time.perf_counter()
    controller.computation.calibrate()
    _until(application, lambda: controller.runner.running is None)
    seconds = time.perf_counter() - began
    beat.stop()
    seen, ended = zip(*(_cancel_once(application, window, share) for share in (0.05, 0.3, 0.6, 0.8)), strict=True)
    window.close()
    return {
        "calibrating: s": seconds,
        "calibrating: stall p95, ms": beat.percentile(95),
        "calibrating: longest stall, ms": beat.percentile(100),
        "cancel: seen after, ms": 1e3 * max(seen),
        "cancel: ended after, ms, median": 1e3 * float(np.median(ended)),
        "cancel: ended after, ms, longest": 1e3 * max(ended),
    }


def _cancel_once(application: Any, window: Any, share: float) -> tuple[float, float]:
    """Seconds until the page says that it stops, and until it has stopped."""
    controller = window.controller
    controller.computation.calibrate()
    _until(application, lambda: window.page.course.fraction >= share or controller.runner.running is None)
    began = time.perf_counter()
    controller.cancel()
    _until(application, lambda: window.page.word.text() != "Computing")
    seen = time.perf_counter() - began
    _until(application, lambda: controller.runner.running is None)
    return seen, time.perf_counter() - began


# --- the window ------------------------------------------------------------------------------------------------------


class Heartbeat:
    """A timer of 5 ms in the window's thread; what it is late is what somebody feels.

    Counted in tenths of a millisecond: a list of all beats grew by 11 MB in half an hour, and was taken for a leak.
    """

    def __init__(self, application: Any) -> None:
        from PySide6.QtCore import Qt, QTimer

        self._counts, self._longest_ms = np.zeros(50_000, np.int64), 0.0
        self._last = time.perf_counter()
        self._timer = QTimer(application)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.setInterval(HEARTBEAT_MS)
        self._timer.timeout.connect(self._beat)
        self._timer.start()

    def _beat(self) -> None:
        now = time.perf_counter()
        late_ms = 1e3 * (now - self._last)
        self._counts[min(int(10 * late_ms), len(self._counts) - 1)] += 1
        self._longest_ms = max(self._longest_ms, late_ms)
        self._last = now

    def stop(self) -> None:
        """No more beats."""
        self._timer.stop()

    def percentile(self, share: float) -> float:
        """Of the time between two beats, ms."""
        if share == 100 or not self._counts.any():
            return self._longest_ms
        below = np.searchsorted(np.cumsum(self._counts), share / 100 * self._counts.sum())
        return float(min((below + 1) / 10, self._longest_ms))


def _window(home: Path) -> tuple[Any, Any]:
    from PySide6.QtWidgets import QApplication

    from spherecal_gui import app
    from spherecal_gui.tasks.task import Collector

    application = QApplication.instance() or QApplication(["bench"])
    if application.findChild(Collector) is None:
        Collector(application).start()
    window = app.make_window(home / "projects")
    window.resize(1440, 900)
    window.show()
    application.processEvents()
    return application, window


def _live(application: Any, seconds: float) -> None:
    """Let the window's own loop run: waiting costs nothing, as it does in real life."""
    from PySide6.QtCore import QEventLoop, QTimer

    loop = QEventLoop()
    QTimer.singleShot(int(1e3 * seconds), loop.quit)
    loop.exec()


def _until(application: Any, done: Callable[[], bool], seconds: float = 900.0) -> None:
    until = time.perf_counter() + seconds
    while not done():
        if time.perf_counter() > until:
            raise TimeoutError("The wizard has not come to an end.")
        _live(application, 0.02)


def _rss_mb() -> float:
    """The process's memory now."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) / 1024
    import resource  # not there on Windows

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


PARTS: dict[str, Callable[[argparse.Namespace, Path], dict[str, object]]] = {
    "start": start,
    "wall": wall,
    "overlay": overlay,
    "scene": scene,
    "calibrate": calibrate,
}


if __name__ == "__main__":
    main()
