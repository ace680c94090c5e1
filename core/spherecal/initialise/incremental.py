"""The start of the adjustment: cameras placed along their paths, in rings where the paths are long.

Short paths are chained at once. Over many hops the errors of the nominal intrinsics add up (0.3 m over 7.5 m, and the
adjustment stuck at 4 to 14 px). So beyond `DIRECT_HOPS` the network grows ring by ring, with a short robust adjustment
after each. Cameras that no triple reaches are resected at the end where the points allow it. See
docs/decisions/0003-start-of-the-adjustment.md.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust import bundle
from spherecal.adjust.network import Network
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal.geometry.camera import undistort
from spherecal.geometry.resection import resect
from spherecal.initialise.camera_path import chain_poses, relative_pose
from spherecal.initialise.local import LocalNetwork
from spherecal.initialise.triple import Triple

DIRECT_HOPS = 3
# Observations a camera brings into the short adjustments: 150 place it as well as all of a thousand. Large networks
# grow by the latter.
ENOUGH_OBSERVATIONS, LARGE_OBSERVATIONS = 150, 1000
RING_ITERATIONS = 15
# The share of a camera's agreeing points below which its resection is not believed.
MIN_AGREEING_SHARE = 0.5
RESECTION_GATE_PX = 12.0
# Of the cameras without a pose a round takes those that see at least this share of what the best sees of known points.
ROUND_SHARE = 0.5


@dataclass(frozen=True)
class InitialPoses:
    """Start values: the state and which cameras have a pose (c,)."""

    state: State
    placed: BoolArray


def grow(
    local: LocalNetwork, network: Network, intrinsics: FloatArray, candidates: BoolArray, context: Context
) -> InitialPoses:
    """Poses of all cameras that triples or points reach, in the reference camera's frame."""
    if np.count_nonzero(candidates) > bundle.LARGE_START:
        candidates = bundle.spread_observations(network, candidates, LARGE_OBSERVATIONS)
    rotation, translation = chain_poses(local.paths, local.triples, local.graph.scale, len(intrinsics))
    if local.pair is not None:
        first, second = local.pair.cameras
        rotation[first], translation[first] = np.eye(3), 0.0
        rotation[second], translation[second] = local.pair.rotation, local.pair.translation
    state = State(rotation, translation, intrinsics, np.full((network.n_features, 3), np.nan))
    resected = InitialPoses(state, np.isfinite(translation[:, 0]))
    if max((len(path.cameras) - 1 for path in local.paths.values()), default=0) > DIRECT_HOPS:
        resected = _grow_in_rings(local, network, resected.state, candidates, context)
    if resected.placed.sum() >= 2 and not resected.placed.all():
        state = adjust_placed(network, resected.state, resected.placed, candidates, context)
        resected = resect_rest(network, InitialPoses(state, resected.placed), candidates, context)
    return resected


def _grow_in_rings(
    local: LocalNetwork, network: Network, state: State, candidates: BoolArray, context: Context
) -> InitialPoses:
    hops = {camera: len(path.cameras) - 1 for camera, path in local.paths.items()}
    last = max(hops.values())
    for ring in range(DIRECT_HOPS, last + 1):
        context.report("growing the network", ring / last, Phrase("ring-of", {"ring": ring, "rings": last}))
        if ring > DIRECT_HOPS:
            state = _place_ring([c for c in sorted(hops) if hops[c] == ring], local, network, state, candidates)
        placed = np.array([hops.get(c, last + 1) <= ring for c in range(len(network.group))])
        state = adjust_placed(network, state, placed, candidates, context)
    return InitialPoses(state, np.isfinite(state.translation[:, 0]))


def _place_ring(ring: list[int], local: LocalNetwork, network: Network, state: State, candidates: BoolArray) -> State:
    """The ring's cameras placed by resection from the points known so far, or else along their paths."""
    rotation, translation = state.rotation.copy(), state.translation.copy()
    known = np.isfinite(state.points[network.feature, 0]) & candidates
    for camera in ring:
        pose = resect_camera(network, state, camera, np.flatnonzero(known & (network.camera == camera)))
        if pose is None:
            pose = _pose_from_parent(local, state, camera)
        rotation[camera], translation[camera] = pose
    return replace(state, rotation=rotation, translation=translation)


