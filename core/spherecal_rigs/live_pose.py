"""A bar in front of the cameras: the positions of its end marks from one set of observations, to accept its pose."""

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.data.observations import Observations, find_features
from spherecal.data.rig import Rig
from spherecal.data.session import Bar
from spherecal.targets.target_set import TargetSet
from spherecal_rigs.pose_plan import BarMarks
from spherecal_verify.marks import MarkFinder, MarkPlace
from spherecal_verify.outlying_views import triangulate_checked
from spherecal_verify.verify_bars import views_of


def measured_ends(
    rig: Rig, bar: Bar, target_set: TargetSet | None, observations: Observations, placement: int = 0
) -> FloatArray | None:
    """The places (2, 3) in mm of the bar's first and last mark in one placement; None unless two cameras see both."""
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    in_rig = np.array([index.get(name, -1) for name in observations.cameras], dtype=np.int64)
    targets = [mark.target for mark in bar.marks.values()]
    requested = (observations.placement == placement) & np.isin(observations.target, targets)
    own = observations.select(requested & (in_rig[observations.camera] >= 0))
    if not len(own):
        return None
    features = find_features(own)
    views, noise = views_of(own, features, in_rig[own.camera], rig)
    finder = MarkFinder(own, features, triangulate_checked(views, noise), target_set)
    marks = BarMarks.of(bar.id, bar.lengths)
    places = [finder.find(placement, bar.marks[name]) for name in (marks.names[0], marks.names[-1])]
    ends = [place.place_mm for place in places if isinstance(place, MarkPlace)]
    return np.stack(ends) if len(ends) == 2 else None
