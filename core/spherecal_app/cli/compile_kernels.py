"""`spherecal compile-kernels`: numba's cache filled now, instead of during the first calibration."""

import argparse
import ctypes
import importlib
import json
import logging
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import cast

from spherecal.base.context import Context
from spherecal.base.errors import Cancelled, SpherecalError
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import is_installed
from spherecal_app.cli.console import out, shown_progress
from spherecal_app.kernel_state import is_marked, mark_compiled, state, wanted

log = logging.getLogger("spherecal")
_Tell = Callable[[int, int], None]  # done, all
_Finish = Callable[[_Tell], None]
_TRIAL = "spherecal_app.cli.kernel_trial"


def compile_kernels(options: argparse.Namespace) -> int:
    """`spherecal compile-kernels`."""
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
        kernel32 = ctypes.windll.kernel32  # pyright: ignore[reportAttributeAccessIssue]
        kernel32.SetPriorityClass(kernel32.GetCurrentProcess(), 0x40)  # IDLE_PRIORITY_CLASS
        return
    os.nice(19)
    if hasattr(os, "SCHED_IDLE"):
        with suppress(OSError):  # a container may forbid it
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def compile_all(tell: Callable[[int, int], None], trial: str = _TRIAL) -> None:
    """Run the parts of the kernels' trial side by side into numba's cache; `tell(done, all)` after every step."""
    made_from = wanted()
    with _side_by_side(trial, "PARTS") as finish:
        finish(tell)
    mark_compiled(made_from)


@contextmanager
def demo_kernels(context: Context) -> Iterator[None]:
    """Compile what the demo needs beside what the body does, where that has not been done yet."""
    made_from = f"demo{wanted()}"
    if state() != "to compile" or is_marked(made_from):
        yield
        return

    def tell(done: int, count: int) -> None:
        context.check()
        context.report("compiling kernels", done / count)

    with _side_by_side(_TRIAL, "DEMO") as finish:
        yield
        _mark_when_done(finish, tell, made_from)


def compile_first(context: Context, trial: str = _TRIAL) -> None:
    """Compile once what a calibration needs, where an installed wheel has not; dev.py does so for a checkout."""
    made_from = f"calibration{wanted()}"
    trying = multiprocessing.parent_process() is not None  # a part of the trial calibrates
    if not is_installed() or trying or state() != "to compile" or is_marked(made_from) or is_marked(f"demo{wanted()}"):
        return

    def tell(done: int, count: int) -> None:
        context.check()
        context.report("compiling kernels, once", min(done / count, 1.0), f"{done} functions")

    with _side_by_side(trial, "CALIBRATION") as finish:
        _mark_when_done(finish, tell, made_from)


def _mark_when_done(finish: _Finish, tell: _Tell, made_from: str) -> None:
    """Wait for the parts, and remember that all is compiled; of a part that failed, whoever needs them compiles."""
    try:
        finish(tell)
    except Cancelled:
        raise
    except SpherecalError as error:
        log.warning("%s", error)
    else:
        mark_compiled(made_from)


@contextmanager
def _side_by_side(trial: str, table: str) -> Iterator[_Finish]:
    """Run a table of the trial, a process a part, ended with the body; yields what waits, calling `tell(done, all)`."""
    tables = importlib.import_module(trial)
    parts, functions = getattr(tables, table), getattr(tables, f"{table}_FUNCTIONS", 0)
    count = functions or sum(len(steps) for steps in parts.values())
    context = multiprocessing.get_context("spawn")
    running: dict[Connection, tuple[str, BaseProcess]] = {}

    def finish(tell: Callable[[int, int], None]) -> None:
        done = 0
        tell(done, count)
        while running:
            for ended in wait(list(running), timeout=0.2):
                ours = cast(Connection, ended)
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

    with tempfile.TemporaryDirectory() as folder:
        try:
            for name in parts:
                ours, theirs = context.Pipe(duplex=False)
                arguments = (trial, table, name, Path(folder), theirs)
                process = context.Process(target=_run_part, args=arguments, daemon=True)
                with _ctrl_c_blocked():
                    process.start()
                theirs.close()
                running[cast(Connection, ours)] = name, process  # PipeConnection on Windows
            yield finish
        finally:
            for _, process in running.values():
                process.terminate()
                process.join()


@contextmanager
def _ctrl_c_blocked() -> Iterator[None]:
    """Ctrl-C comes afterwards; a process started meanwhile never gets it: its parent ends it."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _tell_of_functions(pipe: Connection) -> None:
    """From now on None is sent after every function that numba compiles in this process."""
    event = importlib.import_module("numba.core.event")

    class Told(event.Listener):
        def on_start(self, event: object) -> None:
            pass

        def on_end(self, event: object) -> None:
            pipe.send(None)

    event.register("numba:compile", Told())


def _end_with_parent() -> None:
    """End this process when its parent has gone without ending it: killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run_part(trial: str, table: str, name: str, folder: Path, pipe: Connection) -> None:
    """One part, in a process and a folder of its own: sends None after every step, or what went wrong."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent too, which ends us
    threading.Thread(target=_end_with_parent, daemon=True).start()
    own = folder / name
    try:
        own.mkdir()
        tables = importlib.import_module(trial)
        functions = hasattr(tables, f"{table}_FUNCTIONS")
        if functions:
            _tell_of_functions(pipe)
        for step in getattr(tables, table)[name]:
            step(own)
            if not functions:
                pipe.send(None)
    except Exception as error:
        pipe.send(f"{type(error).__name__}: {error}")
