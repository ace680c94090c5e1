"""The Python interface (docs/api.md): each name of `import spherecal` once, loaded on first use.

Nothing here computes by itself: a function is what the command of the same name uses, too.
"""

from __future__ import annotations  # help() then shows ArrayLike by its name

import inspect
import os
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherecal.base.context import Context, Progress
from spherecal.base.errors import Cancelled, InputError, MissingPackage, OutputError, SpherecalError, needing
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import is_installed
from spherecal.calibrate import calibrate
from spherecal.data.findings import Finding
from spherecal.data.from_arrays import Lens, above_zero
from spherecal.data.observations import Observations
from spherecal.data.rig import BallProfile, Calibration, Quality, Rig, RigScale
from spherecal.data.rig_camera import ImageSize, RigCamera
from spherecal.data.session import Bar, BarLength, BarPose, CameraSpec, Certificate, Mark, Scale, Session
from spherecal.detect.session_images import observed
from spherecal.geometry.camera import LensModel
from spherecal.steps.repairs import Repairs
from spherecal.steps.settings import CalibrationSettings, Method
from spherecal.targets.detection import Detections, DetectionSettings, detect
from spherecal.targets.family import make_target_set
from spherecal.targets.images import as_grey, read_image
from spherecal.targets.target_set import TargetSet
from spherecal_app.argument_kinds import checked
from spherecal_app.kernel_state import is_marked, mark_compiled, state, wanted
from spherecal_app.recordings.new_session import Contents, NewSession, StatedCameras, make_session
from spherecal_boards.pattern_entry import board_entry, board_pattern, partial_board
from spherecal_cameras.protocol import CameraSource
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose, Unit
from spherecal_documents.export.format import Format, ImportFormat
from spherecal_documents.export.import_rig import import_rig as _import_rig
from spherecal_documents.export.write_export import DEFAULT_MAX_LOSS_PX, FORMATS, Exported
from spherecal_documents.export.write_export import export_rig as _export_rig
from spherecal_documents.sheets import board_sheet
from spherecal_documents.sheets.sticker_sheet import Page, write_sheet
from spherecal_files.atomic import write_file_whole
from spherecal_files.ball_file import BALL, read_ball
from spherecal_files.bar_registry import BAR_REGISTRY, RegisteredBar
from spherecal_files.filesystem import write_together
from spherecal_files.json_file import JsonValue
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import COVARIANCE_FILE, check_rig_bytes, covariance_bytes, read_rig, rig_bytes
from spherecal_files.target_set_file import read_target_set, write_target_set
from spherecal_files.write_result import write_result
from spherecal_files.write_verification import write_verification
from spherecal_measuring.live_sets import LiveSets, LiveSettings, rig_cameras_of
from spherecal_measuring.measured_sets import BodyPose, MeasuredSet, MeasuredValue, ObservedSet, Series
from spherecal_measuring.measurer import Measurer
from spherecal_measuring.measuring_task import Body, BodyPoint, PointName, Ruler, Task
from spherecal_measuring.points import MeasuredPoints, project_points, triangulate_points
from spherecal_measuring.pose import read_body, write_body
from spherecal_measuring.series_file import TableKind, sets_of_session
from spherecal_measuring.series_file import run as measure_sets
from spherecal_rigs.check_rig import Check, check, read_known_ball
from spherecal_rigs.compare_rigs import Comparison, compare
from spherecal_rigs.framed_rig import FRAME, write_frame
from spherecal_rigs.framed_rig import define_frame as _define_frame
from spherecal_rigs.next_placement import Guidance, advise
from spherecal_rigs.pose_plan import BarMarks, PosePlan, plan_poses
from spherecal_rigs.recalibrate import LeftOut, Selection, What, cross_validate, recalibrate
from spherecal_rigs.rig_source import Source, corners_beside, points_file, read_source, refuse_failed_rig, volume_of
from spherecal_rigs.save_entry import SaveOptions, prepare
from spherecal_rigs.store import Profile, add_entry, create_profile, open_profile
from spherecal_rigs.store import apply as put_to_use
from spherecal_rigs.user_frame import FrameDefinition, UserFrame
from spherecal_sim.simulate_session import simulate_session as simulate
from spherecal_sim.simulate_session import write_session
from spherecal_sim.truth import CameraMove, SimulationOptions, Truth
from spherecal_verify.limit import LengthLimit, parse_limit
from spherecal_verify.verification import Verification
from spherecal_verify.verify_bars import VerifySettings, verify

