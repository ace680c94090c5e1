"""Why an image shows no targets: what is found in it once its polarity, its sides, its ids or its size are changed."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from spherecal.base.messages.values import Phrase
from spherecal.targets.blobs import GreyImage
from spherecal.targets.detection import Detections, Detector
from spherecal.targets.family import CODE_COUNT, make_target_set
from spherecal.targets.images import read_image
from spherecal.targets.target_set import TargetSet

_LEAST_TARGETS = 2  # one alone may be chance: a fifth of mirrored targets read as others
_LEAST_CONTRAST = 12.0  # over the noise: below, the detector takes nothing for contrast (10 in blobs.py)
_FAINT, _FAINT_GREY = 24.0, 24.0  # contrast over noise, and brightest grey of 255, of images that are called dark
_MOST_MEGAPIXELS = 8.0  # of an enlarged image
# Detail of about 1 px over what is coarser. Rendered rooms with the ball: 0.47 in focus, 0.28 to 0.6 before textures,
# 0.16 with four targets before a plain wall; 0.17 blurred by 2 px and 0.11 by 3 px (most targets are still found), 0.10
# to 0.12 by 4 to 6 px.
_SHARP = 0.135
_MOST_IMAGES = 5


@dataclass(frozen=True)
class Cause:
    """The likely reason for having found nothing: `kind` for programs, what was seen and what to do in words."""

    kind: str
    seen: Phrase
    remedy: Phrase


def why_nothing(image: GreyImage, targets: TargetSet) -> Cause:
    """The likely reason why a grey image (h, w) shows no targets of a set."""
    return _without_light(image) or _with_a_change(image, targets) or _without_sharpness(image) or _NOT_THERE


def why_nothing_in(paths: Sequence[Path], targets: TargetSet) -> Cause:
    """The most frequent reason in a few of the image files, spread over all of them."""
    step = max(len(paths) // _MOST_IMAGES, 1)
    causes = [why_nothing(read_image(path), targets) for path in list(paths)[::step][:_MOST_IMAGES]]
    telling = [cause for cause in causes if cause is not _NOT_THERE] or causes
    most = Counter(cause.kind for cause in telling).most_common(1)[0][0]
    return next(cause for cause in telling if cause.kind == most)


def reads_mirrored(image: GreyImage, targets: TargetSet, known: int | None = None) -> bool:
    """Whether far more targets are found in the image (h, w) as a mirror shows it; some read as others as it is.

    `known`: how many are found in it as it is; None: not looked for yet.
    """
    found = _found(image[:, ::-1], targets)
    return found >= _LEAST_TARGETS and found > 2 * (_found(image, targets) if known is None else known)


_NOT_THERE = Cause("no-targets", Phrase("nothing-there"), Phrase("nothing-there-remedy"))


def _without_light(image: GreyImage) -> Cause | None:
    """Too little light or contrast for anything to be found."""
    low, high = (float(x) for x in np.percentile(image, [0.5, 99.8]))
    noise = _noise(image)
    contrast = (high - low) / noise
    digits = 8 if image.dtype == np.uint8 else max(int(image.max()).bit_length(), 10)  # as far as its pixels show
    if contrast < _LEAST_CONTRAST or (contrast < _FAINT and high < _FAINT_GREY * float(2**digits - 1) / 255):
        seen = Phrase("nothing-dark", {"contrast": high - low, "noise": noise})
        return Cause("dark", seen, Phrase("nothing-dark-remedy"))
    return None


def _noise(image: GreyImage) -> float:
    """Standard deviation of the noise in grey, at least that of rounding to the image's digits."""
    pixels = image[: 2 * (image.shape[0] // 2), : 2 * (image.shape[1] // 2)].astype(np.float32)
    second = (pixels[:, ::2] - pixels[:, 1::2])[::2] - (pixels[:, ::2] - pixels[:, 1::2])[1::2]
    bits = int(np.bitwise_or.reduce(image, axis=None))
    return max(float(np.median(np.abs(second))) / (0.6745 * 2.0), 0.29 * (bits & -bits or 1))


def _with_a_change(image: GreyImage, targets: TargetSet) -> Cause | None:
    """A change to the image or to what is looked for with which targets are found."""
    other = "dark-on-light" if targets.polarity == "light-on-dark" else "light-on-dark"
    found = _found(image, replace(targets, polarity=other))
    if found >= _LEAST_TARGETS:
        key = "nothing-polarity-dark" if other == "dark-on-light" else "nothing-polarity-light"
        remedy = "nothing-polarity-dark-remedy" if other == "dark-on-light" else "nothing-polarity-light-remedy"
        return Cause("polarity", Phrase(key, {"targets": found}), Phrase(remedy))
    if reads_mirrored(image, targets):
        found = _found(image[:, ::-1], targets)
        return Cause("mirrored", Phrase("nothing-mirrored", {"targets": found}), Phrase("nothing-mirrored-remedy"))
    family = make_target_set(CODE_COUNT, targets.size_mm, targets.polarity)
    every: Detections = Detector(family).detect(image)
    strangers = [int(target) for target in every.target_ids if int(target) not in targets.layouts]
    if len(strangers) >= _LEAST_TARGETS:
        values = {"targets": len(strangers), "ids": strangers[:8]}
        seen = Phrase("nothing-others-more", values) if len(strangers) > 8 else Phrase("nothing-others", values)
        return Cause("other-targets", seen, Phrase("nothing-others-remedy"))
    for times in (2, 4):
        if image.size * times**2 > _MOST_MEGAPIXELS * 1e6 * times:
            break
        large = cv2.resize(image, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
        if _found(cast(GreyImage, large), targets) >= _LEAST_TARGETS:
            return Cause("small", Phrase("nothing-small", {"times": times}), Phrase("nothing-small-remedy"))
    return None


def _found(image: GreyImage, targets: TargetSet) -> int:
    return len(Detector(targets).detect(cast(GreyImage, np.ascontiguousarray(image))).target_ids)


_NOISE_QUANTILE = 2.7  # the quantile below of pure noise, in its standard deviations


def _without_sharpness(image: GreyImage) -> Cause | None:
    """Little detail of about 1 px, the noise taken off, over all that is coarser, to 16 px; edges, not empty parts."""
    light = image.astype(np.float32)
    first, second = (cv2.GaussianBlur(light, (0, 0), sigma) for sigma in (1.5, 16.0))
    fine, coarse = (float(np.percentile(np.abs(band), 99.3)) for band in (light - first, first - second))
    sharpness = np.sqrt(max(fine**2 - (_NOISE_QUANTILE * _noise(image)) ** 2, 0.0)) / max(coarse, 1e-6)
    if sharpness >= _SHARP:
        return None
    return Cause("blurred", Phrase("nothing-blurred"), Phrase("nothing-blurred-remedy"))
