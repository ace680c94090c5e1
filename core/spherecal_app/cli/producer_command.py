"""`spherecal cameras build-producer`, `simulate-producer` and `simulate-gige`: simulated cameras for other programs."""

import argparse
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError, SpherecalError
from spherecal.data.findings import counted
from spherecal_app.cli.console import answer, say, shown_progress
from spherecal_app.cli.exit_codes import CANCELLED, DONE
from spherecal_cameras.builtin_driver import prepare
from spherecal_gentl.gige.gige_control import FAULTS, MOST_CAMERAS, GigeCamera, GigeRig
from spherecal_gentl.producer.build_producer import build_producer as built
from spherecal_gentl.producer.producer_control import RigFeed, SessionScenes
from spherecal_gentl.producer.region import default_name
from spherecal_sim.render_session import demo_session, render_session
from spherecal_sim.rigs import PRESETS


def build_producer(options: argparse.Namespace) -> int:
    """`spherecal cameras build-producer`."""
    path = prepare() if options.aravis and options.use else built(options.output, options.aravis)
    answer(options, {"producer": path})
    say(f"{'GigE Vision and USB3 Vision' if options.aravis else 'Simulated cameras'}: {path}")
    say("Every search for cameras finds it from now on." if options.use else _how_to_find(path.parent))
    return DONE


def simulate_producer(options: argparse.Namespace) -> int:
    """`spherecal cameras simulate-producer`: returns at `quit`, Ctrl-C or the end of the process that asked."""
    if options.running:
        with RigFeed(options.session or _demo_folder(), default_name(), options.show, running=True) as feed:
            answer(options, _seen(feed, None))
            say(f"They see {feed.scene}.")
        return DONE
    folder = built().parent
    with ended_by_signals(), RigFeed(options.session or _demo_folder(), default_name(), options.show) as feed:
        answer(options, _seen(feed, folder))
        say(f"{counted(len(feed.control.serials), 'simulated camera')}: {', '.join(feed.control.serials)}")
        say(f"They see {feed.scene} of {', '.join(feed.scenes)}.")
        say(_how_to_find(folder))
        sys.stdout.flush()
        follow(partial(obeyed, feed), sys.stdin, say)
    return DONE


def _seen(feed: RigFeed, producers: Path | None) -> dict[str, object]:
    return {"cameras": feed.control.serials, "scene": feed.scene, "scenes": feed.scenes, "producers": producers}


def follow(obey: Callable[[list[str]], str], lines: Iterable[str], tell: Callable[[str], None]) -> None:
    """Obey commands line by line until `quit`; when there are no more, the rig stays until the program is ended."""
    for line in lines:
        words = line.split()
        if words == ["quit"]:
            return
        try:
            if words:
                tell(obey(words))
        except SpherecalError as error:
            tell(str(error))
        sys.stdout.flush()
    threading.Event().wait()


def obeyed(feed: RigFeed, words: list[str]) -> str:
    """What a command did to the simulated cameras."""
    control = feed.control
    match words:
        case ["pulse"]:
            control.pulse()
            return "pulse"
        case ["unplug", serial]:
            control.unplug(serial)
            return f"{serial} is unplugged"
        case ["plug", serial]:
            control.plug(serial)
            return f"{serial} is plugged in"
        case [scene]:
            feed.show(scene)
            return f"They see {scene}."
    raise InputError(f"Not understood: {' '.join(words)}.", "Say a scene, unplug SERIAL, plug SERIAL, pulse or quit.")


def _demo_folder() -> Path:
    with shown_progress() as context:
        return demo_session(context)


def _how_to_find(folder: Path) -> str:
    setter = (
        f"set GENICAM_GENTL64_PATH={folder}" if sys.platform == "win32" else f"export GENICAM_GENTL64_PATH={folder}"
    )
    return f"Programs find them after: {setter}"


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Being asked to terminate is the same as Ctrl-C, and both are the ordinary end of a rig that waits."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with suppress(KeyboardInterrupt):
            yield
    finally:
        signal.signal(signal.SIGTERM, before)


_END_S = 3.0
_KILLED = 128  # and the signal's number, as shells say it


