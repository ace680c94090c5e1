"""The work behind the buttons: plain functions that block, for `task.Task`; each ends at the engine's own entry."""

import re
import tempfile
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError, SpherecalError
from spherecal.base.messages.values import Phrase
from spherecal_files.atomic import RESULT, check_folder, write_file_whole
from spherecal_files.json_file import JsonValue, json_bytes, read_json
from spherecal_gui import limits_in_force as limits
from spherecal_gui.coverage import Dots
from spherecal_gui.in_use import keep_verification
from spherecal_gui.languages import translate
from spherecal_gui.project import Artefacts, Project, Verdict
from spherecal_gui.project_folder import Document, check_folders

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from spherecal.data.session import Bar, Session
    from spherecal.targets.detection import Detector
    from spherecal_boards.board_images import BoardDetector
    from spherecal_cameras.averaging import Stillness
    from spherecal_cameras.camera_network import InterfaceFact, WireCamera
    from spherecal_cameras.genicam.trust import Ask
    from spherecal_cameras.plan import CapturePlan
    from spherecal_cameras.protocol import CameraSource, Discovery, FrameSet, SetupReport
    from spherecal_files.verification_file import BarReport
    from spherecal_gui.tasks.live_detection import Connection
    from spherecal_rigs.check_rig import Check
    from spherecal_rigs.user_frame import UserFrame

# Imported inside functions: cameras, detection and calibration take a second, with scipy, OpenCV and the kernels. The
# window is shown before.

REPAIRS = ("leave-out", "split", "swap")  # in the order of Repairs
SMALLER = 4  # six placements of twenty cameras of 5 MP take 38 MB; a lamp of 4 px is still half as bright
_LIVE_AVERAGE = 4  # images of a set from real cameras: half the noise, and a test that nothing moved


def connect(project: Project, context: Context, ask: "Ask | None" = None) -> "Connection":
    """Open the project's source and all its cameras. `ask` None: nobody can be asked."""
    from spherecal_cameras.builtin_driver import NoCameras, answering, driver_troubles, on_wire
    from spherecal_cameras.camera_settings import default_profile_path, read_profile
    from spherecal_cameras.sources import open_source

    context.report("opening the source", 0.0, project.source)
    live = project.source.startswith("genicam")
    profile = read_profile(default_profile_path())
    name, *faults = project.source.split("+")
    source = open_source(name, profile.producers if live else (), faults, ask)
    try:
        context.report("looking for cameras", 0.2)
        discovery = source.discover(context)
        wire = answering() if live else ()
        if not discovery.cameras:
            hint = translate("Errors", "Plug the cameras in and switch them on; no other program may hold them.")
            error = NoCameras(translate("Errors", "No camera was found."), hint)
            error.troubles, error.wire = driver_troubles(discovery, wire) if live else (), wire
            raise error
        serials = profile.rig_of(discovery.serials) if live else discovery.serials
        # trying to open what no packet reaches would keep the others waiting, again and again
        elsewhere = {info.serial for info in discovery.cameras if (at := on_wire(info, wire)) and not at.subnet_ok}
        serials = [serial for serial in serials if serial not in elsewhere]
        context.report("opening the cameras", 0.5, str(len(serials)))
        reports = source.open(serials, profile.settings() if live else {}) if serials else ()
        connection = joined(project, source, discovery, reports, _plan(source, project), wire)
        context.report("opening the cameras", 1.0)
        return connection
    except BaseException:
        source.close()
        raise


def network_facts(connection: "Connection", rate_hz: float) -> "tuple[InterfaceFact, ...]":
    """What of this computer's network matters to the cameras on it, at this many images a second."""
    from spherecal_cameras.camera_network import interface_facts
    from spherecal_cameras.network_lines import loads_of

    loads = loads_of(connection.source, connection.discovery, rate_hz, "GEV GigEVision")
    return interface_facts(connection.wire, loads)


def joined(
    project: Project,
    source: "CameraSource",
    discovery: "Discovery",
    reports: "tuple[SetupReport, ...]",
    plan: "CapturePlan",
    wire: "tuple[WireCamera, ...]",
) -> "Connection":
    """The connection to cameras that are open, each with what is known of it now; it opens nothing."""
    from spherecal_cameras.camera_settings import CameraProfile, default_profile_path, read_profile
    from spherecal_cameras.new_recording import session_cameras
    from spherecal_gui.tasks.live_detection import Connection

    live = project.source.startswith("genicam")
    profile = read_profile(default_profile_path()) if live else CameraProfile()
    kept = _recorded_cameras(project.folder) if live and project.taken else {}
    rig = session_cameras(source, plan, discovery, reports, profile, kept)
    ordered = sorted(rig.cameras, key=lambda one: as_people_count(one.id))
    names = {camera.serial: camera.id for camera in ordered}
    return Connection(source, discovery, reports, rig.cameras, plan, names, profile, rig, wire)


