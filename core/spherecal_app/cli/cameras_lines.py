"""The lines of GigE cameras in `spherecal cameras doctor`: shown, and the delays kept with which cameras share them."""

import argparse
from collections.abc import Sequence
from dataclasses import replace

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_app.cli.console import say
from spherecal_cameras.camera_settings import CameraProfile, write_profile
from spherecal_cameras.network_lines import LineExamination, Stagger
from spherecal_cameras.protocol import CameraSource


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
            say(f"  To share it (--stagger keeps this): {', '.join(_share(stagger) for stagger in one.staggers)}.")


def _share(stagger: Stagger) -> str:
    if stagger.packet_delay is None:
        return f"{stagger.serial} {stagger.throughput_bytes_s} bytes/s"
    before = "" if stagger.frame_delay is None else f" and before an image {stagger.frame_delay}"
    return f"{stagger.serial} after a packet {stagger.packet_delay}{before} ticks"


def keep_staggered(
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