__all__ = [
    "FORMATS", "BallProfile", "Bar", "BarLength", "BarPose", "Body", "BodyPoint", "BodyPose", "Calibration",
    "CalibrationSettings", "CameraMove", "CameraSpec", "Cancelled", "Certificate", "Check", "Comparison", "Context",
    "DetectionSettings", "Detections", "Exported", "FileCamera", "FileRig", "Finding", "Format", "Guidance",
    "ImportFormat", "InputError", "LengthLimit", "LiveSettings", "Mark", "MeasuredPoints", "MeasuredSet",
    "MeasuredValue", "MissingPackage", "NewSession", "Observations", "ObservedSet", "OutputError", "PointName",
    "Pose", "Profile", "Progress", "Quality", "RegisteredBar", "Repairs", "Rig", "RigCamera", "RigScale", "Ruler",
    "Scale", "Series", "Session", "SimulationOptions", "SpherecalError", "TargetSet", "Task", "Truth", "UserFrame",
    "Verification", "apply_calibration", "calibrate_points", "calibrate_session", "check_rig", "compare_rigs",
    "cross_validate_session", "define_frame", "detect_targets", "export_rig", "guide_next_placement", "import_rig",
    "live_sets", "load_ball", "load_bars", "load_body", "load_frame", "load_profile", "load_rig", "load_session",
    "load_targets", "make_targets", "measure", "new_session", "plan_bar_poses", "project_points",
    "recalibrate_cameras", "save_ball", "save_bar", "save_body", "save_calibration", "save_frame", "save_rig",
    "save_targets", "save_to_profile", "save_verification", "simulate_session", "triangulate_points", "verify_rig",
    "write_board_sheet", "write_report", "write_target_sheet",
]  # fmt: skip

AnyPath = str | os.PathLike[str]


# --- sessions, calibration, verification -----------------------------------------------------------------------------


def load_session(folder: AnyPath) -> Session:
    """The session in a folder.

    Raises
    ------
    InputError
        Names the file and the place in it that is wrong.
    """
    return read_session(Path(folder))


def new_session(
    folder: AnyPath,
    images: AnyPath,
    *,
    pattern: str | None = None,
    board: Mapping[str, object] | str | None = None,
    targets: TargetSet | AnyPath | None = None,
    sphere_diameter_mm: float | None = None,
    spacing_mm: tuple[float, float] | None = None,
    focal_length_mm: float | None = None,
    pixel_pitch_um: float | None = None,
    lens_model: LensModel | None = None,
    frames: int = 30,
    context: Context | None = None,
) -> NewSession:
    """A session folder made from the images, or synchronised videos, in another folder, and how they were read.

    Camera and placement are taken from the paths, as cam1/0001.png, 0001/cam1.png or cam1_0001.png, or by `pattern`.
    Images are copied unless they are in `folder`; of videos still and sharp frames are.

    Parameters
    ----------
    folder
        The new session's folder.
    images
        The folder with the images or videos.
    pattern
        How the files are named, as "{camera}_{placement}.png"; None: it is recognised.
    board
        The fields of session.json's `board`, as a mapping, as text ("chessboard,rows=6,columns=9,pitch_mm=20"), in a
        JSON file or caliscope's charuco.toml; rows, columns, dictionary and legacy may be left out of a chessboard,
        ChArUco board or AprilGrid ("charuco,pitch_mm=20"): they are found in the images. None where the images show no
        board.
    targets
        The target set, or its targets.json; None where there is none.
    sphere_diameter_mm
        The ball's diameter; None where it is not known.
    spacing_mm
        What the targets' widest spacing measures on the print, and its expanded uncertainty (k = 2); None: as they
        should be printed, to 0.3 %.
    focal_length_mm, pixel_pitch_um
        Of all cameras; None: EXIF's, else a start value is assumed.
    lens_model
        The lens model of all cameras; None for `brown`.
    frames
        How many frames of each video are taken at most.
    context
        For progress, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        Shows what was seen where names can be read in two ways; also for images and numbers that cannot be used.
    OutputError
        Where the folder cannot be written, or has a session already.
    """
    for name, value in (
        ("focal_length_mm", focal_length_mm),
        ("pixel_pitch_um", pixel_pitch_um),
        ("sphere_diameter_mm", sphere_diameter_mm),
    ):
        if value is not None and not above_zero(name, value) < 1e6:
            raise InputError(Phrase("error-above-zero", {"name": name, "value": value}))
    if spacing_mm is not None and not (0 < spacing_mm[0] < 1e6 and 0 <= spacing_mm[1] < spacing_mm[0]):
        raise InputError(Phrase("error-above-zero", {"name": "spacing_mm", "value": spacing_mm[0]}))
    if frames < 1:
        raise InputError(Phrase("error-frames-needed", {"frames": frames}))
    shown = targets if targets is None or isinstance(targets, TargetSet) else load_targets(targets)
    partial = None if board is None else partial_board(board)
    entry = partial if partial is not None or board is None else board_entry(board)
    contents = Contents(entry, shown, sphere_diameter_mm, spacing_mm, seen_board=partial is not None)
    known = StatedCameras(focal_length_mm, pixel_pitch_um, lens_model)
    return make_session(Path(folder), Path(images), pattern, contents, known, frames, context or Context())


