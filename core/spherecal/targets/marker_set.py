"""ArUco and AprilTag markers as targets: which there are, and where their corners are."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.targets.target_set import Polarity, TargetSet

if TYPE_CHECKING:  # half a second, which a window that shows a target set does not wait for
    import cv2

FAMILY = "aruco"
# As OpenCV orders them: clockwise from the top left of the marker as generateImageMarker draws it.
CORNERS: tuple[str, ...] = ("0", "1", "2", "3")
_CORNER = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
BORDER_BITS = 1


def dictionary_names() -> tuple[str, ...]:
    """The names of OpenCV's dictionaries, such as DICT_4X4_250 and DICT_APRILTAG_36h11."""
    import cv2

    return tuple(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))


def marker_dictionary(name: str) -> "cv2.aruco.Dictionary":
    """OpenCV's dictionary of this name."""
    import cv2

    if name not in dictionary_names():
        raise InputError(Phrase("error-dictionary", {"name": name[:60], "names": ", ".join(dictionary_names())}))
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


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
