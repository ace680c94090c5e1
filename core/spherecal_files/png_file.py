"""Images as PNG files."""

import struct
import zlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

_ROWS = 32  # filtered and coded at a time: they stay in the processor's cache
_UP = 2  # the filter
_SAMPLED = 32  # one row of so many tells how often each byte occurs


def png_bytes(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """A grey image (h, w), uint8 or uint16, as PNG: differences to the row above by frequency, small as deflate's 1."""
    from spherecal_files.huffman import zlib_stream  # not while a window starts, which loads whoever records

    (height, width), bits, whole = image.shape, 8 * image.itemsize, np.ascontiguousarray(image)
    below, above = (whole[row::_SAMPLED].view(np.uint8)[: -(-(height - 1) // _SAMPLED)] for row in (1, 0))
    data = zlib_stream(_filtered(image), np.bincount((below - above).ravel(), minlength=256))
    chunks = (b"IHDR", struct.pack(">2I5B", width, height, bits, 0, 0, 0, 0)), (b"IDAT", data), (b"IEND", b"")
    parts = [
        (struct.pack(">I", len(of)), kind, of, zlib.crc32(of, zlib.crc32(kind)).to_bytes(4, "big"))
        for kind, of in chunks
    ]
    return b"".join([b"\x89PNG\r\n\x1a\n", *(one for part in parts for one in part)])


def _filtered(image: NDArray[np.uint8] | NDArray[np.uint16]) -> Iterator[NDArray[np.uint8]]:
    """Some rows at a time as a PNG file has them: the filter, then the difference of each byte to the one above."""
    height, width = image.shape
    rows = np.zeros((_ROWS + 1, image.itemsize * width), np.uint8)
    for start in range(0, height, _ROWS):
        some = np.ascontiguousarray(image[start : start + _ROWS], dtype=image.dtype.newbyteorder(">"))
        count = len(some)
        rows[1 : count + 1] = some.view(np.uint8)
        part = np.empty((count, rows.shape[1] + 1), np.uint8)
        part[:, 0] = _UP
        np.subtract(rows[1 : count + 1], rows[:count], out=part[:, 1:])
        rows[0] = rows[count]
        yield part.ravel()
