"""The first page of a sheet of targets: how to print, measure and place them."""

import math
from dataclasses import dataclass

from spherecal.targets.family import DOTS
from spherecal.targets.marker_set import sticker_mm
from spherecal.targets.target_set import TargetSet
from spherecal_documents.sheets.sticker_sheet import SheetDrawing, draw_sticker

BALL_DIAMETER_MM = 500.0
BALL_TARGETS = 200

_LEFT_MM = 20.0
_LINE_MM = 4.9

_TEXT = (
    ("Print", (
        "Print at 100 % (actual size); do not fit to the page. Choose the best quality and a matt, self-adhesive",
        "film: gloss mirrors the lamps into the lens and shifts the dots. A matt laminate must not be stretched.",
    )),
    ("Measure", (
        "Measure both 100 mm rulers on every sheet, from long mark to long mark, with a caliper or a glass scale,",
        "to 0.05 mm or better. Give both lengths to the program when the target set is exported: an error of the",
        "printed scale is an error of every length measured later (0.1 mm in 100 mm is 0.1 %).",
        "If sheets differ by more than 0.05 mm, the paper moved: print again.",
    )),
    ("Cut", (
        "Cut along the marks. The id below a sticker is for you only: the program reads it from the dots.",
        "Use every id once. Discard stickers with scratched, closed or joined dots.",
    )),
    ("Place", (
        "Lay the stickers flat, without folds or bubbles and without pulling; their turn and order do not matter.",
        "They must not overlap and need not be where the table says: 10 mm off is as good.",
        "About 200 on a ball of 500 mm let every camera see 50 or more. For fewer, leave out every second one.",
        "Reference bars take stickers too: note the ids, and do not use them on the ball.",
    )),
)  # fmt: skip


@dataclass(frozen=True)
class LatitudeRing:
    """Stickers on one circle of latitude: its distance from the equator along the surface, their number and spacing."""

    from_equator_mm: float
    stickers: int
    spacing_mm: float


def rings(targets: int = BALL_TARGETS, diameter_mm: float = BALL_DIAMETER_MM) -> list[LatitudeRing]:
    """Rings from the equator to the pole that spread stickers evenly over a ball.

    Rings are as far apart as the stickers on them; all but the equator's are used twice, north and south.
    """
    radius = diameter_mm / 2
    spacing = math.sqrt(4 * math.pi * radius**2 / targets)
    steps = round(math.pi * radius / 2 / spacing)
    result: list[LatitudeRing] = []
    for step in range(steps + 1):
        latitude = step / steps * math.pi / 2
        around = 2 * math.pi * radius * math.cos(latitude)
        stickers = max(round(around / spacing), 1)
        result.append(LatitudeRing(latitude * radius, stickers, around / stickers if stickers > 1 else 0.0))
    return result


def draw_instructions(drawing: SheetDrawing, target_set: TargetSet, ids: list[int]) -> None:
    """Draw the page of instructions."""
    drawing.text(_LEFT_MM, 24.0, "Coded targets", size_pt=20, bold=True)
    drawing.text(
        _LEFT_MM,
        31.0,
        f"Family {target_set.family}, {target_set.polarity}, {target_set.size_mm:g} mm, {len(ids)} targets, "
        f"ids {ids[0]} to {ids[-1]}",
        size_pt=10,
    )
    y = 41.0
    for heading, lines in _TEXT:
        drawing.text(_LEFT_MM, y, heading, size_pt=11, bold=True)
        for line in lines:
            y += _LINE_MM
            drawing.text(_LEFT_MM, y, line, size_pt=9.5)
        y += 1.7 * _LINE_MM
    _draw_rings(drawing, y)
    _draw_example(drawing, target_set, ids[0], _LEFT_MM + 105.0, y + 2.0)


def _draw_rings(drawing: SheetDrawing, y: float) -> None:
    table = rings()
    total = 2 * sum(ring.stickers for ring in table) - table[0].stickers
    title = f"{total} stickers on a ball of {BALL_DIAMETER_MM:g} mm"
    drawing.text(_LEFT_MM, y, title, size_pt=11, bold=True)
    columns = (_LEFT_MM, _LEFT_MM + 42.0, _LEFT_MM + 62.0)
    for x, heading in zip(columns, ("from equator, along the ball", "stickers", "spacing"), strict=True):
        drawing.text(x, y + 6.0, heading, size_pt=8)
    drawing.line(_LEFT_MM, y + 7.5, _LEFT_MM + 78.0, y + 7.5)
    for row, ring in enumerate(table):
        base = y + 12.0 + row * 5.2
        side = "equator" if row == 0 else f"{ring.from_equator_mm:.0f} mm up and down"
        number = f"{ring.stickers}" if row == 0 else f"2 x {ring.stickers}"
        spacing = f"{ring.spacing_mm:.0f} mm" if ring.spacing_mm else ""
        for x, text in zip(columns, (side, number, spacing), strict=True):
            drawing.text(x, base, text, size_pt=9)


def _draw_example(drawing: SheetDrawing, target_set: TargetSet, target: int, x: float, y: float) -> None:
    """One sticker with the names of its dots and the axes of its plane."""
    size = target_set.size_mm
    if size > 60.0:
        return
    draw_sticker(drawing, target_set, target, x, y)
    grey = 1.0 if target_set.polarity == "light-on-dark" else 0.0
    names = () if target_set.dictionary is not None else DOTS  # corners of a marker lie on its edge
    for place, name in zip(target_set.places(target, names), names, strict=True):
        below = 1.25 * target_set.dot_diameter_mm
        drawing.text(x + size / 2 + place[0] - 0.8 * len(name), y + size / 2 + place[1] + below, name, 6.0, grey=grey)
    foot = y + sticker_mm(target_set) + 5.0
    drawing.text(x, foot, f"id {target}, seen from the printed side", size_pt=8)
    drawing.text(x, foot + 4.0, "x right, y down, origin in the middle;", size_pt=8)
    last = "A to E: the longest distance" if names else "corners 0 to 3: clockwise from the top left"
    drawing.text(x, foot + 8.0, last, size_pt=8)
