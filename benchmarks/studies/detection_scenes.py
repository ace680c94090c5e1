"""Scenes for the detector's benchmark and study: the ball as a camera aimed at it sees it, and which targets count."""

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.session import Session
from spherecal.targets.target_set import TargetSet
from spherecal_sim.dot_truth import DotTruth, Station, ball_dots
from spherecal_sim.optics import Image
from spherecal_sim.render_session import RENDERED, Rendered, render_image, station_at
from spherecal_sim.rigs import CameraKind, TrueCamera, look_at
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_scene import RenderSettings, ball_scene, lit_for
from spherecal_sim.tracing import TracedScene
from spherecal_sim.truth import SimulationOptions, Truth

FIVE_MP = CameraKind("simulated 5 MP", (2448, 2048), 3.45, 11.0)
FIVE_MP_DISTANCE_MM = 1100.0  # dots of 10 px, some 65 targets fully in sight
THREE_MP = CameraKind("simulated 3.2 MP", (2064, 1544), 3.45, 8.0)
THREE_MP_DISTANCE_MM = 1100.0  # dots of 8 px, as rig A's cameras see them
DOTS_OF_A_TARGET = 8


@dataclass(frozen=True)
class View:
    """The ball in a rig's light, seen by a camera aimed at it: session, truth, placement and camera index."""

    session: Session
    truth: Truth
    placement: int
    camera: int

    @property
    def targets(self) -> TargetSet:
        """The target set on the ball."""
        assert self.session.target_set is not None
        return self.session.target_set

    @property
    def station(self) -> Station:
        """The camera at this placement."""
        return station_at(self.truth.cameras[self.camera], self.truth, self.placement)

    def scene(self, settings: RenderSettings) -> TracedScene:
        """The lit scene."""
        scene = ball_scene(self.truth, self.targets, self.placement, settings)
        return lit_for(scene, self.truth, self.camera, settings)

    def render(self, settings: RenderSettings, seed: int) -> Rendered:
        """The image, and the truth about its dots."""
        dots = ball_dots(self.truth.ball, self.targets.dot_diameter_mm / 2, self.targets.size_mm / 2)
        dots = dots.moved(self.truth.ball_rotations[self.placement], self.truth.ball_places_mm[self.placement])
        rng = np.random.default_rng(seed)
        return render_image(self.scene(settings), dots, self.station, settings, rng)


def aimed_view(
    seed: int,
    kind: CameraKind,
    distance_mm: float,
    placement: int = 0,
    camera: int = 2,
    options: SimulationOptions = RENDERED,
    off_axis: tuple[float, float] = (0.0, 0.0),
) -> View:
    """A camera of rig A, moved to a distance from the ball and aimed at it, with its own lens errors.

    `off_axis` moves the ball's image by parts of the image's half width and height.
    """
    session, truth = simulate_session("rigA", seed, replace(options, bar_poses=0))
    old, ball = truth.cameras[camera], truth.ball_places_mm[placement]
    towards = (old.centre_mm - ball) / np.linalg.norm(old.centre_mm - ball)
    place = ball + distance_mm * towards
    rotation = _turned_aside(off_axis, kind) @ look_at(place, ball, np.array([0.0, 1.0, 0.0]))
    intrinsics = old.intrinsics.copy()
    intrinsics[:2] *= kind.focal_length_px / old.kind.focal_length_px
    intrinsics[2:4] += (np.array(kind.image_size) - old.kind.image_size) / 2
    new = TrueCamera(old.id, kind, intrinsics, rotation, -rotation @ place)
    cameras = tuple(new if i == camera else c for i, c in enumerate(truth.cameras))
    return View(session, replace(truth, cameras=cameras), placement, camera)


def _turned_aside(off_axis: tuple[float, float], kind: CameraKind) -> FloatArray:
    """A camera's small turn that moves the image of what it is aimed at."""
    half = np.array(kind.image_size) / 2 / kind.focal_length_px
    aim = np.array([-off_axis[0] * half[0], -off_axis[1] * half[1], 1.0])
    return look_at(np.zeros(3), aim, np.array([0.0, -1.0, 0.0]))


@dataclass(frozen=True)
class Picture:
    """A rendered image and the truth about its dots."""

    image: Image
    dots: DotTruth


def kept(name: str, render: Callable[[], Rendered]) -> Picture:
    """A rendered image, from the folder SPHERECAL_STUDY_CACHE where it is set and has it (and put there if not)."""

    def make() -> tuple[Image, dict[str, Any]]:
        rendered = render()
        return rendered.image, asdict(rendered.dots)

    image, truth = _kept(name, make)
    return Picture(image, DotTruth(**truth))


def kept_image(name: str, make: Callable[[], Image]) -> Image:
    """The same for an image without dots."""
    return _kept(name, lambda: (make(), {}))[0]


def _kept(name: str, make: Callable[[], tuple[Image, dict[str, Any]]]) -> tuple[Image, dict[str, Any]]:
    folder = os.environ.get("SPHERECAL_STUDY_CACHE")
    path = Path(folder or "") / f"{name}.npz"
    if folder and path.exists():
        with np.load(path) as data:
            truth = {key: data[key] for key in data.files if key != "png"}
            return cast(Image, cv2.imdecode(data["png"], cv2.IMREAD_UNCHANGED)), truth
    image, truth = make()
    if folder:
        path.parent.mkdir(parents=True, exist_ok=True)
        _, png = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        partial = path.with_suffix(".part.npz")
        np.savez(partial, png=png, **truth)
        partial.replace(path)
    return image, truth


@dataclass(frozen=True)
class TargetTruth:
    """The targets in an image, n of them: `ids`, whether all dots show, and over all dots the largest view angle and
    the smallest gap and short diameter in px.
    """

    ids: IntArray
    fully_visible: BoolArray
    view_deg: FloatArray
    gap_px: FloatArray
    short_px: FloatArray


def targets_in(dots: DotTruth) -> TargetTruth:
    """Targets of which at least one dot lies in the image."""
    ids, of = np.unique(dots.target, return_inverse=True)
    n = len(ids)
    shown = np.bincount(of, weights=dots.fully_visible, minlength=n)
    view, gap, short = np.zeros(n), np.full(n, np.inf), np.full(n, np.inf)
    np.maximum.at(view, of, dots.view_deg)
    np.minimum.at(gap, of, dots.gap_px)
    np.minimum.at(short, of, dots.axes_px[:, 1])
    return TargetTruth(ids, shown == DOTS_OF_A_TARGET, view, gap, short)
