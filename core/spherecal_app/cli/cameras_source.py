"""The cameras that a command works with: their source, their settings, and drivers (.cti) that were never allowed."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal_app.cli.console import answer, say
from spherecal_cameras import builtin_driver
from spherecal_cameras.builtin_driver import answering, driver_advice, unlisted
from spherecal_cameras.camera_settings import CameraProfile, default_profile_path, read_profile
from spherecal_cameras.genicam.discovery import producer_files
from spherecal_cameras.genicam.trust import Ask, Driver, TrustStore, who_may_change
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


def asked_before(producers: Sequence[str]) -> Ask | None:
    """Ask at the terminal about every driver that is new or has changed, before any is loaded; None without one."""
    if not (sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()):
        return None
    store = TrustStore()
    looked = [store.look(file) for file in producer_files(producers)]
    answers = {driver.file: _yes(driver) for driver in looked if driver.state in ("new", "changed")}
    return lambda driver: answers.get(driver.file, False)


def _yes(driver: Driver) -> bool:
    why = "is new" if driver.state == "new" else "has changed since you allowed it"
    print(
        f"The camera driver {driver.file} {why}.\nA driver is a program: load it only if you or your administrator "
        f"installed it.\nIts SHA-256 is {driver.sha256}.\nLoad it, now and from now on? [y/N] ",
        end="",
        file=sys.stderr,
        flush=True,
    )
    return sys.stdin.readline().strip().lower() in ("y", "yes", "j", "ja")


def advice_for(discovery: Discovery, ask_network: bool = True) -> list[str]:
    """Who answers on the wire or the bus although no driver lists it, and what makes it usable, in sentences."""
    seen = unlisted(discovery, answering(ask_network))
    return [phrase(one) for one in driver_advice(seen, builtin_driver.state())]


def trust(options: argparse.Namespace) -> int:
    """`spherecal cameras trust`."""
    store = TrustStore()
    if not options.files:
        for file, digest in sorted(store.allowed().items()):
            say(f"{digest}  {file}")
    for file in options.files:
        if options.forget:
            say(f"{file}: {'forgotten' if store.forget(file) else 'was not on the list'}.")
        else:
            if not Path(file).is_file():
                raise InputError(Phrase("error-no-driver-file", {"file": file}))
            driver = store.look(file)
            if driver.state == "unreadable":
                raise InputError(Phrase("error-driver-unreadable", {"file": file}))
            if driver.state == "unsafe":
                values = {"file": file, "who": who_may_change(driver.file), "driver": str(driver.file)}
                raise InputError(Phrase("error-driver-unsafe", values))
            if driver.state != "own":
                store.allow(driver)
            say(f"{file}: allowed.")
    answer(options, {"allowed": store.allowed()})
    return 0
