"""Points from image points: rays intersected linearly, then the reprojection error minimised, many points at once."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray, blocks_of_groups, sum_by
from spherecal.geometry.camera import project, project_with_point_derivatives, undistort, undistort_views
from spherecal.geometry.rotation import cross
from spherecal.geometry.transform import PosedCameras

# Rays closer to parallel than this (0.02 to 0.03 px at f = 2300 to 3500 px, the noise of a good dot centre) carry no
# depth; it also keeps the normal matrices, whose condition grows with 1/angle^2, within double precision.
_LEAST_ANGLE_RAD = 1e-5
# Levenberg-Marquardt: from the rays' nearest point 3 to 5 steps suffice; wild points (mismatches, rays that meet behind
# a camera) are given up after 20 and keep the best place found.
_STEPS = 20
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-6, 1e-12, 1e6
# A step is the last when it promises less than this of v'Pv: 1e-6 of a point's standard deviation.
_LAST_DECREASE = 1e-12


@dataclass(frozen=True)
class Triangulation:
    """Points (m, 3) in the frame of the poses, NaN where fewer than two rays or only parallel ones meet.

    - `normal` (m, 3, 3) is the normal matrix J'PJ of each point.
    - `residual` (n, 2) px is predicted minus observed, NaN without a point.
    - `max_angle_rad` (m,) is the largest acute angle between two of the point's rays (lines; 0 .. pi/2).
    - `views` (m,) is the number of rays that took part.
    - `in_front` (m,) says whether the point is in front of all cameras that see it.
    """

    points: FloatArray
    normal: FloatArray
    residual: FloatArray
    max_angle_rad: FloatArray
    views: IntArray
    in_front: BoolArray

    @property
    def covariance(self) -> FloatArray:
        """Covariance (m, 3, 3) of the points for a unit-weight standard deviation of 1; NaN where there is no point."""
        found = np.isfinite(self.points[:, 0])
        return np.where(found[:, None, None], _inverse(self.normal), np.nan)


@dataclass(frozen=True)
class _Rows:
    """The observations that take part, with the cameras they belong to."""

    feature: IntArray
    camera: IntArray
    uv: FloatArray
    weight: FloatArray
    cameras: PosedCameras

    def select(self, keep: BoolArray) -> "_Rows":
        return _Rows(self.feature[keep], self.camera[keep], self.uv[keep], self.weight[keep], self.cameras)


def triangulate(
    feature: IntArray, camera: IntArray, uv: FloatArray, weight: FloatArray, n_features: int, cameras: PosedCameras
) -> Triangulation:
    """The points with the least weighted squared reprojection errors, in the frame of the cameras' poses.

    Rows (n,) say which point is seen by which camera at `uv` (n, 2) px; `weight` is 1/sigma^2, (n,) or (n, 2).
    Residuals are given for all rows. Points are worked on some at a time, since an observation takes 1 KB here.
    """
    weight = np.broadcast_to(weight if weight.ndim == 2 else weight[:, None], (len(uv), 2))
    empty, m = np.empty, n_features
    of_points = empty(m), empty(m, dtype=np.int64), empty(m, dtype=bool)
    out = Triangulation(empty((m, 3)), empty((m, 3, 3)), empty((len(uv), 2)), *of_points)
    for points, rows in _some_points(feature, n_features):
        views = _Rows(feature[rows] - points.start, camera[rows], uv[rows], weight[rows], cameras)
        part = _triangulated(views, points.stop - points.start)
        out.residual[rows] = part.residual
        for name in ("points", "normal", "max_angle_rad", "views", "in_front"):
            getattr(out, name)[points] = getattr(part, name)
    return out


def _some_points(feature: IntArray, n_features: int) -> Iterator[tuple[slice, IntArray]]:
    """Blocks of points and the rows that observe them, in their order but for the points'."""
    order = np.argsort(feature, kind="stable")
    start = np.searchsorted(feature[order], np.arange(n_features + 1))
    for first, last in blocks_of_groups(start):
        yield slice(first, last), order[start[first] : start[last]]


