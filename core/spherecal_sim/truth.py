"""The truth behind a simulated session, and what to simulate."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from spherecal.base.arrays import BoolArray, ByValue, FloatArray
from spherecal.geometry.camera import camera_matrix, is_fisheye
from spherecal.geometry.rotation import exp_rotation
from spherecal_files.filesystem import create
from spherecal_files.json_file import plain_fields
from spherecal_sim.rigs import Layout, TrueCamera, Turns
from spherecal_sim.simulated_ball import Ball


@dataclass(frozen=True)
class CameraMove:
    """A camera knocked from placement index `from_placement` on: sizes and unit directions of shift and turn."""

    camera: str
    from_placement: int
    shift_mm: float = 0.0
    turn_rad: float = 0.0
    direction_shift: tuple[float, float, float] = (1.0, 0.0, 0.0)
    direction_turn: tuple[float, float, float] = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class SimulationOptions:
    """What to simulate; the defaults are the standard session of the method.

    `placements` None takes the rig's own number. `blurred` gives single simulated cameras a noise of their own, in px.
    `shape_change_mm` is the rms of the 3-D displacement by which the ball's dots change from placement to placement.
    `mark_points` says whether a bar's marks are observed as points `centre` or as eight dots each.
    """

    placements: int | None = None
    layout: Layout = "spread"
    turns: Turns = "turned"
    targets: int = 200
    ball_radius_mm: float = 250.0
    bump_mm: float = 1.0
    print_sd_mm: float = 0.0
    view_limit_deg: float = 60.0
    sigma_px: float = 0.04
    blurred: dict[str, float] = field(default_factory=dict)
    outlier_fraction: float = 0.0
    misfit_px: float = 0.0
    moved: CameraMove | None = None
    shape_change_mm: float = 0.0
    shape_change: Literal["smooth", "per-dot"] = "smooth"
    bar_poses: int = 8
    mark_points: Literal["centre", "dots"] = "centre"
    scale: Literal["target_spacing", "bar"] = "target_spacing"
    prior_focal_error: float = 0.0
    prior_centre_error_px: float = 0.0


@dataclass(frozen=True)
class TrueBar:
    """A bar: its marks are at `x_mm` along it (m,) at the reference temperature; sticker axes are the bar's axes."""

    id: str
    marks: tuple[str, ...]
    targets: tuple[int, ...]
    x_mm: FloatArray
    expansion_per_kelvin: float
    reference_temperature_c: float


@dataclass(frozen=True)
class TrueBarPose:
    """One pose `x_world = rotation @ x_bar + place_mm` of a bar at its true temperature."""

    id: str
    bar: str
    rotation: FloatArray
    place_mm: FloatArray
    temperature_c: float


@dataclass(frozen=True, eq=False, repr=False)
class Truth(ByValue):
    """All that a simulated session was made from.

    In placement t the ball is at `x_world = ball_rotations[t] @ x_ball + ball_places_mm[t]`; `shape_changes_mm` (t,
    dots, 3) is added to the ball's dots before that. `uv_true_px` (n, 2) are the noise-free image points of the
    observations, lens misfit included, `outlier` (n,) says which were spoilt.
    """

    preset: str
    seed: int
    options: SimulationOptions
    cameras: tuple[TrueCamera, ...]
    sigma_px: FloatArray
    volume_mm: FloatArray
    misfit_phases: FloatArray
    ball: Ball
    placements: tuple[str, ...]
    ball_rotations: FloatArray
    ball_places_mm: FloatArray
    shape_changes_mm: FloatArray | None
    bars: tuple[TrueBar, ...]
    bar_poses: tuple[TrueBarPose, ...]
    uv_true_px: FloatArray
    outlier: BoolArray

    def points_mm(self, placement: int) -> FloatArray:
        """The ball's dots in the world at a placement index, (dots, 3) mm."""
        shape = self.ball.dots_mm
        if self.shape_changes_mm is not None:
            shape = shape + self.shape_changes_mm[placement]
        return shape @ self.ball_rotations[placement].T + self.ball_places_mm[placement]

    def bar(self, bar_id: str) -> TrueBar:
        """The bar with this id."""
        return next(bar for bar in self.bars if bar.id == bar_id)


def camera_pose(camera: TrueCamera, move: CameraMove | None, placement: int) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) mm of a simulated camera at a placement, after its move if it had one."""
    if move is None or move.camera != camera.id or placement < move.from_placement:
        return camera.rotation, camera.translation_mm
    turn = exp_rotation(move.turn_rad * np.array(move.direction_turn))
    shift = move.shift_mm * np.array(move.direction_shift)
    return turn @ camera.rotation, turn @ camera.translation_mm + shift


def write_truth(truth: Truth, path: Path) -> None:
    """Write truth.json: cameras, ball, placements, bars and noise; lengths in mm, world = the rig's frame."""
    create(path, (json.dumps(_as_json(truth), indent=1) + "\n").encode())


def _as_json(truth: Truth) -> dict[str, Any]:
    ball = truth.ball
    return {
        "format": "spherecal/truth",
        "version": 1,
        "preset": truth.preset,
        "seed": truth.seed,
        "options": asdict(truth.options),
        "cameras": [
            {
                "id": c.id,
                "matrix": camera_matrix(c.intrinsics).tolist(),
                "distortion": c.intrinsics[4 : 8 if is_fisheye(c.intrinsics) else 16].tolist(),
                "rotation": c.rotation.tolist(),
                "translation_mm": c.translation_mm.tolist(),
                "sigma_px": float(sigma),
            }
            for c, sigma in zip(truth.cameras, truth.sigma_px, strict=True)
        ],
        "ball": {
            "radius_mm": ball.radius_mm,
            "dots": [
                {"target": int(t), "point": ball.points[p], "xyz_mm": xyz.tolist()}
                for t, p, xyz in zip(ball.dot_target, ball.dot_point, ball.dots_mm, strict=True)
            ],
        },
        "placements": [
            {"id": name, "rotation": r.tolist(), "translation_mm": place.tolist()}
            for name, r, place in zip(truth.placements, truth.ball_rotations, truth.ball_places_mm, strict=True)
        ],
        "bars": [
            {"id": b.id, "marks": dict(zip(b.marks, b.x_mm.tolist(), strict=True)), "targets": list(b.targets)}
            for b in truth.bars
        ],
        "bar_poses": [
            plain_fields(p, "id bar rotation")
            | {"translation_mm": p.place_mm.tolist(), "temperature_c": p.temperature_c}
            for p in truth.bar_poses
        ],
        "outliers": np.flatnonzero(truth.outlier).tolist(),
    }
