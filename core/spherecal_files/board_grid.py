"""The kinds of boards, and where their points are."""

from typing import Literal, get_args

import numpy as np

from spherecal.base.arrays import FloatArray

BoardKind = Literal["circles", "asymmetric-circles", "chessboard", "charuco", "aprilgrid"]
BOARD_KINDS: tuple[BoardKind, ...] = get_args(BoardKind)


def board_grid(kind: str, rows: int, columns: int, pitch_mm: float, marker_mm: float | None) -> FloatArray:
    """Places (n, 2) mm of points row by row, x along the rows; dots and inner corners are `pitch_mm` apart.

    Every second row of `asymmetric-circles` is shifted by it (OpenCV); an `aprilgrid` has four corners a tag (Kalibr).
    """
    if kind == "aprilgrid":
        assert marker_mm is not None
        along, across = (
            np.repeat(np.arange(count) * pitch_mm, 2) + np.tile([0.0, marker_mm], count) for count in (rows, columns)
        )
    else:
        along, across = np.arange(rows) * pitch_mm, np.arange(columns) * pitch_mm
    x, y = np.tile(across, len(along)), np.repeat(along, len(across))
    if kind == "asymmetric-circles":
        x = 2 * x + np.repeat(np.arange(rows) % 2, columns) * pitch_mm
    return np.column_stack([x, y]).astype(np.float64)