def calibrate_session(
    session: Session | AnyPath,
    method: Method = "auto",
    *,
    intrinsics: Literal["free", "fixed"] = "free",
    seed: int = 0,
    settings: CalibrationSettings | None = None,
    context: Context | None = None,
) -> Calibration:
    """The calibrated rig of a session or session folder, the same as `spherecal calibrate` writes.

    Ask `rig.quality.valid` before you use it: a rig that could not be calibrated is a result too, whose findings say
    why.

    Parameters
    ----------
    session
        The session, or its folder.
    method
        The form of the ball, or another method; "auto" chooses.
    intrinsics
        "free" to estimate them, "fixed" to keep the priors.
    seed
        Of the random numbers of robust estimation; the same seed gives the same result.
    settings
        All that can be said of how to calibrate, in place of `method`, `intrinsics` and `seed`.
    context
        For progress, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        For what cannot be used.
    """
    chosen = settings or CalibrationSettings(method=method, intrinsics=intrinsics, seed=seed)
    given = _session(session)
    _tell_of_compiling()
    return calibrate(given, chosen, context)


def calibrate_points(
    observations: ArrayLike | Mapping[str, object],
    cameras: Mapping[str, Lens] | Lens,
    image_size: ImageSize | None = None,
    *,
    fisheye: bool | Collection[str] = False,
    scale: Scale | None = None,
    bars: Sequence[Bar] = (),
    bar_poses: Sequence[BarPose] = (),
    target_set: TargetSet | None = None,
    sphere_diameter_mm: float | None = None,
    settings: CalibrationSettings | None = None,
    context: Context | None = None,
) -> Calibration:
    """The rig that sees these image points: `Session.from_arrays` and `calibrate_session` in one.

    Without a scale lengths are arbitrary, in fields named `_mm` too; the finding `no-scale` says so.

    Parameters
    ----------
    observations
        {camera: {frame: (ids, uv)}}, with uv (n, 2) px; or a table (a dict of columns, or a data frame) with `camera`,
        `target`, `u`, `v`, and optionally `placement` and `point`; or arrays by camera, (n, 2) or (frames, n, 2) px,
        whose row i is the same point in all cameras, NaN where it is not seen.
    cameras
        Start values by camera: K, (K, dist) in OpenCV's terms, or a CameraSpec; one K or (K, dist) serves all cameras
        of a table or of arrays by camera.
    image_size
        (width, height) px, one for all or one for each by camera; None where all cameras are a CameraSpec.
    fisheye
        Whether all cameras, or which, have lenses of cv2.fisheye.
    scale
        Where millimetres come from; None: lengths are arbitrary.
    bars, bar_poses
        Reference bars and their poses; image points of a pose are those of the placement of its id.
    target_set
        The targets' layouts; None where they have none.
    sphere_diameter_mm
        The ball's diameter; None where it is not known.
    settings
        How to calibrate; None for the usual way.
    context
        For progress, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        For what cannot be used.
    """
    session = Session.from_arrays(
        observations, cameras, image_size, fisheye=fisheye, scale=scale, bars=bars, bar_poses=bar_poses,
        target_set=target_set, sphere_diameter_mm=sphere_diameter_mm,
    )  # fmt: skip
    _tell_of_compiling()
    return calibrate(session, settings, context)


