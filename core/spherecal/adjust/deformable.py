"""The deformable ball: it keeps its shape but for shape noise, X = R_t S + T_t + e with e ~ N(0, tau^2) per coordinate.

It is between the free form (tau infinite) and the rigid one (tau 0). It is solved as the rigid form whose observations
of one dot at one placement have the dot's shape noise in common as an error (generalised least squares; A. C. Aitken,
1936): `deformable_kernel`. So no step depends on where the points are off the shape. Ties do not shrink the network,
whose size nothing else fixes.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable
from spherecal.adjust.covariance_factors import Covariance, Inverted, add_products, moments_of
from spherecal.adjust.datum import Places, carried_dots
from spherecal.adjust.linear import Linear, Reduced
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray, sum_by
from spherecal.geometry.rotation import cross_matrix

# Below, the seven motions that no observation sees would wander; 1e-7 of a diagonal slows nothing else down.
LEAST_DAMPING = 1e-7


@dataclass(frozen=True)
class ShapeNoise:
    """The part of the observations that the shape noise absorbs at a linearisation, in the ball's frame.

    Group g are the observations of one dot at one placement: rows from `start[g]` (g + 1,) on. `of` (n,) is the group
    of each row, `place` (g,) its number among the places, `dot` and `placement` (g,) what it is. `normal` (g,3,3) is V,
    `q` = tau^2 (I + tau^2 V)^-1, `p` = I - Q V.
    """

    problem: Problem
    linear: Linear
    start: IntArray
    of: IntArray
    place: IntArray
    dot: IntArray
    placement: IntArray
    normal: FloatArray
    q: FloatArray
    p: FloatArray

    def pulled(self, residual: FloatArray) -> FloatArray:
        """J'r (g,3) of every group, from residuals (n,2)."""
        return _summed(np.einsum("nki,nk->ni", self.linear.at(slice(None)).by_point, residual), self.start)

    def taken(self, residual: FloatArray) -> float:
        """The reduction of the squares of residuals (n,2) by the shape noise: r'J Q J'r."""
        if not len(self.start):
            return 0.0
        b = self.pulled(residual)
        return float(np.einsum("gi,gij,gj->", b, self.q, b))

    def back_substitute(self, reduced: Reduced, step: FloatArray) -> tuple[FloatArray, float]:
        """As `engine.back_substitute`, with what the shape noise takes off the squares."""
        problem = self.problem
        if not isinstance(problem.ball, Deformable):
            return engine.back_substitute(problem, self.linear, reduced, step)
        linear, kept = self.linear.at(slice(None)), problem.kept_points
        steps = np.split(step, [problem.n_cameras * linear.width, len(step) - 3 * len(kept)])
        change = np.einsum("nkw,nw->nk", linear.by_camera, steps[0].reshape(-1, linear.width)[problem.camera])
        change += np.einsum("nkw,nw->nk", linear.by_placement, steps[1].reshape(-1, POSE)[problem.ball.placement])
        pull = sum_by(self.dot, np.einsum("gij,gj->gi", self.p, self.pulled(change)), problem.n_points)
        point_step = -np.einsum("pij,pj->pi", reduced.point_inverse, reduced.point_gradient + pull)  # kept points: 0
        whole = point_step.copy()
        whole[kept] = steps[2].reshape(-1, 3)
        after = linear.residual + change + np.einsum("nki,ni->nk", linear.by_point, whole[problem.point])
        return point_step, 0.5 * (float((after**2).sum()) - self.taken(after))

    def shape_residual(self, state: State) -> FloatArray:
        """Deviations (f,3) of the places from the shape, in the world; 0 where nothing is observed."""
        out = np.zeros((len(self.problem.ball.shape_sd), 3))
        off = np.einsum("gij,gj->gi", self.q, self.pulled(self.linear.residual))
        out[self.place] = -np.einsum("gij,gj->gi", state.placement_rotation[self.placement], off)
        return out


