"""The known ball seen again: whether it has the size and shape that it had at the calibration."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray
from spherecal.data.observations import Features, Observations
from spherecal.files.write_result import POINT_COLUMNS
from spherecal.geometry.transform import Similarity, fit_similarity
from spherecal.verify.uncertainty import PointErrors, calibration_variance
from spherecal_rigs.result_table import read_csv

LEAST_DOTS = 12
# A sticker that was replaced is off by millimetres, the reconstruction by hundredths.
_GATE_SIGMAS, _ROUNDS = 4.5, 3


@dataclass(frozen=True, eq=False, repr=False)
class BallDots(ByValue):
    """The dots of the calibration: by placement a table from (target, point name) to the place (3,) in mm."""

    placements: dict[str, dict[tuple[int, str], FloatArray]]


@dataclass(frozen=True)
class BallCheck:
    """Dots in common, size against the calibration (ppm) with its sd, shape left after it, dots that moved."""

    placement: str
    dots: int
    scale_ppm: float
    scale_sd_ppm: float
    shape_rms_mm: float
    changed: int

    @property
    def differs(self) -> bool:
        """Whether the size differs by more than chance (3.5 standard deviations, once in 2000)."""
        return abs(self.scale_ppm) > 3.5 * self.scale_sd_ppm


def read_known_ball(path: Path) -> BallDots | None:
    """The ball's dots from a points.csv; None if there is no such file."""
    if not path.is_file():
        return None
    table = read_csv(path, POINT_COLUMNS)
    places = np.column_stack([table.numbers(f"{axis}_mm") for axis in "xyz"])
    found: dict[str, dict[tuple[int, str], FloatArray]] = {}
    keys = zip(table.names("placement"), table.whole_numbers("target").tolist(), table.names("point"), strict=True)
    for (placement, target, point), place in zip(keys, places, strict=True):
        found.setdefault(placement, {})[target, point] = place
    return BallDots(found)


def check_ball(
    known: BallDots, placement: int, o: Observations, features: Features, errors: PointErrors
) -> BallCheck | None:
    """The ball at a placement against the calibration's that shares most dots; None below 12 in common or in place."""
    checked = errors.checked
    usable = np.isfinite(checked.points.points[:, 0]) & checked.points.in_front & ~checked.contradicting
    rows = np.flatnonzero(usable & (features.placement == placement))
    names = [(int(features.target[i]), o.points[features.point[i]]) for i in rows]
    best: dict[tuple[int, str], FloatArray] = max(
        known.placements.values(), key=lambda dots: sum(name in dots for name in names), default={}
    )
    common = [k for k, name in enumerate(names) if name in best]
    if len(common) < LEAST_DOTS:
        return None
    rows = rows[common]
    before = np.array([best[names[k]] for k in common])
    now = checked.points.points[rows]
    noise = np.sqrt(np.trace(errors.covariance[rows], axis1=1, axis2=2) / 3)
    keep = np.ones(len(rows), dtype=bool)
    fit, rest, ratio = _fit(before, now, noise, keep)
    for _ in range(_ROUNDS):
        keep = rest <= _GATE_SIGMAS * ratio * noise
        if keep.sum() < LEAST_DOTS:
            return None
        fit, rest, ratio = _fit(before, now, noise, keep)
    sd = _scale_sd(rows[keep], now[keep], errors, ratio)
    return BallCheck(
        o.placements[placement],
        int(keep.sum()),
        1e6 * (fit.scale - 1),
        1e6 * sd,
        float(np.sqrt((rest[keep] ** 2).mean())),
        int((~keep).sum()),
    )


def _fit(
    before: FloatArray, now: FloatArray, noise: FloatArray, keep: BoolArray
) -> tuple[Similarity, FloatArray, float]:
    """The similarity, the residual of each dot (n,) mm, and the scatter in units of the noise, at least 1."""
    fit = fit_similarity(before[keep], now[keep])
    rest = np.linalg.norm(now - (fit.scale * before @ fit.rotation.T + fit.translation), axis=1)
    return fit, rest, max(float(np.median(rest / noise)) / 1.538, 1.0)  # the median of a chi of three degrees


def _scale_sd(rows: IntArray, now: FloatArray, errors: PointErrors, ratio: float) -> float:
    """The size's standard uncertainty: noise of both measurements, and the cameras' covariance where not in common."""
    centred = now - now.mean(axis=0)
    by_point = centred / (centred**2).sum()  # d(scale) = sum of by_point . dx
    noise = float(np.einsum("ki,kij,kj->", by_point, errors.covariance[rows], by_point))
    return float(np.sqrt(2 * ratio**2 * noise + calibration_variance(rows, by_point, errors)))
