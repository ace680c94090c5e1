"""`spherecal cameras simulate-gige`: cameras that speak GigE Vision, in network namespaces of this machine."""

import argparse
import os
import shlex
import subprocess
import sys
import tempfile
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import CANCELLED, DONE
from spherecal_app.cli.producer_command import ended_by_signals, follow
from spherecal_app.cli.progress import shown_progress
from spherecal_gentl.gige.gige_control import FAULTS, MOST_CAMERAS, GigeCamera, GigeRig
from spherecal_gentl.producer.build_producer import build_producer
from spherecal_gentl.producer.feed import SessionScenes
from spherecal_sim.render_session import demo_session, render_session
from spherecal_sim.rigs import PRESETS

_END_S = 3.0
_KILLED = 128  # and the signal's number, as shells say it


def simulate(options: argparse.Namespace) -> int:
    """`spherecal cameras simulate-gige`."""
    if options.cameras is not None and not 1 <= options.cameras <= MOST_CAMERAS:
        raise InputError(f"--cameras {options.cameras}: 1 to {MOST_CAMERAS} cameras can be simulated.")
    with ExitStack() as stack:
        stack.enter_context(ended_by_signals())
        producer = build_producer(aravis=True)
        scenes = SessionScenes(_session(options.rig, stack))
        sizes = {serial: camera.image_size for serial, camera in scenes.cameras.items()}
        count = min(len(sizes), MOST_CAMERAS) if options.cameras is None else options.cameras
        rig = stack.enter_context(GigeRig([GigeCamera(s[:15], *sizes[s]) for s in list(sizes)[:count]], options.mtu))
        scene = options.show or scenes.names[0]
        show(rig, scenes, scene)
        if options.run:
            return _run(rig, options.run, producer.parent)
        answer(
            options, {"cameras": rig.addresses, "scene": scene, "scenes": scenes.names, "producers": producer.parent}
        )
        for serial, address in rig.addresses.items():
            say(f"{serial} at {address}")
        say(f"They see {scene} of {', '.join(scenes.names)}.")
        say(f"On the rig's computer: {shlex.join(rig.inside())} COMMAND")
        say(f"Programs find the cameras there after: export GENICAM_GENTL64_PATH={producer.parent}")
        sys.stdout.flush()
        follow(partial(obeyed, rig, scenes), sys.stdin, say)
    return CANCELLED if options.run else DONE  # the command's own code has been returned above


def show(rig: GigeRig, scenes: SessionScenes, scene: str) -> None:
    """Let the cameras of the rig see a scene; images with more than 8 bits lose their lowest."""
    bits = scenes.bits
    images = scenes.images(scene)
    for serial in scenes.cameras:
        if serial[:15] in rig.serials:
            rig.set_image(serial[:15], (images[serial] >> (bits[serial] - 8)).astype(np.uint8))


def obeyed(rig: GigeRig, scenes: SessionScenes, words: list[str]) -> str:
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
    show(rig, scenes, name)
    return f"They see {name}."


def _number(word: str) -> float:
    try:
        value = float(word)
    except ValueError as error:
        raise InputError(f"{word!r} is no number.") from error
    if not 0 <= value < 1e9:
        raise InputError(f"{word!r} is no number from 0 on.")
    return int(value) if value.is_integer() else value


def _run(rig: GigeRig, command: str, producers: Path) -> int:
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
