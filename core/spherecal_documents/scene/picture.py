"""The rig in space for the report, rendered by pyvista where it is there."""

from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import SpherecalError
from spherecal.data.session import Session
from spherecal_documents.report.rig_drawing import ScenePicture
from spherecal_documents.report.style import ACCENT, BAD, CAUTION, GOOD, INK, RULE
from spherecal_documents.scene.eye import fitting_view
from spherecal_documents.scene.model import SceneData, scene_data, with_images
from spherecal_documents.scene.renderer import PictureProcess, can_render
from spherecal_documents.scene.shapes import SceneStyle, rgb
from spherecal_rigs.result_folder import Result

_SIZE_PX = (1600, 880)
_ROOM = 0.92
_PAPER = (255, 255, 255)
_IMAGE_PX = 480


def scene_picture(
    result: Result, session: Session | None, process: PictureProcess | None = None
) -> ScenePicture | None:
    """The scene of a result on white, with its session's last images; None without cameras or renderer."""
    data = scene_data(result) if can_render() else None
    if data is None:
        return None
    data = with_images(data, last_images(session) if session is not None else {})
    width, height = _SIZE_PX
    eye = fitting_view(data.every_place(), "oblique", _ROOM * width, _ROOM * height).eye(width, height)
    with process or PictureProcess() as started:
        try:
            if started.trouble():
                return None
            pixels = started.picture(data, paper_style(), eye)
        except (EOFError, OSError):
            return None
    names, places = named_places(data)
    return ScenePicture(pixels, names, eye.flat(places), data.floor.step)


def paper_style() -> SceneStyle:
    """The report's colours on white paper."""
    return SceneStyle(False, _PAPER, rgb(RULE), rgb(INK), rgb(ACCENT), rgb(GOOD), rgb(CAUTION), rgb(BAD))


def named_places(data: SceneData) -> tuple[tuple[str, ...], FloatArray]:
    """Names of cameras, placements and axes, and their places (n, 3) mm."""
    found = [(one.id, one.centre) for one in data.scene.cameras]
    found += [(one.name, one.ball_centre) for one in data.scene.placements if one.ball_centre is not None]
    found += [(letter, tip) for ((_, tip), _), letter in zip(data.reference_axes, "xyz", strict=False)]
    return tuple(name for name, _ in found), np.array([place for _, place in found], dtype=float)


def last_images(session: Session) -> Mapping[str, NDArray[np.uint8]]:
    """The last image of each camera by id, small (height, width) uint8, but for those that cannot be read."""
    from spherecal.targets.images import read_image

    last = {camera: path for placement in session.placements for camera, path in placement.images.items()}
    found = {}
    for camera, path in last.items():
        with suppress(SpherecalError):
            # every k-th pixel, as bytes
            image = read_image(path)
            step = max(1, -(-max(image.shape) // _IMAGE_PX))
            picked = np.asarray(image)[::step, ::step].astype(float)
            found[camera] = np.ascontiguousarray((picked * (255.0 / max(float(picked.max()), 1.0))).astype(np.uint8))
    return found