def _tell_of_compiling() -> None:
    """Warn once that the first calibration of a wheel without kernels compiles: it is silent here, and on one core."""
    if not is_installed() or state() != "to compile":
        return
    if any(is_marked(f"{what}{wanted()}") for what in ("told", "calibration", "demo")):
        return
    mark_compiled(f"told{wanted()}")
    said = "The first calibration compiles its kernels, for minutes. `spherecal compile-kernels` does it on all cores."
    warnings.warn(said, stacklevel=4)  # 1 here, 2 what calibrates, 3 what checks its arguments, 4 the caller


def verify_rig(
    session: Session | AnyPath,
    rig: Rig | AnyPath,
    context: Context | None = None,
    limit: LengthLimit | str | None = None,
) -> Verification:
    """The check bars of a session measured with a rig.

    Parameters
    ----------
    session
        The session, or its folder.
    rig
        The rig, a rig.json or a result folder; of a path the points beside it give the volume where the rig has no map.
    context
        For progress, and to stop: Cancelled is then raised.
    limit
        The limit of the length errors, such as "0.03+L/20000" in mm, decided by ISO 14253-1; None to decide nothing by
        it.

    Raises
    ------
    InputError
        Where the session has nothing to measure, and for a limit that cannot be read.
    """
    context = context or Context()
    settings = VerifySettings(_limit(limit), None, None if isinstance(rig, Rig) else corners_beside(Path(rig)))
    seen = observed(_session(session), context, bar_poses_only=True)
    return verify(seen, rig_of(rig), context, settings)


def check_rig(
    session: Session | AnyPath,
    rig: Rig | AnyPath,
    *,
    limit: LengthLimit | str | None = None,
    context: Context | None = None,
) -> Check:
    """Whether a rig is still as it was calibrated, from one placement of the ball or pose of a bar: `spherecal check`.

    Parameters
    ----------
    session
        The session, or its folder.
    rig
        The rig, or the path of a profile, result folder or rig.json; the ball is then compared with its points.csv.
    limit
        The limit of the bars' errors, such as "0.03+L/20000" in mm; None: 3.5 standard uncertainties.
    context
        For progress, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        Where three cameras see too little at once.
    """
    known = None if isinstance(rig, Rig) else read_known_ball(points_file(Path(rig)))
    return check(_session(session), _source(rig).rig, known, _limit(limit), context)


def recalibrate_cameras(
    session: Session | AnyPath,
    rig: Rig | AnyPath,
    cameras: Sequence[str],
    what: What = "all",
    *,
    settings: CalibrationSettings | None = None,
    context: Context | None = None,
) -> Calibration:
    """The rig with some cameras calibrated again, the others locked.

    Parameters
    ----------
    session
        The session, or its folder.
    rig
        The rig, a rig.json or a result folder.
    cameras
        Ids of the cameras to calibrate, or one id.
    what
        What of them: "all", "pose" or "intrinsics".
    settings
        How to calibrate; None for the usual way.
    context
        For progress, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        For unknown cameras, and where fewer than two stay locked.
    """
    chosen = Selection((cameras,) if isinstance(cameras, str) else tuple(cameras), what)
    return recalibrate(_session(session), rig_of(rig), chosen, settings, context)


def cross_validate_session(
    session: Session | AnyPath, settings: CalibrationSettings | None = None, context: Context | None = None
) -> tuple[Calibration, tuple[LeftOut, ...]]:
    """The calibration, and every placement compared with the rig that the others give.

    Parameters
    ----------
    session
        The session, or its folder.
    settings
        How to calibrate; None for the usual way.
    context
        For progress, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        For fewer than three placements.
    """
    return cross_validate(_session(session), settings, context)


def guide_next_placement(session: Session | AnyPath, context: Context | None = None) -> Guidance:
    """Where to put the ball next, and how good the result would be without that.

    Parameters
    ----------
    session
        The session recorded so far, or its folder.
    context
        For progress, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        Where nothing can be planned yet.
    """
    context = context or Context()
    seen = observed(_session(session), context)
    guidance = advise(seen, calibrate(seen, None, context), context)
    if guidance is None:
        raise InputError(Phrase("error-no-network"))
    return guidance


