"""Detections against the truth of rendered images: errors dot by dot, targets found, missed and wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.targets.detection import Detections
from spherecal_sim.dot_truth import DotTruth

from .detection_scenes import targets_in

FAR_PX = 3.0  # a target whose dots lie that far from the truth's (median) carries a wrong id
BEST = 0.98


@dataclass(frozen=True)
class Score:
    """One image. Dots, m rows: `error` (m, 2) px to the rim's centre, `sigma` (m, 2), `bound` (m,), `dot_view` (m,).

    Targets all of whose dots show, k rows: `view`, `gap` (k,) as of `TargetTruth`, `found` (k,). `wrong` counts targets
    with a wrong id, `misplaced` dots of right targets that are farther off than half their length and 1 px.
    """

    error: FloatArray
    sigma: FloatArray
    bound: FloatArray
    dot_view: FloatArray
    view: FloatArray
    gap: FloatArray
    found: BoolArray
    detected: int
    wrong: int
    misplaced: int


def score(found: Detections, dots: DotTruth, points: Sequence[str]) -> Score:
    """Compare one image's detections with its truth; `points` names the truth's dots."""
    row_of = {(int(t), points[p]): i for i, (t, p) in enumerate(zip(dots.target, dots.point, strict=True))}
    rows = np.array(
        [row_of.get((int(t), found.points[p]), -1) for t, p in zip(found.target, found.point, strict=True)], dtype=int
    )
    offset = np.where((rows >= 0)[:, None], found.uv - dots.uv_rim[rows], np.inf)
    distance = np.hypot(offset[:, 0], offset[:, 1])
    wrong = [t for t in found.target_ids if not np.median(distance[found.target == t]) <= FAR_PX]
    right = ~np.isin(found.target, wrong) & (rows >= 0)
    at = rows[right]
    misplaced = int((distance[right] > dots.axes_px[at, 0] / 2 + 1.0).sum())
    misplaced += int((~np.isin(found.target, wrong) & (rows < 0)).sum())
    truth = targets_in(dots)
    shown = truth.fully_visible
    return Score(
        offset[right],
        found.sigma_uv[right],
        dots.bound_px[at],
        dots.view_deg[at],
        truth.view_deg[shown],
        truth.gap_px[shown],
        np.isin(truth.ids[shown], found.target_ids) & ~np.isin(truth.ids[shown], wrong),
        len(found.target_ids),
        len(wrong),
        misplaced,
    )


def rms_of_best(distances: FloatArray) -> float:
    """Root mean square of the best 98 %; NaN of none."""
    if not len(distances):
        return np.nan
    best = np.sort(distances)[: max(int(BEST * len(distances)), 1)]
    return float(np.sqrt((best**2).mean()))


@dataclass(frozen=True)
class Accuracy:
    """Dots of one band of view angles: rms of the best 98 % and its standard error, bound, normalised errors' spread.

    `spread` is the standard deviation of error over stated sigma of all dots, `spread_best` of those of the best 98 %,
    whose normal value is 0.96. `mean` is the mean error (u, v), px.
    """

    count: int
    rms: float
    rms_error: float
    bound: float
    spread: float
    spread_error: float
    spread_best: float
    mean: FloatArray

    @property
    def ratio(self) -> float:
        """Rms over the bound."""
        return self.rms / self.bound

    @property
    def ratio_error(self) -> float:
        """Its standard error."""
        return self.rms_error / self.bound


def accuracy(scores: Sequence[Score], low: float, high: float) -> Accuracy:
    """Dots seen at `low` to `high` degrees, over all images; standard errors by leaving out one image at a time."""
    parts = [_in_band(s, low, high) for s in scores]
    parts = [part for part in parts if len(part[0])]
    nan = np.nan
    if not parts:
        return Accuracy(0, nan, nan, nan, nan, nan, nan, np.full(2, nan))
    error, sigma, bound = (np.concatenate([part[k] for part in parts]) for k in range(3))
    distance = np.hypot(error[:, 0], error[:, 1])
    best = distance <= np.quantile(distance, BEST)
    known = np.isfinite(bound)
    return Accuracy(
        len(error),
        rms_of_best(distance),
        _jackknife(parts, lambda e, _: rms_of_best(np.hypot(e[:, 0], e[:, 1]))),
        float(np.sqrt((bound[known] ** 2).mean())) if known.any() else np.nan,
        _spread(error, sigma),
        _jackknife(parts, _spread),
        _spread(error[best], sigma[best]),
        error[best].mean(axis=0),
    )


def _in_band(s: Score, low: float, high: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    band = (s.dot_view >= low) & (s.dot_view < high)
    return s.error[band], s.sigma[band], s.bound[band]


def _spread(error: FloatArray, sigma: FloatArray) -> float:
    return float(np.sqrt(((error / sigma) ** 2).mean()))


def _jackknife(
    parts: list[tuple[FloatArray, FloatArray, FloatArray]], figure: Callable[[FloatArray, FloatArray], float]
) -> float:
    """Standard error of a figure of (error, sigma) pooled over images."""
    n = len(parts)
    if n < 2:
        return np.nan
    without = [
        figure(*(np.concatenate([p[k] for j, p in enumerate(parts) if j != i]) for k in range(2))) for i in range(n)
    ]
    return float(np.sqrt((n - 1) / n * ((np.array(without) - np.mean(without)) ** 2).sum()))


@dataclass(frozen=True)
class Recall:
    """Found of all."""

    found: int
    count: int

    @property
    def rate(self) -> float:
        """Part found, NaN of none."""
        return self.found / self.count if self.count else np.nan

    @property
    def error(self) -> float:
        """Standard error; of all or none found that of one more or less (rule of succession)."""
        p = (self.found + 1) / (self.count + 2)
        return float(np.sqrt(p * (1 - p) / max(self.count, 1)))

    def __str__(self) -> str:
        return f"{self.found}/{self.count}"


def recall(scores: Sequence[Score], low: float, high: float, by_gap: bool = False) -> Recall:
    """Targets fully visible whose most oblique dot is seen at `low` to `high` degrees (or smallest gap in px)."""
    found = count = 0
    for s in scores:
        value = s.gap if by_gap else s.view
        band = (value >= low) & (value < high)
        found += int(s.found[band].sum())
        count += int(band.sum())
    return Recall(found, count)


def wrong_ids(scores: Sequence[Score]) -> int:
    """Targets with a wrong id in all images."""
    return sum(s.wrong for s in scores)