def _recorded_cameras(folder: Path) -> dict[str, Document]:
    """The cameras of a recorded session by serial, as its session.json has them."""
    document = read_json(folder / "session.json", "spherecal/session", 1).value
    entries = document.get("cameras", ()) if isinstance(document, dict) else ()
    return {entry["serial"]: entry for entry in entries if "serial" in entry}


def taken_in_again(project: Project, connection: "Connection", serials: Sequence[str]) -> "Connection":
    """The connection with cameras that could not be used and now answer, set up like the others."""
    from spherecal_cameras.protocol import CameraSettings

    wanted = connection.profile.settings()
    settings = {serial: wanted.get(serial, CameraSettings()) for serial in serials}
    new = connection.source.apply(settings)
    own, c = {report.serial: report for report in (*connection.reports, *new)}, connection
    return joined(project, c.source, c.discovery, tuple(own.values()), c.plan, c.wire)


def as_people_count(name: str) -> list[tuple[int, str]]:
    """Sorts C2 before C10: the wall has the order in which people number their cameras."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _plan(source: "CameraSource", project: Project) -> "CapturePlan":
    """Targets, ball, scale and bars: of the bench file that was named, else of the recording or the simulated rig."""
    from spherecal_boards.pattern_entry import recorded_board
    from spherecal_cameras.plan import CapturePlan, check_marks, plan_of, read_plan
    from spherecal_cameras.protocol import session_behind
    from spherecal_rigs.ball_registry import whole_bar

    if project.bench:
        plan = read_plan(Path(project.bench))
        check_marks(plan, Path(project.bench))
        # a project keeps the figures that it was recorded with, whatever the bars' next certificates say
        fields = {**plan.fields, "bars": [whole_bar(bar) for bar in plan.bars]} if plan.bars else plan.fields
        return replace(plan, fields=fields)
    recorded = session_behind(source)
    if recorded is None:
        return CapturePlan((), None, {})
    plan, board = plan_of(recorded), recorded_board(recorded)
    return plan if board is None else replace(plan, fields={**plan.fields, "board": board})


def board_of(plan: "CapturePlan") -> Document | None:
    """The board that calibrates, as session.json has it; None where a ball does."""
    board = plan.fields.get("board")
    return board if plan.target_set is None and isinstance(board, dict) and "kind" in board else None


def detector_of(plan: "CapturePlan") -> "Detector | BoardDetector | None":
    """What finds in images what calibrates: coded targets, or the points of a board; None where neither is known."""
    from spherecal.targets.detection import Detector
    from spherecal_boards.board_images import BoardDetector
    from spherecal_boards.pattern_entry import board_pattern

    if plan.target_set is not None:
        return Detector(plan.target_set)
    board = board_of(plan)
    return BoardDetector(board_pattern(JsonValue(board, Path("board")))) if board is not None else None


def artefacts_of(plan: "CapturePlan") -> Artefacts | None:
    """The bench, in words of no language, as they are kept and compared; None where not even targets are known."""
    board = board_of(plan)
    if board is not None:
        own = {key: board[key] for key in ("rows", "columns", "pitch_mm", "marker_mm", "dictionary") if key in board}
        words = ", ".join(f"{key} {value}" for key, value in own.items())
        return Artefacts(f"{board['kind']}: {words}", "", f"{board['pitch_mm']:g} mm", board=True)
    if plan.target_set is None:
        return None
    targets = plan.target_set
    ids = sorted(targets.layouts)
    sphere = plan.fields.get("sphere", {}).get("nominal_diameter_mm")
    scale = plan.fields.get("scale") or {}
    scale_bar = str(scale["bar"]) if scale.get("kind") == "bar" else None
    if scale_bar is not None:
        words = f"{scale_bar}: {_lengths(next(bar for bar in plan.bars if bar.id == scale_bar))}"
    elif scale:
        words = f"{scale.get('from')} - {scale.get('to')}: {scale.get('distance_mm'):g} mm"
    else:
        words = ""
    about = f"{targets.family}: {ids[0]} - {ids[-1]} ({len(ids)}), {targets.size_mm:g} mm"
    checks = [bar for bar in plan.bars if bar.role == "check"]
    said = "; ".join(f"{bar.id}: {_lengths(bar)}" for bar in checks)
    ball = f"{sphere:g} mm" if sphere else ""
    return Artefacts(about, ball, words, scale_bar, tuple(bar.id for bar in checks), said)


def _lengths(bar: "Bar") -> str:
    return ", ".join(f"{one.length_mm:.3f} mm" for one in bar.lengths)


def planned_sets(plan: "CapturePlan") -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """The plan's placements, poses of the scale bar, and poses of check bars, by id."""
    artefacts = artefacts_of(plan)
    scale_bar = artefacts.scale_bar if artefacts else None
    checks = artefacts.check_bars if artefacts else ()
    return (
        tuple(one.id for one in plan.sets if one.bar is None),
        tuple(one.id for one in plan.sets if one.bar is not None and one.bar == scale_bar),
        tuple(one.id for one in plan.sets if one.bar in checks),
    )


