"""The correction field of a lens: what its images are off the lens model, as a smooth random function of the pixel.

`uv - F(uv)` is where the lens model predicts the measured pixel `uv`. F is a Gaussian process with squared-exponential
covariance over the part of the image where points are, written in its eigenfunctions (Karhunen-Loeve; C. Rasmussen and
C. Williams, Gaussian Processes for Machine Learning, 2006, 4.3), each scaled so that its coefficient has the field's
standard deviation. What the lens model or a turn of the camera can do there as well is taken out, so that the field
says only what they cannot.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.geometry.camera import project_with_derivatives, undistort
from spherecal.geometry.rotation import cross_matrix

# Correlation length over half the region's longer side. 0.8 is too stiff (rig A, 0.1 px: 35 um against 18); 0.3 and 0.5
# differ by less than a tenth, and 0.5 needs half the coefficients.
LENGTH = 0.5
_NODES = 40  # of the quadrature along an axis
_CELL = 0.1  # of the length: points so near each other count as one, with less noise
_GRID = 14  # points along each axis at which the lens model's own derivatives are compared


@dataclass(frozen=True)
class FieldBasis:
    """The functions (m of them) of one lens' field over a region of the image: products of functions along its axes.

    `low`, `size` (2,) px: the region's first corner and its sides; beyond it the functions go to 0.
    `nodes` (2,k): of the quadrature, from -1 to 1; `along_u, along_v` (k,a) and (k,b): the axes' functions at these;
    `pairs` (s,2): which of them each product has; `mixture` (2s,m): of products by both coordinates.
    """

    low: FloatArray
    size: FloatArray
    nodes: FloatArray
    along_u: FloatArray
    along_v: FloatArray
    lengths: FloatArray
    pairs: np.ndarray
    mixture: FloatArray

    @property
    def count(self) -> int:
        """How many coefficients the field has."""
        return self.mixture.shape[1]

    def scalars(self, uv: FloatArray) -> FloatArray:
        """The products (n,s) at pixels (n,2), as they are for each coordinate."""
        at = 2 * (uv - self.low) / self.size - 1
        u, v = (
            np.exp(-0.5 * ((at[:, k, None] - self.nodes[k]) / self.lengths[k]) ** 2) @ along
            for k, along in enumerate((self.along_u, self.along_v))
        )
        return u[:, self.pairs[:, 0]] * v[:, self.pairs[:, 1]]

    def at(self, uv: FloatArray) -> FloatArray:
        """The functions (n,2,m) px at pixels (n,2)."""
        scalars = self.scalars(uv)
        s = scalars.shape[1]
        return np.stack([scalars @ self.mixture[:s], scalars @ self.mixture[s:]], axis=1)


def field_basis(
    low: FloatArray, size: FloatArray, intrinsics: FloatArray, free: BoolArray, most: int, least_share: float
) -> FieldBasis:
    """The basis of a lens' field, at most `most` functions a coordinate, without what the lens model itself can do.

    `low`, `size` (2,) px: the region where points are; `intrinsics` (16,), and which of them the lens model has, (16,);
    `least_share`: of the variance, below which functions are left out.
    """
    half = size / size.max()
    lengths = LENGTH / half
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    shares, functions = zip(*(_eigenfunctions(nodes, weights / 2, length) for length in lengths), strict=True)
    product = np.outer(*shares)
    order = np.argsort(-product, axis=None, kind="stable")[:most]
    order = order[product.ravel()[order] >= least_share]
    pairs = np.stack(np.unravel_index(order, product.shape), axis=1)
    along_u, along_v = functions
    both = np.stack([nodes, nodes])
    plain = FieldBasis(low, size, both, along_u, along_v, lengths, pairs, np.eye(2 * len(pairs)))
    across = (np.stack(np.meshgrid(*[np.arange(_GRID)] * 2), axis=-1).reshape(-1, 2) + 0.5) / _GRID * size + low
    own = _lens_and_turns(across, intrinsics, free)
    seen = np.isfinite(own).all(axis=(1, 2))
    if not seen.any():  # no lens of this kind has an image there: nothing to take out
        return plain
    own, values = own[seen].reshape(2 * int(seen.sum()), -1), plain.at(across[seen]).reshape(2 * int(seen.sum()), -1)
    basis = np.linalg.svd(own / np.linalg.norm(own, axis=0).clip(min=1e-30), full_matrices=False)
    held = basis[0][:, basis[1] > 1e-6 * basis[1][0]].T @ values
    mixture = np.linalg.svd(held)[2][len(held) :].T
    return replace(plain, mixture=mixture)


def _eigenfunctions(nodes: FloatArray, weights: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
    """Shares (k,) of the variance by the eigenfunctions along an axis, and the functions scaled by them (k,k).

    The latter multiply the covariance with each node (Nystroem).
    """
    covariance = np.exp(-0.5 * ((nodes[:, None] - nodes) / length) ** 2)
    root = np.sqrt(weights)
    values, vectors = np.linalg.eigh(root[:, None] * covariance * root)
    values, vectors = values[::-1].clip(min=1e-12), vectors[:, ::-1]
    return values, root[:, None] * vectors / np.sqrt(values)


def _lens_and_turns(uv: FloatArray, intrinsics: FloatArray, free: BoolArray) -> FloatArray:
    """Derivatives (n,2,k) of pixels (n,2) by the lens model's parameters and by turns of the camera; NaN beyond it."""
    xy, _ = undistort(uv, intrinsics)
    rays = np.column_stack([xy, np.ones(len(xy))])
    _, by_point, by_lens = project_with_derivatives(rays, intrinsics)
    return np.concatenate([by_lens[:, :, free], -by_point @ cross_matrix(rays)], axis=2)


