"""Covariance factors of a deformable ball.

A feature's place is x = R S + T + e. Its error has three sources that do not depend on each other. These are the
columns of the reduced system, the dots' own noise V^-1, and the noise Q of the shape noise that their images leave.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from spherecal.adjust.covariance_factors import Covariance, Inverted, add_products, moments_of
from spherecal.adjust.datum import Places, carried_dots
from spherecal.adjust.deformable import shape_noise_matrices, shape_noise_of
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.rotation import cross_matrix

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