@dataclass(frozen=True, eq=False)
class Taken:
    """A set as it was taken: what the cameras delivered, and the dots in it by camera name."""

    set_id: str
    frames: "FrameSet"
    stillness: "Mapping[str, Stillness]"
    dots: Mapping[str, Dots]
    small: "Mapping[str, NDArray[np.uint8]]"  # the images by camera name, SMALLER times less wide and high


def take_set(connection: "Connection", set_id: str, context: Context, live: bool) -> Taken:
    """Take one set and find its dots."""
    from spherecal_cameras.averaging import take_averaged
    from spherecal_cameras.protocol import CameraError, CaptureRequest, MissingFrame

    context.report("taking images", 0.0, set_id)
    detector = detector_of(connection.plan)
    there = connection.source.statuses()
    request = CaptureRequest(tuple(serial for serial in connection.names if serial in there), 5.0, 2)
    like = cast("Detector | None", detector)  # that of a board is called in the same way
    averaged = take_averaged(connection.source, _LIVE_AVERAGE if live else 1, like, request, context)
    if not averaged.taken.frames:
        causes = "; ".join(f"{connection.names[one.camera]}: {one.cause}" for one in averaged.taken.missing)
        none = translate("Errors", "No camera delivered an image of {name}.").format(name=set_id)
        raise CameraError(f"{none} {causes}".strip(), translate("Errors", "Check the cameras at Connect."))
    dots, small = {}, {}
    for done, (serial, frame) in enumerate(averaged.taken.frames.items()):
        context.report("finding targets", done / len(averaged.taken.frames), connection.names[serial])
        dots[connection.names[serial]] = _find(detector, frame.image)
        small[connection.names[serial]] = _smaller(frame.image, frame.bits)
    absent = [serial for serial in connection.names if serial not in there]
    missing = (MissingFrame(serial, "It is not found.", "Plug it in.") for serial in absent)
    frames = replace(averaged.taken, missing=(*averaged.taken.missing, *missing))
    return Taken(set_id, frames, averaged.stillness, dots, small)


def _smaller(image: np.ndarray, bits: int) -> "NDArray[np.uint8]":
    """Means of squares of SMALLER px, grey values to 255; rows and columns that make no square are left out."""
    height, width = (size // SMALLER for size in image.shape)
    squares = image[: height * SMALLER, : width * SMALLER].reshape(height, SMALLER, width, SMALLER)
    return (squares.mean(axis=(1, 3), dtype=np.float32) * (255.0 / (2**bits - 1))).astype(np.uint8)


def _find(detector: "Detector | BoardDetector | None", image: np.ndarray) -> Dots:
    from spherecal.targets.images import balance_mosaic

    size = (image.shape[1], image.shape[0])
    if detector is None:
        return Dots(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 2)), size)
    found = detector.detect(balance_mosaic(image))
    return Dots(found.target, found.point, found.uv, size)


def dots_of_images(images: Mapping[str, Path], plan: "CapturePlan", context: Context) -> dict[str, Dots]:
    """The dots in recorded images by camera, where the store has none."""
    from spherecal.targets.images import read_image

    detector = detector_of(plan)
    dots = {}
    for done, (camera, path) in enumerate(images.items()):
        context.report("finding targets", done / max(len(images), 1), str(path.name))
        dots[camera] = _find(detector, read_image(path))
    return dots


