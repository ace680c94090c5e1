"""From which sides to look at a rig: axes that suit it, and the four views as parallel projections."""

from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import RigCamera
from spherecal_documents.report.language import label
from spherecal_rigs.result_folder import Result

# Below this length of the mean of all unit view directions the cameras look all around, and it means nothing.
_COMMON_DIRECTION = 0.3
_FRUSTUM = 0.22  # length of a camera's frustum, as a part of its distance from the next placement


@dataclass(frozen=True)
class DrawnPlacement:
    """One placement's targets in the picture's frame (n, 3), and its ball if there is one."""

    name: str
    targets: FloatArray
    ball_centre: FloatArray | None
    ball_radius: float


@dataclass(frozen=True)
class CameraShape:
    """A camera in the picture's frame: centre, the four corners (4, 3) of its frustum, its three axes (3, 3) by row."""

    id: str
    centre: FloatArray
    corners: FloatArray
    axes: FloatArray


@dataclass(frozen=True)
class DrawnRig:
    """A rig in a frame of its own: origin in the middle, a, b across, h the height; rows of `axes` in the world."""

    axes: FloatArray
    height_is: str
    cameras: tuple[CameraShape, ...]
    placements: tuple[DrawnPlacement, ...]
    frustum: float
    reference: str | None

    def axis_tips(self, camera: CameraShape) -> FloatArray:
        """Where the camera's axes x, y, z end in the picture, (3, 3)."""
        return camera.centre + 1.3 * self.frustum * camera.axes

    def extent(self, view: "Projection") -> tuple[FloatArray, FloatArray]:
        """Least and largest place in a view of all that is shown, (2,) each."""
        parts = [np.vstack([c.centre, c.corners]) for c in self.cameras] + [p.targets for p in self.placements]
        parts += [self.axis_tips(c) for c in self.cameras if c.id == self.reference]
        flat = [view.flat(part) for part in parts if len(part)]
        for p in self.placements:
            if p.ball_centre is not None:
                middle = view.flat(p.ball_centre[None])
                flat += [middle - p.ball_radius, middle + p.ball_radius]
        every = np.vstack(flat)
        return every.min(axis=0), every.max(axis=0)


@dataclass(frozen=True)
class Projection:
    """A parallel projection: name, the (2, 3) matrix, names of its axes (empty for an oblique view)."""

    name: Phrase
    matrix: FloatArray
    labels: tuple[str, str]

    def flat(self, places: FloatArray) -> FloatArray:
        """Places (n, 3) in the plane of the picture, (n, 2)."""
        return places @ self.matrix.T


def _oblique() -> FloatArray:
    """Seen from the front and the right, from 28 degrees above."""
    turn, lift = np.deg2rad(-55.0), np.deg2rad(28.0)
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    towards = np.array([np.cos(turn) * np.cos(lift), np.sin(turn) * np.cos(lift), np.sin(lift)])
    return np.vstack([right, np.cross(towards, right)])


TOP = Projection(Phrase("report-view-top"), np.array([[1.0, 0, 0], [0, 1, 0]]), ("a", "b"))
FRONT = Projection(Phrase("report-view-front"), np.array([[1.0, 0, 0], [0, 0, 1]]), ("a", "h"))
SIDE = Projection(Phrase("report-view-side"), np.array([[0.0, 1, 0], [0, 0, 1]]), ("b", "h"))
OBLIQUE = Projection(Phrase("report-view-oblique"), _oblique(), ("", ""))


def make_scene(result: Result) -> DrawnRig:
    """The scene of a result with at least one camera."""
    cameras = result.rig.cameras
    centres = np.array([camera.centre_mm for camera in cameras])
    points = result.points.xyz_mm
    axes, height_is = choose_axes(cameras, centres, points)
    middle = points.mean(axis=0) if len(points) else centres.mean(axis=0)
    placements = _placements(result, axes, middle)
    # from the placement next to each
    seen = np.array([placement.targets.mean(axis=0) for placement in placements]).reshape(-1, 3)
    seen = seen if len(seen) else np.zeros((1, 3))
    distances = np.linalg.norm(((centres - middle) @ axes.T)[:, None] - seen, axis=2).min(axis=1)
    depth = _FRUSTUM * (float(np.median(distances)) or 1.0)
    return DrawnRig(
        axes, height_is, tuple(_shape(camera, axes, middle, depth) for camera in cameras), placements, depth,
        result.rig.reference_camera,
    )  # fmt: skip


