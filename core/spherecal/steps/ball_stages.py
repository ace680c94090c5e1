"""What an adjustment of the ball starts from: the network of a recording, its local reconstructions, poses."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.network import Network, free_network
from spherecal.ball.fit import Run
from spherecal.base.arrays import BoolArray
from spherecal.base.context import Context, Stopwatch
from spherecal.base.memory import release_freed
from spherecal.base.messages.values import Phrase
from spherecal.data.lens_model import estimated_intrinsics
from spherecal.data.session import Recording
from spherecal.geometry.camera import estimated_mask
from spherecal.initialise.incremental import InitialPoses, grow
from spherecal.initialise.local import LocalNetwork, lasting_reference, reconstruct_locally
from spherecal.steps.settings import CalibrationSettings


def describe_network(recording: Recording, settings: CalibrationSettings) -> Network:
    """Who observes what, and which intrinsics are to be estimated."""
    cameras, observations, features = recording.session.cameras, recording.observations, recording.features
    free = settings.intrinsics == "free"
    estimated = estimated_intrinsics(recording.session, free)
    if settings.method == "tao2021":
        estimated = np.tile(estimated_mask("tao2021") & free, (len(estimated), 1))
    names = [(c.earlier_pose_of or c.id) if settings.own_intrinsics else c.intrinsics_group for c in cameras]
    group = np.unique(names, return_inverse=True)[1].reshape(-1)
    network = free_network(
        features.of_observation, observations.camera, observations.uv, len(features), estimated, group
    ).with_sigma(observations.sigma)
    if settings.method == "tao2021":
        return network
    sizes = np.array([camera.image_size for camera in cameras], dtype=float)
    return replace(network, sizes=sizes, placement=observations.placement)


def local_network(recording: Recording, settings: CalibrationSettings, context: Context) -> LocalNetwork:
    """Two-view geometry, triples, view graph and paths of a recording, from its cameras' priors; [Tao21] (3)-(14)."""
    observations, features = recording.observations, recording.features
    local = reconstruct_locally(observations, features, recording.priors, settings.seed, context)
    release_freed()
    return lasting_reference(local, recording.session)


@dataclass(frozen=True)
class StartValues:
    """What the adjustment starts from: network, local reconstructions, poses; with `tao2021` the points too, or NaN."""

    network: Network
    local: LocalNetwork
    poses: InitialPoses

    @property
    def candidates(self) -> BoolArray:
        """The observations to start with (n,): those that the two-view gates keep, of cameras with a pose."""
        return self.local.keep & self.poses.placed[self.network.camera]


def start_values(
    recording: Recording, local: LocalNetwork, settings: CalibrationSettings, context: Context, turning: bool = False
) -> StartValues:
    """Poses chained along the paths and by resection; `turning`: whether images may turn."""
    context.report("start values", 0.0, Phrase("compiling"))
    network = replace(describe_network(recording, settings), turning=turning)
    poses = grow(local, network, recording.priors, local.keep, context)
    release_freed()
    return StartValues(network, local, poses)


def run_of(
    recording: Recording, start: StartValues, settings: CalibrationSettings, context: Context, watch: Stopwatch
) -> Run:
    """Data that the stages from the adjustment on share; the requested reference camera is first, if it has a pose."""
    cameras, placed = recording.session.cameras, start.poses.placed
    requested = [c for c, camera in enumerate(cameras) if camera.id == settings.reference and placed[c]]
    first, *others = dict.fromkeys((*requested, *start.local.graph.references))
    return Run(recording.priors, first, settings.method == "tao2021", tuple(others), context, watch)
