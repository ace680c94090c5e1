"""ArUco and AprilTag markers as targets: sets of them, their cells, and the size of their stickers."""

from collections.abc import Sequence

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.targets.marker_set import BORDER_BITS, CORNERS, marker_dictionary
from spherecal.targets.target_set import Polarity, TargetSet

FAMILY = "aruco"
_CORNER = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def marker_count(name: str) -> int:
    """How many markers a dictionary has; their ids are 0 to one less."""
    return len(marker_dictionary(name).bytesList)


def make_marker_set(
    dictionary: str, size_mm: float, ids: Sequence[int] | None = None, polarity: Polarity = "dark-on-light"
) -> TargetSet:
    """Markers of a dictionary (all without `ids`) as targets; points 0 to 3 are the black square's corners."""
    count = marker_count(dictionary)
    chosen = range(count) if ids is None else ids
    if not chosen or min(chosen) < 0 or max(chosen) >= count:
        raise InputError(Phrase("error-marker-ids", {"dictionary": dictionary, "last": count - 1}))
    if not size_mm > 0:
        raise InputError(Phrase("error-marker-size", {"size_mm": size_mm}))
    corners = size_mm * _CORNER
    layouts: dict[int, dict[str, FloatArray]] = {
        int(i): dict(zip(CORNERS, corners.copy(), strict=True)) for i in chosen
    }
    return TargetSet(FAMILY, polarity, size_mm, 0.0, layouts, dictionary)


def marker_bits(dictionary: str, marker: int, border: int = BORDER_BITS) -> FloatArray:
    """The cells (n, n) of a marker with its black border, 0 black, 1 white."""
    found = marker_dictionary(dictionary)
    side = found.markerSize + 2 * border
    return (np.asarray(found.generateImageMarker(marker, side, borderBits=border)) > 127).astype(float)


def sticker_mm(target_set: TargetSet) -> float:
    """Side in mm of a sticker as printed; that of a marker has a blank edge as wide as one of its cells."""
    if target_set.dictionary is None:
        return target_set.size_mm
    cells = marker_dictionary(target_set.dictionary).markerSize + 2 * BORDER_BITS
    return target_set.size_mm * (1 + 2 / cells)
