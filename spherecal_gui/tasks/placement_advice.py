"""The engine's advice after each placement, from the dots that were found already; the check bars' poses."""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.data.observations import Observations
from spherecal.targets.family import DOTS
from spherecal.targets.marker_set import CORNERS
from spherecal.targets.target_set import TargetSet
from spherecal_files.filesystem import create
from spherecal_files.table_file import COLUMNS
from spherecal_files.target_set_file import write_target_set
from spherecal_gui import limits_in_force as limits
from spherecal_gui.coverage import Dots, SetDots
from spherecal_gui.project_folder import Document
from spherecal_gui.rig_scenes import GuidanceView, next_scene

if TYPE_CHECKING:
    from spherecal.data.rig import Calibration, Rig
    from spherecal.data.session import Bar, Session
    from spherecal_cameras.simulated.stage import Stage
    from spherecal_rigs.next_placement import Guidance as Advised
    from spherecal_rigs.pose_plan import PlannedPose, PosePlan

# Imported inside functions: the calibration with scipy and the kernels, for which the window does not wait.

# Dots of a camera from which the first answer is worked out: with 80 the cameras are known to some px (demo rig).
_COARSE_DOTS = 160
_IN_SIGHT = "live"


def plan_coarse(
    document: Document, target_set: TargetSet | None, dots: Mapping[str, SetDots], context: Context
) -> GuidanceView | None:
    """A first answer, from a few dots and by geometry alone; None where they give nothing to plan with."""
    from spherecal.calibrate import calibrate
    from spherecal.steps.settings import CalibrationSettings
    from spherecal_gui.tasks.ghost import thinned
    from spherecal_rigs.next_placement import first_guess

    few = {name: thinned(one, _COARSE_DOTS) for name, one in dots.items()}
    share = _dots_in(few) / max(_dots_in(dots), 1)
    session = session_of_dots(document, target_set, few)
    # held: a quarter of the time, and 10 px of an outline for some seconds (benchmarks/studies/ghost.py)
    quick = CalibrationSettings(method="free", repair_by_itself=False, intrinsics="fixed")
    calibration = calibrate(session, quick, context)
    found = first_guess(session, calibration, round(share * limits.now().needed_dots))
    return _shown(session, calibration, found, coarse=True)


def survey(document: Document, target_set: TargetSet | None, dots: SetDots, context: Context) -> GuidanceView | None:
    """Where cameras and ball are, as far as what is in sight says, in millimetres of the print."""
    alone: Document = {**document, "placements": [{"id": _IN_SIGHT}]}
    return plan_coarse(alone, target_set, {_IN_SIGHT: dots}, context)


def _dots_in(sets: Mapping[str, SetDots]) -> int:
    return sum(len(dots) for one in sets.values() for dots in one.values())


def plan_next(
    document: Document, target_set: TargetSet | None, dots: Mapping[str, SetDots], context: Context
) -> GuidanceView | None:
    """Where to put the ball next; None where the placements so far give nothing to plan with."""
    from spherecal.calibrate import calibrate
    from spherecal_rigs.next_placement import advise

    session = session_of_dots(document, target_set, dots)
    calibration = calibrate(session, None, context)
    return _shown(session, calibration, advise(session, calibration, context, limits.now().needed_dots))


def _shown(
    session: "Session", calibration: "Calibration", found: "Advised | None", coarse: bool = False
) -> GuidanceView | None:
    """The engine's answer as the window shows it, with the ghost of the ball at the proposed place."""
    from spherecal.geometry.rotation import exp_rotation
    from spherecal_documents.report.rig_view import choose_axes
    from spherecal_gui.tasks.ghost import Ghost, Lenses, body_of

    best = found.best if found is not None else None
    if found is None or best is None:
        return None
    order = {placement.id: i for i, placement in enumerate(session.placements)}
    spheres = [sphere for sphere in calibration.spheres if sphere.placement in order]
    spheres.sort(key=lambda sphere: order[sphere.placement])
    if not spheres:
        return None
    cameras = calibration.rig.cameras
    places = [np.array([one.centre_mm for one in group]) for group in (cameras, spheres)]
    up = choose_axes(cameras, *places)[0][2]
    body = body_of(calibration, spheres[-1].placement, up)
    ghost = None
    if body is not None:
        turn = np.zeros(3) if best.axis is None else np.deg2rad(best.turn_deg) * np.asarray(best.axis)
        ghost = Ghost(Lenses.of(calibration.rig), body, best.centre_mm, exp_rotation(turn))
    scene = next_scene(calibration.rig, spheres, best.centre_mm)
    return GuidanceView(found.now_mm, best.expanded_mm, ghost, scene, coarse)


def session_of_dots(document: Document, target_set: TargetSet | None, dots: Mapping[str, SetDots]) -> "Session":
    """A session with these dots as its observations; the reader of sessions checks all the rest."""
    placements = [one["id"] for one in document["placements"] if one["id"] in dots]
    cameras = [camera["id"] for camera in document["cameras"]]
    bare = {key: value for key, value in document.items() if key not in ("bars", "bar_poses", "target_set")}
    if (bare.get("scale") or {}).get("kind") != "target_spacing":  # the bar's poses come after the placements
        bare["scale"] = printed_scale(target_set) if target_set is not None else None
        bare = {key: value for key, value in bare.items() if value is not None}
    bare["placements"] = [{"id": name} for name in placements]
    return replace(_read(bare, target_set), observations=observations_of(placements, cameras, dots, target_set))


