"""What is set at a camera: its name, exposure and gain, its light."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from spherecal.base.context import Context
from spherecal.base.file_reading import id_problem
from spherecal.base.messages.catalogue import phrase
from spherecal_gui import languages
from spherecal_gui.controllers.camera_controller import keep_in_profile
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import translate
from spherecal_gui.tasks.task import Runner

if TYPE_CHECKING:  # the window starts without the cameras' modules
    from spherecal_cameras.protocol import CameraSettings, CameraSource
    from spherecal_gui.controllers.controller import Controller

    OfAll = Mapping[str, CameraSettings]  # by serial

_BLINKS, _BLINK_S = 8, 0.35
_PATIENCE_MS = 10_000


class TuningController(ControllerPart):
    """Settings of single cameras."""

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.blinker = Runner(self)
        self._tuned: dict[str, CameraSettings] = {}

    def close(self) -> None:
        """Stop what blinks, and forget the settings; all is on disk already."""
        self.blinker.abandon(_PATIENCE_MS)
        self._tuned = {}

    @property
    def _real(self) -> bool:
        return self.project is not None and self.project.source.startswith("genicam")

    def settings_of(self, serial: str) -> "CameraSettings":
        """A camera's settings as they were set."""
        # The window starts without the cameras' modules.
        from spherecal_cameras.camera_settings import default_profile_path, read_profile
        from spherecal_cameras.protocol import CameraSettings

        if serial not in self._tuned:
            known = read_profile(default_profile_path()).entry(serial).settings if self._real else CameraSettings()
            self._tuned[serial] = known
        return self._tuned[serial]

    def why_not_renamed(self, serial: str) -> str:
        """Why a camera cannot have another name now; empty where it can."""
        project, connection = self.project, self.main.cameras.connection
        if not self._real or connection is None or project is None:
            return translate("Connect", "The names come from the recording or the simulated rig.")
        if project.taken:
            return translate(
                "Connect", "Placements were captured under this name: begin a new calibration to change it."
            )
        if connection.plan.camera(serial, "") is not None:
            return translate("Connect", "The description of the bench names this camera.")
        return ""

    def set_camera(self, serial: str, name: str, exposure_us: float, gain_db: float) -> bool:
        """Give a camera a name (if it may have it now), an exposure and a gain; whether that was begun."""
        connection = self.main.cameras.connection
        if connection is None or self.runner.running:
            return False
        settings = replace(self.settings_of(serial), exposure_us=exposure_us, gain_db=gain_db)
        renamed = name != connection.names[serial] and not self.why_not_renamed(serial)
        real, source = self._real, connection.source

        def work(context: Context) -> bool:
            context.report("setting up the camera", 0.0, connection.names[serial])
            if real:
                keep_in_profile((serial,), settings=settings, **({"name": name} if renamed else {}))
            source.apply({serial: settings})
            return renamed

        self._tuned[serial] = settings
        return self.runner.start("connect", work, self._set_up, self.main.failed("connect"))

    def set_all(self, **settings: Any) -> bool:
        """Set up all cameras like this (protocol.CameraSettings); kept in the camera profile."""

        def change(source: "CameraSource", of_all: "OfAll", _: Context) -> "tuple[OfAll, list[str]]":
            wanted = {serial: replace(one, **settings) for serial, one in of_all.items()}
            return wanted, [report.serial for report in source.apply(wanted) if report.problems]

        return self._set_all(change)

    def of_all(self) -> "list[CameraSettings]":
        """What the cameras were set to."""
        return [self.settings_of(serial) for serial in self.main.cameras.names]

    def expose_all(self) -> bool:
        """Find for each camera the longest exposure by which its dots are not saturated; kept in the camera profile."""

        def expose(source: "CameraSource", of_all: "OfAll", context: Context) -> "tuple[OfAll, list[str]]":
            # the window starts without the cameras' modules
            from spherecal.targets.detection import Detector
            from spherecal_cameras.exposure import expose_all

            detector = self.main.cameras.connection.detector() if self.main.cameras.connection is not None else None
            return expose_all(source, of_all, detector if isinstance(detector, Detector) else None, context), []

        return self._set_all(expose)

    def _set_all(self, change: "Callable[[CameraSource, OfAll, Context], tuple[OfAll, list[str]]]") -> bool:
        """Begin to set up all cameras that can be reached; those of a rig keep it in the camera profile."""
        connection = self.main.cameras.connection
        if connection is None or self.runner.running:
            return False
        source, real, names = connection.source, self._real, connection.names
        states = source.statuses()
        of_all = {s: self.settings_of(s) for s in names if s not in states or states[s].state.usable}

        def work(context: Context) -> "tuple[OfAll, list[str]]":
            changed, refused = change(source, of_all, context)
            for serial, settings in changed.items():
                if real:
                    keep_in_profile((serial,), settings=settings)
            return changed, refused

        def done(found: "tuple[OfAll, list[str]]") -> None:
            self._tuned.update(found[0])
            if found[1]:
                message = translate("Look", "Not as wanted: {names}. Their driver took the nearest setting.")
                self.main.tell("bad", message.format(names=languages.listed(names[one] for one in found[1])))
            self._set_up(False)

        return self.runner.start("connect", work, done, self.main.failed("connect"))

    def why_no_trigger(self) -> str:
        """Why the cameras' trigger cannot be chosen; empty where it can."""
        return "" if self._real else translate("Connect", "Simulated cameras are all exposed at the same moment.")

    def name_camera(self, serial: str, name: str) -> None:
        """Give a camera another name; the window says why it cannot have it."""
        connection = self.main.cameras.connection
        if connection is None:
            return
        why = self.why_not_renamed(serial)
        if not why and name in (one for other, one in connection.names.items() if other != serial):
            why = translate("Connect", "Another camera has the name {name}.").format(name=name)
        if not why and (problem := id_problem(name)) is not None:
            why = f"{name}: {phrase(problem, languages.now())}."
        if why:
            self.main.tell("bad", why)
            return
        settings = self.settings_of(serial)
        self.set_camera(serial, name, settings.exposure_us, settings.gain_db)

    def _set_up(self, renamed: bool) -> None:
        if renamed:
            self.main.cameras.connect_all()
        else:
            self.main.changed.emit()

    def can_blink(self) -> bool:
        """Whether the cameras may have a light of their own that can be switched."""
        return hasattr(self.main.cameras.source, "indicate")

    def blink(self, serial: str, answered: Callable[[bool], None]) -> None:
        """Let a camera's own light blink for some seconds."""
        indicate = getattr(self.main.cameras.source, "indicate", None)
        if indicate is None:
            answered(False)
            return

        def work(context: Context) -> bool:
            try:
                for number in range(_BLINKS):
                    context.check()
                    if not indicate(serial, bool(number % 2)):
                        return False
                    time.sleep(_BLINK_S)
            finally:
                indicate(serial, True)
            return True

        self.blinker.start("blink", work, answered, lambda _: answered(False), lambda: None)
