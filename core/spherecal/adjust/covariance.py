"""Covariance of an adjusted network in the free-network datum.

The observations leave position, orientation and size of the whole open. The datum used here is the inner constraint on
the points: no shift, turn or stretch of the points as a whole, so their covariance has the least trace. It is reached
from any generalised inverse of the reduced normal matrix by an S-transformation (W. Baarda, S-transformations and
criterion matrices, 1973).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spherecal.adjust.levenberg import Engine, load_engine, normal_equations, one_blas_thread
from spherecal.adjust.problem import POSE, Problem, State, symmetric
from spherecal.arrays import FloatArray
from spherecal.geometry.rotation import cross_matrix


@dataclass(frozen=True)
class Covariance:
    """Cofactors (covariances for a standard deviation of unit weight of 1) of an adjusted network.

    `cameras` (c,w,w): pose and intrinsics of each camera in the problem's columns; `points` (p,3,3), NaN where a point
    takes no part. `datum_free` says that seven (six) parameters are fixed by the datum alone. `functional` gives the
    cofactor of a linear function of all points.
    """

    cameras: FloatArray
    points: FloatArray
    condition: float
    _parts: "_Parts"

    @property
    def point_noise(self) -> FloatArray:
        """The part of the points' cofactors that is their own image noise, V^-1 (p,3,3), without the cameras' share."""
        return self._parts.point_inverse

    def functional(self, gradient: FloatArray) -> float:
        """Cofactor of sum(gradient_p . x_p), gradient (p,3), with all correlations."""
        parts = self._parts
        held = np.einsum("pi,pig->g", gradient, parts.gauge_points)
        left = held @ parts.moments  # how much the datum takes back
        by_camera = parts.point_columns_times(gradient) - left @ parts.pull
        by_noise = gradient - parts.gauge_points @ left
        noise = np.einsum("pi,pij,pj->", by_noise, parts.point_inverse, by_noise)
        return float(by_camera @ parts.inverse @ by_camera + noise)


@dataclass(frozen=True)
class _Parts:
    """Pieces of the S-transformation; e expanded columns, g datum parameters.

    `inverse` (e,e): a generalised inverse of the reduced matrix; `by_camera` (n,3,w): shift of each observation's point
    by its camera's parameters (minus V^-1 W'); `gauge_points` (p,3,g), `gauge_cameras` (e,g): the datum's free motions;
    `moments` = (sum G'G)^-1 (g,g); `pull` (g,e) = sum G' K.
    """

    problem: Problem
    inverse: FloatArray
    by_camera: FloatArray
    point_inverse: FloatArray
    gauge_points: FloatArray
    gauge_cameras: FloatArray
    moments: FloatArray
    pull: FloatArray

    def point_columns_times(self, gradient: FloatArray) -> FloatArray:
        """sum over points of gradient_p K_p, (e,)."""
        problem, width = self.problem, self.by_camera.shape[2]
        rows = np.einsum("ni,niw->nw", gradient[problem.point], self.by_camera)
        total = np.zeros((problem.n_cameras, width))
        np.add.at(total, problem.camera, rows)
        return np.concatenate([total.ravel(), gradient[problem.kept_points].ravel()])

    @cached_property
    def datum_noise(self) -> FloatArray:
        """sum G' V^-1 G (g,g)."""
        return np.einsum("pig,pij,pjh->gh", self.gauge_points, self.point_inverse, self.gauge_points)


def covariance(problem: Problem, state: State, engine: Engine) -> Covariance | None:
    """Cofactors of cameras and points at the minimum (free form); None where the network is singular."""
    if problem.placement is not None:
        raise ValueError("covariance() is for the free form")
    if not len(problem.uv):
        return None
    with one_blas_thread():
        try:
            parts, condition = _parts(problem, state, engine)
        except (LinAlgError, np.linalg.LinAlgError):
            return None
        return Covariance(_camera_cofactors(parts), _point_cofactors(parts), condition, parts)


def _parts(problem: Problem, state: State, engine_name: Engine) -> tuple[_Parts, float]:
    engine = load_engine(engine_name)
    linear = engine.linearise(problem, state, None)
    normal = normal_equations(problem, state, engine, linear, 0.0)
    if not (np.isfinite(normal.gradient).all() and (normal.matrix.diagonal() > 0).all()):
        raise LinAlgError  # as with a point whose rays are parallel to the last bit
    gauge_cameras, gauge_points = datum_motions(problem, state)
    layout = problem.layout
    reduced_gauge = np.zeros((layout.size, gauge_cameras.shape[1]))
    used = layout.column >= 0
    reduced_gauge[layout.column[used]] = gauge_cameras[used]
    inverse, condition = _generalised_inverse(symmetric(normal.matrix), reduced_gauge)
    expanded = layout.expand_rows(layout.expand_rows(inverse).T)

    point_inverse = normal.reduced.point_inverse
    coupling = np.einsum("nji,njw->niw", linear.by_point, linear.by_camera)
    is_kept = np.zeros(problem.n_points, dtype=bool)
    is_kept[problem.kept_points] = True
    by_camera = -point_inverse[problem.point] @ coupling
    by_camera[is_kept[problem.point]] = 0.0

    moments = (
        np.linalg.inv(np.einsum("pig,pih->gh", gauge_points, gauge_points)) if gauge_points.size else np.zeros((0, 0))
    )
    parts = _Parts(problem, expanded, by_camera, point_inverse, gauge_points, gauge_cameras, moments, np.zeros((0, 0)))
    pull = [parts.point_columns_times(gauge_points[:, :, g]) for g in range(gauge_points.shape[2])]
    pull_matrix = np.array(pull).reshape(gauge_points.shape[2], layout.expanded)
    return (
        _Parts(problem, expanded, by_camera, point_inverse, gauge_points, gauge_cameras, moments, pull_matrix),
        condition,
    )


def datum_motions(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """The motions that no observation sees: of cameras (e,g) and of points (p,3,g).

    Three shifts, three turns about the points' centroid and, where no length is known, one stretch. One locked camera
    leaves the stretch about its centre, two or more leave nothing.
    """
    locked = np.flatnonzero((np.bincount(problem.camera, minlength=problem.n_cameras) > 0) & ~problem.free_pose)
    takes_part = np.diff(problem.point_start) > 0
    centroid = state.points[takes_part].mean(axis=0)
    if len(locked):
        centroid = -state.rotation[locked[0]].T @ state.translation[locked[0]]
    offset = state.points - centroid
    spread = np.sqrt((offset[takes_part] ** 2).sum(axis=1).mean())
    points = np.zeros((problem.n_points, 3, 7))
    points[:, :, :3] = np.eye(3)
    points[:, :, 3:6] = -cross_matrix(offset) / spread
    # a camera keeps its view: x_camera stays as it is, or is stretched with the points
    cameras = np.zeros((problem.n_cameras, POSE + len(problem.intrinsic_columns), 7))
    rotation = state.rotation
    to_centroid = np.einsum("cij,j->ci", rotation, centroid) + state.translation
    cameras[:, 3:6, :3] = -rotation
    cameras[:, :3, 3:6] = -rotation / spread
    cameras[:, 3:6, 3:6] = -np.einsum("cij,cjk->cik", cross_matrix(to_centroid), rotation) / spread
    points[:, :, 6] = offset / spread
    cameras[:, 3:6, 6] = to_centroid / spread
    points[~takes_part] = 0.0
    motions = np.vstack([cameras.reshape(-1, 7), points[problem.kept_points].reshape(-1, 7)])
    open_ones = slice(6 if len(locked) else 0, 7 if problem.lengths is None and len(locked) < 2 else 6)
    return motions[:, open_ones], points[:, :, open_ones]


def _generalised_inverse(matrix: FloatArray, gauge: FloatArray) -> tuple[FloatArray, float]:
    """A generalised inverse of a matrix whose null space is spanned by `gauge` (d,g), and its condition number."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    scaled = matrix * scale[:, None] * scale
    null = np.linalg.qr(gauge / scale[:, None])[0]
    factor = cho_factor(scaled + null @ null.T)
    inverse = cho_solve(factor, np.eye(len(matrix))) - null @ null.T
    condition = np.linalg.norm(scaled, 1) * np.linalg.norm(inverse, 1)
    return inverse * scale[:, None] * scale, float(condition)


def _camera_cofactors(parts: _Parts) -> FloatArray:
    """(c,w,w) of B C B' + G M N M G', B = 1 - G M A, block by block."""
    problem, width = parts.problem, parts.by_camera.shape[2]
    held = parts.gauge_cameras @ parts.moments  # G M (e,g)
    carried = parts.inverse @ parts.pull.T  # C A' (e,g)
    middle = parts.pull @ carried + parts.datum_noise  # A C A' + N
    out = np.empty((problem.n_cameras, width, width))
    for c in range(problem.n_cameras):
        own = slice(c * width, (c + 1) * width)
        mixed = carried[own] @ held[own].T
        out[c] = parts.inverse[own, own] - mixed - mixed.T + held[own] @ middle @ held[own].T
    return out


def _point_cofactors(parts: _Parts) -> FloatArray:
    """(p,3,3) of K C K' + V^-1 with K and V^-1 transformed to the datum; NaN where a point takes no part."""
    problem, width = parts.problem, parts.by_camera.shape[2]
    out = parts.point_inverse.copy()
    _add_camera_share(out, parts)
    kept = problem.kept_points
    after = problem.n_cameras * width
    for position, p in enumerate(kept):
        own = slice(after + 3 * position, after + 3 * position + 3)
        out[p] = parts.inverse[own, own]
    if parts.moments.size:
        held = parts.gauge_points @ parts.moments  # G M (p,3,g)
        carried = parts.inverse @ parts.pull.T  # C A' (e,g)
        middle = parts.pull @ carried + parts.datum_noise
        mixed = np.zeros((problem.n_points, 3, carried.shape[1]))
        by_camera = carried[: problem.n_cameras * width].reshape(problem.n_cameras, width, -1)
        np.add.at(mixed, problem.point, parts.by_camera @ by_camera[problem.camera])
        mixed[kept] = carried[after:].reshape(len(kept), 3, carried.shape[1])
        mixed += parts.point_inverse @ parts.gauge_points
        cross = mixed @ held.transpose(0, 2, 1)
        out += held @ middle @ held.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1)
    out[np.diff(problem.point_start) == 0] = np.nan
    return out


def _add_camera_share(out: FloatArray, parts: _Parts) -> None:
    """Add K C K' of each point to (p,3,3), one product for each pair of cameras that meets in points."""
    problem, width = parts.problem, parts.by_camera.shape[2]
    first, second = _pairs(problem)
    key = problem.camera[first] * problem.n_cameras + problem.camera[second]
    order = np.argsort(key, kind="stable")
    first, second, key = first[order], second[order], key[order]
    starts = np.flatnonzero(np.diff(key, prepend=-1))
    for begin, end in zip(starts, np.append(starts[1:], len(key)), strict=True):
        a, b = first[begin:end], second[begin:end]
        i, j = problem.camera[a[0]] * width, problem.camera[b[0]] * width
        share = parts.by_camera[a] @ parts.inverse[i : i + width, j : j + width] @ parts.by_camera[b].transpose(0, 2, 1)
        # within a pair of cameras a point occurs once
        out[problem.point[a]] += share
        if i != j:
            out[problem.point[a]] += share.transpose(0, 2, 1)


def _pairs(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of observations (i <= j) of one point."""
    end = problem.point_start[problem.point + 1]
    index = np.arange(len(end))
    count = end - index
    first = np.repeat(index, count)
    return first, first + np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
