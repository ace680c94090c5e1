"""Choosing the user's frame: three places, an offset, turns by 90 degrees; each choice can be taken back."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal_documents.scene.model import SceneData, scene_data
from spherecal_gui.languages import error_line, translate
from spherecal_rigs.user_frame import FrameDefinition, UserFrame, turn_matrix

if TYPE_CHECKING:  # imports scipy.optimize
    from spherecal_rigs.framed_rig import Place
    from spherecal_rigs.result_folder import Result

Role = Literal["origin", "x", "xy"]
_MINUS = "\N{MINUS SIGN}"
_AXIS_LENGTH = 1.6  # of a camera's frustum in the picture


def place_text(name: str, kind: str) -> str:
    """A place as it is shown in a list."""
    texts = {
        "ball": translate("Frame", "{name}: the ball's centre"),
        "mark": translate("Frame", "{name}: mark of a bar"),
    }
    return texts.get(kind, translate("Frame", "{name}: a point")).format(name=name)


def frame_words(definition: FrameDefinition | None, reference: str | None) -> str:
    """In which frame exports are given; without a `definition` that of the reference camera."""
    camera = translate("Frame", "the reference camera's frame ({camera})").format(camera=reference or "-")
    if definition is None:
        return camera
    if definition.places:
        what = translate("Frame", "the user's frame: origin {origin}, X axis to {x}, XY plane with {xy}").format(
            origin=definition.origin, x=definition.x, xy=definition.xy
        )
    else:
        what = camera
    if any(definition.offset_mm):
        offset = " / ".join(f"{value:g}" for value in definition.offset_mm)
        what += translate("Frame", ", offset {offset} mm").format(offset=offset)
    if definition.turns:
        what += translate("Frame", ", turned {turns}").format(turns=" ".join(map(turn_word, definition.turns)))
    return what


def turn_word(turn: str) -> str:
    """A turn as its button says it."""
    return f"{turn[0].upper()} {_MINUS if turn[1] == '-' else '+'}90°"


class FrameChoice:
    """What is chosen, the frame that it gives, and how that looks; knows no widgets."""

    def __init__(
        self, result: "Result", places: "Mapping[str, Place]", definition: FrameDefinition | None = None
    ) -> None:
        self.rig = result.rig
        self.places = places
        self.definition = self._without_missing(definition or FrameDefinition())
        self.scene: SceneData | None = scene_data(result)
        self.frame: UserFrame | None = None
        self.problem = ""
        self._before: list[tuple[str, FrameDefinition]] = []
        self._make()

    def _without_missing(self, definition: FrameDefinition) -> FrameDefinition:
        """The definition with other places where its own are gone."""
        if all(name in self.places for name in definition.places):
            return definition
        if definition.origin not in self.places:
            return FrameDefinition()
        x, xy = self._suggested(str(definition.origin))
        return replace(definition, x=x, xy=xy)

    @property
    def options(self) -> list[tuple[str, str]]:
        """The places to choose from, single dots left out unless they are chosen: name and text."""
        message = self.definition.places
        return [
            (name, place_text(name, place.kind))
            for name, place in self.places.items()
            if place.kind != "point" or name.endswith("/centre") or name in message
        ]

    @property
    def is_plain(self) -> bool:
        """Whether it is the reference camera's frame as it is."""
        return self.definition == FrameDefinition()

    @property
    def can_undo(self) -> bool:
        """Whether there is something to take back."""
        return bool(self._before)

    def choose(self, role: Role, name: str | None) -> None:
        """Another place for a role, None for the reference camera; a new origin suggests the others."""
        made = replace(self.definition, **{role: name})
        if role == "origin" and name is None:
            made = replace(made, x=None, xy=None)
        elif role == "origin" and (made.x in (None, name) or made.xy in (None, name)):
            x, xy = self._suggested(str(name))
            made = replace(made, x=x, xy=xy)
        self._change(role, made)

    @property
    def lies_at_mm(self) -> tuple[float, float, float]:
        """Where the origin's place lies in the frame as it is: the offset, turned with the axes."""
        x, y, z = turn_matrix(self.definition.turns) @ self.definition.offset_mm + 0.0
        return float(x), float(y), float(z)

    def let_lie_at(self, place_mm: tuple[float, float, float]) -> None:
        """Say where the origin's place lies in the frame as it is; the definition has that before the turns."""
        x, y, z = turn_matrix(self.definition.turns).T @ place_mm + 0.0
        self._change("offset", replace(self.definition, offset_mm=(float(x), float(y), float(z))))

    def turn(self, turn: str) -> None:
        """Turn the axes about one of them by 90 degrees."""
        self._change("turn", replace(self.definition, turns=(*self.definition.turns, turn)))

    def reset(self) -> None:
        """Without offset and turns."""
        self._change("reset", replace(self.definition, offset_mm=(0.0, 0.0, 0.0), turns=()))

    def back_to_camera(self) -> None:
        """The reference camera's frame as it is."""
        self._change("camera", FrameDefinition())

    def undo(self) -> None:
        """Take the last choice back; all numbers typed for an offset are one."""
        if self._before:
            _, self.definition = self._before.pop()
            self._make()

    def _change(self, kind: str, definition: FrameDefinition) -> None:
        if definition == self.definition:
            return
        if kind != "offset" or not self._before or self._before[-1][0] != "offset":
            self._before.append((kind, self.definition))
        self.definition = definition
        self._make()

    def _make(self) -> None:
        from spherecal_rigs.framed_rig import frame_of  # imports scipy.optimize

        try:
            self.frame, self.problem = frame_of(self.definition, self.places, self.rig), ""
        except InputError as error:
            self.frame, self.problem = None, error_line(error)

    def _suggested(self, origin: str) -> tuple[str | None, str | None]:
        """The place farthest from the origin, and the one farthest from the line to it; of the origin's kind first."""
        own = self.places[origin]
        others = [name for name, place in self.places.items() if name != origin and place.kind == own.kind]
        if len(others) < 2:
            others = [name for name in self.places if name != origin]
        if len(others) < 2:
            return None, None
        away = {name: self.places[name].place_mm - own.place_mm for name in others}
        x = max(others, key=lambda name: float(np.linalg.norm(away[name])))
        rest = [name for name in others if name != x]
        return x, max(rest, key=lambda name: float(np.linalg.norm(np.cross(away[x], away[name]))))

    @property
    def sentence(self) -> tuple[str, str]:
        """What is chosen in words, and its level: `good`, or `bad` with what is in the way."""
        if self.frame is None:
            return self.problem, "bad"
        words = translate("Frame", "Exports are given in: {frame}.").format(
            frame=frame_words(None if self.is_plain else self.definition, self.rig.reference_camera)
        )
        if self.frame.distance_mm is None:
            return words, "none"
        d = self.definition
        x, y, z = self.frame.apply(self.places[str(d.origin)].place_mm[None])[0].round(3) + 0.0
        message = translate(
            "Frame", "{origin} lies at {x} / {y} / {z} mm; {to} is {distance} mm from it, {xy} {angle}° off."
        )
        figures = {"x": x, "y": y, "z": z, "distance": self.frame.distance_mm}
        shown = {name: f"{figure:.1f}" for name, figure in figures.items()}
        angle = f"{self.frame.angle_deg:.0f}"
        words += " " + message.format(origin=d.origin, to=d.x, xy=d.xy, angle=angle, **shown)
        if self.frame.axes_sigma_deg is not None and self.frame.origin_sigma_mm is not None:
            words += " " + translate("Frame", "Uncertainty (k = 1): origin {mm} mm, axes {deg}°.").format(
                mm=f"{self.frame.origin_sigma_mm.max():.2g}", deg=f"{self.frame.axes_sigma_deg.max():.2g}"
            )
        return words, "good"

    @property
    def axes(self) -> list[tuple[FloatArray, FloatArray]]:
        """The axes X, Y, Z in the picture: both ends of each; none while there is no frame."""
        if self.frame is None or self.scene is None:
            return []
        length = _AXIS_LENGTH * self.scene.scene.frustum
        origin = self.in_picture(self.frame.origin_mm[None])[0]
        tips = self.in_picture(self.frame.origin_mm + length * self.frame.rotation)
        return [(origin, tip) for tip in tips]

    @property
    def marked(self) -> list[tuple[str, FloatArray]]:
        """The chosen places in the picture."""
        d = self.definition
        names = [str(name) for name in (d.origin, d.x, d.xy) if name in self.places]
        places = np.array([self.places[name].place_mm for name in names]).reshape(-1, 3)
        return list(zip(names, self.in_picture(places), strict=True))

    def in_picture(self, places_mm: FloatArray) -> FloatArray:
        """Places (n, 3) of the world in the picture's frame."""
        assert self.scene is not None
        shape = self.scene.scene.cameras[0]
        camera, axes = self.rig.camera(shape.id), self.scene.scene.axes
        assert camera is not None
        return (places_mm - camera.centre_mm) @ axes.T + shape.centre