def compare_rigs(a: Rig | AnyPath, b: Rig | AnyPath) -> tuple[Comparison, Comparison]:
    """What has changed from rig a to rig b: after the best similarity, and metric, without a change of scale.

    Parameters
    ----------
    a, b
        The earlier and the later rig, or paths: a profile, a calibration of its history, a result folder or a rig.json.

    Raises
    ------
    InputError
        Where the two cannot be compared.
    """
    first = _source(a)
    return compare(first.rig, _source(b).rig, volume_of(first))


def plan_bar_poses(rig: Rig | AnyPath, bars: Sequence[RegisteredBar]) -> PosePlan:
    """Where to lay bars to verify a rig (VDI/VDE 2634-1, reduced): seven lines over its volume.

    Parameters
    ----------
    rig
        The rig, or the path of a profile, result folder or rig.json, whose points then give the volume where it has no
        map. Without either it is where most cameras look.
    bars
        Bars of the registry, one at least.

    Raises
    ------
    InputError
        Where there is no rig at the path, or a rig of fewer than two cameras and no points.
    """
    source = _source(rig)
    box = volume_of(source)
    return plan_poses(source.rig, [BarMarks.of(bar.serial, bar.lengths) for bar in bars], (box.low_mm, box.high_mm))


def measure(
    recording: Session | AnyPath | Iterable[ObservedSet],
    rig: Rig | AnyPath,
    task: Task | None = None,
    *,
    output: AnyPath | None = None,
    table: TableKind = "csv",
    context: Context | None = None,
) -> Series:
    """All sets of a session, or of live cameras, measured with a rig: points, values, bodies, health.

    Parameters
    ----------
    recording
        A session or its folder, or sets as `live_sets` gives them.
    rig
        The rig, or the path of a profile, result folder or rig.json.
    task
        What to measure. None: of a session all targets of its target set, and its bars; of other sets every point.
    output
        The series folder to write too, set by set, and whole at the end; None for none.
    table
        The form of its tables.
    context
        For progress, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        Where nothing belongs to the rig.
    OutputError
        Where the series cannot be written.
    CameraError
        Where live cameras stay silent.
    MissingPackage
        For Parquet tables without pyarrow.
    """
    measured_with = _source(rig).rig
    if isinstance(recording, str | os.PathLike | Session):
        session = _session(recording)
        task = task or Task(session.target_set, bars=session.bars)
        sets = sets_of_session(session, measured_with, context)
    else:
        sets = iter(recording)
    measurer, found = Measurer(measured_with, task), list[MeasuredSet]()
    measure_sets(sets, measurer, found.append, _path(output), table, context)
    return Series(tuple(found), measurer.health)


def live_sets(
    source: CameraSource,
    rig: Rig | AnyPath,
    targets: TargetSet | AnyPath,
    settings: LiveSettings | None = None,
    *,
    names: Mapping[str, str] | None = None,
    context: Context | None = None,
) -> LiveSets:
    """The sets of the live cameras of an open source, for `measure`; targets are looked for around their last places.

    Parameters
    ----------
    source
        The open source.
    rig
        The rig, or the path of a profile, result folder or rig.json. Cameras are the rig's by serial number, or by
        name.
    targets
        The target set, or its targets.json.
    settings
        How many sets, and how fast; None for the usual.
    names
        Names by serial, which go before those that the cameras have.
    context
        For progress, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        Where none of the cameras is the rig's.
    """
    cameras = rig_cameras_of(_source(rig).rig, source.discover(context), names)
    chosen = targets if isinstance(targets, TargetSet) else load_targets(targets)
    return LiveSets(source, cameras, chosen, settings, context)


def load_body(path: AnyPath) -> Body:
    """The rigid body in a body.json.

    Raises
    ------
    InputError
        Names what is wrong in it.
    """
    return read_body(Path(path))


def save_body(body: Body, path: AnyPath) -> None:
    """Write body.json, whole or not at all.

    Parameters
    ----------
    body
        The body.
    path
        The file; one that is there is replaced.

    Raises
    ------
    InputError
        For a body whose points do not define its pose.
    OutputError
        Where the file cannot be written.
    """
    write_body(body, Path(path))


# --- rigs, reports, profiles, bars, balls ----------------------------------------------------------------------------


