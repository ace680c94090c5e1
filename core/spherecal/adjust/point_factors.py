"""Covariance factors of free points and of the dots of a ball that keeps its shape."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from spherecal.adjust.covariance_factors import Covariance, Inverted, add_products, moments_of
from spherecal.adjust.datum import Places, carried_dots
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base import arrays
from spherecal.base.arrays import FloatArray, IntArray, blocks, blocks_of_groups, sum_by
from spherecal.geometry.rotation import cross, cross_matrix

# Points whose columns are multiplied at a time, which bounds the memory: 3 * 512 rows of at most 5,000 columns, 60 MB.
_CHUNK = 512
# Pairs of observations of a point that are worked on at a time, 50 MB; a million observations have 14 million.
_MOST_PAIRS = 500_000
# Above, the rigid form keeps the shifts of its dots (at most 5,000 rows by 2,000 columns) instead of adding up each
# observation's share in them whenever they are needed.
_MOST_KEPT = 200_000


@dataclass(frozen=True)
class PointFactors(Covariance):
    """Factors whose sources of noise are the points; `shifts` -V^-1 W' (3p,e): kept where few points are seen often."""

    shifts: sparse.csr_array | None

    def shifts_of(self, rows: slice) -> tuple[FloatArray, FloatArray]:
        """Shifts -V^-1 W' of observations' points by cameras (k,3,w) and placements (k,3,6); 0 for kept points."""
        if len(self.problem.uv) > arrays.ROWS_AT_ONCE:
            return self._shifts_of(rows)
        by_camera, by_placement = self._all_shifts
        return by_camera[rows], by_placement[rows] if len(by_placement) else by_placement

    @cached_property
    def _all_shifts(self) -> tuple[FloatArray, FloatArray]:
        return self._shifts_of(slice(None))

    def _shifts_of(self, rows: slice) -> tuple[FloatArray, FloatArray]:
        linear, point = self.linear.at(rows), self.problem.point[rows]
        is_kept = np.isin(point, self.problem.kept_points)
        inverse = -self.point_inverse[point]
        inverse[is_kept] = 0.0

        def shift(derivatives: FloatArray) -> FloatArray:
            return inverse @ np.einsum("nji,njw->niw", linear.by_point, derivatives)

        return shift(linear.by_camera), shift(linear.by_placement) if self.problem.n_placements else np.zeros(
            (0, 3, POSE)
        )

    @cached_property
    def every_shift(self) -> sparse.csr_array:
        """`shift_matrix`, which the diagnosis, the ball's shape and the places ask for."""
        return shift_matrix(self)

    @cached_property
    def own_noise(self) -> FloatArray:
        """The features' own image noise (f,3,3), without the cameras' share."""
        if self.places is None:
            return self.point_inverse
        return self.rotation @ self.point_inverse[self.places.point] @ self.rotation.transpose(0, 2, 1)

    @property
    def point_of_feature(self) -> IntArray:
        """The unknown point (f,) behind each feature."""
        return np.arange(len(self.motions.places)) if self.places is None else self.places.point

    def place_cofactors(self) -> FloatArray:
        """Cofactors (f,3,3) of L C L' + R V^-1 R' in the datum, L = R K + J by columns; NaN without observations."""
        if self.places is None:
            out = self.point_inverse.copy()
            if self.shifts is not None:
                add_products(out, self.shifts, self.inverse, _CHUNK)
            else:
                for begin, end in _runs_of_points(self.problem):
                    by_camera = self.shifts_of(slice(begin, end))[0]
                    _add_share_of(out, self, begin, by_camera, *_pairs(self.problem, begin, end))
                kept = self.problem.kept_points
                after = self.n_camera_columns
                for position, p in enumerate(kept):
                    own = slice(after + 3 * position, after + 3 * position + 3)
                    out[p] = self.inverse[own, own]
            gauge_cross = _carried_points(self) + self.point_inverse @ self.datum_points
        else:
            out, gauge_cross = _carried_places(self)
        self.take_back(out, gauge_cross)
        out[~self.is_located] = np.nan
        return out

    def to_unknowns(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A gradient by places (f,3) as gradients by points (p,3) and by columns (e,)."""
        columns = np.zeros(len(self.inverse))
        if self.places is None:
            return gradient, columns
        turned = np.einsum("fji,fj->fi", self.rotation, gradient)
        points = sum_by(self.places.point, turned, self.problem.n_points)
        moved = np.concatenate([cross(self.lever_arm, gradient), gradient], axis=1)
        poses = sum_by(self.places.placement, moved, self.problem.n_placements)
        start = self.n_camera_columns
        columns[start : start + poses.size] = poses.ravel()
        return points, columns

    def point_columns_times(self, gradients: FloatArray) -> FloatArray:
        """sum over points of gradient_p K_p, (m,e), for gradients (m,p,3)."""
        problem, m = self.problem, len(gradients)
        if self.shifts is not None:
            rows = [gradient.ravel() @ self.shifts for gradient in gradients]
            return np.array(rows).reshape(m, len(self.inverse))
        cameras = np.zeros((m, problem.n_cameras, self.linear.width))
        poses = np.zeros((m, problem.n_placements, POSE))
        for rows in blocks(len(problem.uv)):
            by_camera, by_placement = self.shifts_of(rows)
            for k, own in enumerate(gradients[:, problem.point[rows]]):
                shares = np.einsum("ni,niw->nw", own, by_camera)
                cameras[k] = sum_by(problem.camera[rows], shares, problem.n_cameras, cameras[k])
                if problem.n_placements:
                    shares = np.einsum("ni,niw->nw", own, by_placement)
                    poses[k] = sum_by(problem.placement[rows], shares, problem.n_placements, poses[k])
        pieces = (cameras, poses, gradients[:, problem.kept_points])
        return np.concatenate([piece.reshape(m, piece.shape[1] * piece.shape[2]) for piece in pieces], axis=1)

    def transformed(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A gradient by places (f,3) in the datum, by columns (e,) and by the points' own noise (p,3)."""
        left = np.einsum("fi,fig->g", gradient, self.motions.places) @ self.moments  # how much the datum takes back
        points, columns = self.to_unknowns(gradient)
        by_column = columns + self.point_columns_times(points[None])[0] - left @ self.gauge_rows
        return by_column, points - self.datum_points @ left

    @cached_property
    def gauge_rows(self) -> FloatArray:
        """The datum's conditions by columns, points eliminated, (g,e)."""
        return self.point_columns_times(self.datum_points.transpose(2, 0, 1)) + self.datum_columns.T


def point_factors(inverted: Inverted, state: State, places: Places | None) -> PointFactors:
    """The factors of a network of free points (`places` None), or of dots whose features are at `places`."""
    problem, motions = inverted.problem, inverted.motions
    g, expanded = motions.columns.shape[1], problem.layout.expanded
    rotation, lever_arm = carried_dots(state, places)
    parts = PointFactors(
        **vars(inverted),
        places=places,
        rotation=rotation,
        lever_arm=lever_arm,
        datum_points=motions.places,
        datum_columns=np.zeros((expanded, g)),
        moments=moments_of(motions.places),
        shifts=None,
    )
    if places is None:
        return parts
    datum_points, datum_columns = np.zeros((problem.n_points, 3, g)), np.zeros((expanded, g))
    for k in range(g):
        datum_points[:, :, k], datum_columns[:, k] = parts.to_unknowns(motions.places[:, :, k])
    shifts = shift_matrix(parts) if len(problem.uv) > _MOST_KEPT else None
    return replace(parts, shifts=shifts, datum_points=datum_points, datum_columns=datum_columns)


def widened(parts: PointFactors, inverse: FloatArray, shifts: sparse.csr_array) -> PointFactors:
    """The factors with more columns, which the datum leaves alone: cofactors (e+m,e+m) and points' shifts (3p,m)."""
    more = ((0, len(inverse) - len(parts.inverse)), (0, 0))
    return replace(
        parts,
        inverse=inverse,
        shifts=sparse.hstack([shift_matrix(parts), shifts], format="csr"),
        motions=replace(parts.motions, columns=np.pad(parts.motions.columns, more)),
        datum_columns=np.pad(parts.datum_columns, more),
        given=parts,
    )


def _carried_points(parts: PointFactors) -> FloatArray:
    """K C A' (p,3,g)."""
    problem = parts.problem
    if parts.shifts is not None:
        carried = np.asarray(parts.shifts @ parts.gauge_cross)
        return carried.reshape(problem.n_points, 3, parts.gauge_cross.shape[1])
    out = np.zeros((problem.n_points, 3, parts.gauge_cross.shape[1]))
    by_camera = parts.gauge_cross[: parts.n_camera_columns].reshape(problem.n_cameras, parts.linear.width, out.shape[2])
    for own in blocks(len(problem.uv)):
        share = parts.shifts_of(own)[0] @ by_camera[problem.camera[own]]
        out = sum_by(problem.point[own], share, len(out), out)
    kept = problem.kept_points
    out[kept] = parts.gauge_cross[problem.layout.expanded - 3 * len(kept) :].reshape(len(kept), *out.shape[1:])
    return out


def _carried_places(parts: PointFactors) -> tuple[FloatArray, FloatArray]:
    """In the rigid form: L C L' + R V^-1 R' (f,3,3) and L C A' + R V^-1 B' (f,3,g) of the features' places."""
    problem, places = parts.problem, parts.places
    assert places is not None
    shifts = parts.every_shift
    pose = parts.n_camera_columns + POSE * places.placement[:, None] + np.arange(POSE)  # (f,6)
    by_pose = np.concatenate([-cross_matrix(parts.lever_arm), np.broadcast_to(np.eye(3), (len(pose), 3, 3))], axis=2)
    out = by_pose @ parts.inverse[pose[:, :, None], pose[:, None, :]] @ by_pose.transpose(0, 2, 1)
    gauge_cross = by_pose @ parts.gauge_cross[pose]
    by_point = parts.point_inverse @ parts.datum_points + np.asarray(shifts @ parts.gauge_cross).reshape(
        problem.n_points, 3, parts.gauge_cross.shape[1]
    )
    gauge_cross += parts.rotation @ by_point[places.point]
    order = np.argsort(places.point, kind="stable")
    for first in range(0, problem.n_points, _CHUNK):
        rows = shifts[3 * first : 3 * (first + _CHUNK)].toarray()
        moved = (rows @ parts.inverse).reshape(-1, 3, len(parts.inverse))  # K C
        own = moved @ rows.reshape(moved.shape).transpose(0, 2, 1) + parts.point_inverse[first : first + _CHUNK]
        begin, end = np.searchsorted(places.point[order], [first, first + _CHUNK])
        some = order[begin:end]
        local, rotation = places.point[some] - first, parts.rotation[some]
        mixed = rotation @ moved[local[:, None], :, pose[some]].transpose(0, 2, 1) @ by_pose[some].transpose(0, 2, 1)
        out[some] += rotation @ own[local] @ rotation.transpose(0, 2, 1) + mixed + mixed.transpose(0, 2, 1)
    return out, gauge_cross


def shift_matrix(parts: PointFactors) -> sparse.csr_array:
    """K: shifts of all points by all columns (3p, e)."""
    if parts.shifts is not None:
        return parts.shifts
    problem = parts.problem
    pieces = [_shifts(parts, first, last) for first, last in blocks_of_groups(problem.point_start)]
    count = np.concatenate([[0], *(np.diff(piece.indptr) for piece in pieces)])
    start = np.cumsum(count, dtype=np.int32)
    values, columns = np.empty(int(start[-1])), np.empty(int(start[-1]), dtype=np.int32)
    end = len(values)
    while pieces:  # each is let go as soon as it is copied, so that they are never in memory twice
        piece = pieces.pop()
        own, end = slice(end - piece.nnz, end), end - piece.nnz
        values[own], columns[own] = piece.data, piece.indices
    return sparse.csr_array((values, columns, start), shape=(3 * problem.n_points, problem.layout.expanded))


def _shifts(parts: PointFactors, first: int, last: int) -> sparse.csr_array:
    """The rows of K of the points from `first` to `last`."""
    problem = parts.problem
    own = slice(int(problem.point_start[first]), int(problem.point_start[last]))
    by_camera, by_placement = parts.shifts_of(own)
    width = by_camera.shape[2]
    spread = [(by_camera, problem.camera[own] * width)]
    if problem.n_placements:
        spread.append((by_placement, problem.n_cameras * width + POSE * problem.placement[own]))
    kept = np.flatnonzero((problem.kept_points >= first) & (problem.kept_points < last))  # columns themselves
    rows = [(3 * (problem.kept_points[kept, None] - first) + np.arange(3)).astype(np.int32).ravel()]
    from_column = problem.layout.expanded - 3 * len(problem.kept_points)
    columns = [(from_column + 3 * kept[:, None] + np.arange(3)).astype(np.int32).ravel()]
    values = [np.ones(3 * len(kept))]
    point = 3 * (problem.point[own] - first).astype(np.int32)
    for value, column in spread:
        rows.append(np.broadcast_to((point[:, None] + np.arange(3, dtype=np.int32))[:, :, None], value.shape).ravel())
        all_columns = (column[:, None] + np.arange(value.shape[2])).astype(np.int32)
        columns.append(np.broadcast_to(all_columns[:, None], value.shape).ravel())
        values.append(value.ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.csr_array(entries, shape=(3 * (last - first), problem.layout.expanded))


def _runs_of_points(problem: Problem) -> Iterator[tuple[int, int]]:
    """First and last observations of runs of whole points that have some _MOST_PAIRS pairs each, or fewer."""
    views = np.diff(problem.point_start)
    run = np.cumsum(views * (views + 1) // 2 + 8 * views) // _MOST_PAIRS  # an observation takes as much as 8 pairs
    first = np.flatnonzero(np.diff(run, prepend=-1))
    starts = problem.point_start[first]
    yield from zip(starts.tolist(), [*starts[1:].tolist(), int(problem.point_start[-1])], strict=True)


def _add_share_of(
    out: FloatArray, parts: PointFactors, begin: int, by_camera: FloatArray, first: IntArray, second: IntArray
) -> None:
    """What some pairs of observations of one point each add; by_camera: the shifts of all from `begin` on."""
    problem, width = parts.problem, by_camera.shape[2]
    key = problem.camera[first] * problem.n_cameras + problem.camera[second]
    order = np.argsort(key, kind="stable")
    first, second, key = first[order], second[order], key[order]
    starts = np.flatnonzero(np.diff(key, prepend=-1))
    for start, end in zip(starts, np.append(starts[1:], len(key)), strict=True):
        a, b = first[start:end], second[start:end]
        i, j = problem.camera[a[0]] * width, problem.camera[b[0]] * width
        inverse = parts.inverse[i : i + width, j : j + width]
        share = by_camera[a - begin] @ inverse @ by_camera[b - begin].transpose(0, 2, 1)
        # within a pair of cameras a point occurs once
        out[problem.point[a]] += share
        if i != j:
            out[problem.point[a]] += share.transpose(0, 2, 1)


def _pairs(problem: Problem, begin: int, stop: int) -> tuple[IntArray, IntArray]:
    """All pairs of observations (i <= j) of one point each, of whole points' observations begin to stop."""
    index = np.arange(begin, stop)
    count = problem.point_start[problem.point[begin:stop] + 1] - index
    first = np.repeat(index, count)
    return first, first + np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
