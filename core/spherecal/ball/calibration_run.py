"""Data that every stage of one calibration shares."""

from dataclasses import dataclass, field, replace

import numpy as np

from spherecal.adjust.bundle import Adjustment
from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context, Stopwatch


@dataclass(frozen=True)
class Run:
    """A running calibration: what is known before, the camera whose frame is the world, progress and stage times.

    `known` (c,16) intrinsics before the adjustment. `next_references`: cameras to take instead of `reference`, in this
    order, where the adjustment leaves out all that it observed. `plain`, as in the paper: every observation weighs the
    same, and a bar gives nothing but the scale.
    """

    known: FloatArray
    reference: int
    plain: bool = False
    next_references: tuple[int, ...] = ()
    context: Context = field(default_factory=Context)
    watch: Stopwatch = field(default_factory=Stopwatch)

    def accepting_partial(self) -> "Run":
        """The same, for work whose caller has a partial result."""
        return replace(self, context=self.context.accepting_partial())

    def reference_in(self, adjusted: Adjustment) -> int:
        """The camera whose frame is the world: the first of the references that still observes anything."""
        seen = np.bincount(adjusted.problem.camera, minlength=adjusted.problem.n_cameras) > 0
        return next((c for c in (self.reference, *self.next_references) if seen[c]), self.reference)
