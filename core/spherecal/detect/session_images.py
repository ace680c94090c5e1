"""Observations of a session from its images."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, Findings
from spherecal.data.observations import Observations
from spherecal.data.session import CameraSpec, Session
from spherecal.targets.detect_images import detect_images
from spherecal.targets.detection import DetectionSettings
from spherecal.targets.why_nothing import why_nothing_in


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
    placement, camera, paths = (list(column) for column in zip(*shots, strict=True))
    settings = [_what_is_known(session.cameras[c]) for c in camera]
    found = detect_images(paths, session.target_set, context, os.cpu_count() or 1, settings)
    count = [len(one) for one in found]
    image = np.repeat(np.array(placement, np.int64), count), np.repeat(np.array(camera, np.int64), count)
    target, point, uv, sigma = (
        np.concatenate([getattr(one, name) for one in found]) for name in ("target", "point", "uv", "sigma_uv")
    )
    places = tuple(place.id for place in (*session.placements, *session.bar_poses))
    names = places, tuple(camera.id for camera in session.cameras), found[0].points
    return replace(session, observations=Observations(*names, *image, target, point, uv, sigma))


def _shots(session: Session, bar_poses_only: bool) -> list[tuple[int, int, Path]]:
    """All images, in the order of placements, bar poses and cameras: place and camera (indices), and the file."""
    index = {camera.id: c for c, camera in enumerate(session.cameras)}
    groups = [place.images for place in (*session.placements, *session.bar_poses)]
    first = len(session.placements) if bar_poses_only else 0
    return [
        (p, index[camera], images[camera])
        for p, images in enumerate(groups)
        if p >= first
        for camera in sorted(images, key=index.__getitem__)
    ]


def _what_is_known(camera: CameraSpec) -> DetectionSettings:
    u0, v0 = camera.prior[2:4]
    return DetectionSettings(float(camera.prior[0]), (float(u0), float(v0)), camera.image_size, camera.ignore)


# --- findings where no target was found ------------------------------------------------------------------------------


def nothing_found(session: Session, from_images: bool) -> Findings:
    """Findings on a session without observations, and on cameras and placements whose images gave none."""
    observations, targets = session.observations, session.target_set
    assert observations is not None
    if not from_images:
        return () if len(observations) else (Finding("empty-table", "error"),)
    if targets is None:
        return ()
    shots = [shot for shot in _shots(session, False) if shot[0] < len(session.placements)]
    if not len(observations) and shots:
        paths = [path for _, _, path in shots]
        cause = why_nothing_in(paths, targets)
        values = {"images": len(paths), "cause": cause.seen, "remedy": cause.remedy}
        return (Finding("no-targets", "error", values, kind="any" if len(paths) > 1 else "only"),)
    n, cameras = len(session.placements), session.cameras
    seen = np.zeros((n + len(session.bar_poses), len(cameras)), dtype=bool)
    seen[observations.placement, observations.camera] = True
    blind, empty = (np.flatnonzero(~seen[:n].any(axis=axis)).tolist() for axis in (0, 1))
    of_cameras = [("camera", cameras[c].id, 1, c) for c in blind]
    of_places = [("placement", session.placements[p].id, 0, p) for p in empty]
    found = []
    for kind, name, of, i in of_cameras + of_places:
        if paths := [shot[2] for shot in shots if shot[of] == i]:
            cause = why_nothing_in(paths, targets)
            values = {"cause": cause.seen, "remedy": cause.remedy}
            found.append(Finding("no-targets-here", "warning", values, (name,), kind=kind))
    return tuple(found)
