"""The Python interface: what `import spherecal` offers, each name loaded on first use (docs/api.md).

Nothing here computes by itself: each function is the one that the command of the same name uses.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from spherecal.base.context import Context, Progress
from spherecal.base.errors import Cancelled, InputError, MissingPackage, OutputError, SpherecalError
from spherecal.data.findings import Finding
from spherecal.data.observations import Observations
from spherecal.data.rig import Calibration, Quality, Rig, RigScale
from spherecal.data.rig_camera import RigCamera
from spherecal.data.session import Bar, BarLength, BarPose, CameraSpec, Certificate, Mark, Scale, Session
from spherecal.files.ball_file import BallProfile
from spherecal.files.bar_registry import RegisteredBar
from spherecal.files.write_result import write_result
from spherecal.geometry.user_frame import FrameDefinition, UserFrame
from spherecal.steps.repairs import Repairs
from spherecal.steps.settings import CalibrationSettings
from spherecal.targets.detection import Detections, DetectionSettings
from spherecal.targets.target_set import TargetSet
from spherecal.verify.limit import LengthLimit
from spherecal.verify.verification import Verification
from spherecal.verify.write_verification import write_verification
from spherecal_app.recordings.new_session import NewSession
from spherecal_app.use_cases import (
    AnyPath,
    apply_calibration,
    calibrate_points,
    calibrate_session,
    check_rig,
    compare_rigs,
    cross_validate_session,
    detect_targets,
    guide_next_placement,
    live_sets,
    load_ball,
    load_bars,
    load_body,
    load_profile,
    load_rig,
    load_session,
    load_targets,
    make_targets,
    measure,
    new_session,
    plan_bar_poses,
    recalibrate_cameras,
    rig_of,
    save_ball,
    save_bar,
    save_body,
    save_rig,
    save_targets,
    save_to_profile,
    simulate_session,
    verify_rig,
    write_board_sheet,
    write_report,
    write_target_sheet,
)
from spherecal_documents.export.cameras import FileCamera, FileRig, Pose, Unit
from spherecal_documents.export.format import Format
from spherecal_documents.export.import_rig import import_rig as _import_rig
from spherecal_documents.export.other_formats import ImportFormat
from spherecal_documents.export.write_export import DEFAULT_MAX_LOSS_PX, FORMATS, Exported
from spherecal_documents.export.write_export import export_rig as _export_rig
from spherecal_measuring.live import LiveSettings
from spherecal_measuring.points import MeasuredPoints, project_points, triangulate_points
from spherecal_measuring.results import BodyPose, MeasuredSet, MeasuredValue, ObservedSet, Series
from spherecal_measuring.task import Body, BodyPoint, PointName, Ruler, Task
from spherecal_rigs.check import Check
from spherecal_rigs.compare import Comparison
from spherecal_rigs.frame_file import read_frame, write_frame
from spherecal_rigs.framed_rig import define_frame as _define_frame
from spherecal_rigs.next_placement import Guidance
from spherecal_rigs.source import corners_beside
from spherecal_rigs.store import Profile
from spherecal_sim.truth import CameraMove, SimulationOptions, Truth

__all__ = [
    "FORMATS",
    "BallProfile",
    "Bar",
    "BarLength",
    "BarPose",
    "Body",
    "BodyPoint",
    "BodyPose",
    "Calibration",
    "CalibrationSettings",
    "CameraMove",
    "CameraSpec",
    "Cancelled",
    "Certificate",
    "Check",
    "Comparison",
    "Context",
    "DetectionSettings",
    "Detections",
    "Exported",
    "FileCamera",
    "FileRig",
    "Finding",
    "Format",
    "Guidance",
    "ImportFormat",
    "InputError",
    "LengthLimit",
    "LiveSettings",
    "Mark",
    "MeasuredPoints",
    "MeasuredSet",
    "MeasuredValue",
    "MissingPackage",
    "NewSession",
    "Observations",
    "ObservedSet",
    "OutputError",
    "PointName",
    "Pose",
    "Profile",
    "Progress",
    "Quality",
    "RegisteredBar",
    "Repairs",
    "Rig",
    "RigCamera",
    "RigScale",
    "Ruler",
    "Scale",
    "Series",
    "Session",
    "SimulationOptions",
    "SpherecalError",
    "TargetSet",
    "Task",
    "Truth",
    "UserFrame",
    "Verification",
    "apply_calibration",
    "calibrate_points",
    "calibrate_session",
    "check_rig",
    "compare_rigs",
    "cross_validate_session",
    "define_frame",
    "detect_targets",
    "export_rig",
    "guide_next_placement",
    "import_rig",
    "live_sets",
    "load_ball",
    "load_bars",
    "load_body",
    "load_frame",
    "load_profile",
    "load_rig",
    "load_session",
    "load_targets",
    "make_targets",
    "measure",
    "new_session",
    "plan_bar_poses",
    "project_points",
    "recalibrate_cameras",
    "save_ball",
    "save_bar",
    "save_body",
    "save_calibration",
    "save_frame",
    "save_rig",
    "save_targets",
    "save_to_profile",
    "save_verification",
    "simulate_session",
    "triangulate_points",
    "verify_rig",
    "write_board_sheet",
    "write_report",
    "write_target_sheet",
]


def save_calibration(calibration: Calibration, folder: AnyPath, details: Mapping[str, object] | None = None) -> None:
    """Write the result folder, whole or not at all.

    Parameters
    ----------
    calibration
        The calibration.
    folder
        The result folder.
    details
        Further items of the entry `software` of rig.json; None adds none.

    Raises
    ------
    OutputError
        Where the folder cannot be written.
    """
    write_result(calibration, Path(folder), details)


def save_verification(verification: Verification, folder: AnyPath, rig_file: AnyPath) -> None:
    """Write bars.csv and verification.json into the result folder of the rig that was verified.

    Parameters
    ----------
    verification
        The verification.
    folder
        The result folder. One of this very rig keeps its other files; another older result is replaced.
    rig_file
        The rig.json that was verified, which is copied to the folder.

    Raises
    ------
    OutputError
        Where the folder cannot be written.
    """
    write_verification(verification, Path(folder), Path(rig_file))


def define_frame(
    result: AnyPath,
    origin: str | None = None,
    x: str | None = None,
    xy: str | None = None,
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    turns: Sequence[str] = (),
) -> UserFrame:
    """The user's frame by three places of a result folder: the origin, one on the +X axis, one in the XY plane.

    A place is a placement's id (the ball's centre there), POSE/MARK of a bar that was verified, or
    PLACEMENT/TARGET/POINT of points.csv.

    Parameters
    ----------
    result
        The result folder.
    origin, x, xy
        Names of the three places; None for all: the reference camera's frame.
    offset_mm
        Where the origin's place is in the frame, before the turns.
    turns
        How the axes are then turned, one after the other: "x90", "x-90", "y90", "y-90", "z90", "z-90".

    Raises
    ------
    InputError
        For places that are not there, too near together, or nearly in a line.
    """
    return _define_frame(Path(result), FrameDefinition(origin, x, xy, offset_mm, tuple(turns)))


def load_frame(path: AnyPath) -> UserFrame:
    """The user's frame in a frame.json.

    Raises
    ------
    InputError
        Names what is wrong in the file.
    """
    return read_frame(Path(path))


def save_frame(frame: UserFrame, path: AnyPath) -> None:
    """Write frame.json, whole or not at all.

    Parameters
    ----------
    frame
        The user's frame.
    path
        The file.

    Raises
    ------
    OutputError
        Where the file cannot be written.
    """
    write_frame(frame, Path(path))


def export_rig(
    rig: Rig | AnyPath,
    format_name: str,
    output: AnyPath,
    unit: Unit | None = None,
    max_loss_px: float = DEFAULT_MAX_LOSS_PX,
    frame: UserFrame | None = None,
    volume_mm: tuple[Sequence[float], Sequence[float]] | None = None,
) -> Exported:
    """Write the rig in a format of others and read it back; the largest difference is in the answer.

    Parameters
    ----------
    rig
        The rig, or its file or result folder.
    format_name
        One of FORMATS, or "gltf", "ply" or "blender": scenes to look at.
    output
        Where to write.
    unit
        Unit of lengths; None takes the format's own.
    max_loss_px
        Largest change of a projection, px, by a lens that the format cannot hold.
    frame
        The user's frame in which all poses are given; None is the world of rig.json.
    volume_mm
        Lowest and highest corner of a box. A lens that the format cannot hold within `max_loss_px` is fitted only where
        its camera sees it. None takes the box of the points of a result folder.

    Raises
    ------
    InputError
        For a rig without cameras, an unknown format, a unit or a lens that the format does not have.
        Also for a frame of a rig with another reference camera.
    OutputError
        Where it cannot be written.
    """
    if volume_mm is not None:
        low, high = volume_mm
        box = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    else:
        box = None if isinstance(rig, Rig) else corners_beside(Path(rig))
    return _export_rig(rig_of(rig), format_name, Path(output), unit, max_loss_px, frame, box)


def import_rig(path: AnyPath, format_name: str, unit: Unit | None = None, ids: Sequence[str] | None = None) -> Rig:
    """The rig in a file of another program; of its accuracy nothing is known, so use it with care until it is verified.

    Parameters
    ----------
    path
        The file, or the folder of formats that have several files.
    format_name
        One of the formats that can be read.
    unit
        Unit of lengths in the file; None takes the format's own.
    ids
        New names of the cameras in the file's order; None keeps those in the file.

    Raises
    ------
    InputError
        Where the file cannot be used: a camera without a pose or an image size, another count of `ids`.
    """
    return _import_rig(Path(path), format_name, unit, ids)
