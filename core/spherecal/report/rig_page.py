"""The rig in pictures: cameras with their names, targets by placement, from four sides."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import Circle
from matplotlib.text import Text

from spherecal.arrays import FloatArray
from spherecal.report.document import Document
from spherecal.report.labels import Labels
from spherecal.report.result_folder import Result
from spherecal.report.rig_view import FRONT, OBLIQUE, SIDE, TOP, CameraShape, Scene, View, make_scene
from spherecal.report.sheet import Box, Sheet
from spherecal.report.style import INK, MARKS, RULE, SERIES, SMALL_PT, SOFT, TINY_PT, number

_CROWDED = 30  # cameras that four views on one page can still name
_CAMERA = "#33475b"
_GRID = "#e3e6ea"


def add_rig_pages(document: Document, result: Result) -> None:
    """The rig from above, from the front, from the side and obliquely."""
    document.begin_section("Rig and placements")
    if not result.rig.cameras:
        document.paragraph("No camera could be placed, so there is no rig to show.")
        return
    scene = make_scene(result)
    document.caption(_explanation(scene, result))
    room = document.bottom - document.y
    if len(scene.cameras) <= _CROWDED:
        upper, lower = document.box(room * 0.53), document.box(room * 0.45)
        left, right = lower.grid(1, 2, 6.0)
        top, oblique = upper.grid(1, 2, 6.0)
        boxes = [(oblique, OBLIQUE), (top, TOP), (left, FRONT), (right, SIDE)]
        for box, view in boxes:
            draw_view(document.sheet, box, scene, view, result)
        return
    for views in ((OBLIQUE, TOP), (FRONT, SIDE)):
        for box, view in zip(document.box(document.bottom - document.y).grid(2, 1, 6.0), views, strict=True):
            draw_view(document.sheet, box, scene, view, result)
        if views[0] is OBLIQUE:
            document.new_page()


def _explanation(scene: Scene, result: Result) -> str:
    def axis(row: FloatArray) -> str:
        return "(" + ", ".join(number(float(x), 3) for x in row) + ")"

    frame = "" if result.rig.reference_camera is None else f" of {result.rig.reference_camera}"
    return (
        f"Parallel views, true to scale, origin in the middle of the points. h = {axis(scene.axes[2])} in the world "
        f"frame{frame}: {scene.height_is}. a = {axis(scene.axes[0])}: the longest extent of the cameras across h; "
        f"b = {axis(scene.axes[1])} completes a right-handed frame. Marks: targets, one colour and shape a placement; "
        "circles: the fitted balls. Pyramids: directions and fields of view of the cameras, shortened. x, y, z: axes "
        "of the reference camera, the world frame."
    )


def draw_view(sheet: Sheet, box: Box, scene: Scene, view: View, result: Result) -> None:
    """One view with its title, a scale bar or axes, names of cameras and placements."""
    sheet.text(box.x, box.y + 3.0, view.name, SMALL_PT, bold=True)
    measured = bool(view.labels[0])
    inner = box.inset(9.0, 5.0, 0.5, 9.0) if measured else box.inset(0.5, 5.0, 0.5, 4.0)
    axes = sheet.axes(inner)
    bounds, mm_per_unit = _fit(axes, inner, scene, view)
    if measured:
        _measured_axes(axes, view, result.unit)
    else:
        axes.set_axis_off()
        _floor(axes, scene, view)
    targets = _draw_placements(axes, scene, view)
    _draw_cameras(axes, scene, view, result)
    obstacles = np.vstack([*targets, view.flat(np.array([c.centre for c in scene.cameras]))])
    _name_all(Labels(axes, mm_per_unit, obstacles, bounds), scene, view, result)


def _fit(axes: Axes, box: Box, scene: Scene, view: View) -> tuple[FloatArray, float]:
    """Equal scales with room around for the names; the limits (2, 2) and millimetres on paper for a unit."""
    low, high = scene.extent(view)
    if not view.labels[0]:
        corners = view.flat(_floor_corners(scene))
        low, high = np.minimum(low, corners.min(axis=0)), np.maximum(high, corners.max(axis=0))
    size = np.maximum(high - low, 1e-9)
    margin = 6.0
    scale = float(min((box.width - 2 * margin) / size[0], (box.height - 2 * margin) / size[1]))
    half = np.array([box.width, box.height]) / scale / 2
    middle = (low + high) / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    return np.array([middle - half, middle + half]), scale


def _measured_axes(axes: Axes, view: View, unit: str) -> None:
    axes.set_xlabel(f"{view.labels[0]} / {unit}", labelpad=1.5)
    axes.set_ylabel(f"{view.labels[1]} / {unit}", labelpad=1.0)
    axes.grid(color=_GRID, linewidth=0.4)
    axes.tick_params(pad=1.5)
    axes.locator_params(nbins=6)
    for label in axes.get_yticklabels():
        label.set_rotation(90)
        label.set_verticalalignment("center")


def _floor_corners(scene: Scene) -> FloatArray:
    low, high = _floor_range(scene)
    level = _floor_level(scene)
    return np.array([[x, y, level] for x in (low[0], high[0]) for y in (low[1], high[1])])


def _floor_level(scene: Scene) -> float:
    lowest = [float(p.ball_centre[2]) - p.ball_radius for p in scene.placements if p.ball_centre is not None]
    lowest += [float(p.targets[:, 2].min()) for p in scene.placements]
    return min([*lowest, *(float(c.centre[2]) for c in scene.cameras)])


def _floor_range(scene: Scene) -> tuple[FloatArray, FloatArray]:
    step = _step(scene)
    places = np.vstack([[c.centre for c in scene.cameras], *(p.targets for p in scene.placements)])[:, :2]
    return np.floor(places.min(axis=0) / step) * step, np.ceil(places.max(axis=0) / step) * step


def _step(scene: Scene) -> float:
    """A round distance of which the rig's extent has four to ten."""
    centres = np.vstack([[c.centre for c in scene.cameras], *(p.targets for p in scene.placements)])
    extent = max(float(np.ptp(centres[:, :2], axis=0).max()), 1e-6)
    power = 10.0 ** np.floor(np.log10(extent / 4))
    return float(max(step * power for step in (1, 2, 2.5, 5) if step * power <= extent / 4))


