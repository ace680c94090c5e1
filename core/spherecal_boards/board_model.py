"""A board as frames: its points are known, a placement is a pose of the board (six unknowns)."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.observations import Observations
from spherecal.geometry.rotation import cross_matrix, exp_rotation
from spherecal_boards.frame_network import FrameModel
from spherecal_boards.frames_adjustment import PointRows


@dataclass(frozen=True)
class BoardViews:
    """What cameras see of a board: observation i shows point `point[i]` at `placement[i]` in `camera[i]`.

    `points_mm` (p,3) in the board's frame, uv (n,2) px, sigma (n,2) px or None; names of cameras and placements.
    """

    points_mm: FloatArray
    placement: IntArray
    camera: IntArray
    point: IntArray
    uv: FloatArray
    sigma: FloatArray | None
    n_placements: int
    n_cameras: int

    def __len__(self) -> int:
        return len(self.uv)

    def of(self, camera: int, placement: int) -> IntArray:
        """Rows of one view, (k,); none where it has no observations."""
        return self._rows.get((camera, placement), np.zeros(0, dtype=np.int64))

    @cached_property
    def _rows(self) -> dict[tuple[int, int], IntArray]:
        order = np.lexsort((self.placement, self.camera))
        key = self.camera[order] * self.n_placements + self.placement[order]
        starts = np.flatnonzero(np.diff(key, prepend=-1))
        return {
            (int(key[rows[0]] // self.n_placements), int(key[rows[0]] % self.n_placements)): order[rows]
            for rows in np.split(np.arange(len(key)), starts[1:])
            if len(rows)
        }

    @property
    def views(self) -> list[tuple[int, int]]:
        """All (camera, placement) that have observations."""
        return list(self._rows)


def board_views(observations: Observations, points_mm: FloatArray, point: IntArray) -> BoardViews:
    """What the cameras see of a board's points (p,3) mm: which of them each observation shows, (n,)."""
    o = observations
    return BoardViews(points_mm, o.placement, o.camera, point, o.uv, o.sigma, len(o.placements), len(o.cameras))


@dataclass(frozen=True)
class BoardModel(FrameModel):
    """The frames of a board; `rigid` has the placements, `problem` only the cameras."""

    rigid: Problem

    @property
    def observed(self) -> Problem:
        """The problem with the placements."""
        return self.rigid

    def moved_frames(self, state: State, step: FloatArray) -> State:
        """The state with its placements turned (rad) about the board's origin, and shifted (mm), by steps (f,6)."""
        return replace(
            state,
            placement_rotation=exp_rotation(step[:, :3]) @ state.placement_rotation,
            placement_translation=state.placement_translation + step[:, 3:],
        )

    def point_rows(self, state: State, placement: IntArray, point: IntArray, in_datum: BoolArray) -> PointRows:
        """Points (p,) of the board at placements in the world, and how they follow the placements."""
        turned = np.einsum("pij,pj->pi", state.placement_rotation[placement], state.points[point])
        by_frame = np.concatenate([-cross_matrix(turned), np.tile(np.eye(3), (len(point), 1, 1))], axis=2)
        return PointRows(placement, turned + state.placement_translation[placement], by_frame, in_datum)
