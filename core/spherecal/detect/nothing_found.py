"""Findings where no target was found: in no image, by one camera, at one placement, in an empty table."""

from pathlib import Path
from typing import Literal

import numpy as np

from spherecal.data.findings import Finding
from spherecal.data.session import Session
from spherecal.targets.target_set import TargetSet
from spherecal.targets.why_nothing import why_nothing_in


def nothing_found(session: Session, from_images: bool) -> tuple[Finding, ...]:
    """Findings on a session without observations, and on cameras and placements whose images gave none."""
    observations, targets = session.observations, session.target_set
    assert observations is not None
    if not from_images:
        return () if len(observations) else (Finding("empty-table", "error"),)
    if targets is None:
        return ()
    shots = [
        (p, c, placement.images[camera.id])
        for p, placement in enumerate(session.placements)
        for c, camera in enumerate(session.cameras)
        if camera.id in placement.images
    ]
    if not len(observations) and shots:
        paths = [path for _, _, path in shots]
        cause = why_nothing_in(paths, targets)
        values = {"images": len(paths), "cause": cause.seen, "remedy": cause.remedy}
        return (Finding("no-targets", "error", values, kind="any" if len(paths) > 1 else "only"),)
    seen = np.zeros((len(session.placements) + len(session.bar_poses), len(session.cameras)), dtype=bool)
    seen[observations.placement, observations.camera] = True
    found = []
    for c, camera in enumerate(session.cameras):
        paths = [path for _, of, path in shots if of == c]
        if paths and not seen[: len(session.placements), c].any():
            found.append(_somewhere("camera", camera.id, paths, targets))
    for p, placement in enumerate(session.placements):
        paths = [path for of, _, path in shots if of == p]
        if paths and not seen[p].any():
            found.append(_somewhere("placement", placement.id, paths, targets))
    return tuple(found)


def _somewhere(kind: Literal["camera", "placement"], name: str, paths: list[Path], targets: TargetSet) -> Finding:
    cause = why_nothing_in(paths, targets)
    return Finding("no-targets-here", "warning", {"cause": cause.seen, "remedy": cause.remedy}, (name,), kind=kind)
