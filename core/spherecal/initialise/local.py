"""The local stage: from observations to triples, their graph and every camera's path to the reference."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.data.observations import Features, Observations, seen_matrix
from spherecal.data.session import Session
from spherecal.geometry.camera import undistort_views
from spherecal.initialise import view_graph
from spherecal.initialise.camera_path import Path, find_paths
from spherecal.initialise.planar import is_flat, reconstruct_planar_triple
from spherecal.initialise.triple import MIN_POINTS, Triple, reconstruct_triple
from spherecal.initialise.two_view import GATE_PX, Pair, TwoViewGate, relative_orientation, vote
from spherecal.initialise.view_graph import MIN_COMMON, CameraGraph

# Pairs of each camera that the two-view gate asks, and that triples are made of. With 113 views of one scene all pairs
# made 9,905 triples, 93 s instead of 9; the network they started ended in the same minimum.
GATED_PARTNERS, PARTNERS = 20, 12
# Points of a triple; those of 36 placements (up to 3,000) took 11 s and start the network no better.
MOST_COMMON = 500
# A scene counts as flat where this share of its pairs of cameras sees a plane; so many pairs are asked.
FLAT_PAIRS, FLAT_SHARE = 40, 0.8


@dataclass(frozen=True)
class LocalNetwork:
    """The result of the local stage: the two-view gate's verdicts (n,), triples, their graph and the paths.

    Only triples on a path have their points: those of a thousand triples take more memory than the observations.
    `pair` is the pair of cameras with most common points where no three have enough.
    """

    keep: BoolArray
    counts: IntArray
    triples: list[Triple]
    graph: CameraGraph
    paths: dict[int, Path]
    pair: Pair | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to start from."""
        return not self.triples and self.pair is None


def reconstruct_locally(
    observations: Observations, features: Features, intrinsics: FloatArray, seed: int, context: Context
) -> LocalNetwork:
    """Two-view gate, triples, graph and paths to the camera in most triples, [Tao21] (3)-(14)."""
    n_cameras = len(observations.cameras)
    xy, usable = undistort_views(observations.uv, observations.camera, intrinsics)
    focal, centre = intrinsics[observations.camera, :2], intrinsics[observations.camera, 2:4]
    flat = np.where(usable[:, None], xy * focal + centre, 0.0)
    table = np.full((n_cameras, len(features)), -1)
    table[observations.camera[usable], features.of_observation[usable]] = np.flatnonzero(usable)

    pairs = view_graph.strongest_pairs(view_graph.common_counts(table >= 0), GATED_PARTNERS)
    gate = vote(table, flat, pairs, GATE_PX, seed, context)
    keep = gate.keep & usable
    seen = seen_matrix(features, observations, keep)
    counts = view_graph.common_counts(seen)

    def solve(cameras: tuple[int, int, int]) -> Triple | None:
        common = gate.common(cameras)
        if len(common) < MIN_POINTS:
            return None
        common = common[:: -(-len(common) // MOST_COMMON)]
        rays = np.stack([xy[table[camera, common]] for camera in cameras])
        return reconstruct(cameras, common, rays, intrinsics[list(cameras), 0])

    reconstruct = reconstruct_planar_triple if _is_flat(gate, table, xy, intrinsics) else reconstruct_triple
    edges = view_graph.strongest_pairs(np.where(pairs > 0, counts, 0), PARTNERS)
    triples = view_graph.solve_triples(view_graph.candidate_triples(seen, edges), n_cameras, solve, MIN_POINTS, context)
    graph = view_graph.build_graph(triples, counts)
    found = find_paths(graph, triples) if triples else {}
    on_a_path = {number for path in found.values() for number in path.triples}
    none = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    triples = [t if i in on_a_path else replace(t, features=none[0], points=none[1]) for i, t in enumerate(triples)]
    pair = None if triples else _strongest_pair(gate, table, xy, intrinsics, seed)
    if pair is not None:
        graph = replace(graph, groups=np.isin(np.arange(n_cameras), pair.cameras).astype(int))
    return LocalNetwork(keep, counts, triples, graph, found, pair)


def _strongest_pair(
    gate: TwoViewGate, table: IntArray, xy: FloatArray, intrinsics: FloatArray, seed: int
) -> Pair | None:
    """The two cameras that agree on most points; None where these do not determine their pose, or are all there is."""
    if ((table >= 0).sum(axis=1) >= MIN_COMMON).sum() < 3 or not gate.consistent:
        return None
    (i, j), common = max(gate.consistent.items(), key=lambda one: len(one[1]))
    if len(common) < MIN_COMMON:
        return None
    focal_px = float(intrinsics[[i, j], 0].mean())
    return relative_orientation((i, j), xy[table[i, common]], xy[table[j, common]], focal_px, seed)


def _is_flat(gate: TwoViewGate, table: IntArray, xy: FloatArray, intrinsics: FloatArray) -> bool:
    """Whether most pairs of cameras see points of one plane, whose triples no factorisation can reconstruct."""
    pairs = [(pair, common) for pair, common in gate.consistent.items() if len(common) >= MIN_COMMON]
    some = [pairs[i] for i in np.unique(np.linspace(0, len(pairs) - 1, FLAT_PAIRS).astype(int))] if pairs else []
    not_flat = 0
    for (i, j), common in some:
        not_flat += not is_flat(xy[table[i, common]], xy[table[j, common]], float(intrinsics[j, 0]))
        if (len(some) - not_flat) / len(some) < FLAT_SHARE:  # whatever the others are
            return False
    return bool(some)


def lasting_reference(local: LocalNetwork, session: Session) -> LocalNetwork:
    """The local network with a reference camera that stays in the rig: not an earlier pose of a split camera."""
    earlier = np.array([camera.earlier_pose_of is not None for camera in session.cameras])
    if not earlier.any():
        return local
    return replace(local, graph=replace(local.graph, groups=np.where(earlier, -1, local.graph.groups)))
