"""The ball's shape from one adjustment, and its use in another: a ball profile.

The covariance of each dot is that of its place among all dots: no shift, turn, stretch or strain of them as a whole.
What else the dots' errors have in common is left out: the cameras' share, a third of a dot's own noise on rig A. What
the ball may be strained by where it is used is considered there (`space_strain`).
"""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.ball_model import ShapePrior, Stored
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.datum import moved_points
from spherecal.adjust.point_factors import PointFactors
from spherecal.adjust.space_strain import STRAINS
from spherecal.adjust.state import State
from spherecal.ball.rigid import Alignment, BallNetwork, RigidNetwork, fit_motion, share_shape
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.rig import BallShape
from spherecal.geometry.transform import Similarity

# Rows of the dots' shifts that are multiplied at a time: 1500 of up to 2,000 columns are 24 MB.
_CHUNK = 500
# A free network of two placements is bent by up to 0.5 % of the ball; of another ball dots are off by half its size.
OTHER_BALL = 0.03


def shape_cofactors(covariance: Covariance, points: FloatArray, dots: IntArray) -> FloatArray:
    """Cofactors (d,3,3) of some dots (d,) of the points (p,3) among themselves, in the network's unit squared."""
    assert isinstance(covariance, PointFactors)
    own, at = covariance.point_inverse[dots], points[dots]
    centroid = at.mean(axis=0)
    spread = float(np.sqrt(((at - centroid) ** 2).sum(axis=1).mean()))
    strains = np.einsum("kij,pj->pik", STRAINS, (at - centroid) / spread)
    motions = np.concatenate([moved_points(at, centroid, spread), strains], axis=2)
    flat = motions.reshape(len(dots) * 3, -1)
    # of all dots: nearly full, so that taking these dots' rows of it would copy 100 MB
    shifts = covariance.every_shift
    spread_out = np.zeros((len(covariance.point_inverse), *motions.shape[1:]))
    spread_out[dots] = motions
    gauge_rows = np.asarray(shifts.T @ spread_out.reshape(-1, motions.shape[2])).T
    noise = own @ motions
    gauge_cross = np.asarray(shifts @ (covariance.inverse @ gauge_rows.T)).reshape(spread_out.shape)[dots] + noise
    gauge_inner = gauge_rows @ covariance.inverse @ gauge_rows.T + np.einsum("pig,pih->gh", motions, noise)
    gauge_weights = motions @ np.linalg.inv(flat.T @ flat)
    cross = gauge_cross @ gauge_weights.transpose(0, 2, 1)
    out = own + gauge_weights @ gauge_inner @ gauge_weights.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1)
    for first in range(0, len(dots), _CHUNK):
        own_rows = (3 * dots[first : first + _CHUNK, None] + np.arange(3)).ravel()
        some = shifts[own_rows].toarray()
        product = (some @ covariance.inverse).reshape(-1, 3, some.shape[1])
        out[first : first + _CHUNK] += product @ some.reshape(product.shape).transpose(0, 2, 1)
    return out


@dataclass(frozen=True)
class Anchored:
    """A network based on a stored shape, in mm, and its start; `matched` (t,): placements whose ball has that shape.

    `common` (t,): dots of each that the shape knows.
    """

    rigid: RigidNetwork
    start: State
    matched: BoolArray
    common: IntArray


def anchored(
    ball: BallNetwork, state: State, shape: BallShape, names: tuple[str, ...], variance: float
) -> Anchored | None:
    """A free network with the stored shape in place of its ball; None where no placement shows that shape.

    `names`: of the features' points.
    """
    features, n_placements = ball.features, ball.n_placements
    number = {key: i for i, key in enumerate(zip(shape.target.tolist(), shape.point, strict=True))}
    pairs = zip(features.target.tolist(), (names[point] for point in features.point), strict=True)
    known = np.array([number.get(pair, -1) for pair in pairs], dtype=np.int64)
    motions: dict[int, Similarity] = {}
    common = np.zeros(n_placements, dtype=np.int64)
    for t in range(ball.n_ball):
        own = (features.placement == t) & (known >= 0) & np.isfinite(state.points[:, 0])
        common[t] = own.sum()
        there = shape.places_mm[known[own]]
        found = fit_motion(there, state.points[own], features.target[own], with_scale=True)
        if found is not None:  # and most dots are where the motion puts those of the shape
            off = np.linalg.norm(found.apply(there) - state.points[own], axis=1)
            size = found.scale * np.sqrt(((there - there.mean(axis=0)) ** 2).sum(axis=1).mean())
            if np.median(off) <= OTHER_BALL * size:
                motions[t] = found
    if not motions:
        return None
    unit = 1.0 / float(np.median([motion.scale for motion in motions.values()]))
    matched = np.isin(np.arange(n_placements), list(motions))
    turned, shifted = np.tile(np.eye(3), (n_placements, 1, 1)), np.zeros((n_placements, 3))
    for t, motion in motions.items():
        turned[t], shifted[t] = motion.rotation, motion.translation * unit
    root = np.where(matched, -1, np.arange(n_placements))  # the shape itself
    alignment = Alignment(root, turned, shifted, np.zeros((n_placements, n_placements), dtype=np.int64))
    rigid, start = share_shape(ball.network, features, state.scaled(unit), alignment)
    on_ball = matched[features.placement]
    of_shape, is_anchored = np.full(rigid.network.n_features, -1), np.zeros(rigid.network.n_features, dtype=bool)
    of_shape[rigid.places.point[on_ball]], is_anchored[rigid.places.point[on_ball]] = known[on_ball], True
    there = of_shape >= 0
    places, information = np.full((len(there), 3), np.nan), np.zeros((len(there), 3, 3))
    places[there] = shape.places_mm[of_shape[there]]
    information[there] = variance * np.linalg.inv(shape.covariance_mm2[of_shape[there]])
    own = rigid.network.ball
    stored = Stored(own.placement, own.free_placement, shape=ShapePrior(places, information))
    start = replace(start, points=places.copy(), anchored=is_anchored)
    return Anchored(replace(rigid, network=replace(rigid.network, ball=stored)), start, matched, common)
