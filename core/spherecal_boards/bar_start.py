"""Start values from a waved bar: pairs of cameras by essential matrices, scaled by the bar, and chained."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.diagnose.camera_findings import FLIPS, Flip, flipped
from spherecal.geometry.camera import undistort
from spherecal.geometry.transform import PosedCameras
from spherecal.geometry.triangulation import triangulate
from spherecal.initialise.view_graph import common_counts, groups_of
from spherecal_boards.bar_marks import BarRecording, Lengths
from spherecal_boards.camera_lag import AGREE_PX, MOST_FRAMES, Compared, Lag, Link, find_lags

LEAST_COMMON = 20
# As in initialise/two_view.py: nominal intrinsics bend epipolar lines by up to this.
_GATE_PX = 12.0
_ENOUGH = 1000  # points of a pair: more do not better a start
_LEAST_SHARE = 0.5  # of a pair's points that must agree with it
# Median deviation of a pair's lengths from their median. Where one camera is mirrored, points in front of both fit too,
# with lengths that scatter by 0.31 to 0.79; those of right pairs by at most 0.045 (rigs A, B, random, 3 each).
_MOST_SCATTER = 0.15


@dataclass(frozen=True)
class BarStart:
    """Poses (c,3,3), (c,3), NaN where unknown; the reference camera; common points (c,c) and solved pairs (c,c).

    `parents`: the pairs (parent, camera) along which it was chained, each parent before its cameras.
    """

    rotation: FloatArray
    translation: FloatArray
    reference: int
    common: IntArray
    linked: IntArray
    parents: tuple[tuple[int, int], ...] = ()

    @property
    def placed(self) -> BoolArray:
        """Cameras with a pose, (c,)."""
        return np.isfinite(self.translation[:, 0])


def start_from_pairs(
    recording: BarRecording, lengths: Lengths, intrinsics: FloatArray, seed: int, context: Context
) -> BarStart:
    """Poses (mm) of all cameras that pairs with `LEAST_COMMON` common points reach, in the best linked one's frame."""
    n = len(recording.observations.cameras)
    xy, table, common = _seen(recording, intrinsics)
    pairs: dict[tuple[int, int], Link] = {}
    todo = np.argwhere(np.triu(common >= LEAST_COMMON, 1)).tolist()
    for number, (a, b) in enumerate(todo):
        context.report("pairs of cameras", number / len(todo))
        points = np.flatnonzero((table[a] >= 0) & (table[b] >= 0))
        rows = table[a, points], table[b, points]
        focal = float(intrinsics[[a, b], 0].mean())
        pair = _solve_pair(recording, lengths, _Common(points, xy[rows[0]], xy[rows[1]], focal), seed)
        if pair is not None:
            pairs[a, b], pairs[b, a] = pair, pair.back()
    return _chain(pairs, common, n)


def lags_of(
    recording: BarRecording, lengths: Lengths, intrinsics: FloatArray, widths: IntArray, seed: int
) -> list[Lag]:
    """Cameras late, early or flipped, by pairs that agree only then; known intrinsics (c,16), image widths (c,) px."""
    xy, table, common = _seen(recording, intrinsics)

    o = recording.observations
    flips: dict[Flip, FloatArray] = {
        how: undistort(flipped(o.uv, how, widths[o.camera]), intrinsics[o.camera])[0] for how in FLIPS
    }

    def compare(a: int, b: int, shifted: bool) -> Compared:
        best: Compared = np.inf, np.zeros(recording.n_frames, dtype=np.int64), None
        seen = np.flatnonzero(table[b] >= 0)
        for lag in sorted(range(-MOST_FRAMES, MOST_FRAMES + 1), key=abs) if shifted else (0,):
            first = seen - lag * recording.slots
            both = (first >= 0) & (first < recording.n_points)
            both[both] &= table[a, first[both]] >= 0
            if both.sum() < LEAST_COMMON:
                continue
            rows = table[a, first[both]], table[b, seen[both]]
            focal = float(intrinsics[[a, b], 0].mean())
            pair = _solve_pair(recording, lengths, _Common(first[both], xy[rows[0]], xy[rows[1]], focal), seed)
            if pair is not None and pair.weight < best[0]:
                best = pair.weight, np.full(recording.n_frames, lag), None
            if best[0] <= AGREE_PX:
                return best
        both = np.flatnonzero((table[a] >= 0) & (table[b] >= 0)) if shifted else np.zeros(0, dtype=np.int64)
        for how, put_back in flips.items() if len(both) >= LEAST_COMMON else ():
            focal = float(intrinsics[[a, b], 0].mean())
            common_to = _Common(both, xy[table[a, both]], put_back[table[b, both]], focal)
            pair = _solve_pair(recording, lengths, common_to, seed)
            if pair is not None and pair.weight < best[0]:
                best = pair.weight, np.zeros(recording.n_frames, dtype=np.int64), how
        return best

    return find_lags(np.where(common >= LEAST_COMMON, common, 0), compare)