def shape_noise_of(problem: Problem, linear: Linear) -> ShapeNoise:
    """The shape noise of a deformable ball's places at a linearisation; no groups for any other ball."""
    if not isinstance(problem.ball, Deformable):
        none, matrices = np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3))
        return ShapeNoise(problem, linear, none, none, none, none, none, matrices, matrices, matrices)
    of_row = problem.ball.place
    is_first = (np.diff(of_row, prepend=-1) != 0) | (np.diff(problem.point, prepend=-1) != 0)
    first = np.flatnonzero(is_first)
    start = np.append(first, len(problem.uv))
    by_point = linear.at(slice(None)).by_point
    normal = _summed(np.einsum("nki,nkj->nij", by_point, by_point), start)
    group, place = np.cumsum(is_first) - 1, of_row[first]
    dot, placement = problem.point[first], problem.placement[first]
    q, p = shape_noise_matrices(normal, problem.ball.shape_sd[place])
    return ShapeNoise(problem, linear, start, group, place, dot, placement, normal, q, p)


def _summed(values: FloatArray, start: IntArray) -> FloatArray:
    """Sums (g, ...) of values (n, ...) over groups of rows."""
    return np.add.reduceat(values, start[:-1], axis=0) if len(values) else values[:0]


def shape_noise_matrices(normal: FloatArray, shape_sd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Q = tau^2 (I + tau^2 V)^-1 and I - Q V = (I + tau^2 V)^-1, (g,3,3) each; `shape_sd` is tau (g,)."""
    variance = (shape_sd**2)[:, None, None]
    p = np.linalg.inv(np.eye(3) + variance * normal)
    p = 0.5 * (p + p.transpose(0, 2, 1))
    return variance * p, p


def left_over(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """Residuals (n,2) that the shape noise leaves; how much of each observation's rows its own point absorbs (n,)."""
    linear = engine.linearise(problem, state, None)
    shape = shape_noise_of(problem, linear)
    off = np.einsum("gij,gj->gi", shape.q, shape.pulled(linear.residual))
    normal = sum_by(shape.dot, shape.p @ shape.normal, problem.n_points)
    noise = shape.q + shape.p @ np.linalg.pinv(normal, hermitian=True)[shape.dot] @ shape.p.transpose(0, 2, 1)
    taken = np.einsum("nki,nij,nkj->n", linear.by_point, noise[shape.of], linear.by_point)
    return linear.residual - np.einsum("nki,ni->nk", linear.by_point, off[shape.of]), taken


# --- covariance factors of a deformable ball -------------------------------------------------------------------------
#
# A feature's place is x = R S + T + e. Its error has three sources that do not depend on each other. These are the
# columns of the reduced system, the dots' own noise V^-1, and the noise Q of the shape noise that their images leave.

# Features whose places are worked on at a time: 1500 rows of up to 2,000 columns are 24 MB.
_CHUNK = 500


@dataclass(frozen=True)
class DeformableFactors(Covariance):
    """Pieces of the covariance; the noise sources (p + f, 3) are the dots, then the features' shape noise.

    `by_columns` (3f,e): places by columns, `by_dots` (3f,3p): places by the dots' own noise; `through` (f,3,3): its
    blocks.
    """

    through: FloatArray
    by_columns: sparse.csr_array
    by_dots: sparse.csr_array

    @cached_property
    def own_noise(self) -> FloatArray:
        """The features' own image noise (f,3,3), without the cameras' share."""
        assert self.places is not None
        p, through = self.problem.n_points, self.through
        return through @ self.point_inverse[:p][self.places.point] @ through.transpose(0, 2, 1) + self.point_inverse[p:]

    @property
    def point_of_feature(self) -> IntArray:
        """A number (f,) for each feature, its own where it has shape noise: it contains more than its dot alone."""
        assert self.places is not None
        count = len(self.places.point)
        return np.where(self.problem.ball.shape_sd > 0, self.problem.n_points + np.arange(count), self.places.point)

    def transformed(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A gradient by places (f,3) in the datum, by columns (e,) and by the noise sources (p + f,3)."""
        left = np.einsum("fi,fig->g", gradient, self.motions.places) @ self.moments
        by_noise = _by_noise(self.by_dots, gradient) - self.datum_points @ left
        return gradient.ravel() @ self.by_columns - left @ self.gauge_rows, by_noise

    @cached_property
    def gauge_rows(self) -> FloatArray:
        """The datum's conditions by columns, (g,e)."""
        flat = self.motions.places.reshape(3 * len(self.motions.places), self.motions.places.shape[2])
        return np.asarray(self.by_columns.T @ flat).T

    def place_cofactors(self) -> FloatArray:
        """Cofactors (f,3,3) of the features' places in the datum; NaN where one is not used."""
        out = self.own_noise.copy()
        p, count, g = self.problem.n_points, len(out), self.moments.shape[0]
        gauge_cross = np.asarray(self.by_columns @ self.gauge_cross).reshape(count, 3, g)
        dots = (self.point_inverse[:p] @ self.datum_points[:p]).reshape(3 * p, g)
        gauge_cross += np.asarray(self.by_dots @ dots).reshape(count, 3, g)
        gauge_cross += self.point_inverse[p:] @ self.datum_points[p:]
        add_products(out, self.by_columns, self.inverse, _CHUNK)
        self.take_back(out, gauge_cross)
        out[~self.is_located] = np.nan
        return out


def deformable_factors(inverted: Inverted, state: State, places: Places) -> DeformableFactors:
    """The factors of a network with a deformable ball, whose features are at `places`."""
    problem, motions, dot_inverse = inverted.problem, inverted.motions, inverted.point_inverse
    linear = inverted.linear.at(slice(None))
    shape = shape_noise_of(problem, linear)
    count, p, columns = len(places.point), problem.n_points, problem.layout.expanded
    rotation, lever_arm = carried_dots(state, places)
    normal, own = np.zeros((count, 3, 3)), rotation[shape.place]
    normal[shape.place] = own @ shape.normal @ own.transpose(0, 2, 1)
    q, through = shape_noise_matrices(normal, problem.ball.shape_sd)
    start = int(problem.layout.block_offset[problem.n_cameras])
    pose = np.concatenate([-cross_matrix(lever_arm), np.broadcast_to(np.eye(3), (count, 3, 3))], axis=2)
    of_pose = start + POSE * places.placement
    by_pose = _blocks(np.arange(count), of_pose, pose, (3 * count, columns))
    by_images = linear.by_placement[:, :, 3:].transpose(0, 2, 1) @ linear.by_camera
    met = _blocks(problem.ball.place, problem.layout.block_offset[problem.camera], by_images, (3 * count, columns))
    met += _blocks(np.arange(count), of_pose, normal @ pose, (3 * count, columns))
    through = through @ rotation
    through_dots = _blocks(np.arange(count), 3 * places.point, through, (3 * count, 3 * p))
    dots = -(_diagonal(dot_inverse) @ (through_dots.T @ met))
    kept = problem.kept_points
    first = columns - 3 * len(kept)
    dots += _blocks(kept, first + 3 * np.arange(len(kept)), np.tile(np.eye(3), (len(kept), 1, 1)), dots.shape)
    by_columns = (by_pose - _diagonal(q) @ met + through_dots @ dots).tocsr()
    g = motions.columns.shape[1]
    datum = np.zeros((p + count, 3, g))
    for k in range(g):
        datum[:, :, k] = _by_noise(through_dots, motions.places[:, :, k])
    return DeformableFactors(
        **vars(inverted) | {"linear": linear, "point_inverse": np.concatenate([dot_inverse, q])},
        places=places,
        rotation=rotation,
        lever_arm=lever_arm,
        datum_points=datum,
        datum_columns=np.zeros((columns, g)),
        moments=moments_of(motions.places),
        through=through,
        by_columns=by_columns,
        by_dots=through_dots,
    )


def _blocks(feature: np.ndarray, first: np.ndarray, values: FloatArray, shape: tuple[int, int]) -> sparse.csr_array:
    """Blocks (m,3,w) put at the features' three rows and from column `first` (m,) on; blocks at one place add up."""
    rows = np.broadcast_to((3 * feature[:, None] + np.arange(3))[:, :, None], values.shape)
    columns = np.broadcast_to((first[:, None] + np.arange(values.shape[2]))[:, None, :], values.shape)
    return sparse.csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape)


def _diagonal(blocks: FloatArray) -> sparse.csr_array:
    n = len(blocks)
    return sparse.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n)).tocsr()


def _by_noise(by_dots: sparse.csr_array, gradient: FloatArray) -> FloatArray:
    """A gradient by places (f,3) as one by the noise sources (p + f,3)."""
    return np.concatenate([(gradient.ravel() @ by_dots).reshape(-1, 3), gradient])
