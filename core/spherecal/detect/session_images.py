"""Observations of a session from its images."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Observations
from spherecal.data.session import CameraSpec, Session
from spherecal.targets.detect_images import detect_images
from spherecal.targets.detection import Detections, DetectionSettings


@dataclass(frozen=True)
class _Shot:
    """One image: of which placement or bar pose and camera (indices), and its file."""

    placement: int
    camera: int
    path: Path


def observed(session: Session, context: Context, bar_poses_only: bool = False) -> Session:
    """The session with observations: its own, or else those of the targets found in its images."""
    if session.observations is not None:
        return session
    shots = _shots(session, bar_poses_only)
    if not shots:
        nothing = "error-no-bar-images" if bar_poses_only and session.placements else "error-nothing-recorded"
        raise InputError(Phrase(nothing, {"folder": session.where}))
    if session.target_set is None:
        raise InputError(Phrase("error-no-target-set", {"folder": session.where}))
    settings = [_what_is_known(session.cameras[shot.camera]) for shot in shots]
    paths = [shot.path for shot in shots]
    detections = detect_images(paths, session.target_set, context, os.cpu_count() or 1, settings)
    return replace(session, observations=_collect(session, shots, detections))


def _shots(session: Session, bar_poses_only: bool) -> list[_Shot]:
    """All images of the session in the order of placements, bar poses and cameras."""
    index = {camera.id: c for c, camera in enumerate(session.cameras)}
    groups = [placement.images for placement in session.placements] + [pose.images for pose in session.bar_poses]
    first = len(session.placements) if bar_poses_only else 0
    return [
        _Shot(p, index[camera], path)
        for p, images in enumerate(groups)
        if p >= first
        for camera, path in sorted(images.items(), key=lambda item: index[item[0]])
    ]


def _what_is_known(camera: CameraSpec) -> DetectionSettings:
    u0, v0 = camera.prior[2:4]
    return DetectionSettings(float(camera.prior[0]), (float(u0), float(v0)), camera.image_size, camera.ignore)


def _collect(session: Session, shots: Sequence[_Shot], detections: Sequence[Detections]) -> Observations:
    """The dots found in all images as one table of observations."""
    count = np.array([len(found) for found in detections])

    def column(values: list[int]) -> np.ndarray:
        return np.repeat(np.array(values, dtype=np.int64), count)

    return Observations(
        tuple(placement.id for placement in session.placements) + tuple(pose.id for pose in session.bar_poses),
        tuple(camera.id for camera in session.cameras),
        detections[0].points,
        column([shot.placement for shot in shots]),
        column([shot.camera for shot in shots]),
        np.concatenate([found.target for found in detections]),
        np.concatenate([found.point for found in detections]),
        np.concatenate([found.uv for found in detections]),
        np.concatenate([found.sigma_uv for found in detections]),
    )
