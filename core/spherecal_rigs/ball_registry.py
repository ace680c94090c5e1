"""The owner's balls by name: size, targets, how large these were printed; one JSON file per user, beside the bars."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import ByValue
from spherecal.base.messages.values import Phrase
from spherecal.files.codec import FileFormat, field, items, name, only, optional, positive, record
from spherecal.files.registry import Registry
from spherecal.files.target_set_file import TARGETS
from spherecal.targets.target_set import TargetSet

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
    """The two dots that all targets share and that are farthest apart, and their distance in mm as designed.

    Dots count only where all targets have them at the same places; None where there are no two.
    """
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
