"""The camera graph and the paths through it, against counting and enumeration by brute force."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, pairwise, permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spherecal.base.context import Context
from spherecal.base.errors import Cancelled
from spherecal.geometry.rotation import exp_rotation
from spherecal.initialise.camera_path import BASE, Path, chain_points, chain_poses, find_paths, relative_pose
from spherecal.initialise.triple import Triple
from spherecal.initialise.view_graph import (
    KEEP_AN_EDGE,
    MIN_COMMON,
    CameraGraph,
    Candidates,
    Edge,
    EdgeWeights,
    build_graph,
    candidate_triples,
    common_counts,
    common_scales,
    edge_weight,
    solve_triples,
)
from spherecal.steps.tao2021 import adjacency


def random_views(seed: int, cameras: int = 9, features: int = 400) -> np.ndarray:
    """Which camera sees which feature: neighbours on a ring share most."""
    rng = np.random.default_rng(seed)
    at, where = np.arange(cameras), rng.uniform(0, cameras, features)
    apart = np.abs((at[:, None] - where + cameras / 2) % cameras - cameras / 2)
    return (apart < 2.2) & (rng.random((cameras, features)) < 0.7)


def stub(cameras: tuple[int, int, int], error: float | tuple[float, float, float] = 1.0, scale: float = 1.0) -> Triple:
    """A triple whose cameras stand at known places of the world, all lengths divided by `scale`."""
    rotation, place = true_pose(cameras)
    return Triple(
        cameras,
        rotation,
        -np.einsum("cij,cj->ci", rotation, place) / scale,
        np.arange(12),
        np.ones((12, 3)),
        np.ones(3) * error,
    )


def true_pose(cameras: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    rng = [np.random.default_rng(1000 + c) for c in cameras]
    return exp_rotation(np.array([r.normal(size=3) for r in rng])), np.array([r.uniform(-500, 500, 3) for r in rng])


def test_common_counts_are_those_of_counting() -> None:
    seen = random_views(0)
    counts = common_counts(seen)
    for i, j in combinations(range(len(seen)), 2):
        assert counts[i, j] == counts[j, i] == sum(a and b for a, b in zip(seen[i], seen[j], strict=True))
    assert counts.diagonal().tolist() == seen.sum(axis=1).tolist()
    assert counts.dtype.kind == "i"


def test_common_counts_stay_exact_for_many_features() -> None:
    assert common_counts(np.ones((2, 300_001), dtype=bool))[0, 1] == 300_001


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("least", [1, MIN_COMMON, 60])
def test_candidates_are_those_of_brute_force(seed: int, least: int) -> None:
    seen = random_views(seed)
    candidates = candidate_triples(seen, common_counts(seen), least)
    expected = {
        (i, j, k): int((seen[i] & seen[j] & seen[k]).sum())
        for i, j, k in combinations(range(len(seen)), 3)
        if min((seen[a] & seen[b]).sum() for a, b in ((i, j), (i, k), (j, k))) >= least
    }
    found = {tuple(map(int, c)): int(n) for c, n in zip(candidates.cameras, candidates.common, strict=True)}
    assert found == expected
    assert len(candidates.common) == len(expected)
    assert (np.diff(candidates.common) <= 0).all()


def test_no_candidates_without_a_third_camera() -> None:
    for seen in (np.ones((2, 50), dtype=bool), np.ones((1, 50), dtype=bool), np.zeros((4, 50), dtype=bool)):
        assert len(candidate_triples(seen, common_counts(seen)).common) == 0


class Solver:
    """Stands in for the reconstruction: remembers what it was asked and fails where it is told to."""

    def __init__(self, failing: set[tuple[int, int, int]] | None = None) -> None:
        self.asked: list[tuple[int, int, int]] = []
        self.failing = failing or set()

    def __call__(self, cameras: tuple[int, int, int]) -> Triple | None:
        self.asked.append(cameras)
        return None if cameras in self.failing else stub(cameras)


@pytest.mark.parametrize("seed", range(4))
def test_pruning_keeps_enough_triples_an_edge(seed: int) -> None:
    seen = np.random.default_rng(seed).random((14, 1000)) < 0.4
    candidates = candidate_triples(seen, common_counts(seen))
    solver = Solver()
    solved = solve_triples(candidates, 14, solver, 12, Context())
    assert len(candidates.common) == 364
    assert len(solved) <= 2 * 91  # at most two for each of the 91 edges
    assert len(set(solver.asked)) == len(solver.asked)
    every, kept = edge_counts(candidates.cameras), edge_counts(np.array([t.cameras for t in solved]))
    for edge, count in every.items():
        assert kept.get(edge, 0) >= min(KEEP_AN_EDGE, count), edge


def edge_counts(triples: np.ndarray) -> dict[tuple[int, int], int]:
    counts: dict[tuple[int, int], int] = {}
    for cameras in triples:
        for a, b in combinations(sorted(map(int, cameras)), 2):
            counts[a, b] = counts.get((a, b), 0) + 1
    return counts


def test_richest_triples_come_first_and_poor_ones_never() -> None:
    cameras = np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4], [0, 3, 4]])
    solver = Solver()
    solve_triples(Candidates(cameras, np.array([90, 50, 12, 11])), 5, solver, 12, Context())
    assert solver.asked == [(0, 1, 2), (1, 2, 3), (2, 3, 4)]


class FailingLater(Solver):
    """Reconstructs camera 5's richest triples so badly that the graph refuses them."""

    bad = ((0, 1, 5), (1, 2, 5), (2, 3, 5), (0, 3, 5))

    def __call__(self, cameras: tuple[int, int, int]) -> Triple | None:
        self.asked.append(cameras)
        return stub(cameras, 600.0 if cameras in self.bad else 1.0)


