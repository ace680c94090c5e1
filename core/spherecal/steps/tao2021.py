"""The method of [Tao21] to the letter, under its own headings; docs/tao2021.md holds it against the text.

Nothing of ours is in between: no two-view gate, no common scale of the groups, no resection, no robust start, no
priors, no rejected observations, no rigid ball. That page also says what the text leaves open and what is taken here.
"""

from dataclasses import replace

import numpy as np

from spherecal.adjust.bundle import Adjustment, datum_defect
from spherecal.adjust.least_squares import minimise, minimise_with_identity
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.state import State
from spherecal.ball.fit import finished_solution
from spherecal.ball.rigid import ModelChoice
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context, Stopwatch
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, Findings
from spherecal.data.observations import find_features, seen_matrix
from spherecal.data.rig import Calibration
from spherecal.data.session import Recording
from spherecal.geometry.camera import undistort_views
from spherecal.geometry.sphere import fit_sphere_geometrically
from spherecal.initialise import view_graph
from spherecal.initialise.camera_path import chain_points, chain_poses, find_paths
from spherecal.initialise.incremental import InitialPoses
from spherecal.initialise.local import LocalNetwork, lasting_reference
from spherecal.initialise.triple import Triple, factorised
from spherecal.initialise.view_graph import CameraGraph, EdgeWeights
from spherecal.result.build_result import build_failed_result, build_result
from spherecal.scale.metric import MetricFit, in_millimetres
from spherecal.steps.ball_stages import StartValues, describe_network, run_of
from spherecal.steps.settings import CalibrationSettings

# Steps at most: from starts of hundreds of pixels the slowest that arrived took 96.
MOST_STEPS = 200


def calibrate_as_published(
    recording: Recording, settings: CalibrationSettings, context: Context, watch: Stopwatch
) -> Calibration:
    """The rig by local reconstruction, OPT, SPO, bundle adjustment and scale, each as in [Tao21]."""
    local = local_reconstruction(recording, settings, context)
    watch.lap("local reconstruction")
    if len(local.paths) < 2:
        return build_failed_result(recording, local, settings.method, watch.seconds)
    recording, local, ungrouped = grouped_points(recording, local, settings)
    start = optimal_path_transformation(recording, local, settings)
    if settings.spherical_projection:
        start = spherical_projection(recording, start)
    watch.lap("start values")
    run = run_of(recording, start, settings, context, watch)
    adjusted = bundle_adjustment(start, settings, context)
    fit = finished_solution(start.network, adjusted, start.poses.placed, run)
    watch.lap("bundle adjustment")
    fit, solution = in_millimetres(recording, fit, run)  # (18)-(19)
    watch.lap("scale")
    metric = MetricFit(fit, ModelChoice("free", Phrase("form-asked-alone")), solution, ungrouped)
    return build_result(recording, local, metric, settings.method, run)


# --- Local reconstruction and adjacency, (3)-(13) ---------------------------------------------------------------------


def local_reconstruction(recording: Recording, settings: CalibrationSettings, context: Context) -> LocalNetwork:
    """All groups of three cameras with TH_pt common points, the adjacency, and every camera's path (14)-(15)."""
    observations, features, intrinsics = recording.observations, recording.features, recording.priors
    xy, usable = undistort_views(observations.uv, observations.camera, intrinsics)
    table = np.full((len(observations.cameras), len(features)), -1)
    table[observations.camera[usable], features.of_observation[usable]] = np.flatnonzero(usable)
    seen = seen_matrix(features, observations, usable)
    counts = view_graph.common_counts(seen)
    candidates = view_graph.candidate_triples(seen, counts, settings.th_pt)
    rich = candidates.cameras[candidates.common >= settings.th_pt]
    groups = []
    for number, cameras in enumerate(rich):
        if number % 8 == 0:
            context.report("triples", number / len(rich))
        common = np.flatnonzero(seen[cameras].all(axis=0))
        rays = np.stack([xy[table[camera, common]] for camera in cameras])
        groups.append(reconstructed_group(cameras, common, rays, intrinsics[cameras, 0]))
    graph = adjacency(groups, counts, settings.weights)
    paths = find_paths(graph, groups, settings.search, settings.base) if groups else {}
    return lasting_reference(LocalNetwork(usable, counts, groups, graph, paths), recording.session)


