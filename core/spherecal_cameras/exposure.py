"""Exposures for all cameras at once: as long as the dots stay below saturation."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal.targets.detection import Detector
from spherecal.targets.images import balance_mosaic
from spherecal_cameras.protocol import CameraSettings, CameraSource, CaptureRequest, Frame

# Of full scale, at the brightest pixels of the dots. Noise of a dot goes with the root of its light: 0.8 leaves a
# twentieth more noise than 0.9, and room for lamps that flicker by a tenth.
WANTED, _NEAR = 0.8, 0.06
_FULL = 0.98  # from there on it is not known by how much a pixel is too bright
_SHORTER = 0.3
_MOST_US, _LEAST_US = 200_000.0, 10.0  # longer ones are for a lamp, not for a setting: five images a second
_TRIES = 8  # from 100 times the light: four shorter ones, and two that fit
_REACH = 5  # px around a dot: its rim and the paper beside it
_OF_DOTS, _OF_PIXELS = 95.0, 99.5  # percentiles: a highlight on some dots, or a lamp in the image, does not count


def expose_all(
    source: CameraSource,
    settings: Mapping[str, CameraSettings],
    detector: Detector | None,
    context: Context | None = None,
) -> dict[str, CameraSettings]:
    """Give open cameras the longest exposure at which their dots, or brightest pixels, are not saturated; by serial."""
    context, chosen, left = context or Context(), dict(settings), dict.fromkeys(settings)
    for number in range(_TRIES):
        context.report(
            "setting exposures", number / _TRIES, Phrase("some-of-all", {"number": number + 1, "all": _TRIES})
        )
        taken = source.capture_set(CaptureRequest(tuple(left)), context)
        better = {serial: _better(chosen[serial].exposure_us, taken.frames.get(serial), detector) for serial in left}
        left = {serial: None for serial, exposure_us in better.items() if exposure_us != chosen[serial].exposure_us}
        if not left:
            break
        changed = {serial: replace(chosen[serial], exposure_us=better[serial]) for serial in left}
        source.apply(changed)
        chosen |= changed
    return chosen


def _better(exposure_us: float, frame: Frame | None, detector: Detector | None) -> float:
    """A better exposure than that of an image, us; the same where it is good."""
    if frame is None:
        return exposure_us
    light = dots_light(frame, detector)
    if abs(light - WANTED) <= _NEAR:
        return exposure_us
    factor = _SHORTER if light >= _FULL else WANTED / max(light, 0.01)
    return float(np.clip(exposure_us * factor, _LEAST_US, max(_MOST_US, exposure_us)).round(1))


def dots_light(frame: Frame, detector: Detector | None) -> float:
    """How bright the dots of an image are at their brightest, over full scale; without dots the whole image."""
    full, image = 2.0**frame.bits - 1, frame.image
    found = detector.detect(balance_mosaic(image)) if detector is not None else None
    if found is None or not len(found):
        return float(np.percentile(image[::2, ::2], _OF_PIXELS)) / full
    reach = np.arange(-_REACH, _REACH + 1)
    columns, rows = (np.rint(found.uv[:, axis, None]).astype(int) + reach for axis in (0, 1))
    columns, rows = columns.clip(0, image.shape[1] - 1), rows.clip(0, image.shape[0] - 1)
    return float(np.percentile(image[rows[:, :, None], columns[:, None, :]].max(axis=(1, 2)), _OF_DOTS)) / full
