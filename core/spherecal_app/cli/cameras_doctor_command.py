"""`spherecal cameras doctor`: lines, rates and triggers tested."""

import argparse
from collections.abc import Sequence
from dataclasses import replace

from rich.markup import escape
from rich.table import Table

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal_app.cli.cameras_source import advice_for, ask, discovered, open_named, profile_of
from spherecal_app.cli.console import answer, out, say, shown_progress
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_cameras.camera_doctor import brightness, covered_camera, examine
from spherecal_cameras.camera_network import cut_packets, found_on_wire
from spherecal_cameras.camera_settings import CameraProfile, write_profile
from spherecal_cameras.network_lines import LineExamination, Stagger, examined, shares
from spherecal_cameras.new_recording import camera_name
from spherecal_cameras.protocol import CameraError, CameraSource, Discovery
from spherecal_files.json_file import plain_fields


def doctor(options: argparse.Namespace) -> int:
    """`spherecal cameras doctor`."""
    profile = profile_of(options)
    with open_named(options, profile) as source, shown_progress() as context:
        discovery, cut = _open_all(source, profile, context)
        examination = examine(source, options.seconds, options.rate, context)
        lines = examined(source, discovery, options.rate)
        if options.stagger:
            _keep_staggered(options, profile, source, shares(source, discovery, lines))
        if options.order:
            _order_test(source, discovery, profile)
    examination = replace(examination, findings=(*examination.findings, *cut))
    of_lines = [finding for line in lines for finding in line.findings]
    well = examination.well and all(finding.severity == "info" for finding in of_lines)
    answer(options, {"source": source.kind, **plain_fields(examination), "lines": lines})
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
            escape(names[link.serial]), link.state.value, str(counted.delivered), str(counted.incomplete),
            str(counted.underrun), f"{counted.rate_hz:.1f}", wanted, link.packet_size or "-",
            link.packets_missing or "-", link.packets_resent or "-", warm,
        )  # fmt: skip
    out.print(table)
    trigger = examination.trigger
    out.print(
        f"Sets: {trigger.complete} of {trigger.sets} complete, median {trigger.median_s * 1e3:.0f} ms, "
        f"longest {trigger.longest_s * 1e3:.0f} ms."
    )
    _show_lines(lines)
    colour = {"error": "red", "warning": "yellow", "info": "blue"}
    for finding in (*examination.findings, *of_lines):
        out.print(f"[{colour[finding.severity]}]{finding.severity}[/] ", end="")
        say(f"{finding.message} {finding.hint}")
    out.print("All is well." if well else "See above for what to do.")
    return DONE if well else NOT_VALID


def _open_all(source: CameraSource, profile: CameraProfile, context: Context) -> tuple[Discovery, tuple[Finding, ...]]:
    """Discover and open every camera of the rig, and whose packets are cut; CameraError where there is none."""
    discovery = discovered(source, context)
    if not (serials := profile.rig_of(discovery.serials)):
        say(*(advice_for(discovery) if source.kind == "genicam" else ()))
        raise CameraError(Phrase("error-no-camera-found"))
    context.report("opening the cameras", 0.0)
    cut = cut_packets(found_on_wire()) if source.kind == "genicam" else ()
    source.open(serials, profile.settings())
    return discovery, cut


def _order_test(source: CameraSource, discovery: Discovery, profile: CameraProfile) -> None:
    """Ask for each lens to be covered and tell which camera that is."""
    out.print("Cover one lens at a time with your hand; an empty line with no lens covered ends the test.")
    before = brightness(source)
    names = {info.serial: camera_name(profile, info) for info in discovery.cameras}
    left = set(profile.rig_of(names))
    while left:
        if not ask("Cover a lens, then press Enter: "):
            return
        found = covered_camera(source, before)
        if found is None:
            out.print("No single image has become dark; the test ends.")
            return
        left.discard(found)
        out.print(f"That is camera {escape(names[found])} (serial {escape(found)}).")


def _show_lines(lines: Sequence[LineExamination]) -> None:
    """A sentence for every line, and the delays with which its cameras would share it."""
    for one in lines:
        line = one.line
        speed = "speed unknown" if line.mbit_s is None else f"{line.mbit_s:.0f} Mbit/s"
        say(
            f"{line.interface} ({line.address}, {speed}, packets to {line.mtu} bytes): {len(one.cameras)} GigE cameras "
            f"want {one.wanted_bytes_s * 8e-6:.0f} Mbit/s."
        )
        if one.staggers:
            say(f"  To share it (--stagger keeps this): {', '.join(_share(stagger) for stagger in one.staggers)}.")


def _share(stagger: Stagger) -> str:
    if stagger.packet_delay is None:
        return f"{stagger.serial} {stagger.throughput_bytes_s} bytes/s"
    before = "" if stagger.frame_delay is None else f" and before an image {stagger.frame_delay}"
    return f"{stagger.serial} after a packet {stagger.packet_delay}{before} ticks"


def _keep_staggered(
    options: argparse.Namespace, profile: CameraProfile, source: CameraSource, staggers: Sequence[Stagger]
) -> None:
    """Write the cameras' shares of their lines into the profile and the cameras."""
    if not staggers:
        raise InputError(Phrase("error-no-delays"))
    changed = {}
    for stagger in staggers:
        entry = profile.entry(stagger.serial)
        settings = stagger.of(entry.settings)
        profile = profile.with_entry(replace(entry, settings=settings))
        changed[stagger.serial] = settings
    write_profile(options.profile, profile)
    source.apply(changed)
