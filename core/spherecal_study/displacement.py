"""Table II: start points displaced (22), with SPO and without, and what an adjustment makes of them."""

from dataclasses import replace
from typing import Any

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.bundle import usable_features
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Minimum, Settings
from spherecal.adjust.network import Network
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.data.observations import find_features
from spherecal.data.recording import calibration_observations
from spherecal.data.session import Session
from spherecal.initialise.spherical_projection import project_to_spheres
from spherecal.steps.start_values import StartValues
from spherecal_sim.truth import Truth
from spherecal.adjust.identity_damping import minimise_with_identity

PERCENT = (10, 15, 20, 25)
# Converged: within this of the optimum's rms, the rest of a few slow steps; other minima are ten times off and more.
SAME_RMS = 1.05
_ITERATIONS = 150


def displaced_cases(session: Session, truth: Truth, start: StartValues, seed: int, damping: str) -> dict[str, Any]:
    """How adjustments end whose points are displaced by a share of the ball's radius, with SPO and without.

    [Tao21] (22). `cases` has each percentage with and without projection, and for the diagonal with points triangulated
    from the cameras.
    """
    network, state, points = start.network, start.poses.state, start.points
    assert points is not None
    candidates = start.candidates & np.isfinite(points[network.feature, 0])
    placement = find_features(calibration_observations(session)).placement
    radius = _radius(points, placement)
    size = truth.options.ball_radius_mm / radius if damping == "identity-mm" else 1.0
    used = candidates & (network.views(candidates) >= 2)[network.feature]
    best = _figures(network, used, _adjusted(network, _true_state(network, truth), used, "diagonal"))
    cases = []
    for percent in PERCENT:
        moved = points + percent / 100 * radius * _within_one(
            np.random.default_rng([seed, percent * 100]), points.shape
        )
        for way in ("spo", "none"):
            begin = project_to_spheres(moved, placement) if way == "spo" else moved
            displaced = replace(state, points=np.nan_to_num(begin)).scaled(size)
            done = _figures(network, used, _adjusted(network, displaced, used, damping))
            cases.append({"percent": percent, "way": way, **done, "converged": _converged(done, best)})
    if damping == "diagonal":
        cases.append({"percent": 0, "way": "triangulated", **_triangulated(network, state, candidates, best)})
    ids = [camera.id for camera in session.cameras]
    return {"cases": cases, "best_rms_px": best["rms_px"], "best_mean_px": best["mean_px"], "ids": ids}


def _triangulated(network: Network, state: State, candidates: BoolArray, best: dict[str, Any]) -> dict[str, Any]:
    """The adjustment from points that one triangulation gives: whatever they were displaced by is gone."""
    points, good = usable_features(network, state, candidates)
    candidates = candidates & good[network.feature]
    used = candidates & (network.views(candidates) >= 2)[network.feature]
    minimum = _adjusted(network, replace(state, points=np.nan_to_num(points)), used, "diagonal")
    done = _figures(network, used, minimum)
    return {**done, "converged": _converged(done, best)}


def _converged(done: dict[str, Any], best: dict[str, Any]) -> bool:
    return done["rms_px"] <= best["rms_px"] * SAME_RMS


def _adjusted(network: Network, state: State, used: BoolArray, damping: str) -> Minimum:
    """A plain adjustment of all unknowns."""
    placed = np.isfinite(state.translation[:, 0])
    problem, _ = network.problem(used, network.free, placed, weighted=True)
    if damping != "diagonal":
        return minimise_with_identity(problem, state)
    return minimise(problem, state, Settings(max_iterations=_ITERATIONS))


def _figures(network: Network, used: BoolArray, minimum: Minimum) -> dict[str, Any]:
    """Steps taken, whether the minimiser settled, and the reprojection errors it ends with, of all and by camera."""
    placed = np.isfinite(minimum.state.translation[:, 0])
    problem, _ = network.problem(used, network.free, placed, weighted=False)
    with np.errstate(all="ignore"):
        size = np.linalg.norm(engine.residuals(problem, minimum.state), axis=1)
    size = np.minimum(np.nan_to_num(size, nan=1e6, posinf=1e6), 1e6)
    count = np.maximum(np.bincount(problem.camera, minlength=problem.n_cameras), 1)
    return {
        "iterations": minimum.iterations,
        "settled": minimum.converged,
        "mean_px": float(size.mean()),
        "rms_px": float(np.sqrt((size**2).mean())),
        "camera_mean_px": (np.bincount(problem.camera, size, problem.n_cameras) / count).tolist(),
    }


def _radius(points: FloatArray, placement: np.ndarray) -> float:
    """The ball's radius in the start's units: the median distance of a placement's points from their middle."""
    radii = []
    for p in np.unique(placement):
        own = points[(placement == p) & np.isfinite(points[:, 0])]
        if len(own):
            radii.append(float(np.median(np.linalg.norm(own - own.mean(axis=0), axis=1))))
    return float(np.median(radii))


def _within_one(rng: np.random.Generator, shape: tuple[int, ...]) -> FloatArray:
    """Standard normal numbers, drawn again where they are not in (-1, 1)."""
    out = rng.normal(size=shape)
    while (wide := np.abs(out) >= 1).any():
        out[wide] = rng.normal(size=int(wide.sum()))
    return out


def _true_state(network: Network, truth: Truth) -> State:
    """The true cameras, with points triangulated from them: a start from which nothing can go wrong."""
    state = State(
        np.array([c.rotation for c in truth.cameras]),
        np.array([c.translation_mm for c in truth.cameras]),
        np.array([c.intrinsics for c in truth.cameras]),
        np.zeros((network.n_features, 3)),
    )
    triangulated = network.triangulated(state, np.ones(len(network.uv), dtype=bool))
    return replace(state, points=np.nan_to_num(triangulated.points))
