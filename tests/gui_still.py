"""A simulated scene at rest: its live images are drawn and examined once, not five times a second.

Drawing and detecting the live images of six cameras takes two thirds of a processor for as long as a window is open.
What is captured has noise of its own all the same, and a scene, a light or a fault that changes is seen at once.
Files of captured images are not compressed, which takes as long as finding their dots. The ball has half as many
targets: all that is drawn, found and computed takes half the time.
"""

from collections import OrderedDict
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from threading import Lock
from time import perf_counter
from typing import Any

import pytest

import spherecal.calibrate as engine
from spherecal.base.context import Context
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.steps.settings import CalibrationSettings
from spherecal.targets.detection import Detections, DetectionSettings, Detector
from spherecal.targets.images import balance_mosaic
from spherecal_cameras.protocol import CameraSettings, Frame
from spherecal_cameras.simulated.simulated_source import SimulatedSource
from spherecal_sim.render_session import RENDERED
from tests.networks import computed_once

_KEPT = 96  # images of 1.3 MB
# Neither compressed nor filtered: 1 ms for an image, where OpenCV knows the filter (since 4.12); without that 13 ms.
_TARGETS = 100  # 140 dots and more in each image; 100 are wanted


@dataclass(eq=False)
class _Image:
    """A live image, and what was found in it, by detector and settings."""

    frame: Frame
    found: dict[Hashable, Detections] = field(default_factory=dict)
    is_grey: bool = False


class _Images:
    """The live images of late, by what they show and by the number of their array."""

    def __init__(self) -> None:
        self._by_scene: OrderedDict[Hashable, _Image] = OrderedDict()
        self._by_array: dict[int, _Image] = {}
        self._lock = Lock()

    def showing(self, scene: Hashable) -> _Image | None:
        """The image of a scene."""
        with self._lock:
            return self._by_scene.get(scene)

    def of(self, array: Any) -> _Image | None:
        """The image with this array."""
        with self._lock:
            return self._by_array.get(id(array))

    def keep(self, scene: Hashable, frame: Frame) -> _Image:
        """Keep a new image; the oldest goes."""
        made = _Image(frame)
        with self._lock:
            self._by_scene[scene] = self._by_array[id(frame.image)] = made
            while len(self._by_scene) > _KEPT:
                del self._by_array[id(self._by_scene.popitem(last=False)[1].frame.image)]
        return made


@contextmanager
def images_at_rest() -> Iterator[None]:
    """Live images of simulated cameras are the same while nothing changes, and what is found in them too.

    The simulated ball is a small one.
    """
    images, take, detect = _Images(), SimulatedSource.take_image, Detector.detect

    def take_image(
        self: SimulatedSource, serial: str, settings: CameraSettings, number: int, attempt: int, timeout_s: float
    ) -> Frame:
        faults = tuple(one for one in self.faults if one.camera == serial and one.active(self.sets_taken + 1))
        if number or any(fault.kind == "lose" for fault in faults):
            return take(self, serial, settings, number, attempt, timeout_s)
        began = perf_counter()
        camera = next(one for one in self.stage.truth.cameras if serial.endswith(one.id))
        rig = (self.label, camera.intrinsics.tobytes(), camera.translation_mm.tobytes(), self._rendered)
        scene = (rig, self.stage.at(), serial, settings, faults)
        image = images.showing(scene) or images.keep(scene, take(self, serial, settings, number, attempt, timeout_s))
        now, frame_id = perf_counter(), self.next_frame_id(serial)
        return replace(image.frame, taken_s=began, arrived_s=now, frame_id=frame_id, time_stamp_ns=self.stamp_ns())

    def detect_once(self: Detector, image: Any, settings: DetectionSettings | None = None) -> Detections:
        kept = images.of(image)
        if kept is None or self._markers is not None:
            return detect(self, image, settings)
        key = (self._table.ids.tobytes(), self._table.layouts.tobytes(), settings)
        if key not in kept.found:
            kept.found[key] = detect(self, image, settings)
        return kept.found[key]

    def balance_once(image: Any) -> Any:
        kept = images.of(image)
        if kept is not None and kept.is_grey:
            return image
        balanced = balance_mosaic(image)
        if kept is not None:
            kept.is_grey = balanced is image
        return balanced

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("spherecal_cameras.simulated.stage.RENDERED", replace(RENDERED, targets=_TARGETS))
        patch.setattr("spherecal_gui.tasks.live_detection.balance_mosaic", balance_once)
        patch.setattr(SimulatedSource, "take_image", take_image)
        patch.setattr(Detector, "detect", detect_once)
        yield


@contextmanager
def calibrated_once() -> Iterator[None]:
    """The window calibrates the same images with equal settings once in a run of the tests; the rest is done again."""
    compute = engine.calibrate

    def known(
        session: Session, settings: CalibrationSettings | None = None, context: Context | None = None
    ) -> Calibration:
        return computed_once(f"{session.input_sha256} {settings}", lambda: compute(session, settings, context))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "calibrate", known)
        yield
