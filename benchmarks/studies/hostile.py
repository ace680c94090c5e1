"""Trust boundaries: hostile inputs and working folders, writers side by side, Ctrl-C, drivers exchanged meanwhile."""

import os
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.studies.hostile_drivers import Races, flip_drivers, kill_and_swap
from benchmarks.studies.hostile_folder import SETTINGS, Attacked, attack, starts
from benchmarks.studies.hostile_inputs import make_ground
from benchmarks.studies.hostile_tries import (
    MOST_MB,
    MOST_S,
    MOST_WAIT_S,
    Interrupts,
    Rounds,
    Tries,
    hostile_tries,
    interrupts,
    writers,
)
from benchmarks.studies.report import Report

TRIES, ROUNDS, INTERRUPTS, FLIPS = 20_000, 1000, 500, 200  # demanded
KILLS = 50
WRITERS = tuple((kind, count) for kind in ("output", "project", "profile") for count in (2, 3))


@dataclass(frozen=True)
class Found:
    """What all series gave: writers by what they write and how many they are, drivers by what is exchanged."""

    tries: Tries
    folder: Attacked
    writers: Sequence[tuple[str, int, Rounds]]
    interrupts: Interrupts
    drivers: Sequence[tuple[str, Races]]


def report(runs: int | None = None) -> Report:
    """The page; `runs` hostile inputs, and the other series in proportion to what is demanded of them."""
    tries = runs or TRIES
    share = tries / TRIES
    with tempfile.TemporaryDirectory(dir=os.environ.get("HOSTILE_IN")) as made:
        root = Path(made)
        for name in ("tries", "folder", "interrupts", "link", "file", "killed"):
            (root / name).mkdir()
        found = Found(
            hostile_tries(tries, root / "tries"),
            _attacked(share, root / "folder"),
            [(kind, n, writers(max(round(ROUNDS * share), 5), root / f"{kind}{n}", kind, n)) for kind, n in WRITERS],
            interrupts(max(round(INTERRUPTS * share), 5), root / "interrupts"),
            _races(share, root),
        )
    return page_of(found, f"python3 dev.py studies hostile --runs {tries}")


def _attacked(share: float, root: Path) -> Attacked:
    ground = make_ground(root)
    kinds = [start.kind for start in starts(ground)]
    return attack(ground, kinds[: max(round(len(kinds) * share), 3)])


def _races(share: float, root: Path) -> list[tuple[str, Races]]:
    flips = max(round(FLIPS * share), 3)
    return [
        ("a link, while looked for", flip_drivers(flips, root / "link")),
        ("the file, while looked for", flip_drivers(flips, root / "file", in_place=True)),
        ("the file, and the process killed", kill_and_swap(max(round(KILLS * share), 3), root / "killed")),
    ]


def page_of(found: Found, command: str) -> Report:
    """The page of these series."""
    page = Report("Hostile surroundings", command)
    least = min(rounds.rounds for _, _, rounds in found.writers)
    page.text(
        f"Demanded are {TRIES} inputs, {ROUNDS} rounds of each kind, {INTERRUPTS} interrupts and {FLIPS} exchanges; "
        f"done were {found.tries.done}, {least} or more, {found.interrupts.tries} and "
        f"{found.drivers[0][1].tries} and {found.drivers[1][1].tries}."
    )
    _tries(page, found.tries)
    _folder(page, found.folder)
    _writers(page, found.writers)
    _interrupts(page, found.interrupts)
    _drivers(page, found.drivers)
    return page


