"""What each command does, as one function (docs/api.md): read, call the engine's entry point, give back the result."""

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherecal.base.context import Context
from spherecal.base.errors import InputError, OutputError, needing
from spherecal.base.messages.values import Phrase
from spherecal.calibrate import calibrate
from spherecal.cameras.protocol import CameraSource
from spherecal.data.rig import Calibration, Rig
from spherecal.data.rig_camera import ImageSize
from spherecal.data.session import Bar, BarPose, Scale, Session
from spherecal.detect.session_images import observed
from spherecal.files.atomic import write_file_whole
from spherecal.files.ball_file import BallProfile, ball_bytes, read_ball
from spherecal.files.bar_registry import RegisteredBar, changing_registry, read_registry, registry_path, write_registry
from spherecal.files.from_arrays import Lens
from spherecal.files.json_file import JsonValue
from spherecal.files.new_session import Contents, NewSession, StatedCameras, make_session
from spherecal.files.read_session import read_session
from spherecal.files.rig_file import COVARIANCE_FILE, covariance_bytes, read_rig, rig_bytes
from spherecal.files.target_set_file import read_target_set, write_target_set
from spherecal.geometry.camera import LensModel
from spherecal.guidance.next_placement import Guidance, advise
from spherecal.measuring.body_file import read_body, write_body
from spherecal.measuring.live import LiveSets, LiveSettings, rig_cameras_of
from spherecal.measuring.measurer import Measurer
from spherecal.measuring.results import MeasuredSet, ObservedSet, Series
from spherecal.measuring.run import run as measure_sets
from spherecal.measuring.series_file import TableKind
from spherecal.measuring.sets import sets_of_session
from spherecal.measuring.task import Body, Task
from spherecal.methods.board_pattern import board_entry, board_pattern
from spherecal.methods.settings import CalibrationSettings, Method
from spherecal.profile.compare import Comparison, compare
from spherecal.profile.save import SaveOptions, prepare
from spherecal.profile.source import Source, corners_beside, points_file, read_source, volume_of
from spherecal.profile.store import Profile, add_entry, create_profile, open_profile
from spherecal.profile.store import apply as put_to_use
from spherecal.targets import board_sheet
from spherecal.targets.detection import Detections, DetectionSettings, detect
from spherecal.targets.family import make_target_set
from spherecal.targets.images import as_grey, read_image
from spherecal.targets.sheet import Page, write_sheet
from spherecal.targets.target_set import TargetSet
from spherecal.uses.check import Check, check
from spherecal.uses.check_ball import read_known_ball
from spherecal.uses.cross_validate import LeftOut, cross_validate
from spherecal.uses.recalibrate import Selection, What, recalibrate
from spherecal.verify.bars import VerifySettings, verify
from spherecal.verify.limit import LengthLimit, parse_limit
from spherecal.verify.pose_plan import BarMarks, PosePlan, plan_poses
from spherecal.verify.verification import Verification
from spherecal_sim.session import simulate_session as simulate
from spherecal_sim.session_folder import write_session
from spherecal_sim.truth import SimulationOptions, Truth

AnyPath = str | os.PathLike[str]


class SessionParts(TypedDict, total=False):
    """What else `Session.from_arrays` takes."""

    fisheye: bool | Collection[str]
    scale: Scale | None
    bars: Sequence[Bar]
    bar_poses: Sequence[BarPose]
    target_set: TargetSet | None
    sphere_diameter_mm: float | None


# --- sessions, calibration, verification -----------------------------------------------------------------------------


def load_session(folder: AnyPath) -> Session:
    """The session in a folder; InputError names the file and the place in it that is not as it has to be."""
    return read_session(Path(folder))


