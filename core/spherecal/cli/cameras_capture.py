"""`spherecal cameras capture`: a session, set by set."""

import argparse
import os
import subprocess
from dataclasses import replace

from rich.markup import escape

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.cameras.averaging import AveragedSet, take_averaged
from spherecal.cameras.capture import SessionCamera, SessionFolder, session_ids
from spherecal.cameras.in_process import Staged
from spherecal.cameras.plan import (
    CapturePlan,
    camera_spec_json,
    plan_of,
    read_plan,
    recorded_camera_json,
    simple_plan,
)
from spherecal.cameras.profile import CameraProfile
from spherecal.cameras.protocol import CameraError, CameraSource, CaptureRequest, Discovery, SetupReport
from spherecal.cli.cameras import ask, console, discovered, open_named, shown_name
from spherecal.cli.main import DONE, NOT_VALID
from spherecal.cli.progress import shown_progress
from spherecal.data.findings import counted
from spherecal.data.session import Session
from spherecal.targets.detection import Detector


def capture(options: argparse.Namespace, profile: CameraProfile) -> int:
    """`spherecal cameras capture`."""
    if options.average < 1 or options.retries < 0:
        raise InputError(Phrase("error-average-retries"))
    with open_named(options, profile) as source, shown_progress() as context:
        plan = _plan(options, source)
        discovery = discovered(source, context)
        if not discovery.cameras:
            raise CameraError(Phrase("error-no-camera-found"))
        context.report("opening the cameras", 0.0)
        reports = source.open(discovery.serials, profile.settings())
        cameras = _session_cameras(source, plan, discovery, reports, profile)
        session = SessionFolder(options.output, plan, cameras, source)
        session.start(options.take_up)
        names = {camera.serial: camera.id for camera in cameras}
        detector = Detector(plan.target_set) if plan.target_set is not None and options.average > 1 else None
        request = CaptureRequest(tuple(names), options.timeout, options.retries)
        poor = 0
        for planned in session.to_take:
            if isinstance(source, Staged):
                source.show(planned.id)
            _before(planned.id, planned.bar, options, isinstance(source, Staged))
            averaged = take_averaged(source, options.average, detector, request, context)
            session.add(planned, averaged.taken, averaged.stillness)
            poor += _show_set(planned.id, averaged, names)
    total = len(plan.sets)
    console().print(f"{counted(total, 'set')} of {counted(len(cameras), 'camera')} in {escape(str(options.output))}.")
    if poor:
        console().print(f"{poor} of them {'is' if poor == 1 else 'are'} incomplete or not still; see above.")
    return NOT_VALID if poor else DONE


def _plan(options: argparse.Namespace, source: CameraSource) -> CapturePlan:
    recorded = _recorded(source)
    if options.plan is not None:
        return read_plan(options.plan)
    if recorded is not None and options.placements is None:
        return plan_of(recorded)
    if recorded is not None:
        whole = plan_of(recorded)
        chosen = [s for s in whole.sets if s.bar is None][: options.placements]
        return replace(whole, sets=(*chosen, *(s for s in whole.sets if s.bar is not None)))
    if options.targets is None:
        raise InputError(Phrase("error-capture-targets"))
    return simple_plan(options.placements or 4, options.targets, options.diameter_mm)


def _session_cameras(
    source: CameraSource,
    plan: CapturePlan,
    discovery: Discovery,
    reports: tuple[SetupReport, ...],
    profile: CameraProfile,
) -> tuple[SessionCamera, ...]:
    """Every camera as session.json has it: as the plan or the recording knows it, else by the profile."""
    recorded = _recorded(source)
    sizes = {report.serial: report.image_size for report in reports}
    names = session_ids({info.serial: shown_name(profile, info) for info in discovery.cameras})
    cameras = []
    for info in discovery.cameras:
        name, size = names[info.serial], sizes.get(info.serial)
        if size is None:
            status = source.statuses()[info.serial]
            raise CameraError(Phrase("error-camera-unusable", {"camera": name, "cause": status.cause}), status.remedy)
        planned = plan.camera(info.serial, name)
        spec = next((c for c in recorded.cameras if c.id == info.user_name), None) if recorded is not None else None
        if planned is not None:
            document = {**planned, "serial": info.serial}
        elif spec is not None and recorded is not None:
            document = recorded_camera_json(spec, recorded, info.serial)
        else:
            kept = profile.entry(info.serial)
            document = camera_spec_json(name, info.serial, info.model, size, kept.pixel_pitch_um, kept.focal_length_mm)
        if list(document["image_size"]) != list(size):
            raise CameraError(
                Phrase(
                    "error-prior-size",
                    {
                        "camera": name,
                        "width": size[0],
                        "height": size[1],
                        "prior_width": document["image_size"][0],
                        "prior_height": document["image_size"][1],
                    },
                )
            )
        cameras.append(SessionCamera(info.serial, document))
    return tuple(cameras)


def _recorded(source: CameraSource) -> Session | None:
    """The session behind a simulated rig or a recording."""
    stage = getattr(source, "stage", None)
    return getattr(source, "session", None) if stage is None else stage.session


def _before(set_id: str, bar: str | None, options: argparse.Namespace, staged: bool) -> None:
    """Give people or a machine the time to bring ball or bar to its place."""
    if options.before_each:
        done = subprocess.run(options.before_each, shell=True, env=os.environ | {"SPHERECAL_SET": set_id}, check=False)
        if done.returncode:
            raise InputError(
                Phrase(
                    "error-before-each", {"command": repr(options.before_each), "set": set_id, "code": done.returncode}
                )
            )
    if not (options.no_wait or staged or options.before_each):
        what = "the ball" if bar is None else f"bar {bar}"
        if not ask(f"{set_id}: put {what} into place, let it come to rest, then press Enter: "):
            raise InputError(Phrase("error-nobody-to-ask"))


def _show_set(set_id: str, averaged: AveragedSet, names: dict[str, str]) -> bool:
    """Say how a set went; True if it is incomplete or was not still."""
    taken = averaged.taken
    out = console()
    spread = "" if taken.spread_s is None else f", exposed within {taken.spread_s * 1e3:.1f} ms"
    out.print(
        f"{escape(set_id)}: {len(taken.frames)} of {counted(len(names), 'camera')} in {taken.seconds:.2f} s{spread}."
    )
    noises = [one.noise_px for one in averaged.stillness.values() if one.noise_px is not None]
    if noises:
        out.print(f"  noise floor of a dot: {min(noises):.4f} to {max(noises):.4f} px.")
    if taken.late:
        out.print(
            f"  tried {counted(taken.attempts, 'time')} for {', '.join(names[s] for s in taken.late)}.", markup=False
        )
    for one in taken.missing:
        out.print(f"  missing: {names[one.camera]}. {one.cause} {one.remedy}", markup=False)
    for serial in averaged.moved:
        moved = averaged.stillness[serial].motion_px
        out.print(f"  camera {names[serial]} saw motion of {moved:.3f} px: let the scene come to rest.", markup=False)
    return bool(taken.missing or averaged.moved)
