"""The camera graph: common features of cameras, the triples to solve, and the lightest edges, [Tao21] (10)-(13)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.sparse.linalg import cg

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.initialise.triple import Triple

# Common features that two cameras need to be neighbours; fewer made factorisations that failed every second time.
MIN_COMMON = 20
# Solved triples that every edge should have: 1 left start errors 30 % larger, 3 changed nothing but time.
KEEP_AN_EDGE = 2


def common_counts(seen: BoolArray) -> IntArray:
    """Features that each pair of cameras has in common, (c, c), from seen (c, m); one matrix product."""
    pattern = seen.astype(np.float32)
    return np.rint(pattern @ pattern.T).astype(np.int64)


def groups_of(linked: IntArray, placed: BoolArray) -> list[IntArray]:
    """Connected groups of cameras by their links (c,c): the placed ones first, then the largest."""
    label = connected_components(csr_array(linked > 0), directed=False)[1]
    groups = [np.flatnonzero(label == value) for value in dict.fromkeys(label.tolist())]
    return sorted(groups, key=lambda group: (-int(placed[group].any()), -len(group), int(group[0])))


def strongest_pairs(counts: IntArray, partners: int) -> IntArray:
    """Counts (c,c) of each camera's pairs with most common features (c,c), and of those that keep the graph connected.

    The rest is 0. A pair stays when either camera counts the other among its best.
    """
    apart = counts * ~np.eye(len(counts), dtype=bool)
    best = np.argsort(-apart, axis=1, kind="stable")[:, :partners]
    keep = np.zeros(counts.shape, dtype=bool)
    keep[np.arange(len(counts))[:, None], best] = True
    forest = minimum_spanning_tree(csr_array(np.where(apart > 0, -apart, 0))).toarray() != 0
    keep |= keep.T | forest | forest.T
    return np.where(keep, apart, 0) + np.diag(counts.diagonal())


@dataclass(frozen=True)
class Candidates:
    """Triples of cameras (t, 3) whose three edges have enough features, with their common features (t,), most first."""

    cameras: IntArray
    common: IntArray


def candidate_triples(seen: BoolArray, counts: IntArray, min_common: int = MIN_COMMON) -> Candidates:
    """All triples whose every pair shares at least `min_common` features: seen (c,m), common ones (c,c)."""
    patterns, weight = np.unique(seen.T, axis=0, return_counts=True)
    edge = counts >= min_common
    rows, common = [], []
    for i in range(len(seen)):
        neighbours = np.flatnonzero(edge[i, i + 1 :]) + i + 1
        mine = patterns[:, i]
        shared = patterns[mine][:, neighbours].astype(np.float32)
        count = np.rint((shared * weight[mine, None].astype(np.float32)).T @ shared).astype(np.int64)
        a, b = np.nonzero(np.triu(edge[np.ix_(neighbours, neighbours)], 1))
        rows.append(np.column_stack([np.full(len(a), i), neighbours[a], neighbours[b]]))
        common.append(count[a, b])
    cameras, number = np.concatenate(rows), np.concatenate(common)
    order = np.argsort(-number, kind="stable")
    return Candidates(cameras[order], number[order])


Solve = Callable[[tuple[int, int, int]], Triple | None]


def solve_triples(
    candidates: Candidates, n_cameras: int, solve: Solve, min_points: int, context: Context
) -> list[Triple]:
    """The triples worth solving: until every edge has `KEEP_AN_EDGE` of them, the richest first.

    The pruned ones are the re-try list. They are solved too as long as cameras stay apart that they could join, since
    the triples of an edge may all have failed.
    """
    fit: list[Triple] = []
    in_edge = np.zeros((n_cameras, n_cameras), dtype=int)
    left_out: list[int] = []

    def attempt(i: int, j: int, k: int) -> None:
        triple = solve((i, j, k))
        if triple is not None:
            fit.append(triple)
            in_edge[np.ix_((i, j, k), (i, j, k))] += 1

    for number, (i, j, k) in enumerate(candidates.cameras.tolist()):
        if candidates.common[number] < min_points:
            break
        if min(in_edge[i, j], in_edge[i, k], in_edge[j, k]) >= KEEP_AN_EDGE:
            left_out.append(number)
            continue
        if number % 8 == 0:
            context.report("triples", number / len(candidates.cameras))
        attempt(i, j, k)
    part = _parts(fit, n_cameras)
    for i, j, k in candidates.cameras[left_out].tolist():
        if part.max() == 0:
            break
        if len(np.unique(part[[i, j, k]])) > 1:
            context.check()
            attempt(i, j, k)
            part = _parts(fit, n_cameras)
    return fit


def _parts(triples: list[Triple], n_cameras: int) -> IntArray:
    """Cameras that are connected by triples whose errors the graph accepts: the number of each camera's part, (c,)."""
    linked = np.zeros((n_cameras, n_cameras), dtype=bool)
    threshold = error_threshold(triples)
    for triple in triples:
        good = np.array(triple.cameras)[triple.error_px <= threshold]
        linked[np.ix_(good, good)] = True
    return connected_components(csr_array(linked), directed=False)[1]


@dataclass(frozen=True)
class Edge:
    """The lightest reconstruction of a pair of cameras: its triple's number and its weight `alpha` of (13)."""

    triple: int
    weight: float


