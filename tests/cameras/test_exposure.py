"""Exposures that are found for all cameras at once."""

import time
from typing import cast

import numpy as np
import pytest

from spherecal_cameras.exposure import WANTED, dots_light, expose_all
from spherecal_cameras.protocol import CameraSettings, CameraSource, CaptureRequest, Frame, FrameSet, MissingFrame
from tests.method.test_targets_detection import DETECTOR, drawn, view_of

LIGHT = drawn([3, 17, 42, 58], [view_of(10 * i, 25 * i) for i in range(4)]).light


class Lamp:
    """Cameras that see drawn targets, each in light of its own; `dead` ones send nothing."""

    def __init__(self, lights: dict[str, float], bits: int = 8, dead: tuple[str, ...] = ()) -> None:
        self.lights, self.bits, self.dead = lights, bits, dead
        self.exposures = dict.fromkeys(lights, 10_000.0)
        self.sets = 0

    def apply(self, settings):
        self.exposures |= {serial: one.exposure_us for serial, one in settings.items()}

    def frame(self, serial: str) -> Frame:
        full = 2**self.bits - 1
        light = LIGHT / 185 * self.lights[serial] * self.exposures[serial] / 10_000 * full
        noisy = light + np.random.default_rng(self.sets).normal(0, 0.004 * full, light.shape)
        image = np.clip(np.rint(noisy), 0, full).astype(np.uint8 if self.bits == 8 else np.uint16)
        now = time.perf_counter()
        return Frame(serial, image, self.bits, "Mono8", now, now)

    def capture_set(self, request: CaptureRequest, context) -> FrameSet:
        self.sets += 1
        wanted = request.cameras or ()
        missing = tuple(MissingFrame(serial, "", "") for serial in wanted if serial in self.dead)
        return FrameSet(
            self.sets, {serial: self.frame(serial) for serial in wanted if serial not in self.dead}, missing
        )


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("detector", [DETECTOR, None])
def test_every_camera_gets_the_longest_exposure_that_does_not_saturate_its_dots(bits, detector):
    lamp = Lamp({"dim": 0.06, "right": WANTED, "bright": 4.0, "glaring": 60.0}, bits)
    settings = {serial: CameraSettings(gain_db=3.0) for serial in lamp.lights}
    found = expose_all(cast(CameraSource, lamp), settings, detector)
    assert found["right"].exposure_us == 10_000.0, "it was right and stays as it is"
    for serial, one in found.items():
        assert one.gain_db == 3.0 and one.exposure_us == lamp.exposures[serial]
        assert dots_light(lamp.frame(serial), detector) == pytest.approx(WANTED, abs=0.07)
        assert (lamp.frame(serial).image >= 2**bits - 1).mean() < 0.001
    assert lamp.sets <= 8


def test_darkness_and_cameras_that_send_nothing_end_it_too():
    lamp = Lamp({"capped": 0.0, "dead": 1.0, "right": WANTED}, dead=("dead",))
    found = expose_all(cast(CameraSource, lamp), {serial: CameraSettings() for serial in lamp.lights}, DETECTOR)
    assert found["dead"].exposure_us == 10_000.0 and found["right"].exposure_us == 10_000.0
    assert found["capped"].exposure_us == 200_000.0, "five images a second are still possible"