def test_pruned_triples_are_tried_again_for_a_camera_that_stays_apart() -> None:
    # camera 5's edges have two triples each from the four that turn out to be bad: the last two are pruned at first
    cameras = [*combinations(range(5), 3), *FailingLater.bad, (0, 2, 5), (1, 3, 5)]
    candidates = Candidates(np.array(cameras), np.arange(200, 200 - len(cameras), -1))
    solver = FailingLater()
    solved = solve_triples(candidates, 6, solver, 12, Context())
    assert solver.asked[-1] == (0, 2, 5)
    counts = np.full((6, 6), 30)
    assert set(find_paths(build_graph(solved, counts), solved)) == set(range(6))
    assert (1, 3, 5) not in solver.asked  # one is enough
    good = Solver()
    solve_triples(candidates, 6, good, 12, Context())
    assert (0, 2, 5) not in good.asked


def test_triples_can_be_cancelled() -> None:
    seen = random_views(0)
    with pytest.raises(Cancelled):
        solve_triples(candidate_triples(seen, common_counts(seen)), 9, Solver(), 12, Context(is_cancelled=lambda: True))


def test_edge_weight_is_that_of_the_paper() -> None:
    plain = EdgeWeights(threshold_px=10.0)
    assert edge_weight(2.0, 4.0, 50, plain) == pytest.approx(3.0 + 1 / 50)
    assert edge_weight(2.0, 4.0, 50, EdgeWeights(0.5, 20.0, 10.0)) == pytest.approx(1.5 + 20 / 50)
    assert edge_weight(0.0, 10.0, 50, plain) < np.inf
    for bad in ((10.1, 1.0, 50), (1.0, 10.1, 50), (1.0, 1.0, 0), (np.nan, 1.0, 50), (-1.0, 1.0, 50)):
        assert edge_weight(*bad, plain) == np.inf


def test_graph_keeps_the_lightest_edge_of_each_pair_both_ways() -> None:
    triples = [stub((0, 1, 2), 5.0), stub((1, 2, 3), 2.0), stub((0, 2, 4), 3.0), stub((2, 3, 4), (1.0, 2.0, 6.0))]
    counts = np.full((6, 6), 40)
    counts[2, 3] = counts[3, 2] = 100
    graph = build_graph(triples, counts)
    expected: dict[tuple[int, int], tuple[float, int]] = {}
    for number, t in enumerate(triples):
        for a, b in combinations(range(3), 2):
            j, g = t.cameras[a], t.cameras[b]
            weight = (t.error_px[a] + t.error_px[b]) / 2 + 1 / counts[j, g]
            expected[j, g] = min(expected.get((j, g), (np.inf, -1)), (weight, number))
    for (j, g), (weight, number) in expected.items():
        assert graph.edges[j][g] == graph.edges[g][j]
        assert graph.edges[j][g].triple == number and graph.edges[j][g].weight == pytest.approx(weight)
    assert sum(map(len, graph.edges)) == 2 * len(expected)
    assert graph.groups.tolist() == [2, 2, 4, 2, 2, 0]
    assert graph.reference == 2


def test_reference_is_the_first_among_equals() -> None:
    assert build_graph([stub((3, 1, 2))], np.full((5, 5), 30)).reference == 1


