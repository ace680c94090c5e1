"""Run studies: `python3 dev.py studies [NAME ...] [--quick | --runs N]`; each writes NAME.md beside this file."""

import argparse
import sys
import time
from importlib import import_module
from pathlib import Path

from threadpoolctl import threadpool_limits

# runs, for a first look
QUICK = {
    "accuracy": 10, "misfit": 2, "shape": 2, "coverage": 20, "groups": 4, "convergence": 5, "outliers": 5,
    "detection": 1, "exports": 1, "profiles": 5, "cameras": 2,
    "diagnosis": 2, "verification": 5, "verdicts": 16, "check": 20, "fuzz": 1, "rendered": 1, "twins": 1,
    "realistic": 20, "wrong": 1, "moves": 1,
    "hostile": 200, "boards": 1, "gige": 1, "measure": 1, "markers": 1,
    "others": 1, "photographs": 1, "folds": 1,
}  # fmt: skip
NAMES = tuple(QUICK)
FOLDER = Path(__file__).resolve().parent


def main() -> int:
    """Run the named studies, all of them without a name; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(prog="dev.py studies", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--runs", type=int, help="runs instead of the study's own number")
    parser.add_argument("--quick", action="store_true", help="few runs; the pages are only as good as these")
    parser.add_argument("--to", type=Path, default=FOLDER, help="folder for the pages")
    options = parser.parse_args()
    if unknown := set(options.names) - set(NAMES):
        parser.error(f"there is no study {', '.join(sorted(unknown))}; there are {', '.join(NAMES)}")
    missed = False
    with threadpool_limits(1):
        for name in options.names or NAMES:
            begin = time.monotonic()
            runs = options.runs or (QUICK[name] if options.quick else None)
            page = import_module(f"benchmarks.studies.{name}").report(runs)
            options.to.mkdir(parents=True, exist_ok=True)
            path = page.write(options.to, name)
            print(page.page())
            print(f"{path.name} written after {time.monotonic() - begin:.0f} s\n", flush=True)
            missed |= not all(met for _, met in page.verdicts)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