def _triangulated(rows: _Rows, n_features: int) -> Triangulation:
    """The same of all points at once."""
    feature, camera, cameras = rows.feature, rows.camera, rows.cameras
    ray, usable = _rays(camera, rows.uv, cameras)
    usable = usable & (rows.weight > 0).all(axis=1)
    views = np.bincount(feature[usable], minlength=n_features)
    angle = _largest_angle(feature[usable], ray[usable], n_features)
    possible = (views >= 2) & (angle >= _LEAST_ANGLE_RAD)

    take = usable & possible[feature]
    centre = cameras.centres
    along = ray[take]
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    normal = sum_by(feature[take], across, n_features)
    right = sum_by(feature[take], np.einsum("nij,nj->ni", across, centre[camera[take]]), n_features)
    start = np.einsum("mij,mj->mi", _inverse(normal), right)  # with the least squared distances to the rays
    points, normal = _minimise(rows.select(take), np.where(possible[:, None], start, np.nan))

    x_camera = np.einsum("nij,nj->ni", cameras.rotation[camera], points[feature]) + cameras.translation[camera]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        residual = project(x_camera, cameras.intrinsics[camera]) - rows.uv
    behind = np.bincount(feature[usable], ~(x_camera[usable, 2] > 0), n_features)
    return Triangulation(points, normal, residual, angle, views, possible & (behind == 0))


def ray_angles(
    feature: IntArray, camera: IntArray, uv: FloatArray, n_features: int, cameras: PosedCameras
) -> FloatArray:
    """The largest acute angle (m,) rad between two rays of each feature, as `triangulate` returns it."""
    angle = np.empty(n_features)
    for points, rows in _some_points(feature, n_features):
        ray, usable = _rays(camera[rows], uv[rows], cameras)
        own = feature[rows][usable] - points.start
        angle[points] = _largest_angle(own, ray[usable], points.stop - points.start)
    return angle


def _rays(camera: IntArray, uv: FloatArray, cameras: PosedCameras) -> tuple[FloatArray, BoolArray]:
    """Unit vectors (n, 3) of the image points' rays in the frame of the poses, and where there is one (n,)."""
    xy, usable = undistort(uv, cameras.intrinsics[camera])
    ray = np.einsum("nji,nj->ni", cameras.rotation[camera], np.column_stack([xy, np.ones(len(xy))]))
    return ray / np.linalg.norm(ray, axis=1, keepdims=True), usable


def _largest_angle(feature: IntArray, ray: FloatArray, n_features: int) -> FloatArray:
    """The largest acute angle between any two unit rays (n, 3) of each feature, (m,); 0 for a single ray."""
    ray = ray[np.argsort(feature, kind="stable")]
    count = np.bincount(feature, minlength=n_features)
    first = np.cumsum(count) - count
    sine = np.zeros(n_features)
    for rays in np.unique(count[count > 1]).tolist():
        own = np.flatnonzero(count == rays)
        of_each = ray[first[own][:, None] + np.arange(rays)]
        cosine = np.abs(of_each @ of_each.transpose(0, 2, 1)).reshape(len(own), -1)
        one, other = np.divmod(cosine.argmin(axis=1), rays)  # of which the sine is exact for small angles, too
        of_one, of_other = (np.take_along_axis(of_each, which[:, None, None], axis=1)[:, 0] for which in (one, other))
        sine[own] = np.linalg.norm(cross(of_one, of_other), axis=1)
    return np.arcsin(sine.clip(max=1.0))


