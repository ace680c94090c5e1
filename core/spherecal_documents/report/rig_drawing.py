"""Drawings of the rig: a picture of the scene, or lines."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import Circle
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.messages.catalogue import phrase
from spherecal.data.session import Session
from spherecal_documents.report import style
from spherecal_documents.report.language import label, language_now
from spherecal_documents.report.model import TEXT_MM, Block, Figure, Paragraph
from spherecal_documents.report.rig_view import FRONT, OBLIQUE, SIDE, TOP, DrawnRig, Projection, make_scene
from spherecal_rigs.result_folder import Result

_FOOT_MM = 4.0


@dataclass(frozen=True, eq=False)
class ScenePicture:
    """`pixels` (height, width, 3) uint8; `names` at `places` (n, 2) px from its top left corner; the grid's side."""

    pixels: NDArray[np.uint8]
    names: tuple[str, ...]
    places: FloatArray
    grid_mm: float

    def height_for(self, width_mm: float) -> float:
        """The height on paper, mm, with the line below it."""
        height, width = self.pixels.shape[:2]
        return width_mm * height / width + _FOOT_MM


# What renders a result with the images of its session, where there is one; None where it cannot.
Renderer = Callable[[Result, Session | None], ScenePicture | None]


def draw_scene(sheet: style.Sheet, box: style.PageBox, picture: ScenePicture, unit: str) -> None:
    """The picture with its names, and below it how wide the grid is."""
    height, width = picture.pixels.shape[:2]
    axes = sheet.axes(box.inset(0.0, bottom=_FOOT_MM))
    axes.imshow(picture.pixels, extent=(0.0, width, -height, 0.0), aspect="auto", interpolation="antialiased")
    axes.set_axis_off()
    flat = picture.places.reshape(-1, 2) * np.array([1.0, -1.0])
    bounds, middle = np.array([[0.0, -height], [width, 0.0]]), np.array([width, -height]) / 2
    names = style.Labels(axes, box.width / width, flat, bounds)
    for name, place in zip(picture.names, flat, strict=True):
        names.put(place, name, place - middle, style.SMALL_PT, style.INK, bold=True, gap_mm=1.6)
    note = label("report-grid", step=picture.grid_mm, unit=unit)
    sheet.text(box.x, box.y + box.height - 1.0, note, style.TINY_PT, colour=style.SOFT)


_CROWDED = 12  # cameras that four views on one page can still name
_MANY_PLACEMENTS = 6
_GAP_MM = 6.0  # between views
_MARGIN_MM = 6.0  # around what is shown, for the names
_LONGEST_NAME_MM = 24.0
_HIGHEST_MM = 105.0  # two drawings on a page
_TOGETHER_MM = 2.2  # cameras nearer than this share a name
_CAMERA = "#33475b"
_GRID = "#e3e6ea"


def rig_blocks(result: Result, picture: ScenePicture | None) -> tuple[Block, ...]:
    """The rig, of at least one camera, from above, from the front, from the side and obliquely, or as a `picture`."""
    scene = make_scene(result)
    caption = Paragraph(_explanation(scene, result), "note")
    rows: tuple[tuple[Projection, ...], ...] = ((OBLIQUE, TOP), (FRONT, SIDE))
    figures: list[Figure] = []
    if picture is not None:
        draw = partial(draw_scene, picture=picture, unit=result.unit)
        figures = [Figure(label("report-rig-and-placements"), picture.height_for(TEXT_MM), draw)]
        rows = ((TOP, FRONT, SIDE),)
    if len(scene.cameras) > _CROWDED or len(scene.placements) > _MANY_PLACEMENTS:
        rows = tuple((view,) for row in rows for view in row)
    return caption, *figures, *(_figure(scene, row, result) for row in rows)


def _figure(scene: DrawnRig, views: Sequence[Projection], result: Result) -> Figure:
    """Views side by side."""
    width = (TEXT_MM - (len(views) - 1) * _GAP_MM) / len(views)

    def draw(sheet: style.Sheet, box: style.PageBox) -> None:
        for place, view in zip(box.grid(1, len(views), _GAP_MM), views, strict=True):
            sheet.text(place.x, place.y + 3.0, phrase(view.name, language_now()), style.SMALL_PT, bold=True)
            measured = bool(view.labels[0])
            inner = place.inset(*_frame(view))
            axes = sheet.axes(inner)
            bounds, mm_per_unit = _fit(axes, inner, scene, view)
            if measured:
                _measured_axes(axes, inner, view, result.unit)
            else:
                axes.set_axis_off()
                _floor(axes, scene, view)
                note = label("report-grid", step=_step(scene), unit=result.unit)
                sheet.text(place.x, place.y + place.height - 1.0, note, style.TINY_PT, colour=style.SOFT)
            targets = _draw_placements(axes, scene, view)
            _draw_cameras(axes, scene, view)
            frusta = [
                view.flat(part)
                for c in scene.cameras
                for part in (c.centre[None], c.corners, (c.corners + c.centre) / 2)
            ]
            obstacles = np.vstack([*targets, *frusta])
            _name_all(style.Labels(axes, mm_per_unit, obstacles, bounds), scene, view, mm_per_unit)

    name = ", ".join(phrase(view.name, language_now()) for view in views)
    return Figure(name, min(max(_height(width, scene, view) for view in views), _HIGHEST_MM), draw)


