"""Averages of a still scene: N sets, a test that nothing moved meanwhile, and each camera's noise floor."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal.targets.detection import Detections, Detector
from spherecal.targets.images import balance_mosaic
from spherecal_cameras.protocol import CameraSource, CaptureRequest, Frame, FrameSet

# Motion below this leaves an average as good as a single image: a twentieth of the usual blur, half a dot's noise.
STILL_PX = 0.02
_MOST_LOOKED_AT = 4  # images of a camera in which dots are sought; they are spread over the N
_FOR_AFFINE = 6  # dots; fewer only show shifts


@dataclass(frozen=True)
class Stillness:
    """What the dots of one camera did while N images were taken: standard deviations, per axis."""

    camera: str
    dots: int
    motion_px: float | None  # common to all dots (shift, turn, stretch), without their noise; None: none in all images
    noise_px: float | None  # of one dot in one image, the noise floor; None: fewer than `_FOR_AFFINE` dots

    @property
    def still(self) -> bool:
        """Whether nothing moved, as far as dots can tell."""
        return self.motion_px is None or self.motion_px <= STILL_PX


@dataclass(frozen=True, eq=False)
class AveragedSet:
    """An averaged set and what is known of the scene's stillness, by serial; `moved` names cameras that saw motion."""

    taken: FrameSet
    stillness: Mapping[str, Stillness]

    @property
    def moved(self) -> tuple[str, ...]:
        """The cameras that saw the scene move."""
        return tuple(serial for serial, one in self.stillness.items() if not one.still)


def take_averaged(
    source: CameraSource,
    count: int,
    detector: Detector | None,
    request: CaptureRequest | None = None,
    context: Context | None = None,
) -> AveragedSet:
    """Take `count` sets and average them (16 bits), again if the scene moved; one missing in a set is missing."""
    request, context = request or CaptureRequest(), context or Context()
    tries = 0
    while True:
        tries += 1
        sets = []
        for number in range(count):
            context.report("taking images", number / count, Phrase("some-of-all", {"number": number + 1, "all": count}))
            sets.append(source.capture_set(request, context))
        whole = [serial for serial in sets[0].frames if all(serial in one.frames for one in sets)]
        stillness: dict[str, Stillness] = {}
        if detector is not None and count > 1:
            stillness = _examine(sets, whole, detector, context)
        averaged = AveragedSet(_averaged(sets, whole), stillness)
        if not averaged.moved or tries > request.retries:
            return averaged


def _averaged(sets: Sequence[FrameSet], whole: Sequence[str]) -> FrameSet:
    if len(sets) == 1:
        return sets[0]
    missing = {one.camera: one for taken in sets for one in taken.missing}
    late = dict.fromkeys(serial for taken in sets for serial in taken.late)
    spreads = [taken.spread_s for taken in sets if taken.spread_s is not None]
    return FrameSet(
        sets[-1].number,
        {serial: average([taken.frames[serial] for taken in sets]) for serial in whole},
        tuple(missing.values()),
        tuple(late),
        max(taken.attempts for taken in sets),
        sum(taken.seconds for taken in sets),
        max(spreads, default=None),
        all(taken.common_clock for taken in sets),
    )


def average(frames: Sequence[Frame]) -> Frame:
    """The mean of a camera's images, in 16 bits: grey values times 2^(16 - bits), so that fractions survive."""
    total = np.zeros(frames[0].image.shape, np.uint32)
    for frame in frames:
        total += frame.image
    gain = 2 ** (16 - frames[0].bits)
    mean = ((total * gain + len(frames) // 2) // len(frames)).astype(np.uint16)
    mean.flags.writeable = False
    temperatures = [frame.temperature_c for frame in frames if frame.temperature_c is not None]
    return replace(
        frames[-1],
        image=mean,
        bits=16,
        averaged=len(frames),
        temperature_c=float(np.mean(temperatures)) if temperatures else None,
    )


def _examine(
    sets: Sequence[FrameSet], serials: Sequence[str], detector: Detector, context: Context
) -> dict[str, Stillness]:
    chosen = np.unique(np.linspace(0, len(sets) - 1, _MOST_LOOKED_AT).round().astype(int))
    found: dict[str, Stillness] = {}
    with ThreadPoolExecutor(2) as pool:

        def look(serial: str) -> Stillness:
            images = [sets[i].frames[serial].image for i in chosen]
            return stillness(serial, [detector.detect(balance_mosaic(image)) for image in images])

        for serial, one in zip(serials, pool.map(look, serials), strict=True):
            found[serial] = one
            context.report("testing stillness", len(found) / len(serials), Phrase("camera", {"camera": serial}))
    return found


def stillness(camera: str, detections: Sequence[Detections]) -> Stillness:
    """Motion and noise of the dots that all images of a camera show."""
    keys = [d.target.astype(np.int64) * 64 + d.point for d in detections]
    common = reduce(np.intersect1d, keys) if keys else np.empty(0)
    if not len(common) or len(detections) < 2:
        return Stillness(camera, len(common), None, None)
    uv = np.stack([d.uv[np.isin(key, common)] for key, d in zip(keys, detections, strict=True)])  # sorted, both
    moves = uv - uv.mean(axis=0)
    if len(common) < _FOR_AFFINE:
        shift = moves.mean(axis=1)
        return Stillness(camera, len(common), float(np.sqrt((shift**2).sum() / (2 * (len(detections) - 1)))), None)
    # standard deviations, per axis, of the common affine motion and of single dots
    places = uv.mean(axis=0)
    k, n = moves.shape[:2]
    middle = places - places.mean(axis=0)
    design = np.column_stack([np.ones(n), middle / max(float(np.abs(middle).max()), 1.0)])
    basis, _ = np.linalg.qr(design)
    affine = basis @ (basis.T @ moves)
    own = moves - affine
    # wrong or jumping dots (a reflection) must not pass for noise: median-based standard deviation
    noise = 1.4826 * float(np.median(np.abs(own))) * np.sqrt(k / (k - 1) * n / max(n - 3, 1))
    variance = float((affine**2).sum()) / (2 * n * (k - 1)) - noise**2 * 3 / n
    return Stillness(camera, len(common), float(np.sqrt(max(variance, 0.0))), noise)
