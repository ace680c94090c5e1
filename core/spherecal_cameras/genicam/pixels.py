"""From a delivered buffer to grey pixels: line padding, packed formats, colour."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from spherecal_cameras.protocol import GreyPixels

_COMPONENTS = {"RGB": (0, 1, 2), "BGR": (2, 1, 0)}
_NO_PICTURE = ("Coord3D", "Confidence", "Disparity")
# Where the brightness of a pixel is in its two bytes: YUYV, or UYVY and CbYCrY.
_CHROMA_FIRST = ("UYVY", "CbYCrY")
# ITU-R BT.601 luma in 1/256
_LUMA = (77, 150, 29)
# Of a line and of lines: 16 and 3 % of the pixels would be enough; sensors repeat every 2 or 4 px, so it is odd.
_SAMPLED = 7


def grey_pixels(component: Any) -> GreyPixels:
    """The pixels (h, w) of a 2-D component, a view where they can be: no padding, luminance of colour, Bayer as is."""
    name, data = str(component.data_format), component.data
    if data is None or name.startswith(_NO_PICTURE):
        raise ValueError(f"images of the format {name} cannot be read")
    width, height = int(component.width), int(component.height)
    if width <= 0 or height <= 0:
        raise ValueError(f"an image of {width} x {height} px")
    channels = round(component.num_components_per_pixel)
    data = np.asarray(data)
    per_line = data.size // height
    image = data[: per_line * height].reshape(height, per_line)
    if per_line < width * channels:
        raise ValueError(f"an image holds {data.size} numbers instead of {width * height * channels}")
    image = image[:, : width * channels]
    if data.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"images of the format {name} have neither 8 nor 16 bits a pixel")
    if channels == 1:
        return image
    if "422" in name:
        return image.reshape(height, width, channels)[..., int(name.endswith(_CHROMA_FIRST))]
    return _luminance(image.reshape(height, width, channels), name)


def first_grey(components: Sequence[Any]) -> tuple[Any, GreyPixels]:
    """The pixels (h, w) of a buffer's first component that is an image, not range or confidence beside it."""
    problem = "a buffer without an image"
    for component in components:
        if component is None:  # of a format that Harvesters does not know
            continue
        try:
            return component, grey_pixels(component)
        except (ValueError, KeyError, AttributeError, TypeError) as error:
            problem = str(error)
    raise ValueError(problem)


def _luminance(image: NDArray[Any], name: str) -> GreyPixels:
    order = _COMPONENTS.get(name[:3].upper())
    if order is None or image.shape[2] < 3:
        raise ValueError(f"images of the format {name} cannot be made grey")
    wide = np.uint16 if image.dtype == np.uint8 else np.uint32  # the weights together are 256
    total, part = np.empty(image.shape[:2], wide), np.empty(image.shape[:2], wide)
    np.multiply(image[..., order[0]], _LUMA[0], out=total, dtype=wide)
    for channel, weight in zip(order[1:], _LUMA[1:], strict=True):
        np.multiply(image[..., channel], weight, out=part, dtype=wide)
        total += part
    total >>= 8
    return cast(GreyPixels, total.astype(image.dtype))


def in_order(image: GreyPixels, bits: int, big: bool) -> tuple[GreyPixels, int]:
    """Pixels (h, w) in this computer's byte order and their significant bits, by which bits are 0: drivers err."""
    if image.dtype != np.uint16 or bits == 8:
        return image, bits if image.dtype == np.uint8 else 16
    if bits == 16:
        return (image.byteswap() if big else image), 16
    sample = np.ascontiguousarray(image[::_SAMPLED, ::_SAMPLED])
    if not (sample >> bits).any():
        return image, bits
    return (image, 16) if (sample.byteswap() >> bits).any() else (image.byteswap(), bits)


def significant_bits(pixel_format: str) -> int:
    """The bits of a pixel by its format's name: Mono12p has 12, BayerRG8 has 8."""
    digits = ""
    for character in pixel_format:
        if character.isdigit():
            digits += character
        elif digits:
            break
    return int(digits) if digits and int(digits) in (8, 10, 12, 14, 16) else 8
