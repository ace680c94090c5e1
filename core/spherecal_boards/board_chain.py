"""Cameras chained over a board, as in [Tao21]: groups of four adjusted alone, joined in common cameras."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.geometry.camera import project
from spherecal.geometry.rotation import nearest_rotation
from spherecal.geometry.transform import PosedCameras
from spherecal_boards.board_adjustment import BoardNetwork, ViewPoses, place_boards, robust_start
from spherecal_boards.board_start import BoardPose, BoardViews
from spherecal_boards.camera_lag import MOST_FRAMES, Compared, Link, lagged, least_error

GROUP_SIZE = 4
# Placements that a pair's relative pose is taken from, and is tried on: more gain nothing and cost time squared.
_DRAWN, _TRIED = 6, 12


Links = dict[tuple[int, int], Link]


@dataclass(frozen=True)
class BoardStart:
    """What each camera alone gives: intrinsics (c,16), the usable observations (n,), poses of every view."""

    intrinsics: FloatArray
    candidates: BoolArray
    poses: ViewPoses


def common_placements(found: ViewPoses, n_cameras: int, n_placements: int) -> IntArray:
    """In how many placements each two cameras see the board together, (c,c)."""
    seen = np.zeros((n_cameras, n_placements), dtype=np.int64)
    for camera, placement in found:
        seen[camera, placement] = 1
    return seen @ seen.T


def find_links(views: BoardViews, found: ViewPoses, intrinsics: FloatArray, context: Context) -> Links:
    """The relative poses of all pairs of cameras that see the board together, both ways."""
    common = common_placements(found, views.n_cameras, views.n_placements)
    pairs = np.argwhere(np.triu(common, 1) > 0)
    links: Links = {}
    for number, (a, b) in enumerate(pairs.tolist()):
        context.report("pairs of cameras", number / len(pairs))
        link = _link(views, found, intrinsics, a, b)
        if link is not None:
            links[a, b], links[b, a] = link, link.back()
    return links


def compare_views(
    views: BoardViews, found: tuple[ViewPoses, ViewPoses], intrinsics: FloatArray, a: int, b: int, shifted: bool
) -> Compared:
    """How well two cameras agree about where the board was, by its corners in the second camera's image."""
    count = views.n_placements
    poses = [_first_poses(own, camera, count) for own, camera in zip(found, (a, b), strict=True)]
    extent = views.points_mm[[*views.points_mm.argmin(axis=0), *views.points_mm.argmax(axis=0)]]
    corners = [np.einsum("tij,pj->tpi", rotation, extent) + shift[:, None] for rotation, shift in poses]
    seen = [np.isfinite(shift[:, 0]) for _, shift in poses]
    lags = range(-MOST_FRAMES, MOST_FRAMES + 1) if shifted else (0,)
    pairs = {}
    for lag in lags:
        first, second = lagged(np.flatnonzero(seen[1]), lag, count)
        both = seen[0][first]
        pairs[lag] = first[both], second[both]
    relative = []  # each is tried with all lags
    for first, second in pairs.values():
        for i in _spread(len(second), _DRAWN):
            rotation = poses[1][0][second[i]] @ poses[0][0][first[i]].T
            relative.append((rotation, poses[1][1][second[i]] - rotation @ poses[0][1][first[i]]))
    by_frame = {lag: np.full((max(len(relative), 1), count), np.nan) for lag in lags}
    for row, (rotation, shift) in enumerate(relative):
        x = corners[0] @ rotation.T + shift
        for lag, (first, second) in pairs.items():
            with np.errstate(all="ignore"):
                off = x[first, :, :2] / x[first, :, 2:] - corners[1][second][..., :2] / corners[1][second][..., 2:]
            size = intrinsics[b, 0] * np.sqrt((off**2).sum(axis=2).mean(axis=1))
            by_frame[lag][row, second] = np.where((x[first, :, 2] > 0).all(axis=1), size, np.inf)
    return least_error(by_frame, shifted)


def _first_poses(found: ViewPoses, camera: int, count: int) -> tuple[FloatArray, FloatArray]:
    """The likelier pose of the board at each placement in a camera's frame, (t,3,3) and (t,3), NaN where not seen."""
    rotation, shift = np.full((count, 3, 3), np.nan), np.full((count, 3), np.nan)
    for (c, placement), poses in found.items():
        if c == camera:
            rotation[placement], shift[placement] = poses[0].rotation, poses[0].translation
    return rotation, shift


def _link(views: BoardViews, found: ViewPoses, intrinsics: FloatArray, a: int, b: int) -> Link | None:
    """The relative pose that explains most placements; it decides which of a plane's two poses in a view is right."""
    placements = [t for t in range(views.n_placements) if found.get((a, t)) and found.get((b, t))]
    if not placements:
        return None
    best: Link | None = None
    tried = [placements[i] for i in _spread(len(placements), _TRIED)]
    for t in (placements[i] for i in _spread(len(placements), _DRAWN)):
        for first in found[a, t]:
            for second in found[b, t]:
                rotation = second.rotation @ first.rotation.T
                translation = second.translation - rotation @ first.translation
                camera = PosedCameras(intrinsics[b], rotation, translation)
                errors = [_error_in(views, views.of(b, s), found[a, s], camera) for s in tried]
                weight = float(np.median(errors)) * (1 + 1 / len(placements))
                if np.isfinite(weight) and (best is None or weight < best.weight):
                    best = Link(rotation, translation, weight)
    return best


