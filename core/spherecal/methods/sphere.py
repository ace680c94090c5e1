"""The sphere's start values: its network, the local reconstruction, and points as in the paper."""

import numpy as np

from spherecal.adjust.network import Network, free_network
from spherecal.ball.run import Run
from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context, Stopwatch
from spherecal.data.lens_model import estimated_intrinsics
from spherecal.data.observations import Features
from spherecal.data.recording import Recording
from spherecal.data.session import Session
from spherecal.geometry.camera import estimated_mask
from spherecal.initialise.chain import chain_points
from spherecal.initialise.incremental import InitialPoses
from spherecal.initialise.local import LocalNetwork, lasting_reference, reconstruct_locally
from spherecal.initialise.spherical_projection import project_to_spheres
from spherecal.methods.settings import CalibrationSettings


def describe_network(recording: Recording, settings: CalibrationSettings) -> Network:
    """Who observes what, and which intrinsics are to be estimated."""
    cameras, observations, features = recording.session.cameras, recording.observations, recording.features
    free = settings.intrinsics == "free"
    estimated = estimated_intrinsics(recording.session, free)
    if settings.method == "tao2021":
        estimated = np.tile(estimated_mask("tao2021") & free, (len(estimated), 1))
    names = [(c.earlier_pose_of or c.id) if settings.own_intrinsics else c.intrinsics_group for c in cameras]
    group = np.unique(names, return_inverse=True)[1].reshape(-1)
    return free_network(
        features.of_observation, observations.camera, observations.uv, len(features), estimated, group
    ).with_sigma(observations.sigma)


def local_network(
    recording: Recording, known: FloatArray, settings: CalibrationSettings, context: Context
) -> LocalNetwork:
    """Two-view geometry, triples and paths of a recording, from its cameras' known intrinsics (c,16)."""
    observations, features = recording.observations, recording.features
    local = reconstruct_locally(observations, features, known, settings.paths, settings.seed, context)
    return lasting_reference(local, recording.session)


def points_as_in_the_paper(start: InitialPoses, local: LocalNetwork, features: Features, spherical: bool) -> FloatArray:
    """Points (p,3) chained through the triples and, unless none-SPO, moved onto their placements' spheres."""
    points = chain_points(
        local.paths, local.triples, local.graph.scale, start.state.rotation, start.state.translation, len(features)
    )
    return project_to_spheres(points, features.placement) if spherical else points


def run_of(
    session: Session,
    settings: CalibrationSettings,
    start: InitialPoses,
    local: LocalNetwork,
    known: FloatArray,
    context: Context,
    watch: Stopwatch,
) -> Run:
    """What the stages from the adjustment on share; the wanted reference camera, where it has a pose, is the first."""
    wanted = [c for c, camera in enumerate(session.cameras) if camera.id == settings.reference and start.placed[c]]
    first, *others = dict.fromkeys((*wanted, *local.graph.references))
    return Run(known, first, settings.method == "tao2021", tuple(others), context, watch)