def test_failed_triples_make_no_edges() -> None:
    good = [stub(c, 10.0) for c in ((0, 1, 2), (1, 2, 3), (0, 2, 3))]
    graph = build_graph([*good, stub((3, 4, 5), 600.0)], np.full((6, 6), 30))
    assert graph.edges[4] == {}
    assert graph.edges[3].keys() == {0, 1, 2}


def test_graph_without_triples_is_empty() -> None:
    graph = build_graph([], np.zeros((4, 4), dtype=int))
    assert graph.edges == ({}, {}, {}, {})


def random_triples(seed: int, n: int = 7) -> tuple[list[Triple], np.ndarray]:
    rng = np.random.default_rng(seed)
    chosen = [c for c in combinations(range(n), 3) if rng.random() < 0.5] or [(0, 1, 2)]
    scales = np.exp(rng.normal(0, 1, len(chosen)))
    return [stub(c, scale=s) for c, s in zip(chosen, scales, strict=True)], scales


@pytest.mark.parametrize("seed", range(5))
def test_common_scales_undo_the_triples_own(seed: int) -> None:
    triples, scales = random_triples(seed)
    factor = common_scales(triples) / scales
    np.testing.assert_allclose(factor, factor[0], rtol=1e-8)


def test_common_scales_are_robust() -> None:
    triples, scales = random_triples(1, 8)
    rng = np.random.default_rng(0)
    noisy = []
    for t, s in zip(triples, scales, strict=True):
        error = rng.normal(0, 2.0, (3, 3)) / s
        noisy.append(Triple(t.cameras, t.rotation, t.translation + error, t.features, t.points, t.error_px))
    bent = noisy[3]
    noisy[3] = Triple(  # one of its cameras is entirely elsewhere
        bent.cameras, bent.rotation, bent.translation * [[3.0], [1.0], [1.0]], bent.features, bent.points, bent.error_px
    )
    factor = common_scales(noisy) / scales
    factor /= np.median(factor)
    assert np.abs(np.delete(factor, 3) - 1).max() < 0.02


def test_common_scales_of_separate_parts_hold_within_each() -> None:
    triples = [
        stub((0, 1, 2), scale=2.0),
        stub((1, 2, 3), scale=3.0),
        stub((4, 5, 6), scale=5.0),
        stub((5, 6, 7), scale=7.0),
    ]
    scale = common_scales(triples)
    assert np.isfinite(scale).all() and (scale > 0).all()
    assert scale[0] / scale[1] == pytest.approx(2 / 3, rel=1e-8)
    assert scale[2] / scale[3] == pytest.approx(5 / 7, rel=1e-8)
    assert common_scales([stub((0, 1, 2))]) == pytest.approx([1.0])


weights = st.floats(0.01, 10.0)


@st.composite
def graphs(draw: st.DrawFn) -> CameraGraph:
    """Random small graphs, any number of parts; the reference is camera 0."""
    n = draw(st.integers(2, 6))
    edges: list[dict[int, Edge]] = [{} for _ in range(n)]
    for number, (a, b) in enumerate(combinations(range(n), 2)):
        weight = draw(st.one_of(st.none(), weights))
        if weight is not None:
            edges[a][b] = edges[b][a] = Edge(number, weight)
    groups = np.zeros(n, dtype=int)
    groups[0] = 1
    return CameraGraph(tuple(edges), groups, np.ones(n))


def simple_paths(graph: CameraGraph, start: int) -> Iterator[tuple[tuple[int, ...], float]]:
    """Every path without repetition from a camera to the reference, with its length."""
    others = [c for c in range(len(graph.edges)) if c not in (start, graph.reference)]
    if start == graph.reference:
        yield (start,), 0.0
        return
    for size in range(len(others) + 1):
        for middle in permutations(others, size):
            path = (start, *middle, graph.reference)
            steps = list(pairwise(path))
            if all(b in graph.edges[a] for a, b in steps):
                yield path, sum(graph.edges[a][b].weight for a, b in steps)


def check_is_path(graph: CameraGraph, camera: int, path: Path) -> None:
    assert path.cameras[0] == camera and path.cameras[-1] == graph.reference
    assert len(set(path.cameras)) == len(path.cameras)
    steps = list(zip(path.cameras, path.cameras[1:], strict=False))
    assert path.triples == tuple(graph.edges[a][b].triple for a, b in steps)
    assert path.length == pytest.approx(sum(graph.edges[a][b].weight for a, b in steps))


