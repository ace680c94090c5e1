"""The owner's balls by name: size, targets, how large these were printed; one JSON file per user, beside the bars."""

import json
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.arrays import ByValue
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import make_parent, write_file_whole
from spherecal.files.json_file import JsonValue, json_bytes, read_json, unique
from spherecal.files.lock import locked
from spherecal.files.target_set_file import target_set_bytes, target_set_of
from spherecal.targets.target_set import TargetSet

FORMAT = "spherecal/balls"
VERSION = 1
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
    """The two dots that all targets share and that lie farthest apart, and their distance in mm as designed."""
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


def balls_path() -> Path:
    """The file: `SPHERECAL_BALLS`, else balls.json in the user's settings."""
    from platformdirs import user_config_path

    named = os.environ.get("SPHERECAL_BALLS")
    return Path(named) if named else user_config_path("spherecal", appauthor=False) / "balls.json"


def read_balls(path: Path | None = None) -> dict[str, RegisteredBall]:
    """The balls by name, in the file's order, none where there is no file; InputError where it is broken."""
    path = path or balls_path()
    if not path.exists():
        return {}
    values = read_json(path, FORMAT, VERSION).fields(("balls",))["balls"].items()
    balls = [_read_ball(value) for value in values]
    unique(values, [ball.name for ball in balls], "name")
    return {ball.name: ball for ball in balls}


def _read_ball(value: JsonValue) -> RegisteredBall:
    f = value.fields(("name", "nominal_diameter_mm", "targets"), ("spacing",))
    spacing = f["spacing"].fields(("from", "to", "distance_mm")) if "spacing" in f else None
    return RegisteredBall(
        f["name"].name(),
        f["nominal_diameter_mm"].positive("mm"),
        target_set_of(f["targets"]),
        None
        if spacing is None
        else PrintedSpacing(spacing["from"].name(), spacing["to"].name(), spacing["distance_mm"].positive("mm")),
    )


def changing_balls(path: Path | None = None) -> AbstractContextManager[None]:
    """Hold the file from reading to writing, so that no other program's change is lost; OutputError."""
    path = path or balls_path()
    make_parent(path, Phrase("error-set-balls"))
    return locked(path)


def write_balls(balls: Mapping[str, RegisteredBall], path: Path | None = None) -> None:
    """Write the file whole; OutputError where that fails."""
    path = path or balls_path()
    document = {"format": FORMAT, "version": VERSION, "balls": [_entry(ball) for ball in balls.values()]}
    make_parent(path, Phrase("error-set-balls"))
    write_file_whole(path, json_bytes(document))


def _entry(ball: RegisteredBall) -> dict[str, Any]:
    targets = json.loads(target_set_bytes(ball.target_set))
    entry: dict[str, Any] = {
        "name": ball.name,
        "nominal_diameter_mm": ball.nominal_diameter_mm,
        "targets": {key: value for key, value in targets.items() if key not in ("format", "version")},
    }
    if ball.spacing is not None:
        one = ball.spacing
        entry["spacing"] = {"from": one.from_point, "to": one.to_point, "distance_mm": one.distance_mm}
    return entry
