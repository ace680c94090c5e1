"""The scene of each page, from what the page has, and what is said of a thing in it; advice for the next placement."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from spherecal.base.arrays import FloatArray
from spherecal_documents.scene.model import DrawnBall, SceneData, scene_data, with_bars, with_images, with_moved
from spherecal_documents.scene.shapes import map_step
from spherecal_gui.languages import translate
from spherecal_gui.standing import Level

if TYPE_CHECKING:  # imports scipy and OpenCV, for which the window does not wait
    from pathlib import Path

    from spherecal.data.rig import PlacedSphere, Rig
    from spherecal_gui.tasks.ghost import Ghost, Lying
    from spherecal_gui.tasks.outcome import Outcome
    from spherecal_rigs.check_rig import Check


def outcome_scene(outcome: "Outcome") -> SceneData | None:
    """The rig of a result (tasks.outcome), its paths, last images, and the cameras that moved since the one in use."""
    data = scene_data(outcome.result, outcome.links)
    if data is None:
        return None
    data = with_images(data, outcome.images)
    if outcome.compared is None:
        return data
    moved = [one for one in outcome.compared.comparison.cameras if one.moved and not one.replaced]
    return with_moved(data, [(one.id, one.centre_mm, one.rotation_deg) for one in moved])


def verified_scene(outcome: "Outcome") -> SceneData | None:
    """The rig with the measured bars, coloured by whether their errors are within their uncertainty."""
    data = scene_data(outcome.result)
    return None if data is None else with_bars(with_images(data, outcome.images), outcome.result.bars, outcome.places)


def rig_scene(rig: "Rig") -> SceneData | None:
    """A rig alone, such as that of a profile, which keeps no dots."""
    none = SimpleNamespace(placement=[], target=np.empty(0, dtype=np.int64), point=[], used=np.empty(0, dtype=bool))
    none.xyz_mm, none.sigma_mm, none.du_dv = np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2))
    return scene_data(SimpleNamespace(rig=rig, points=none, residuals=none, spheres=()))


def rig_in_use(profile: "Path | None", cameras: Collection[str]) -> "Rig | None":
    """The calibration in use of a profile, where it can be read and has all of these cameras; else None."""
    from spherecal.base.errors import SpherecalError
    from spherecal_rigs.store import open_profile  # imports scipy

    if profile is None or not (profile / "profile.json").is_file() or not cameras:
        return None
    try:
        rig = open_profile(profile).rig()
    except (SpherecalError, OSError):
        return None
    return rig if set(cameras) <= {camera.id for camera in rig.cameras} else None


def next_scene(rig: "Rig", spheres: "Sequence[PlacedSphere]", centre_mm: ArrayLike) -> SceneData | None:
    """The rig as it is known so far, the ball where it was and where it should go next (3,), mm in the rig's world."""
    from spherecal_documents.report.rig_view import DrawnPlacement  # imports scipy

    data = rig_scene(rig)
    if data is None or not spheres:
        return data

    def place(xyz_mm: ArrayLike) -> FloatArray:
        return data.scene.axes @ (np.asarray(xyz_mm) - data.origin_mm)

    balls = tuple(
        DrawnPlacement(one.placement, np.empty((0, 3)), place(one.centre_mm), float(one.radius_mm)) for one in spheres
    )
    last = spheres[-1]
    wanted = DrawnBall(place(centre_mm), float(last.radius_mm), place(last.centre_mm))
    return replace(data, scene=replace(data.scene, placements=balls), wanted=wanted)


def without_balls(data: SceneData) -> SceneData:
    """The rig alone, for a ball that is drawn where it lies now."""
    bare = replace(data, scene=replace(data.scene, placements=()), wanted=None)
    return replace(bare, room=replace(data, wanted=None).every_place())


@dataclass(frozen=True, eq=False)
class LiveParts:
    """What changes in a scene while it is looked at; places in the scene's frame, mm."""

    ball: tuple[FloatArray, FloatArray, float] | None = None  # centre (3,), top (3,), radius
    near: bool = False  # it lies where it should
    bars: tuple[tuple[FloatArray, bool], ...] = ()  # ends (2, 3); lies so, not: should
    levels: Mapping[str, Level] = field(default_factory=dict)
    images: Mapping[str, Any] = field(default_factory=dict)  # QImage by camera, as are the levels
    points: tuple[tuple[str, FloatArray], ...] = ()  # measured ones by name
    box: FloatArray | None = None  # corners (8, 3) of the measuring volume


def in_scene(data: SceneData, places_mm: FloatArray) -> FloatArray:
    """Places (n, 3) mm of the rig's world in the scene's frame."""
    return (places_mm - data.origin_mm) @ data.scene.axes.T


def live_ball(data: SceneData, ghost: "Ghost", lying: "Lying | None") -> tuple[FloatArray, FloatArray, float] | None:
    """The ball as it lies now, in the scene; None where it is not seen."""
    if lying is None:
        return None
    body = ghost.body
    turn = np.eye(3) if lying.turn is None else lying.turn
    top_mm = lying.centre + turn @ (body.up * body.radius_mm)
    centre, top = in_scene(data, np.stack([lying.centre, top_mm]))
    return centre, top, body.radius_mm