def load_rig(path: AnyPath) -> Rig:
    """The rig in a rig.json, or in a result folder; with its covariance if that is beside it.

    Raises
    ------
    InputError
        Where the file is not as docs/formats.md says.
    """
    path = Path(path)
    return read_rig(path / "rig.json" if path.is_dir() else path)


def save_rig(rig: Rig, path: AnyPath, details: Mapping[str, object] | None = None) -> None:
    """Write a rig.json (into a folder: under that name), and beside it the cameras' covariance, if the rig has it.

    Parameters
    ----------
    rig
        The rig.
    path
        The file, or a folder that is there.
    details
        What else its entry `software` is to say; None for name and version alone.

    Raises
    ------
    InputError
        For a rig that could not be read again, such as one with a rotation that is none.
    OutputError
        Where it cannot be written, or where the covariance of another rig is in the folder.
    """
    path = Path(path)
    path = path / "rig.json" if path.is_dir() else path
    content = rig_bytes(rig, details)
    check_rig_bytes(content, path)
    if rig.covariance is None:
        write_file_whole(path, content)
        return
    beside, covariance = path.parent / COVARIANCE_FILE, covariance_bytes(rig.covariance)
    if beside.exists() and beside.read_bytes() != covariance and not _has_covariance(path):
        raise OutputError(Phrase("error-other-rig", {"file": beside}))
    write_together(path.parent, {beside.name: covariance, path.name: content})


def _has_covariance(path: Path) -> bool:
    """Whether a rig.json names the covariance beside it as its own."""
    try:
        return path.exists() and read_rig(path).covariance is not None
    except InputError:
        return False


def write_report(
    result: AnyPath,
    output: AnyPath,
    *,
    session: AnyPath | None = None,
    page: Literal["A4", "Letter"] = "A4",
    issuer: AnyPath | None = None,
    language: str = "en",
) -> None:
    """Write the report of a result folder: PDF, HTML, JSON or a calibration certificate (.xml), by the ending.

    Parameters
    ----------
    result
        The result folder.
    output
        The file; its ending chooses the form.
    session
        The session's folder, for pictures of detections; None: one beside the result, if it is its own.
    page
        The PDF's page, A4 or Letter.
    issuer
        The issuer.json with a certificate's statements, which a certificate needs (docs/verification.md, Reports).
    language
        en, de or zh_CN; a certificate is always in English.

    Raises
    ------
    MissingPackage
        Without matplotlib or, for a PDF, typst (the extra `report`).
    InputError
        For another ending, and for a folder or file that cannot be used.
    OutputError
        Where the report cannot be written.
    """
    with needing("matplotlib", Phrase("documents")), needing("typst", Phrase("documents")):
        from spherecal_documents.report.write_report import write_report as write  # here, since it loads matplotlib

        write(Path(result), Path(output), _path(session), page, _path(issuer), language)


def load_profile(folder: AnyPath) -> Profile:
    """The profile in a folder: a rig's calibrations over time, which is in use, and whether it is still good.

    Raises
    ------
    InputError
        Where the folder is no profile.
    """
    return open_profile(Path(folder))


def save_to_profile(
    result: AnyPath,
    profile: AnyPath,
    *,
    note: str = "",
    session: AnyPath | None = None,
    temperature_c: float | None = None,
    calibrated_at: datetime | None = None,
    apply: bool = False,
) -> str:
    """Add a result folder to a profile (made where it is missing) and put it to use if asked to; its id there.

    Parameters
    ----------
    result
        The result folder.
    profile
        The profile's folder.
    note
        What is to be remembered of the calibration.
    session
        The session's folder; None where it is not known.
    temperature_c
        The rig's temperature in deg C; None: the mean of the bar poses', if the session has them.
    calibrated_at
        When it was calibrated; None: when the last images were taken, else when rig.json was written.
    apply
        Put it to use, with the same note.

    Raises
    ------
    InputError
        Where result and session cannot be used or do not belong together. With `apply`, as `apply_calibration`.
    OutputError
        Where the profile cannot be written.
    """
    known = SaveOptions(_path(session), None, temperature_c, note, calibrated_at)
    prepared = prepare(Path(result), known)  # before a folder is made for it
    saved = add_entry(create_profile(Path(profile)), *prepared)
    if apply:
        apply_calibration(profile, saved, note=note)
    return saved


