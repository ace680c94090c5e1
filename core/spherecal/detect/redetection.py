"""Re-detection: targets that one camera missed though others saw them, searched where they must be."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Features, Observations
from spherecal.data.rig import Calibration, RigCamera
from spherecal.data.session import Session
from spherecal.geometry.camera import is_unfolded, project
from spherecal.targets.code_table import CodeTable, code_table
from spherecal.targets.detect_images import STAGE
from spherecal.targets.family import DOTS
from spherecal.targets.images import read_image
from spherecal.targets.masks import masked
from spherecal.targets.predicted_search import LEAST_DOTS, ExpectedTargets, Found, detect_predicted

# Beyond this angle between a sticker's normal and the line of sight its dots are a pixel wide and merge.
MOST_VIEW_DEG = 76.0
BORDER_PX = 8.0


@dataclass(frozen=True)
class Located:
    """What a first adjustment found: cameras by their names, and the places (m,3) of features."""

    cameras: dict[str, RigCamera]
    features: Features
    points_mm: FloatArray

    @classmethod
    def of(cls, first: Calibration) -> "Located":
        """What a calibration found."""
        return cls({camera.id: camera for camera in first.rig.cameras}, first.features, first.points_mm)


def with_missed_targets(session: Session, first: Located, context: Context) -> Session:
    """The session with targets found at places that a first adjustment predicts; as it is where none is found.

    Markers are found by their outlines, whatever is expected of them.
    """
    observations, targets = session.observations, session.target_set
    if observations is None or targets is None or targets.dictionary is not None or not first.cameras:
        return session
    table = code_table(targets)
    points = _points_by_target(first, observations, table)
    jobs = list(_jobs(session, observations, first, table, points))

    def search(job: _Job) -> Found:
        _, _, path, camera, expected = job
        focal, _, u0, v0 = camera.intrinsics[:4]
        return detect_predicted(read_image(path), expected, table, (focal, u0, v0))

    names, more = ("placement", "camera", "target", "point", "uv", "sigma"), []
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for number, (job, found) in enumerate(zip(jobs, pool.map(search, jobs), strict=True)):
            context.report(STAGE, number / len(jobs), Phrase("looking-again"))
            n, k = np.nonzero(np.isfinite(found.uv[..., 0]))
            if len(n):
                image = np.full(len(n), job[0]), np.full(len(n), job[1])
                more.append((*image, found.targets[n], k, found.uv[n, k], found.sigma_uv[n, k]))
    if not more:
        return session
    columns = zip(names, zip(*more, strict=True), strict=True)
    behind = {k: np.concatenate([getattr(observations, k), *own]) for k, own in columns}
    return replace(session, observations=replace(observations, **behind))


_Job = tuple[int, int, Path, RigCamera, ExpectedTargets]  # placement and camera (indices) of an image to look at again


def _points_by_target(first: Located, observations: Observations, table: CodeTable) -> FloatArray:
    """Reconstructed dots (placements, targets, 8, 3) of the ball, NaN where there are none."""
    f, names = first.features, observations.points
    out = np.full((len(observations.placements), len(table.ids), len(DOTS), 3), np.nan)
    point = np.array([DOTS.index(name) if name in DOTS else -1 for name in names])[f.point]
    rows = np.flatnonzero((point >= 0) & np.isin(f.target, table.ids))
    out[f.placement[rows], np.searchsorted(table.ids, f.target[rows]), point[rows]] = first.points_mm[rows]
    return out


def _jobs(
    session: Session, observations: Observations, first: Located, table: CodeTable, points: FloatArray
) -> Iterator[_Job]:
    for p, placement in enumerate(session.placements):
        faces = _faces(points[p])
        for c, spec in enumerate(session.cameras):
            camera, path = first.cameras.get(spec.id), placement.images.get(spec.id)
            if camera is None or path is None:
                continue
            known, known_uv = _seen(observations, p, c)
            missed = _facing(camera, *faces) & ~np.isin(table.ids, known)
            uv = _predict(camera, points[p][missed])
            inside = _inside(uv, camera) & ~masked(uv, spec.ignore).any(axis=1)
            if inside.any():
                expected = ExpectedTargets(table.ids[missed][inside], uv[inside], known, known_uv)
                yield p, c, path, camera, expected


def _seen(observations: Observations, placement: int, camera: int):
    """Targets that a camera saw at a placement: ids (k,) and dots (k, 8, 2), NaN where missing."""
    rows = np.flatnonzero((observations.placement == placement) & (observations.camera == camera))
    ids, position = np.unique(observations.target[rows], return_inverse=True)
    uv = np.full((len(ids), len(DOTS), 2), np.nan)
    uv[position, observations.point[rows]] = observations.uv[rows]
    return ids, uv


def _faces(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middles and outward normals (n, 3) of the targets of a placement, NaN where too few dots are reconstructed."""
    known = np.isfinite(points[..., 0])
    middle = np.full((len(points), 3), np.nan)
    normal = np.full((len(points), 3), np.nan)
    for n in np.flatnonzero(known.sum(axis=1) >= LEAST_DOTS):
        dots = points[n][known[n]]
        middle[n] = dots.mean(axis=0)
        normal[n] = np.linalg.svd(dots - middle[n])[2][2]
    inward = (normal * (middle - np.nanmean(middle, axis=0))).sum(axis=1) < 0
    return middle, np.where(inward[:, None], -normal, normal)


def _facing(camera: RigCamera, middle: FloatArray, outward: FloatArray) -> BoolArray:
    """Targets (n,) whose face the camera sees at a fair angle."""
    sight = camera.centre_mm - middle
    with np.errstate(invalid="ignore"):
        cosine = (outward * sight).sum(axis=1) / np.linalg.norm(sight, axis=1)
        return cosine > np.cos(np.deg2rad(MOST_VIEW_DEG))


def _predict(camera: RigCamera, points: FloatArray) -> FloatArray:
    """Image points (n, 8, 2) px of dots (n, 8, 3), NaN where they are unknown or the camera cannot show them."""
    x = points.reshape(-1, 3) @ camera.rotation.T + camera.translation_mm
    with np.errstate(invalid="ignore"):
        shown = x[:, 2] > 0
        shown[shown] = is_unfolded(x[shown], np.broadcast_to(camera.intrinsics, (int(shown.sum()), 16)))
        uv = np.where(shown[:, None], project(x, camera.intrinsics), np.nan)
    return uv.reshape(*points.shape[:2], 2)


def _inside(uv: FloatArray, camera: RigCamera) -> BoolArray:
    """Targets (n,) of which enough dots are known, all of them inside the image."""
    known = np.isfinite(uv[..., 0])
    limit = np.array(camera.image_size) - 1 - BORDER_PX
    with np.errstate(invalid="ignore"):
        outside = known & ((uv < BORDER_PX) | (uv > limit)).any(axis=2)
    return (known.sum(axis=1) >= LEAST_DOTS) & ~outside.any(axis=1)