def check_scene(rig: "Rig", found: "Check") -> SceneData | None:
    """The calibration in use, and those cameras that a check found moved where they are now."""
    from spherecal.geometry.rotation import exp_rotation  # imports scipy

    moved = {one.test.id: one.test for one in found.cameras if one.test.moved}
    now, changes = [], []
    for camera in rig.cameras:
        test = moved.get(camera.id)
        if test is None or np.size(test.turn_rad) != 3:  # of a check that was read again only the sizes are known
            now.append(camera)
            continue
        turn = exp_rotation(np.asarray(test.turn_rad, dtype=float))
        shifted = turn @ camera.translation_mm + test.shift_mm
        there = replace(camera, rotation=turn @ camera.rotation, translation_mm=shifted)
        now.append(there)
        changes.append((camera.id, there.centre_mm - camera.centre_mm, np.degrees(test.turn_rad)))
    data = rig_scene(replace(rig, cameras=tuple(now)))
    return None if data is None else with_moved(data, changes)


@dataclass(frozen=True, eq=False)
class RigPlanes:
    """Upright and level in a rig, for words such as "up"; worked out once for a result."""

    axes: FloatArray
    names: tuple[str, ...]
    centres: FloatArray

    @staticmethod
    def of(rig: "Rig", middle: FloatArray) -> "RigPlanes":
        """Upright, as the rig is set up. `middle`: of the measuring volume (3,), mm in the rig's world."""
        from spherecal_documents.report.rig_view import choose_axes  # imports scipy

        centres = np.array([camera.centre_mm for camera in rig.cameras])
        axes = choose_axes(rig.cameras, centres, np.asarray(middle)[None])[0]
        return RigPlanes(axes, tuple(camera.id for camera in rig.cameras), centres)


# More than this says no more than "not determined yet" (the demo with one placement: 25 mm, with two 0.18 mm).
NOT_YET_MM = 5.0
# A placement that makes lengths better by less than this part is not worth a walk to the ball.
WORTH = 0.1


@dataclass(frozen=True, eq=False)
class GuidanceView:
    """One piece of advice; lengths are those of 500 mm (k = 2), None where they are not known."""

    now_mm: float | None  # when stopping now
    next_mm: float | None  # after the next placement
    ghost: "Ghost | None" = None  # the ball where it should go as the cameras would see it
    scene: SceneData | None = None  # the whole in space
    coarse: bool = False  # a first answer: the lengths are still being worked out

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras of which it is known where they are."""
        return tuple(camera.id for camera in self.scene.scene.cameras) if self.scene is not None else ()


@dataclass(frozen=True, eq=False)
class SceneItem:
    """One thing: `kind`, name, place (3,), how far it reaches in mm, its figures; `rank`: small things first."""

    kind: str
    name: str
    place: FloatArray
    radius_mm: float
    data: SceneData
    index: int
    rank: int

    def lines(self) -> list[str]:
        """The name, then the figures."""
        if self.kind == "camera":
            return [self.name, *_camera(self)]
        if self.kind == "bar":
            return [self.name, *_bar(self)]
        if self.kind == "ball":
            return [self.name, translate("Scene", "Ball, radius {radius:.2f} mm").format(radius=self.radius_mm)]
        if self.kind == "map":
            text = translate("Scene", "Uncertainty {u:.3f} mm (95 %)")
            return [self.name, text.format(u=self.data.map_mm[self.index])]
        px = float(self.data.sizes[self.index]) * self.data.most_px
        return [self.name, translate("Scene", "Residual {px:.3f} px rms").format(px=px)]


def items_of(data: SceneData, layers: frozenset[str]) -> list[SceneItem]:
    """Everything that can be asked about."""
    found = [
        SceneItem("camera", camera.id, camera.centre, 0.0, data, i, 0) for i, camera in enumerate(data.scene.cameras)
    ]
    found += [
        SceneItem("ball", one.name, one.ball_centre, one.ball_radius, data, i, 3)
        for i, one in enumerate(data.scene.placements)
        if one.ball_centre is not None
    ]
    found += [SceneItem("bar", bar.name, (bar.start + bar.end) / 2, 0.0, data, i, 1) for i, bar in enumerate(data.bars)]
    if "map" in layers and len(data.map_mm):
        name = translate("Scene", "{length:.0f} mm at this place").format(length=data.map_length_mm)
        half = 0.3 * map_step(data.map_places)
        found += [SceneItem("map", name, place, half, data, i, 2) for i, place in enumerate(data.map_places)]
    elif "dots" in layers and data.names:
        text = translate("Scene", "{placement}, target {target}, dot {dot}")
        names = [text.format(placement=placement, target=target, dot=dot) for placement, target, dot in data.names]
        found += [SceneItem("dot", name, data.points[i], 0.0, data, i, 2) for i, name in enumerate(names)]
    return found


def _camera(item: SceneItem) -> list[str]:
    known = item.data.figures.get(item.name)
    if known is None:
        return []
    lines = []
    if known.serial:
        lines.append(translate("Scene", "Serial number {serial}").format(serial=known.serial))
    if known.sensor_px is not None:
        (width, height), text = known.sensor_px, translate("Scene", "Sensor {width} × {height} px")
        lines.append(text.format(width=width, height=height))
    if known.rms_px is not None:
        lines.append(translate("Scene", "Residuals {rms:.3f} px rms").format(rms=known.rms_px))
    if known.sd_mm is not None:
        lines.append(translate("Scene", "Place ± {sd:.3f} mm").format(sd=known.sd_mm))
    for one in item.data.moved:
        if one.id == item.name:
            text = translate("Scene", "Moved by {mm:.3f} mm and {deg:.3f}°")
            lines.append(text.format(mm=one.shift_mm, deg=one.turn_deg))
    return lines


def _bar(item: SceneItem) -> list[str]:
    bar = item.data.bars[item.index]
    lines = []
    if bar.error_mm is not None:
        lines.append(translate("Scene", "Length error {error:+.3f} mm").format(error=bar.error_mm))
    if bar.expanded_mm is not None:
        lines.append(translate("Scene", "Uncertainty {u:.3f} mm (95 %)").format(u=bar.expanded_mm))
    return lines