def kept_reference(profile: Path, result: Path) -> str | None:
    """The camera whose frame was the world so far: of the calibration in use, else of the project's; else None."""
    from spherecal_files.rig_file import read_rig
    from spherecal_rigs.store import is_profile, open_profile

    try:
        kept = open_profile(profile) if is_profile(profile) else None
        if kept is not None and kept.active is not None:
            return kept.rig().reference_camera
        return read_rig(result / "rig.json").reference_camera if (result / "rig.json").is_file() else None
    except SpherecalError:
        return None


def calibrate(project: Project, context: Context, reference: str | None = None) -> Verdict:
    """The same calls as `spherecal calibrate FOLDER -o RESULT` with these repairs, hence the same bytes."""
    from spherecal.calibrate import calibrate as run
    from spherecal.steps.repairs import Repairs
    from spherecal.steps.settings import CalibrationSettings, Method
    from spherecal_files.read_session import read_session
    from spherecal_files.write_result import write_result

    result = project.result_folder
    check_folders(project.folder)
    check_folder(result, RESULT)
    asked = [tuple(value for option, value in project.repairs_now if option == f"--{name}") for name in REPAIRS]
    repairs_asked = Repairs(*asked)
    context.report("reading the session", 0.0)
    session = read_session(project.folder)
    by_board = session.board is not None and session.target_set is None
    method: Method = "board" if by_board else "tao2021" if project.method == "tao2021" else "auto"
    settings = CalibrationSettings(method, repairs=repairs_asked, reference=reference)
    calibration = run(session, settings, context)
    context.report("writing the result", 0.0)
    write_result(calibration, result, {"method": calibration.method, "seed": settings.seed})
    return _word(calibration.rig.quality.verdict)


def _word(verdict: str) -> Verdict:
    words: dict[str, Verdict] = {"valid": "valid", "use-with-care": "use with care"}
    return words.get(verdict, "not valid")


def verify(project: Project, context: Context, seen: "Session | None") -> "tuple[Verdict, Session]":
    """The calls of `spherecal verify FOLDER --rig RESULT/rig.json -o RESULT`; what was `seen` needs no image."""
    from spherecal.detect.session_images import observed
    from spherecal_files.read_session import read_session
    from spherecal_files.rig_file import read_rig
    from spherecal_files.write_verification import write_verification
    from spherecal_rigs.result_folder import read_bar_report
    from spherecal_rigs.rig_source import corners_beside
    from spherecal_verify.limit import parse_limit
    from spherecal_verify.verify_bars import VerifySettings
    from spherecal_verify.verify_bars import verify as run

    result = project.result_folder
    check_folders(project.folder)
    context.report("reading the session", 0.0)
    rig, session = read_rig(result / "rig.json"), read_session(project.verification_folder)
    if seen is None or seen.input_sha256 != session.input_sha256:
        seen = observed(session, context, bar_poses_only=True)
    settings = VerifySettings(parse_limit(project.limit) if project.limit else None, None, corners_beside(result))
    write_verification(run(seen, rig, context, settings), result, result / "rig.json")
    report = read_bar_report(result)
    assert report is not None
    return _verified_word(report), seen


def _verified_word(bars: "BarReport") -> Verdict:
    """The verdict on a verification (report.verification_file) as projects keep it; bar_verdict's word is the same."""
    if bars.failed:
        return "inconsistent"
    acceptance = bars.procedure.acceptance if bars.procedure is not None else None
    decided = acceptance.verdict if acceptance is not None else None
    if decided == "cannot tell":
        return "undecided"
    return "pass" if decided == "pass" else "consistent" if bars.verdict == "consistent" else "no data"


def keep_if_in_use(profile: Path, result: Path, verdict: Verdict) -> None:
    """Have the profile know of a verification, where it was of the calibration in use."""
    from spherecal_gui.in_use import number_of

    number = number_of(profile, result)
    if number is not None:
        keep_verification(profile, number, verdict)


def check(project: Project, profile: Path, context: Context) -> "Check":
    """The same calls as `spherecal check FOLDER --profile PROFILE -o FOLDER/check.json`; the engine's answer."""
    from spherecal_files.read_session import read_session
    from spherecal_rigs.check_rig import check as run
    from spherecal_rigs.check_rig import check_json, keep, read_known_ball
    from spherecal_rigs.rig_source import points_file, read_source

    context.report("reading the session", 0.0)
    session = read_session(project.folder)
    found = run(session, read_source(profile).rig, read_known_ball(points_file(profile)), None, context)
    document = check_json(found)
    write_file_whole(project.folder / "check.json", json_bytes(document))
    keep(profile, document)
    return found


