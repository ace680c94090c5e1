"""The wizard's walk over GigE Vision packets, with pictures: `python -m benchmarks.gige_wizard FOLDER` (Linux, root).

From Connect to a saved profile, on simulated GigE cameras that see the demo's rig: the window's own code, the camera
process, Harvesters, genicam and the Aravis producer. Then `spherecal calibrate` on the recording. Ends with 1 where a
step does not come to its end.
"""

import os
import sys
import time
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtWidgets import QApplication

from spherecal.base.context import Context
from spherecal_app.cli.main import main as spherecal
from spherecal_app.cli.producer_command import show_gige
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.producer.build_producer import DISCOVERY_VARIABLE, build_producer
from spherecal_gentl.producer.producer_control import SessionScenes
from spherecal_gui.wizard.window import WizardWindow
from spherecal_sim.render_session import demo_session

_PICTURE_WIDTH = 900
_LIMIT_S = 1200.0
_IN_FLIGHT_S = 0.6  # live images of the scene before


class Wizard:
    """The window on the rig, and the pictures that are taken of it."""

    def __init__(self, folder: Path, rig: GigeRig, scenes: SessionScenes, session: Path) -> None:
        self.folder, self._rig, self._scenes = folder, rig, scenes
        self.window = WizardWindow(folder / "projects")
        self.window.resize(1280, 800)
        self.window.show()
        self.control = self.window.controller
        self.control.cameras.live_hz = 1.0
        self.control.cameras.somebody_answers = False  # the driver is our own, just built
        self.control.new_project("genicam", folder / "projects", str(session))
        self._settle()

    def _live(self, seconds: float = 0.3) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            QCoreApplication.processEvents()
            time.sleep(0.005)

    def _settle(self) -> None:
        until = time.monotonic() + _LIMIT_S
        while self.control.runner.running is not None:
            if time.monotonic() > until:
                raise TimeoutError(f"{self.control.project and self.control.project.step} does not end")
            self._live(0.02)
        self._live()

    def _until_all_seen(self) -> None:
        """Until targets were found in a live image of every camera; the first time the detector is compiled."""
        until = time.monotonic() + _LIMIT_S
        connection, live = self.control.cameras.connection, self.control.cameras.live
        assert connection is not None and live is not None
        while not all(live.sight(serial) for serial in connection.names) and time.monotonic() < until:
            self._live(0.2)

    def picture(self, name: str) -> None:
        """Keep what the window shows now."""
        self._live(1.5)
        image = self.window.grab().toImage()
        image.scaledToWidth(_PICTURE_WIDTH, Qt.TransformationMode.SmoothTransformation).save(
            str(self.folder / f"gige-{name}.png")
        )

    def take(self, name: str, step: str, picture: bool = False, shown: str = "") -> None:
        """Put a set (or what is `shown` in its place) in front of the cameras and take it."""
        project = self.control.project
        assert project is not None
        self.control.go(step)
        show_gige(self._rig, self._scenes, shown or name)
        self._live(_IN_FLIGHT_S)
        assert self.control.sets.take(name, step), name
        self._settle()
        if picture:
            self.picture(step.partition(":")[0])
        print(f"{name} taken", flush=True)

    def walk(self) -> None:
        """Every step in its order."""
        control = self.control
        assert control.project is not None, "the cameras are not connected"
        control.recording.confirm_bench()
        self._settle()
        show_gige(self._rig, self._scenes, control.project.placements[0])
        control.go("look")
        self._until_all_seen()
        self.picture("look")
        control.go("connect")
        self.picture("connect")
        control.cameras.accept_look()
        for number, name in enumerate(control.project.placements):
            self.take(name, f"placement:{name}", picture=number == 0)
        for name in control.project.scale_poses:
            self.take(name, "scale")
        control.go("calibrate")
        assert control.computation.calibrate()
        self._settle()
        control.computation.accept_results()
        control.go("results")
        self.picture("results")
        bars = [
            name
            for name in self._scenes.names
            if name not in (*control.project.placements, *control.project.scale_poses)
        ]
        for name, bar in zip(control.project.check_poses, bars, strict=False):
            self.take(name, "verify", shown=bar)  # it lies where the rig was recorded, not where the plan wants it
        assert control.computation.verify()
        self._settle()
        self.picture("verify")
        profile = control.profile_folder
        assert profile is not None
        assert control.saving.save_profile(profile, True)
        self._settle()
        control.go("save")
        self.picture("save")
        print(f"calibrated: {control.project.calibrated}\nverified: {control.project.verified}", flush=True)


def main() -> int:
    """Walk, and calibrate the recording by the command."""
    folder = Path(sys.argv[1]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    os.environ |= {"SPHERECAL_SETTINGS": str(folder / "settings.ini"), "SPHERECAL_3D": "2d"}
    os.environ |= {"XDG_CONFIG_HOME": str(folder), "SPHERECAL_DRIVERS": str(folder / "drivers.json")}
    os.environ[DISCOVERY_VARIABLE] = str(build_producer(aravis=True).parent)
    session = demo_session(Context())
    scenes = SessionScenes(session)
    cameras = [GigeCamera(serial, *camera.image_size) for serial, camera in scenes.cameras.items()]
    application = QApplication(sys.argv[:1])
    with GigeRig(cameras) as rig, rig.entered():
        show_gige(rig, scenes, scenes.names[0])
        wizard = Wizard(folder, rig, scenes, session)
        try:
            wizard.walk()
            recording = wizard.control.project
            assert recording is not None
        finally:
            wizard.window.close()
            application.processEvents()
    return spherecal(["calibrate", str(recording.folder), "-o", str(folder / "calibrated")])


if __name__ == "__main__":
    sys.exit(main())
