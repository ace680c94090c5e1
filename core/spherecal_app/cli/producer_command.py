"""`spherecal cameras build-producer` and `simulate-producer`."""

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from spherecal.base.errors import InputError, SpherecalError
from spherecal.data.findings import counted
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.progress import shown_progress
from spherecal_cameras.builtin_driver import prepare
from spherecal_gentl.producer.build_producer import build_producer as built
from spherecal_gentl.producer.feed import RigFeed
from spherecal_gentl.producer.region import default_name
from spherecal_sim.render_session import demo_session


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
