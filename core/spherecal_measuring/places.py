"""Where named points are in one set: target centres by their layouts, single dots, all with their joint covariance.

Places depend on the image points of their own dots and on parameters of cameras, kept apart, since all share these.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherecal.base.arrays import BoolArray, ByValue, FloatArray, IntArray
from spherecal.geometry.rotation import cross_matrix
from spherecal.targets.centre import LEAST_DOTS
from spherecal.targets.target_set import TargetSet
from spherecal_measuring.measuring_task import CENTRE, PointName
from spherecal_verify.outlying_views import CheckedPoints
from spherecal_verify.uncertainty import PointErrors

_WEAK_DOT = 5.0  # standard deviations over the median dot's, as spherecal_verify/marks.py
_COLLINEAR = 0.01  # as targets/centre.py
# A flat sticker's dots fit its layout by their noise; one bent on a ball of 250 mm is off by 0.1 mm, and which of its
# dots are seen then shifts its centre by as much (benchmarks/studies/measure.md).
_BENT = 4.0


@dataclass(frozen=True, eq=False, repr=False)
class LocatedPoints(ByValue):
    """Places (n, 3) mm of named points, with what their uncertainties come from."""

    names: tuple[PointName, ...]
    places_mm: FloatArray
    noise: FloatArray  # (n, 3, 3) of their own image points
    gradient: FloatArray  # (n, 3, p) by the cameras' parameters
    cameras: FloatArray  # (p, p) covariance of these
    views: IntArray  # (n,) cameras
    dots: tuple[IntArray, ...]  # (k,) of each place: the features it rests on
    by_dot: tuple[FloatArray, ...]  # (k, 3, 3)

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def rows(self) -> dict[PointName, int]:
        """The row of each name."""
        return {name: i for i, name in enumerate(self.names)}

    @cached_property
    def covariance(self) -> FloatArray:
        """The covariance of each place by itself, (n, 3, 3) mm^2."""
        n, _, p = self.gradient.shape
        by_cameras = (self.gradient.reshape(3 * n, p) @ self.cameras).reshape(n, 3, p)
        return self.noise + by_cameras @ np.swapaxes(self.gradient, 1, 2)

    def joint(self, rows: Sequence[int]) -> FloatArray:
        """The covariance (3k, 3k) in mm^2 of some places (k rows) together."""
        chosen = list(rows)
        gradient = self.gradient[chosen].reshape(3 * len(chosen), -1)
        joint = gradient @ self.cameras @ gradient.T
        for i, row in enumerate(chosen):
            joint[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += self.noise[row]
        return joint

    def variance(self, rows: Sequence[int], derivative: FloatArray) -> float:
        """Variance of a number that depends on some places, by its derivatives (k, 3) per mm."""
        flat = derivative.ravel()
        return float(flat @ self.joint(rows) @ flat)


class Layouts:
    """A target set's layouts as arrays, for observations that name their points as `points` does; None: none."""

    def __init__(self, target_set: TargetSet | None, points: tuple[str, ...]) -> None:
        self.points = points
        known = {} if target_set is None else target_set.layouts
        self.ids = np.array(sorted(known), dtype=np.int64)
        self.flat = np.full((len(self.ids), len(points), 2), np.nan)
        column = {name: i for i, name in enumerate(points)}
        for row, target in enumerate(self.ids.tolist()):
            for name, place in known[target].items():
                if name in column:
                    self.flat[row, column[name]] = place

    def of(self, target: IntArray, point: IntArray) -> FloatArray:
        """Places (n, 2) mm on their flat targets, NaN without a layout, of targets (n,) and points' indices (n,)."""
        if not len(self.ids):
            return np.full((len(target), 2), np.nan)
        row = np.searchsorted(self.ids, target).clip(max=len(self.ids) - 1)
        return np.where((self.ids[row] == target)[:, None], self.flat[row, point], np.nan)

    def dots(self, targets: IntArray) -> IntArray:
        """How many dots targets (t,) of the set have."""
        return np.isfinite(self.flat[np.searchsorted(self.ids, targets), :, 0]).sum(axis=1)


