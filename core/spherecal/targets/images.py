"""Reading camera images as they were recorded: one channel of 8 or 16 bits, raw pixel order."""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, cast

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFile, UnidentifiedImageError

from spherecal.base.errors import InputError
from spherecal.base.file_reading import read_file
from spherecal.base.messages.values import Phrase
from spherecal.targets.blobs import GreyImage
from spherecal.targets.pnm import read_pnm

LARGEST_MEGAPIXELS = 160  # the largest industrial sensors have 152
_SMALLEST_SIDE_PX = 72  # the window of the local contrast, see blobs.py
_MOST_BYTES_A_PIXEL = 8  # four channels of 16 bits
_SMALL_BYTES = 16 << 20  # for whatever else an image file holds: previews, colour profiles
MOST_BYTES = 1 << 30
# What broken files make Pillow raise when they are opened.
BROKEN = (OSError, SyntaxError, ValueError, EOFError, Image.DecompressionBombError, UnidentifiedImageError)
_FORMATS = ("PNG", "TIFF", "JPEG", "BMP", "PPM")  # PPM: all of PBM, PGM, PPM, PNM, text and binary

# A colour filter array left in the image shows as phases of unlike contrast: by 10 % and more under white light, while
# phases of one colour agree to 0.5 % in images of 3 MP.
_MOSAIC = 0.03


@contextmanager
def opened(file: BinaryIO) -> Iterator[ImageFile.ImageFile]:
    """An image file in one of our formats, its pixels not read yet; no warnings of large images and broken metadata."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Image.open(file, formats=_FORMATS) as image:
            yield image


def check_size(path: Path, image: GreyImage, size: tuple[int, int]) -> None:
    """Refuse an image that is not of its camera's width and height in px."""
    height, width = image.shape
    if (width, height) != tuple(size):
        values = {"file": path, "width": width, "height": height, "camera_width": size[0], "camera_height": size[1]}
        raise InputError(Phrase("error-image-size", values))


def read_image(path: Path) -> GreyImage:
    """The grey image (h, w), uint8 or uint16, in a PNG, TIFF, JPEG, BMP or PNM (PGM, PPM) file.

    Colour becomes luminance; raw Bayer pixels are brought to one brightness; orientation tags are ignored.
    """
    data = read_file(Path(path), MOST_BYTES, fits=_looked_at)
    try:
        with opened(io.BytesIO(data)) as image:
            _check_size(path, *image.size)
            deep_colour = ";16" in str(image.tile) and image.mode in ("RGB", "RGBA", "LA")
            pixels = read_pnm(data) if image.format == "PPM" else None
            if pixels is None:
                image.load()
                pixels = _decode_deep_colour(data) if deep_colour else _decode(image)
            if pixels is None:
                raise InputError(Phrase("error-image-bits", {"file": path}))
    except Image.DecompressionBombError as error:
        raise InputError(Phrase("error-image-large", {"file": path, "most": LARGEST_MEGAPIXELS})) from error
    except UnidentifiedImageError as error:
        raise InputError(Phrase("error-no-image", {"file": str(path)}), Phrase("error-image-kinds")) from error
    except (OSError, SyntaxError, ValueError, EOFError) as error:  # what broken files make the decoders raise
        raise InputError(Phrase("error-damaged-image", {"file": str(path), "why": str(error)})) from error
    return balance_mosaic(_of_kind(pixels))


def _looked_at(file: BinaryIO, path: Path, size: int) -> None:
    """Raise InputError for an image that is too large, or far longer than its pixels need, before it is read."""
    try:
        with opened(file) as image:
            width, height = image.size
    except BROKEN:
        if size > _SMALL_BYTES:
            raise InputError(Phrase("error-no-image", {"file": str(path)}), Phrase("error-image-kinds")) from None
        return  # read whole it says best what is wrong with it
    _check_size(path, width, height)
    if size > width * height * _MOST_BYTES_A_PIXEL + _SMALL_BYTES:
        values = {"file": path, "megabytes": size >> 20, "width": width, "height": height}
        raise InputError(Phrase("error-image-padded", values))


