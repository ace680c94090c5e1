"""Findings where no target was found: in no image, by one camera, at one placement, in an empty table."""

import numpy as np

from spherecal.data.findings import Finding, Findings
from spherecal.data.session import Session
from spherecal.targets.why_nothing import why_nothing_in


def nothing_found(session: Session, from_images: bool) -> Findings:
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
