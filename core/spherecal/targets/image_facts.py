"""What an image file holds besides its pixels: its size and, where stated, region, camera, focal length, pitch."""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from spherecal.base.errors import InputError
from spherecal.base.file_reading import read_file
from spherecal.base.messages.values import Phrase
from spherecal.targets.images import BROKEN, MOST_BYTES, opened

_PNG_EXIF = (b"eXIf", b"Raw profile type exif")  # names of chunks
# EXIF 2.32, tables 4, 7 and 8
_MODEL, _EXIF_IFD = 0x0110, 0x8769
_FOCAL_MM, _FOCAL_35, _SERIAL = 0x920A, 0xA405, 0xA431
_PLANE_X, _PLANE_UNIT, _RECORDED_WIDTH = 0xA20E, 0xA210, 0xA002
# TIFF 6.0: where the image is on the page, in units of its resolution
_POSITION, _RESOLUTION = (0x011E, 0x011F), (0x011A, 0x011B)
_MM_PER_PLANE_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
# The "35 mm equivalent" compares diagonals: that of 36 x 24 mm (CIPA DCG-001).
_DIAGONAL_35_MM = float(np.hypot(36, 24))
# Lenses and sensors that exist; tags outside are of another device or damaged.
_FOCAL_RANGE_MM, _PITCH_RANGE_UM = (0.5, 5000.0), (0.3, 100.0)


@dataclass(frozen=True)
class ImageFacts:
    """Size (width, height) px of an image, and the facts in its EXIF; None for what is missing.

    `focal_px` is the focal length in pixels by its 35 mm equivalent, where the pixel pitch is not known. `offset`
    (left, top) px of the image in a larger one, as TIFF states it.
    """

    size: tuple[int, int]
    model: str | None = None
    serial: str | None = None
    focal_length_mm: float | None = None
    pixel_pitch_um: float | None = None
    focal_px: float | None = None
    offset: tuple[int, int] | None = None


def image_facts(path: Path) -> ImageFacts:
    """The facts of a PNG, TIFF, JPEG, BMP or PNM file; its pixels are not decoded."""
    data = read_file(path, MOST_BYTES)
    try:
        with opened(io.BytesIO(data)) as image:
            # to find tags behind the pixels Pillow decodes these: 35 ms for 5 MP
            has_none = image.format == "PNG" and not any(name in data for name in _PNG_EXIF)
            return _with_exif(image.size, {} if has_none else _exif(image))
    except BROKEN:
        raise InputError(Phrase("error-no-image", {"file": str(path)}), Phrase("error-image-kinds")) from None


def _exif(image: Image.Image) -> dict[int, Any]:
    try:
        exif = image.getexif()
        return {**exif, **exif.get_ifd(_EXIF_IFD)}
    except Exception:  # whatever broken metadata make the decoder raise: the image does not need them
        return {}


def _with_exif(size: tuple[int, int], tags: dict[int, Any]) -> ImageFacts:
    focal = _within(_number(tags.get(_FOCAL_MM)), _FOCAL_RANGE_MM)
    equivalent = _within(_number(tags.get(_FOCAL_35)), _FOCAL_RANGE_MM)
    pitch = _pitch_um(size, tags)
    focal_px = None
    if equivalent is not None and (focal is None or pitch is None):
        focal_px = equivalent * float(np.hypot(*size)) / _DIAGONAL_35_MM
    offset = _offset(tags)
    return ImageFacts(size, _text(tags.get(_MODEL)), _text(tags.get(_SERIAL)), focal, pitch, focal_px, offset)


def _offset(tags: dict[int, Any]) -> tuple[int, int] | None:
    """Where the image lies in the whole frame; None where the file does not say so."""
    if not all(tag in tags for tag in _POSITION):
        return None
    pairs = zip(_POSITION, _RESOLUTION, strict=True)
    left, top = ((_number(tags[at]) or 0.0) * (_number(tags.get(per)) or 1.0) for at, per in pairs)
    return round(left), round(top)


def _pitch_um(size: tuple[int, int], tags: dict[int, Any]) -> float | None:
    """The pixel pitch by the resolution in the focal plane, which holds for the width at which it was recorded."""
    per_unit, mm = _number(tags.get(_PLANE_X)), _MM_PER_PLANE_UNIT.get(tags.get(_PLANE_UNIT, 2))
    if not per_unit or mm is None:
        return None
    recorded = _number(tags.get(_RECORDED_WIDTH)) or size[0]
    return _within(1000 * mm / per_unit * recorded / size[0], _PITCH_RANGE_UM)


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if np.isfinite(number) and number > 0 else None


def _within(value: float | None, limits: tuple[float, float]) -> float | None:
    return value if value is not None and limits[0] <= value <= limits[1] else None


def _text(value: Any) -> str | None:
    text = value.strip("\0 ") if isinstance(value, str) else ""
    return text[:100] if text and text.isprintable() else None
