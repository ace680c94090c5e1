"""`spherecal cameras list|show|set|doctor|capture`."""

import argparse
import dataclasses
import sys
from collections.abc import Callable
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.cameras.profile import (
    CameraProfile,
    default_profile_path,
    read_profile,
    settings_json,
    write_profile,
)
from spherecal.cameras.protocol import (
    CameraError,
    CameraSource,
    Discovery,
    Region,
    SetupReport,
    features_of,
)
from spherecal.cameras.sources import open_source
from spherecal.cli import cameras_lines, drivers, producer
from spherecal.cli.answer import answer, plain
from spherecal.cli.main import DONE, NOT_VALID
from spherecal.cli.progress import shown_progress
from spherecal.uses.capture import camera_name


def run(options: argparse.Namespace) -> int:
    """`spherecal cameras ...`."""
    if options.kind in producer.COMMANDS:
        return producer.run(options)
    if options.kind == "trust":
        return drivers.trust(options)
    if options.profile is None:
        options.profile = default_profile_path()
    if options.kind == "capture":
        from spherecal.cli.cameras_capture import capture

        return capture(options, read_profile(options.profile))
    actions: dict[str, Callable[[argparse.Namespace, CameraProfile], int]] = {
        "list": list_cameras, "show": show, "set": set_up, "doctor": doctor,
    }  # fmt: skip
    return actions[options.kind](options, read_profile(options.profile))


def console() -> Console:
    """Where results are printed."""
    from spherecal.cli.commands import out

    return out


def open_named(options: argparse.Namespace, profile: CameraProfile) -> CameraSource:
    """The source that the options name."""
    producers = (*options.producer, *profile.producers)
    ask_driver = drivers.asked_before(producers) if options.source == "genicam" else None
    return open_source(options.source, producers, options.fault, ask_driver)


def discovered(source: CameraSource, context: Context) -> Discovery:
    """The cameras of a source; where they are not real, that is said."""
    discovery = source.discover(context)
    if source.label:
        print(source.label, file=sys.stderr)
    return discovery


def _find(name: str, discovery: Discovery, profile: CameraProfile) -> str:
    """The serial of a camera by serial or name; InputError where it is not there."""
    for info in discovery.cameras:
        if name in (info.serial, camera_name(profile, info)):
            return info.serial
    raise InputError(
        Phrase(
            "error-camera-not-found",
            {
                "name": repr(name),
                "found": [camera_name(profile, info) for info in discovery.cameras] or Phrase("nothing"),
            },
        )
    )


# --- list, show, set -------------------------------------------------------------------------------------------------


def list_cameras(options: argparse.Namespace, profile: CameraProfile) -> int:
    """`spherecal cameras list`: every camera once, and a verdict for every driver; 3 without any camera."""
    with open_named(options, profile) as source, shown_progress() as context:
        discovery = discovered(source, context)
    answer(options, {"source": source.kind, "label": source.label, **plain(discovery)})
    out = console()
    table = Table("name", "serial", "model", "maker", "line", "state", box=None)
    for info in discovery.cameras:
        cells = (camera_name(profile, info), info.serial, info.model, info.vendor, info.transport, info.access)
        table.add_row(*map(escape, cells))
    if discovery.cameras:
        out.print(table)
    else:
        out.print("No camera found.")
    if source.kind == "genicam":
        _list_producers(discovery)
    return DONE if discovery.cameras else NOT_VALID


def _list_producers(discovery: Discovery) -> None:
    out = console()
    if not discovery.producers:
        out.print(
            "No driver (.cti file) was found. Install the driver of the cameras' maker, "
            "or name its folder in GENICAM_GENTL64_PATH or with --producer."
        )
    for verdict in discovery.producers:
        mark = "[green]ok[/]" if verdict.usable else "[red]bad[/]"
        out.print(f"{mark} {escape(verdict.file)}: ", end="")
        out.print(f"{verdict.message} {verdict.hint}".strip(), markup=False)
    for double in discovery.doubles:
        out.print(f"   {escape(double.serial)} is seen by {escape(double.producer)} as well; the first driver has it.")


