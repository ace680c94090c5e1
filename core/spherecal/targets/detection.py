"""Detection: the coded targets in an image, dot by dot, with standard uncertainties.

Blobs are found (blobs.py), grouped to targets and decoded (grouping.py), their dots fitted (refinement.py). The image
points are those of the centres of the dots' rims: perspective eccentricity is taken out. On a ball of radius R the rim
of a dot of radius r is r^2 / 2R below its surface, 4.5 um here, the same for all dots. A bundle of rays takes that up
as a slightly smaller ball.
"""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray, IntArray
from spherecal.targets import sticker_view as sv
from spherecal.targets.blobs import GreyImage, find_blobs
from spherecal.targets.code_reading import MISSING
from spherecal.targets.code_table import code_table
from spherecal.targets.false_positives import proven
from spherecal.targets.family import DOTS
from spherecal.targets.grouping import find_groups
from spherecal.targets.marker_set import CORNERS
from spherecal.targets.markers import USUAL_RESIDUAL_PX, find_markers, tilts_deg
from spherecal.targets.masks import Rectangle, masked
from spherecal.targets.refinement import refine
from spherecal.targets.target_set import TargetSet

# Focal length over image width where none is given: 1.1 and 1.4 in the rigs of [Tao21]. It only enters small terms:
# 20 % off shifts a dot of 10 px by 0.002 px.
_USUAL_FOCAL = 1.25
# Relative standard uncertainty of the focal length, and so of eccentricities (0.007 px where dots are 26 px wide):
# guessed as above, and from a data sheet, which allows 5 % either way.
_GUESSED, _GIVEN = 0.2, 0.03


@dataclass(frozen=True)
class DetectionSettings:
    """What is known about the camera: focal length and principal point in px; None takes usual values.

    `image_size` (width, height), where given, must be that of the image. Dots within `ignore` are left out.
    """

    focal_px: float | None = None
    principal_point_px: tuple[float, float] | None = None
    image_size: tuple[int, int] | None = None
    ignore: tuple[Rectangle, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Detections(ByValue):
    """The targets of one image, and their dots as rows.

    Dots, m rows sorted by target then point:

    - `target` (m,) id.
    - `point` (m,) index into `points`.
    - `uv` (m, 2) px with (0, 0) the centre of the top left pixel.
    - `sigma_uv` (m, 2) standard uncertainty px.

    Targets, n of them, by id:

    - `target_ids` (n,).
    - `misfit` (n,) rms of the fit's residuals over their expected noise. 1 is perfect; above 3 a target is scratched or
      blurred oddly.
    - `tilt_deg` (n,) against the line of sight.
    - `blur_px` (n,) standard deviation.
    """

    points: tuple[str, ...]
    target: IntArray
    point: IntArray
    uv: FloatArray
    sigma_uv: FloatArray
    target_ids: IntArray
    misfit: FloatArray
    tilt_deg: FloatArray
    blur_px: FloatArray

    def __len__(self) -> int:
        return len(self.target)


class Detector:
    """Finds the targets of one set in images; keeps the set's tables, which take longer to make than to use."""

    def __init__(self, target_set: TargetSet) -> None:
        self._markers = target_set if target_set.dictionary is not None else None
        if self._markers is not None:
            return
        self._table = code_table(target_set)
        self._dark_on_light = target_set.polarity == "dark-on-light"

    def detect(self, image: GreyImage, settings: DetectionSettings | None = None) -> Detections:
        """The targets in a grey image (h, w), uint8 or uint16."""
        # a part of an image or one that is read-only has a type of its own: each kernel would be compiled once more
        image = np.require(image, requirements=["C", "W"])
        if self._markers is not None:
            return _markers_in(image, self._markers, settings or DetectionSettings())
        table = self._table
        blobs = find_blobs(image, dark=self._dark_on_light)
        if len(blobs) < 2:  # numpy calls their columns contiguous, another type again: half a minute for an empty scene
            none, row = np.empty(0), np.empty((0, 2))
            return Detections(DOTS, table.ids[:0], np.empty(0, np.int64), row, row, table.ids[:0], none, none, none)
        settings = settings or DetectionSettings()
        camera = _camera(image, settings)
        groups = find_groups(blobs, table, camera)
        start = np.where((groups.blobs != MISSING)[..., None], blobs.uv[groups.blobs], np.nan)
        layouts = table.layouts[groups.target]
        focal_error = _GUESSED if settings.focal_px is None else _GIVEN
        dots = refine(image, start, layouts, table.dot_radius, groups.views, focal_error)
        complete = (groups.blobs != MISSING).all(axis=1)
        found = np.isfinite(dots.uv[..., 0]) & proven(dots, layouts, groups.views, complete, camera)[:, None]
        found &= ~masked(dots.uv, settings.ignore)
        by_id = np.argsort(table.ids[groups.target], kind="stable")
        by_id = by_id[np.asarray(found.any(axis=1))[by_id]]
        n, point = np.nonzero(found[by_id])
        n = by_id[n]
        ids = table.ids[groups.target]
        of_dots = ids[n], point, dots.uv[n, point], dots.sigma[n, point]
        tilt_deg = np.rad2deg(np.arccos(np.clip(groups.views[by_id, sv.COSINE], 0.0, 1.0)))
        return Detections(DOTS, *of_dots, ids[by_id], dots.misfit[by_id], tilt_deg, dots.blur_px[by_id])


def detect(image: GreyImage, target_set: TargetSet, settings: DetectionSettings | None = None) -> Detections:
    """The targets of a set in one grey image; for many images keep a `Detector`.

    `image`: grey image (h, w), uint8 or uint16; `settings` None is nothing.
    """
    return Detector(target_set).detect(image, settings)


def _markers_in(image: GreyImage, targets: TargetSet, settings: DetectionSettings) -> Detections:
    """The markers of a set in an image, their corners as points."""
    found = find_markers(image, targets)
    keep = np.isfinite(found.uv).all(axis=2) & ~masked(found.uv, settings.ignore)
    whole = keep.any(axis=1)
    n, point = np.nonzero(keep)
    focal, u, v = _camera(image, settings)
    matrix = np.array([[focal, 0, u], [0, focal, v], [0, 0, 1]])
    of_corners = found.ids[n], point, found.uv[n, point], found.sigma[n, point]
    misfit, tilt_deg = found.residual[whole] / USUAL_RESIDUAL_PX, tilts_deg(found.uv[whole], matrix)
    return Detections(CORNERS, *of_corners, found.ids[whole], misfit, tilt_deg, found.blur[whole])


def _camera(image: GreyImage, settings: DetectionSettings) -> FloatArray:
    height, width = image.shape
    focal = settings.focal_px or _USUAL_FOCAL * max(width, height)
    u, v = settings.principal_point_px or ((width - 1) / 2, (height - 1) / 2)
    return np.array([focal, u, v])
