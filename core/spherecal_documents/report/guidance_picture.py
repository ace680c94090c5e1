"""Pictures of what the engine predicts: where to put the ball next, and the map of a length's uncertainty."""

import io
from pathlib import Path
from textwrap import wrap

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from spherecal.base.arrays import FloatArray
from spherecal.data.rig import Rig
from spherecal.files.atomic import write_file_whole
from spherecal_documents.report.rig_view import OBLIQUE, TOP, Projection, choose_axes
from spherecal_documents.report.style import INK, report_style
from spherecal_rigs.next_placement import Guidance

_CAMERA, _PAST, _BEST = "#33475b", "#8a949e", "#c8500a"
_DPI = 150


def save_guidance_picture(rig: Rig, guidance: Guidance, radius_mm: float, path: Path) -> None:
    """The candidates for the next placement, tilted and from above, coloured by what they give; the best one is drawn.

    PNG, 1800 x 840 px.
    """
    centres = np.array([camera.centre_mm for camera in rig.cameras])
    every = np.vstack([centres, guidance.placements_mm])
    axes = choose_axes(rig.cameras, centres, every)[0]
    middle = every.mean(axis=0)

    def flat(view: Projection, places: FloatArray) -> FloatArray:
        return view.flat((places - middle) @ axes.T)

    with report_style():
        figure, panels = plt.subplots(1, 2, figsize=(12, 5.6), dpi=_DPI)
        figure.subplots_adjust(left=0.02, right=0.98, bottom=0.02, top=0.84, wspace=0.05)
        shown = None
        for panel, view in zip(panels, (OBLIQUE, TOP), strict=True):
            _cameras(panel, rig, flat(view, centres))
            for name, at in zip(guidance.placements, flat(view, guidance.placements_mm), strict=True):
                panel.add_patch(Circle(tuple(at), radius_mm, fill=False, ec=_PAST, lw=1.5))
                panel.annotate(name, tuple(at), ha="center", va="center", color=_PAST, fontsize=11)
            if guidance.candidates:
                shown = _candidates(panel, guidance, flat, view, radius_mm)
            panel.set_aspect("equal")
            panel.set_title(view.name, fontsize=12, color=INK)
            panel.autoscale_view()
            panel.set_axis_off()
        if shown is not None:
            bar = figure.colorbar(shown, ax=panels, shrink=0.7, pad=0.02)
            bar.set_label("a 500 mm length after it, k = 2, mm", fontsize=11)
        figure.suptitle("\n".join(wrap(guidance.words(), 100)), fontsize=13, color=INK)
        _save(figure, path)


def _cameras(panel: Axes, rig: Rig, at: FloatArray) -> None:
    panel.plot(at[:, 0], at[:, 1], "^", color=_CAMERA, ms=9)
    for camera, place in zip(rig.cameras, at, strict=True):
        panel.annotate(camera.id, tuple(place), xytext=(0, 8), textcoords="offset points", ha="center", fontsize=10)


def _candidates(panel: Axes, guidance: Guidance, flat, view: Projection, radius_mm: float):
    """One mark a place, coloured by its best turn; the ball at the best place with the axis it is turned about."""
    best_at: dict[tuple[float, ...], float] = {}
    for c in guidance.candidates:
        key = tuple(c.centre_mm)
        best_at[key] = min(best_at.get(key, np.inf), c.expanded_mm)
    at = flat(view, np.array(list(best_at)))
    shown = panel.scatter(at[:, 0], at[:, 1], c=list(best_at.values()), cmap="viridis_r", s=90, zorder=3)
    best = guidance.candidates[0]
    middle = flat(view, best.centre_mm[None])[0]
    panel.add_patch(Circle(tuple(middle), radius_mm, fill=False, ec=_BEST, lw=3))
    if best.axis is not None:
        tip = flat(view, (best.centre_mm + 1.3 * radius_mm * best.axis)[None])[0]
        panel.annotate("", tuple(tip), tuple(middle), arrowprops={"arrowstyle": "->", "color": _BEST, "lw": 2})
        note = f"turn {best.turn_deg:.0f} deg\nabout this axis"
        above = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5}
        panel.annotate(
            note, tuple(tip), xytext=(6, -14), textcoords="offset points", color=_BEST, fontsize=10, bbox=above
        )
    return shown


def _save(figure, path: Path) -> None:
    file = io.BytesIO()
    figure.savefig(file, format="png", metadata={"Software": None})
    plt.close(figure)
    write_file_whole(path, file.getvalue())
