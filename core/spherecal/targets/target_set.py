"""A target set: the layout of every coded target, as targets.json describes it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray

Polarity = Literal["light-on-dark", "dark-on-light"]


@dataclass(frozen=True, eq=False, repr=False)
class TargetSet(ByValue):
    """Targets of one family; `layouts[id][dot]` is the dot's place (2,) in mm on the flat sticker.

    Origin at the sticker's centre, x right, y down as printed (docs/conventions.md). `dictionary` is OpenCV's name of
    the dictionary where targets are ArUco or AprilTag markers (marker_set.py): then `size_mm` is the side of the black
    square, dots are its corners and `dot_diameter_mm` is 0.
    """

    family: str
    polarity: Polarity
    size_mm: float
    dot_diameter_mm: float
    layouts: dict[int, dict[str, FloatArray]]
    dictionary: str | None = None

    def places(self, target: int, dots: Sequence[str]) -> FloatArray:
        """Places (k, 2) in mm on the flat sticker of the named dots of one target; KeyError where it has no such."""
        layout = self.layouts[target]
        return np.array([layout[dot] for dot in dots], dtype=float).reshape(-1, 2)