def _spread(n: int, most: int) -> list[int]:
    return sorted(set(np.linspace(0, n - 1, min(n, most)).round().astype(int).tolist()))


def _error_in(views: BoardViews, rows: IntArray, poses: Sequence[BoardPose], camera: PosedCameras) -> float:
    """Median distance in px of a camera's view (rows) from the board by another camera, for the better of its poses."""
    points, best = views.points_mm[views.point[rows]], np.inf
    for pose in poses:
        x = (points @ pose.rotation.T + pose.translation) @ camera.rotation.T + camera.translation
        if (x[:, 2] > 0).all():
            off = np.linalg.norm(project(x, camera.intrinsics) - views.uv[rows], axis=1)
            best = min(best, float(np.median(off)))
    return best


def chain(network: BoardNetwork, start: BoardStart, links: Links, context: Context) -> tuple[State, list[list[int]]]:
    """Cameras and placements in the reference camera's frame, and the groups (of up to four) of the chain."""
    views = network.views
    n = views.n_cameras
    state = State(np.full((n, 3, 3), np.nan), np.full((n, 3), np.nan), start.intrinsics.copy(), views.points_mm)
    state.rotation[network.reference], state.translation[network.reference] = np.eye(3), 0.0
    placed = np.arange(n) == network.reference
    groups: list[list[int]] = []
    while (group := _next_group(links, placed)) is not None:
        context.report("groups of cameras", float(placed.mean()), " ".join(map(str, group)))
        local = _adjust_group(network, replace(start, intrinsics=state.intrinsics), links, group, context)
        groups.append(group)
        common = [c for c in group if placed[c]]
        # group frame to world: x_world = R x_group + t for each common camera
        rotations = [state.rotation[c].T @ local.rotation[c] for c in common]
        rotation = nearest_rotation(np.sum(rotations, axis=0))
        centres = np.array([-local.rotation[c].T @ local.translation[c] for c in common])
        goals = np.array([-state.rotation[c].T @ state.translation[c] for c in common])
        translation = (goals - centres @ rotation.T).mean(axis=0)
        for c in group:
            if not placed[c]:
                state.rotation[c] = local.rotation[c] @ rotation.T
                state.translation[c] = local.translation[c] - state.rotation[c] @ translation
                state.intrinsics[c] = local.intrinsics[c]
                placed[c] = True
    return place_boards(views, start.poses, state, placed), groups


def _next_group(links: Links, placed: BoolArray) -> list[int] | None:
    """Up to four cameras, the placed ones first, connected by the lightest links, that include new cameras."""
    fresh = {pair: link for pair, link in links.items() if placed[pair[0]] and not placed[pair[1]]}
    if not fresh:
        return None
    group = list(min(fresh, key=lambda pair: (fresh[pair].weight, pair)))
    anchored = int(placed.sum() > 1)  # a second camera in common holds the joint better
    while len(group) < GROUP_SIZE:
        nearest: dict[int, float] = {}
        for (a, b), link in links.items():
            if a in group and b not in group:
                nearest[b] = min(nearest.get(b, np.inf), link.weight)
        new = {c: w for c, w in nearest.items() if not placed[c]}
        old = {c: w for c, w in nearest.items() if placed[c]}
        pool = old if (anchored and old) or not new else new
        anchored = 0
        if not pool:
            break
        group.append(min(pool, key=lambda c: (pool[c], c)))
    return sorted(group, key=lambda c: (not placed[c], c))


def _adjust_group(network: BoardNetwork, start: BoardStart, links: Links, group: list[int], context: Context) -> State:
    """The cameras of a group in the frame of its first, after a robust adjustment of their own."""
    n = network.views.n_cameras
    state = State(np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), start.intrinsics.copy(), network.views.points_mm)
    reached = [group[0]]
    while len(reached) < len(group):
        open_links = {p: k for p, k in links.items() if p[0] in reached and p[1] in group and p[1] not in reached}
        a, b = min(open_links, key=lambda pair: (open_links[pair].weight, pair))
        link = open_links[a, b]
        state.rotation[b] = link.rotation @ state.rotation[a]
        state.translation[b] = link.rotation @ state.translation[a] + link.translation
        reached.append(b)
    members = np.isin(np.arange(n), group)
    state = whole(place_boards(network.views, start.poses, state, members))
    own = start.candidates & members[network.views.camera]
    # shared intrinsics may be another group's as well: each group here estimates its own
    alone = replace(network, reference=group[0], group=np.arange(n))
    return robust_start(alone, state, own, context)


def whole(state: State) -> State:
    """The state with any pose for placements and cameras that have none, for kernels that run over all."""
    known = np.isfinite(state.placement_translation[:, 0])
    placed = np.isfinite(state.translation[:, 0])
    return replace(
        state,
        rotation=np.where(placed[:, None, None], state.rotation, np.eye(3)),
        translation=np.where(placed[:, None], state.translation, 0.0),
        placement_rotation=np.where(known[:, None, None], state.placement_rotation, np.eye(3)),
        placement_translation=np.where(known[:, None], state.placement_translation, 0.0),
    )
