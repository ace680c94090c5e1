"""`spherecal cameras capture`: a session, set by set."""

import argparse
import subprocess
from dataclasses import replace

from rich.markup import escape

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.data.session import STANDARD_PLACEMENTS
from spherecal.targets.detection import Detector
from spherecal_app.cli.cameras_source import ask, discovered, open_named, profile_of
from spherecal_app.cli.console import answer, out, say, shown_progress
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_cameras.averaging import AveragedSet, take_averaged
from spherecal_cameras.capture import SessionFolder
from spherecal_cameras.in_process import Staged
from spherecal_cameras.new_recording import session_cameras
from spherecal_cameras.plan import CapturePlan, begun_plan, plan_of, read_plan, simple_plan
from spherecal_cameras.protocol import CameraError, CameraSource, CaptureRequest, FrameSet, session_behind
from spherecal_files.json_file import plain_fields
from spherecal_files.programs import users_environment


def capture(options: argparse.Namespace) -> int:
    """`spherecal cameras capture`."""
    profile = profile_of(options)
    if options.average < 1 or options.retries < 0:
        raise InputError(Phrase("error-average-retries"))
    with open_named(options, profile) as source, shown_progress() as context:
        plan = _plan(options, source)
        discovery = discovered(source, context)
        if not (serials := profile.rig_of(discovery.serials)):
            raise CameraError(Phrase("error-no-camera-found"))
        context.report("opening the cameras", 0.0)
        reports = source.open(serials, profile.settings())
        found = session_cameras(source, plan, discovery, reports, profile).or_raise()
        for error in found.problems.values():
            say(f"{error.message} {error.hint}".strip())
        cameras = found.cameras
        session = SessionFolder(options.output, plan, cameras, source)
        session.start(options.take_up)
        names = {camera.serial: camera.id for camera in cameras}
        detector = Detector(plan.target_set) if plan.target_set is not None and options.average > 1 else None
        request = CaptureRequest(tuple(names), options.timeout, options.retries)
        poor, record = 0, []
        for planned in session.to_take:
            if isinstance(source, Staged):
                source.show(planned.id)
            _before(planned.id, planned.bar, options, isinstance(source, Staged))
            averaged = take_averaged(source, options.average, detector, request, context)
            session.add(planned, averaged.taken, averaged.stillness)
            poor += _show_set(planned.id, averaged, names)
            taken = averaged.taken
            missing, moved = [names[one.camera] for one in taken.missing], [names[serial] for serial in averaged.moved]
            about = {"id": planned.id, "images": len(taken.frames), "missing": missing, "moved": moved}
            record.append({**about, **plain_fields(taken, "attempts spread_s")})
    total, incomplete = len(plan.sets), session.incomplete
    without = {found.names[serial]: error.message for serial, error in found.problems.items()}
    document = {"session": options.output, "cameras": list(names.values()), "without": without, "sets": record}
    answer(options, {**document, "incomplete": incomplete})
    out.print(f"{counted(total, 'set')} of {counted(len(cameras), 'camera')} in {escape(str(options.output))}.")
    if poor:
        out.print(f"{poor} of them {'is' if poor == 1 else 'are'} incomplete or not still; see above.")
    for name, missing in incomplete.items():
        say(f"{name} has no image of {', '.join(missing)}.")
    return NOT_VALID if poor or incomplete or without else DONE


def _plan(options: argparse.Namespace, source: CameraSource) -> CapturePlan:
    recorded = session_behind(source)
    begun = begun_plan(options.output) if options.take_up else None
    if options.plan is not None:
        return read_plan(options.plan)
    if begun is not None and options.targets is None and options.placements is None:
        return begun
    if recorded is not None and options.placements is None:
        return plan_of(recorded)
    if recorded is not None:
        whole = plan_of(recorded)
        chosen = [s for s in whole.sets if s.bar is None][: options.placements]
        return replace(whole, sets=(*chosen, *(s for s in whole.sets if s.bar is not None)))
    if options.targets is None and (begun is None or begun.target_set is None):
        raise InputError(Phrase("error-capture-targets"))
    whole = simple_plan(options.placements or STANDARD_PLACEMENTS, options.targets, options.diameter_mm)
    return whole if begun is None else replace(begun, sets=whole.sets, target_set=whole.target_set or begun.target_set)


def _before(set_id: str, bar: str | None, options: argparse.Namespace, staged: bool) -> None:
    """Give people or a machine the time to bring ball or bar to its place."""
    if options.before_each:
        done = subprocess.run(
            options.before_each, shell=True, env=users_environment() | {"SPHERECAL_SET": set_id}, check=False
        )
        if done.returncode:
            values = {"command": repr(options.before_each), "set": set_id, "code": done.returncode}
            raise InputError(Phrase("error-before-each", values))
    if not (options.no_wait or staged or options.before_each):
        what = "the ball" if bar is None else f"bar {bar}"
        if not ask(f"{set_id}: put {what} into place, let it come to rest, then press Enter: "):
            raise InputError(Phrase("error-nobody-to-ask"))


def _spread(taken: FrameSet) -> str:
    """How far apart the exposures were, and by whose clock."""
    if taken.spread_s is None:
        return ""
    if taken.common_clock:
        return f", exposed within {taken.spread_s * 1e3:.3f} ms by the cameras' common clock"
    return f", exposed within {taken.spread_s * 1e3:.1f} ms"


def _show_set(set_id: str, averaged: AveragedSet, names: dict[str, str]) -> bool:
    """Say how a set went; True if it is incomplete or was not still."""
    taken = averaged.taken
    spread = _spread(taken)
    out.print(
        f"{escape(set_id)}: {len(taken.frames)} of {counted(len(names), 'camera')} in {taken.seconds:.2f} s{spread}."
    )
    noises = [one.noise_px for one in averaged.stillness.values() if one.noise_px is not None]
    if noises:
        out.print(f"  noise floor of a dot: {min(noises):.4f} to {max(noises):.4f} px.")
    if taken.late:
        say(f"  tried {counted(taken.attempts, 'time')} for {', '.join(names[s] for s in taken.late)}.")
    for one in taken.missing:
        say(f"  missing: {names[one.camera]}. {one.cause} {one.remedy}")
    for serial in averaged.moved:
        moved = averaged.stillness[serial].motion_px
        say(f"  camera {names[serial]} saw motion of {moved:.3f} px: let the scene come to rest.")
    return bool(taken.missing or averaged.moved)
