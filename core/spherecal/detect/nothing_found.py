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
    seen = np.zeros((len(session.placements) + len(session.bar_poses), len(session.cameras)), dtype=bool)
    seen[observations.placement, observations.camera] = True
    blind, empty = (~seen[: len(session.placements)].any(axis=0)).tolist(), (~seen.any(axis=1)).tolist()
    of_cameras = [("camera", one.id, 1, i) for i, one in enumerate(session.cameras) if blind[i]]
    of_places = [("placement", one.id, 0, i) for i, one in enumerate(session.placements) if empty[i]]
    found = []
    for kind, name, of, i in of_cameras + of_places:
        if paths := [shot[2] for shot in shots if shot[of] == i]:
            cause = why_nothing_in(paths, targets)
            values = {"cause": cause.seen, "remedy": cause.remedy}
            found.append(Finding("no-targets-here", "warning", values, (name,), kind=kind))
    return tuple(found)
