"""Fields of lenses and motions of images: what the cameras do beyond the lens model and one pose each."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from spherecal.adjust.lens_field import FieldBasis
from spherecal.adjust.problem import Problem
from spherecal.adjust.variance_components import Estimate
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.rotation import exp_rotation

FIELD, MOTION, BENDING = 0, 1, 2  # kinds of effects
TURN = 3  # columns of a motion
# Powers of a place's coordinates in a smooth change of the ball's shape, the sum of them at most 4 (no shift).
_POWERS = np.array([p for p in product(range(5), repeat=3) if 1 <= sum(p) <= 4])


# A step between two placements, or of one image alone, explains this share of the turns of a camera that was knocked
# (0.89 to 0.99 of 0.05 to 1 mm on rigs A and B). Steady creep over four placements has 0.80, others 0.5 to 0.85.
# (0.82 to 0.89 on rig B behind a misfit, where it alone has turns 5 times those of the others).
MOST_OF_A_STEP, MOST_OF_ITS_STEP, STICKS_OUT = 0.9, 0.82, 5.0


@dataclass(frozen=True)
class Field:
    """A field's basis, its first column, and the cameras (k,) that have it: those with the same intrinsics."""

    basis: FieldBasis
    first: int
    cameras: IntArray

    @property
    def columns(self) -> IntArray:
        """The columns of its coefficients."""
        return self.first + np.arange(self.basis.count)


@dataclass(frozen=True)
class Bending:
    """Smooth changes of the ball's shape at each of its placements, by polynomials (p,s) of its points' places.

    `size`: of the ball, the rms distance of its points from their middle; `unit`: of each polynomial, (s,): times it,
    values are products of coordinates over the size.
    """

    values: FloatArray
    size: float
    unit: FloatArray
    n_placements: int

    @property
    def count(self) -> int:
        """Columns of one placement: each polynomial along x, then along y and z."""
        return 3 * self.values.shape[1]

    @property
    def linear(self) -> tuple[IntArray, FloatArray]:
        """The polynomials (3,) of degree 1, along x, y and z, and what each is multiplied by to be that coordinate."""
        index = _POWERS.T[:, _POWERS.sum(axis=1) == 1].argmax(axis=1)
        own = np.flatnonzero(_POWERS.sum(axis=1) == 1)[index]
        return own, self.size * self.unit[own]


def bending_of(problem: Problem, points: FloatArray) -> Bending | None:
    """Changes of the ball's shape by polynomials, each with an rms over its points (p,3) of 1 over its degree.

    Its points are those that several placements show or a stored shape knows, not a bar's marks; None without any.
    """
    seen = np.unique(problem.point * problem.n_placements + problem.placement) // problem.n_placements
    is_shared = (np.bincount(seen, minlength=problem.n_points) > 1) | problem.known_points
    if not is_shared.any():
        return None
    off = np.where(is_shared[:, None], points - points[is_shared].mean(axis=0), 0.0)
    size = float(np.sqrt((off[is_shared] ** 2).sum(axis=1).mean()))
    values = ((off / size)[:, None] ** _POWERS).prod(axis=2)
    rms = np.sqrt((values[is_shared] ** 2).mean(axis=0)).clip(min=1e-9)
    unit = rms * _POWERS.sum(axis=1)
    return Bending(values / unit, size, unit, problem.n_placements)


@dataclass(frozen=True)
class Design:
    """The effects that a network may have: fields of lenses, then turns of images, if any, as columns.

    An image here is all that a camera sees at `together` consecutive placements: 1 but in large recordings.
    `camera_of_image` and `span_of_image`, which placements these are (i,), sorted.
    """

    fields: tuple[Field, ...]
    camera_of_image: IntArray
    span_of_image: IntArray
    n_cameras: int
    together: int = 1
    bending: Bending | None = None

    @cached_property
    def n_fields(self) -> int:
        """Columns of the fields, the first ones."""
        return sum(field.basis.count for field in self.fields)

    @property
    def count(self) -> int:
        """All columns."""
        return self.n_of_cameras + (self.bending.count * self.bending.n_placements if self.bending else 0)

    @property
    def n_of_cameras(self) -> int:
        """Columns of fields and turns."""
        return self.n_fields + TURN * len(self.camera_of_image)

    @property
    def of_fields(self) -> "Design":
        """The same without turns."""
        return replace(self, camera_of_image=self.camera_of_image[:0], span_of_image=self.span_of_image[:0])

    @property
    def part(self) -> IntArray:
        """The part of each column: fields, then cameras that turn."""
        fields = [np.full(field.basis.count, number) for number, field in enumerate(self.fields)]
        turns = len(self.fields) + np.repeat(self.camera_of_image, TURN)
        bending = np.full(self.count - self.n_of_cameras, len(self.fields) + self.n_cameras)
        return np.concatenate([*fields, turns, bending])

    @property
    def kind(self) -> IntArray:
        """The kind of each part."""
        return np.repeat([FIELD, MOTION, BENDING], [len(self.fields), self.n_cameras, int(self.bending is not None)])

    @cached_property
    def fields_of(self) -> list[list[Field]]:
        """The fields that each camera has."""
        return [[field for field in self.fields if camera in field.cameras] for camera in range(self.n_cameras)]

    def images(self, camera: IntArray, placement: IntArray) -> IntArray:
        """The image (n,) of observations by camera and placement (n,); the camera where there are no turns."""
        if not len(self.camera_of_image):
            return camera
        count = int(self.span_of_image.max()) + 1
        span = placement // self.together
        return np.searchsorted(self.camera_of_image * count + self.span_of_image, camera * count + span)


