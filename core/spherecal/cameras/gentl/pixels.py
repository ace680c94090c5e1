"""From a delivered buffer to grey pixels: line padding, packed formats, colour."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherecal.cameras.protocol import GreyPixels

_COMPONENTS = {"RGB": (0, 1, 2), "BGR": (2, 1, 0)}
# ITU-R BT.601 luma in 1/256
_LUMA = (77, 150, 29)


def grey_pixels(component: Any) -> GreyPixels:
    """The pixels (h, w) of a 2-D component of a buffer; a view on its memory where they need no unpacking.

    Line padding is cut off, colour becomes luminance, a Bayer mosaic stays as it is. ValueError for anything else.
    """
    name, data = str(component.data_format), component.data
    if data is None:
        raise ValueError(f"images of the format {name} cannot be read")
    width, height = int(component.width), int(component.height)
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
    return _luminance(image.reshape(height, width, channels), name)


def _luminance(image: NDArray[Any], name: str) -> GreyPixels:
    order = _COMPONENTS.get(name[:3].upper())
    if order is None or image.shape[2] < 3:
        raise ValueError(f"images of the format {name} cannot be made grey")
    total = np.zeros(image.shape[:2], np.uint32)
    for channel, weight in zip(order, _LUMA, strict=True):
        total += np.multiply(image[..., channel], weight, dtype=np.uint32)
    return (total >> 8).astype(image.dtype)


def significant_bits(pixel_format: str) -> int:
    """The bits of a pixel by its format's name: Mono12p has 12, BayerRG8 has 8."""
    digits = ""
    for character in pixel_format:
        if character.isdigit():
            digits += character
        elif digits:
            break
    return int(digits) if digits and int(digits) in (8, 10, 12, 14, 16) else 8
