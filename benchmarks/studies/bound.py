"""The Cramer-Rao bound by brute force, independently of the adjustment's own covariance.

Derivatives are taken by complex steps through the projection, the whole normal matrix (cameras and points) is set up
and inverted densely; nothing of `spherecal.adjust` takes part but the containers.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import lapack

from benchmarks.studies.simulated import Bars, Simulated
from spherecal.adjust.problem import State
from spherecal.arrays import FloatArray, IntArray
from spherecal.geometry.camera import project

_STEP = 1e-100  # of a complex step: no subtraction, no rounding
_POSE = 6


@dataclass(frozen=True)
class BarBound:
    """Variances (n,) mm^2 of the bars' lengths: by the cameras' errors, the bars' own noise, the noise of the scale."""

    calibration: FloatArray
    own: FloatArray
    scale: FloatArray

    @property
    def total(self) -> FloatArray:
        """The bound, (n,) mm^2."""
        return self.calibration + self.own + self.scale


@dataclass(frozen=True)
class DenseNetwork:
    """Covariance (u, u) of cameras (width parameters each), then the `points` (indices of features), datum: the points.

    `point_noise` (p, 3, 3): the points' covariance with the cameras known.
    """

    state: State
    columns: IntArray
    width: int
    points: IntArray
    covariance: FloatArray
    point_noise: FloatArray

    def camera_sd(self) -> FloatArray:
        """Standard deviations (c, width)."""
        n = len(self.state.rotation) * self.width
        return np.sqrt(np.diag(self.covariance)[:n]).reshape(-1, self.width)

    def point_sd(self) -> FloatArray:
        """Standard deviations (p, 3)."""
        n = len(self.state.rotation) * self.width
        return np.sqrt(np.diag(self.covariance)[n:]).reshape(-1, 3)


def dense_network(simulated: Simulated) -> DenseNetwork:
    """The covariance at the truth, all of it."""
    network, state, use = simulated.network, simulated.true, simulated.usable
    camera, feature = network.camera[use], network.feature[use]
    columns = np.flatnonzero(network.free[0])
    assert (network.free == network.free[0]).all() and len(np.unique(network.group)) == len(network.group)
    points, index = np.unique(feature, return_inverse=True)
    by_camera, by_point = derivatives(state, camera, state.points[feature], columns)
    weight = 1.0 / simulated.truth.sigma_px[camera][:, None, None]
    by_camera, by_point = by_camera * weight, by_point * weight
    width, n_cameras = by_camera.shape[2], len(network.group)
    first_point = n_cameras * width
    row = np.arange(2 * len(camera)).reshape(-1, 2, 1)
    parts = (
        (by_camera, (camera * width)[:, None, None] + np.arange(width)),
        (by_point, (first_point + 3 * index)[:, None, None] + np.arange(3)),
    )
    row_index = np.concatenate([np.broadcast_to(row, values.shape).ravel() for values, _ in parts])
    column_index = np.concatenate([np.broadcast_to(where, values.shape).ravel() for values, where in parts])
    values = np.concatenate([values.ravel() for values, _ in parts])
    jacobian = sparse.csr_array((values, (row_index, column_index)), shape=(row.size, first_point + 3 * len(points)))
    normal = (jacobian.T @ jacobian).toarray()
    own = np.arange(len(points))[:, None, None] * 3 + first_point
    blocks = normal[own + np.arange(3)[:, None], own + np.arange(3)]
    motions = _motions(state, state.points[points], width)
    covariance = _inner_inverse(normal, motions, first_point)
    return DenseNetwork(state, columns, width, points, covariance, np.linalg.inv(blocks))


