"""The columns of the unknowns in the reduced system, and how the engine's expanded system is folded into it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from spherecal.base.arrays import FloatArray, IntArray

POSE = 6  # columns of a pose: rotation, then shift (docs/conventions.md)


@dataclass(frozen=True)
class Layout:
    """The columns of each block in the expanded system, and how that is folded into the reduced one.

    `block_offset`, `block_width`: `n_cameras` cameras first, then placements, then kept points. `column` (expanded,) is
    the reduced column or -1 where nothing is estimated. Prior rows: reduced column, camera and intrinsic of each.
    """

    n_cameras: int
    block_offset: IntArray
    block_width: IntArray
    expanded: int
    size: int
    column: IntArray
    prior_columns: IntArray
    prior_camera: IntArray
    prior_intrinsic: IntArray

    @cached_property
    def _fold(self) -> sparse.csr_array:
        used = np.flatnonzero(self.column >= 0)
        return sparse.csr_array((np.ones(len(used)), (self.column[used], used)), shape=(self.size, self.expanded))

    @cached_property
    def _first(self) -> IntArray | None:
        """The first expanded column of each reduced one (d,), where that keeps their order."""
        used = np.flatnonzero(self.column >= 0)
        first = used[np.unique(self.column[used], return_index=True)[1]]
        return first if (np.diff(first) > 0).all() else None  # another order would mix the two triangles

    @property
    def _intrinsics(self) -> IntArray:
        """The reduced columns of each camera's intrinsics (c,i)."""
        width = int(self.block_width[0]) if self.n_cameras else POSE
        return self.column[: self.n_cameras * width].reshape(self.n_cameras, width)[:, POSE:]

    @cached_property
    def lens_owner(self) -> IntArray:
        """For each camera (c,) the first camera with the same unknown intrinsics; itself if no other shares them."""
        intrinsics = self._intrinsics
        _, first, same = np.unique(intrinsics, axis=0, return_index=True, return_inverse=True)
        return np.where((intrinsics >= 0).any(axis=1), first[same.reshape(-1)], np.arange(self.n_cameras))

    @cached_property
    def _share_all(self) -> bool:
        """Whether cameras that share an intrinsic share all, so that one camera can keep the lens for all."""
        own = self._intrinsics[np.unique(self.lens_owner)]
        used = own[own >= 0]
        return len(np.unique(used)) == len(used)

    def fold_matrix(self, expanded: FloatArray, is_gathered: bool = False) -> FloatArray:
        """The reduced matrix (d,d) of the expanded one (e,e); of both the upper (block) triangle is valid."""
        none_shared = np.count_nonzero(self.column >= 0) == self.size  # so that folding is mere selection
        if self._first is not None and (none_shared or (is_gathered and self._share_all)):
            return expanded if self.size == self.expanded else expanded[np.ix_(self._first, self._first)]
        half = self._fold @ symmetric(expanded)
        return np.asarray((self._fold @ half.T).T)

    def fold_vector(self, expanded: FloatArray) -> FloatArray:
        """The reduced vector (d,) from the expanded one."""
        return self._fold @ expanded

    def expanded_rows(self, reduced: FloatArray) -> FloatArray:
        """A reduced vector (d,) or matrix (d, m) expanded to rows (e,) or (e, m); zero where nothing is estimated."""
        return np.concatenate([reduced, np.zeros((1, *reduced.shape[1:]))])[self.column]


def symmetric(upper: FloatArray) -> FloatArray:
    """The symmetric matrix of which only the upper triangle is valid."""
    full = np.triu(upper)
    full += np.triu(upper, 1).T
    return full
