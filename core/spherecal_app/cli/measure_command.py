"""`spherecal measure`: points, lengths, bars and bodies with a calibrated rig, from a session or live cameras."""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial

import numpy as np
from rich.markup import escape

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.data.rig import Rig
from spherecal.data.session import Session
from spherecal.targets.family import make_target_set
from spherecal_app.cli.cameras_source import discovered, open_asking
from spherecal_app.cli.console import check_output_folder, figures, kept_in_profile, out, say, shown_progress
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_cameras.camera_settings import default_profile_path, read_profile
from spherecal_cameras.new_recording import camera_name
from spherecal_files.bar_registry import BAR_REGISTRY
from spherecal_files.read_session import read_session
from spherecal_files.target_set_file import read_target_set
from spherecal_measuring.health import keep_health
from spherecal_measuring.live_sets import LiveSets, LiveSettings, rig_cameras_of
from spherecal_measuring.measured_sets import Health, MeasuredSet, ObservedSet
from spherecal_measuring.measurer import Measurer
from spherecal_measuring.measuring_task import Task, parse_point, parse_ruler, registered
from spherecal_measuring.pose import read_body
from spherecal_measuring.series_file import SERIES, check_table_kind, run, set_json, sets_of_session
from spherecal_measuring.stream import MeasurementStream
from spherecal_rigs.rig_source import read_source

_SHOWN_S = 0.5  # between lines of a live measurement on the terminal


def measure(options: argparse.Namespace) -> int:
    """`spherecal measure`."""
    _check(options)
    with ExitStack() as stack:
        context = stack.enter_context(shown_progress())
        rig = read_source(options.rig).rig
        session = None if options.session is None else read_session(options.session)
        task = _task(options, session)
        measurer = Measurer(rig, task)
        if session is not None:
            sets = sets_of_session(session, rig, context)
        else:
            sets = _live_sets(options, rig, task, context, stack)
        seen = _listener(options, measurer, stack)
        ended_by_user = _run(options, sets, measurer, seen, context)
    health = measurer.health
    kept = None
    if not options.not_kept:
        keep = partial(keep_health, options.rig, health, rig, options.temperature)
        kept = kept_in_profile("The rig's health", options.rig, keep)
    if not options.json:
        _summary(options, health, rig)
        if kept is not None:
            say(kept)
    if ended_by_user and (options.sets is not None or options.seconds is not None or session is not None):
        raise KeyboardInterrupt
    return NOT_VALID if health.moved or not rig.quality.valid else DONE


def _check(options: argparse.Namespace) -> None:
    if (options.session is None) == (options.cameras is None):
        raise InputError(Phrase("error-session-or-cameras"))
    if not 0 < options.rate <= 1000:
        raise InputError(Phrase("error-rate", {"rate": options.rate}))
    if options.sets is not None and options.sets < 1:
        raise InputError(Phrase("error-at-least", {"option": "--sets", "least": 1, "value": options.sets}))
    if options.seconds is not None and not options.seconds > 0:
        raise InputError(Phrase("error-above-zero", {"name": "--seconds", "value": options.seconds}))
    if options.skew_ms is not None and not 0 <= options.skew_ms < 1e6:
        raise InputError(Phrase("error-at-least", {"option": "--skew-ms", "least": 0, "value": options.skew_ms}))
    if options.output is not None:
        check_table_kind(options.table)
        check_output_folder(options.output, SERIES)


def _task(options: argparse.Namespace, session: Session | None) -> Task:
    if options.targets is not None:
        targets = read_target_set(options.targets)
    else:
        targets = make_target_set() if session is None else session.target_set
    own = () if session is None else session.bars
    known = BAR_REGISTRY.read() if options.bar else {}
    if unknown := [serial for serial in options.bar if serial not in known]:
        raise InputError(
            Phrase("error-bar-not-registered", {"bar": unknown[0], "names": list(known) or Phrase("nothing")})
        )
    there = {bar.serial for bar in own}
    return Task(
        targets,
        tuple(parse_point(text) for text in options.point),
        (*(parse_ruler(text, 2) for text in options.distance), *(parse_ruler(text, 3) for text in options.angle)),
        (*own, *(registered(known[serial]) for serial in options.bar if serial not in there)),
        tuple(read_body(path) for path in options.body),
        options.temperature,
        _exposure_sd(options),
        options.exact_times,
    )


def _exposure_sd(options: argparse.Namespace) -> float | None:
    """As the options say; 0 for cameras that are all triggered by hardware; None: as their times scatter."""
    if options.skew_ms is not None:
        return options.skew_ms * 1e-3
    if options.cameras is None:
        return None
    settings = read_profile(options.camera_profile or default_profile_path()).settings().values()
    return 0.0 if settings and all(one.trigger == "hardware" for one in settings) else None


