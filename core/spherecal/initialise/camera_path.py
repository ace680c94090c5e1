"""OPT: every camera's best path to the reference, [Tao21] (14)-(17), and the variants it is compared with."""

import heapq
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.initialise.triple import Triple
from spherecal.initialise.view_graph import CameraGraph

Search = Literal["opt", "dijkstra", "first", "first-listed"]

# How much a path's length counts more for every further camera on it; the paper's example value.
BASE = 1.1


@dataclass(frozen=True)
class Path:
    """Cameras from one camera to the reference, both included, the triple behind each step, the sum of weights."""

    cameras: tuple[int, ...]
    triples: tuple[int, ...]
    length: float


def find_paths(
    graph: CameraGraph, triples: list[Triple], search: Search = "opt", base: float = BASE
) -> dict[int, Path]:
    """The path of every camera that can be reached; the reference's own has no steps."""
    if search == "first":
        return _first_paths(graph, triples)
    if search == "first-listed":
        return _first_listed_paths(graph, triples)
    hops = _fewest_hops(graph)
    if search == "dijkstra":
        return {camera: _a_star(graph, camera, dict.fromkeys(hops, 0.0), 1.0) for camera in sorted(hops)}
    lightest = min((edge.weight for edges in graph.edges for edge in edges.values()), default=0.0)
    heuristic = {camera: n * lightest for camera, n in hops.items()}
    return {camera: _a_star(graph, camera, heuristic, base) for camera in sorted(hops)}


def _fewest_hops(graph: CameraGraph) -> dict[int, int]:
    """Fewest edges from the reference to every camera it reaches."""
    hops, queue = {graph.reference: 0}, deque([graph.reference])
    while queue:
        here = queue.popleft()
        for neighbour in sorted(graph.edges[here]):
            if neighbour not in hops:
                hops[neighbour] = hops[here] + 1
                queue.append(neighbour)
    return hops


def _a_star(graph: CameraGraph, start: int, heuristic: dict[int, float], base: float) -> Path:
    """The path with the least base^m g.

    That cost does not add up along a path, but among paths of equal m the shorter is better: so the search runs over
    (camera, m) states, where base is 1 over cameras. It is optimal as base >= 1 and h never overestimates; with h = 0
    and base 1 it is Dijkstra's.
    """
    queue: list[tuple[float, float, tuple[int, ...]]] = [(heuristic[start], 0.0, (start,))]
    best: dict[tuple[int, int], float] = {}
    counted = base != 1
    while queue:
        _, length, cameras = heapq.heappop(queue)
        here, hops = cameras[-1], len(cameras)
        if here == graph.reference:
            steps = pairwise(cameras)
            return Path(cameras, tuple(graph.edges[a][b].triple for a, b in steps), length)
        for neighbour, edge in graph.edges[here].items():
            longer = length + edge.weight
            state = neighbour, hops * counted
            if neighbour in cameras or longer >= best.get(state, float("inf")):
                continue
            best[state] = longer
            heapq.heappush(queue, (base**hops * longer + heuristic[neighbour], longer, (*cameras, neighbour)))
    raise ValueError("the camera does not reach the reference")


def _first_paths(graph: CameraGraph, triples: list[Triple]) -> dict[int, Path]:
    """none-OPT: grow from the reference, always by the first triple that reaches a camera without a pose."""
    paths = {graph.reference: Path((graph.reference,), (), 0.0)}
    reached = True
    while reached:
        reached = False
        for number, triple in enumerate(triples):
            known = [c for c in triple.cameras if c in paths]
            for camera in triple.cameras:
                if not known or camera in paths or camera not in graph.edges[known[0]]:
                    continue
                step = paths[known[0]]
                weight = graph.edges[known[0]][camera].weight
                paths[camera] = Path((camera, *step.cameras), (number, *step.triples), step.length + weight)
                reached = True
    return paths


def _first_listed_paths(graph: CameraGraph, triples: list[Triple]) -> dict[int, Path]:
    """none-OPT in the literal order: the list is read again after every camera; refused steps are infinitely long."""
    paths = {graph.reference: Path((graph.reference,), (), 0.0)}
    listed = sorted(range(len(triples)), key=lambda number: tuple(sorted(triples[number].cameras)))
    while (step := _first_step(listed, triples, paths)) is not None:
        number, known, camera = step
        edge = graph.edges[known].get(camera)
        length = paths[known].length + (edge.weight if edge else float("inf"))
        paths[camera] = Path((camera, *paths[known].cameras), (number, *paths[known].triples), length)
    return paths


def _first_step(listed: list[int], triples: list[Triple], paths: dict[int, Path]) -> tuple[int, int, int] | None:
    """The first triple with a camera that has a path and one that has none: its number, that camera, the new one."""
    for number in listed:
        cameras = sorted(triples[number].cameras)
        known = [camera for camera in cameras if camera in paths]
        fresh = [camera for camera in cameras if camera not in paths]
        if known and fresh:
            return number, known[0], fresh[0]
    return None


# --- poses and points chained along the paths into the reference camera's frame, [tao21] (16)-(17) -------------------


def relative_pose(triple: Triple, camera: int, other: int, scale: float) -> tuple[FloatArray, FloatArray]:
    """R, t with `x_camera = R x_other + t`, in the common scale."""
    j, g = triple.cameras.index(camera), triple.cameras.index(other)
    rotation = triple.rotation[j] @ triple.rotation[g].T
    return rotation, (triple.translation[j] - rotation @ triple.translation[g]) * scale


def chain_poses(
    paths: dict[int, Path], triples: list[Triple], scale: FloatArray, n_cameras: int
) -> tuple[FloatArray, FloatArray]:
    """Rotations (c,3,3) and translations (c,3) of all cameras that have a path; NaN for the rest."""
    rotation, translation = np.full((n_cameras, 3, 3), np.nan), np.full((n_cameras, 3), np.nan)
    for camera, path in paths.items():
        r, t = np.eye(3), np.zeros(3)
        for here, following, number in zip(path.cameras, path.cameras[1:], path.triples, strict=False):
            step_r, step_t = relative_pose(triples[number], here, following, scale[number])
            r, t = r @ step_r, t + r @ step_t
        rotation[camera], translation[camera] = r, t
    return rotation, translation


def chain_points(
    sources: Iterable[tuple[Triple, int]], rotation: FloatArray, translation: FloatArray, n_features: int
) -> FloatArray:
    """Points (m,3) of triples in the reference frame, each by the first triple that has it; NaN where none has."""
    points = np.full((n_features, 3), np.nan)
    for triple, camera in sources:
        j = triple.cameras.index(camera)
        in_camera = triple.points @ triple.rotation[j].T + triple.translation[j]
        new = np.isnan(points[triple.features, 0])
        points[triple.features[new]] = ((in_camera - translation[camera]) @ rotation[camera])[new]
    return points