def repair(project: Project, profile: Path, cameras: tuple[str, ...], context: Context) -> "tuple[Verdict, Check]":
    """The same calls as `spherecal check FOLDER --profile PROFILE --repair RESULT`; verdict, and the check after it."""
    from spherecal_files.read_session import read_session
    from spherecal_files.write_result import write_result
    from spherecal_rigs.check_rig import check as run
    from spherecal_rigs.check_rig import read_known_ball
    from spherecal_rigs.repose import repose
    from spherecal_rigs.rig_source import points_file, read_source

    result = project.repair_folder
    check_folders(project.folder)
    check_folder(result, RESULT)
    context.report("reading the session", 0.0)
    session = read_session(project.folder)
    done = repose(session, read_source(profile).rig, cameras, context)
    write_result(done, result, {"method": "selected", "only": list(cameras), "estimate": "pose"})
    after = run(session, done.rig, read_known_ball(points_file(profile)), None, context)
    return _word(done.rig.quality.verdict), after


def report(project: Project, output: Path, language: str, notice: str, context: Context) -> Path:
    """Write the report; pictures of the images are in it while the session is the result's own."""
    from spherecal_documents.report.write_report import write_report
    from spherecal_documents.scene.picture import scene_picture

    context.report("drawing the report", 0.0)
    result = project.result_folder
    write = partial(write_report, language=language, notice=notice, note=project.note, render=scene_picture)
    failed: list[BaseException] = []

    def draw(file: Path) -> None:
        try:
            try:
                write(result, file, project.folder)
            except InputError:  # retaken since: the numbers still hold, the pictures would not
                write(result, file)
        except BaseException as error:
            failed.append(error)

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        file = Path(folder) / output.name
        # in a thread of its own: neither typst nor the renderer can be asked to stop, and nobody waits for what is left
        drawing = threading.Thread(target=draw, args=(file,), name="report", daemon=True)
        drawing.start()
        while drawing.is_alive():
            context.check()
            drawing.join(0.1)
        if failed:
            raise failed[0]
        write_file_whole(output, file.read_bytes())
    return output


def save_profile(result: Path, session: Path, profile: Path, put_to_use: bool, note: str, context: Context) -> str:
    """Add the result to a rig profile's history and, if asked, put it to use; the calibration's number."""
    from spherecal_files.read_session import read_session
    from spherecal_files.rig_file import read_rig
    from spherecal_rigs.framed_rig import FRAME, write_frame
    from spherecal_rigs.result_folder import refuse_failed
    from spherecal_rigs.save_entry import SaveOptions, save_result
    from spherecal_rigs.store import apply, create_profile, open_profile, saying_what_is_in_use

    context.report("saving the profile", 0.0)
    rig = read_rig(result / "rig.json")
    if put_to_use:  # before anything is stored: else it would be half done
        if not rig.quality.valid:
            raise InputError(Phrase("error-not-stored"))
        refuse_failed(result)
    try:
        own = read_session(session).input_sha256 == rig.input_sha256
    except InputError:
        own = False
    kept = create_profile(profile, limits=limits.now().validity)
    number = save_result(kept, result, SaveOptions(session=session if own else None, note=note))
    if put_to_use:
        apply(open_profile(profile), number, note)
        with saying_what_is_in_use(profile):
            if (own_frame := session / "frame.json").is_file():  # the default of the exports of later calibrations
                write_frame(FRAME.read(own_frame), profile / "frame.json")
    return number


def export(result: Path, form: str, output: Path, context: Context, frame: "UserFrame | None" = None) -> Path:
    """Write the rig in another program's format, in a user's frame, else in the reference camera's."""
    from spherecal_documents.export.write_export import export_rig
    from spherecal_files.rig_file import read_rig
    from spherecal_rigs.result_folder import refuse_failed

    context.report("exporting", 0.0, form)
    override = refuse_failed(result)
    export_rig(read_rig(result / "rig.json"), form, output, frame=frame, override=override)
    return output


def calibration_plan(plan: "CapturePlan", sets: Sequence[str], bars: Mapping[str, str] | None = None) -> "CapturePlan":
    """These sets in this order; guided poses have the temperature that the bench's description gives for their bars."""
    from spherecal_cameras.plan import PlannedSet

    known = {one.id: one for one in plan.sets}
    warm = {one.bar: one.temperature_c for one in reversed(plan.sets) if one.bar is not None}
    guided = {name: PlannedSet(name, bar, warm.get(bar)) for name, bar in (bars or {}).items()}
    return replace(plan, sets=tuple(guided.get(name) or known.get(name) or PlannedSet(name) for name in sets))