def _height(width: float, scene: DrawnRig, view: Projection) -> float:
    """The height that a view needs to fill this width."""
    low, high = _limits(scene, view)
    left, top, right, foot = _frame(view)
    scale = (width - left - right - 2 * _MARGIN_MM) / float(high[0] - low[0])
    return float(high[1] - low[1]) * scale + 2 * _MARGIN_MM + top + foot


def _frame(view: Projection) -> tuple[float, float, float, float]:
    """Room for titles and axes: left, top, right, foot."""
    return (9.0, 6.5, 4.0, 9.0) if view.labels[0] else (0.5, 5.0, 0.5, 4.0)


def _explanation(scene: DrawnRig, result: Result) -> str:
    def axis(row: FloatArray) -> str:
        return "(" + ", ".join(style.number(float(x), 3) for x in row) + ")"

    a, b, h = map(axis, scene.axes)
    camera = result.rig.reference_camera or style.NONE
    return label("report-views-caption", h=h, camera=camera, height=scene.height_is, a=a, b=b)


def _fit(axes: Axes, box: style.PageBox, scene: DrawnRig, view: Projection) -> tuple[FloatArray, float]:
    """Equal scales with room around for the names; the limits (2, 2) and millimetres on paper for a unit."""
    low, high = _limits(scene, view)
    size = high - low
    scale = float(min((box.width - 2 * _MARGIN_MM) / size[0], (box.height - 2 * _MARGIN_MM) / size[1]))
    half = np.array([box.width, box.height]) / scale / 2
    middle = (low + high) / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    return np.array([middle - half, middle + half]), scale


def _limits(scene: DrawnRig, view: Projection) -> tuple[FloatArray, FloatArray]:
    low, high = scene.extent(view)
    if not view.labels[0]:
        near, far = _floor_range(scene)
        level = _floor_level(scene)
        corners = view.flat(np.array([[x, y, level] for x in (near[0], far[0]) for y in (near[1], far[1])]))
        low, high = np.minimum(low, corners.min(axis=0)), np.maximum(high, corners.max(axis=0))
    return low, np.maximum(high, low + 1e-6)


def _measured_axes(axes: Axes, box: style.PageBox, view: Projection, unit: str) -> None:
    axes.set_xlabel(f"{view.labels[0]} / {unit}", labelpad=1.5)
    axes.set_ylabel(f"{view.labels[1]} / {unit}", labelpad=1.0)
    axes.grid(color=_GRID, linewidth=0.4)
    axes.tick_params(pad=1.5)
    axes.locator_params(axis="x", nbins=max(2, min(6, int(box.width / 14))))
    axes.locator_params(axis="y", nbins=max(2, min(6, int(box.height / 14))))
    for tick in axes.get_yticklabels():
        tick.set_rotation(90)
        tick.set_verticalalignment("center")


def _floor_level(scene: DrawnRig) -> float:
    lowest = [float(p.ball_centre[2]) - p.ball_radius for p in scene.placements if p.ball_centre is not None]
    lowest += [float(p.targets[:, 2].min()) for p in scene.placements]
    return min([*lowest, *(float(c.centre[2]) for c in scene.cameras)])


def _floor_range(scene: DrawnRig) -> tuple[FloatArray, FloatArray]:
    places = np.vstack([[c.centre for c in scene.cameras], *(p.targets for p in scene.placements)])[:, :2]
    margin = 0.3 * scene.frustum
    return places.min(axis=0) - margin, places.max(axis=0) + margin


def _step(scene: DrawnRig) -> float:
    """A round distance of which the rig's extent has four to ten."""
    centres = np.vstack([[c.centre for c in scene.cameras], *(p.targets for p in scene.placements)])
    extent = max(float(np.ptp(centres[:, :2], axis=0).max()), 1e-6)
    power = 10.0 ** np.floor(np.log10(extent / 4))
    return float(max(step * power for step in (1, 2, 2.5, 5) if step * power <= extent / 4))


