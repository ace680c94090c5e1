"""Tries in processes of their own: hostile inputs, writers side by side, Ctrl-C at random moments."""

import gc
import hashlib
import math
import os
import random
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from benchmarks.studies.hostile_commands import Try, make_try
from benchmarks.studies.hostile_inputs import Ground, make_ground

MOST_S, MOST_MB = 20.0, 1500.0  # of processor time: what other programs take is not ours
MOST_WAIT_S = 90.0  # whoever waits takes no processor time


@dataclass
class Tries:
    """What came out: exit codes by command, the slowest and largest, and everything that must not be."""

    done: int = 0
    codes: Counter[tuple[str, int]] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=dict)
    slowest_s: float = 0.0
    largest_mb: float = 0.0
    problems: list[str] = field(default_factory=list)


def state_of(folder: Path) -> set[str]:
    """A line for each entry of a tree: name, mode, target of a link, hash of a file (size and time of a large one)."""
    lines = set()
    for path in (folder, *folder.rglob("*")):
        state = path.lstat()
        holds = ""
        if stat.S_ISLNK(state.st_mode):
            holds = os.readlink(path)
        elif stat.S_ISREG(state.st_mode) and state.st_size < 4 << 20:
            holds = hashlib.sha256(path.read_bytes()).hexdigest()
        elif stat.S_ISREG(state.st_mode):
            holds = f"{state.st_size} {state.st_mtime_ns}"
        lines.add(f"{path} {state.st_mode:o} {holds}")
    return lines


def forked(run: Callable[[], int], said: Path) -> tuple[int, float, float]:
    """Run something in a fork of this process: its exit code (-9 after MOST_S), processor seconds, memory in MB."""
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        code = 99
        try:
            output = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(output, 1)
            os.dup2(output, 2)
            sys.stdout, sys.stderr = os.fdopen(1, "w", errors="replace"), os.fdopen(2, "w", errors="replace")
            code = run()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 99
        except BaseException:
            import traceback

            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    while True:
        found, status, usage = os.wait4(child, os.WNOHANG)
        if found:
            seconds = usage.ru_utime + usage.ru_stime
            return os.waitstatus_to_exitcode(status), seconds, usage.ru_maxrss / 1024
        seconds = time.monotonic() - began
        if seconds > MOST_WAIT_S or (seconds > MOST_S and _processor_s(child) > MOST_S):
            os.kill(child, signal.SIGKILL)
            os.wait4(child, 0)
            return -9, time.monotonic() - began, 0.0
        time.sleep(0.002)


def _processor_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def hostile_tries(number: int, root: Path, seed: int = 1, until: float = math.inf, names: Sequence[str] = ()) -> Tries:
    """Give hostile inputs to every command, or those of `names`; what is outside `out` or only read must not change.

    No new try begins after the moment `until` of time.monotonic().
    """
    chance = random.Random(seed)
    home = root / "home"
    home.mkdir(exist_ok=True)
    os.environ |= {"HOME": str(home), "XDG_CONFIG_HOME": str(home / "config"), "SPHERECAL_LIMITS": str(home / "l.json")}
    _warm()
    ground = make_ground(root)
    (root / "said.txt").touch()
    gc.freeze()  # what was loaded is then not copied for every fork
    before = _outside(ground)
    tries = Tries()
    while tries.done < number and time.monotonic() < until:
        _one_try(make_try(ground, chance, names), ground, before, tries)
    return tries


def _warm() -> None:
    """Load what every try needs before the forks."""
    import cv2

    import spherecal_gui.recorded_sets  # noqa: F401

    cv2.setNumThreads(0)


def _one_try(one: Try, ground: Ground, before: set[str], tries: Tries) -> None:
    said = ground.root / "said.txt"
    given = [state_of(path) for path in one.untouched]
    code, seconds, megabytes = forked(one.run, said)
    text = said.read_text(errors="replace")
    tries.done += 1
    tries.codes[one.name, code] += 1
    tries.seconds[one.name] = tries.seconds.get(one.name, 0.0) + seconds
    tries.slowest_s, tries.largest_mb = max(tries.slowest_s, seconds), max(tries.largest_mb, megabytes)
    wrong = []
    if code not in (0, 2, 3) or "Traceback" in text:
        wrong.append(f"exit code {code}: {text[-900:]}")
    if megabytes > MOST_MB:
        wrong.append(f"{megabytes:.0f} MB")
    after = _outside(ground)
    if after != before:
        wrong.append(f"something outside was changed: {sorted(before ^ after)}")
        before ^= before ^ after  # it is said once
    if given != [state_of(path) for path in one.untouched]:
        wrong.append("an input was changed that is only read")
    if wrong:
        tries.problems.append(f"try {tries.done}, {one.name}: {'; '.join(wrong)}")


def _outside(ground: Ground) -> set[str]:
    """What no try may change: the user's files, the valid inputs, and which other files there are."""
    names = sorted(path.name for path in ground.root.iterdir() if path not in (ground.given, ground.out))
    return state_of(ground.precious) | state_of(ground.valid) | set(names)