def apply_calibration(profile: AnyPath, calibration: str, *, note: str = "", anyway: bool = False) -> Profile:
    """Put a calibration of a profile's history to use.

    Parameters
    ----------
    profile
        The profile's folder.
    calibration
        Its id there, as "0001".
    note
        Why; a calibration that is to be used with care needs one.
    anyway
        Although it is marked as not valid.

    Raises
    ------
    InputError
        Where there is none of this id, its file was changed, it is not valid, or a note is missing.
    OutputError
        Where the profile cannot be written.
    """
    return put_to_use(open_profile(Path(profile)), calibration, note, anyway)


def load_bars(path: AnyPath | None = None) -> dict[str, RegisteredBar]:
    """Your reference bars by serial: of the user's registry, or of the file given.

    Raises
    ------
    InputError
        Where the file is broken.
    """
    return BAR_REGISTRY.read(_path(path))


def save_bar(bar: RegisteredBar, path: AnyPath | None = None) -> None:
    """Enter a bar into the registry, in place of one with the same serial number.

    Parameters
    ----------
    bar
        The bar.
    path
        The registry's file; None for the user's own.

    Raises
    ------
    InputError
        Where the file is broken.
    OutputError
        Where it cannot be written.
    """
    registry = _path(path) or BAR_REGISTRY.path()
    with BAR_REGISTRY.changing(registry):
        BAR_REGISTRY.write({**BAR_REGISTRY.read(registry), bar.serial: bar}, registry)


def load_ball(path: AnyPath) -> BallProfile:
    """The shape of a ball in a ball.json, or in a result folder.

    Raises
    ------
    InputError
        Where it is no ball.json.
    """
    return read_ball(Path(path))


def save_ball(ball: BallProfile, path: AnyPath) -> None:
    """Write ball.json, whole or not at all.

    Parameters
    ----------
    ball
        The ball's shape.
    path
        The file; one that is there is replaced.

    Raises
    ------
    OutputError
        Where the file cannot be written.
    """
    write_file_whole(Path(path), BALL.bytes(ball))


# --- targets and simulation ------------------------------------------------------------------------------------------


def detect_targets(
    image: NDArray[np.generic] | AnyPath,
    targets: TargetSet | AnyPath | None = None,
    settings: DetectionSettings | None = None,
) -> Detections:
    """The coded targets in an image, dot by dot with standard uncertainties in px.

    Parameters
    ----------
    image
        An array (h, w) or (h, w, 3), or an image file. Pixels have 8 or 16 bits, colours are in any order.
    targets
        A target set or its targets.json; None: those that `spherecal targets sheet` prints unless asked otherwise.
    settings
        What is known of the camera; None for usual values.

    Raises
    ------
    InputError
        For another image.
    """
    if targets is None or isinstance(targets, TargetSet):
        chosen = targets or make_target_set()
    else:
        chosen = load_targets(targets)
    grey = read_image(Path(image)) if isinstance(image, str | os.PathLike) else as_grey(np.asarray(image))
    return detect(grey, chosen, settings)


def make_targets(
    count: int = 200, size_mm: float = 28.0, first_id: int = 1, *, dark_on_light: bool = False
) -> TargetSet:
    """The targets with ids first_id, first_id + 1, ..., printed `size_mm` wide.

    Parameters
    ----------
    count
        How many.
    size_mm
        The width of a target as printed.
    first_id
        The first id, from 1 on.
    dark_on_light
        Dark dots on light paper; otherwise light dots on dark.

    Raises
    ------
    InputError
        For ids there are not, and for a width that is not above 0.
    """
    return make_target_set(count, size_mm, "dark-on-light" if dark_on_light else "light-on-dark", first_id)


def load_targets(path: AnyPath) -> TargetSet:
    """The target set in a targets.json.

    Raises
    ------
    InputError
        Names what is wrong in it.
    """
    return read_target_set(Path(path))


def save_targets(targets: TargetSet, path: AnyPath) -> None:
    """Write targets.json, whole or not at all.

    Parameters
    ----------
    targets
        The target set.
    path
        The file; one that is there is replaced.

    Raises
    ------
    OutputError
        Where the file cannot be written.
    """
    write_target_set(Path(path), targets)


def write_target_sheet(targets: TargetSet, path: AnyPath, page: Page = "A4") -> None:
    """Write the stickers as a PDF to print.

    Parameters
    ----------
    targets
        The target set; all its targets are printed.
    path
        The PDF file.
    page
        A4 or Letter.

    Raises
    ------
    InputError
        For another page, and where not even one sticker fits on it.
    OutputError
        Where the file cannot be written.
    """
    write_sheet(Path(path), targets, page)