def _floor(axes: Axes, scene: Scene, view: View) -> None:
    """A grid below everything, and a plumb line from every camera down to it."""
    (low, high), level, step = _floor_range(scene), _floor_level(scene), _step(scene)
    lines = [[(x, low[1], level), (x, high[1], level)] for x in np.arange(low[0], high[0] + step / 2, step)]
    lines += [[(low[0], y, level), (high[0], y, level)] for y in np.arange(low[1], high[1] + step / 2, step)]
    axes.add_collection(LineCollection([view.flat(np.array(line)) for line in lines], colors=_GRID, linewidths=0.5))
    plumbs = [np.array([c.centre, [c.centre[0], c.centre[1], level]]) for c in scene.cameras]
    axes.add_collection(LineCollection([view.flat(line) for line in plumbs], colors=RULE, linewidths=0.5, zorder=1.5))
    axes.add_artist(
        Text(
            0.0, -0.005, f"grid of {step:g} below the lowest point", fontsize=TINY_PT, color=SOFT, parse_math=False,
            transform=axes.transAxes, verticalalignment="top",
        )
    )  # fmt: skip


def _draw_placements(axes: Axes, scene: Scene, view: View) -> list[FloatArray]:
    flat = []
    for i, placement in enumerate(scene.placements):
        colour, mark = SERIES[i % len(SERIES)], MARKS[i % len(MARKS)]
        places = view.flat(placement.targets)
        flat.append(places)
        axes.plot(
            *places.T,
            linestyle="none",
            marker=mark,
            markersize=1.7,
            markerfacecolor=colour,
            markeredgewidth=0,
            zorder=3,
        )
        if placement.ball_centre is not None:
            middle = view.flat(placement.ball_centre[None])[0]
            circle = Circle((float(middle[0]), float(middle[1])), placement.ball_radius)
            axes.add_collection(
                PatchCollection([circle], facecolors=colour + "14", edgecolors=colour, linewidths=0.5, zorder=2)
            )
    return flat


def _draw_cameras(axes: Axes, scene: Scene, view: View, result: Result) -> None:
    edges: list[FloatArray] = []
    for camera in scene.cameras:
        corners, centre = view.flat(camera.corners), view.flat(camera.centre[None])[0]
        edges += [np.vstack([corners, corners[:1]]), *(np.array([centre, corner]) for corner in corners)]
    axes.add_collection(LineCollection(edges, colors=_CAMERA, linewidths=0.5, zorder=4))
    centres = view.flat(np.array([camera.centre for camera in scene.cameras]))
    axes.plot(*centres.T, linestyle="none", marker="s", markersize=2.4, color=_CAMERA, zorder=5)
    reference = _reference(scene, result)
    if reference is not None:
        ends = reference.centre + 1.3 * scene.frustum * reference.axes
        origin = view.flat(reference.centre[None])[0]
        tips = view.flat(ends)
        axes.add_collection(LineCollection([[origin, tip] for tip in tips], colors=INK, linewidths=1.1, zorder=6))


def _reference(scene: Scene, result: Result) -> CameraShape | None:
    return next((camera for camera in scene.cameras if camera.id == result.rig.reference_camera), None)


def _name_all(labels: Labels, scene: Scene, view: View, result: Result) -> None:
    middle = view.flat(np.zeros((1, 3)))[0]
    reference = _reference(scene, result)
    if reference is not None:
        origin = view.flat(reference.centre[None])[0]
        for tip, name in zip(view.flat(reference.centre + 1.3 * scene.frustum * reference.axes), "xyz", strict=True):
            if np.linalg.norm(tip - origin) > 0.25 * scene.frustum:
                labels.put(tip, name, tip - origin, TINY_PT, INK, gap_mm=0.3)
    size = TINY_PT if len(scene.cameras) <= 2 * _CROWDED else 5.0
    for camera in scene.cameras:
        place = view.flat(camera.centre[None])[0]
        labels.put(place, camera.id, place - middle, size, _CAMERA, bold=camera is reference)
    for i, placement in enumerate(scene.placements):
        centre = placement.targets.mean(axis=0) if placement.ball_centre is None else placement.ball_centre
        place = view.flat(centre[None])[0]
        above = place + np.array([0.0, placement.ball_radius])
        labels.put(above, placement.name, np.array([0.0, 1.0]), TINY_PT, SERIES[i % len(SERIES)], bold=True, gap_mm=0.4)