def show(options: argparse.Namespace, profile: CameraProfile) -> int:
    """`spherecal cameras show`."""
    with open_named(options, profile) as source, shown_progress() as context:
        discovery = discovered(source, context)
        serial = _find(options.camera, discovery, profile)
        info = discovery.camera(serial)
        assert info is not None
        source.open([serial], profile.settings())
        status = source.statuses()[serial]
        features = features_of(source, serial)
    entry = profile.entry(serial)
    document = {
        "camera": info,
        "name": camera_name(profile, info),
        "state": status,
        "settings": settings_json(entry.settings),
        "focal_length_mm": entry.focal_length_mm,
        "pixel_pitch_um": entry.pixel_pitch_um,
        "features": features,
    }
    answer(options, document)
    out = console()
    of = f"{info.vendor} {info.model}, serial {serial}"
    out.print(f"[bold]{escape(camera_name(profile, info))}[/]: {escape(of)}")
    out.print(f"state: {status.state.value}. {status.cause} {status.remedy}".strip(), markup=False)
    if status.temperature_c is not None:
        out.print(f"temperature: {status.temperature_c:.1f} degrees Celsius")
    kept = settings_json(entry.settings) | {
        "focal_length_mm": entry.focal_length_mm,
        "pixel_pitch_um": entry.pixel_pitch_um,
    }
    table = Table("setting", "kept", box=None)
    for key, value in kept.items():
        table.add_row(key, "-" if value is None else escape(str(value)))
    out.print(table)
    table = Table("feature", "the camera's name for it", "now", box=None)
    for feature in features:
        table.add_row(feature.feature, escape(feature.node or "(missing)"), escape(feature.got))
    out.print(table)
    return DONE


def set_up(options: argparse.Namespace, profile: CameraProfile) -> int:
    """`spherecal cameras set`: kept in the profile, applied to the cameras that are there."""
    if options.camera == "all" and options.name:
        raise InputError(Phrase("error-one-name-for-all"))
    if options.offline:
        serials = (
            list(profile.cameras) if options.camera == "all" else [profile.serial_of(options.camera) or options.camera]
        )
        _keep(options, profile, serials)
        answer(options, {"profile": options.profile, "cameras": serials, "set_up": [], "not_reached": {}})
        return DONE
    with open_named(options, profile) as source, shown_progress() as context:
        discovery = discovered(source, context)
        serials = list(discovery.serials) if options.camera == "all" else [_find(options.camera, discovery, profile)]
        if not serials:
            raise CameraError(Phrase("error-no-camera-found"))
        profile = _keep(options, profile, serials)
        reports = source.open(serials, profile.settings())
        unreachable = {s: status for s, status in source.statuses().items() if not status.state.usable}
    record = {"profile": options.profile, "cameras": serials, "set_up": reports, "not_reached": unreachable}
    answer(options, record)
    for report in reports:
        _show_setup(report, profile.entry(report.serial).name or report.serial)
    for serial, status in unreachable.items():
        console().print(f"{serial}: kept, but not applied. {status.cause} {status.remedy}", markup=False)
    return DONE if all(not report.problems for report in reports) and not unreachable else NOT_VALID


def _keep(options: argparse.Namespace, profile: CameraProfile, serials: list[str]) -> CameraProfile:
    for serial in serials:
        entry = profile.entry(serial)
        changes: dict[str, Any] = {
            key: value
            for key in (
                "exposure_us",
                "gain_db",
                "pixel_format",
                "trigger",
                "trigger_source",
                "frame_rate_hz",
                "packet_size",
                "packet_delay",
                "frame_delay",
            )
            if (value := getattr(options, key)) is not None
        }
        if options.region is not None:
            changes["region"] = Region(*options.region)
        if options.full:
            changes["region"] = None
        entry = dataclasses.replace(entry, settings=dataclasses.replace(entry.settings, **changes))
        for key in ("name", "focal_length_mm", "pixel_pitch_um"):
            if getattr(options, key) is not None:
                entry = dataclasses.replace(entry, **{key: getattr(options, key)})
        holder = profile.serial_of(entry.name) if entry.name else None
        if holder not in (None, serial):
            raise InputError(Phrase("error-name-taken", {"camera": holder, "name": repr(entry.name)}))
        profile = profile.with_entry(entry)
    write_profile(options.profile, profile)
    return profile