def derivatives(
    state: State, camera: IntArray, points: FloatArray, columns: IntArray
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Derivatives of image points by pose and intrinsics (n, 2, 6 + k) and by the point (n, 2, 3)."""
    rotation, intrinsics = state.rotation[camera], state.intrinsics[camera].astype(complex)
    x = np.einsum("nij,nj->ni", rotation, points) + state.translation[camera]
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


def _motions(state: State, points: FloatArray, width: int) -> FloatArray:
    """The seven motions that no image sees, (u, 7): shifts, turns and a stretch of everything."""
    middle = points.mean(axis=0)
    out = np.zeros((len(state.rotation) * width + 3 * len(points), 7))
    cameras, of_points = out[: len(state.rotation) * width].reshape(-1, width, 7), out[len(state.rotation) * width :]
    of_points = of_points.reshape(-1, 3, 7)
    seen = np.einsum("cij,j->ci", state.rotation, middle) + state.translation  # the middle in each camera
    for k in range(3):
        axis = state.rotation[:, :, k]
        of_points[:, k, k] = 1.0
        cameras[:, 3:_POSE, k] = -axis
        of_points[:, :, 3 + k] = np.cross(np.eye(3)[k], points - middle)
        cameras[:, :3, 3 + k] = -axis
        cameras[:, 3:_POSE, 3 + k] = np.cross(axis, seen)
    of_points[:, :, 6] = points - middle
    cameras[:, 3:_POSE, 6] = seen
    return out


def _inner_inverse(normal: FloatArray, motions: FloatArray, first_point: int) -> FloatArray:
    """The inverse under the conditions that the points as a whole do not move: (N + BB')^-1 - G (G'BB'G)^-1 G'."""
    scale = 1.0 / np.sqrt(np.diag(normal))
    conditions = motions.copy()
    conditions[:first_point] = 0.0
    conditions /= np.linalg.norm(conditions * scale[:, None], axis=0)
    blind = np.abs(normal @ motions).max(axis=0) / (np.abs(normal) @ np.abs(motions)).max(axis=0)
    assert blind.max() < 1e-9, "these motions are seen after all"
    bordered = conditions * scale[:, None]
    matrix = normal * scale[:, None] * scale + bordered @ bordered.T
    factor, failed = lapack.dpotrf(matrix, lower=1, overwrite_a=1)
    assert not failed
    inverse, failed = lapack.dpotri(factor, lower=1, overwrite_c=1)
    assert not failed
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    inverse *= scale[:, None]
    inverse *= scale
    across = conditions.T @ motions
    inverse -= motions @ np.linalg.inv(across.T @ across) @ motions.T
    return inverse


def bar_bound(simulated: Simulated, bars: Bars, dense: DenseNetwork) -> BarBound:
    """var(L) of every bar measured with the calibrated rig, the scale taken from the weighted A-E distances."""
    by_scale, scale_noise = _scale_gradient(simulated, dense)
    camera_columns = len(dense.state.rotation) * dense.width
    sigma = simulated.truth.sigma_px[bars.camera]
    ends = bars.study.ends_mm.reshape(-1, 3)
    by_camera, by_point = derivatives(dense.state, bars.camera, ends[bars.end], dense.columns)
    by_camera, by_point = by_camera / sigma[:, None, None], by_point / sigma[:, None, None]
    calibration, own = [], []
    for bar, length in enumerate(bars.lengths_mm):
        along = (ends[2 * bar + 1] - ends[2 * bar]) / length
        gradient, noise = np.zeros(len(dense.covariance)), 0.0
        for end, sign in ((2 * bar, -1.0), (2 * bar + 1, 1.0)):
            rows = np.flatnonzero(bars.end == end)
            normal = np.einsum("nki,nkj->ij", by_point[rows], by_point[rows])
            pull = np.linalg.solve(normal, along)
            noise += along @ pull
            for row in rows:
                column = bars.camera[row] * dense.width
                gradient[column : column + dense.width] -= sign * (by_point[row] @ pull) @ by_camera[row]
        gradient = gradient / length - by_scale
        both = gradient @ dense.covariance @ gradient * length**2
        calibration.append(both - scale_noise * length**2)
        own.append(noise)
    assert (by_scale[:camera_columns] == 0).all()
    return BarBound(np.array(calibration), np.array(own), scale_noise * bars.lengths_mm**2)


def _scale_gradient(simulated: Simulated, dense: DenseNetwork) -> tuple[FloatArray, float]:
    """Derivative of ln(mean A-E distance) by all unknowns (u,), and its variance by the points' own noise."""
    scale, features, names = simulated.session.scale, simulated.features, simulated.observations.points
    assert scale is not None and scale.from_point is not None and scale.to_point is not None
    number = np.full(len(features), -1)
    number[dense.points] = np.arange(len(dense.points))
    place = {
        (features.placement[f], features.target[f], features.point[f]): number[f] for f in dense.points
    }  # fmt: skip
    start, end = names.index(scale.from_point), names.index(scale.to_point)
    pairs = [(i, place[p, t, end]) for (p, t, name), i in place.items() if name == start and (p, t, end) in place]
    first, second = np.array(pairs).T
    x = dense.state.points[dense.points]
    difference = x[second] - x[first]
    length = np.linalg.norm(difference, axis=1)
    along = difference / length[:, None]
    noise = dense.point_noise[first] + dense.point_noise[second]
    relative_variance = np.einsum("ni,nij,nj->n", along, noise, along) / length**2
    weight = 1.0 / relative_variance
    weight /= weight.sum()
    gradient = np.zeros(len(dense.covariance))
    of_points = gradient[len(dense.state.rotation) * dense.width :].reshape(-1, 3)
    share = (weight / length)[:, None] * along
    np.add.at(of_points, second, share)
    np.add.at(of_points, first, -share)
    return gradient, float(weight**2 @ relative_variance)
