"""What the study of accuracy collects: errors over their predictions, and whole runs beside those from the truth."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray


@dataclass(frozen=True)
class Normalised:
    """Errors over their predicted standard deviations: mean squares (runs, k) of k quantities, pooled as one."""

    squares: FloatArray

    @property
    def ratio(self) -> float:
        """Empirical over predicted standard deviation."""
        return float(np.sqrt(self.squares.mean()))

    @property
    def standard_error(self) -> float:
        """Of the ratio, from the scatter between runs."""
        by_run = self.squares.mean(axis=1)
        return float(by_run.std(ddof=1) / np.sqrt(len(by_run)) / (2 * self.ratio)) if len(by_run) > 1 else np.inf

    @property
    def extremes(self) -> tuple[float, float]:
        """Smallest and largest ratio of a single quantity."""
        single = np.sqrt(self.squares.mean(axis=0))
        return float(single.min()), float(single.max())


@dataclass(frozen=True)
class WholeRun:
    """A run through `calibrate` beside the one from the truth: observations that differ, costs, bars."""

    other_used: int
    cost_difference: float
    bar_difference_um: float
