"""The Cramer-Rao bound by brute force, independently of the adjustment's own covariance.

Derivatives are taken by complex steps through the projection, the whole normal matrix (cameras, placements of the rigid
ball and points, rows of a bar's certified lengths) is set up and inverted densely; nothing of `spherecal.adjust` takes
part but the containers.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import get_lapack_funcs

from benchmarks.studies.simulated import CERTIFICATE_SD_MM, THERMOMETER_SD_K, Bars, Form, Simulated
from spherecal.adjust.datum import Places
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.camera import project

_STEP = 1e-100  # of a complex step: no subtraction, no rounding
_POSE = 6
_LEAST_DOTS = 4  # of a sticker, for its pattern to be measured


@dataclass(frozen=True)
class BarBound:
    """Variances (n,) mm^2 of the bars' lengths: by the cameras' errors, the bars' own noise, the noise of the scale.

    Where a bar gives the scale inside the adjustment, its noise is part of the cameras' errors.
    """

    calibration: FloatArray
    own: FloatArray
    scale: FloatArray

    @property
    def total(self) -> FloatArray:
        """The bound, (n,) mm^2."""
        return self.calibration + self.own + self.scale


@dataclass(frozen=True)
class _Unknowns:
    """Columns: cameras (width each), placements that moved (6 each), points (3 each).

    Feature f is point `point[f]` (an index among the points that take part, -1: none) where placement block
    `block[f]` (0: the world) carries it: `turn` (f,3,3) and `arm` (f,3) = turn @ point.
    """

    width: int
    n_cameras: int
    n_blocks: int
    n_points: int
    point: IntArray
    block: IntArray
    turn: FloatArray
    arm: FloatArray

    @property
    def first_point(self) -> int:
        return self.n_cameras * self.width + _POSE * (self.n_blocks - 1)

    @property
    def count(self) -> int:
        return self.first_point + 3 * self.n_points

    @property
    def known(self) -> BoolArray:
        """Features (f,) that take part."""
        return self.point >= 0

    def by_places(self, features: IntArray, values: FloatArray) -> sparse.csr_array:
        """Derivatives (n,k,3) by the places of features (n,), as rows (n*k, unknowns)."""
        k = values.shape[1]
        row = np.arange(len(features) * k).reshape(-1, k, 1)
        by_point = values @ self.turn[features]
        parts = [(by_point, (self.first_point + 3 * self.point[features])[:, None, None] + np.arange(3), row)]
        moved = self.block[features] > 0
        by_turn = np.cross(self.arm[features][moved][:, None], values[moved])
        by_pose = np.concatenate([by_turn, values[moved]], axis=2)
        pose = self.n_cameras * self.width + _POSE * (self.block[features][moved] - 1)
        parts.append((by_pose, pose[:, None, None] + np.arange(_POSE), row[moved]))
        return _rows(parts, row.size, self.count)


@dataclass(frozen=True)
class DenseNetwork:
    """Covariance (u,u) of all unknowns of a network at the truth, with what nothing determines held.

    `in_datum` is the same in the datum of the features' places, which takes back a stretch that a bar determines too;
    `point_noise` (f,3,3): the places' covariance with cameras and placements known, NaN for features without a point.
    """

    state: State
    places_mm: FloatArray
    columns: IntArray
    unknowns: _Unknowns
    covariance: FloatArray
    in_datum: FloatArray
    point_noise: FloatArray
    length_covariance: FloatArray | None

    @property
    def with_lengths(self) -> bool:
        """Whether a bar gives the scale."""
        return self.length_covariance is not None

    @property
    def known(self) -> BoolArray:
        """Features (f,) that take part."""
        return self.unknowns.known

    def camera_sd(self) -> FloatArray:
        """Standard deviations (c, width) in the datum."""
        n = self.unknowns.n_cameras * self.unknowns.width
        return np.sqrt(np.diag(self.in_datum)[:n]).reshape(self.unknowns.n_cameras, -1)

    def place_sd(self) -> FloatArray:
        """Standard deviations (k,3) of the places of the known features in the datum."""
        features = np.flatnonzero(self.known)
        rows = self.unknowns.by_places(features, np.broadcast_to(np.eye(3), (len(features), 3, 3)))
        return np.sqrt(np.asarray((rows @ self.in_datum) * rows.toarray()).sum(axis=1)).reshape(-1, 3)


def dense_network(simulated: Simulated, form: Form = "free") -> DenseNetwork:
    """The covariance at the truth, all of it."""
    network, state, use = simulated.network_in(form), simulated.state_in(form), simulated.usable_in(form)
    camera, feature = network.camera[use], simulated.features.of_observation[use]
    columns = np.flatnonzero(network.free[0])
    assert (network.free == network.free[0]).all() and len(np.unique(network.group)) == len(network.group)
    unknowns = _unknowns(simulated, form, state, use, _POSE + len(columns))
    by_camera, by_place = derivatives(state, camera, simulated.places_mm[feature], columns)
    weight = 1.0 / simulated.truth.sigma_px[camera][:, None, None]
    by_camera, by_place = by_camera * weight, by_place * weight
    row = np.arange(2 * len(camera)).reshape(-1, 2, 1)
    of_cameras = (by_camera, (camera * unknowns.width)[:, None, None] + np.arange(unknowns.width), row)
    rows = _rows([of_cameras], row.size, unknowns.count) + unknowns.by_places(feature, by_place)
    lengths, certificate = _length_rows(simulated, unknowns)
    normal = (rows.T @ rows).toarray()
    own = np.arange(unknowns.n_points)[:, None, None] * 3 + unknowns.first_point
    of_points = np.linalg.inv(normal[own + np.arange(3)[:, None], own + np.arange(3)])
    noise = np.full((len(unknowns.point), 3, 3), np.nan)
    turn = unknowns.turn[unknowns.known]
    noise[unknowns.known] = turn @ of_points[unknowns.point[unknowns.known]] @ turn.transpose(0, 2, 1)
    if lengths is not None:
        normal += lengths.T @ lengths
    motions, conditions = _motions(simulated, state, unknowns)
    unseen = 7 if lengths is None else 6
    covariance = _inner_inverse(normal, motions[:, :unseen], conditions[:, :unseen])
    in_datum = covariance if lengths is None else _taken_back(covariance, motions, conditions)
    return DenseNetwork(state, simulated.places_mm, columns, unknowns, covariance, in_datum, noise, certificate)


def _unknowns(simulated: Simulated, form: Form, state: State, use: BoolArray, width: int) -> _Unknowns:
    count, feature = len(simulated.features), simulated.features.of_observation[use]
    places: Places | None = simulated.places_in(form)
    turn, block, number = np.tile(np.eye(3), (count, 1, 1)), np.zeros(count, dtype=np.int64), np.arange(count)
    arm = simulated.places_mm
    n_blocks = 1
    if places is not None:
        n_blocks, block, number = len(state.placement_rotation), places.placement, places.point
        turn, arm = state.placement_rotation[block], simulated.places_mm - state.placement_translation[block]
    taking_part = np.unique(number[feature])
    index = np.full(number.max() + 1, -1)
    index[taking_part] = np.arange(len(taking_part))
    return _Unknowns(width, len(state.rotation), n_blocks, len(taking_part), index[number], block, turn, arm)


_Part = tuple[FloatArray, IntArray, IntArray]  # values with their columns and rows, to be broadcast


def _rows(parts: list[_Part], height: int, width: int) -> sparse.csr_array:
    row = np.concatenate([np.broadcast_to(at, values.shape).ravel() for values, _, at in parts])
    column = np.concatenate([np.broadcast_to(where, values.shape).ravel() for values, where, _ in parts])
    return sparse.csr_array(
        (np.concatenate([values.ravel() for values, _, _ in parts]), (row, column)), shape=(height, width)
    )


def derivatives(state: State, camera: IntArray, places: FloatArray, columns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of image points by pose and intrinsics (n, 2, 6 + k) and by the point's place (n, 2, 3)."""
    rotation, intrinsics = state.rotation[camera], state.intrinsics[camera].astype(complex)
    x = np.einsum("nij,nj->ni", rotation, places) + state.translation[camera]
    unit = np.eye(3)
    turns = [np.cross(unit[k], x) for k in range(3)]
    shifts = [np.broadcast_to(unit[k], x.shape) for k in range(3)]
    moves = [rotation[:, :, k] for k in range(3)]
    by_place = [project(x + 1j * _STEP * d, intrinsics).imag / _STEP for d in (*turns, *shifts, *moves)]
    by_lens = []
    for column in columns:
        stepped = intrinsics.copy()
        stepped[:, column] += 1j * _STEP
        by_lens.append(project(x.astype(complex), stepped).imag / _STEP)
    return np.stack([*by_place[:_POSE], *by_lens], axis=2), np.stack(by_place[_POSE:], axis=2)