def new_session(
    folder: AnyPath,
    images: AnyPath,
    *,
    pattern: str | None = None,
    board: Mapping[str, object] | str | None = None,
    targets: TargetSet | AnyPath | None = None,
    sphere_diameter_mm: float | None = None,
    focal_length_mm: float | None = None,
    pixel_pitch_um: float | None = None,
    lens_model: LensModel | None = None,
    frames: int = 30,
    context: Context | None = None,
) -> NewSession:
    """A session folder made from the images, or synchronised videos, in another folder, and how they were read.

    Camera and placement are taken from the paths, as cam1/0001.png, 0001/cam1.png or cam1_0001.png, or as `pattern`
    says: "{camera}_{placement}.png". Images are copied unless they lie in `folder`; of videos up to `frames` still and
    sharp ones are. `board`: the fields of session.json's `board`, as a mapping, as text
    ("chessboard,rows=6,columns=9,pitch_mm=20") or in a JSON file. Focal length and pixel pitch are EXIF's unless
    given, else a start value is assumed. InputError shows what was seen where names can be read in two ways.
    """
    for name, value in (
        ("focal_length_mm", focal_length_mm),
        ("pixel_pitch_um", pixel_pitch_um),
        ("sphere_diameter_mm", sphere_diameter_mm),
    ):
        if value is not None and not 0 < value < 1e6:
            raise InputError(Phrase("error-above-zero", {"name": name, "value": value}))
    if frames < 1:
        raise InputError(Phrase("error-frames-needed", {"frames": frames}))
    shown = targets if targets is None or isinstance(targets, TargetSet) else load_targets(targets)
    contents = Contents(None if board is None else board_entry(board), shown, sphere_diameter_mm)
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

    `settings`, where given, replace `method`, `intrinsics` and `seed`. Ask `rig.quality.valid` before you use it: a
    rig that could not be calibrated is a result too, whose findings say why. InputError for what cannot be used,
    Cancelled where the context says so.
    """
    chosen = settings or CalibrationSettings(method=method, intrinsics=intrinsics, seed=seed)
    return calibrate(_session(session), chosen, context)


def calibrate_points(
    observations: ArrayLike | Mapping[str, object],
    cameras: Mapping[str, Lens],
    image_size: ImageSize | None = None,
    *,
    settings: CalibrationSettings | None = None,
    context: Context | None = None,
    **session: Unpack[SessionParts],
) -> Calibration:
    """The rig that sees these image points: `Session.from_arrays` and `calibrate_session` in one.

    `session`: what else `Session.from_arrays` takes. Without a scale lengths are arbitrary.
    """
    return calibrate(Session.from_arrays(observations, cameras, image_size, **session), settings, context)


def verify_rig(
    session: Session | AnyPath,
    rig: Rig | AnyPath,
    context: Context | None = None,
    limit: LengthLimit | str | None = None,
) -> Verification:
    """The check bars of a session measured with a rig; InputError where the session has nothing to measure.

    `limit` of the length errors, such as "0.03+L/20000" in mm, is decided by ISO 14253-1.
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
    """Whether a rig still is as it was calibrated, by one look at the ball or a bar: `spherecal check`.

    `rig` as a path: a profile, result folder or rig.json; the ball is then compared with its points.csv. InputError
    where three cameras see too little at once.
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
    """The rig with some cameras calibrated again (`all` of them, `pose` or `intrinsics`), the others locked."""
    chosen = Selection((cameras,) if isinstance(cameras, str) else tuple(cameras), what)
    return recalibrate(_session(session), rig_of(rig), chosen, settings, context)


def cross_validate_session(
    session: Session | AnyPath, settings: CalibrationSettings | None = None, context: Context | None = None
) -> tuple[Calibration, tuple[LeftOut, ...]]:
    """The calibration, and every placement against the rig that the others give; InputError for fewer than three."""
    return cross_validate(_session(session), settings, context)


def guide_next_placement(session: Session | AnyPath, context: Context | None = None) -> Guidance:
    """Where to put the ball next, and what stopping now would give; InputError where nothing can be planned yet."""
    context = context or Context()
    seen = observed(_session(session), context)
    guidance = advise(seen, calibrate(seen, None, context), context)
    if guidance is None:
        raise InputError(Phrase("error-no-network"))
    return guidance


def compare_rigs(a: Rig | AnyPath, b: Rig | AnyPath) -> tuple[Comparison, Comparison]:
    """What has changed from rig a to rig b: after the best similarity, and metric, without a change of scale."""
    first = _source(a)
    return compare(first.rig, _source(b).rig, volume_of(first))


def plan_bar_poses(rig: Rig | AnyPath, bars: Sequence[RegisteredBar]) -> PosePlan:
    """Where to lay bars to verify a rig (VDI/VDE 2634-1, reduced): seven lines over its volume.

    `rig` as a path: a profile, result folder or rig.json, whose points then give the volume.
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
    """All sets of a session, or of live cameras (`live_sets`), measured with a rig: points, values, bodies, health.

    `rig` may be a profile. Without a `task` all targets of the session's target set, and its bars. With `output` the
    series is written there too, set by set, and whole at the end. InputError where nothing belongs to the rig,
    MissingPackage for Parquet tables without pyarrow.
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

    Cameras are the rig's by serial number, or by the name that they have or that `names` gives by serial. InputError
    where none is the rig's.
    """
    cameras = rig_cameras_of(_source(rig).rig, source.discover(context), names)
    chosen = targets if isinstance(targets, TargetSet) else load_targets(targets)
    return LiveSets(source, cameras, chosen, settings, context)


def load_body(path: AnyPath) -> Body:
    """The rigid body in a body.json; InputError names what is wrong in it."""
    return read_body(Path(path))


def save_body(body: Body, path: AnyPath) -> None:
    """Write body.json, whole or not at all; InputError for a body whose points do not define its pose."""
    write_body(body, Path(path))


# --- rigs, reports, profiles, bars, balls ----------------------------------------------------------------------------


def load_rig(path: AnyPath) -> Rig:
    """The rig in a rig.json, or in the result folder that holds one; with its covariance where that lies beside it."""
    path = Path(path)
    return read_rig(path / "rig.json" if path.is_dir() else path)