def reconstructed_group(cameras: IntArray, common: IntArray, xy: FloatArray, focal_px: FloatArray) -> Triple:
    """A group (3)-(9) from `xy` (3,n,2) with each camera's mean reprojection error E_R; infinite where it failed."""
    found = factorised(xy)
    i, j, k = (int(c) for c in cameras)
    if found is None:
        found, common = (np.zeros((3, 3, 3)), np.zeros((3, 3)), np.zeros((0, 3))), common[:0]
        return Triple((i, j, k), found[0], found[1], common, found[2], np.full(3, np.inf))
    rotation, translation, points = found
    x = np.einsum("cij,nj->cni", rotation, points) + translation[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.linalg.norm(x[..., :2] / x[..., 2:] - xy, axis=2).mean(axis=1) * focal_px
    return Triple((i, j, k), rotation, translation, common, points, np.where(np.isfinite(error), error, np.inf))


def adjacency(groups: list[Triple], counts: IntArray, weights: EdgeWeights) -> CameraGraph:
    """The lightest reconstruction of every pair in its own scale, and how many groups share each camera."""
    edges, shared = view_graph.lightest_edges(groups, counts, weights)
    return CameraGraph(edges, shared, np.ones(len(groups)))


def grouped_points(
    recording: Recording, local: LocalNetwork, settings: CalibrationSettings
) -> tuple[Recording, LocalNetwork, Findings]:
    """The recording of the points that some group gives, and what it leaves out: points that two cameras alone see."""
    o, features = recording.observations, recording.features
    grouped = np.zeros(len(features), dtype=bool)
    for group, _ in point_sources(local, settings):
        grouped[group.features] = True
    keep, index = grouped[features.of_observation], np.cumsum(grouped) - 1
    if keep.all():
        return recording, local, ()
    own = o.select(keep)
    triples = [replace(group, features=index[group.features]) for group in local.triples]
    out = int((~keep).sum())
    values = {"count": out, "observations": len(keep), "percent": 100 * out / len(keep)}
    of_groups = replace(local, keep=local.keep[keep], triples=triples)
    some = Recording(recording.session, own, find_features(own))
    return some, of_groups, (Finding("points-without-group", "info", values),)


# --- Optimal path transformation (OPT), (14)-(17), and none-OPT, Algorithm 3 ------------------------------------------


def optimal_path_transformation(
    recording: Recording, local: LocalNetwork, settings: CalibrationSettings
) -> StartValues:
    """Poses and points in the reference camera's frame, chained along the paths."""
    intrinsics, features = recording.priors, recording.features
    network = replace(describe_network(recording, settings), sigma=np.ones((len(recording.observations), 2)))
    rotation, translation = chain_poses(local.paths, local.triples, local.graph.scale, len(intrinsics))
    placed = np.isfinite(translation[:, 0])
    points = chain_points(point_sources(local, settings), rotation, translation, len(features))
    state = State(rotation, translation, intrinsics, points)
    return StartValues(network, local, InitialPoses(state, placed))


def point_sources(local: LocalNetwork, settings: CalibrationSettings) -> list[tuple[Triple, int]]:
    """The groups that give points, first the one to believe, and the camera along whose path (17) chains them.

    OPT believes the lightest group (13) and refuses those beyond TH_er; none-OPT takes them as they are listed. The
    camera is the one with the shortest path.
    """

    def length(camera: int) -> tuple[float, int]:
        return local.paths[camera].length, len(local.paths[camera].cameras)

    def weight(group: Triple) -> float:
        return sum(w for _, _, w in view_graph.edges_of(group, local.counts, settings.weights))

    groups = [g for g in local.triples if np.isfinite(g.error_px).all() and any(c in local.paths for c in g.cameras)]
    if settings.search == "first-listed":
        groups.sort(key=lambda g: g.cameras)
    elif settings.search != "first":
        groups = sorted((g for g in groups if np.isfinite(weight(g))), key=weight)
    return [(g, min((c for c in g.cameras if c in local.paths), key=length)) for g in groups]


# --- Spherical projection optimisation (SPO), Algorithm 2 -------------------------------------------------------------


def spherical_projection(recording: Recording, start: StartValues) -> StartValues:
    """The start with every placement's points moved radially onto the sphere fitted to them.

    Only an initial value: a real ball is off by a millimetre, and the adjustment must be free to leave the sphere.
    """
    points, placement = start.poses.state.points.copy(), recording.features.placement
    for p in np.unique(placement):
        own = np.flatnonzero((placement == p) & np.isfinite(points[:, 0]))
        sphere = fit_sphere_geometrically(points[own])
        if sphere is None:
            continue
        ray = points[own] - sphere.centre
        points[own] = sphere.centre + ray * (sphere.radius / np.linalg.norm(ray, axis=1))[:, None]
    return with_points(start, points)


def with_points(start: StartValues, points: FloatArray) -> StartValues:
    """The start with other points (m,3)."""
    return replace(start, poses=replace(start.poses, state=replace(start.poses.state, points=points)))


# --- Bundle adjustment, (2) -------------------------------------------------------------------------------------------


def bundle_adjustment(start: StartValues, settings: CalibrationSettings, context: Context) -> Adjustment:
    """All poses, intrinsics and points at once by Levenberg-Marquardt, from exactly the start's values."""
    network, placed = start.network, start.poses.placed
    used = observed_points(start)
    state = plain_state(start)
    problem, rows = network.problem(used, network.free, placed, weighted=True)

    def watched(iteration: int, cost: float) -> None:
        context.report_iteration("bundle adjustment", iteration / MOST_STEPS, iteration, cost)

    if settings.damping == "identity":
        minimum = minimise_with_identity(problem, state, MOST_STEPS, watched)
    else:
        minimum = minimise(problem, state, Settings(max_iterations=MOST_STEPS), watched)
    known = network.views(used) > 0
    final = replace(minimum.state, points=np.where(known[:, None], minimum.state.points, np.nan))
    redundancy = problem.rows - problem.unknowns + datum_defect(problem)
    return Adjustment(final, problem, rows, used, minimum, redundancy)


def plain_state(start: StartValues) -> State:
    """The start's values, with numbers also where a camera or a point has none: those take no part."""
    state, placed = start.poses.state, start.poses.placed
    rotation = np.where(placed[:, None, None], state.rotation, np.eye(3))
    translation = np.where(placed[:, None], state.translation, 0.0)
    return State(rotation, translation, state.intrinsics, np.nan_to_num(state.points))


def observed_points(start: StartValues) -> BoolArray:
    """Observations (n,) of cameras with a pose, of points with a start value that two such cameras see."""
    network = start.network
    used = start.candidates & np.isfinite(start.poses.state.points[network.feature, 0])
    return used & (network.views(used) >= 2)[network.feature]
