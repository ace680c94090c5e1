"""Views of one set that contradict the others: found and left out, for all points at once.

With a knocked camera hundreds of points are doubtful, at 1 to 2 ms each by `outlying_views`. Here the cost without a
view is a deletion's closed form, v'Pv - v_i' (I - H_ii)^-1 v_i: hat matrix H, whitened residuals v.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.camera import project_with_point_derivatives
from spherecal.geometry.triangulation import Triangulation
from spherecal_verify.outlying_views import CheckedPoints, Views, robust_noise, weighted_noise

# As outlying_views: a good view exceeds 4.5 standard deviations once in 25 000, none within 0.15 px is gross.
_GATE_SIGMAS, _GATE_PX = 4.5, 0.15
_CHANCE = 1e-5  # that the rest of a point's views, all good, is taken for contradicting
_ROUNDS = 4  # views left out of one point, one a round


@dataclass(frozen=True)
class _Suspects:
    """Views (rows) of the doubtful points, sorted by point; whitened residuals' cost without each of them."""

    rows: IntArray
    feature: IntArray
    cost_without: FloatArray
    views: IntArray  # of each row's point


def reject_views(views: Views, expected_noise: float) -> CheckedPoints:
    """The points without views that contradict: with four or more the worst one, with three only where clear."""
    kept = np.ones(len(views.uv), dtype=bool)
    given_up = np.zeros(views.n_features, dtype=bool)
    points = views.triangulate(kept)
    noise = robust_noise(views, points, expected_noise)
    sigma = np.maximum(noise * views.sigma.max(axis=1), _GATE_PX / _GATE_SIGMAS)
    for _ in range(_ROUNDS):
        doubtful = _doubtful(views, points, kept, sigma) & ~given_up
        if not doubtful.any():
            break
        found = _without_each(views, points, kept & doubtful[views.feature], sigma)
        order = np.lexsort((found.cost_without, found.feature))
        feature, cost, count = found.feature[order], found.cost_without[order], found.views[order]
        first = np.flatnonzero(np.diff(feature, prepend=-1))
        freedom = np.maximum(2 * (count[first] - 1) - 3, 1)
        limit = chdtri(freedom, _CHANCE)
        agrees = cost[first] <= limit
        second = np.minimum(first + 1, len(cost) - 1)
        rival = (cost[second] <= limit) & (feature[second] == feature[first])
        enough = (count[first] > 3) | ((count[first] == 3) & agrees & ~rival)
        wrong, hopeless = found.rows[order[first[enough]]], feature[first[~enough]]
        kept[wrong] = False
        given_up[hopeless] = True
        points = views.triangulate(kept)
    else:
        given_up |= _doubtful(views, points, kept, sigma)
    good = kept & ~given_up[views.feature] & np.isfinite(points.residual[:, 0])
    return CheckedPoints(views, points, good, given_up, weighted_noise(views, points, good, expected_noise))


def _doubtful(views: Views, points: Triangulation, kept: BoolArray, sigma: FloatArray) -> BoolArray:
    """Points (m,) with a gross residual."""
    with np.errstate(invalid="ignore"):
        gross = kept & (np.linalg.norm(points.residual, axis=1) > _GATE_SIGMAS * sigma)
    doubtful = np.zeros(views.n_features, dtype=bool)
    doubtful[views.feature[gross]] = True
    return doubtful


def _without_each(views: Views, points: Triangulation, take: BoolArray, sigma: FloatArray) -> _Suspects:
    rows = np.flatnonzero(take & np.isfinite(points.residual[:, 0]))
    rows = rows[np.argsort(views.feature[rows], kind="stable")]
    feature, camera = views.feature[rows], views.camera[rows]
    x = np.einsum("nij,nj->ni", views.rotation[camera], points.points[feature]) + views.translation[camera]
    _, by_x = project_with_point_derivatives(x, views.intrinsics[camera])
    white = (by_x @ views.rotation[camera]) / sigma[rows, None, None]
    v = points.residual[rows] / sigma[rows, None]
    normal = np.zeros((views.n_features, 3, 3))
    np.add.at(normal, feature, np.swapaxes(white, 1, 2) @ white)
    cofactor = np.linalg.pinv(normal[feature])
    rest = np.eye(2) - white @ cofactor @ np.swapaxes(white, 1, 2)
    # of two views the rest is singular along their common plane, where nothing is redundant
    gain = np.einsum("ni,nij,nj->n", v, np.linalg.pinv(rest, rcond=1e-9), v)
    cost = np.bincount(feature, (v**2).sum(axis=1), views.n_features)
    count = np.bincount(feature, minlength=views.n_features)
    return _Suspects(rows, feature, cost[feature] - gain, count[feature])