@dataclass(frozen=True)
class CameraGraph:
    """Lightest edges `edges[j][g]` of pairs, the same both ways; `groups` (c,): how many triples a camera is in."""

    edges: tuple[dict[int, Edge], ...]
    groups: IntArray
    scale: FloatArray

    @property
    def reference(self) -> int:
        """The camera that belongs to most triples; the lowest index among equals."""
        return self.references[0]

    @property
    def references(self) -> tuple[int, ...]:
        """All cameras, those first that belong to most triples."""
        return tuple(np.argsort(-self.groups, kind="stable").tolist())


# A camera's mean error in a triple is 10 to 40 px while the intrinsics are nominal and the distortion unknown; 5 times
# the median keeps all good triples and refuses the failed ones (above 600 px on rig B).
THRESHOLD_FACTOR = 5.0


# TH_er of [Tao21], which gives no value. On rigs A and B groups of 30 common points and more stay below 190 px with
# nominal intrinsics, failed ones reach thousands. Rig B's adjustments ended in the optimum in 11 of 12 runs with it, in
# 9 without any.
TH_ER_PX = 250.0


@dataclass(frozen=True)
class EdgeWeights:
    """xi1 and xi2 of (13), and TH_er of (11) in px."""

    error: float = 1.0
    count: float = 1.0
    threshold_px: float = TH_ER_PX


def error_threshold(triples: list[Triple]) -> float:
    """The mean reprojection error in px above which `auto` does not use a camera's part in a triple."""
    return THRESHOLD_FACTOR * float(np.median([t.error_px.mean() for t in triples])) if triples else 0.0


def build_graph(triples: list[Triple], counts: IntArray) -> CameraGraph:
    """The graph of lightest edges over all triples, and common scales."""
    edges, groups = lightest_edges(triples, counts, EdgeWeights(threshold_px=error_threshold(triples)))
    return CameraGraph(edges, groups, common_scales(triples) if triples else np.zeros(0))


def lightest_edges(
    triples: list[Triple], counts: IntArray, weights: EdgeWeights
) -> tuple[tuple[dict[int, Edge], ...], IntArray]:
    """The lightest reconstruction of every pair, the same both ways, and how many triples share each camera (c,)."""
    edges: list[dict[int, Edge]] = [{} for _ in counts]
    groups = np.zeros(len(counts), dtype=int)
    for number, triple in enumerate(triples):
        groups[list(triple.cameras)] += 1
        for j, g, weight in edges_of(triple, counts, weights):
            if np.isfinite(weight) and (g not in edges[j] or weight < edges[j][g].weight):
                edges[j][g] = edges[g][j] = Edge(number, weight)
    return tuple(edges), groups


def edges_of(triple: Triple, counts: IntArray, weights: EdgeWeights) -> list[tuple[int, int, float]]:
    """A triple's three pairs of cameras with their weights (10)-(13)."""
    cameras, error = triple.cameras, triple.error_px
    return [
        (cameras[a], cameras[b], edge_weight(error[a], error[b], int(counts[cameras[a], cameras[b]]), weights))
        for a, b in ((0, 1), (0, 2), (1, 2))
    ]


def edge_weight(error_j: float, error_g: float, common: int, weights: EdgeWeights) -> float:
    """Weight of an edge (13): xi1 times the mean reprojection error in px (11), xi2 over the common features (12)."""
    if not (0 <= error_j <= weights.threshold_px and 0 <= error_g <= weights.threshold_px) or common <= 0:
        return float("inf")
    return weights.error * (error_j + error_g) / 2 + weights.count / common


def common_scales(triples: list[Triple]) -> FloatArray:
    """Factors (t,) that give all triples one scale: triples that share an edge must agree on its length.

    The paper chains translations of triples as they are, but each has a scale of its own. Least absolute deviations of
    the logarithms of base lengths, by reweighting; of mean zero in each part that hangs together. The equations have a
    null space (a constant in each part), which conjugate gradients (M. Hestenes, E. Stiefel, 1952) do not mind; they
    take 0.02 s for 400 triples.
    """
    pair_of: dict[tuple[int, int], int] = {}
    rows: list[tuple[int, int, float]] = []
    for number, triple in enumerate(triples):
        for a, b in ((0, 1), (0, 2), (1, 2)):
            pair = (triple.cameras[a], triple.cameras[b])
            key = (min(pair), max(pair))
            base = max(triple.baseline(a, b), 1e-12)
            rows.append((number, pair_of.setdefault(key, len(pair_of)), float(np.log(base))))
    t, e, value = (np.array(column) for column in zip(*rows, strict=True))
    weight, log_scale = np.ones(len(t)), np.zeros(len(triples))
    share = csr_array((weight, (t, e)))
    part = connected_components(share @ share.T, directed=False)[1]
    for _ in range(10):
        # eliminate the pairs: each is the weighted mean of (scale + base) over its triples
        share = csr_array((weight, (t, e)))
        total, own = share.sum(axis=0), share.sum(axis=1)
        mean = np.bincount(e, weight * value) / total
        right = -np.bincount(t, weight * (value - mean[e]))
        normal = diags_array(own) - share @ diags_array(1 / total) @ share.T
        log_scale = cg(normal, right, log_scale, rtol=1e-12, atol=1e-12, M=diags_array(1 / own))[0]
        length = np.bincount(e, weight * (value + log_scale[t])) / total
        weight = 1.0 / np.maximum(np.abs(value + log_scale[t] - length[e]), 1e-3)
    return np.exp(log_scale - (np.bincount(part, log_scale) / np.bincount(part))[part])
