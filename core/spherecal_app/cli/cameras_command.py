"""`spherecal cameras list|show|set`."""

import argparse
import dataclasses

from rich.markup import escape
from rich.table import Table

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_app.cli.cameras_source import advice_for, discovered, open_named, profile_of
from spherecal_app.cli.console import answer, out, say, shown_progress
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_cameras.camera_settings import SETTINGS, CameraProfile, write_profile
from spherecal_cameras.new_recording import camera_name
from spherecal_cameras.protocol import CameraError, CameraInfo, Discovery, Region, features_of
from spherecal_files.json_file import plain_fields


def _find(name: str, discovery: Discovery, profile: CameraProfile) -> str:
    """The serial of a camera by serial or name; InputError where it is not there, or several have the name."""
    if discovery.camera(name) is not None:
        return name
    found = [info for info in discovery.cameras if camera_name(profile, info) == name]
    if len(found) == 1:
        return found[0].serial
    if found:
        raise InputError(Phrase("error-camera-ambiguous", {"name": repr(name), "cameras": list(map(_in_words, found))}))
    values = {
        "name": repr(name), "found": [camera_name(profile, info) for info in discovery.cameras] or Phrase("nothing"),
    }  # fmt: skip
    raise InputError(Phrase("error-camera-not-found", values))


def _in_words(info: CameraInfo) -> str:
    """A camera by what tells it from others of its name."""
    return " ".join(part for part in (info.serial, info.vendor, info.model, info.address) if part)


def list_cameras(options: argparse.Namespace) -> int:
    """`spherecal cameras list`: every camera once, and a verdict for every driver; 3 without any camera."""
    profile = profile_of(options)
    with open_named(options, profile) as source, shown_progress() as context:
        discovery = discovered(source, context)
    answer(options, {"source": source.kind, "label": source.label, **plain_fields(discovery)})
    table = Table("name", "serial", "model", "maker", "line", "address", "state", box=None)
    for info in discovery.cameras:
        place = info.transport, info.address, info.access if profile.entry(info.serial).in_rig else "left out"
        table.add_row(*map(escape, (camera_name(profile, info), info.serial, info.model, info.vendor, *place)))
    if discovery.cameras:
        out.print(table)
        _tell_alike(profile, discovery)
    else:
        out.print("No camera found.")
    if source.kind == "genicam":
        for line in advice_for(discovery):
            say(line)
        if not discovery.producers:
            out.print(
                "No driver (.cti file) was found. Install the driver of the cameras' maker, "
                "or name its folder in GENICAM_GENTL64_PATH or with --producer."
            )
        for verdict in discovery.producers:
            mark = "[green]ok[/]" if verdict.usable else "[red]bad[/]"
            out.print(f"{mark} {escape(verdict.file)}: ", end="")
            say(f"{verdict.message} {verdict.hint}".strip())
        for double in discovery.doubles:
            out.print(
                f"   {escape(double.serial)} is seen by {escape(double.producer)} as well; the first driver has it."
            )
    return DONE if discovery.cameras else NOT_VALID


def _tell_alike(profile: CameraProfile, discovery: Discovery) -> None:
    """Say which cameras share a name, and which are told apart by their place alone."""
    names = [camera_name(profile, info) for info in discovery.cameras]
    for name in sorted({one for one in names if names.count(one) > 1}):
        alike = [info.serial for info, one in zip(discovery.cameras, names, strict=True) if one == name]
        hint = f"Give each its own: spherecal cameras set {alike[0]!r} --name NAME."
        say(f"{len(alike)} cameras are called {name}: {', '.join(alike)}. {hint}")
    for info in discovery.cameras:
        if info.address and info.serial.endswith(f" ({info.address})"):
            say(f"{info.serial}: another camera has this serial number too; its address {info.address} tells it apart.")


def show(options: argparse.Namespace) -> int:
    """`spherecal cameras show`."""
    profile = profile_of(options)
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
        "camera": info, "name": camera_name(profile, info), "state": status,
        "settings": SETTINGS.entry(entry.settings), "focal_length_mm": entry.focal_length_mm,
        "pixel_pitch_um": entry.pixel_pitch_um, "features": features,
    }  # fmt: skip
    answer(options, document)
    of = f"{info.vendor} {info.model}, serial {serial}"
    out.print(f"[bold]{escape(camera_name(profile, info))}[/]: {escape(of)}")
    say(f"state: {status.state.value}. {status.cause} {status.remedy}".strip())
    if status.temperature_c is not None:
        out.print(f"temperature: {status.temperature_c:.1f} degrees Celsius")
    kept = SETTINGS.entry(entry.settings) | {
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


def set_up(options: argparse.Namespace) -> int:
    """`spherecal cameras set`: kept in the profile, applied to the cameras that are there."""
    profile = profile_of(options)
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
        profile = _keep(options, profile, serials, discovery)
        reports = source.open(serials, profile.settings())
        unreachable = {s: status for s, status in source.statuses().items() if not status.state.usable}
    record = {"profile": options.profile, "cameras": serials, "set_up": reports, "not_reached": unreachable}
    answer(options, record)
    for report in reports:
        size = f"{report.image_size[0]} x {report.image_size[1]} px" if report.image_size else "size unknown"
        out.print(f"{escape(profile.entry(report.serial).name or report.serial)}: set up, {size}.")
        for feature in report.problems:
            say(f"  {feature.feature}: wanted {feature.wanted}, has {feature.got or '-'}: {feature.problem}")
        if report.missing:
            out.print(f"  not on this camera: {', '.join(report.missing)}")
    for serial, status in unreachable.items():
        out.print(f"{serial}: kept, but not applied. {status.cause} {status.remedy}", markup=False)
    return DONE if all(not report.problems for report in reports) and not unreachable else NOT_VALID


def _keep(
    options: argparse.Namespace, profile: CameraProfile, serials: list[str], discovery: Discovery | None = None
) -> CameraProfile:
    called = {info.serial: camera_name(profile, info) for info in (discovery.cameras if discovery is not None else ())}
    for serial in serials:
        entry = profile.entry(serial)
        asked = {one.name: getattr(options, one.name) for one in dataclasses.fields(entry.settings)}
        changes: dict[str, object] = {key: value for key, value in asked.items() if value is not None}
        if options.region is not None:
            changes["region"] = Region(*options.region)
        if options.full:
            changes["region"] = None
        entry = dataclasses.replace(entry, settings=dataclasses.replace(entry.settings, **changes))
        for key in ("name", "focal_length_mm", "pixel_pitch_um"):
            if getattr(options, key) is not None:
                entry = dataclasses.replace(entry, **{key: getattr(options, key)})
        if options.in_rig is not None:
            entry = dataclasses.replace(entry, in_rig=options.in_rig == "yes")
        holder = profile.serial_of(entry.name) if entry.name else None
        if options.name:
            holder = next((other for other, name in called.items() if name == entry.name and other != serial), holder)
        if holder not in (None, serial):
            raise InputError(Phrase("error-name-taken", {"camera": holder, "name": repr(entry.name)}))
        profile = profile.with_entry(entry)
    write_profile(options.profile, profile)
    return profile
