"""PGM and PPM files as raw pixels: Pillow stretches the grey values of 10, 12 and 14 bits to the full scale of 16.

Format: netpbm, pgm(5) and ppm(5). It has magic number, width, height, largest value, one white space, then the
samples, 16-bit ones with the high byte first; text (P2, P3) or binary (P5, P6). Comments run from # to the end of the
line.
"""

import re
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

_GAP = rb"(?:\s|#[^\n\r]*[\n\r])+"
_HEADER = re.compile(rb"P([2356])" + 3 * (_GAP + rb"(\d+)") + rb"\s")


def read_pnm(data: bytes) -> NDArray[Any] | None:
    """Grey values (h, w), uint8 or uint16, of a PGM or PPM file, colour as luminance; None for any other file."""
    header = _HEADER.match(data)
    if header is None:
        return None
    kind, width, height, largest = (int(number) for number in header.groups())
    shape = (height, width) if kind in (2, 5) else (height, width, 3)
    count = int(np.prod(shape))
    if not 0 < largest < 2**16:
        raise ValueError(f"largest value {largest}")
    if kind in (2, 3):
        words = data[header.end() :].split(maxsplit=count)[:count]
        samples = np.array([int(word) for word in words], dtype=np.int64)
    else:
        samples = np.frombuffer(data, ">u2" if largest > 255 else np.uint8, offset=header.end())[:count]
    if len(samples) < count:
        raise ValueError(f"{count - len(samples)} of {count} samples are missing")
    if samples.min() < 0 or samples.max() > largest:
        raise ValueError("samples exceed the largest value")
    pixels = samples.reshape(shape).astype(np.uint16 if largest > 255 else np.uint8)
    return pixels if kind in (2, 5) else cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