def save_rig(rig: Rig, path: AnyPath, details: Mapping[str, object] | None = None) -> None:
    """Write a rig.json (into a folder: under that name), and beside it the cameras' covariance, if the rig has it.

    `details` go into its entry `software`. OutputError where it cannot be written, or where the covariance of another
    rig is in the folder.
    """
    path = Path(path)
    path = path / "rig.json" if path.is_dir() else path
    if rig.covariance is not None:
        beside, content = path.parent / COVARIANCE_FILE, covariance_bytes(rig.covariance)
        if beside.exists() and beside.read_bytes() != content and not _has_covariance(path):
            raise OutputError(Phrase("error-other-rig", {"file": beside}))
        write_file_whole(beside, content)
    write_file_whole(path, rig_bytes(rig, details))


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

    MissingPackage without matplotlib (the extra `report`).
    """
    with needing("matplotlib", Phrase("documents")):
        from spherecal.report.write_report import write_report as write  # here, since it loads matplotlib

    write(Path(result), Path(output), _path(session), page, _path(issuer), language)


def load_profile(folder: AnyPath) -> Profile:
    """The profile in a folder: a rig's calibrations over time, which is in use, and whether it is still good."""
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
    """Add a result folder to a profile (made where it is missing) and put it to use if asked to; its id there."""
    known = SaveOptions(_path(session), None, temperature_c, note, calibrated_at)
    prepared = prepare(Path(result), known)  # before a folder is made for it
    saved = add_entry(create_profile(Path(profile)), *prepared)
    if apply:
        apply_calibration(profile, saved, note=note)
    return saved


def apply_calibration(profile: AnyPath, calibration: str, *, note: str = "", anyway: bool = False) -> Profile:
    """Put a calibration of a profile's history to use; `anyway`: although it is marked as not valid."""
    return put_to_use(open_profile(Path(profile)), calibration, note, anyway)


def load_bars(path: AnyPath | None = None) -> dict[str, RegisteredBar]:
    """Your reference bars by serial: of the user's registry, or of the file given."""
    return read_registry(_path(path))


def save_bar(bar: RegisteredBar, path: AnyPath | None = None) -> None:
    """Enter a bar into the registry, in place of one with its serial."""
    registry = _path(path) or registry_path()
    with changing_registry(registry):
        write_registry({**read_registry(registry), bar.serial: bar}, registry)


def load_ball(path: AnyPath) -> BallProfile:
    """The shape of a ball in a ball.json, or in the result folder that holds one."""
    return read_ball(Path(path))


def save_ball(ball: BallProfile, path: AnyPath) -> None:
    """Write ball.json, whole or not at all."""
    write_file_whole(Path(path), ball_bytes(ball))


# --- targets and simulation ------------------------------------------------------------------------------------------


def detect_targets(
    image: NDArray[np.generic] | AnyPath,
    targets: TargetSet | AnyPath | None = None,
    settings: DetectionSettings | None = None,
) -> Detections:
    """The coded targets in an image, dot by dot with standard uncertainties; an array (h, w) or (h, w, 3), or a file.

    `targets`: a target set or its targets.json; without one those that `spherecal targets sheet` prints unless asked
    otherwise. Pixels have 8 or 16 bits, colours are in any order. InputError for another image.
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
    """The targets with ids first_id, first_id + 1, ..., printed `size_mm` wide; InputError for ids there are not."""
    return make_target_set(count, size_mm, "dark-on-light" if dark_on_light else "light-on-dark", first_id)


def load_targets(path: AnyPath) -> TargetSet:
    """The target set in a targets.json; InputError names what is wrong in it."""
    return read_target_set(Path(path))


def save_targets(targets: TargetSet, path: AnyPath) -> None:
    """Write targets.json, whole or not at all."""
    write_target_set(Path(path), targets)


def write_target_sheet(targets: TargetSet, path: AnyPath, page: Page = "A4") -> None:
    """Write the stickers as a PDF to print."""
    write_sheet(Path(path), targets, page)


def write_board_sheet(board: Mapping[str, object] | str, path: AnyPath, page: str = "A4") -> str:
    """Write a calibration board at full size as a PDF to print; the board as `--board` takes it.

    `board` as in `new_session`, `page` A4, Letter, A3, A2, A1 or A0. InputError where it does not fit on the page.
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

    With a `folder` it is written there, with `images` as rendered images, which need a folder and take a while.
    InputError for an unknown preset.
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
    """A rig as it is, or out of its file."""
    return rig if isinstance(rig, Rig) else load_rig(rig)


def _session(session: Session | AnyPath) -> Session:
    return session if isinstance(session, Session) else load_session(session)


def _path(path: AnyPath | None) -> Path | None:
    return None if path is None else Path(path)


def _limit(limit: LengthLimit | str | None) -> LengthLimit | None:
    return parse_limit(limit) if isinstance(limit, str) else limit
