"""The map of a length's uncertainty: layers of the volume, the worst direction of each place."""

from functools import partial

import numpy as np
from matplotlib.patches import Rectangle

from spherecal.base.arrays import FloatArray
from spherecal.geometry.volume_map import LengthMap
from spherecal_documents.report.language import label
from spherecal_documents.report.model import TEXT_MM, Figure
from spherecal_documents.report.sheet import PageBox, Sheet
from spherecal_documents.report.style import INK, NONE, RULE, SIZES, SMALL_PT, SOFT, TINY_PT, number

_GAP_MM = 3.0  # between layers


def length_map_figure(found: LengthMap) -> Figure | None:
    """The map as a drawing; None where its places are no cube."""
    worst = _layers(found)
    if worst is None:
        return None
    height = (TEXT_MM - _GAP_MM * (len(worst) - 1)) / len(worst) + 7.0
    return Figure(label("report-uncertainty-in-the-volume"), height, partial(_draw_layers, worst=worst, found=found))


def _layers(found: LengthMap) -> FloatArray | None:
    """The worst over the directions at each place, (n, n, n) by the map's axes; None for no cube of places."""
    side = round(len(found.places_mm) ** (1 / 3))
    if side**3 != len(found.places_mm) or side < 2:
        return None
    seen = np.isfinite(found.expanded_mm)
    worst = np.where(seen.any(axis=1), np.where(seen, found.expanded_mm, -np.inf).max(axis=1), np.nan)
    return worst.reshape(side, side, side)


def _draw_layers(sheet: Sheet, box: PageBox, worst: FloatArray, found: LengthMap) -> None:
    """The layers side by side, numbers in the squares; `worst` (n, n, n) mm."""
    side = len(worst)
    low, high = (float(f(worst[np.isfinite(worst)])) if np.isfinite(worst).any() else 1.0 for f in (np.min, np.max))
    height = (
        (found.places_mm - found.places_mm.mean(axis=0)) @ found.directions[2] if len(found.directions) > 2 else None
    )
    for k, panel in enumerate(box.inset(0, 5.0, 0, 2.0).grid(1, side, _GAP_MM)):
        name = label("report-layer", number=k + 1)
        if height is not None:
            name = f"Z {number(float(height.reshape(worst.shape)[0, 0, k]), 0, sign=True)} mm"
        sheet.text(panel.x, box.y + 3.2, name, TINY_PT, colour=SOFT)
        size = min(panel.width, panel.height)
        axes = sheet.axes(PageBox(panel.x, panel.y, size, size), xlim=(0, side), ylim=(side, 0), xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set(visible=True, color=RULE, linewidth=0.5)
        for i in range(side):
            for j in range(side):
                value = float(worst[i, j, k])
                if not np.isfinite(value):
                    axes.text(i + 0.5, j + 0.6, NONE, fontsize=TINY_PT, ha="center", va="center", color=SOFT)
                    continue
                shade = (value - low) / (high - low) if high > low else 0.0
                axes.add_patch(Rectangle((i, j), 1, 1, facecolor=SIZES(shade), linewidth=0))
                ink = "white" if shade > 0.3 else INK
                text = f"{value:.3f}".lstrip("0") if value < 10 else f"{value:.0f}"
                axes.text(
                    i + 0.5, j + 0.55, text, fontsize=min(SMALL_PT - 2.4, 4.6), ha="center", va="center", color=ink
                )
