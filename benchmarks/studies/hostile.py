"""Trust boundaries: hostile inputs, writers side by side, Ctrl-C at any moment, drivers exchanged while looked at."""

import os
import tempfile
from collections import defaultdict
from pathlib import Path

from benchmarks.studies.hostile_drivers import flip_drivers
from benchmarks.studies.hostile_tries import MOST_MB, MOST_S, hostile_tries, interrupts, writers
from benchmarks.studies.report import Report

TRIES = 20_000


def report(runs: int | None = None) -> Report:
    """The page; `runs` hostile inputs, and the other series in proportion to what is demanded of them."""
    tries = runs or TRIES
    share = tries / TRIES
    page = Report("Hostile surroundings", f"python3 dev.py studies hostile --runs {tries}")
    with tempfile.TemporaryDirectory(dir=os.environ.get("HOSTILE_IN")) as made:
        root = Path(made)
        (root / "tries").mkdir()
        _tries(page, tries, root / "tries")
        _writers(page, max(round(1000 * share), 5), root)
        (root / "interrupts").mkdir()
        _interrupts(page, max(round(500 * share), 5), root / "interrupts")
        _drivers(page, max(round(200 * share), 3), root)
    return page


def _tries(page: Report, number: int, root: Path) -> None:
    found = hostile_tries(number, root)
    page.heading("Hostile inputs")
    page.text(
        f"{found.done} inputs with one to three hostile changes each: names that lead elsewhere, links to the user's "
        "files and folders, pipes, devices, loops, files of 12 GB, absurd values; and outputs that are links, pipes, "
        "folders with the user's files. Every command runs in a process of its own, on a file system with canaries."
    )
    by_name: dict[str, dict[int, int]] = defaultdict(dict)
    for (name, code), times in found.codes.items():
        by_name[name][code] = times
    page.table(
        ("command", "tries", "done (0)", "refused (2)", "not valid (3)", "other"),
        [
            (name, sum(codes.values()), *(codes.get(code, 0) for code in (0, 2, 3)),
             sum(times for code, times in codes.items() if code not in (0, 2, 3)))
            for name, codes in sorted(by_name.items())
        ],
    )  # fmt: skip
    page.text(f"Slowest: {found.slowest_s:.1f} s. Most memory: {found.largest_mb:.0f} MB.")
    for problem in found.problems[:20]:
        page.text(f"- `{' '.join(problem.split())[:700]}`")
    goal = f"no traceback, nothing changed outside, under {MOST_S:.0f} s and {MOST_MB:.0f} MB"
    page.verdict(goal, not found.problems, f"{len(found.problems)} wrong")


def _writers(page: Report, rounds: int, root: Path) -> None:
    page.heading("Writers side by side")
    rows, wrong = [], []
    for kind in ("output", "project", "profile"):
        for count in (2, 3):
            found = writers(rounds, root / f"{kind}{count}", kind, count)
            rows.append((kind, count, found.rounds, found.successes, found.refusals, len(found.problems)))
            wrong += found.problems
    page.table(("what", "writers", "rounds", "reported as done", "refused", "wrong"), rows)
    for problem in wrong[:10]:
        page.text(f"- `{problem[:500]}`")
    page.verdict(
        "every round one whole result, true exit codes, readers see old or new", not wrong, f"{len(wrong)} wrong"
    )


def _interrupts(page: Report, number: int, root: Path) -> None:
    found = interrupts(number, root)
    page.heading("Ctrl-C")
    page.text(
        f"{found.tries} runs of `calibrate` interrupted at a random moment: exit codes "
        + ", ".join(f"{code}: {times}" for code, times in sorted(found.codes.items()))
        + f". {found.before_the_program} came before the first line of the program, while Python itself was starting "
        "(ended by the signal, which shells show as 130, or with Python's own traceback)."
    )
    for problem in found.problems[:10]:
        page.text(f"- `{problem[:500]}`")
    page.verdict("130 and nothing left, or 0 and a whole result", not found.problems, f"{len(found.problems)} wrong")


def _drivers(page: Report, number: int, root: Path) -> None:
    page.heading("Drivers")
    rows = []
    for in_place in (False, True):
        folder = root / f"drivers{in_place}"
        folder.mkdir()
        found = flip_drivers(number, folder, in_place)
        rows.append(("file" if in_place else "link", found.tries, found.allowed_loaded, found.loaded_unchecked))
    page.table(("exchanged", "searches", "allowed one loaded", "other one loaded"), rows)
    page.verdict("no driver is loaded that was not allowed", not any(r[3] for r in rows), f"{sum(r[3] for r in rows)}")