def _length_rows(simulated: Simulated, unknowns: _Unknowns) -> tuple[FloatArray | None, FloatArray | None]:
    """Rows (m, unknowns) of the scale bar's certified length in all its poses, made independent and of unit size.

    And the lengths' covariance (m,m) in mm^2; None without such a bar.

    The certificate errs alike in all poses, the thermometer anew in each.
    """
    scale = simulated.session.scale
    if scale is None or scale.kind != "bar":
        return None, None
    bar = next(bar for bar in simulated.session.bars if bar.id == scale.bar)
    marks = [mark.target for mark in bar.marks.values()]
    ends = []
    for i, pose in enumerate(simulated.session.bar_poses):
        own = simulated.features.placement == len(simulated.session.placements) + i
        found = [np.flatnonzero(own & unknowns.known & (simulated.features.target == mark)) for mark in marks]
        if pose.bar == bar.id and all(len(f) == 1 for f in found):
            ends.append([int(f[0]) for f in found])
    first, last = np.array(ends).T
    difference = simulated.places_mm[last] - simulated.places_mm[first]
    length = np.linalg.norm(difference, axis=1)
    along = (difference / length[:, None])[:, None]
    rows = (unknowns.by_places(last, along) - unknowns.by_places(first, along)).toarray()
    certificate = np.diag((bar.expansion_per_kelvin * length * THERMOMETER_SD_K) ** 2) + CERTIFICATE_SD_MM**2
    return np.linalg.solve(np.linalg.cholesky(certificate), rows), certificate