def write_board_sheet(board: Mapping[str, object] | str, path: AnyPath, page: str = "A4") -> str:
    """Write a calibration board at full size as a PDF to print; the board in one line, as `--board` takes it.

    Parameters
    ----------
    board
        The board, as in `new_session`.
    path
        The PDF file.
    page
        A4, Letter, A3, A2, A1 or A0.

    Raises
    ------
    InputError
        For a board or page that cannot be used, and where the board does not fit on the page.
    OutputError
        Where the file cannot be written.
    """
    pattern = board_pattern(JsonValue(board_entry(board), Path("board")))
    board_sheet.write_board_sheet(Path(path), pattern, page)
    return board_sheet.words(pattern)


def simulate_session(
    preset: str,
    seed: int = 1,
    options: SimulationOptions | None = None,
    *,
    folder: AnyPath | None = None,
    images: bool = False,
    context: Context | None = None,
) -> tuple[Session, Truth]:
    """A session of a simulated rig and the truth behind it; the same seed gives the same.

    Parameters
    ----------
    preset
        The rig's name.
    seed
        Of all random numbers.
    options
        What to simulate; None for the standard session, with `images` for that which images can show.
    folder
        The folder to write the session into; None to keep it in memory.
    images
        Render images, which need a folder and take a while; otherwise observations alone.
    context
        For progress while images are rendered, and to stop: Cancelled is then raised.

    Raises
    ------
    InputError
        For an unknown preset, images without a folder, and options that images cannot show.
    OutputError
        Where the folder cannot be written.
    """
    if images:
        from spherecal_sim.render_session import render_session  # here, since it loads the renderer

        if folder is None:
            raise InputError(Phrase("error-images-need-folder"))
        truth = render_session(preset, seed, Path(folder), context, options)
        return read_session(Path(folder)), truth
    session, truth = simulate(preset, seed, options)
    if folder is None:
        return session, truth
    write_session(session, truth, Path(folder))
    return read_session(Path(folder)), truth


def _source(rig: Rig | AnyPath) -> Source:
    """A rig with the box of its points, where that is known."""
    return Source(rig, None) if isinstance(rig, Rig) else read_source(Path(rig))


def rig_of(rig: Rig | AnyPath) -> Rig:
    """A rig as it is, or from its file."""
    return rig if isinstance(rig, Rig) else load_rig(rig)


def _session(session: Session | AnyPath) -> Session:
    return session if isinstance(session, Session) else load_session(session)


def _path(path: AnyPath | None) -> Path | None:
    return None if path is None else Path(path)


def _limit(limit: LengthLimit | str | None) -> LengthLimit | None:
    return parse_limit(limit) if isinstance(limit, str) else limit


# --- results, frames and files of other programs ----------------------------------------------------------------------


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
    return FRAME.read(Path(path))


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
        Also for a frame of a rig with another reference camera, and for a file or folder whose verification failed.
    OutputError
        Where it cannot be written.
    """
    if volume_mm is not None:
        low, high = volume_mm
        box = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    else:
        box = None if isinstance(rig, Rig) else corners_beside(Path(rig))
    override = None if isinstance(rig, Rig) else refuse_failed_rig(Path(rig))
    return _export_rig(rig_of(rig), format_name, Path(output), unit, max_loss_px, frame, box, override)


def import_rig(path: AnyPath, format_name: str, unit: Unit | None = None, ids: Sequence[str] | None = None) -> Rig:
    """The rig in a file of another program; of its accuracy nothing is known, so use it with care until it is verified.

    Parameters
    ----------
    path
        The file, or the folder of formats that have several files.
    format_name
        One of the formats that can be read.
    unit
        Unit of lengths in the file; None takes what the file shows, else the format's own.
    ids
        New names of the cameras in the file's order; None keeps those in the file.

    Raises
    ------
    InputError
        Where the file cannot be used: a camera without a pose or an image size, another count of `ids`.
    """
    return _import_rig(Path(path), format_name, unit, ids).rig


for _name in __all__:
    if inspect.isfunction(_function := globals()[_name]) and _function.__module__ == __name__:
        globals()[_name] = checked(_function)
