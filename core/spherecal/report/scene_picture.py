"""The rig in space as a picture that was rendered elsewhere (package spherecal_scene), with names on it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.data.session import Session
from spherecal.report.labels import Labels
from spherecal.report.language import label
from spherecal.report.result_folder import Result
from spherecal.report.sheet import PageBox, Sheet
from spherecal.report.style import INK, SMALL_PT, SOFT, TINY_PT

_FOOT_MM = 4.0


@dataclass(frozen=True, eq=False)
class ScenePicture:
    """`pixels` (height, width, 3) uint8; `names` at `places` (n, 2) px from its top left corner; the grid's side."""

    pixels: NDArray[np.uint8]
    names: tuple[str, ...]
    places: FloatArray
    grid_mm: float

    def height_for(self, width_mm: float) -> float:
        """The height on paper, mm, with the line below it."""
        height, width = self.pixels.shape[:2]
        return width_mm * height / width + _FOOT_MM


# What renders a result with the images of its session, where there is one; None where it cannot.
Renderer = Callable[[Result, Session | None], ScenePicture | None]


def draw_scene(sheet: Sheet, box: PageBox, picture: ScenePicture, unit: str) -> None:
    """The picture with its names, and below it how wide the grid is."""
    height, width = picture.pixels.shape[:2]
    axes = sheet.axes(box.inset(0.0, bottom=_FOOT_MM))
    axes.imshow(picture.pixels, extent=(0.0, width, -height, 0.0), aspect="auto", interpolation="antialiased")
    axes.set_axis_off()
    flat = picture.places.reshape(-1, 2) * np.array([1.0, -1.0])
    bounds, middle = np.array([[0.0, -height], [width, 0.0]]), np.array([width, -height]) / 2
    names = Labels(axes, box.width / width, flat, bounds)
    for name, place in zip(picture.names, flat, strict=True):
        names.put(place, name, place - middle, SMALL_PT, INK, bold=True, gap_mm=1.6)
    note = label("report-grid", step=picture.grid_mm, unit=unit)
    sheet.text(box.x, box.y + box.height - 1.0, note, TINY_PT, colour=SOFT)
