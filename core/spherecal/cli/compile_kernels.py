"""`spherecal compile-kernels`: numba's cache filled now, instead of during the first calibration."""

import argparse
import importlib
import json
import multiprocessing
import os
import signal
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from spherecal.base.errors import SpherecalError
from spherecal.base.messages.values import Phrase


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    one = add("compile-kernels", "Compile the numeric kernels now, instead of during the first calibration.")
    one.add_argument("--idle", action="store_true", help="only while the processor has nothing else to do")
    one.add_argument("--json", action="store_true", help="a line of JSON for every step: how many of how many")


def compile_kernels(options: argparse.Namespace) -> int:
    """`spherecal compile-kernels`."""
    from spherecal.base.kernels import state
    from spherecal.cli.commands import out
    from spherecal.cli.progress import shown_progress

    if state() != "to compile":
        print(json.dumps({"done": 1, "all": 1})) if options.json else out.print("The kernels are compiled.")
        return 0
    if options.idle:
        run_when_idle()
    with shown_progress() as context:

        def tell(done: int, count: int) -> None:
            context.check()
            context.report("compiling kernels", done / count)
            if options.json:
                print(json.dumps({"done": done, "all": count}), flush=True)

        compile_all(tell)
    if not options.json:
        out.print("The kernels are compiled.")
    return 0


def run_when_idle() -> None:
    """From now on this process and its children get the processor only when nobody else wants it."""
    if sys.platform == "win32":
        import ctypes

        kernel32 = ctypes.windll.kernel32  # pyright: ignore[reportAttributeAccessIssue]
        kernel32.SetPriorityClass(kernel32.GetCurrentProcess(), 0x40)  # IDLE_PRIORITY_CLASS
        return
    os.nice(19)
    if hasattr(os, "SCHED_IDLE"):
        with suppress(OSError):  # a container may forbid it
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def compile_all(tell: Callable[[int, int], None], trial: str = "spherecal.cli.kernel_trial") -> None:
    """Run the trial of the kernels, its parts side by side; `tell(done, all)` after every step.

    `trial` is the module with the PARTS.
    SpherecalError where a part fails. The kernels are in numba's cache afterwards, and a stamp says so.
    """
    from spherecal.base.kernels import mark_compiled, wanted

    parts = importlib.import_module(trial).PARTS
    made_from, count, done = wanted(), sum(len(steps) for steps in parts.values()), 0
    context = multiprocessing.get_context("spawn")
    running: dict[Any, tuple[str, BaseProcess]] = {}
    previous = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # children end with us
    try:
        tell(0, count)
        for name in parts:
            ours, theirs = context.Pipe(duplex=False)
            process = context.Process(target=_run_part, args=(trial, name, theirs), daemon=True)
            process.start()
            theirs.close()
            running[ours] = name, process
        while running:
            for ended in wait(list(running), timeout=0.2):
                ours: Any = ended
                name, process = running[ours]
                try:
                    said = ours.recv()
                except EOFError:  # it has ended
                    process.join()
                    del running[ours]
                    if code := process.exitcode:
                        raise SpherecalError(Phrase("error-kernels", {"part": name, "code": code})) from None
                    continue
                if isinstance(said, str):
                    raise SpherecalError(Phrase("error-kernels-why", {"part": name, "why": said}))
                done += 1
                tell(done, count)
    finally:
        for _, process in running.values():
            process.terminate()
            process.join()
        signal.signal(signal.SIGTERM, previous)
    mark_compiled(made_from)


def _run_part(trial: str, name: str, pipe: Connection) -> None:
    """One part, in a process of its own: sends None after every step, or what went wrong."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            for step in importlib.import_module(trial).PARTS[name]:
                step(Path(folder))
                pipe.send(None)
        except Exception as error:
            pipe.send(f"{type(error).__name__}: {error}")