def triangulate_places(
    target: IntArray, point: IntArray, layouts: Layouts, wanted: frozenset[PointName], errors: PointErrors
) -> LocatedPoints:
    """Places of all targets (centres by layout, else points) and wanted points (m,), mm, sorted by name."""
    checked, points = errors.checked, errors.checked.points
    usable = np.isfinite(points.points[:, 0]) & points.in_front & ~checked.contradicting
    flat = layouts.of(target, point)
    centres = _centres(target, flat, usable, checked, layouts)
    centre_seen = np.array([name == CENTRE for name in layouts.points], dtype=bool)[point]
    direct = {int(t) for t in target[usable & centre_seen]}
    names = [PointName(int(t)) for t in centres.target]
    rows = [i for i, name in enumerate(names) if name.target not in direct]
    names = [names[i] for i in rows]
    dots, by_dot = [centres.dots[i] for i in rows], [centres.by_dot[i] for i in rows]
    places = [centres.places_mm[i] for i in rows]
    bent = [float(centres.bent[i]) for i in rows]
    for i in np.flatnonzero(usable):
        name = PointName(int(target[i]), layouts.points[point[i]])
        if np.isnan(flat[i, 0]) or name in wanted:
            names.append(name)
            dots.append(np.array([i]))
            by_dot.append(np.eye(3)[None])
            places.append(points.points[i])
            bent.append(0.0)
    order = sorted(range(len(names)), key=lambda i: names[i])
    found = _places(
        tuple(names[i] for i in order),
        np.array([places[i] for i in order]).reshape(-1, 3),
        tuple(dots[i] for i in order),
        tuple(by_dot[i] for i in order),
        errors,
    )
    return replace(found, noise=found.noise + np.array([bent[i] for i in order])[:, None, None] * np.eye(3))


@dataclass(frozen=True)
class _Centres:
    target: IntArray
    places_mm: FloatArray
    dots: list[IntArray]
    by_dot: list[FloatArray]
    bent: FloatArray  # variance (t,) mm^2 of a centre whose dots are not all seen and do not lie as on flat paper


def _centres(
    target: IntArray, flat: FloatArray, usable: BoolArray, checked: CheckedPoints, layouts: Layouts
) -> _Centres:
    """Targets' centres: flat layouts laid over the dots as in targets/centre.py, all at once, with derivatives."""
    candidates = np.flatnonzero(usable & np.isfinite(flat[:, 0]))
    candidates = candidates[np.argsort(target[candidates], kind="stable")]
    ids, slot, count = np.unique(target[candidates], return_inverse=True, return_counts=True)
    none = _Centres(ids[:0], np.zeros((0, 3)), [], [], np.zeros(0))
    if not len(ids):
        return none
    column = np.arange(len(candidates)) - (np.cumsum(count) - count)[slot]
    shape = (len(ids), int(count.max()))
    mask, dot = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.int64)
    mask[slot, column], dot[slot, column] = True, candidates
    variance = np.where(mask, np.einsum("mii->m", checked.points.covariance)[dot], np.nan)
    with np.errstate(invalid="ignore"):
        mask &= variance <= _WEAK_DOT**2 * np.nanmedian(variance, axis=1, keepdims=True)
    k = mask.sum(axis=1)
    weight = mask / np.maximum(k, 1)[:, None]
    layout = np.where(mask[..., None], np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)[dot], 0.0)
    place = np.where(mask[..., None], checked.points.points[dot], 0.0)
    layout_mean, place_mean = np.einsum("tk,tki->ti", weight, layout), np.einsum("tk,tki->ti", weight, place)
    a = (layout - layout_mean[:, None]) * mask[..., None]
    b = (place - place_mean[:, None]) * mask[..., None]
    good = (k >= LEAST_DOTS) & _spread_out(a, layout_mean)
    if not good.any():
        return none
    ids, mask, dot, k, a, b = ids[good], mask[good], dot[good], k[good], a[good], b[good]
    layout_mean, place_mean = layout_mean[good], place_mean[good]
    u, _, vt = np.linalg.svd(np.einsum("tki,tkj->tij", b, a))
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    rotation = u @ vt
    to_origin = np.einsum("tij,tj->ti", rotation, layout_mean)
    arm = np.einsum("tij,tkj->tki", rotation, a)
    inertia = np.einsum("tki,tki->t", arm, arm)[:, None, None] * np.eye(3) - np.einsum("tki,tkj->tij", arm, arm)
    turn = np.linalg.inv(inertia)[:, None] @ cross_matrix(arm)
    off = (b - arm) * mask[..., None]
    misfit = np.einsum("tki,tki->t", off, off) / (3 * k - 6)
    noise = np.where(mask, checked.noise**2 * variance[good], 0.0).sum(axis=1) / (3 * k)
    bent = np.where((misfit > _BENT * noise) & (k < layouts.dots(ids)), misfit - noise, 0.0)
    by_dot = np.eye(3) / k[:, None, None, None] + cross_matrix(to_origin)[:, None] @ turn
    return _Centres(
        ids,
        place_mean - to_origin,
        [dot[i][mask[i]] for i in range(len(ids))],
        [by_dot[i][mask[i]] for i in range(len(ids))],
        bent,
    )


