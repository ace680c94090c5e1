"""Bright spots that stay where they are while the ball is moved: reflections and lamps, to be masked."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.targets.masks import Rectangle, masked

_KNOWN = 20  # dots by which it is known where the ball is in an image
_SHARE = 0.9  # of the dots: one that is read elsewhere in the room says nothing of the ball
# Of the distance within which they lie from their median. The ball's rim is at 1.1, and where half of it is seen, the
# far rim at 1.9.
_RIM, _FAR = 1.2, 2.0
_BRIGHT = 0.5  # of what is bright on the ball itself
_LARGEST = 0.01  # of the image: what is larger is a wall or a window, behind which the ball may come to lie
_MOST = 8  # in one image
_MARGIN_PX = 2


def staying_spots(images: Sequence[NDArray[np.uint8]], dots: Sequence[FloatArray]) -> tuple[Rectangle, ...]:
    """Bright spots of one camera that stay where they are while the ball is moved, the largest first, px.

    `images`: grey values (height, width), one of each placement; `dots`: where targets were read in it, (n, 2) px. Of
    the ball itself, and of anything that was read as a target, nothing is a spot, whether it was moved or not.
    """
    seen = [(image, uv) for image, uv in zip(images, dots, strict=True) if len(uv) >= _KNOWN]
    if len(seen) < 2:
        return ()
    shape = seen[0][0].shape
    stays, beside, far = np.ones(shape, bool), np.zeros(shape, int), np.zeros(shape, bool)
    rows, columns = np.indices(shape, dtype=np.float32)
    for image, uv in seen:
        u, v = np.median(uv, axis=0)
        from_ball = np.hypot(columns - u, rows - v)
        reach = np.quantile(np.hypot(*(uv - (u, v)).T), _SHARE) + 1.0
        stays &= (from_ball <= _RIM * reach) | (image >= _BRIGHT * np.quantile(image[from_ball <= reach], 0.99))
        beside += from_ball > _RIM * reach
        far |= from_ball > _FAR * reach  # once at least: what was never seen but near the ball may be its own
    _, labels, found, _ = cv2.connectedComponentsWithStats((stays & (beside > 0)).astype(np.uint8))
    known = np.unique(labels[stays & far & (beside > 1)]).tolist()
    spots, places = [], found.tolist()
    for left, top, width, height, area in sorted((places[k] for k in known), key=lambda one: -one[4]):
        spot = (left - _MARGIN_PX, top - _MARGIN_PX, width - 1 + 2 * _MARGIN_PX, height - 1 + 2 * _MARGIN_PX)
        is_target = sum(masked(uv, [spot]).any() for _, uv in seen) > 1  # of a bar that lies there; one is of the ball
        if area <= _LARGEST * stays.size and not is_target:
            spots.append(spot)
    return tuple(spots[:_MOST])