def choose_axes(cameras: tuple[RigCamera, ...], centres: FloatArray, points: FloatArray) -> tuple[FloatArray, str]:
    """Three unit vectors (3, 3) in the world, and what the third, the height, is.

    Cameras that look roughly one way look down: the height is opposite to their mean view direction. Where they look
    all around, it is the normal of the plane of the cameras' places, with the sides of the images' tops as up.
    """
    views = np.array([camera.rotation[2] for camera in cameras])
    ups = np.array([-camera.rotation[1] for camera in cameras])
    common = views.mean(axis=0)
    spread = centres - centres.mean(axis=0)
    if np.linalg.norm(common) > _COMMON_DIRECTION or len(cameras) < 3:
        height, height_is = -common, label("report-opposite-to-the-mean-view")
    else:
        height = np.linalg.svd(spread)[2][2]
        height = height if height @ ups.sum(axis=0) >= 0 else -height
        height_is = label("report-normal-to-the-plane-of")
    height = _unit(height, np.array([0.0, 0, -1]))
    scatter = spread if np.abs(spread).max(initial=0) > 0 or not len(points) else points - points.mean(axis=0)
    across = scatter - np.outer(scatter @ height, height)
    first = np.linalg.svd(across, full_matrices=False)[2][0]
    first = first - (first @ height) * height
    least = np.zeros(3)
    least[int(np.argmin(np.abs(height)))] = 1.0
    a = _unit(first, np.array(np.cross(height, least), dtype=float))
    a = a if a[int(np.argmax(np.abs(a)))] > 0 else -a
    return np.vstack([a, np.cross(height, a), height]), height_is


def _unit(vector: FloatArray, otherwise: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    if length > 1e-6:
        return vector / length
    return otherwise / np.linalg.norm(otherwise)


def _shape(camera: RigCamera, axes: FloatArray, middle: FloatArray, depth: float) -> CameraShape:
    """The frustum's corners are where the corners of the image look at, without the lens's distortion."""
    width, height = camera.image_size
    fu, fv, u0, v0 = camera.intrinsics[:4]
    u, v = np.array([-0.5, width - 0.5, width - 0.5, -0.5]), np.array([-0.5, -0.5, height - 0.5, height - 0.5])
    rays = np.column_stack([(u - u0) / fu, (v - v0) / fv, np.ones(4)]) * depth
    corners = (rays - camera.translation_mm) @ camera.rotation
    return CameraShape(
        camera.id, axes @ (camera.centre_mm - middle), (corners - middle) @ axes.T, camera.rotation @ axes.T
    )


def _placements(result: Result, axes: FloatArray, middle: FloatArray) -> tuple[DrawnPlacement, ...]:
    """The targets, each the mean of its points, by placement in the order of the file."""
    points, spheres = result.points, {sphere.placement: sphere for sphere in result.spheres}
    names = np.array(points.placement, dtype=object)
    placements = []
    for name in dict.fromkeys(points.placement):
        own = names == name
        _, target = np.unique(points.target[own], return_inverse=True)
        sums = np.array([np.bincount(target, column) for column in points.xyz_mm[own].T]).T
        means = sums / np.bincount(target)[:, None]
        if len(means) == 1:  # a board whose points are one target
            means = points.xyz_mm[own]
        sphere = spheres.get(name)
        centre = None if sphere is None else axes @ (sphere.centre_mm - middle)
        radius = 0.0 if sphere is None else sphere.radius_mm
        placements.append(DrawnPlacement(name, (means - middle) @ axes.T, centre, radius))
    return tuple(placements)