def _motions(simulated: Simulated, state: State, unknowns: _Unknowns) -> tuple[FloatArray, FloatArray]:
    """The seven motions that no image sees by all unknowns (u,7), and the conditions that the places do not move (u,7).

    Shifts, turns about the middle of the features' places and a stretch from there.
    """
    features = np.flatnonzero(unknowns.known)
    at = simulated.places_mm[features]
    middle = at.mean(axis=0)

    def field(x: FloatArray) -> FloatArray:
        """Velocities (n,3,7) of points (n,3)."""
        turns = np.stack([np.cross(axis, x - middle) for axis in np.eye(3)], axis=2)
        shifts = np.broadcast_to(np.eye(3), (len(x), 3, 3))
        return np.concatenate([shifts, turns, (x - middle)[:, :, None]], axis=2, dtype=np.float64)

    out = np.zeros((unknowns.count, 7))
    first_pose = unknowns.n_cameras * unknowns.width
    cameras = out[:first_pose].reshape(-1, unknowns.width, 7)
    seen = np.einsum("cij,j->ci", state.rotation, middle) + state.translation  # the middle in each camera
    for k in range(3):
        axis = state.rotation[:, :, k]
        cameras[:, 3:_POSE, k] = -axis
        cameras[:, :3, 3 + k] = -axis
        cameras[:, 3:_POSE, 3 + k] = np.cross(axis, seen)
    cameras[:, 3:_POSE, 6] = seen
    if len(state.placement_rotation):
        turn, shift = state.placement_rotation[1:], state.placement_translation[1:]
        poses = out[first_pose : unknowns.first_point].reshape(-1, _POSE, 7)
        poses[:, :3, 3:6] = np.eye(3) - turn  # the world turns, and the ball's frame with it
        # at the ball's origin: it goes where the field at T takes it, less what R makes of its own motion
        poses[:, 3:] = field(shift) - turn @ field(np.zeros((1, 3)))
    ball = np.full((unknowns.n_points, 3), np.nan)
    ball[unknowns.point[features]] = np.einsum("fji,fj->fi", unknowns.turn[features], unknowns.arm[features])
    out[unknowns.first_point :] = field(ball).reshape(-1, 7)
    moved = field(at)
    conditions = [unknowns.by_places(features, moved[:, None, :, k]).sum(axis=0) for k in range(7)]
    return out, np.stack(conditions, axis=1)


def _inner_inverse(normal: FloatArray, motions: FloatArray, conditions: FloatArray) -> FloatArray:
    """The inverse N^ with N^ N N^ = N^ and conditions' N^ = 0: (N + BB')^-1 - G (G'BB'G)^-1 G'."""
    scale = 1.0 / np.sqrt(np.diag(normal))
    conditions = conditions / np.linalg.norm(conditions * scale[:, None], axis=0)
    blind = np.abs(normal @ motions).max(axis=0) / (np.abs(normal) @ np.abs(motions)).max(axis=0)
    assert blind.max() < 1e-9, "these motions are seen after all"
    bordered = conditions * scale[:, None]
    matrix = normal * scale[:, None] * scale + bordered @ bordered.T
    potrf, potri = get_lapack_funcs(("potrf", "potri"), (matrix,))
    factor, failed = potrf(matrix, lower=1, overwrite_a=1)
    assert not failed
    inverse, failed = potri(factor, lower=1, overwrite_c=1)
    assert not failed
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    inverse *= scale[:, None]
    inverse *= scale
    across = conditions.T @ motions
    inverse -= motions @ np.linalg.inv(across.T @ across) @ motions.T
    return inverse


