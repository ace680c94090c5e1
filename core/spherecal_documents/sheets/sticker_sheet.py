"""Sheets of stickers in PDF, with how to print and apply them."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import resource_path
from spherecal.targets.family import DOTS
from spherecal.targets.target_set import TargetSet
from spherecal_boards.board_pattern import marker_parts
from spherecal_documents.sheets.pdf_canvas import POINTS_PER_MM as MM
from spherecal_documents.sheets.pdf_canvas import PdfCanvas
from spherecal_files.filesystem import write_whole
from spherecal_files.target_set_file import marker_bits, sticker_mm

Page = Literal["A4", "Letter"]
PAGE_SIZES_MM: dict[str, tuple[float, float]] = {"A4": (210.0, 297.0), "Letter": (215.9, 279.4)}

RULER_MM = 100.0
_MARGIN_MM = 8.0  # office printers leave up to 6 mm of a sheet blank
_RULER_BAND_MM = 12.0
_GAP_MM = 2.5  # between stickers: room for the cut marks and the id, and for the knife
_HAIRLINE_MM = 0.1
HEAD_MM, LEFT_MM, FOOT_MM = _MARGIN_MM, _MARGIN_MM + _RULER_BAND_MM, _MARGIN_MM + _RULER_BAND_MM

# A printer that is off by more than this was set to fit the page, or the ruler was misread.
_LARGEST_SCALE_ERROR = 0.05


@dataclass(frozen=True)
class SheetDrawing:
    """A canvas that draws in millimetres, y down from the top of the page."""

    canvas: PdfCanvas
    height_mm: float

    def line(self, x0: float, y0: float, x1: float, y1: float, width_mm: float = _HAIRLINE_MM) -> None:
        """A black line; `x0`, `y0`, `x1`, `y1`: its ends in mm."""
        ends = (x0 * MM, (self.height_mm - y0) * MM, x1 * MM, (self.height_mm - y1) * MM)
        self.canvas.line(*ends, width_mm * MM)

    def square(self, x: float, y: float, size_mm: float, grey: float) -> None:
        """A filled square."""
        self.rectangle(x, y, size_mm, size_mm, grey)

    def rectangle(self, x: float, y: float, width_mm: float, height_mm: float, grey: float) -> None:
        """A filled rectangle."""
        bottom = (self.height_mm - y - height_mm) * MM
        self.canvas.rectangle(x * MM, bottom, width_mm * MM, height_mm * MM, grey)

    def disc(self, x: float, y: float, diameter_mm: float, grey: float) -> None:
        """A filled circle."""
        self.canvas.disc(x * MM, (self.height_mm - y) * MM, diameter_mm / 2 * MM, grey)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        size_pt: float = 6.0,
        bold: bool = False,
        grey: float = 0.0,
        turn_deg: float = 0.0,
    ) -> None:
        """A line of text; `x`, `y`: where its base line starts, in mm."""
        self.canvas.text(x * MM, (self.height_mm - y) * MM, text, size_pt, bold, grey, turn_deg)


def write_sheet(path: Path, target_set: TargetSet, page: Page = "A4") -> None:
    """Write targets as a PDF of stickers, whole, same targets same bytes; its first page says how to use them."""
    if page not in PAGE_SIZES_MM:
        raise InputError(Phrase("error-page", {"page": repr(page), "pages": list(PAGE_SIZES_MM)}))
    ids = sorted(target_set.layouts)
    if not ids:
        raise InputError(Phrase("set-empty"))
    width, height = PAGE_SIZES_MM[page]
    title = f"Coded targets {target_set.family}, {target_set.size_mm:g} mm, ids {ids[0]} to {ids[-1]}"
    canvas = PdfCanvas(title, width * MM, height * MM)
    drawing = SheetDrawing(canvas, height)
    draw_instructions(drawing, target_set, ids)
    canvas.end_page()
    side = sticker_mm(target_set)
    places = sticker_places(page, side)
    for start in range(0, len(ids), len(places)):
        batch = ids[start : start + len(places)]
        for target, (x, y) in zip(batch, places, strict=False):
            draw_sticker(drawing, target_set, target, x, y)
            # two short lines at each corner, along the sticker's edges and outside it
            near, far = 0.25, 0.25 + 0.75
            for corner_x, outward_x in ((x, -1), (x + side, 1)):
                for corner_y, outward_y in ((y, -1), (y + side, 1)):
                    drawing.line(corner_x + outward_x * near, corner_y, corner_x + outward_x * far, corner_y)
                    drawing.line(corner_x, corner_y + outward_y * near, corner_x, corner_y + outward_y * far)
            drawing.text(x + 2.0, y + side + 2.0, f"{target}", size_pt=5.0)
        draw_rulers(drawing)
        drawing.text(
            _MARGIN_MM + _RULER_BAND_MM,
            drawing.height_mm - _MARGIN_MM,
            f"{target_set.dictionary or target_set.family}, {target_set.polarity}, {target_set.size_mm:g} mm, "
            + ("" if target_set.dictionary else f"dots {target_set.dot_diameter_mm:g} mm, ")
            + f"ids {batch[0]} to {batch[-1]}; print at 100 %",
        )
        canvas.end_page()
    write_whole(Path(path), canvas.data())


def sticker_places(page: Page, size_mm: float) -> list[tuple[float, float]]:
    """Top left corners of the stickers on one page, in mm, row by row."""
    width, height = PAGE_SIZES_MM[page]
    left, top = _MARGIN_MM + _RULER_BAND_MM, _MARGIN_MM
    pitch = size_mm + _GAP_MM
    columns = int((width - _MARGIN_MM - left + _GAP_MM) // pitch)
    rows = int((height - _MARGIN_MM - _RULER_BAND_MM - top + _GAP_MM) // pitch)
    if columns < 1 or rows < 1:
        raise InputError(Phrase("error-target-page", {"size": size_mm, "page": page}))
    return [(left + column * pitch, top + row * pitch) for row in range(rows) for column in range(columns)]


def draw_sticker(drawing: SheetDrawing, target_set: TargetSet, target: int, x: float, y: float) -> None:
    """Draw one target; `x`, `y`: top left corner of its sticker, mm."""
    if target_set.dictionary is not None:  # a marker with its blank edge
        side, dark = sticker_mm(target_set), 0.0 if target_set.polarity == "dark-on-light" else 1.0
        drawing.square(x, y, side, 1.0 - dark)
        edge = (side - target_set.size_mm) / 2
        parts = marker_parts(marker_bits(target_set.dictionary, target), x + edge, y + edge, target_set.size_mm)
        for left, top, width, height, grey in parts:
            drawing.rectangle(left, top, width, height, abs(dark - grey))
        return
    dots = 1.0 if target_set.polarity == "light-on-dark" else 0.0
    size = target_set.size_mm
    drawing.square(x, y, size, 1.0 - dots)
    for place in target_set.places(target, DOTS):
        drawing.disc(x + size / 2 + place[0], y + size / 2 + place[1], target_set.dot_diameter_mm, dots)


def scaled(target_set: TargetSet, measured_horizontal_mm: float, measured_vertical_mm: float) -> TargetSet:
    """The target set as a printer whose 100 mm rulers measure this made it; sizes by the geometric mean of both."""
    across, down = measured_horizontal_mm / RULER_MM, measured_vertical_mm / RULER_MM
    for name, factor in (("horizontal", across), ("vertical", down)):
        if not abs(factor - 1) <= _LARGEST_SCALE_ERROR:
            raise InputError(Phrase("error-ruler", {"name": name, "length": RULER_MM * factor}))
    mean = (across * down) ** 0.5
    layouts: dict[int, dict[str, FloatArray]] = {
        target: {dot: place * (across, down) for dot, place in layout.items()}
        for target, layout in target_set.layouts.items()
    }
    return replace(
        target_set,
        size_mm=target_set.size_mm * mean,
        dot_diameter_mm=target_set.dot_diameter_mm * mean,
        layouts=layouts,
    )


def draw_rulers(drawing: SheetDrawing) -> None:
    """Draw the horizontal check ruler at the foot of the page and the vertical one at its left, 100 mm each."""
    left, foot = _MARGIN_MM + _RULER_BAND_MM, drawing.height_mm - _MARGIN_MM - 4.0
    right, head = _MARGIN_MM + 4.0, drawing.height_mm - _MARGIN_MM - _RULER_BAND_MM - RULER_MM - 4.0
    drawing.line(left, foot, left + RULER_MM, foot)
    drawing.line(right, head, right, head + RULER_MM)
    for step in range(0, 101, 10):
        length = 4.0 if step in (0, 100) else 1.5
        drawing.line(left + step, foot - length, left + step, foot)
        drawing.line(right, head + step, right + length, head + step)
    drawing.text(left + 12.0, foot - 2.2, "horizontal check ruler: 100 mm between the two long marks")
    caption = "vertical check ruler: 100 mm between the two long marks"
    drawing.text(right + 4.3, head + RULER_MM - 12.0, caption, turn_deg=90)


BALL_DIAMETER_MM = 500.0
BALL_TARGETS = 200

_LEFT_MM = 20.0
_LINE_MM = 4.9


@dataclass(frozen=True)
class LatitudeRing:
    """Stickers on one circle of latitude: its distance from the equator along the surface, their number and spacing."""

    from_equator_mm: float
    stickers: int
    spacing_mm: float


def rings() -> list[LatitudeRing]:
    """Rings from the equator to the pole that spread stickers evenly over a ball; all but one on both halves."""
    radius = BALL_DIAMETER_MM / 2
    spacing = math.sqrt(4 * math.pi * radius**2 / BALL_TARGETS)
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
    text = resource_path("sticker_sheet.txt").read_text(encoding="utf-8").strip()
    for heading, *lines in (section.split("\n") for section in text.split("\n\n")):
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