def observations_of(
    placements: list[str], cameras: list[str], dots: Mapping[str, SetDots], target_set: TargetSet | None
) -> Observations:
    """The dots of these placements and cameras, or the corners of markers, as one table."""
    shots = [(p, c, dots[name].get(camera)) for p, name in enumerate(placements) for c, camera in enumerate(cameras)]
    found = [(p, c, one) for p, c, one in shots if one is not None and len(one)]
    count = [len(one) for _, _, one in found]

    return Observations(
        tuple(placements),
        tuple(cameras),
        DOTS if target_set is None or target_set.dictionary is None else CORNERS,
        np.repeat(np.array([p for p, _, _ in found], dtype=np.int64), count),
        np.repeat(np.array([c for _, c, _ in found], dtype=np.int64), count),
        np.concatenate([np.empty(0, np.int64), *(one.target for *_, one in found)]).astype(np.int64),
        np.concatenate([np.empty(0, np.int64), *(one.point for *_, one in found)]).astype(np.int64),
        np.concatenate([np.empty((0, 2)), *(one.uv for *_, one in found)]).astype(np.float64),
    )


def printed_scale(target_set: TargetSet) -> Document | None:
    """The scale as the targets were printed, good to a percent or so; None where no distance is that of all targets."""
    widest = target_set.widest()
    if widest is None:
        return None
    first, second, distance_mm = widest
    return {
        "kind": "target_spacing", "from": first, "to": second, "distance_mm": distance_mm, "surface": "sphere",
        "expanded_uncertainty_mm": 0.0,  # the bar takes its place: what the print errs by is not for placements to mend
    }  # fmt: skip


def _read(document: Document, target_set: TargetSet | None) -> "Session":
    from spherecal_files.read_session import read_session

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if target_set is not None:
            write_target_set(folder / "targets.json", target_set)
            document = {**document, "target_set": "targets.json"}
        create(folder / "session.json", json.dumps(document).encode())
        create(folder / "observations.csv", (",".join(COLUMNS) + "\n").encode())
        return read_session(folder)


def plan_poses_of(result_folder: Path, rig: "Rig", bars: "Sequence[Bar]") -> "PosePlan | None":
    """The plan for the check bars among `bars`; None without a scale, a volume or such a bar."""
    from spherecal_rigs.pose_plan import BarMarks, plan_poses
    from spherecal_rigs.rig_source import corners_beside

    marks = [BarMarks.of(bar.id, bar.lengths) for bar in bars if bar.role == "check" and bar.lengths]
    corners = corners_beside(result_folder)
    if not marks or corners is None or not rig.cameras or rig.scale.source == "none":
        return None
    plan = plan_poses(rig, marks, corners)
    return plan if plan.poses else None


def lying_ends(rig: "Rig", bar: "Bar", target_set: TargetSet | None, dots: Mapping[str, Dots]) -> FloatArray | None:
    """Where the first and the last mark of a bar are, (2, 3) mm in the rig's world; None where not found."""
    from spherecal_rigs.pose_plan import measured_ends

    return measured_ends(rig, bar, target_set, observations_of(["live"], list(dots), {"live": dots}, target_set))


def lay_bar(stage: "Stage", rig: "Rig", pose: "PlannedPose", bar: "Bar") -> None:
    """Lay a bar of a simulated rig as the plan asks, as somebody would do by hand."""
    from scipy.spatial.transform import Rotation

    from spherecal_rigs.pose_plan import BarMarks

    reference = rig.camera(rig.reference_camera or "")
    assert reference is not None
    true = next(camera for camera in stage.truth.cameras if camera.id == rig.reference_camera)
    start, end = (
        true.rotation.T @ (reference.rotation @ place + reference.translation_mm - true.translation_mm)
        for place in (pose.start_mm, pose.end_mm)
    )
    names, own = BarMarks.of(bar.id, bar.lengths).names, stage.truth.bar(pose.bar)
    first, last = (own.x_mm[own.marks.index(name)] for name in (names[0], names[-1]))
    along = (end - start) / np.linalg.norm(end - start) * np.sign(last - first)
    back = -true.rotation.T @ (reference.rotation @ pose.facing)  # the marks are on the side of -z
    back = back - (back @ along) * along
    back /= np.linalg.norm(back)
    wanted = np.column_stack([along, np.cross(back, along), back])
    shown = next(one for one in stage.truth.bar_poses if one.bar == pose.bar)
    stage.show(shown.id)
    turn = Rotation.from_matrix(wanted @ shown.rotation.T).as_rotvec(degrees=True)
    shift = start - first * along - shown.place_mm
    stage.move(tuple(shift.tolist()), tuple(turn.tolist()))
