"""Focal lengths that nobody stated, from how a ball of known targets looks in one camera's images.

From 1.2 times the image's longer side the adjustment finds lenses of 4 to 50 mm too where data are good. With lenses of
4 mm, two placements and 10 % wrong matches it then placed five of six cameras, with this start all six.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.data.observations import Observations
from spherecal.data.session import CameraSpec, Session

# Start values, as multiples of the image's longer side: 4 to 50 mm are 0.5 to 7.1 of it for a sensor of 7.1 mm.
_START = np.geomspace(0.35, 12.0, 10)
_LEAST_DOTS, _LEAST_TARGETS, _MOST_PLACEMENTS = 4, 12, 6
# A standard deviation of ln f beyond this says nothing. Sessions of 4 to 50 mm have 0.001 to 0.05.
_MOST_SD = 0.25
_TERMS = np.array([1.0, 1.0, np.sqrt(2.0)])


@dataclass(frozen=True)
class _Looks:
    """Targets in one camera's images: centroids (n,2) px from the image's middle, shapes A A' (n,2,2) in (px/mm)^2.

    A maps the flat sticker onto the image; A A' does not depend on how the sticker is turned. `root` (n,2,2) makes it
    the unit matrix; `weight` (n,) is what a pixel is of the target's shorter side.
    """

    placement: IntArray
    centroid: FloatArray
    root: FloatArray
    weight: FloatArray
    shape: FloatArray


def with_seen_focal_lengths(session: Session) -> tuple[Session, dict[str, float]]:
    """The session with priors for the focal lengths that were only assumed, and those by camera, px.

    Unchanged where the ball's targets or diameter are not known, or do not say it; cameras of one group share one.
    """
    o, targets, diameter = session.observations, session.target_set, session.sphere_diameter_mm
    unknown = [c for c in session.cameras if "focal_length" in c.assumed and c.lens_model == "brown"]
    if o is None or targets is None or diameter is None or not unknown:
        return session, {}
    of_ball = o.select(o.placement < len(session.placements))
    layouts = {number: {k: np.asarray(v, float) for k, v in dots.items()} for number, dots in targets.layouts.items()}
    found: dict[str, list[float]] = {}
    for camera in unknown:
        rows = of_ball.select(of_ball.camera == session.cameras.index(camera))
        f = _focal_length(_looks(rows, layouts, camera), diameter / 2, max(camera.image_size))
        found.setdefault(camera.intrinsics_group, []).extend([] if f is None else [f])
    shared = {group: float(np.median(values)) for group, values in found.items() if values}
    known = {camera.id: shared[camera.intrinsics_group] for camera in unknown if camera.intrinsics_group in shared}
    cameras = list(session.cameras)
    for c, camera in enumerate(cameras):
        if (f := known.get(camera.id)) is not None:
            cameras[c] = replace(camera, prior=np.array([f, f, *camera.prior[2:]]))
    return replace(session, cameras=tuple(cameras)), known


def _looks(o: Observations, layouts: dict[int, dict[str, FloatArray]], camera: CameraSpec) -> _Looks:
    middle = (np.array(camera.image_size, dtype=float) - 1) / 2
    order = np.lexsort((o.target, o.placement))
    starts = np.flatnonzero(np.diff(o.target[order], prepend=-1) | np.diff(o.placement[order], prepend=-1))
    kept: list[tuple[int, FloatArray, FloatArray, float, FloatArray]] = []
    for rows in np.split(order, starts[1:]):
        layout = layouts.get(int(o.target[rows[0]]), {}) if len(rows) else {}
        known = np.array([row for row in rows if o.points[o.point[row]] in layout], dtype=int)
        if len(known) < _LEAST_DOTS:
            continue
        flat = np.array([layout[o.points[o.point[row]]] for row in known])
        flat, uv = flat - flat.mean(axis=0), o.uv[known]
        a = np.linalg.lstsq(flat, uv - uv.mean(axis=0), rcond=None)[0].T
        least = np.linalg.svd(a, compute_uv=False)[-1]
        if np.linalg.matrix_rank(flat) == 2 and least > 0:
            shape = a @ a.T
            root = np.linalg.inv(np.linalg.cholesky(shape))
            kept.append(
                (int(o.placement[known[0]]), uv.mean(axis=0) - middle, root, least * np.linalg.norm(flat), shape)
            )
    placement = np.array([one[0] for one in kept], dtype=int)
    of_most = np.argsort(-np.bincount(placement, minlength=1), kind="stable")[:_MOST_PLACEMENTS]
    chosen = [one for one in kept if one[0] in of_most]
    columns = [np.array(column) for column in zip(*chosen, strict=True)] if chosen else [np.empty(0)] * 5
    return _Looks(np.unique(columns[0], return_inverse=True)[1], *columns[1:])


def _focal_length(looks: _Looks, radius_mm: float, side_px: int) -> float | None:
    """The focal length in px; None where too few targets are seen, or they fit many."""
    if len(looks.placement) < _LEAST_TARGETS:
        return None

    def misfit(x: FloatArray, log_f: float | None = None) -> FloatArray:
        centres = x[-3 * count :].reshape(count, 3)
        return _misfit(looks, x[0] if log_f is None else log_f, centres, radius_mm)

    count = int(looks.placement.max()) + 1
    best: tuple[float, Any] | None = None
    for log_f in np.log(_START * side_px):
        start = _centres(looks, float(np.exp(log_f)), radius_mm, count).ravel()
        fit = least_squares(misfit, start, kwargs={"log_f": log_f}, loss="cauchy", x_scale="jac", max_nfev=12)
        if best is None or fit.cost < best[0]:
            best = fit.cost, np.concatenate([[log_f], fit.x])
    assert best is not None
    fit = least_squares(misfit, best[1], loss="cauchy", x_scale="jac", max_nfev=100)
    freedom = fit.fun.size - fit.x.size
    sd = np.sqrt(2 * fit.cost / max(freedom, 1) * np.linalg.pinv(fit.jac.T @ fit.jac)[0, 0])
    return float(np.exp(fit.x[0])) if freedom > 0 and sd < _MOST_SD else None


def _centres(looks: _Looks, f: float, radius_mm: float, count: int) -> FloatArray:
    """About where the ball is (count,3) mm in the camera's frame, from directions and sizes of its targets."""
    sizes = np.sqrt(np.linalg.eigvalsh(looks.shape)[:, -1])
    rays = np.column_stack([looks.centroid / f, np.ones(len(looks.centroid))])
    out = np.empty((count, 3))
    for t in range(count):
        own = looks.placement == t
        out[t] = np.median(rays[own], axis=0) * (f / np.median(sizes[own]) + 0.8 * radius_mm)
    return out