def _taken_back(covariance: FloatArray, motions: FloatArray, conditions: FloatArray) -> FloatArray:
    """S C S' with S = I - G (B'G)^-1 B': the covariance under the conditions, whatever it stood under before."""
    taken = np.linalg.solve(conditions.T @ motions, conditions.T @ covariance)
    half = covariance - motions @ taken
    return half - np.linalg.solve(conditions.T @ motions, conditions.T @ half.T).T @ motions.T


def bar_bound(simulated: Simulated, bars: Bars, dense: DenseNetwork) -> BarBound:
    """var(L) of every bar measured with the calibrated rig, by the scale that the calibration has."""
    by_scale, scale_noise = np.zeros(dense.unknowns.count), 0.0
    if not dense.with_lengths:
        by_scale, scale_noise = _scale_gradient(simulated, dense)
    width = dense.unknowns.width
    sigma = simulated.truth.sigma_px[bars.camera]
    ends = bars.study.ends_mm.reshape(-1, 3)
    by_camera, by_point = derivatives(dense.state, bars.camera, ends[bars.end], dense.columns)
    by_camera, by_point = by_camera / sigma[:, None, None], by_point / sigma[:, None, None]
    calibration, own = [], []
    for bar, length in enumerate(bars.lengths_mm):
        along = (ends[2 * bar + 1] - ends[2 * bar]) / length
        gradient, noise = np.zeros(dense.unknowns.count), 0.0
        for end, sign in ((2 * bar, -1.0), (2 * bar + 1, 1.0)):
            rows = np.flatnonzero(bars.end == end)
            normal = np.einsum("nki,nkj->ij", by_point[rows], by_point[rows])
            pull = np.linalg.solve(normal, along)
            noise += along @ pull
            for row in rows:
                column = bars.camera[row] * width
                gradient[column : column + width] -= sign * (by_point[row] @ pull) @ by_camera[row]
        gradient = gradient / length - by_scale
        both = gradient @ dense.covariance @ gradient * length**2
        calibration.append(both - scale_noise * length**2)
        own.append(noise)
    return BarBound(np.array(calibration), np.array(own), scale_noise * bars.lengths_mm**2)


def _scale_gradient(simulated: Simulated, dense: DenseNetwork) -> tuple[FloatArray, float]:
    """Derivative of ln(mean size of the stickers) by all unknowns (u,), and its variance by the points' own noise.

    A sticker's size is that of the similarity between its dots and its printed pattern: d ln s = sum x . dx / sum x^2
    with x from the dots' middle. A sticker of the rigid ball counts once, however many placements show it.
    """
    gradient = np.zeros((len(dense.known), 3))
    rows, variances = [], []
    for own in _stickers(simulated, dense):
        x = dense.places_mm[own] - dense.places_mm[own].mean(axis=0)
        by_dot = x / (x**2).sum()
        rows.append((own, by_dot))
        variances.append(float(np.einsum("ni,nij,nj->", by_dot, dense.point_noise[own], by_dot)))
    weight = 1.0 / np.array(variances)
    weight /= weight.sum()
    for (own, by_dot), share in zip(rows, weight, strict=True):
        gradient[own] += share * by_dot
    features = np.flatnonzero(dense.known)
    by_unknown = dense.unknowns.by_places(features, gradient[features][:, None]).sum(axis=0)
    return np.asarray(by_unknown), float(weight**2 @ np.array(variances))


def _stickers(simulated: Simulated, dense: DenseNetwork) -> list[IntArray]:
    """Features of the dots of every sticker that gives the scale: with both of the spacing's dots, or four and more."""
    scale, features, names = simulated.session.scale, simulated.features, simulated.observations.points
    assert scale is not None and scale.from_point is not None and scale.to_point is not None
    ends = [names.index(scale.from_point), names.index(scale.to_point)]
    known = np.flatnonzero(dense.known)
    keys = np.stack([features.placement[known], features.target[known]], axis=1)
    found = [known[(keys == key).all(axis=1)] for key in np.unique(keys, axis=0)]
    found = [own for own in found if len(own) >= _LEAST_DOTS or np.isin(ends, features.point[own]).all()]
    taken: set[int] = set()
    out = []
    for own in sorted(found, key=len, reverse=True):
        dots = set(dense.unknowns.point[own].tolist())
        if not dots & taken:
            out.append(own)
        taken |= dots
    return out