@pytest.mark.parametrize("base", [1.0, BASE, 2.0])
@given(graphs())
def test_a_star_is_optimal(base: float, graph: CameraGraph) -> None:
    paths = find_paths(graph, [], "opt", base)
    for camera in range(len(graph.edges)):
        every = list(simple_paths(graph, camera))
        assert (camera in paths) == bool(every)  # a camera without a path has none in the answer
        if every:
            check_is_path(graph, camera, paths[camera])
            found = base ** (len(paths[camera].cameras) - 1) * paths[camera].length
            assert found == pytest.approx(min(base ** (len(c) - 1) * g for c, g in every), rel=1e-9)


@given(graphs())
def test_dijkstra_is_shortest_whatever_the_base(graph: CameraGraph) -> None:
    paths = find_paths(graph, [], "dijkstra", 2.0)
    for camera, path in paths.items():
        check_is_path(graph, camera, path)
        assert path.length == pytest.approx(min(g for _, g in simple_paths(graph, camera)), rel=1e-9)


def test_longer_paths_have_to_be_worth_it() -> None:
    """The paper's example: two light edges against a direct one; b = 1.1 lets 0.1221 win over 0.188, b = 2 does not."""
    direct, light = Edge(0, 0.188), Edge(1, 0.06105)
    graph = CameraGraph(
        ({2: direct, 1: light}, {0: light, 2: light}, {0: direct, 1: light}), np.array([1, 0, 0]), np.ones(2)
    )
    assert find_paths(graph, [], "opt", 1.1)[2].cameras == (2, 1, 0)
    assert find_paths(graph, [], "opt", 1.1)[2].length == pytest.approx(0.1221)
    assert find_paths(graph, [], "opt", 2.0)[2].cameras == (2, 0)
    assert find_paths(graph, [], "dijkstra")[2].cameras == (2, 1, 0)


def test_fewer_hops_may_win_in_the_middle_and_lose_at_the_end() -> None:
    """base^m g does not add up: a search over cameras alone keeps the wrong half of the path here."""
    # to camera 1: one hop of 1.0 or two of 0.9 together; then two more hops of 5
    edges: list[dict[int, Edge]] = [{} for _ in range(6)]
    for number, (a, b, weight) in enumerate([(5, 1, 1.0), (5, 4, 0.45), (4, 1, 0.45), (1, 2, 5.0), (2, 0, 5.0)]):
        edges[a][b] = edges[b][a] = Edge(number, weight)
    graph = CameraGraph(tuple(edges), np.array([1, 0, 0, 0, 0, 0]), np.ones(5))
    assert find_paths(graph, [], "opt", 1.1)[5].cameras == (5, 1, 2, 0)
    assert find_paths(graph, [], "dijkstra")[5].cameras == (5, 4, 1, 2, 0)
    assert 3 not in find_paths(graph, [], "opt")


@pytest.mark.parametrize("seed", range(5))
def test_none_opt_takes_the_first_triple_that_reaches(seed: int) -> None:
    triples, _ = random_triples(seed)
    counts = np.full((9, 9), 30)
    graph = build_graph(triples, counts)
    paths = find_paths(graph, triples, "first")
    assert set(paths) == set(find_paths(graph, triples, "opt"))
    for camera, path in paths.items():
        assert path.cameras[0] == camera and path.cameras[-1] == graph.reference
        for (a, b), number in zip(zip(path.cameras, path.cameras[1:], strict=False), path.triples, strict=True):
            assert {a, b} <= set(triples[number].cameras)
    first = next(t for t in triples if graph.reference in t.cameras)
    for camera in first.cameras:
        assert len(paths[camera].cameras) <= 2


def test_the_literal_order_reads_its_list_again_after_every_camera() -> None:
    # by most common features the good triple (0, 3, 4) comes first, by number (0, 1, 2) and its heavy edges
    triples = [stub((0, 3, 4), 0.1), stub((0, 1, 2), 0.4), stub((2, 3, 4), 0.1), stub((0, 2, 5), 0.1)]
    graph = build_graph(triples, np.full((6, 6), 30))
    assert graph.reference == 0
    paths = find_paths(graph, triples, "first-listed")
    assert set(paths) == set(range(6))
    assert [paths[c].triples for c in (1, 2, 5)] == [(1,), (1,), (3,)]
    assert paths[3].triples == (0,)  # (0, 3, 4) is before (2, 3, 4) in the list
    assert paths[1].length == pytest.approx(graph.edges[0][1].weight)
    refused = adjacency(triples, np.full((6, 6), 30), EdgeWeights(threshold_px=0.3))
    assert np.isinf(find_paths(refused, triples, "first-listed")[1].length)  # taken all the same
    assert 1 not in find_paths(refused, triples, "opt")


