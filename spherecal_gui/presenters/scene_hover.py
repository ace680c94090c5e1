"""What lies where in a scene, and what is said of it when the mouse is over it."""

from dataclasses import dataclass

from spherecal.base.arrays import FloatArray
from spherecal_documents.scene.model import SceneData
from spherecal_documents.scene.shapes import map_step
from spherecal_gui.languages import translate


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
