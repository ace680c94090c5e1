"""A board looked for in live images, as a `Detector` looks for coded targets."""

import numpy as np

from spherecal.base.arrays import IntArray
from spherecal.targets.blobs import GreyImage
from spherecal.targets.detection import Detections, DetectionSettings
from spherecal.targets.masks import masked
from spherecal_boards.board_images import find_board
from spherecal_boards.board_pattern import BoardPattern

_POINTS = ("centre",)
# Nominal, since the finders state none; what a board's points are off by is its print, alike for all (board_images).
_SIGMA_PX = 0.1


class BoardDetector:
    """Finds the points of one board in images: each a target of the point's row-major index with one dot, `centre`."""

    def __init__(self, pattern: BoardPattern) -> None:
        self._pattern = pattern

    def detect(self, image: GreyImage, settings: DetectionSettings | None = None) -> Detections:
        """The board's points in a grey image (h, w) of 8 or 16 bits; none where it is not seen. Blur: unknown (NaN)."""
        found = find_board(np.require(image, requirements=["C"]), self._pattern)
        if found is None:
            return _detections(np.empty(0, np.int64), np.empty((0, 2)))
        keep = ~masked(found.uv, settings.ignore if settings is not None else ())
        return _detections(found.index[keep], found.uv[keep])


def _detections(index: IntArray, uv: np.ndarray) -> Detections:
    unknown = np.full(len(index), np.nan)
    point, sigma = np.zeros(len(index), np.int64), np.full(uv.shape, _SIGMA_PX)
    return Detections(_POINTS, index, point, uv, sigma, index, unknown, unknown, unknown)
