"""What the paper's plain adjustment makes of its starts: OPT and SPO against none, and points displaced (22)."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.bundle import Adjustment
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.data.session import Recording, Session
from spherecal.geometry.sphere import fit_sphere_geometrically
from spherecal.initialise.camera_path import Path, Search, find_paths
from spherecal.initialise.local import LocalNetwork
from spherecal.initialise.view_graph import edges_of
from spherecal.steps import tao2021
from spherecal.steps.ball_stages import StartValues
from spherecal.steps.settings import CalibrationSettings
from spherecal_sim.truth import Truth

PERCENT = (10, 15, 20, 25)
# Converged: within this of the optimum's rms, the rest of a few slow steps; other minima are ten times off and more.
SAME_RMS = 1.05
_SEARCHES: tuple[Search, ...] = ("opt", "dijkstra", "first", "first-listed")


def published_cases(session: Session, truth: Truth, settings: CalibrationSettings) -> dict[str, Any]:
    """How the paper's adjustment ends from its starts (OPT, Dijkstra, none-OPT; SPO, none-SPO), processor s."""
    cases: list[dict[str, Any]] = []
    best: dict[str, Any] | None = None
    whole = Recording.of(session)
    groups = tao2021.local_reconstruction(whole, settings, Context())
    for search in _SEARCHES:
        chosen = replace(settings, search=search)
        paths = find_paths(groups.graph, groups.triples, search, settings.base)
        recording, local, _ = tao2021.grouped_points(whole, replace(groups, paths=paths), chosen)
        chained = tao2021.optimal_path_transformation(recording, local, chosen)
        best = best or _optimum(chained, truth, chosen)
        lengths = [path_length(local, path, chosen) for path in local.paths.values() if path.triples]
        known = {
            "search": search,
            "placed": int(chained.poses.placed.sum()),
            "length": float(np.mean(lengths)) if lengths and np.isfinite(lengths).all() else None,
        }
        for spo in (True, False):
            start = tao2021.spherical_projection(recording, chained) if spo else chained
            cases.append({**known, "spo": spo, **_ended(start, best, chosen)})
    assert best is not None
    return {"cases": cases, "best_rms_px": best["rms_px"], "cameras": len(session.cameras)}


def path_length(local: LocalNetwork, path: Path, settings: CalibrationSettings) -> float:
    """The sum of the weights (13) of the edges that a path really takes; none-OPT does not take the lightest."""
    length = 0.0
    for a, b, number in zip(path.cameras, path.cameras[1:], path.triples, strict=False):
        edges = edges_of(local.triples[number], local.counts, settings.weights)
        length += next(weight for j, g, weight in edges if {j, g} == {a, b})
    return length


def displaced_cases(
    session: Session, truth: Truth, seed: int, settings: CalibrationSettings, percents: Sequence[int]
) -> dict[str, Any]:
    """How adjustments end from the paper's start, in mm, displaced by shares of the radius, SPO and none (22)."""
    recording = Recording.of(session)
    recording, local, _ = tao2021.grouped_points(
        recording, tao2021.local_reconstruction(recording, settings, Context()), settings
    )
    start = tao2021.optimal_path_transformation(recording, local, settings)
    radius = truth.options.ball_radius_mm
    scaled = start.poses.state.scaled(radius / _radius(start.poses.state.points, recording.features.placement))
    start = replace(start, poses=replace(start.poses, state=scaled))
    best = _optimum(start, truth, settings)
    cases = [
        {"percent": percent, "way": way, **_ended(displaced, best, settings)}
        for percent, way, displaced in _displaced(recording, start, radius, seed, percents)
    ]
    ids = [camera.id for camera in session.cameras]
    return {"cases": cases, "best_rms_px": best["rms_px"], "best_mean_px": best["mean_px"], "ids": ids}


def _displaced(
    recording: Recording, start: StartValues, radius: float, seed: int, percents: Sequence[int]
) -> Iterator[tuple[int, str, StartValues]]:
    points = start.poses.state.points
    for percent in percents:
        rng = np.random.default_rng([seed, percent * 100])
        # standard normal numbers, drawn again where they are not in (-1, 1)
        out = rng.normal(size=points.shape)
        while (wide := np.abs(out) >= 1).any():
            out[wide] = rng.normal(size=int(wide.sum()))
        displaced = tao2021.with_points(start, points + percent / 100 * radius * out)
        yield percent, "spo", tao2021.spherical_projection(recording, displaced)
        yield percent, "none", displaced


def _optimum(start: StartValues, truth: Truth, settings: CalibrationSettings) -> dict[str, Any]:
    """Where the adjustment of the same observations ends from the true cameras."""
    # the true cameras, with points triangulated from them: nothing can go wrong
    state = State(
        np.array([c.rotation for c in truth.cameras]),
        np.array([c.translation_mm for c in truth.cameras]),
        np.array([c.intrinsics for c in truth.cameras]),
        np.zeros((start.network.n_features, 3)),
    )
    triangulated = start.network.triangulated(state, np.ones(len(start.network.uv), dtype=bool))
    state = replace(state, points=np.nan_to_num(triangulated.points))
    points = np.where(np.isfinite(start.poses.state.points), state.points, np.nan)
    known = tao2021.with_points(replace(start, poses=replace(start.poses, state=state)), points)
    return _figures(tao2021.bundle_adjustment(known, replace(settings, damping="diagonal"), Context()))


def _ended(start: StartValues, best: dict[str, Any], settings: CalibrationSettings) -> dict[str, Any]:
    """Where a start begins and ends, in how many steps and seconds, and whether that is the optimum."""
    began = time.process_time()
    adjusted = tao2021.bundle_adjustment(start, settings, Context())
    seconds = time.process_time() - began
    done = _figures(adjusted)
    return {
        **done,
        "start_px": float(np.median(_sizes(adjusted, tao2021.plain_state(start)))),
        "adjust_s": seconds,
        "converged": done["rms_px"] <= best["rms_px"] * SAME_RMS,
    }


def _sizes(adjusted: Adjustment, state: State) -> FloatArray:
    """Lengths (n,) of the residuals at a state, px, at most a million."""
    with np.errstate(all="ignore"):
        size = np.linalg.norm(engine.residuals(adjusted.problem, state), axis=1)
    return np.minimum(np.nan_to_num(size, nan=1e6, posinf=1e6), 1e6)


def _figures(adjusted: Adjustment) -> dict[str, Any]:
    """Steps taken, whether the minimiser settled, and the reprojection errors it ends with, of all and by camera."""
    problem, minimum = adjusted.problem, adjusted.minimum
    size = _sizes(adjusted, minimum.state)
    count = np.maximum(np.bincount(problem.camera, minlength=problem.n_cameras), 1)
    return {
        "iterations": minimum.iterations,
        "settled": minimum.converged,
        "mean_px": float(size.mean()),
        "rms_px": float(np.sqrt((size**2).mean())),
        "camera_mean_px": (np.bincount(problem.camera, size, problem.n_cameras) / count).tolist(),
    }


def _radius(points: FloatArray, placement: IntArray) -> float:
    """The ball's radius in the start's units: the median of the spheres through the placements' points."""
    spheres = [
        fit_sphere_geometrically(points[(placement == p) & np.isfinite(points[:, 0])]) for p in np.unique(placement)
    ]
    return float(np.median([sphere.radius for sphere in spheres if sphere is not None]))
