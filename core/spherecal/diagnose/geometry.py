"""Findings on the ball's placements and on how the cameras are connected."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence
from spherecal.geometry.camera import project
from spherecal.initialise.view_graph import MIN_COMMON, common_counts

# Of the image, by the middle of the ball from placement to placement, in the median camera: spread placements go over
# half of it and more. Clustered ones (0.15 on rig A) make lengths twice, stacked ones three times as uncertain.
CLUSTERED = 0.3
# Placements one behind the other: twice as long as wide, along the cameras' mean line of sight (within 37 degrees).
STACKED, ALONG_SIGHT = 2.0, 0.8


def weak_places(e: Evidence) -> list[Finding]:
    """The finding where the placements lie close together or one behind the other."""
    spheres = e.solution.spheres
    if len(spheres) < 2 or e.solved.placed.sum() < 1:
        return []
    places = np.array([sphere.centre for sphere in spheres.values()])
    spread = []
    for c in np.flatnonzero(e.placed):
        seen = np.isin(list(spheres), e.observations.placement[(e.observations.camera == c) & e.used])
        if seen.sum() >= 2:
            spread.append(_spread_in(e, int(c), places[seen]))
    if not spread or np.median(spread) >= CLUSTERED:
        return []
    values = {"percent": 100 * np.median(spread)}
    _, size, axes = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)
    sight = e.solution.state.rotation[e.placed, 2].mean(axis=0)
    length = float(np.linalg.norm(sight))
    stacked = length > 0.5 and size[0] > STACKED * size[1] and abs(axes[0] @ sight) > ALONG_SIGHT * length
    return [Finding("placements-stacked" if stacked else "placements-clustered", "warning", values)]


def _spread_in(e: Evidence, camera: int, places: FloatArray) -> float:
    """How far the ball's centre moves in an image, as a share of the image's size."""
    state = e.solution.state
    x = places @ state.rotation[camera].T + state.translation[camera]
    x = x[x[:, 2] > 0]
    if len(x) < 2:
        return 0.0
    pinhole = np.concatenate([state.intrinsics[camera, :4], np.zeros(12)])  # beyond the image distortion runs wild
    extent = np.ptp(project(x, np.broadcast_to(pinhole, (len(x), 16))), axis=0) / e.session.cameras[camera].image_size
    return float(extent.max())


def weak_links(e: Evidence) -> list[Finding]:
    """The finding where only one camera or one pair of cameras connects two parts of the rig."""
    cameras = np.flatnonzero(e.placed)
    if len(cameras) < 4:
        return []
    network = e.solved.network  # of the rigid form: common dots of the ball count
    seen = np.zeros((len(e.camera_ids), network.n_features), dtype=bool)
    seen[network.camera[e.used], network.feature[e.used]] = True
    common = common_counts(seen)[np.ix_(cameras, cameras)]
    edge = common >= MIN_COMMON
    np.fill_diagonal(edge, False)
    if _parts(edge) != 1:
        return []
    ids = [e.camera_ids[c] for c in cameras]
    alone = articulations(edge)
    found = []
    for i in alone:
        keep = np.flatnonzero(np.arange(len(ids)) != i)
        others = [ids[keep[k]] for k in _smaller_part(edge[np.ix_(keep, keep)])]
        through = Phrase("thread-camera", {"camera": ids[i]})
        found.append(_thread(through, others, (ids[i], *others)))
    for i, j in bridges(edge):
        if i in alone or j in alone:  # one finding is enough
            continue
        cut = edge.copy()
        cut[i, j] = cut[j, i] = False
        others = [ids[k] for k in _smaller_part(cut)]
        through = Phrase("thread-points", {"points": common[i, j], "first": ids[i], "second": ids[j]})
        found.append(_thread(through, others, tuple(dict.fromkeys((ids[i], ids[j], *others)))))
    return found


def _thread(through: Phrase, part: list[str], where: tuple[str, ...]) -> Finding:
    values = {"part": part, "through": through, "least": MIN_COMMON}
    return Finding("linked-by-a-thread", "warning", values, where)


def _parts(edge: BoolArray) -> int:
    return int(connected_components(csr_array(edge), directed=False)[0])


def _smaller_part(edge: BoolArray) -> list[int]:
    """Vertices of the smallest part of a graph that is not connected."""
    label = connected_components(csr_array(edge), directed=False)[1]
    return np.flatnonzero(label == np.argmin(np.bincount(label))).tolist()


def articulations(edge: BoolArray) -> list[int]:
    """Vertices of a connected graph (n,n) without which the rest is not connected."""
    every = np.arange(len(edge))
    return [int(i) for i in every if _parts(edge[np.ix_(every != i, every != i)]) > 1]


def bridges(edge: BoolArray) -> list[tuple[int, int]]:
    """Edges of a connected graph (n,n) without which it is not connected."""
    _, parent = breadth_first_order(csr_array(edge), 0, directed=False)
    found = []
    for j, i in enumerate(parent.tolist()):
        if i < 0:
            continue
        cut = edge.copy()
        cut[i, j] = cut[j, i] = False
        if _parts(cut) > 1:
            found.append((min(i, j), max(i, j)))
    return found