def _seen(recording: BarRecording, intrinsics: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Normalised image points (n,2), the observation of each camera and point (c,p) or -1, common points (c,c)."""
    o = recording.observations
    xy, usable = undistort(o.uv, intrinsics[o.camera])
    table = np.full((len(o.cameras), recording.n_points), -1)
    table[o.camera[usable], recording.point[usable]] = np.flatnonzero(usable)
    return xy, table, common_counts(table >= 0)


@dataclass(frozen=True)
class _Common:
    """What two cameras both see: points (k,), their normalised image points (k,2) in each, the mean focal length px."""

    points: IntArray
    first: FloatArray
    second: FloatArray
    focal: float


def _solve_pair(recording: BarRecording, lengths: Lengths, common: _Common, seed: int) -> Link | None:
    """A pair of cameras from the points that both see; None where these do not agree."""
    points, first, second, focal = common.points, common.first, common.second, common.focal
    frames = np.unique(points // recording.slots)
    if len(points) > _ENOUGH:  # whole frames, or no length would be left
        step = int(np.ceil(len(points) / _ENOUGH))
        take = np.isin(points // recording.slots, frames[::step])
        points, first, second = points[take], first[take], second[take]
    cv2.setRNGSeed(seed + 1)
    matrix, mask = cv2.findEssentialMat(first, second, np.eye(3), cv2.RANSAC, 0.999, _GATE_PX / focal, 1000)
    if matrix is None or matrix.shape != (3, 3):
        return None
    agreeing, rotation, translation, mask = cv2.recoverPose(matrix, first, second, np.eye(3), mask=mask)
    keep = np.asarray(mask).ravel() > 0
    if agreeing < max(LEAST_COMMON / 2, _LEAST_SHARE * len(points)):
        return None
    rotation, translation = np.asarray(rotation, dtype=float), np.asarray(translation, dtype=float).ravel()
    points = points[keep]
    places, error = _triangulated(first[keep], second[keep], rotation, translation, focal)
    # reconstructed over known lengths of all frames whose ends were reconstructed
    every = np.full((recording.n_points, 3), np.nan)
    every[points] = places
    own = every.reshape(recording.n_frames, recording.slots, 3)[lengths.frame]
    needed = lengths.coefficient != 0
    whole = (np.isfinite(own[:, :, 0]) | ~needed).all(axis=1)
    difference = np.einsum("ms,msi->mi", lengths.coefficient[whole], np.nan_to_num(own[whole]))
    ratio = np.linalg.norm(difference, axis=1) / lengths.length[whole]
    if len(ratio) < 3 or np.median(np.abs(ratio / np.median(ratio) - 1)) > _MOST_SCATTER:
        return None
    factor = 1.0 / float(np.median(ratio))
    return Link(rotation, translation * factor, error * (1 + LEAST_COMMON / len(points)))


def _triangulated(
    first: FloatArray, second: FloatArray, rotation: FloatArray, translation: FloatArray, focal: float
) -> tuple[FloatArray, float]:
    """Points (k,3) in the first camera's frame and their median reprojection error in px."""
    k = len(first)
    pinhole = np.zeros((2, 16))
    pinhole[:, :2] = focal
    found = triangulate(
        np.tile(np.arange(k), 2),
        np.repeat([0, 1], k),
        np.concatenate([first, second]) * focal,
        np.ones(2 * k),
        k,
        PosedCameras(pinhole, np.stack([np.eye(3), rotation]), np.stack([np.zeros(3), translation])),
    )
    points = np.where(found.in_front[:, None], found.points, np.nan)
    size = np.linalg.norm(found.residual, axis=1)
    return points, float(np.median(size[np.isfinite(size)])) if np.isfinite(size).any() else np.inf


def _chain(pairs: dict[tuple[int, int], Link], common: IntArray, n: int) -> BarStart:
    """Shortest paths from the reference: of the largest linked group, the camera with most common points."""
    weight, linked = np.zeros((n, n)), np.zeros((n, n), dtype=np.int64)
    for (a, b), pair in pairs.items():
        weight[a, b], linked[a, b] = max(pair.weight, 1e-9), common[a, b]
    largest = groups_of(linked, np.zeros(n, dtype=bool))[0]
    reference = int(max(largest, key=lambda c: (linked[c].sum(), -c)))
    rotation, translation = np.full((n, 3, 3), np.nan), np.full((n, 3), np.nan)
    rotation[reference], translation[reference] = np.eye(3), 0.0
    if not pairs:
        translation[:], rotation[:] = np.nan, np.nan
        return BarStart(rotation, translation, reference, common, linked)
    distance, before = dijkstra(csr_array(weight), indices=reference, return_predecessors=True)
    parents = []
    for camera in np.argsort(distance, kind="stable"):
        if camera == reference or not np.isfinite(distance[camera]):
            continue
        parent = int(before[camera])
        pair = pairs[parent, int(camera)]
        rotation[camera] = pair.rotation @ rotation[parent]
        translation[camera] = pair.rotation @ translation[parent] + pair.translation
        parents.append((parent, int(camera)))
    return BarStart(rotation, translation, reference, common, linked, tuple(parents))
