"""The lines of GigE cameras in `spherecal cameras doctor`: shown, and the delays kept with which cameras share them."""

import argparse
from collections.abc import Sequence
from dataclasses import replace

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_app.cli.console import say
from spherecal_cameras.network_lines import LineExamination, examine_lines, load_of
from spherecal_cameras.profile import CameraProfile, write_profile
from spherecal_cameras.protocol import CameraSource, Discovery, features_of


def examined(source: CameraSource, discovery: Discovery, rate_hz: float) -> tuple[LineExamination, ...]:
    """The lines of the GigE cameras that a source has open; none where there are no such cameras."""
    serials = [info.serial for info in discovery.cameras if info.transport in ("GEV", "GigEVision")]
    if source.kind != "genicam" or not serials:
        return ()
    loads = {serial: load_of(features_of(source, serial), rate_hz) for serial in serials}
    return examine_lines({serial: load for serial, load in loads.items() if load is not None})


def well(lines: Sequence[LineExamination]) -> bool:
    """Whether nothing is wrong with them."""
    return all(finding.severity == "info" for line in lines for finding in line.findings)


def show(lines: Sequence[LineExamination]) -> None:
    """A sentence for every line, and the delays with which its cameras would share it."""
    for one in lines:
        line = one.line
        speed = "speed unknown" if line.mbit_s is None else f"{line.mbit_s:.0f} Mbit/s"
        say(
            f"{line.interface} ({line.address}, {speed}, packets to {line.mtu} bytes): {len(one.cameras)} GigE cameras "
            f"want {one.wanted_bytes_s * 8e-6:.0f} Mbit/s."
        )
        if one.staggers:
            delays = ", ".join(f"{s.serial} {s.packet_delay} {s.frame_delay}" for s in one.staggers)
            say(f"  To share it (camera, GevSCPD, GevSCFTD in ticks; --stagger keeps them): {delays}.")


def keep_staggered(
    options: argparse.Namespace, profile: CameraProfile, source: CameraSource, lines: Sequence[LineExamination]
) -> None:
    """Write the proposed delays into the profile and the cameras."""
    staggers = [stagger for line in lines for stagger in line.staggers]
    if not staggers:
        raise InputError(Phrase("error-no-delays"))
    changed = {}
    for stagger in staggers:
        entry = profile.entry(stagger.serial)
        settings = replace(entry.settings, packet_delay=stagger.packet_delay, frame_delay=stagger.frame_delay)
        profile = profile.with_entry(replace(entry, settings=settings))
        changed[stagger.serial] = settings
    write_profile(options.profile, profile)
    source.apply(changed)
