"""How the dots of the ball are connected from placement to placement: the four models of the network.

All of them have the same arrays, empty where a model has none of them, so that what does not depend on the model needs
no case of its own.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray

_NO_INDICES = np.zeros(0, dtype=np.int64)
_NO_FLAGS = np.zeros(0, dtype=bool)
_NO_NUMBERS = np.zeros(0)


@dataclass(frozen=True)
class Free:
    """Every dot at every placement is a point of its own [Tao21]."""

    @property
    def placement(self) -> IntArray:
        """None of the observations has a pose of the ball, (0,)."""
        return _NO_INDICES

    @property
    def free_placement(self) -> BoolArray:
        """There are no poses of the ball, (0,)."""
        return _NO_FLAGS

    @property
    def place(self) -> IntArray:
        """The observations share no shape noise, (0,)."""
        return _NO_INDICES

    @property
    def shape_sd(self) -> FloatArray:
        """There is no shape noise, (0,)."""
        return _NO_NUMBERS

    def select(self, rows: BoolArray | IntArray | slice) -> "Free":
        """The model of some of the observations."""
        return self

    def scaled(self, factor: float) -> "Free":
        """The model with all lengths multiplied by `factor`."""
        return self


@dataclass(frozen=True)
class Rigid:
    """The ball keeps its shape: X = R_t S + T_t.

    `placement` (n,): pose at each observation; `free_placement` (t,): estimated ones, the others are the world itself.
    """

    placement: IntArray
    free_placement: BoolArray

    @property
    def place(self) -> IntArray:
        """The observations share no shape noise, (0,)."""
        return _NO_INDICES

    @property
    def shape_sd(self) -> FloatArray:
        """There is no shape noise, (0,)."""
        return _NO_NUMBERS

    def select(self, rows: BoolArray | IntArray | slice) -> "Rigid":
        """The model of some of the observations."""
        return replace(self, placement=self.placement[rows])

    def scaled(self, factor: float) -> "Rigid":
        """The model with all lengths multiplied by `factor`."""
        return self


@dataclass(frozen=True)
class Deformable:
    """The ball keeps its shape but for some shape noise of its dots: X = R_t S + T_t + e (see `deformable`).

    `placement, free_placement`: as of Rigid; `place`: the feature (dot at a placement) that each observation shows,
    (n,); `shape_sd`: standard deviation of e per coordinate of each feature (f,), in the network's unit and for a
    standard deviation of unit weight of 1. 0 is a rigid place.
    """

    placement: IntArray
    free_placement: BoolArray
    place: IntArray
    shape_sd: FloatArray

    def select(self, rows: BoolArray | IntArray | slice) -> "Deformable":
        """The model of some of the observations."""
        return replace(self, placement=self.placement[rows], place=self.place[rows])

    def scaled(self, factor: float) -> "Deformable":
        """The model with all lengths multiplied by `factor`."""
        return replace(self, shape_sd=self.shape_sd * factor)


@dataclass(frozen=True)
class ShapePrior:
    """The ball's shape, known from an earlier calibration, for a standard deviation of unit weight of 1.

    `places` (p,3) in the ball's frame; `information` (p,3,3): inverses of their covariances, 0 where nothing is known.
    """

    places: FloatArray
    information: FloatArray

    @cached_property
    def known(self) -> BoolArray:
        """Points (p,) that it knows."""
        return self.information[:, 0, 0] > 0

    def off(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Deviations of points (p,3) from the shape, 0 where nothing is known, and these times the information."""
        off = np.where(self.known[:, None], points - self.places, 0.0)
        return off, np.einsum("pij,pj->pi", self.information, off)


@dataclass(frozen=True)
class Stored:
    """The ball keeps a shape that is stored (a ball profile): its dots are observations of the shape.

    As Rigid; all placements but the first, the world itself, are free.
    """

    placement: IntArray
    free_placement: BoolArray
    shape: ShapePrior

    @property
    def place(self) -> IntArray:
        """The observations share no shape noise, (0,)."""
        return _NO_INDICES

    @property
    def shape_sd(self) -> FloatArray:
        """There is no shape noise, (0,)."""
        return _NO_NUMBERS

    def select(self, rows: BoolArray | IntArray | slice) -> "Stored":
        """The model of some of the observations."""
        return replace(self, placement=self.placement[rows])

    def scaled(self, factor: float) -> "Stored":
        """The model as it is: the shape is in millimetres, and so is a network based on it."""
        return self


FREE = Free()
BallModel: TypeAlias = Free | Rigid | Deformable | Stored


def as_rigid(ball: BallModel) -> BallModel:
    """The same placements of a ball without shape noise and without a known shape; a free network stays free."""
    return ball if isinstance(ball, Free) else Rigid(ball.placement, ball.free_placement)
