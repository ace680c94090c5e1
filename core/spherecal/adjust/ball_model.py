"""How the dots of the ball are connected from placement to placement: the four models of the network.

All of them have the same arrays, so that what does not depend on the model needs no case of its own.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class BallModel:
    """What all four have: arrays, empty where a model has none of them.

    `placement` (n,): pose of the ball at each observation; `free_placement` (t,): the estimated poses, the others are
    the world itself; `place` (n,): the feature (dot at a placement) that each observation shows; `shape_sd` (f,):
    standard deviation of shape noise per coordinate of each feature.
    """

    placement: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    free_placement: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    place: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    shape_sd: FloatArray = field(default_factory=lambda: np.zeros(0))

    def select(self, rows: BoolArray | IntArray | slice) -> Self:
        """The model of some of the observations."""
        placement, place = (each[rows] if len(each) else each for each in (self.placement, self.place))
        return replace(self, placement=placement, place=place)

    def scaled(self, factor: float) -> Self:
        """The model with all lengths multiplied by `factor`; a stored shape is in millimetres, as its network is."""
        return replace(self, shape_sd=self.shape_sd * factor)


@dataclass(frozen=True)
class Free(BallModel):
    """Every dot at every placement is a point of its own [Tao21]."""


@dataclass(frozen=True)
class Rigid(BallModel):
    """The ball keeps its shape: X = R_t S + T_t."""


@dataclass(frozen=True)
class Deformable(BallModel):
    """The ball keeps its shape but for some shape noise of its dots: X = R_t S + T_t + e (see `deformable`).

    `shape_sd` in the network's unit and for a standard deviation of unit weight of 1. 0 is a rigid place.
    """


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


@dataclass(frozen=True, kw_only=True)
class Stored(BallModel):
    """The ball keeps a shape that is stored (a ball profile): its dots are observations of the shape.

    As Rigid; all placements but the first, the world itself, are free.
    """

    shape: ShapePrior


FREE = Free()


def as_rigid(ball: BallModel) -> BallModel:
    """The same placements of a ball without shape noise and without a known shape; a free network stays free."""
    return ball if isinstance(ball, Free) else Rigid(ball.placement, ball.free_placement)
