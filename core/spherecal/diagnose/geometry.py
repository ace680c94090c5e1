"""Findings on the ball's placements and on how the cameras are connected."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
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
    """The finding where only one camera connects two parts of the rig.

    Where one pair of cameras does, one of these does too, as there are more than two.
    """
    cameras = np.flatnonzero(e.placed)
    if len(cameras) < 4:
        return []
    network = e.solved.network  # of the rigid form: common dots of the ball count
    seen = np.zeros((len(e.camera_ids), network.n_features), dtype=bool)
    seen[network.camera[e.used], network.feature[e.used]] = True
    common = common_counts(seen)[np.ix_(cameras, cameras)]
    edge = common >= MIN_COMMON
    np.fill_diagonal(edge, False)
    if smaller_part(edge, np.arange(len(edge))):
        return []
    ids, found = np.array(e.camera_ids)[cameras], []
    for i, name in enumerate(ids.tolist()):
        others = ids[smaller_part(edge, np.delete(np.arange(len(edge)), i))].tolist()
        if others:
            values = {"part": others, "through": Phrase("thread-camera", {"camera": name}), "least": MIN_COMMON}
            found.append(Finding("linked-by-a-thread", "warning", values, (name, *others)))
    return found


def smaller_part(edge: BoolArray, kept: IntArray) -> list[int]:
    """Those of the vertices `kept` of a graph that are its smallest part then; none where it is connected."""
    count, label = connected_components(csr_array(edge[np.ix_(kept, kept)]), directed=False)
    return kept[label == np.argmin(np.bincount(label))].tolist() if count > 1 else []
