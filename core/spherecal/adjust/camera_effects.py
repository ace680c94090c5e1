"""Fields of lenses and motions of images: what the cameras do beyond the lens model and one pose each."""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust.lens_field import FieldBasis
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.rotation import exp_rotation

FIELD, MOTION = 0, 1  # kinds of effects
TURN = 3  # columns of a motion


@dataclass(frozen=True)
class Design:
    """The effects that a network may have: fields of lenses, then turns of images, as columns.

    `basis`: of each lens' field, None where it has none; `lens` (c,): which is each camera's; `field_start`
    (lenses + 1,): first columns; `camera_of_image` and `placement_of_image` (i,), sorted.
    """

    basis: tuple[FieldBasis | None, ...]
    lens: IntArray
    field_start: IntArray
    camera_of_image: IntArray
    placement_of_image: IntArray

    @property
    def n_fields(self) -> int:
        """Columns of the fields, the first ones."""
        return int(self.field_start[-1])

    @property
    def count(self) -> int:
        """All columns."""
        return self.n_fields + TURN * len(self.camera_of_image)

    @property
    def part(self) -> IntArray:
        """The part of each column: lenses, then cameras that turn."""
        fields = np.repeat(np.arange(len(self.basis)), np.diff(self.field_start))
        return np.concatenate([fields, len(self.basis) + np.repeat(self.camera_of_image, TURN)])

    @property
    def kind(self) -> IntArray:
        """The kind of each part."""
        return np.repeat([FIELD, MOTION], [len(self.basis), len(self.lens)])

    def images(self, camera: IntArray, placement: IntArray) -> IntArray:
        """The image (n,) of observations by camera and placement (n,)."""
        count = int(self.placement_of_image.max()) + 1
        return np.searchsorted(self.camera_of_image * count + self.placement_of_image, camera * count + placement)

    def columns(self, image: int) -> IntArray:
        """The columns that an image's observations have."""
        lens, turn = self.lens[self.camera_of_image[image]], self.n_fields + TURN * image
        return np.append(np.arange(self.field_start[lens], self.field_start[lens + 1]), turn + np.arange(TURN))

    def derivatives(self, camera: int, uv: FloatArray, weight: FloatArray, by_camera: FloatArray) -> FloatArray:
        """Weighted derivatives (k,2,r) of residuals at measured pixels uv (k,2) of one image by its columns."""
        basis = self.basis[self.lens[camera]]
        field = np.zeros((len(uv), 2, 0)) if basis is None else basis.at(uv) * weight[:, :, None]
        return np.concatenate([field, by_camera[:, :, :TURN]], axis=2)


@dataclass(frozen=True)
class Corrections:
    """Estimated fields and motions: coefficients (m,) and variances (parts,) over sigma0 squared.

    `freedom`: how many coefficients' worth the data determine, which the redundancy lacks.
    `field_evidence, motion_evidence`: by how much -2 log of the likelihood falls by each beside the other.
    """

    design: Design
    coefficients: FloatArray
    variances: FloatArray
    freedom: float
    field_evidence: float
    motion_evidence: float

    @property
    def turns(self) -> FloatArray:
        """Turns (i,3) rad of the images."""
        return self.coefficients[self.design.n_fields :].reshape(-1, TURN)

    def field(self, lens: int, uv: FloatArray) -> FloatArray:
        """The field (n,2) px of a lens at measured pixels (n,2)."""
        basis, start = self.design.basis[lens], self.design.field_start
        if basis is None:
            return np.zeros_like(uv)
        return basis.at(uv) @ self.coefficients[start[lens] : start[lens + 1]]

    def of(self, measured: FloatArray, camera: IntArray, placement: IntArray, intrinsics: FloatArray) -> FloatArray:
        """What image points (n,2) px as measured have too much, of cameras with intrinsics (c,16)."""
        corrected = measured.copy()
        turns = self.turns[self.design.images(camera, placement)]
        for c in np.unique(camera):
            rows = np.flatnonzero(camera == c)
            uv = measured[rows] - self.field(int(self.design.lens[c]), measured[rows])
            if turns[rows].any():
                xy, good = undistort(uv, intrinsics[c])
                rays = np.column_stack([xy, np.ones(len(xy))])
                turned = project(np.einsum("nij,nj->ni", exp_rotation(-turns[rows]), rays), intrinsics[c])
                uv = np.where(good[:, None], turned, uv)
            corrected[rows] = uv
        return measured - corrected
