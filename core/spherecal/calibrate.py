"""The method on one page: images -> observations -> triples -> paths -> adjustment -> covariance and scale -> rig."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherecal.adjust.bundle import Adjusted, adjust
from spherecal.adjust.covariance import Covariance, covariance
from spherecal.adjust.growth import Grown, grow
from spherecal.adjust.held import hold, poorly_determined, poorly_observed
from spherecal.adjust.levenberg import Engine
from spherecal.adjust.network import Network
from spherecal.arrays import BoolArray, FloatArray
from spherecal.assemble import assemble, assemble_failed
from spherecal.context import Context, Stopwatch
from spherecal.geometry.camera import estimated_mask
from spherecal.network.chain import chain_points
from spherecal.network.local import LocalNetwork, reconstruct_locally
from spherecal.network.observations import Features, Observations, find_features
from spherecal.network.path import Search
from spherecal.network.spherical import project_to_spheres
from spherecal.observe import observed
from spherecal.rig import Calibration
from spherecal.search import with_missed_targets
from spherecal.session.model import Session
from spherecal.solution import metric_solution

Method = Literal["auto", "tao2021", "free"]

# Nominal intrinsics that are simply wrong make the fit many times worse when held; right ones hardly change it.
MOST_WORSE_BY_HOLDING = 2.0


@dataclass(frozen=True)
class CalibrationSettings:
    """How to calibrate; `auto` is `free` as long as the rigid form is not part of the program.

    `tao2021` starts from chained points and spherical projection and estimates the paper's distortion terms; `search`
    `first` is none-OPT, `spherical_projection` False none-SPO. `intrinsics` `fixed` keeps the priors,
    `own_intrinsics` disregards intrinsics groups.
    """

    method: Method = "auto"
    search: Search = "opt"
    spherical_projection: bool = True
    intrinsics: Literal["free", "fixed"] = "free"
    own_intrinsics: bool = False
    seed: int = 0
    engine: Engine = "numba"


def calibrate(
    session: Session, settings: CalibrationSettings | None = None, context: Context | None = None
) -> Calibration:
    """The calibrated rig of a session's images or observations, with points, residuals, spheres and findings.

    A rig that could not be calibrated, or only in part, is a result too, with `valid` False and findings that say why.
    InputError where the session has neither, or images that cannot be read.
    """
    settings, context, watch = settings or CalibrationSettings(), context or Context(), Stopwatch()
    if session.observations is None:
        session = observed(session, context)
        watch.lap("detection")
        first = _calibrate(session, settings, context, Stopwatch())
        session = with_missed_targets(session, first, context)
        watch.lap("second look")
    return _calibrate(session, settings, context, watch)


def _calibrate(session: Session, settings: CalibrationSettings, context: Context, watch: Stopwatch) -> Calibration:
    """The method from observations to the rig."""
    observations = calibration_observations(session)
    features = find_features(observations)
    network = describe_network(session, observations, features, settings)
    known = np.array([camera.prior for camera in session.cameras])

    local = reconstruct_locally(observations, features, known, settings.search, settings.seed, context)
    watch.lap("local reconstruction")
    if not local.triples:
        return assemble_failed(session, observations, features, local, settings.method, watch.seconds)

    context.report("start values", 0.0, "the first run on a machine compiles for some ten seconds")
    start = grow(local, network, known, local.keep, settings.engine, context)
    points = None
    if settings.method == "tao2021":
        points = points_as_in_the_paper(start, local, features, settings.spherical_projection)
    watch.lap("start values")

    adjusted, cofactors, held = adjust_or_hold(network, start, points, local, known, settings, context)
    watch.lap("bundle adjustment")

    solution = metric_solution(session, observations, features, adjusted, cofactors)
    watch.lap("scale")
    return assemble(
        session, observations, features, local, start.placed, adjusted, held, solution, settings.method, watch.seconds
    )


def calibration_observations(session: Session) -> Observations:
    """What a calibration may use: the placements, and the marks of the bar that gives the scale.

    Check bars never enter.
    """
    o = session.observations
    assert o is not None
    take = o.placement < len(session.placements)
    bars = {bar.id: bar for bar in session.bars}
    for i, pose in enumerate(session.bar_poses):
        if session.scale is not None and pose.bar == session.scale.bar:
            marks = [mark.target for mark in bars[pose.bar].marks.values()]
            take |= (o.placement == len(session.placements) + i) & np.isin(o.target, marks)
    return o.select(take)


def describe_network(
    session: Session, observations: Observations, features: Features, settings: CalibrationSettings
) -> Network:
    """Who observes what, and which intrinsics are to be estimated."""
    preset = "tao2021" if settings.method == "tao2021" else "brown"
    estimated = estimated_mask(preset) if settings.intrinsics == "free" else np.zeros(16, dtype=bool)
    names = [c.id if settings.own_intrinsics else c.intrinsics_group for c in session.cameras]
    group = np.unique(names, return_inverse=True)[1].reshape(-1)
    return Network(
        features.of_observation, observations.camera, observations.uv, observations.sigma, len(features),
        np.tile(estimated, (len(names), 1)), group,
    )  # fmt: skip


def points_as_in_the_paper(start: Grown, local: LocalNetwork, features: Features, spherical: bool) -> FloatArray:
    """Points (p,3) chained through the triples and, unless none-SPO, moved onto their placements' spheres."""
    points = chain_points(
        local.paths, local.triples, local.graph.scale, start.state.rotation, start.state.translation, len(features)
    )
    return project_to_spheres(points, features.placement) if spherical else points


def adjust_or_hold(
    network: Network, start: Grown, points: FloatArray | None, local: LocalNetwork, known: FloatArray,
    settings: CalibrationSettings, context: Context,
) -> tuple[Adjusted, Covariance | None, BoolArray]:  # fmt: skip
    """The bundle adjustment in the reference camera's frame, with its covariance.

    Cameras whose intrinsics the data cannot carry are held by their prior; (c,) bool says which.
    """
    candidates = local.keep & start.placed[network.camera]
    held = poorly_observed(network, candidates) & start.placed
    adjusted, cofactors = _adjust(hold(network, known, held, 1.0), start, points, candidates, local, settings, context)
    if held.any():  # again with the noise that only the adjustment tells
        holding = hold(network, known, held, np.sqrt(adjusted.variance))
        adjusted, cofactors = _adjust(holding, start, points, candidates, local, settings, context)
    while cofactors is not None:
        weak = poorly_determined(adjusted.problem, adjusted.state, cofactors, adjusted.variance)
        if not (weak & ~held).any():
            break
        holding = hold(network, known, held | weak, np.sqrt(adjusted.variance))
        again, cofactors_again = _adjust(holding, start, points, candidates, local, settings, context)
        if again.variance > MOST_WORSE_BY_HOLDING * adjusted.variance:
            break
        adjusted, cofactors, held = again, cofactors_again, held | weak
    return adjusted, cofactors, held


def _adjust(
    network: Network, start: Grown, points: FloatArray | None, candidates: BoolArray, local: LocalNetwork,
    settings: CalibrationSettings, context: Context,
) -> tuple[Adjusted, Covariance | None]:  # fmt: skip
    adjusted = adjust(network, start.state, points, candidates, start.placed, settings.engine, context)
    adjusted = replace(adjusted, state=adjusted.state.seen_from(local.graph.reference))
    context.report("uncertainty", 0.0)
    return adjusted, covariance(adjusted.problem, adjusted.state, settings.engine)