def left_unknown(nodes: FloatArray, size: FloatArray, seen: FloatArray, noise: float) -> FloatArray:
    """Standard deviation (n,) at pixels nodes (n,2) of a field of amplitude 1 that is known at pixels seen (k,2).

    By Matern's covariance (5/2) with the field's length: a squared-exponential process has all derivatives, and claims
    to go on beyond the last point as it was before it. A tenth of the image beyond the last points errors were 1.6
    times their standard uncertainties (rms of five recordings), 2.3 at a fifth.

    `size` (2,) px: of the field's region; `noise`: of a point, in units of the amplitude.
    """
    length = LENGTH * size.max() / 2
    cell = _CELL * length
    cells, which, count = np.unique(np.floor(seen / cell).astype(int), axis=0, return_inverse=True, return_counts=True)
    middles = np.stack([np.bincount(which.ravel(), along) for along in seen.T], axis=1) / count[:, None]

    def covariance(a: FloatArray, b: FloatArray) -> FloatArray:
        away = cdist(a, b) * (np.sqrt(5.0) / length)
        return (1 + away + away**2 / 3) * np.exp(-away)

    known = covariance(middles, middles)
    known[np.diag_indices(len(cells))] += noise**2 / count
    across = solve_triangular(np.linalg.cholesky(known), covariance(middles, nodes), lower=True, check_finite=False)
    return np.sqrt(np.maximum(1.0 - (across**2).sum(axis=0), 0.0))


def beyond_lens(values: FloatArray, uv: FloatArray, intrinsics: FloatArray, free: BoolArray) -> FloatArray:
    """What neither the lens model (free parameters (16,)) nor a turn can do of values (n,2) px at pixels uv (n,2)."""
    return values - _of_lens_and_turns(values, uv, intrinsics, free)[1]


def lens_and_turns_in(
    values: FloatArray, uv: FloatArray, intrinsics: FloatArray, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """The change (16,) of the lens model's free parameters and the turn (3,) rad nearest to values (n,2) px."""
    taken = _of_lens_and_turns(values, uv, intrinsics, free)[0]
    lens = np.zeros(len(free))
    lens[free] = taken[:-3]
    return lens, taken[-3:]


def _of_lens_and_turns(
    values: FloatArray, uv: FloatArray, intrinsics: FloatArray, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """The free parameters and turns nearest to values (n,2) px, (k+3,), and what they do of these, (n,2) px."""
    own = _lens_and_turns(uv, intrinsics, free)
    seen = np.isfinite(own).all(axis=(1, 2))
    design = own[seen].reshape(2 * int(seen.sum()), -1)
    size = np.linalg.norm(design, axis=0).clip(min=1e-30)
    taken = np.linalg.lstsq(design / size, values[seen].ravel(), rcond=1e-6)[0] / size
    part = np.zeros_like(values)
    part[seen] = (design @ taken).reshape(-1, 2)
    return taken, part