def _misfit(looks: _Looks, log_f: float, centres: FloatArray, radius_mm: float) -> FloatArray:
    """How far the shapes are from those on spheres of this radius at `centres`: 3 for each target, in about px."""
    f, c = np.exp(log_f), centres[looks.placement]
    ray = np.column_stack([looks.centroid / f, np.ones(len(c))])
    along, square = (ray * c).sum(axis=1), (ray * ray).sum(axis=1)
    root = np.sqrt(np.maximum(along**2 - square * ((c * c).sum(axis=1) - radius_mm**2), 0.0))
    point = ((along - root) / square)[:, None] * ray
    normal = (point - c) / radius_mm
    z = np.maximum(point[:, 2], 1e-3 * radius_mm)
    j = np.zeros((len(c), 2, 3))
    j[:, 0, 0] = j[:, 1, 1] = f / z
    j[:, :, 2] = -looks.centroid / z[:, None]
    tilt = np.einsum("nij,nj->ni", j, normal)
    seen = np.einsum("nij,nkj->nik", j, j) - tilt[:, :, None] * tilt[:, None, :]
    same = looks.root @ seen @ looks.root.transpose(0, 2, 1) - np.eye(2)
    parts = np.stack([same[:, 0, 0], same[:, 1, 1], same[:, 0, 1]], axis=1) * _TERMS
    return (parts * looks.weight[:, None]).ravel()
