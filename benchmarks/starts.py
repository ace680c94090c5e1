"""The adjustments that are timed: a rig's observations and the state that the method starts from."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.bundle import usable_features
from spherecal.adjust.network import Network
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray
from spherecal.base.context import Context
from spherecal.data.session import Recording, Session
from spherecal.initialise.incremental import grow
from spherecal.initialise.local import reconstruct_locally
from spherecal.steps.ball_stages import describe_network
from spherecal.steps.settings import CalibrationSettings
from spherecal_sim.simulate_session import simulate_session

SEED = 1


@dataclass(frozen=True)
class Start:
    """What every engine is given: the network, the observations that count, and the state to start from."""

    rig: str
    network: Network
    used: BoolArray
    placed: BoolArray
    state: State

    def problem(self) -> Problem:
        """A new problem, so that building it can be timed (its layout is worked out at first use and kept)."""
        return self.network.problem(self.used, self.network.free, self.placed, weighted=True)[0]


def make_start(rig: str, seed: int = SEED) -> Start:
    """A simulated rig as the method has it before the adjustment of (2): grown, triangulated and gated.

    Intrinsics are the data sheets' (or, where the network grew in rings, those of the short adjustments).
    """
    return start_of(simulate_session(rig, seed)[0], rig)


def start_of(session: Session, name: str) -> Start:
    """A session as the method has it before the adjustment of (2)."""
    settings = CalibrationSettings()
    recording = Recording.of(session)
    network = describe_network(recording, settings)
    known = np.array([camera.prior for camera in session.cameras])
    local = reconstruct_locally(recording.observations, recording.features, known, settings.seed, Context())
    grown = grow(local, network, known, local.keep, Context())
    candidates = local.keep & grown.placed[network.camera]
    points, good = usable_features(network, grown.state, candidates)
    used = candidates & good[network.feature]
    used &= (network.views(used) >= 2)[network.feature]
    return Start(name, network, used, grown.placed, replace(grown.state, points=np.where(good[:, None], points, 0.0)))
