"""The rig in space for the report, rendered by pyvista where it is there."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from spherecal_gui import theme
from spherecal_gui.presenters.scene import SceneData, scene_data, with_images
from spherecal_gui.presenters.scene_eye import fitting_view
from spherecal_gui.presenters.scene_shapes import SceneStyle, rgb
from spherecal_gui.tasks.scene_process import render_once
from spherecal_gui.tasks.scene_renderer import can_render

if TYPE_CHECKING:
    from spherecal.report.scene_picture import ScenePicture

_SIZE_PX = (1600, 880)
_ROOM = 0.92
_PAPER = (255, 255, 255)


def scene_picture(result: Any, images: Mapping[str, Any]) -> "ScenePicture | None":
    """The scene of a result (report.result_folder) on white, with the cameras' last images; None without a renderer."""
    data = scene_data(result) if can_render() else None
    if data is None:
        return None
    from spherecal.report.scene_picture import ScenePicture

    data = with_images(data, images)
    width, height = _SIZE_PX
    eye = fitting_view(data.every_place(), "oblique", _ROOM * width, _ROOM * height).eye(width, height)
    pixels = render_once(data, paper_style(), eye)
    if pixels is None:
        return None
    names, places = named_places(data)
    return ScenePicture(pixels, names, eye.flat(places), data.floor.step)


def paper_style() -> SceneStyle:
    """The light colours on white paper."""
    c = theme.LIGHT
    border, text, accent = rgb(c.border), rgb(c.text), rgb(c.accent)
    return SceneStyle(False, _PAPER, border, text, accent, rgb(c.good), rgb(c.caution), rgb(c.bad))


def named_places(data: SceneData) -> tuple[tuple[str, ...], Any]:
    """Cameras, placements and axes with their places (n, 3)."""
    found = [(one.id, one.centre) for one in data.scene.cameras]
    found += [(one.name, one.ball_centre) for one in data.scene.placements if one.ball_centre is not None]
    found += [(letter, tip) for ((_, tip), _), letter in zip(data.reference_axes, "xyz", strict=False)]
    return tuple(name for name, _ in found), np.array([place for _, place in found], dtype=float)
