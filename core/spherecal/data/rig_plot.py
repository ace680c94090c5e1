"""A rig drawn in space with matplotlib."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from spherecal.base.errors import InputError, needing
from spherecal.base.messages.values import Phrase
from spherecal.data.rig_camera import RigCamera

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d.axes3d import Axes3D

_FRUSTUM = 0.3  # its length over the median distance of the cameras from their middle
_EDGES = (0, 1, 2, 0, 3, 4, 0, 2, 3, 4, 1)  # one line through centre (0) and corners (1 to 4)


def plot_cameras(cameras: Sequence[RigCamera], reference: str | None, ax: Any = None) -> "Axes3D":
    """The cameras as frusta with their ids, in mm in the world, equal scales; the axes, new ones where `ax` is None."""
    if not cameras:
        raise InputError(Phrase("error-nothing-to-draw"))
    with needing("matplotlib", "Rig.plot"):
        import matplotlib.pyplot as plt
    axes = plt.figure().add_subplot(projection="3d") if ax is None else ax
    if not hasattr(axes, "plot3D"):
        raise InputError(Phrase("error-axes-in-space"))
    centres = np.array([camera.centre_mm for camera in cameras])
    spread = float(np.median(np.linalg.norm(centres - centres.mean(axis=0), axis=1))) or 1000.0
    drawn = []
    for camera, centre in zip(cameras, centres, strict=True):
        width, height = camera.image_size
        corners = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]]) - (0.5, 0.5, 0)
        rays = corners @ np.linalg.inv(camera.K).T * _FRUSTUM * spread
        places = np.vstack([centre, centre + rays @ camera.rotation])
        drawn.append(places)
        first = camera.id == reference
        axes.plot(*places[list(_EDGES)].T, color="tab:red" if first else "tab:blue", linewidth=1.5 if first else 1)
        x, y, z = centre
        axes.text(x, y, z, camera.id)
    every = np.vstack(drawn)
    middle, reach = (every.min(axis=0) + every.max(axis=0)) / 2, np.ptp(every, axis=0).max() / 2
    for name, at in zip("xyz", middle, strict=True):
        getattr(axes, f"set_{name}lim")(at - reach, at + reach)
        getattr(axes, f"set_{name}label")(f"{name} mm")
    axes.set_box_aspect((1, 1, 1))
    return axes