def _spread_out(centred: FloatArray, mean: FloatArray) -> BoolArray:
    """Whether dots (t, k, 3), about their mean, are not on one line, or on one through the origin."""
    _, spread, axes = np.linalg.svd(centred[:, :, :2], full_matrices=False)
    off = np.abs(np.einsum("ti,ti->t", axes[:, 1], mean[:, :2]))
    return ~((spread[:, 1] < _COLLINEAR * spread[:, 0]) & (off > _COLLINEAR * spread[:, 0]))


def _places(
    names: tuple[PointName, ...],
    places: FloatArray,
    dots: tuple[IntArray, ...],
    by_dot: tuple[FloatArray, ...],
    errors: PointErrors,
) -> LocatedPoints:
    checked, views = errors.checked, errors.checked.views
    n, width = len(names), errors.by_camera.shape[2]
    p = len(views.rotation) * width
    if not n:
        return LocatedPoints(
            (), places, np.zeros((0, 3, 3)), np.zeros((0, 3, len(errors.cameras))), errors.cameras, np.zeros(0, int),
            (), (),
        )  # fmt: skip
    of_dot = np.repeat(np.arange(n), [len(d) for d in dots])
    dot, derivative = np.concatenate(dots), np.concatenate(by_dot)
    noise = np.zeros((n, 3, 3))
    np.add.at(noise, of_dot, derivative @ errors.covariance[dot] @ np.swapaxes(derivative, 1, 2))
    # every pair of a place's dot and a view of it; a dot may serve two places, its target's centre and itself
    start = np.searchsorted(
        views.feature[order := np.argsort(views.feature, kind="stable")], np.arange(views.n_features + 1)
    )
    length = np.diff(start)[dot]
    pair = np.repeat(np.arange(len(dot)), length)
    row = order[np.repeat(start[dot] - (np.cumsum(length) - length), length) + np.arange(length.sum())]
    kept = checked.kept[row]
    pair, row = pair[kept], row[kept]
    gradient = np.zeros((n * len(views.rotation), 3, width))
    at = of_dot[pair] * len(views.rotation) + views.camera[row]
    np.add.at(gradient, at, derivative[pair] @ errors.by_camera[row])
    gradient = gradient.reshape(n, len(views.rotation), 3, width).transpose(0, 2, 1, 3).reshape(n, 3, p)
    if errors.by_shared is not None:
        shared = np.zeros((n, *errors.by_shared.shape[1:]))
        np.add.at(shared, of_dot, derivative @ errors.by_shared[dot])
        gradient = np.concatenate([gradient, shared], axis=2)
    seen = np.zeros(n * len(views.rotation), dtype=bool)
    seen[at] = True
    return LocatedPoints(names, places, noise, gradient, errors.cameras, seen.reshape(n, -1).sum(axis=1), dots, by_dot)
