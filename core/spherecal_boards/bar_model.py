"""A waved bar as frames: the marks (or the dots of its marks) of one instant, tied by the bar's certified lengths."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray
from spherecal_boards.frame_network import FrameModel, Ties
from spherecal_boards.frames_covariance import PointRows


@dataclass(frozen=True)
class Lengths:
    """Known distances inside frames: frame (m,), coefficients (m,s) of its slots, length (m,) and sigma (m,) in mm.

    The coefficients of a row are those of its second end less those of its first. An end is a slot, or the origin of a
    target that its dots give as a weighted sum. `certificate` (m,) is which certified length a row is;
    `scatter` what `sigma` holds for the bar's own changes from frame to frame, in mm.
    """

    frame: IntArray
    coefficient: FloatArray
    length: FloatArray
    sigma: FloatArray
    certificate: IntArray
    scatter: float = 0.0


@dataclass(frozen=True)
class BarModel(FrameModel):
    """The frames of a bar: point `frame * parts + slot`, three unknowns a slot."""

    lengths: Lengths

    def ties(self, state: State) -> Ties:
        """The lengths' rows, over their standard uncertainties."""
        difference = self.differences(state)
        size = np.linalg.norm(difference, axis=1)
        along = difference / (size * self.lengths.sigma)[:, None]
        rows = (self.lengths.coefficient[:, :, None] * along[:, None]).reshape(len(size), -1)
        return Ties(self.lengths.frame, rows, (size - self.lengths.length) / self.lengths.sigma)

    def differences(self, state: State) -> FloatArray:
        """From each length's first end to its second, (m,3)."""
        points = state.points.reshape(-1, self.parts, 3)[self.lengths.frame]
        return np.einsum("ms,msi->mi", self.lengths.coefficient, points)

    def moved_frames(self, state: State, step: FloatArray) -> State:
        """The state with its points moved by the shifts of each frame's slots, (f,3s)."""
        return replace(state, points=state.points + step.reshape(-1, 3))

    def point_rows(self, state: State, points: IntArray) -> PointRows:
        """Points (p,) of the problem in the world, and how they follow their frames; all define the datum."""
        by_frame = np.zeros((len(points), self.parts, 3, 3))
        by_frame[np.arange(len(points)), points % self.parts] = np.eye(3)
        by_frame = by_frame.transpose(0, 2, 1, 3).reshape(len(points), 3, -1)
        return PointRows(points // self.parts, state.points[points], by_frame, np.ones(len(points), dtype=bool))
