"""bench.json: what is in front of the cameras, in the form of session.json; its targets.json beside it.

Bars of the owner's registry are named by their serial alone, so that a new certificate counts on every bench.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from spherecal.base.messages.values import Phrase
from spherecal.data.session import STANDARD_PLACEMENTS, Bar
from spherecal.files.atomic import make_parent, write_file_whole
from spherecal.files.bar_registry import figures_entry
from spherecal.files.json_file import json_bytes
from spherecal.files.target_set_file import write_target_set
from spherecal_rigs.ball_registry import RegisteredBall

FILE, TARGETS = "bench.json", "targets.json"
# What is measured on a sticker is read on a calliper: +-0.02 mm at each end.
CALLIPER_MM = 0.04
FORMAT, VERSION = "spherecal/session", 1  # a bench is a session without images (read_session.py)


@dataclass(frozen=True)
class BenchBar:
    """A bar of the registry on the bench: the id it has there, its serial, what it is for, in how many poses."""

    id: str
    serial: str
    role: Literal["scale", "check"]
    poses: int


@dataclass(frozen=True)
class Bench:
    """The ball, the bars, how many placements of the ball; the bars' temperature, None where it was not read."""

    ball: RegisteredBall
    bars: tuple[BenchBar, ...] = ()
    placements: int = STANDARD_PLACEMENTS
    bars_celsius: float | None = None


def bench_document(bench: Bench) -> dict[str, Any]:
    """The contents of bench.json."""
    document: dict[str, Any] = {
        "format": FORMAT, "version": VERSION, "target_set": TARGETS,
        "sphere": {"nominal_diameter_mm": bench.ball.nominal_diameter_mm},
    }  # fmt: skip
    scale = next((bar for bar in bench.bars if bar.role == "scale"), None)
    spacing = bench.ball.spacing
    if scale is not None:
        document["scale"] = {"kind": "bar", "bar": scale.id}
    elif spacing is not None:
        document["scale"] = {
            "kind": "target_spacing", "from": spacing.from_point, "to": spacing.to_point,
            "distance_mm": spacing.distance_mm, "surface": "sphere", "expanded_uncertainty_mm": CALLIPER_MM,
        }  # fmt: skip
    document["bars"] = [{"id": bar.id, "role": bar.role, "serial": bar.serial} for bar in bench.bars]
    document["placements"] = [{"id": f"P{number + 1}"} for number in range(bench.placements)]
    warm = {} if bench.bars_celsius is None else {"temperature_c": bench.bars_celsius}
    document["bar_poses"] = [
        {"id": f"{bar.id}-{number + 1:02d}", "bar": bar.id, **warm}
        for bar in sorted(bench.bars, key=lambda one: one.role != "scale")
        for number in range(bar.poses)
    ]
    return document


def write_bench(bench: Bench, folder: Path) -> Path:
    """Write bench.json and targets.json, each whole; the path of the first."""
    path = folder / FILE
    make_parent(path, Phrase("error-choose-folder"))
    write_target_set(folder / TARGETS, bench.ball.target_set)
    write_file_whole(path, json_bytes(bench_document(bench)))
    return path


def whole_bar(bar: Bar) -> dict[str, Any]:
    """A bar as session.json has it with all of its figures, so that a session keeps those it was recorded with."""
    entry = {"id": bar.id, "role": bar.role, "serial": bar.serial}
    return {key: value for key, value in entry.items() if value is not None} | figures_entry(bar)
