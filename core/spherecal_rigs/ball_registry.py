"""The owner's balls, and the bench: what one rig is measured with."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from spherecal.base.arrays import ByValue
from spherecal.base.messages.values import Phrase
from spherecal.data.session import STANDARD_PLACEMENTS, Bar
from spherecal.targets.target_set import TargetSet
from spherecal_files.atomic import make_parent, write_file_whole
from spherecal_files.bar_registry import figures_entry
from spherecal_files.codec import FileFormat, field, items, name, only, optional, positive, record
from spherecal_files.json_file import json_bytes
from spherecal_files.registry import Registry
from spherecal_files.target_set_file import TARGETS, write_target_set

# Printers err by 0.5 % at most (finding target-distance); a caliper on two dots of 3 mm reads to 0.1 mm of 28 mm.
USUAL_PRINT = 0.005
# More is another size of sticker, another pair of dots, or inches; sheets are refused from there as well.
WORST_PRINT = 0.05


@dataclass(frozen=True)
class PrintedSpacing:
    """Two named dots of a sticker and their distance in mm as somebody has measured it on the print."""

    from_point: str
    to_point: str
    distance_mm: float


@dataclass(frozen=True, eq=False)
class RegisteredBall(ByValue):
    """A ball as its owner knows it."""

    name: str
    nominal_diameter_mm: float
    target_set: TargetSet
    spacing: PrintedSpacing | None = None


def longest_spacing(target_set: TargetSet) -> tuple[str, str, float] | None:
    """The farthest two dots that all targets share at the same places, and their distance in mm as designed."""
    layouts = list(target_set.layouts.values())
    names = [name for name in layouts[0] if all(name in one for one in layouts)]
    places = np.array([[one[name] for name in names] for one in layouts]).reshape(len(layouts), len(names), 2)
    same = (places == places[0]).all(axis=(0, 2))
    first = dict(zip(names, places[0], strict=True))
    shared = [name for name, is_same in zip(names, same.tolist(), strict=True) if is_same]
    pairs = [(a, b, float(np.hypot(*(first[a] - first[b])))) for i, a in enumerate(shared) for b in shared[:i]]
    if not pairs:
        return None
    b, a, distance = max(pairs, key=lambda pair: pair[2])
    return a, b, distance


def print_error(target_set: TargetSet, spacing: PrintedSpacing) -> float | None:
    """By how much the print is larger than designed, relatively; None where no target has both dots."""
    for layout in target_set.layouts.values():
        if spacing.from_point in layout and spacing.to_point in layout:
            designed = float(np.hypot(*(layout[spacing.from_point] - layout[spacing.to_point])))
            return spacing.distance_mm / designed - 1 if designed > 0 else None
    return None


_SPACING = record(
    "What was measured on a printed sticker.",
    PrintedSpacing,
    field("from", name("A dot."), "from_point"),
    field("to", name("Another dot."), "to_point"),
    field("distance_mm", positive("Their distance on the print.", "mm")),
)
_BALL = record(
    "",
    RegisteredBall,
    field("name", name("The name that its owner knows it by.")),
    field("nominal_diameter_mm", positive("Its diameter, about.", "mm")),
    field("targets", TARGETS.kind.described("Its targets, as in targets.json."), "target_set"),
    optional("spacing", _SPACING, omit=None),
)
BALLS = FileFormat(
    "spherecal/balls",
    "balls.json",
    "The owner's balls, in the user's settings; `SPHERECAL_BALLS` names another file.",
    only("balls", items("The balls.", _BALL, differ="name")),
    ("Names and ids differ.", *TARGETS.rules),
    more="guide/bench.md",
)
BALL_REGISTRY = Registry(BALLS, "SPHERECAL_BALLS", "name", Phrase("error-set-balls"))


FILE, TARGETS_FILE = "bench.json", "targets.json"
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
        "format": FORMAT, "version": VERSION, "target_set": TARGETS_FILE,
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
    write_target_set(folder / TARGETS_FILE, bench.ball.target_set)
    write_file_whole(path, json_bytes(bench_document(bench)))
    return path


def whole_bar(bar: Bar) -> dict[str, Any]:
    """A bar as session.json has it with all of its figures, so that a session keeps those it was recorded with."""
    entry = {"id": bar.id, "role": bar.role, "serial": bar.serial}
    return {key: value for key, value in entry.items() if value is not None} | figures_entry(bar)
