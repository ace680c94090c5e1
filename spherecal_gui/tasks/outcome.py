"""A result as the window shows it: read, compared with the calibration in use, and the paths by which it was built."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.base.errors import SpherecalError
from spherecal.data.observations import Observations, find_features
from spherecal_gui.rig_scenes import RigPlanes
from spherecal_gui.tasks.placement_advice import plan_poses_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from spherecal.data.rig import Rig
    from spherecal.data.session import Bar
    from spherecal_rigs.compare_rigs import Comparison
    from spherecal_rigs.framed_rig import Place
    from spherecal_rigs.pose_plan import PosePlan
    from spherecal_rigs.result_folder import Result


MOTIONS = "image_motions.csv"


@dataclass(frozen=True, eq=False)
class CameraEffect:
    """What one lens and mount do that no model has."""

    camera: str
    field_px: FloatArray | None  # size of its lens's field (rows, columns); None without one
    drift_px: FloatArray  # its turn at each placement (n,), half-way between axis and corners

    @property
    def field_rms_px(self) -> float:
        """Root mean square of the field, of one coordinate."""
        return 0.0 if self.field_px is None else float(np.sqrt((self.field_px**2).mean() / 2))


def effects_of(rig: "Rig", folder: Path) -> tuple[CameraEffect, ...]:
    """Those of a result in a folder; () where neither fields nor motions were estimated."""
    turns: dict[str, list[FloatArray]] = {}
    if (folder / MOTIONS).is_file():
        with (folder / MOTIONS).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                turns.setdefault(row["camera"], []).append(np.array([float(row[f"r{axis}_deg"]) for axis in "xyz"]))
    found = []
    for camera in rig.cameras:
        field = camera.field
        size = None if field is None or not (field.du.any() or field.dv.any()) else np.hypot(field.du, field.dv)
        own = np.array(turns.get(camera.id, [])).reshape(-1, 3)
        across = np.array([camera.intrinsics[1], camera.intrinsics[0], np.hypot(*camera.image_size) / 4])
        found.append(CameraEffect(camera.id, size, np.linalg.norm(np.deg2rad(own) * across, axis=1)))
    return tuple(found) if any(one.field_px is not None or len(one.drift_px) for one in found) else ()


# Imported inside functions: scipy and the kernels, for which the window does not wait.


@dataclass(frozen=True, eq=False)
class Compared:
    """The comparison (profile.compare, metric) with calibration `number` of the profile, made at `made`."""

    number: str
    made: str
    comparison: "Comparison"


@dataclass(frozen=True, eq=False)
class Outcome:
    """A result with all that the window shows of it."""

    result: "Result"
    compared: Compared | None = None
    links: tuple[tuple[str, str], ...] = ()  # steps of every camera's path to the reference, by name
    plan: "PosePlan | None" = None  # where to lay the check bars
    planes: RigPlanes | None = None  # from where that is shown
    places: "Mapping[str, Place]" = field(default_factory=dict)  # that a user's frame may be defined by
    images: "Mapping[str, NDArray[np.uint8]]" = field(default_factory=dict)  # the last of each camera, small
    effects: tuple[CameraEffect, ...] = ()  # of lenses and mounts, () where none were estimated


def read_outcome(folder: Path, session: Path, profile: Path, bars: "Sequence[Bar]", context: Context) -> Outcome:
    """The result in a folder with all that can be said about it."""
    from spherecal_rigs.result_folder import read_result

    context.report("reading the result", 0.0)
    result = read_result(folder)
    context.report("reading the result", 0.5)
    links = _links(result, session, context)
    if (profile / "profile.json").is_file():
        context.report("comparing with the calibration in use", 0.8)
    compared = _compared(result.rig, profile)
    plan = plan_poses_of(folder, result.rig, bars)
    planes = RigPlanes.of(result.rig, plan.box.middle) if plan is not None else None
    context.report("reading the result", 0.9)
    places, images, effects = _places(folder, session), _last_images(session), effects_of(result.rig, folder)
    return Outcome(result, compared, links, plan, planes, places, images, effects)


def _last_images(folder: Path) -> "Mapping[str, NDArray[np.uint8]]":
    """The last image of each camera; none where the session cannot be read, as the result does not depend on it."""
    from spherecal_documents.scene.picture import last_images
    from spherecal_files.read_session import read_session

    try:
        return last_images(read_session(folder))
    except SpherecalError:
        return {}


def _places(folder: Path, session: Path) -> "Mapping[str, Place]":
    """The places to define a frame by, with those that the project's own frame names."""
    from spherecal_rigs.framed_rig import FRAME, result_places

    try:
        wanted = FRAME.read(session / "frame.json").definition.places if (session / "frame.json").is_file() else ()
    except SpherecalError:  # reported where the frame is used
        wanted = ()
    return result_places(folder, wanted)


def _compared(rig: "Rig", profile: Path) -> Compared | None:
    """Against the calibration in use, or the one before where this very one is in use already."""
    from spherecal_rigs.compare_rigs import compare, seen_volume
    from spherecal_rigs.rig_source import entry_volume
    from spherecal_rigs.store import is_profile, open_profile

    if not is_profile(profile):
        return None
    try:
        kept = open_profile(profile)
        number = kept.active_id
        if number is not None and kept.active is not None and kept.active.input_sha256 == rig.input_sha256:
            number = kept.last_good_id
        if number is None or number not in kept.entries:
            return None
        before, entry = kept.rig(number), kept.entries[number]
        _, metric = compare(before, rig, entry_volume(entry) or seen_volume(before))
    except SpherecalError:  # other cameras, another rig: there is nothing to compare
        return None
    return Compared(number, f"{entry.calibrated_at.astimezone():%Y-%m-%d %H:%M}", metric)


def _links(result: "Result", session: Path, context: Context) -> tuple[tuple[str, str], ...]:
    """The paths that OPT finds in the result's observations, from the session's own start values."""
    from spherecal.initialise.local import reconstruct_locally
    from spherecal_files.read_session import read_session

    try:
        cameras = {camera.id: camera.prior for camera in read_session(session).cameras}
        observations, names = _observations(result, tuple(cameras))
    except SpherecalError:
        return ()
    if not len(observations):
        return ()
    priors = np.array([cameras[name] for name in names])
    local = reconstruct_locally(observations, find_features(observations), priors, 0, context)
    steps = {step for path in local.paths.values() for step in pairwise(path.cameras)}
    return tuple(sorted((names[a], names[b]) for a, b in steps))


def _observations(result: "Result", cameras: tuple[str, ...]) -> tuple[Observations, tuple[str, ...]]:
    """What the cameras saw, from the residuals: predicted minus residual."""
    table = result.residuals
    known = [name for name in cameras if name in table.rows_of]
    rows = np.flatnonzero(np.isfinite(table.predicted).all(axis=1) & np.isfinite(table.du_dv).all(axis=1))
    rows = rows[np.isin(np.array(table.camera, dtype=object)[rows], known)]
    placements, points = (tuple(dict.fromkeys(column)) for column in (table.placement, table.point))
    at = [{name: i for i, name in enumerate(names)} for names in (placements, known, points)]
    picked = [
        np.array([index[column[row]] for row in rows.tolist()], dtype=np.int64)
        for index, column in zip(at, (table.placement, table.camera, table.point), strict=True)
    ]
    uv = table.predicted[rows] - table.du_dv[rows]
    names = tuple(known)
    return Observations(placements, names, points, picked[0], picked[1], table.target[rows], picked[2], uv), names