def _show_setup(report: SetupReport, name: str) -> None:
    out = console()
    size = f"{report.image_size[0]} x {report.image_size[1]} px" if report.image_size else "size unknown"
    out.print(f"{escape(name)}: set up, {size}.")
    for feature in report.problems:
        out.print(
            f"  {feature.feature}: wanted {feature.wanted}, has {feature.got or '-'}: {feature.problem}", markup=False
        )
    if report.missing:
        out.print(f"  not on this camera: {', '.join(report.missing)}")


# --- doctor ----------------------------------------------------------------------------------------------------------


def doctor(options: argparse.Namespace, profile: CameraProfile) -> int:
    """`spherecal cameras doctor`."""
    from spherecal.cameras.doctor import examine

    with open_named(options, profile) as source, shown_progress() as context:
        discovery = _open_all(source, profile, context)
        examination = examine(source, options.seconds, options.rate, context)
        lines = cameras_lines.examined(source, discovery, options.rate)
        if options.stagger:
            cameras_lines.keep_staggered(options, profile, source, lines)
        if options.order:
            _order_test(source, discovery, profile)
    well = examination.well and cameras_lines.well(lines)
    answer(options, {"source": source.kind, **plain(examination), "lines": lines})
    out = console()
    table = Table("camera", "state", box=None)
    headings = ("images", "incomplete", "underrun", "rate/s", "wanted/s", "packet", "missing", "resent", "degrees C")
    for heading in headings:
        table.add_column(heading, justify="right")
    names = {info.serial: camera_name(profile, info) for info in discovery.cameras}
    for link in examination.links:
        counted = link.counters
        wanted = "-" if counted.wanted_hz is None else f"{counted.wanted_hz:.1f}"
        warm = "-" if link.temperature_c is None else f"{link.temperature_c:.1f}"
        table.add_row(
            escape(names[link.serial]),
            link.state.value,
            str(counted.delivered),
            str(counted.incomplete),
            str(counted.underrun),
            f"{counted.rate_hz:.1f}",
            wanted,
            link.packet_size or "-",
            link.packets_missing or "-",
            link.packets_resent or "-",
            warm,
        )
    out.print(table)
    trigger = examination.trigger
    out.print(
        f"Sets: {trigger.complete} of {trigger.sets} complete, median {trigger.median_s * 1e3:.0f} ms, "
        f"longest {trigger.longest_s * 1e3:.0f} ms."
    )
    cameras_lines.show(lines, out)
    colour = {"error": "red", "warning": "yellow", "info": "blue"}
    for finding in (*examination.findings, *(finding for line in lines for finding in line.findings)):
        out.print(f"[{colour[finding.severity]}]{finding.severity}[/] ", end="")
        out.print(f"{finding.message} {finding.hint}", markup=False)
    out.print("All is well." if well else "See above for what to do.")
    return DONE if well else NOT_VALID


def _open_all(source: CameraSource, profile: CameraProfile, context: Context) -> Discovery:
    """Discover and open every camera; CameraError where there is none."""
    discovery = discovered(source, context)
    if not discovery.cameras:
        raise CameraError(Phrase("error-no-camera-found"))
    context.report("opening the cameras", 0.0)
    source.open(discovery.serials, profile.settings())
    return discovery


def _order_test(source: CameraSource, discovery: Discovery, profile: CameraProfile) -> None:
    """Ask for each lens to be covered and tell which camera that is."""
    from spherecal.cameras.doctor import brightness, covered_camera

    out = console()
    out.print("Cover one lens at a time with your hand; an empty line with no lens covered ends the test.")
    before = brightness(source)
    names = {info.serial: camera_name(profile, info) for info in discovery.cameras}
    left = set(names)
    while left:
        if not ask("Cover a lens, then press Enter: "):
            return
        found = covered_camera(source, before)
        if found is None:
            out.print("No single image has become dark; the test ends.")
            return
        left.discard(found)
        out.print(f"That is camera {escape(names[found])} (serial {escape(found)}).")


def ask(text: str) -> bool:
    """Wait for Enter; False at the end of input."""
    print(text, end="", file=sys.stderr, flush=True)
    return bool(sys.stdin.readline())