def as_grey(image: NDArray[Any]) -> GreyImage:
    """An image in memory, (h, w) or (h, w, 1, 3 or 4) of 8 or 16 bits, as one channel, as `read_image` makes it.

    Colours are averaged, since nothing says in which order they are; the targets are black and white.
    """
    grey = image[:, :, :3].mean(axis=2) if image.ndim == 3 and image.shape[2] in (1, 3, 4) else image
    if image.dtype not in (np.uint8, np.uint16) or grey.ndim != 2:
        raise InputError(Phrase("error-image-array", {"shape": str(image.shape), "kind": str(image.dtype)}))
    if min(grey.shape) < _SMALLEST_SIDE_PX:
        raise InputError(Phrase("error-small-image", {"width": grey.shape[1], "height": grey.shape[0]}))
    return balance_mosaic(_of_kind(np.rint(grey).astype(image.dtype)))


def _of_kind(pixels: NDArray[Any]) -> GreyImage:
    """The same pixels as a contiguous array of 8 or 16 bits."""
    kind = np.uint16 if pixels.dtype == np.uint16 else np.uint8
    return cast(GreyImage, np.ascontiguousarray(pixels, dtype=kind))


def _check_size(path: Path, width: int, height: int) -> None:
    values = {"file": path, "width": width, "height": height}
    if width * height > LARGEST_MEGAPIXELS * 1e6:
        raise InputError(Phrase("error-many-pixels", {**values, "most": LARGEST_MEGAPIXELS}))
    if min(width, height) < _SMALLEST_SIDE_PX:
        raise InputError(Phrase("error-few-pixels", values))


def _decode(image: Image.Image) -> GreyImage | None:
    """Pixels of a loaded image; None where they have neither 8 nor 16 bits."""
    if image.mode in ("I;16", "I;16L", "I;16B", "I;16N"):
        return np.asarray(image).astype(np.uint16)
    if image.mode == "I":  # 16-bit files come as 32 bits from some decoders
        wide = np.asarray(image)
        return wide.astype(np.uint16) if wide.min() >= 0 and wide.max() < 2**16 else None
    return None if image.mode == "F" else np.asarray(image.convert("L"))


def _decode_deep_colour(data: bytes) -> GreyImage | None:
    """Luminance of 16-bit colour, which Pillow would cut to 8 bits; the data are known to be whole."""
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 3:
        return None
    grey = cv2.cvtColor(pixels[:, :, :3], cv2.COLOR_BGR2GRAY) if pixels.shape[2] > 2 else pixels[:, :, 0]
    return np.asarray(grey, dtype=np.uint16)


def balance_mosaic(image: GreyImage) -> GreyImage:
    """The image with the four phases of a colour filter array brought to one contrast; others are returned unchanged.

    Targets are black and white, so that a gain for each phase makes a raw Bayer image a grey one.
    """
    whole, pairs = np.ascontiguousarray(image), image.shape[1] // 2
    # a row's two phases as two channels: 6 to 28 times as fast as `std` of each (1 to 5 MP)
    rows = [whole[row::2, : 2 * pairs].reshape(-1, pairs, 2) for row in (0, 1)]
    contrasts = np.concatenate([np.asarray(cv2.meanStdDev(row)[1], dtype=float).ravel() for row in rows])
    if contrasts.min() <= 0 or contrasts.max() < (1 + _MOSAIC) * contrasts.min():
        return image
    gains = (contrasts.max() / contrasts).reshape(2, 2)
    black, bright = float(image.min()), float(image.max())
    # room for the gains, and for fractions of the recorded grey values
    scale = min((2**16 - 1) / (gains.max() * max(bright - black, 1.0)), 256.0)
    balanced = np.empty(image.shape, np.uint16)
    for row in (0, 1):
        for column in (0, 1):
            balanced[row::2, column::2] = np.rint((image[row::2, column::2] - black) * (gains[row, column] * scale))
    return balanced
