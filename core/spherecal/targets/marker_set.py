"""ArUco and AprilTag markers: which there are, and how their corners are named."""

from typing import TYPE_CHECKING

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase

if TYPE_CHECKING:  # half a second, which a window that shows a target set does not wait for
    import cv2

# As OpenCV orders them: clockwise from the top left of the marker as generateImageMarker draws it.
CORNERS: tuple[str, ...] = ("0", "1", "2", "3")
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