def _live_sets(
    options: argparse.Namespace, rig: Rig, task: Task, context: Context, stack: ExitStack
) -> Iterator[ObservedSet]:
    profile = read_profile(options.camera_profile or default_profile_path())
    producers = (*options.producer, *profile.producers)
    source = stack.enter_context(open_asking(options.cameras, producers, options.fault))
    discovery = discovered(source, context)
    names = {info.serial: camera_name(profile, info) for info in discovery.cameras}
    cameras = rig_cameras_of(rig, discovery, names)
    if lacking := [camera.id for camera in rig.cameras if camera not in cameras.values()]:
        print(f"Not found, and left out: {', '.join(lacking)}.", file=sys.stderr)
    if task.target_set is None:
        raise InputError(Phrase("error-live-targets"))
    source.open(cameras, profile.settings())
    settings = LiveSettings(options.rate, options.sets, options.seconds)
    return iter(LiveSets(source, cameras, task.target_set, settings, context))


def _listener(options: argparse.Namespace, measurer: Measurer, stack: ExitStack) -> Callable[[MeasuredSet], None]:
    """What is done with every set besides recording it: the stream, the terminal."""
    stream = None
    if options.stream is not None:
        about = {"cameras": [camera.id for camera in measurer.rig.cameras]}
        stream = stack.enter_context(MeasurementStream(options.stream, about))
        print(f"Every set is sent to 127.0.0.1:{stream.port}.", file=sys.stderr, flush=True)
    shown = _Shown(options, measurer)

    def seen(measured: MeasuredSet) -> None:
        document = set_json(measured, measurer.health) if stream is not None or options.json else None
        if stream is not None and document is not None:
            stream.send(document)
        if options.json:
            print(json.dumps(document), flush=True)
        else:
            shown.show(measured)

    return seen


def _run(
    options: argparse.Namespace,
    sets: Iterator[ObservedSet],
    measurer: Measurer,
    seen: Callable[[MeasuredSet], None],
    context: Context,
) -> bool:
    """Measure all sets; whether Ctrl-C ended it (what there was is written)."""
    try:
        run(sets, measurer, seen, options.output, options.table, context)
    except KeyboardInterrupt:
        if not measurer.health.sets:
            raise
        return True
    return False


class _Shown:
    """Sets on the terminal: each of a session, of live cameras some a second; contradictions when they are new."""

    def __init__(self, options: argparse.Namespace, measurer: Measurer) -> None:
        self._live, self._measurer = options.session is None, measurer
        self._last_s = -1e9
        self._named: set[tuple[int, str | None]] = set()
        self._moved: tuple[str, ...] = ()

    def show(self, measured: MeasuredSet) -> None:
        for one in measured.contradictions:
            # single dots are left out now and then, by dirt or a hand; half a target is worth a line
            if 2 * one.views >= one.of and (one.target, one.camera) not in self._named:
                self._named.add((one.target, one.camera))
                who = (
                    "its views contradict one another" if one.camera is None else f"{one.camera} contradicts the others"
                )
                say(f"set {measured.number}, target {one.target}: {who} ({one.views} of {one.of})")
        moved = self._measurer.health.moved
        for camera in sorted(set(moved) - set(self._moved)):
            out.print(f"[bold red]Camera {camera} has moved[/] since the calibration (set {measured.number}).")
        self._moved = moved
        now = time.monotonic()
        if self._live and now - self._last_s < _SHOWN_S:
            return
        self._last_s = now
        say(_line(measured))


def _line(measured: MeasuredSet) -> str:
    at = measured.id or (f"{measured.time_s:.2f} s" if measured.time_s is not None else str(measured.number))
    parts = [f"{at}: {len(measured.names)} points"]
    if len(measured.names):
        parts[0] += f" (u = {float(np.median(measured.sigma_mm)):.4f} mm)"
    for v in measured.values:
        off = "" if v.deviation is None else f", {v.deviation:+.4f} off (u = {v.u_deviation:.4f})"
        parts.append(f"{v.name} {v.value:.4f} {v.unit}{off or f' (u = {v.u:.4f})'}")
    for b in measured.bodies:
        x, y, z = b.translation_mm
        parts.append(f"{b.name} at {x:.3f} {y:.3f} {z:.3f} mm ({b.points} points)")
    return "; ".join(parts)


def _summary(options: argparse.Namespace, health: Health, rig: Rig) -> None:
    table = figures("camera", "image points", "rms px", "at calibration", "left out", "")
    for one in health.cameras:
        rms, before = (("-" if px is None else f"{px:.4f}") for px in (one.rms_px, one.calibrated_rms_px))
        word = "" if one.moved is None else f"[bold red]MOVED[/] by {one.moved.move_px:.2f} px (set {one.named_at})"
        table.add_row(escape(one.camera), str(one.observations), rms, before, str(one.left_out), word)
    out.print(table)
    where = "" if options.output is None else f" in {escape(str(options.output))}"
    out.print(f"{counted(health.sets, 'set')} measured{where}.")
    if not rig.quality.valid:
        out.print("[bold red]The rig is not valid[/]: its measurements prove nothing.")
