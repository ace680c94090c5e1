"""What a calibration starts from: a session and what of its observations it may use."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.data.observations import Features, Observations, find_features
from spherecal.data.session import Session


@dataclass(frozen=True)
class Recording:
    """A session, the observations that may be used and the features (placement, target, point) that they are of."""

    session: Session
    observations: Observations
    features: Features

    @classmethod
    def of(cls, session: Session) -> "Recording":
        """The recording of a session that has observations."""
        o = session.observations
        assert o is not None
        # placements, and the marks of the bar that gives the scale; never check bars
        take = o.placement < len(session.placements)
        bars = {bar.id: bar for bar in session.bars}
        for i, pose in enumerate(session.bar_poses):
            if session.scale is not None and pose.bar == session.scale.bar:
                marks = [mark.target for mark in bars[pose.bar].marks.values()]
                take |= (o.placement == len(session.placements) + i) & np.isin(o.target, marks)
        o = o if take.all() else o.select(take)
        return cls(session, o, find_features(o))

    @property
    def priors(self) -> FloatArray:
        """What is known of the cameras' intrinsics before the calibration, (c,16)."""
        return np.array([camera.prior for camera in self.session.cameras])

    @property
    def n_ball(self) -> int:
        """How many placements are the ball's; they come first."""
        return len(self.session.placements)

    @property
    def n_placements(self) -> int:
        """How many placements there are, poses of bars included."""
        return self.n_ball + len(self.session.bar_poses)
