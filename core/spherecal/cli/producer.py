"""`spherecal cameras build-producer`, `simulate-producer` and `simulate-gige`."""

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.errors import InputError, SpherecalError
from spherecal.cli import gige
from spherecal.cli.answer import answer
from spherecal.data.findings import counted

if TYPE_CHECKING:
    from spherecal.cameras.producer.feed import RigFeed


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The commands' options; `add` makes a command of the group `cameras`."""
    build = add(
        "build-producer",
        "Build a GenTL producer (.cti): of simulated cameras, or with --aravis of GigE Vision and USB3 Vision cameras "
        "of any maker; needs a C++ compiler.",
    )
    build.add_argument("--aravis", action="store_true", help="for real cameras, by libaravis (Linux; libaravis-dev)")
    build.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="also put a copy into this folder")

    simulate = add(
        "simulate-producer",
        "Let any GenICam program see the cameras of a session through the simulated producer, until Ctrl-C. Commands "
        "read from standard input: the name of a placement or bar pose, unplug SERIAL, plug SERIAL, pulse, quit.",
    )
    simulate.add_argument("session", nargs="?", type=Path, metavar="SESSION", help="default: the demo's session")
    simulate.add_argument("--show", metavar="SCENE", help="placement or bar pose to begin with (default: the first)")
    simulate.add_argument(
        "--running", action="store_true", help="change the scene of the cameras that run already, and return"
    )
    gige.add_parser(add)


def run(options: argparse.Namespace) -> int:
    """The command that was asked for."""
    return COMMANDS[options.kind](options)


def build_producer(options: argparse.Namespace) -> int:
    """`spherecal cameras build-producer`."""
    from spherecal.cameras.producer.build import build_producer as built
    from spherecal.cli.commands import out
    from spherecal.cli.main import DONE

    path = built(options.output, options.aravis)
    answer(options, {"producer": path})
    out.print(f"{'GigE Vision and USB3 Vision' if options.aravis else 'Simulated cameras'}: {path}", markup=False)
    out.print(_how_to_find(path.parent), markup=False)
    return DONE


def simulate_producer(options: argparse.Namespace) -> int:
    """`spherecal cameras simulate-producer`: returns at `quit`, Ctrl-C or the end of the process that asked."""
    from spherecal.cameras.producer.build import build_producer as built
    from spherecal.cameras.producer.feed import RigFeed
    from spherecal.cameras.producer.region import default_name
    from spherecal.cli.commands import out
    from spherecal.cli.main import DONE

    if options.running:
        with RigFeed(options.session or _demo_folder(), default_name(), options.show, running=True) as feed:
            answer(options, _seen(feed, None))
            out.print(f"They see {feed.scene}.", markup=False)
        return DONE
    folder = built().parent
    with ended_by_signals(), RigFeed(options.session or _demo_folder(), default_name(), options.show) as feed:
        answer(options, _seen(feed, folder))
        out.print(
            f"{counted(len(feed.control.serials), 'simulated camera')}: {', '.join(feed.control.serials)}", markup=False
        )
        out.print(f"They see {feed.scene} of {', '.join(feed.scenes)}.", markup=False)
        out.print(_how_to_find(folder), markup=False)
        sys.stdout.flush()
        follow(feed, sys.stdin, lambda text: out.print(text, markup=False))
    return DONE


def _seen(feed: "RigFeed", producers: Path | None) -> dict[str, object]:
    return {"cameras": feed.control.serials, "scene": feed.scene, "scenes": feed.scenes, "producers": producers}


def follow(feed: "RigFeed", lines: Iterable[str], say: Callable[[str], None]) -> None:
    """Obey commands line by line until `quit`; when there are no more, the rig stays until the program is ended."""
    for line in lines:
        words = line.split()
        if words == ["quit"]:
            return
        try:
            if words:
                say(_obey(feed, words))
        except SpherecalError as error:
            say(str(error))
        sys.stdout.flush()
    threading.Event().wait()


def _obey(feed: "RigFeed", words: list[str]) -> str:
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
    from spherecal.cli.progress import shown_progress
    from spherecal_sim.render_session import demo_session

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


COMMANDS = {"build-producer": build_producer, "simulate-producer": simulate_producer, "simulate-gige": gige.simulate}
