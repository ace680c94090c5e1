"""What the simulated cameras look at: the ball at a placement or a bar in a pose, which can be moved by hand."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Session
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal.targets.target_set import TargetSet
from spherecal_cameras.protocol import CameraError
from spherecal_cameras.simulated.draw import Solid, draw
from spherecal_sim.dot_truth import Station, TrueDots, ball_dots, bar_dots
from spherecal_sim.render_session import CLUTTERED, RENDERED, render_image
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_scene import RenderSettings, ball_scene, bar_scene, lit_for
from spherecal_sim.tracing import TracedScene
from spherecal_sim.truth import SimulationOptions, TrueBarPose, Truth

# The renderer's lens (optics.Psf); a light well-set lens of 0.65 px and the pixel's own 0.29.
SHARP_PX = 0.71
_FULL_SCALE_OF_WHITE = 0.8

_BALLS: dict[object, TrueDots] = {}  # the dots of the ball of late: half a second, and a rig is opened again and again

Vector = tuple[float, float, float]
# A shift in mm and a rotation vector in degrees, in the rig's frame, at a moment in s of perf_counter.
Path = Callable[[float], tuple[Vector, Vector]]


@dataclass(frozen=True)
class StageView:
    """How a simulated camera sees: blur (sd, px), brightness (1 = well exposed), a knock (rotation rad, shift mm)."""

    blur_px: float = SHARP_PX
    brightness: float = 1.0
    turned_rad: Vector = (0.0, 0.0, 0.0)
    shifted_mm: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ArtefactPose:
    """What is there at one moment: a placement or bar pose, shifted and turned (rotation vector) by hand."""

    shown: str
    shift_mm: Vector = (0.0, 0.0, 0.0)
    turn_rad: Vector = (0.0, 0.0, 0.0)

    def moved(self, shift_mm: Vector, turn_deg: Vector) -> "ArtefactPose":
        """The same, with a further movement."""
        turn = exp_rotation(np.deg2rad(np.asarray(turn_deg, float))) @ exp_rotation(np.array(self.turn_rad))
        shift = np.array(self.shift_mm) + np.asarray(shift_mm, float)
        return ArtefactPose(self.shown, _vector(shift), _vector(log_rotation(turn)))


class Stage:
    """A simulated rig with its ball and bars; `poses` names everything that can be shown."""

    def __init__(self, preset: str, seed: int = 1, options: SimulationOptions | None = None) -> None:
        self.preset = preset
        self.session: Session
        self.truth: Truth
        self.session, self.truth = simulate_session(preset, seed, options or replace(RENDERED, bar_poses=2))
        self.session = replace(self.session, observations=None)
        self.poses = self.truth.placements + tuple(pose.id for pose in self.truth.bar_poses)
        self._lock = threading.Lock()
        self._artefact = ArtefactPose(self.truth.placements[0])
        self._path: Path | None = None

    @property
    def shown(self) -> str:
        """The id of what is shown."""
        return self._artefact.shown

    def show(self, pose: str) -> None:
        """Put the ball to a placement, or a bar into one of its poses; forgets movements by hand."""
        if pose not in self.poses:
            raise InputError(Phrase("error-no-simulated-pose", {"pose": repr(pose), "names": list(self.poses)}))
        with self._lock:
            self._artefact, self._path = ArtefactPose(pose), None

    def move(self, shift_mm: Vector, turn_deg: Vector = (0, 0, 0)) -> None:
        """Move the ball or bar by hand, in the rig's frame."""
        with self._lock:
            self._artefact = self._artefact.moved(shift_mm, turn_deg)

    def carry(self, path: Path) -> None:
        """Carry the ball or bar along a path, from its present place, until something else is shown."""
        with self._lock:
            self._path = path

    def at(self, moment_s: float | None = None) -> ArtefactPose:
        """What is there at a moment of perf_counter; None: now."""
        with self._lock:
            artefact, path = self._artefact, self._path
        return (
            artefact if path is None else artefact.moved(*path(time.perf_counter() if moment_s is None else moment_s))
        )

    def picture(
        self, camera: int, view: StageView, rendered: bool = False, artefact: ArtefactPose | None = None
    ) -> NDArray[np.float32]:
        """The noise-free image (h, w) of a simulated camera, 1 = full scale; `artefact` None is what is there now."""
        artefact = artefact or self.at()
        station, shown = self._station(camera, view), artefact.shown
        white = _FULL_SCALE_OF_WHITE * view.brightness
        placed = self._truth_with(artefact)
        if rendered:
            return self._rendered(camera, shown, placed, station, white)
        if shown in placed.placements:
            t = placed.placements.index(shown)
            rotation, place = placed.ball_rotations[t], placed.ball_places_mm[t]
            solid = Solid(ball=(place, placed.ball.radius_mm))
            return draw(solid, self._ball_dots.moved(rotation, place), station, view.blur_px, white)
        scene, dots = self._bar(_pose(placed, shown), placed)
        # the corners of the bar's face in the world
        first, last, half = scene.bar_faces[0]
        flat = np.array([[first, -half, 0.0], [last, -half, 0.0], [last, half, 0.0], [first, half, 0.0]])
        face = flat @ scene.bar_rotations[0].T + scene.bar_places[0]
        return draw(Solid(face=face), dots, station, view.blur_px, white)

    @cached_property
    def _ball_dots(self) -> TrueDots:
        ball, targets = self.truth.ball, self._targets
        sizes = (targets.dot_diameter_mm / 2, targets.size_mm / 2)
        arrays = (ball.frames, ball.layouts_mm, ball.dots_mm, ball.bumps.axes, ball.bumps.coefficients)
        key = (ball.radius_mm, *sizes, *(array.tobytes() for array in arrays))
        if key not in _BALLS:
            _BALLS.clear()
            _BALLS[key] = ball_dots(ball, *sizes)
        return _BALLS[key]

    @property
    def _targets(self) -> TargetSet:
        if self.session.target_set is None:
            raise CameraError(Phrase("error-no-simulated-targets"))
        return self.session.target_set

    def _station(self, camera: int, view: StageView) -> Station:
        one = self.truth.cameras[camera]
        turn = exp_rotation(np.array(view.turned_rad))
        translation = turn @ one.translation_mm + np.array(view.shifted_mm)
        return Station(one.id, turn @ one.rotation, translation, one.intrinsics, one.kind.image_size)

    def _truth_with(self, artefact: ArtefactPose) -> Truth:
        """The truth with what is shown moved by hand."""
        truth, shown = self.truth, artefact.shown
        shift, turn = np.array(artefact.shift_mm), exp_rotation(np.array(artefact.turn_rad))
        if shown in truth.placements:
            t = truth.placements.index(shown)
            rotations, places = truth.ball_rotations.copy(), truth.ball_places_mm.copy()
            rotations[t] = turn @ rotations[t]
            places[t] = places[t] + shift
            return replace(truth, ball_rotations=rotations, ball_places_mm=places)
        pose = _pose(truth, shown)
        moved = replace(pose, rotation=turn @ pose.rotation, place_mm=pose.place_mm + shift)
        return replace(truth, bar_poses=tuple(moved if p.id == shown else p for p in truth.bar_poses))

    def _bar(
        self, pose: TrueBarPose, truth: Truth, settings: RenderSettings | None = None
    ) -> tuple[TracedScene, TrueDots]:
        scene = bar_scene(truth, self._targets, pose, settings or RenderSettings())
        return scene, bar_dots(scene, truth.bar(pose.bar).targets)

    def _rendered(self, camera: int, shown: str, placed: Truth, station: Station, white: float) -> NDArray[np.float32]:
        settings = replace(CLUTTERED, exposure=white / _FULL_SCALE_OF_WHITE)
        if shown in placed.placements:
            t = placed.placements.index(shown)
            scene = ball_scene(placed, self._targets, t, settings)
            dots = self._ball_dots.moved(placed.ball_rotations[t], placed.ball_places_mm[t])
        else:
            scene, dots = self._bar(_pose(placed, shown), placed, settings)
        lit = lit_for(scene, self.truth, camera, settings)
        return render_image(lit, dots, station, settings, np.random.default_rng(0)).exposure


def _vector(values: FloatArray) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


def _pose(truth: Truth, name: str) -> TrueBarPose:
    return next(pose for pose in truth.bar_poses if pose.id == name)
