"""Names beside marks so that they do not cover each other."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text

from spherecal.base.arrays import FloatArray
from spherecal_documents.report.sheet import MM_PER_PT, text_width

_DIRECTIONS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]], dtype=float)


_APART_MM = 0.3  # between names


class Labels:
    """Puts names into axes whose unit is `mm_per_unit` on paper; names avoid each other and the places given.

    Places and bounds are in the axes' unit.
    """

    def __init__(self, axes: Axes, mm_per_unit: float, obstacles: FloatArray, bounds: FloatArray) -> None:
        self._axes, self._mm = axes, mm_per_unit
        self._obstacles = obstacles * mm_per_unit
        self._taken: list[FloatArray] = []  # left, low, right, high in mm
        self._bounds = bounds.ravel() * mm_per_unit
        self._flip = np.ones(2)
        self._ground: dict[str, Any] | None = {"facecolor": "white", "alpha": 0.65, "edgecolor": "none", "pad": 0.4}

    def over_image(self) -> None:
        """Take y as given to be the negative of the axes' y, since v goes down; no light ground behind the names."""
        self._flip = np.array([1.0, -1.0])
        self._ground = None

    def put(
        self,
        place: FloatArray,
        text: str,
        outwards: FloatArray,
        size_pt: float,
        colour: str,
        bold: bool = False,
        gap_mm: float = 1.2,
        always: bool = True,
    ) -> None:
        """A name near a place: on the side of `outwards` if there is room, otherwise where it covers least."""
        half = np.array([text_width(text, size_pt, bold), size_pt * MM_PER_PT * 0.9]) / 2
        best, best_cost = place * self._mm, np.inf
        length = float(np.linalg.norm(outwards))
        wanted = outwards / length if length > 0 else np.array([0.0, 1.0])
        reached = (np.abs(self._obstacles - best) < 2 * half + 3 * gap_mm + 1.0).all(axis=1)
        near = self._obstacles[reached]
        for reach in (1.0, 2.2):
            for direction in _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1)[:, None]:
                centre = place * self._mm + direction * (half + gap_mm * reach)
                cost = self._cost(centre, half, near) + 0.6 * (1 - float(direction @ wanted)) + 0.5 * (reach - 1)
                if cost < best_cost - 1e-9:
                    best, best_cost = centre, cost
        if not always and self._covers(best, half):
            return
        self._taken.append(np.concatenate([best - half, best + half]))
        x, y = best / self._mm * self._flip
        self._axes.add_artist(
            Text(
                x,
                y,
                text,
                fontsize=size_pt,
                color=colour,
                fontweight="bold" if bold else "normal",
                zorder=9,
                horizontalalignment="center",
                verticalalignment="center",
                parse_math=False,
                transform=self._axes.transData,
                bbox=self._ground,
            )
        )

    def _covers(self, centre: FloatArray, half: FloatArray) -> bool:
        """Whether a name there would cover another."""
        taken = np.array(self._taken).reshape(-1, 4)
        return bool(((centre + half > taken[:, :2]) & (centre - half < taken[:, 2:])).all(axis=1).any())

    def _cost(self, centre: FloatArray, half: FloatArray, obstacles: FloatArray) -> float:
        """How much a name there would cover, in areas of the name."""
        low, high = centre - half, centre + half
        cost = 0.0
        if self._taken:
            taken = np.array(self._taken)
            overlap = np.minimum(high, taken[:, 2:]) - np.maximum(low, taken[:, :2])
            areas = np.prod(np.maximum(overlap + _APART_MM, 0), axis=1)
            cost += float((areas > 0).sum()) + 4 * float(areas.sum() / np.prod(2 * half))
        if len(obstacles):
            cost += 0.35 * float(np.sqrt(((np.abs(obstacles - centre) < half + 0.4).all(axis=1)).sum()))
        outside = np.maximum(self._bounds[:2] - low, 0).sum() + np.maximum(high - self._bounds[2:], 0).sum()
        return cost + float(outside)
