"""The 3-D scene's figures: `python3 dev.py bench scene`.

12 cameras with images, 4 balls with 500 dots each, all layers but the map, at 1280 x 960: seconds to the first picture,
pictures/s while it is turned, how long one takes with smooth edges, stalls of the window meanwhile, memory; and the
same for the view that Qt paints. pyvista renders by OpenGL as it finds it: LIBGL_ALWAYS_SOFTWARE=1 asks for llvmpipe.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.bench_wizard import Heartbeat, _live, _rss_mb, _until  # noqa: E402
from benchmarks.figures import Figures  # noqa: E402

SIZE = (1280, 960)
CAMERAS, BALLS, DOTS, RADIUS_MM = 12, 4, 500, 250.0
STEP_PX = 8.0  # of the mouse between two pictures


def main() -> None:
    """Measure, print, and write into baseline.json where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of turning (default 10)")
    parser.add_argument("--save", action="store_true", help="write the figures into baseline.json")
    options = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from PySide6.QtWidgets import QApplication

    from spherecal_gui import theme

    application = QApplication(["bench"])
    theme.apply(application, dark=True)
    values = painted(application, options.seconds) | rendered(application, options.seconds)
    for name, value in values.items():
        print(f"{name:44} {value:.4g}", flush=True)
    Figures("scene", dict(values)).save(options)


def rig() -> Any:
    """Twelve cameras in two rings around four balls."""
    from spherecal_documents.report.rig_view import CameraShape, DrawnPlacement, DrawnRig
    from spherecal_documents.scene.model import SceneData

    rng = np.random.default_rng(1)
    cameras = []
    for i in range(CAMERAS):
        turn, height = 2 * np.pi * i / CAMERAS, 700.0 + 400.0 * (i % 2)
        place = np.array([1300 * np.cos(turn), 1300 * np.sin(turn), height])
        ahead = -place / np.linalg.norm(place)
        right = np.cross(ahead, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        axes = np.vstack([right, np.cross(ahead, right), ahead])
        corners = np.array([(-110, -90, 300), (110, -90, 300), (110, 90, 300), (-110, 90, 300)], float)
        cameras.append(CameraShape(f"C{i + 1:02d}", place, place + corners @ axes, axes))
    out = rng.normal(size=(BALLS * DOTS, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    centres = np.array([(-200, -200, 0), (200, -200, 60), (-200, 200, 120), (200, 200, 0)], float)
    places = np.repeat(centres, DOTS, axis=0) + RADIUS_MM * out
    balls = tuple(
        DrawnPlacement(f"P{i + 1}", places[i * DOTS : (i + 1) * DOTS], centre, RADIUS_MM)
        for i, centre in enumerate(centres)
    )
    images = {camera.id: rng.integers(0, 255, (400, 480), np.uint8) for camera in cameras}
    return SceneData(
        DrawnRig(np.eye(3), "up", tuple(cameras), balls, 300.0, "C01"),
        places,
        rng.uniform(0, 1, len(places)),
        normals=out,
        names=tuple((f"P{i // DOTS + 1}", i % DOTS, "A") for i in range(len(places))),
        most_px=0.05,
        ellipsoid_places=places[::10],
        ellipsoids=np.abs(rng.normal(0, 0.01, (len(places[::10]), 3, 1))) * np.eye(3),
        images=images,
        links=tuple((f"C{i:02d}", f"C{i + 1:02d}") for i in range(1, CAMERAS)),
    )


def _shown(view: Any) -> Any:
    from spherecal_documents.scene.shapes import LAYERS

    view.resize(*SIZE)
    view.show_scene(rig())
    view.set_layers(frozenset(LAYERS) - {"map"})
    view.show()
    return view


def _turn(application: Any, view: Any, seconds: float, count: Callable[[], int]) -> dict[str, float]:
    """Turned as fast as pictures come; each step asks for one."""
    began, first, beat = time.perf_counter(), count(), Heartbeat(application)
    while time.perf_counter() - began < seconds:
        before, until = count(), time.perf_counter() + 2.0
        view.turn(STEP_PX, 0.0)
        while count() == before and time.perf_counter() < until:
            _live(application, 0.002)
    beat.stop()
    spent = time.perf_counter() - began
    return {
        "pictures/s": (count() - first) / spent,
        "stall p95, ms": beat.percentile(95),
        "longest stall, ms": beat.percentile(100),
    }


def painted(application: Any, seconds: float) -> dict[str, float]:
    """The view of Qt alone."""
    from spherecal_gui.widgets.scene_view import SceneView

    class Counted(SceneView):
        painted = 0

        def paintEvent(self, _: Any) -> None:
            super().paintEvent(_)
            self.painted += 1

    os.environ["SPHERECAL_3D"] = "painted"
    view = _shown(Counted())
    began = time.perf_counter()
    _until(application, lambda: view.painted > 0)
    found = {"painted: first picture, s": time.perf_counter() - began}
    found |= {
        f"painted: {name}": value for name, value in _turn(application, view, seconds / 2, lambda: view.painted).items()
    }
    view.close()
    return found


def rendered(application: Any, seconds: float) -> dict[str, float]:
    """pyvista's, in its own process."""
    from spherecal_gui.widgets.scene_view import SceneView

    os.environ.pop("SPHERECAL_3D", None)
    before = _rss_mb()
    beat = Heartbeat(application)
    view = _shown(SceneView())
    _until(application, lambda: view.rendered or view._broken)
    if view._broken:
        raise SystemExit("OpenGL does not work here.")
    beat.stop()
    found = {
        "rendered: first picture, s": view.first_picture_s,
        "rendered: longest stall until then, ms": beat.percentile(100),
    }
    process = view._process
    found["rendered: processor time until then, s"] = _cpu_s(process.pid)
    _live(application, 2.0)
    cpu = _cpu_s(process.pid)
    got = view._got
    found |= {
        f"rendered: {name}": value for name, value in _turn(application, view, seconds, lambda: view._got).items()
    }
    pictures = view._got - got
    found["rendered: processor time of a picture, ms"] = 1e3 * (_cpu_s(process.pid) - cpu) / max(pictures, 1)
    asked, began = view._number, time.perf_counter()
    view._ask_fine()
    _until(application, lambda: view._got > asked)
    found["rendered: picture with smooth edges, s"] = time.perf_counter() - began
    found["rendered: memory of its process, MB"] = _memory_mb(process.pid)
    found["rendered: the window's memory more by, MB"] = _rss_mb() - before
    view.close_view()
    process.wait(10)
    return found


def _cpu_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _memory_mb(pid: int) -> float:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return float(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024


if __name__ == "__main__":
    main()