@pytest.mark.parametrize(("count", "goes_by"), [(0.0, (0, 2, 1)), (100.0, (0, 1))])
def test_weights_of_edges_choose_the_path(count: float, goes_by: tuple[int, ...]) -> None:
    """xi2 makes few common features heavy: here a direct edge with large errors has most of them."""
    triples = [stub((0, 1, 3), 5.0), stub((0, 2, 3), 1.0), stub((1, 2, 3), 1.0), stub((1, 3, 4), 1.0)]
    counts = np.full((5, 5), 20)
    counts[0, 1] = counts[1, 0] = 2000
    graph = adjacency(triples, counts, EdgeWeights(1.0, count))
    assert graph.reference == 3
    graph = replace(graph, groups=np.array([0, 9, 0, 0, 0]))
    edges = {pair: graph.edges[pair[0]][pair[1]].weight for pair in ((0, 1), (0, 2), (2, 1))}
    assert edges[0, 1] == pytest.approx(5.0 + count / 2000)
    assert edges[0, 2] == pytest.approx(1.0 + count / 20)
    path = find_paths(replace(graph, edges=without(graph, 3)), triples, "opt", 1.0)[0]
    assert path.cameras == goes_by


def without(graph: CameraGraph, camera: int) -> tuple[dict[int, Edge], ...]:
    """The graph's edges but those of one camera."""
    kept = [{g: e for g, e in edges.items() if g != camera} for edges in graph.edges]
    return tuple({} if c == camera else edges for c, edges in enumerate(kept))


def test_cameras_out_of_reach_have_no_path() -> None:
    triples = [stub((0, 1, 2)), stub((0, 1, 2)), stub((3, 4, 5))]
    graph = build_graph(triples, np.full((7, 7), 30))
    for search in ("opt", "dijkstra", "first", "first-listed"):
        assert set(find_paths(graph, triples, search)) == {0, 1, 2}


@pytest.mark.parametrize("search", ["opt", "dijkstra", "first", "first-listed"])
def test_chained_poses_are_the_true_ones(search) -> None:
    triples, scales = random_triples(2)
    graph = build_graph(triples, np.full((9, 9), 30))
    paths = find_paths(graph, triples, search)
    scale = graph.scale
    rotation, translation = chain_poses(paths, triples, scale, 9)
    true_r, place = true_pose(tuple(range(9)))
    size = scale[0] / scales[0]  # the common scale is arbitrary
    reference = graph.reference
    assert np.isnan(rotation[[c for c in range(9) if c not in paths]]).all()
    for camera in paths:
        expected = true_r[camera] @ true_r[reference].T
        np.testing.assert_allclose(rotation[camera], expected, atol=1e-9)
        centre = -rotation[camera].T @ translation[camera]
        np.testing.assert_allclose(
            centre, true_r[reference] @ (place[camera] - place[reference]) * size, atol=1e-6 * size
        )
    assert np.array_equal(rotation[reference], np.eye(3))


def test_relative_pose_is_that_of_the_pair_both_ways() -> None:
    triple = stub((2, 5, 6), scale=3.0)
    r, t = relative_pose(triple, 5, 2, 3.0)
    back_r, back_t = relative_pose(triple, 2, 5, 3.0)
    np.testing.assert_allclose(r @ back_r, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(r @ back_t + t, 0.0, atol=1e-9)
    true_r, place = true_pose((2, 5))
    np.testing.assert_allclose(r, true_r[1] @ true_r[0].T, atol=1e-12)
    np.testing.assert_allclose(t, true_r[1] @ (place[0] - place[1]), atol=1e-9)


def test_chained_points_lie_in_the_reference_frame() -> None:
    true_r, place = true_pose(tuple(range(5)))
    points = np.random.default_rng(0).uniform(-100, 100, (20, 3))
    triples = []
    for cameras, rows, s in (((0, 1, 2), np.arange(14), 1.0), ((0, 3, 4), np.arange(8, 20), 1.0)):
        r, c = true_r[list(cameras)], place[list(cameras)]
        triples.append(Triple(cameras, r, -np.einsum("cij,cj->ci", r, c) / s, rows, points[rows] / s, np.ones(3)))
    graph = build_graph(triples, np.full((5, 5), 30))
    assert graph.reference == 0
    paths = find_paths(graph, triples)
    # with no edge in common the two parts keep scales of their own, here both 1
    found = chain_points([(triples[0], 1), (triples[1], 4)], *chain_poses(paths, triples, graph.scale, 5), 21)
    np.testing.assert_allclose(found[:20], points @ true_r[0].T - true_r[0] @ place[0], atol=1e-6)
    assert np.isnan(found[20]).all()
