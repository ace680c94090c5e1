"""A target set: the layout of every coded target, as targets.json describes it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray

Polarity = Literal["light-on-dark", "dark-on-light"]
_SAME_MM = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class TargetSet(ByValue):
    """Targets of one family; `layouts[id][dot]` is the dot's place (2,) in mm on the flat sticker.

    Origin at the sticker's centre, x right, y down as printed (docs/conventions.md). `dictionary` is OpenCV's name of
    the dictionary where targets are ArUco or AprilTag markers (marker_set.py). Then `size_mm` is the side of the black
    square, dots are its corners and `dot_diameter_mm` is 0.
    """

    family: str
    polarity: Polarity
    size_mm: float
    dot_diameter_mm: float
    layouts: dict[int, dict[str, FloatArray]]
    dictionary: str | None = None

    def widest(
        self, targets: Collection[int] | None = None, dots: Collection[str] | None = None
    ) -> tuple[str, str, float] | None:
        """The two dots farthest apart of those that targets have at the same distance (mm); None without any.

        Of all targets and dots, or of some.
        """
        layouts = [dots_of for target, dots_of in self.layouts.items() if targets is None or target in targets]
        shared = set.intersection(*map(set, layouts)) if layouts else set()
        found: tuple[str, str, float] | None = None
        for first, second in combinations(sorted(shared if dots is None else shared & set(dots)), 2):
            lengths = [float(np.linalg.norm(np.subtract(layout[first], layout[second]))) for layout in layouts]
            if np.ptp(lengths) < _SAME_MM and (found is None or lengths[0] > found[2] + _SAME_MM):
                found = first, second, lengths[0]
        return found

    def places(self, target: int, dots: Sequence[str]) -> FloatArray:
        """Places (k, 2) in mm on the flat sticker of some dots of one target.

        Parameters
        ----------
        target
            Id of the target.
        dots
            Names of the dots.

        Raises
        ------
        KeyError
            Where the set has no such target, or the target no such dot.
        """
        layout = self.layouts[target]
        return np.array([layout[dot] for dot in dots], dtype=float).reshape(-1, 2)
