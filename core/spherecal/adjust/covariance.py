"""Covariance of an adjusted network in the free-network datum.

The observations leave position, orientation and size of the whole open. The datum used here is the inner constraint on
the features' places: no shift, turn or stretch of them as a whole, so their covariance has the least trace. It is
reached from any generalised inverse of the reduced normal matrix by an S-transformation (W. Baarda, S-transformations
and criterion matrices, 1973). Where length rows give the scale, the datum takes it back as well; `stretch` says how
well it is known.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Free
from spherecal.adjust.datum import Places, carried_dots, datum_motions
from spherecal.adjust.least_squares import normal_equations
from spherecal.adjust.linear import Linear
from spherecal.adjust.problem import POSE, Problem, State, symmetric
from spherecal.base import arrays
from spherecal.base.arrays import FloatArray, IntArray, blocks, blocks_of_groups
from spherecal.base.threads import one_blas_thread
from spherecal.geometry.rotation import cross_matrix

# Points whose columns are multiplied at a time, which bounds the memory: 3 * 512 rows of at most 5,000 columns, 60 MB.
_CHUNK = 512
# Pairs of observations of a point that are worked on at a time, 50 MB; a million observations have 14 million.
_MOST_PAIRS = 500_000
# Above, the rigid form keeps the shifts of its dots (at most 5,000 rows by 2,000 columns) instead of adding up each
# observation's share in them whenever they are needed.
_MOST_KEPT = 200_000


@dataclass(frozen=True)
class Covariance:
    """Cofactors (covariances for a standard deviation of unit weight of 1) of an adjusted network.

    `cameras` (c,w,w): pose and intrinsics of each camera in the problem's columns; `points` (f,3,3) of the features'
    places, NaN where one takes no part; `stretch` is the cofactor of the whole network's relative size, None where no
    length row fixes it. `functional` gives the cofactor of a linear function of all places.
    """

    cameras: FloatArray
    points: FloatArray
    stretch: float | None
    condition: float
    _parts: "CovarianceFactors"

    @property
    def point_noise(self) -> FloatArray:
        """The part of the points' cofactors that is their own image noise, V^-1 (f,3,3), without the cameras' share."""
        return self._parts.own_noise

    @property
    def point_of_feature(self) -> IntArray:
        """The unknown point (f,) behind each feature: in the rigid form a dot of the ball has many features."""
        return self._parts.point_of_feature

    def functional(self, gradient: FloatArray) -> float:
        """Cofactor of sum(gradient_f . x_f), gradient (f,3), with all correlations."""
        by_column, by_noise = self._parts.transformed(gradient)
        noise = np.einsum("pi,pij,pj->", by_noise, self._parts.point_inverse, by_noise)
        return float(by_column @ self._parts.inverse @ by_column + noise)

    def all_cameras(self) -> FloatArray:
        """Cofactors of all cameras' parameters with each other, (c*w, c*w)."""
        parts = self._parts
        n = parts.n_camera_columns
        held, carried, middle = parts.held[:n], parts.carried[:n], parts.middle
        mixed = carried @ held.T
        return parts.inverse[:n, :n] - mixed - mixed.T + held @ middle @ held.T

    def with_size(self) -> "Covariance":
        """The same with the uncertainty of the size left in, where length rows give it: cameras only."""
        parts = self._parts
        if self.stretch is None:
            return self
        kept = slice(0, parts.moments.shape[0] - 1)
        places = parts.gauge_places[:, :, kept]
        moments = np.linalg.inv(np.einsum("fig,fih->gh", places, places)) if places.size else np.zeros((0, 0))
        turned = replace(
            parts, gauge_columns=parts.gauge_columns[:, kept], gauge_places=places,
            datum_points=parts.datum_points[:, :, kept], datum_columns=parts.datum_columns[:, kept], moments=moments,
        )  # fmt: skip
        return replace(self, _parts=turned)

    def cameras_with(self, gradient: FloatArray) -> FloatArray:
        """Cofactors (c*w,) of all cameras' parameters with sum(gradient_f . x_f), gradient (f,3)."""
        parts = self._parts
        by_column, by_noise = parts.transformed(gradient)
        moved = parts.inverse @ by_column
        datum = parts.pull @ moved + np.einsum("pig,pij,pj->g", parts.datum_points, parts.point_inverse, by_noise)
        return (moved - parts.held @ datum)[: parts.n_camera_columns]

    def by_scores(self, functional: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Linear functions (m, c*w) of all cameras' parameters by scores: of columns (e,m), of points (3p,g) @ (g,m).

        The score of a column must hold what the points add to it as they follow.
        """
        parts = self._parts
        taken = functional @ parts.held[: parts.n_camera_columns]  # how much of the functions the datum takes back
        by_column = parts.inverse[:, : parts.n_camera_columns] @ functional.T - parts.carried @ taken.T
        return by_column, parts.own_pull, -taken.T


@dataclass(frozen=True)
class CovarianceFactors:
    """Pieces of the S-transformation; e expanded columns, g datum parameters, p points as unknowns, f features.

    `inverse` (e,e): a generalised inverse of the reduced matrix; `linear`: the linearisation at the solution, from
    which `shifts_of` observations come. The datum's motions:
    `gauge_columns` (e,g), and of the features' places `gauge_places` (f,3,g); as conditions on the unknowns they are
    `datum_points` (p,3,g) and `datum_columns` (e,g). `moments` = (sum G'G)^-1 (g,g). `turn` (f,3,3) and `arm` (f,3):
    how placements carry the features' points (`carried_dots`). `shifts` (3p,e): those of all points by all columns,
    held where there are very many observations of few points.
    """

    problem: Problem
    places: Places | None
    turn: FloatArray
    arm: FloatArray
    inverse: FloatArray
    linear: Linear
    point_inverse: FloatArray
    gauge_columns: FloatArray
    gauge_places: FloatArray
    datum_points: FloatArray
    datum_columns: FloatArray
    moments: FloatArray
    spread: float
    shifts: sparse.csr_array | None

    @property
    def n_camera_columns(self) -> int:
        """Expanded columns of cameras, the first ones."""
        return self.problem.n_cameras * self.linear.width

    def shifts_of(self, rows: slice) -> tuple[FloatArray, FloatArray]:
        """Shifts of some observations' points by their cameras' (k,3,w) and placements' (k,3,6) parameters: -V^-1 W'.

        Those by placements are (0,3,6) in the free form. Zeros for points that are kept.
        """
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

    @property
    def own_noise(self) -> FloatArray:
        """The features' own image noise (f,3,3), without the cameras' share."""
        if self.places is None:
            return self.point_inverse
        return self.turn @ self.point_inverse[self.places.point] @ self.turn.transpose(0, 2, 1)

    @property
    def point_of_feature(self) -> IntArray:
        """The unknown point (f,) behind each feature."""
        return np.arange(len(self.gauge_places)) if self.places is None else self.places.point

    def place_cofactors(self) -> FloatArray:
        """Cofactors (f,3,3) of the features' places in the datum; NaN where one takes no part."""
        return _place_cofactors(self)

    def to_unknowns(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A gradient by places (f,3) as gradients by points (p,3) and by columns (e,)."""
        columns = np.zeros(self.problem.layout.expanded)
        if self.places is None:
            return gradient, columns
        points = np.zeros((self.problem.n_points, 3))
        np.add.at(points, self.places.point, np.einsum("fji,fj->fi", self.turn, gradient))
        poses = np.zeros((self.problem.n_placements, POSE))
        np.add.at(poses, self.places.placement, np.concatenate([np.cross(self.arm, gradient), gradient], axis=1))
        start = self.n_camera_columns
        columns[start : start + poses.size] = poses.ravel()
        return points, columns

    def point_columns_times(self, gradients: FloatArray) -> FloatArray:
        """sum over points of gradient_p K_p, (m,e), for gradients (m,p,3)."""
        problem, m = self.problem, len(gradients)
        if self.shifts is not None:
            rows = [gradient.ravel() @ self.shifts for gradient in gradients]
            return np.array(rows).reshape(m, problem.layout.expanded)
        cameras = np.zeros((m, problem.n_cameras, self.linear.width))
        poses = np.zeros((m, problem.n_placements, POSE))
        for rows in blocks(len(problem.uv)):
            by_camera, by_placement = self.shifts_of(rows)
            at = gradients[:, problem.point[rows]]
            for total, own, pose in zip(cameras, at, poses, strict=True):
                np.add.at(total, problem.camera[rows], np.einsum("ni,niw->nw", own, by_camera))
                if problem.n_placements:
                    np.add.at(pose, problem.placement[rows], np.einsum("ni,niw->nw", own, by_placement))
        pieces = (cameras, poses, gradients[:, problem.kept_points])
        return np.concatenate([piece.reshape(m, piece.shape[1] * piece.shape[2]) for piece in pieces], axis=1)

    def transformed(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A gradient by places (f,3) in the datum, by columns (e,) and by the points' own noise (p,3)."""
        left = np.einsum("fi,fig->g", gradient, self.gauge_places) @ self.moments  # how much the datum takes back
        points, columns = self.to_unknowns(gradient)
        by_column = columns + self.point_columns_times(points[None])[0] - left @ self.pull
        return by_column, points - self.datum_points @ left

    @cached_property
    def pull(self) -> FloatArray:
        """The datum's conditions by columns, points eliminated, (g,e)."""
        return self.point_columns_times(self.datum_points.transpose(2, 0, 1)) + self.datum_columns.T

    @cached_property
    def own_pull(self) -> FloatArray:
        """The datum's conditions by scores of the points, (3p,g)."""
        pulled = self.point_inverse @ self.datum_points
        return pulled.reshape(3 * len(pulled), pulled.shape[2])

    @cached_property
    def held(self) -> FloatArray:
        """G M of the columns, (e,g)."""
        return self.gauge_columns @ self.moments

    @cached_property
    def carried(self) -> FloatArray:
        """C A' (e,g) with A the pull."""
        return self.inverse @ self.pull.T

    @cached_property
    def middle(self) -> FloatArray:
        """A C A' + sum B' V^-1 B (g,g)."""
        noise = np.einsum("pig,pij,pjh->gh", self.datum_points, self.point_inverse, self.datum_points)
        return self.pull @ self.carried + noise


def covariance(problem: Problem, state: State, places: Places | None = None) -> Covariance | None:
    """Cofactors of cameras and features at the minimum; None where the network is singular.

    `places` is needed in the rigid form, where one placement at least must stand for the world (locked).
    """
    if isinstance(problem.ball, Free) != (places is None):
        raise ValueError("the rigid form, and only it, needs the features' places")
    return finished_or_none(problem, lambda: _parts(problem, state, places))


def finished_or_none(problem: Problem, pieces: Callable[[], tuple[CovarianceFactors, float]]) -> Covariance | None:
    """The covariance from its pieces and condition number; None without observations, and of a singular network."""
    if not len(problem.uv):
        return None
    with one_blas_thread():
        try:
            parts, condition = pieces()
        except (LinAlgError, np.linalg.LinAlgError):
            return None
        return finished(parts, condition)


def finished(parts: CovarianceFactors, condition: float) -> Covariance:
    """The covariance from its pieces."""
    cameras = Covariance(np.zeros(0), np.zeros(0), None, condition, parts).all_cameras()
    width, own = parts.linear.width, np.arange(parts.problem.n_cameras)
    diagonal = cameras.reshape(len(own), width, len(own), width)[own, :, own, :]
    return Covariance(diagonal, parts.place_cofactors(), _stretch(parts), condition, parts)


def camera_cofactors(problem: Problem, state: State, places: Places | None) -> FloatArray | None:
    """Cofactors of all cameras' parameters alone (c*w, c*w), for planning; None where the network is singular."""
    with one_blas_thread():
        try:
            parts, condition = _parts(problem, state, places)
        except (LinAlgError, np.linalg.LinAlgError):
            return None
        return Covariance(np.zeros(0), np.zeros(0), None, condition, parts).all_cameras()


def _parts(problem: Problem, state: State, places: Places | None) -> tuple[CovarianceFactors, float]:
    linear = engine.linear_model(problem, state, None)
    normal = normal_equations(problem, state, linear, 0.0)
    if not (np.isfinite(normal.gradient).all() and (normal.matrix.diagonal() > 0).all()):
        raise LinAlgError  # as with a point whose rays are parallel to the last bit
    motions = datum_motions(problem, state, places)
    layout = problem.layout
    reduced_gauge = np.zeros((layout.size, int(motions.unseen.sum())))
    used = layout.column >= 0
    reduced_gauge[layout.column[used]] = motions.columns[:, motions.unseen][used]
    point_inverse, matrix = normal.reduced.point_inverse, symmetric(normal.matrix)
    del normal  # each of these matrices takes 24 MB with 100 cameras
    inverse, condition = generalised_inverse(matrix, reduced_gauge)
    del matrix
    expanded = layout.expand_rows(layout.expand_rows(inverse).T)
    del inverse

    g = motions.columns.shape[1]
    turn, arm = carried_dots(state, places)
    moments = np.linalg.inv(np.einsum("fig,fih->gh", motions.places, motions.places)) if g else np.zeros((0, 0))
    parts = CovarianceFactors(
        problem, places, turn, arm, expanded, linear, point_inverse, motions.columns, motions.places,
        motions.places, np.zeros((layout.expanded, g)), moments, motions.spread, None,
    )  # fmt: skip
    if places is None:
        return parts, condition
    conditions = [parts.to_unknowns(motions.places[:, :, k]) for k in range(g)]
    return replace(
        parts,
        shifts=shift_matrix(parts) if len(problem.uv) > _MOST_KEPT else None,
        datum_points=np.stack([points for points, _ in conditions], axis=2)
        if g
        else np.zeros((problem.n_points, 3, 0)),
        datum_columns=np.stack([columns for _, columns in conditions], axis=1) if g else parts.datum_columns,
    ), condition


def _stretch(parts: CovarianceFactors) -> float | None:
    """Cofactor of the relative size of the whole where length rows give it: the datum's last parameter, M B' du."""
    if not parts.problem.has_lengths or not parts.moments.size:
        return None
    last = parts.moments[-1]
    return float(last @ parts.middle @ last) / parts.spread**2


def generalised_inverse(matrix: FloatArray, gauge: FloatArray) -> tuple[FloatArray, float]:
    """A generalised inverse of a matrix whose null space is spanned by `gauge` (d,g), and its condition number."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    scaled = matrix * scale[:, None]
    scaled *= scale
    size = np.linalg.norm(scaled, 1)
    null = np.linalg.qr(gauge / scale[:, None])[0]
    square = null @ null.T
    scaled += square
    factor = cho_factor(np.asfortranarray(scaled), overwrite_a=True)
    del scaled
    inverse = cho_solve(factor, np.eye(len(matrix)), overwrite_b=True) - square
    condition = size * np.linalg.norm(inverse, 1)
    inverse *= scale[:, None]
    inverse *= scale
    return inverse, float(condition)


def _place_cofactors(parts: CovarianceFactors) -> FloatArray:
    """(f,3,3) of L C L' + R V^-1 R' in the datum, L = R K + J by columns; NaN where a feature takes no part."""
    problem, places = parts.problem, parts.places
    observed = np.diff(problem.point_start) > 0
    if places is None:
        out = parts.point_inverse.copy()
        _add_camera_share(out, parts)
        kept = problem.kept_points
        after = parts.n_camera_columns
        for position, p in enumerate(kept):
            own = slice(after + 3 * position, after + 3 * position + 3)
            out[p] = parts.inverse[own, own]
        carried = _carried_points(parts) + parts.point_inverse @ parts.datum_points
    else:
        out, carried = _carried_places(parts)
        observed = observed[places.point]
    if parts.moments.size:
        held = parts.gauge_places @ parts.moments
        cross = carried @ held.transpose(0, 2, 1)
        out += held @ parts.middle @ held.transpose(0, 2, 1) - cross - cross.transpose(0, 2, 1)
    out[~observed] = np.nan
    return out


def _carried_points(parts: CovarianceFactors) -> FloatArray:
    """K C A' (p,3,g)."""
    problem = parts.problem
    out = np.zeros((problem.n_points, 3, parts.carried.shape[1]))
    by_camera = parts.carried[: parts.n_camera_columns].reshape(problem.n_cameras, parts.linear.width, out.shape[2])
    for own in blocks(len(problem.uv)):
        np.add.at(out, problem.point[own], parts.shifts_of(own)[0] @ by_camera[problem.camera[own]])
    kept = problem.kept_points
    out[kept] = parts.carried[problem.layout.expanded - 3 * len(kept) :].reshape(len(kept), *out.shape[1:])
    return out


def _carried_places(parts: CovarianceFactors) -> tuple[FloatArray, FloatArray]:
    """In the rigid form: L C L' + R V^-1 R' (f,3,3) and L C A' + R V^-1 B' (f,3,g) of the features' places."""
    problem, places = parts.problem, parts.places
    assert places is not None
    shifts = shift_matrix(parts)
    pose = parts.n_camera_columns + POSE * places.placement[:, None] + np.arange(POSE)  # (f,6)
    by_pose = np.concatenate([-cross_matrix(parts.arm), np.broadcast_to(np.eye(3), (len(pose), 3, 3))], axis=2)
    out = by_pose @ parts.inverse[pose[:, :, None], pose[:, None, :]] @ by_pose.transpose(0, 2, 1)
    carried = by_pose @ parts.carried[pose]
    by_point = parts.point_inverse @ parts.datum_points + np.asarray(shifts @ parts.carried).reshape(
        problem.n_points, 3, parts.carried.shape[1]
    )
    carried += parts.turn @ by_point[places.point]
    order = np.argsort(places.point, kind="stable")
    for first in range(0, problem.n_points, _CHUNK):
        rows = shifts[3 * first : 3 * (first + _CHUNK)].toarray()
        moved = (rows @ parts.inverse).reshape(-1, 3, problem.layout.expanded)  # K C
        own = moved @ rows.reshape(moved.shape).transpose(0, 2, 1) + parts.point_inverse[first : first + _CHUNK]
        begin, end = np.searchsorted(places.point[order], [first, first + _CHUNK])
        some = order[begin:end]
        local, turn = places.point[some] - first, parts.turn[some]
        mixed = turn @ moved[local[:, None], :, pose[some]].transpose(0, 2, 1) @ by_pose[some].transpose(0, 2, 1)
        out[some] += turn @ own[local] @ turn.transpose(0, 2, 1) + mixed + mixed.transpose(0, 2, 1)
    return out, carried


def shift_matrix(parts: CovarianceFactors) -> sparse.csr_array:
    """K: shifts of all points by all columns (3p, e)."""
    problem = parts.problem
    if parts.shifts is not None:
        return parts.shifts
    pieces = [_shifts(parts, first, last) for first, last in blocks_of_groups(problem.point_start)]
    count = np.concatenate([[0], *(np.diff(piece.indptr) for piece in pieces)])
    start = np.cumsum(count, dtype=np.int32)
    values, columns = np.empty(int(start[-1])), np.empty(int(start[-1]), dtype=np.int32)
    end = len(values)
    while pieces:  # each is let go as soon as it is copied, so that they are never held twice
        piece = pieces.pop()
        own, end = slice(end - piece.nnz, end), end - piece.nnz
        values[own], columns[own] = piece.data, piece.indices
    return sparse.csr_array((values, columns, start), shape=(3 * problem.n_points, problem.layout.expanded))


def _shifts(parts: CovarianceFactors, first: int, last: int) -> sparse.csr_array:
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


def _add_camera_share(out: FloatArray, parts: CovarianceFactors) -> None:
    """Add K C K' of each point to (p,3,3), one product for each pair of cameras that meets in some of the points."""
    for begin, end in _runs_of_points(parts.problem):
        by_camera = parts.shifts_of(slice(begin, end))[0]
        _add_share_of(out, parts, begin, by_camera, *_pairs(parts.problem, begin, end))


def _runs_of_points(problem: Problem) -> Iterator[tuple[int, int]]:
    """First and last observations of runs of whole points that have some _MOST_PAIRS pairs each, or fewer."""
    views = np.diff(problem.point_start)
    run = np.cumsum(views * (views + 1) // 2 + 8 * views) // _MOST_PAIRS  # an observation takes as much as 8 pairs
    first = np.flatnonzero(np.diff(run, prepend=-1))
    starts = problem.point_start[first]
    yield from zip(starts.tolist(), [*starts[1:].tolist(), int(problem.point_start[-1])], strict=True)


def _add_share_of(
    out: FloatArray, parts: CovarianceFactors, begin: int, by_camera: FloatArray, first: IntArray, second: IntArray
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