def _floor(axes: Axes, scene: DrawnRig, view: Projection) -> None:
    """A grid below everything, and a plumb line from every camera down to it."""
    (low, high), level, step = _floor_range(scene), _floor_level(scene), _step(scene)
    across, along = ([low[k], *np.arange(np.ceil(low[k] / step) * step, high[k], step), high[k]] for k in (0, 1))
    lines = [[(x, low[1], level), (x, high[1], level)] for x in across]
    lines += [[(low[0], y, level), (high[0], y, level)] for y in along]
    axes.add_collection(LineCollection([view.flat(np.array(line)) for line in lines], colors=_GRID, linewidths=0.5))
    plumbs = [np.array([c.centre, [c.centre[0], c.centre[1], level]]) for c in scene.cameras]
    axes.add_collection(
        LineCollection([view.flat(line) for line in plumbs], colors=style.RULE, linewidths=0.5, zorder=1.5)
    )


def _draw_placements(axes: Axes, scene: DrawnRig, view: Projection) -> list[FloatArray]:
    flat = []
    for i, placement in enumerate(scene.placements):
        colour, mark = style.SERIES[i % len(style.SERIES)], style.MARKS[i % len(style.MARKS)]
        places = view.flat(placement.targets)
        flat.append(places)
        axes.plot(
            *places.T, linestyle="none", marker=mark, markersize=1.7, markerfacecolor=colour, markeredgewidth=0,
            zorder=3,
        )  # fmt: skip
        if placement.ball_centre is not None:
            middle = view.flat(placement.ball_centre[None])[0]
            circle = Circle((float(middle[0]), float(middle[1])), placement.ball_radius)
            axes.add_collection(
                PatchCollection([circle], facecolors=colour + "0c", edgecolors=colour, linewidths=0.6, zorder=2)
            )
    return flat


def _draw_cameras(axes: Axes, scene: DrawnRig, view: Projection) -> None:
    edges: list[FloatArray] = []
    for camera in scene.cameras:
        corners, centre = view.flat(camera.corners), view.flat(camera.centre[None])[0]
        edges += [np.vstack([corners, corners[:1]]), *(np.array([centre, corner]) for corner in corners)]
    axes.add_collection(LineCollection(edges, colors=_CAMERA, linewidths=0.5, zorder=4))
    centres = view.flat(np.array([camera.centre for camera in scene.cameras]))
    axes.plot(*centres.T, linestyle="none", marker="s", markersize=2.4, color=_CAMERA, zorder=5)
    for camera in scene.cameras:
        if camera.id == scene.reference:
            origin, tips = view.flat(camera.centre[None])[0], view.flat(scene.axis_tips(camera))
            axes.add_collection(
                LineCollection([[origin, tip] for tip in tips], colors=style.INK, linewidths=1.1, zorder=6)
            )


def _name_all(labels: style.Labels, scene: DrawnRig, view: Projection, mm_per_unit: float) -> None:
    reference = next((camera for camera in scene.cameras if camera.id == scene.reference), None)
    if reference is not None:
        origin = view.flat(reference.centre[None])[0]
        for tip, name in zip(view.flat(scene.axis_tips(reference)), "xyz", strict=True):
            if np.linalg.norm(tip - origin) > 0.25 * scene.frustum:
                labels.put(tip, name, tip - origin, style.TINY_PT, style.INK, gap_mm=0.3)
    size = style.TINY_PT if len(scene.cameras) <= 5 * _CROWDED else 5.0
    middle = view.flat(np.zeros((1, 3)))[0]
    for place, ids in _together(scene, view, mm_per_unit):
        name = ", ".join(ids) if len(ids) <= 3 else f"{ids[0]}, {ids[1]} +{len(ids) - 2}"
        name = style.shortened(name, _LONGEST_NAME_MM, size)
        is_reference = scene.reference in ids
        labels.put(place, name, place - middle, size, _CAMERA, bold=is_reference, always=is_reference)
    many = len(scene.placements) > _MANY_PLACEMENTS
    for i, placement in enumerate(scene.placements):
        centre = placement.targets.mean(axis=0) if placement.ball_centre is None else placement.ball_centre
        above = view.flat(centre[None])[0] + np.array([0.0, placement.ball_radius])
        colour, size = style.SERIES[i % len(style.SERIES)], 5.0 if many else style.TINY_PT
        name = style.shortened(placement.name, _LONGEST_NAME_MM, size)
        labels.put(above, name, np.array([0.0, 1.0]), size, colour, bold=not many, gap_mm=0.4, always=not many)


def _together(scene: DrawnRig, view: Projection, mm_per_unit: float) -> list[tuple[FloatArray, list[str]]]:
    """The cameras' places in the view; those that coincide there are taken together, the reference camera first."""
    groups: list[tuple[FloatArray, list[str]]] = []
    for camera in sorted(scene.cameras, key=lambda camera: camera.id != scene.reference):
        place = view.flat(camera.centre[None])[0]
        for other, ids in groups:
            if np.linalg.norm(place - other) * mm_per_unit < _TOGETHER_MM:
                ids.append(camera.id)
                break
        else:
            groups.append((place, [camera.id]))
    return groups
