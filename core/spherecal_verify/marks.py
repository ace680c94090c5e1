"""Where the marks of a bar are: points observed under their names, or targets' origins laid over their dots."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Features, Observations
from spherecal.data.session import Mark
from spherecal.targets.centre import centre_by_point, target_centre
from spherecal.targets.target_set import TargetSet
from spherecal_verify.outlying_views import CheckedPoints

# A dot that only grazing or nearly parallel rays show would pull the layout about, since all dots weigh the same; among
# the dots of one sticker, seen by the same cameras, the standard deviations differ by less than 2.
_WEAK_DOT = 5.0


@dataclass(frozen=True)
class MarkPlace:
    """A place (3,) mm = place + by_point[i] @ shift of point features[i], (k, 3, 3) and (k,); views: its cameras."""

    place_mm: FloatArray
    features: IntArray
    by_point: FloatArray
    views: int


@dataclass(frozen=True)
class MarkFinder:
    """Finds marks among the reconstructed points of bar poses; `checked` belongs to `features`."""

    observations: Observations
    features: Features
    checked: CheckedPoints
    target_set: TargetSet | None

    def find(self, pose: int, mark: Mark) -> MarkPlace | Phrase:
        """The place of a mark in one pose, by its name or as the centre of a layout over its dots; or why none."""
        names = self.observations.points
        of_target = np.flatnonzero((self.features.placement == pose) & (self.features.target == mark.target))
        points = self.checked.points
        usable = np.isfinite(points.points[:, 0]) & points.in_front & ~self.checked.contradicting
        found = of_target[usable[of_target]]
        direct = [i for i in found if names[self.features.point[i]] == mark.point]
        if direct:
            rows = np.array(direct[:1])
            return MarkPlace(self.checked.points.points[rows[0]], rows, np.eye(3)[None], self._count_cameras(rows))
        if mark.point != "centre":
            if not len(of_target):
                return Phrase("mark-unseen", {"target": mark.target})
            return Phrase("mark-in-one-view", {"point": mark.point, "target": mark.target})
        layout = self.target_set.layouts.get(mark.target) if self.target_set is not None else None
        if layout is None:
            return Phrase("mark-no-layout", {"target": mark.target})
        dots = self._leave_out_weak(np.array([i for i in found if names[self.features.point[i]] in layout], dtype=int))
        flat = np.array([layout[names[self.features.point[i]]] for i in dots]).reshape(-1, 2)
        places = points.points[dots]
        centre = target_centre(flat, places)
        if centre is None:
            return Phrase("mark-few-dots", {"target": mark.target, "dots": len(dots)})
        return MarkPlace(centre, dots, centre_by_point(flat, places), self._count_cameras(dots))

    def _leave_out_weak(self, dots: IntArray) -> IntArray:
        if len(dots) == 0:
            return dots
        variance = np.trace(self.checked.points.covariance[dots], axis1=1, axis2=2)
        return dots[variance <= _WEAK_DOT**2 * np.median(variance)]

    def _count_cameras(self, features: IntArray) -> int:
        rows = self.checked.kept & np.isin(self.checked.views.feature, features)
        return len(np.unique(self.checked.views.camera[rows]))