def _minimise(rows: _Rows, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Levenberg-Marquardt for every point on its own; returns points (m, 3) and normal matrices (m, 3, 3).

    Only points that still move are worked on: most are done after three steps, a few wild ones take all.
    """
    points = points.copy()
    normal, gradient, cost = _normal_equations(rows, points)
    damping = np.full(len(points), _FIRST_DAMPING)
    moving = np.flatnonzero(np.isfinite(points[:, 0]))
    slot = np.full(len(points), -1)  # of each point among those that still move
    for _ in range(_STEPS):
        if not len(moving):
            break
        slot[:] = -1
        slot[moving] = np.arange(len(moving))
        rows = rows.select(slot[rows.feature] >= 0)
        damped = normal[moving] * (1 + damping[moving, None, None] * np.eye(3))
        step = -np.einsum("mij,mj->mi", _inverse(damped), gradient[moving])
        step[~np.isfinite(step).all(axis=1)] = 0.0
        trial, before = points[moving] + step, cost[moving]
        trial_normal, trial_gradient, trial_cost = _normal_equations(replace(rows, feature=slot[rows.feature]), trial)
        better = trial_cost < before
        won = moving[better]
        for value, new in ((points, trial), (normal, trial_normal), (gradient, trial_gradient), (cost, trial_cost)):
            value[won] = new[better]
        damping[moving] = np.where(better, (damping[moving] / 10).clip(min=_LEAST_DAMPING), damping[moving] * 100)
        promised = -np.einsum("mi,mi->m", gradient[moving], step)
        done = (promised < _LAST_DECREASE) & (better | (trial_cost <= cost[moving] * (1 + 1e-9)))
        moving = moving[~done & (damping[moving] < _MOST_DAMPING)]
    return points, normal


def _normal_equations(rows: _Rows, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """J'PJ (m, 3, 3), J'Pv (m, 3) and v'Pv (m,) at the given points."""
    m = len(points)
    rotation = rows.cameras.rotation[rows.camera]
    x_camera = np.einsum("nij,nj->ni", rotation, points[rows.feature]) + rows.cameras.translation[rows.camera]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        uv, by_camera_point = project_with_point_derivatives(x_camera, rows.cameras.intrinsics[rows.camera])
        jacobian = by_camera_point @ rotation
        residual = uv - rows.uv
        weighted = jacobian * rows.weight[:, :, None]
        normal = sum_by(rows.feature, np.swapaxes(weighted, 1, 2) @ jacobian, m)
        gradient = sum_by(rows.feature, np.einsum("nki,nk->ni", weighted, residual), m)
        cost = sum_by(rows.feature, (rows.weight * residual**2).sum(axis=1), m)
    return normal, gradient, np.where(np.isfinite(cost), cost, np.inf)


def _inverse(a: FloatArray) -> FloatArray:
    """Inverses of 3x3 matrices (m, 3, 3) by their adjugates; not finite, without an exception, where singular."""
    columns = np.stack([cross(a[:, 1], a[:, 2]), cross(a[:, 2], a[:, 0]), cross(a[:, 0], a[:, 1])], axis=2)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return columns / np.einsum("mi,mi->m", a[:, 0], columns[:, :, 0])[:, None, None]


# --- which views of a point agree ------------------------------------------------------------------------------------
#
# Least squares smears a wrong view's error over all views of its point; of a track of three with one wrong, all three
# then fail every gate. Here each pair of views proposes a point, and the one that most views confirm is taken (M.
# Fischler, R. Bolles, Random sample consensus, 1981; exhaustive, since tracks are short).

# Pairs tried of one point; 45 are all pairs of ten views, and of more views a wrong third leaves 20 good ones of them.
MOST_PAIRS = 45
_MOST_PREDICTED = 20_000  # image points that are predicted at a time


def agreeing_views(
    feature: IntArray, camera: IntArray, uv: FloatArray, gate_px: FloatArray, cameras: PosedCameras
) -> BoolArray:
    """Which rows (n,) belong to the largest set of their feature that agrees on one point in front of all its cameras.

    Among equal sets the one with the smaller errors wins. Of a feature with more than `MOST_PAIRS` pairs of views some
    pairs are tried, evenly chosen.
    """
    out = np.zeros(len(feature), dtype=bool)
    xy, usable = undistort_views(uv, camera, cameras.intrinsics)
    rows = np.flatnonzero(usable)
    rows = rows[np.argsort(feature[rows], kind="stable")]
    if not len(rows):
        return out
    rotation = cameras.rotation[camera[rows]]
    ray = np.einsum("nji,nj->ni", rotation, np.column_stack([xy[rows], np.ones(len(rows))]))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    centre = -np.einsum("nji,nj->ni", rotation, cameras.translation[camera[rows]])
    views = _Views(camera[rows], uv[rows], gate_px[rows], centre, ray, cameras)
    start = np.flatnonzero(np.diff(feature[rows], prepend=-1))
    count = np.diff(np.append(start, len(rows)))
    for some in np.unique(count[count >= 2]).tolist():  # points with equally many views at once
        member = start[count == some][:, None] + np.arange(some)  # (f, v) rows of `views`
        out[rows[member[_largest_set(member, views)]]] = True
    return out


@dataclass(frozen=True)
class _Views:
    """Views, sorted by point: camera, image point, gate, and the ray from the camera's centre."""

    camera: IntArray
    uv: FloatArray
    gate_px: FloatArray
    centre: FloatArray
    ray: FloatArray
    cameras: PosedCameras


def _largest_set(member: IntArray, of: _Views) -> BoolArray:
    """The largest agreeing set of each point, (f,v) bool, of points with v views each (member (f,v))."""
    views = member.shape[1]
    first, second = np.triu_indices(views, 1)
    if len(first) > MOST_PAIRS:
        some = np.linspace(0, len(first) - 1, MOST_PAIRS).astype(int)
        first, second = first[some], second[some]
    own, cameras = of.camera[member], of.cameras
    best = np.zeros(member.shape, dtype=bool)
    best_score = np.zeros(len(member))
    at_once = max(_MOST_PREDICTED // member.size, 1)  # long tracks are few of each length: loops of a pair took longer
    for begin in range(0, len(first), at_once):
        i, j = first[begin : begin + at_once], second[begin : begin + at_once]
        one, other = member[:, i].T, member[:, j].T  # (k,f): k pairs
        points = _midpoints(of.centre[one], of.ray[one], of.centre[other], of.ray[other])
        x = np.einsum("fvij,kfj->kfvi", cameras.rotation[own], points) + cameras.translation[own]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            lens = np.tile(cameras.intrinsics[own.reshape(-1)], (len(i), 1))
            flat = project(x.reshape(-1, 3), lens).reshape(*x.shape[:3], 2)
            error = np.linalg.norm(flat - of.uv[member], axis=3) / of.gate_px[member]
        fits = (error <= 1) & (x[..., 2] > 0)
        score = np.where(fits, 2.0 - np.where(fits, error, 0.0) ** 2 / views, 0.0).sum(axis=2)  # count before error
        pair, point = np.arange(len(i)), np.arange(len(member))
        score *= fits[pair, :, i] & fits[pair, :, j]
        top = score.argmax(axis=0)
        better = score[top, point] > best_score
        best[better], best_score[better] = fits[top, point][better], score[top, point][better]
    return best


def _midpoints(c1: FloatArray, d1: FloatArray, c2: FloatArray, d2: FloatArray) -> FloatArray:
    """The middles (...,3) of the shortest lines between pairs of rays; not finite where they are parallel."""
    between, cosine = c2 - c1, (d1 * d2).sum(axis=-1)
    a, b = (between * d1).sum(axis=-1), (between * d2).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = 1 - cosine**2
        s, t = (a - cosine * b) / determinant, (cosine * a - b) / determinant
    return (c1 + s[..., None] * d1 + c2 + t[..., None] * d2) / 2