# --- writers side by side --------------------------------------------------------------------------------------------


@dataclass
class Rounds:
    """Rounds of writers side by side: how often each reported success, and what was wrong."""

    rounds: int = 0
    successes: int = 0
    refusals: int = 0
    reads: int = 0
    problems: list[str] = field(default_factory=list)


def at_once(runs: list[Callable[[], int]], said: Path) -> list[int]:
    """Exit codes of things that run in forks at the same time."""
    start, go = os.pipe()
    children = []
    for number, run in enumerate(runs):
        child = os.fork()
        if child == 0:
            os.close(go)
            os.read(start, 1)
            code = 99
            try:
                code = run()
            except BaseException as error:
                Path(f"{said}.{number}").write_text(repr(error))
            os._exit(code)
        children.append(child)
    os.close(start)
    os.close(go)  # all begin
    return [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children]


def writers(rounds: int, root: Path, kind: str, count: int, until: float = math.inf) -> Rounds:
    """Let `count` processes write one output, project or profile at once; a reader reads meanwhile."""
    from benchmarks.studies.hostile_writers import KINDS

    root.mkdir(parents=True)
    setup, work, read, judge = KINDS[kind]
    setup(root)
    found = Rounds()
    for number in range(rounds):
        if time.monotonic() > until:
            break
        jobs = [partial(work, root, number, n) for n in range(count)]
        codes = at_once([*jobs, partial(read, root)], root / "said")
        found.rounds += 1
        found.successes += codes[:count].count(0)
        found.refusals += codes[:count].count(2)
        found.reads += 1
        problem = judge(root, number, codes[:count])
        if any(code not in (0, 2) for code in codes) or problem:
            said = [p.read_text()[:300] for p in root.glob("said.*")]
            found.problems.append(f"round {number}: {codes} {problem} {said}")
    return found


# --- Ctrl-C ----------------------------------------------------------------------------------------------------------


@dataclass
class Interrupts:
    """Ctrl-C at random moments: exit codes, how many came before the first line of the program, what was wrong."""

    tries: int = 0
    codes: Counter[int] = field(default_factory=Counter)
    before_the_program: int = 0
    problems: list[str] = field(default_factory=list)


def interrupts(number: int, root: Path, seed: int = 1, until: float = math.inf) -> Interrupts:
    """Interrupt commands from their first millisecond on; 130 and nothing left, or 0 and a whole result."""
    # a job in the background hands its deafness for Ctrl-C on to its children
    signal.signal(signal.SIGINT, signal.default_int_handler)
    chance = random.Random(seed)
    ground = make_ground(root / "ground")
    commands = {
        name: [sys.executable, "-m", "spherecal_app.cli.main", *words.format(valid=ground.valid).split()]
        for name, words in _INTERRUPTED.items()
    }
    longest, whole = {}, {}
    for name, command in commands.items():
        began = time.monotonic()
        subprocess.run([*command, str(root / name)], capture_output=True, check=True)
        longest[name] = 1.1 * (time.monotonic() - began)
        whole[name] = _names(root / name)
    found = Interrupts()
    while found.tries < number and time.monotonic() < until:
        name = chance.choice(list(commands))
        folder = Path(tempfile.mkdtemp(dir=root))
        process = subprocess.Popen(
            [*commands[name], str(folder / name)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        # half of them while the program loads
        time.sleep(chance.uniform(0.0, 0.8 if chance.random() < 0.5 else longest[name]))
        process.send_signal(signal.SIGINT)
        said = process.communicate()[1]
        found.tries += 1
        found.codes[process.returncode] += 1
        early = process.returncode == -signal.SIGINT or (
            process.returncode == 1 and "spherecal" not in said.split("File")[-1]
        )
        found.before_the_program += early  # Python itself was still starting
        if not early and (process.returncode not in (0, 130) or "Traceback" in said):
            found.problems.append(f"{name}: exit code {process.returncode}: {said[-400:]}")
        left = sorted(path.name for path in folder.iterdir())
        if left != ([name] if process.returncode == 0 else []):
            found.problems.append(f"{name}: exit code {process.returncode} and left: {left}")
        elif left and _names(folder / name) != whole[name]:
            found.problems.append(f"{name}: exit code 0 and no whole result: {_names(folder / name)}")
        shutil.rmtree(folder)
    return found


_INTERRUPTED = {
    "result": "calibrate {valid}/session --method rigid -o",
    "csv": "export {valid}/result1/rig.json --to csv -o",
    "profile": "profile save {valid}/result1 --to",
    "report.pdf": "report {valid}/result1 -o",
    "bundle.zip": "support-bundle {valid}/session --result {valid}/result1 -o",
}


def _names(place: Path) -> list[str]:
    """What a command has written: names in a folder, none for a file."""
    return sorted(path.relative_to(place).as_posix() for path in place.rglob("*")) if place.is_dir() else []