def simulate_gige(options: argparse.Namespace) -> int:
    """`spherecal cameras simulate-gige`."""
    if options.cameras is not None and not 1 <= options.cameras <= MOST_CAMERAS:
        raise InputError(f"--cameras {options.cameras}: 1 to {MOST_CAMERAS} cameras can be simulated.")
    with ExitStack() as stack:
        stack.enter_context(ended_by_signals())
        producer = built(aravis=True)
        scenes = SessionScenes(_session(options.rig, stack))
        sizes = {serial: camera.image_size for serial, camera in scenes.cameras.items()}
        count = min(len(sizes), MOST_CAMERAS) if options.cameras is None else options.cameras
        rig = stack.enter_context(GigeRig([GigeCamera(s[:15], *sizes[s]) for s in list(sizes)[:count]], options.mtu))
        scene = options.show or scenes.names[0]
        show_gige(rig, scenes, scene)
        if options.run:
            return _run_in_rig(rig, options.run, producer.parent)
        answer(
            options, {"cameras": rig.addresses, "scene": scene, "scenes": scenes.names, "producers": producer.parent}
        )
        for serial, address in rig.addresses.items():
            say(f"{serial} at {address}")
        say(f"They see {scene} of {', '.join(scenes.names)}.")
        say(f"On the rig's computer: {shlex.join(rig.inside())} COMMAND")
        say(f"Programs find the cameras there after: export GENICAM_GENTL64_PATH={producer.parent}")
        sys.stdout.flush()
        follow(partial(obeyed_gige, rig, scenes), sys.stdin, say)
    return CANCELLED if options.run else DONE  # the command's own code has been returned above


def show_gige(rig: GigeRig, scenes: SessionScenes, scene: str) -> None:
    """Let the cameras of the rig see a scene; images with more than 8 bits lose their lowest."""
    bits = scenes.bits
    images = scenes.images(scene)
    for serial in scenes.cameras:
        if serial[:15] in rig.serials:
            rig.set_image(serial[:15], (images[serial] >> (bits[serial] - 8)).astype(np.uint8))


def obeyed_gige(rig: GigeRig, scenes: SessionScenes, words: list[str]) -> str:
    """What a command did to the cameras and their network."""
    name, *rest = words
    if name in FAULTS:
        wanted = FAULTS[name].split()
        if len(rest) != len(wanted):
            raise InputError(f"{name} needs {FAULTS[name]}.")
        rig.fault(
            name,
            *[
                _number(word) if kind not in ("CAMERA", "OTHER", "CAMERA|line") else word
                for kind, word in zip(wanted, rest, strict=True)
            ],
        )
        return "done"
    if rest:
        faults = ", ".join(f"{name} {meaning}" for name, meaning in FAULTS.items())
        raise InputError(f"Not understood: {' '.join(words)}.", f"Say a scene, quit, or a fault: {faults}.")
    show_gige(rig, scenes, name)
    return f"They see {name}."


def _number(word: str) -> float:
    try:
        value = float(word)
    except ValueError as error:
        raise InputError(f"{word!r} is no number.") from error
    if not 0 <= value < 1e9:
        raise InputError(f"{word!r} is no number from 0 on.")
    return int(value) if value.is_integer() else value


def _run_in_rig(rig: GigeRig, command: str, producers: Path) -> int:
    environment = os.environ | {"GENICAM_GENTL64_PATH": str(producers)}
    program = subprocess.Popen(rig.shell(command), env=environment)
    try:
        code = program.wait()
    except KeyboardInterrupt:  # a terminal sends Ctrl-C to the command too, which may end in its own way
        with suppress(subprocess.TimeoutExpired, KeyboardInterrupt):
            program.wait(_END_S)
        if program.poll() is None:
            program.kill()
            program.wait()
            return CANCELLED
        code = program.returncode
    return code if code >= 0 else _KILLED - code


def _session(named: str | None, stack: ExitStack) -> Path:
    """The folder of the session whose cameras are to be seen; a preset is rendered."""
    if named is not None and named not in PRESETS:
        return Path(named)
    context = stack.enter_context(shown_progress())
    if named in (None, "demo"):
        return demo_session(context)
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="spherecal-gige-"))) / "session"
    render_session(named, 1, folder, context)
    return folder
