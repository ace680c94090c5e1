"""What the benchmarks share: common options, and their figures kept in baseline.json."""

import argparse
import json
import os
import platform
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

BASELINE = Path(__file__).resolve().parent / "baseline.json"
_PACKAGES = ("spherecal", "numpy", "scipy", "numba", "pycolmap", "pyceres")


def add_options(parser: argparse.ArgumentParser, rigs: tuple[str, ...], rounds: int) -> None:
    """`--rigs`, `--rounds`, `--save`."""
    parser.add_argument("--rigs", nargs="+", default=rigs, metavar="RIG", help=f"default: {' '.join(rigs)}")
    parser.add_argument("--rounds", type=int, default=rounds, help=f"runs that count (default {rounds})")
    parser.add_argument("--save", action="store_true", help=f"write the figures into {BASELINE.name}")


@dataclass(frozen=True)
class Figures:
    """The figures of one benchmark."""

    name: str
    values: dict[str, object]

    def save(self, options: argparse.Namespace) -> None:
        """Put them into baseline.json, in place of the older ones of this benchmark, if the options say so."""
        if not options.save:
            return
        every = json.loads(BASELINE.read_text(encoding="utf-8")) if BASELINE.exists() else {}
        packages = {name: version(name) for name in _PACKAGES}
        every[self.name] = {"machine": machine(), "packages": packages, **_rounded(self.values)}
        BASELINE.write_text(json.dumps(every, indent=1) + "\n", encoding="utf-8")


def machine() -> str:
    """Processor kind, cores and Python, without names."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"


def _rounded(value: Any) -> Any:
    """Floats to six figures, so that the file stays readable."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value
