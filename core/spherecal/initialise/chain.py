"""Poses and points chained along the paths into the reference camera's frame, [Tao21] (16)-(17)."""

from collections.abc import Iterable

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.initialise.camera_path import Path
from spherecal.initialise.triple import Triple


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
