"""The cameras that a command works with: their source, and the user's settings for them."""

import argparse
import sys
from collections.abc import Sequence

from spherecal.base.context import Context
from spherecal_app.cli.drivers_command import asked_before
from spherecal_cameras.camera_settings import CameraProfile, default_profile_path, read_profile
from spherecal_cameras.protocol import CameraSource, Discovery
from spherecal_cameras.sources import open_source


def profile_of(options: argparse.Namespace) -> CameraProfile:
    """The camera profile that the options name, else the user's own, which they name afterwards."""
    if options.profile is None:
        options.profile = default_profile_path()
    return read_profile(options.profile)


def open_asking(name: str, producers: Sequence[str], faults: Sequence[str]) -> CameraSource:
    """A source of cameras; at a terminal the user is asked about drivers that were never allowed."""
    return open_source(name, producers, faults, asked_before(producers) if name == "genicam" else None)


def open_named(options: argparse.Namespace, profile: CameraProfile) -> CameraSource:
    """The source that the options name."""
    return open_asking(options.source, (*options.producer, *profile.producers), options.fault)


def discovered(source: CameraSource, context: Context) -> Discovery:
    """The cameras of a source; where they are not real, that is said."""
    discovery = source.discover(context)
    if source.label:
        print(source.label, file=sys.stderr)
    return discovery


def ask(text: str) -> bool:
    """Wait for Enter; False at the end of input."""
    print(text, end="", file=sys.stderr, flush=True)
    return bool(sys.stdin.readline())