def _pose_from_parent(local: LocalNetwork, state: State, camera: int) -> tuple[FloatArray, FloatArray]:
    """The first step of the camera's path, its triple scaled by the points it shares with the adjusted network."""
    path = local.paths[camera]
    triple, parent = local.triples[path.triples[0]], path.cameras[1]
    scale = _scale_to_adjusted(triple, parent, state) or local.graph.scale[path.triples[0]]
    step_r, step_t = relative_pose(triple, camera, parent, scale)
    return step_r @ state.rotation[parent], step_r @ state.translation[parent] + step_t


def _scale_to_adjusted(triple: Triple, parent: int, state: State) -> float | None:
    """The size of the adjusted network relative to the triple: the median ratio of depths in the parent camera."""
    known = np.isfinite(state.points[triple.features, 0])
    if known.sum() < 5:
        return None
    j = triple.cameras.index(parent)
    local = triple.points[known] @ triple.rotation[j, 2] + triple.translation[j, 2]
    adjusted = state.points[triple.features[known]] @ state.rotation[parent, 2] + state.translation[parent, 2]
    ratio = float(np.median(adjusted / local))
    return ratio if ratio > 0 else None


def adjust_placed(network: Network, state: State, placed: BoolArray, candidates: BoolArray, context: Context) -> State:
    """A short robust adjustment of placed cameras (c,) over the best of some rows (n,); points NaN where unknown."""
    some = bundle.best_observations(network, candidates & placed[network.camera], ENOUGH_OBSERVATIONS)
    step = bundle.RobustStep(bundle.START_INTRINSICS, RING_ITERATIONS, "growing the network")
    state = bundle.robust_adjustment(network, bundle.triangulated(network, state, some), some, placed, step, context)
    # from here on only features matter by which cameras to come are placed
    waiting = np.zeros(network.n_features, dtype=bool)
    waiting[network.feature[candidates & ~placed[network.camera]]] = True
    return bundle.triangulated(network, state, candidates & placed[network.camera] & waiting[network.feature])


Follow = Callable[[InitialPoses], InitialPoses]


def resect_rest(
    network: Network, resected: InitialPoses, candidates: BoolArray, context: Context, follow: Follow = lambda now: now
) -> InitialPoses:
    """Poses of cameras that have none yet, those first that see most known points, an adjustment after each round."""
    state, placed = resected.state, resected.placed.copy()
    tried: set[int] = set()
    while True:
        known = np.isfinite(state.points[network.feature, 0]) & candidates
        count = np.bincount(network.camera[known], minlength=len(placed))
        count[placed] = 0
        count[list(tried)] = 0
        if count.max(initial=0) == 0:
            return InitialPoses(state, placed)
        rotation, translation, found = state.rotation.copy(), state.translation.copy(), []
        for camera in np.flatnonzero(count >= ROUND_SHARE * count.max()).tolist():
            pose = resect_camera(network, state, camera, np.flatnonzero(known & (network.camera == camera)))
            if pose is None:
                tried.add(camera)
                continue
            rotation[camera], translation[camera] = pose
            found.append(camera)
        if not found:
            continue
        tried.clear()
        more = placed | np.isin(np.arange(len(placed)), found)
        resected = follow(InitialPoses(replace(state, rotation=rotation, translation=translation), more))
        state, placed = adjust_placed(network, resected.state, resected.placed, candidates, context), resected.placed


def resect_camera(network: Network, state: State, camera: int, rows: IntArray) -> tuple[FloatArray, FloatArray] | None:
    """Rotation and translation of a camera from its rows (k,) of known points; None where few agree."""
    xy, usable = undistort(network.uv[rows], state.intrinsics[camera])
    rows, xy = rows[usable], xy[usable]
    points = network.only(rows).world_points(state)
    pose = resect(points, xy, RESECTION_GATE_PX / state.intrinsics[camera, 0])
    return None if pose is None or pose[2] < MIN_AGREEING_SHARE * len(rows) else pose[:2]
