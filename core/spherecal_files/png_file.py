"""Images as PNG files."""

import heapq
import struct
import zlib
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import IntArray
from spherecal.base.kernels import njit

_END = 256  # the symbol that ends a block
_MOST_BITS = 12  # of a code: those of two bytes and a word that is not yet full fit in 64 bits
_ORDER = (16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15)  # in which a block states lengths' lengths


def zlib_stream(parts: Iterable[NDArray[np.uint8]], counts: IntArray) -> bytes:
    """Bytes in parts, all of even length but the last, compressed (RFC 1950); `counts` (256,): how often, about."""
    lengths = _code_lengths(np.append(counts, 0))
    # the codes that these lengths stand for, their first bit lowest
    codes, code, before = np.zeros_like(lengths), 0, 0
    for k in np.argsort(lengths, kind="stable").tolist():
        code <<= int(lengths[k]) - before
        before = int(lengths[k])
        codes[k] = _reversed(code, before)
        code += 1
    first, second = np.arange(2**16) & 255, np.arange(2**16) >> 8
    pairs = codes[first] | codes[second] << lengths[first] | (lengths[first] + lengths[second]) << 24
    # a last block with codes of its own, 257 for bytes and its end, 2 for distances, which do not occur
    fields = [(1, 1), (2, 2), (0, 5), (1, 5), (15, 4), *((0 if k > 15 else 4, 3) for k in _ORDER)]
    fields += [(_reversed(k, 4), 4) for k in (*lengths.tolist(), 1, 1)]
    out, bits, count, check = [b"\x78\x01"], 0, 0, 1
    for value, size in fields:
        bits, count = bits | value << count, count + size
    whole = count // 32
    out.append((bits & (1 << 32 * whole) - 1).to_bytes(4 * whole, "little"))
    state = np.array([bits >> 32 * whole, count - 32 * whole], np.uint64)
    for part in parts:
        even = len(part) // 2 * 2
        out.append(_coded(part[:even].view(np.uint16), pairs.astype(np.uint32), state).tobytes())
        check = zlib.adler32(part.data, check)
        bits, count = (int(one) for one in state)
        for byte in part[even:].tolist():
            bits, count = bits | int(codes[byte]) << count, count + int(lengths[byte])
    bits, count = bits | int(codes[_END]) << count, count + int(lengths[_END])
    return b"".join([*out, bits.to_bytes((count + 7) // 8, "little"), check.to_bytes(4, "big")])


def _reversed(code: int, size: int) -> int:
    return int(f"{code:0{size}b}"[::-1], 2)


def _code_lengths(counts: IntArray) -> IntArray:
    """The length in bits of each symbol's code, after Huffman, at most `_MOST_BITS`."""
    while True:
        counts = counts // 2 + 1
        lengths, heap = np.zeros_like(counts), [(count, k, [k]) for k, count in enumerate(counts.tolist())]
        heapq.heapify(heap)
        while len(heap) > 1:
            (rare, k, some), (count, _, others) = heapq.heappop(heap), heapq.heappop(heap)
            lengths[some + others] += 1
            heapq.heappush(heap, (rare + count, k, some + others))
        if lengths.max() <= _MOST_BITS:
            return lengths


@njit(nogil=True, cache=True)
def _coded(pairs, table, state):
    """The codes of pairs of bytes as whole words; `state`: bits that fill none yet, and how many, updated."""
    out, size = np.empty(len(pairs) + 1, np.uint32), 0
    bits, count = state
    for pair in pairs:
        code = np.uint64(table[pair])
        bits |= (code & np.uint64(0xFFFFFF)) << count
        count += code >> np.uint64(24)
        out[size] = bits
        full = count & np.uint64(32)
        size += np.int64(full >> np.uint64(5))
        bits >>= full
        count -= full
    state[0], state[1] = bits, count
    return out[:size]


_ROWS = 32  # filtered and coded at a time: they stay in the processor's cache
_UP = 2  # the filter
_SAMPLED = 32  # one row of so many tells how often each byte occurs


def png_bytes(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """A grey image (h, w), uint8 or uint16, as PNG: differences to the row above by frequency, small as deflate's 1."""
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
