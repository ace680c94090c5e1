"""Which views of a point agree: rays that meet are found by pairs, so that one wrong view spoils no other.

Least squares smears a wrong view's error over all views of its point; of a track of three with one wrong, all three
then fail every gate. Here each pair of views proposes a point, and the one that most views confirm is taken
(M. Fischler, R. Bolles, Random sample consensus, 1981; exhaustive, since tracks are short).
"""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.geometry.camera import project, undistort_views
from spherecal.geometry.posed import PosedCameras

# Pairs tried of one point; 45 are all pairs of ten views, and of more views a wrong third leaves 20 good ones of them.
MOST_PAIRS = 45
_MOST_PREDICTED = 20_000  # image points that are predicted at a time


def agreeing_views(
    feature: IntArray, camera: IntArray, uv: FloatArray, gate_px: FloatArray, cameras: PosedCameras
) -> BoolArray:
    """Which rows (n,) belong to the largest set of their feature that agrees on one point in front of all its cameras.

    Among equal sets the one with the smaller errors wins. Of a feature with more than `MOST_PAIRS` pairs of views some
    pairs are tried, evenly chosen.
    """
    out = np.zeros(len(feature), dtype=bool)
    xy, usable = undistort_views(uv, camera, cameras.intrinsics)
    rows = np.flatnonzero(usable)
    rows = rows[np.argsort(feature[rows], kind="stable")]
    if not len(rows):
        return out
    rotation = cameras.rotation[camera[rows]]
    ray = np.einsum("nji,nj->ni", rotation, np.column_stack([xy[rows], np.ones(len(rows))]))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    centre = -np.einsum("nji,nj->ni", rotation, cameras.translation[camera[rows]])
    views = _Views(camera[rows], uv[rows], gate_px[rows], centre, ray, cameras)
    start = np.flatnonzero(np.diff(feature[rows], prepend=-1))
    count = np.diff(np.append(start, len(rows)))
    for some in np.unique(count[count >= 2]).tolist():  # points with equally many views at once
        member = start[count == some][:, None] + np.arange(some)  # (f, v) rows of `views`
        out[rows[member[_largest_set(member, views)]]] = True
    return out


@dataclass(frozen=True)
class _Views:
    """Views, sorted by point: camera, image point, gate, and the ray from the camera's centre."""

    camera: IntArray
    uv: FloatArray
    gate_px: FloatArray
    centre: FloatArray
    ray: FloatArray
    cameras: PosedCameras


def _largest_set(member: IntArray, of: _Views) -> BoolArray:
    """The largest agreeing set of each point, (f,v) bool, of points with v views each (member (f,v))."""
    views = member.shape[1]
    first, second = np.triu_indices(views, 1)
    if len(first) > MOST_PAIRS:
        some = np.linspace(0, len(first) - 1, MOST_PAIRS).astype(int)
        first, second = first[some], second[some]
    own, cameras = of.camera[member], of.cameras
    best = np.zeros(member.shape, dtype=bool)
    best_score = np.zeros(len(member))
    at_once = max(_MOST_PREDICTED // member.size, 1)  # long tracks are few of each length: loops of a pair took longer
    for begin in range(0, len(first), at_once):
        i, j = first[begin : begin + at_once], second[begin : begin + at_once]
        one, other = member[:, i].T, member[:, j].T  # (k,f): k pairs
        points = _midpoints(of.centre[one], of.ray[one], of.centre[other], of.ray[other])
        x = np.einsum("fvij,kfj->kfvi", cameras.rotation[own], points) + cameras.translation[own]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            lens = np.tile(cameras.intrinsics[own.reshape(-1)], (len(i), 1))
            flat = project(x.reshape(-1, 3), lens).reshape(*x.shape[:3], 2)
            error = np.linalg.norm(flat - of.uv[member], axis=3) / of.gate_px[member]
        fits = (error <= 1) & (x[..., 2] > 0)
        score = np.where(fits, 2.0 - np.where(fits, error, 0.0) ** 2 / views, 0.0).sum(axis=2)  # count before error
        pair, point = np.arange(len(i)), np.arange(len(member))
        score *= fits[pair, :, i] & fits[pair, :, j]
        top = score.argmax(axis=0)
        better = score[top, point] > best_score
        best[better], best_score[better] = fits[top, point][better], score[top, point][better]
    return best


def _midpoints(c1: FloatArray, d1: FloatArray, c2: FloatArray, d2: FloatArray) -> FloatArray:
    """The middles (...,3) of the shortest lines between pairs of rays; not finite where they are parallel."""
    between, cosine = c2 - c1, (d1 * d2).sum(axis=-1)
    a, b = (between * d1).sum(axis=-1), (between * d2).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = 1 - cosine**2
        s, t = (a - cosine * b) / determinant, (cosine * a - b) / determinant
    return (c1 + s[..., None] * d1 + c2 + t[..., None] * d2) / 2