def _tries(page: Report, found: Tries) -> None:
    page.heading("Hostile inputs")
    page.text(
        f"{found.done} valid inputs with one to three hostile changes each (some with none, where only the output is "
        "hostile): names that lead elsewhere, links to the user's files and folders, pipes, devices, loops, files of "
        "12 GB, texts of 100 MB, absurd values, nests, repeated keys, changed bytes, archives with other people's "
        "names; and outputs that are links, pipes, the folder the command runs in, folders with the user's files. "
        "Every command runs in a process of its own, on a file system with canaries. What is only read must not change "
        "either."
    )
    by_name: dict[str, dict[int, int]] = defaultdict(dict)
    for (name, code), times in found.codes.items():
        by_name[name][code] = times
    page.table(
        ("command", "tries", "done (0)", "refused (2)", "not valid (3)", "other"),
        [
            (
                name,
                sum(codes.values()),
                *(codes.get(code, 0) for code in (0, 2, 3)),
                sum(times for code, times in codes.items() if code not in (0, 2, 3)),
            )
            for name, codes in sorted(by_name.items())
        ],
    )
    page.text(f"Slowest: {found.slowest_s:.1f} s of processor time. Most memory: {found.largest_mb:.0f} MB.")
    for problem in found.problems[:20]:
        page.text(f"- `{' '.join(problem.split())[:700]}`")
    limits = f"{MOST_S:.0f} s of processor time, {MOST_WAIT_S:.0f} s of waiting and {MOST_MB:.0f} MB"
    goal = f"no traceback, nothing changed outside, under {limits}"
    page.verdict(goal, not found.problems, f"{len(found.problems)} wrong")


def _folder(page: Report, found: Attacked) -> None:
    page.heading("The working folder")
    settings = ", ".join(SETTINGS)
    page.text(
        f"{len(found.runs)} entry points, every command and the window, each with the processes that it starts, begun "
        f"in a folder with {found.canaries} canaries and in an empty one: a module for every name of Python's library, "
        "of the installed packages and of our own, a package with plug-ins, every library of the machine by its name, "
        f"programs, and settings of {settings}. Modules and programs write their name when they are run, and inotify "
        "tells which files any process opens. Exit codes, the files written and the result's tables must be the same."
    )
    for problem in found.problems[:20]:
        page.text(f"- `{problem[:500]}`")
    goal = "none is run or opened, and nothing changes"
    page.verdict(goal, not found.problems, f"{len(found.problems)} wrong")


def _writers(page: Report, found: Sequence[tuple[str, int, Rounds]]) -> None:
    page.heading("Writers side by side")
    rows = [(kind, n, one.rounds, one.successes, one.refusals, len(one.problems)) for kind, n, one in found]
    wrong = [problem for _, _, one in found for problem in one.problems]
    page.table(("what", "writers", "rounds", "reported as done", "refused", "wrong"), rows)
    for problem in wrong[:10]:
        page.text(f"- `{problem[:500]}`")
    page.verdict(
        "every round one whole result, true exit codes, readers see old or new", not wrong, f"{len(wrong)} wrong"
    )


def _interrupts(page: Report, found: Interrupts) -> None:
    page.heading("Ctrl-C")
    page.text(
        f"{found.tries} runs of `calibrate`, `export`, `profile save`, `report` and `support-bundle` interrupted at a "
        "random moment, half of them while the program loads: exit codes "
        + ", ".join(f"{code}: {times}" for code, times in sorted(found.codes.items()))
        + f". {found.before_the_program} came before the first line of the program, while Python itself was starting "
        "(ended by the signal, which shells show as 130, or with Python's own traceback)."
    )
    for problem in found.problems[:10]:
        page.text(f"- `{problem[:500]}`")
    page.verdict("130 and nothing left, or 0 and a whole result", not found.problems, f"{len(found.problems)} wrong")


def _drivers(page: Report, found: Sequence[tuple[str, Races]]) -> None:
    page.heading("Drivers")
    rows = [(what, one.tries, one.allowed_loaded, one.loaded_unchecked) for what, one in found]
    page.table(("exchanged", "tries", "allowed one loaded", "other one loaded"), rows)
    page.text(
        "Where the process is killed, the allowed driver is the simulated producer under another name, with its camera "
        "open. The version before loaded the other driver in 6 of 20 searches with a link and in 1 of 20 with a file."
    )
    page.verdict("no driver is loaded that was not allowed", not any(r[3] for r in rows), f"{sum(r[3] for r in rows)}")
