"""The difference between the image of a circle's centre and the centre of its image, from the board's pose."""

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.geometry.camera import project
from spherecal_boards.board_adjustment import ViewPoses
from spherecal_boards.board_model import BoardViews


def eccentricity(views: BoardViews, poses: ViewPoses, intrinsics: FloatArray, radius_mm: float) -> FloatArray:
    """Centre of the ellipse minus image of the centre, (n,2) px, for dots of one radius; 0 where no pose is known.

    The dual of a circle about C with radius vectors a, b is a a' + b b' - C C' in homogeneous image coordinates. Its
    ellipse's centre is that conic's third column.
    """
    out = np.zeros_like(views.uv)
    for (camera, placement), found in poses.items():
        if not found:
            continue
        rows, pose = views.of(camera, placement), found[0]
        centre = views.points_mm[views.point[rows]] @ pose.rotation.T + pose.translation
        a, b = radius_mm * pose.rotation[:, 0], radius_mm * pose.rotation[:, 1]
        dual = np.outer(a, a) + np.outer(b, b) - centre[:, :, None] * centre[:, None]
        middle = np.column_stack([dual[:, :2, 2] / dual[:, 2:3, 2], np.ones(len(rows))])
        out[rows] = project(middle, intrinsics[camera]) - project(centre, intrinsics[camera])
    return out