@dataclass(frozen=True, kw_only=True)
class Corrections(Estimate):
    """Estimated fields and motions; their `freedom` the redundancy lacks.

    `evidence`: by how much -2 log of the likelihood falls by each kind beside the others, of those taken; `redundancy`:
    with how much the `deviance` is -2 log of it; `turning`: whether turns may be applied.
    """

    design: Design
    evidence: dict[int, float]
    redundancy: int
    turning: bool = False

    @property
    def is_held_back(self) -> bool:
        """Whether nothing is applied, as turns say more than fields: so do cameras that moved, and fields hide them.

        Five cameras on a beam that sagged by 2 mm (740 by turns, 389 by fields) were found without fields alone.
        """
        return not self.turning and self.evidence.get(MOTION, 0.0) > self.evidence.get(FIELD, 0.0)

    @property
    def turns(self) -> FloatArray:
        """Turns (i,3) rad of the images of cameras that drift; 0 of those that moved once (`moved_once`)."""
        turns = self.coefficients[self.design.n_fields :].reshape(-1, TURN)
        if not self.turning:
            return np.zeros_like(turns)
        return np.where(self.moved_once[self.design.camera_of_image, None], 0.0, turns)

    @property
    def applied(self) -> FloatArray:
        """The coefficients (m,) that the image points are corrected by: those that are not applied are 0."""
        fields = self.coefficients[: self.design.n_fields] * (not self.is_held_back)
        return np.concatenate([fields, self.turns.ravel()])

    @cached_property
    def moved_once(self) -> BoolArray:
        """Cameras (c,) that turn in one step, or for one image: who moved is for the diagnosis to find, and to repair.

        Their fields are estimated beside their turns all the same: alone a field takes up three quarters of a move.
        """
        turns, share = self.coefficients[self.design.n_fields :].reshape(-1, TURN), np.zeros(self.design.n_cameras)
        for c in np.unique(self.design.camera_of_image):
            own = turns[self.design.camera_of_image == c]  # in the order of the placements
            share[c] = _step_share(own - own.mean(axis=0))
        return (share >= np.where(self.turns_more, MOST_OF_ITS_STEP, MOST_OF_A_STEP)) & (share > 0)

    @property
    def turns_more(self) -> BoolArray:
        """Cameras (c,) that turn by far more than the others: one focused anew by 0.1 % 14 times, drifting ones 2."""
        square = (self.coefficients[self.design.n_fields :].reshape(-1, TURN) ** 2).sum(axis=1)
        camera, count = self.design.camera_of_image, self.design.n_cameras
        images = np.maximum(np.bincount(camera, minlength=count), 1)
        size = np.sqrt(np.bincount(camera, square, minlength=count) / images)
        return size > STICKS_OUT * np.median(size)

    def field(self, camera: int, uv: FloatArray) -> FloatArray:
        """The field (n,2) px of a camera's lens at measured pixels (n,2)."""
        out = np.zeros_like(uv)
        for field in self.design.fields_of[camera]:
            coefficients = self.applied[field.columns]
            if coefficients.any():
                out += field.basis.at(uv) @ coefficients
        return out

    def of(self, measured: FloatArray, camera: IntArray, placement: IntArray, intrinsics: FloatArray) -> FloatArray:
        """What image points (n,2) px as measured have too much, of cameras with intrinsics (c,16)."""
        corrected = measured.copy()
        turns = self.turns[self.design.images(camera, placement)]
        for c in np.unique(camera):
            rows = np.flatnonzero(camera == c)
            uv = measured[rows] - self.field(int(c), measured[rows])
            if turns[rows].any():
                xy, good = undistort(uv, intrinsics[c])
                rays = np.column_stack([xy, np.ones(len(xy))])
                turned = project(np.einsum("nij,nj->ni", exp_rotation(-turns[rows]), rays), intrinsics[c])
                uv = np.where(good[:, None], turned, uv)
            corrected[rows] = uv
        return measured - corrected


def _step_share(turns: FloatArray) -> float:
    """The share of the squares of turns (k,3) about their mean that two groups of images explain, at most."""
    total = float((turns**2).sum())
    if not total > 0 or len(turns) < 2:
        return 0.0
    after = np.tri(len(turns), k=-1, dtype=bool)[1:]  # those before each step
    groups = np.concatenate([after, np.eye(len(turns), dtype=bool)])
    count = groups.sum(axis=1)
    between = (groups @ turns) ** 2  # the turns sum to 0
    share = between.sum(axis=1) * (1 / count + 1 / (len(turns) - count))
    return float(share.max()) / total
