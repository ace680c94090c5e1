"""The trials of the studies: each a function of plain settings whose result is plain JSON."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.adjust.bundle import usable_features
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.network import Network
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.context import Context
from spherecal.calibrate import calibrate
from spherecal.data.observations import find_features
from spherecal.data.recording import Recording, calibration_observations
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.detect.session_images import observed
from spherecal.initialise.chain import chain_points, chain_poses
from spherecal.initialise.incremental import grow
from spherecal.initialise.local import LocalNetwork, reconstruct_locally
from spherecal.initialise.path import Search
from spherecal.initialise.spherical_projection import project_to_spheres
from spherecal.methods.settings import CalibrationSettings, Method
from spherecal.methods.sphere import describe_network
from spherecal_sim.boards import simulate_board, simulate_waved_bar
from spherecal_sim.rigs import Layout
from spherecal_sim.session import simulate_session
from spherecal_sim.truth import SimulationOptions, Truth
from spherecal_study.batch import calibrate_session
from spherecal_study.identity_damping import minimise_with_identity
from spherecal_study.measures import bar_figures, calibration_only, outcome, residual_figures
from spherecal_study.recorded import detected, recorded
from spherecal_study.rendered import render, rendered_ball, rendered_bars, rendered_board, rendered_waved_bar
from spherecal_study.wand import errors_and_bounds

BAR_POSES = 20  # of each bar, as in the paper
# Converged: within this of the optimum's rms, the rest of a few slow steps; other minima are ten times off and more.
_SAME_RMS = 1.05
_ITERATIONS = 150


def ball(
    preset: str, seed: int, sigma_px: float | None, placements: int = 4, layout: Layout = "spread",
    method: Method = "auto", search: Search = "opt", spherical: bool = True, cameras: int | None = None,
) -> dict[str, Any]:  # fmt: skip
    """One calibration with the ball: residuals, bars, errors of the calibration alone.

    Here and below, `sigma_px` None takes rendered images instead of simulated observations.
    """
    session, truth = _session(preset, seed, sigma_px, placements, layout)
    bars = _with_bars(session, preset, seed, sigma_px)
    if cameras is not None:
        session, truth = some_cameras(session, truth, cameras)
    settings = CalibrationSettings(method=method, search=search, spherical_projection=spherical)
    calibration, cpu_s = _timed(session, settings)
    return {
        **outcome(calibration, cpu_s), **residual_figures(calibration), **bar_figures(bars, calibration),
        **calibration_only(truth, calibration), "method": calibration.method,
    }  # fmt: skip


def board(
    preset: str, seed: int, sigma_px: float | None, placements: int, print_sd_mm: float = 0.0
) -> dict[str, Any]:  # fmt: skip
    """One calibration of the same rig with a plane board, its bars those of the ball's session."""
    if sigma_px is None:
        session = rendered_board(preset, seed, placements, print_sd_mm)
    else:
        session = simulate_board(preset, seed, placements, sigma_px=sigma_px, print_sd_mm=print_sd_mm).session
    return _rival(session, "board", preset, seed, sigma_px)


def bar(preset: str, seed: int, sigma_px: float | None, frames: int) -> dict[str, Any]:
    """One calibration of the same rig with a waved bar, its check bars those of the ball's session."""
    if sigma_px is None:
        session = rendered_waved_bar(preset, seed, frames)
    else:
        session = simulate_waved_bar(preset, seed, frames, sigma_px=sigma_px).session
    return _rival(session, "bar", preset, seed, sigma_px)


def _rival(recorded: Session, method: Method, preset: str, seed: int, sigma_px: float | None) -> dict[str, Any]:
    calibration, cpu_s = _timed(recorded, CalibrationSettings(method=method))
    session, truth = _session(preset, seed, sigma_px, 1, "spread")
    bars = _with_bars(session, preset, seed, sigma_px)
    return {
        **outcome(calibration, cpu_s), **residual_figures(calibration), **bar_figures(bars, calibration),
        **calibration_only(truth, calibration),
    }  # fmt: skip


def wand(preset: str, seed: int, sigma_px: float, frames: int) -> dict[str, Any]:
    """One calibration with a waved bar, against the truth and its bound."""
    recording = simulate_waved_bar(preset, seed, frames, sigma_px=sigma_px)
    calibration, cpu_s = _timed(recording.session, CalibrationSettings(method="bar"))
    return {**outcome(calibration, cpu_s), **errors_and_bounds(recording, calibration, sigma_px)}


def paths(preset: str, seed: int, sigma_px: float | None, search: Search) -> dict[str, Any]:
    """The graph, the paths of one search, and how good the start is that they give, chained without more ado."""
    session, truth = _session(preset, seed, sigma_px, None, "spread")
    return {
        **path_figures(observed(session, Context()), search),
        "places": [c.centre_mm.tolist() for c in truth.cameras],
    }


def path_figures(session: Session, search: Search) -> dict[str, Any]:
    """What `paths` says of a session with observations, but for the cameras' places."""
    network, local, known = _local(session, search)
    rotation, translation = chain_poses(local.paths, local.triples, local.graph.scale, len(known))
    placed = np.isfinite(translation[:, 0])
    chained = State(
        np.where(placed[:, None, None], rotation, np.eye(3)), np.where(placed[:, None], translation, 0.0), known,
        np.zeros((network.n_features, 3)),
    )  # fmt: skip
    located = network.locate(chained, local.keep & placed[network.camera])
    size = np.linalg.norm(located.residual, axis=1)
    size = size[np.isfinite(size)]
    graph = local.graph
    return {
        "start_px": float(np.median(size)) if len(size) else None,
        "start_mean_px": float(np.minimum(size, 1000.0).mean()) if len(size) else None,
        "lengths": {str(c): float(path.length) for c, path in local.paths.items()},
        "paths": {str(c): list(path.cameras) for c, path in local.paths.items()},
        "edges": [[a, b, edge.weight] for a, edges in enumerate(graph.edges) for b, edge in edges.items() if a < b],
        "reference": graph.reference,
        "ids": [c.id for c in session.cameras],
    }  # fmt: skip


def recorded_paths(session: str, fingerprint: str, search: Search) -> dict[str, Any]:
    """The graph, paths and start of a recorded session; see `recorded`."""
    del fingerprint
    return path_figures(detected(Path(session)), search)


def noise(
    preset: str, seed: int, sigma_px: float, percent: float, spherical: bool, damping: str, retriangulate: bool = False
) -> dict[str, Any]:
    """Whether the adjustment converges from points displaced by so many percent of the ball's radius (22).

    `damping`: `diagonal`, as the product has it, `identity` with lengths in units of the start (its base lines are near
    1), or `identity-mm`. `retriangulate` takes points anew from the cameras.
    """
    session, truth = _session(preset, seed, sigma_px, 4, "spread")
    session = observed(session, Context())
    network, local, known = _local(session, "opt")
    start = grow(local, network, known, local.keep, Context())
    points = chain_points(
        local.paths, local.triples, local.graph.scale, start.state.rotation, start.state.translation, network.n_features
    )
    candidates = local.keep & start.placed[network.camera] & np.isfinite(points[network.feature, 0])
    placement = find_features(calibration_observations(session)).placement
    radius = _radius(points, placement)
    rng = np.random.default_rng([seed, int(percent * 100)])
    displaced = points + percent / 100 * radius * _within_one(rng, points.shape)
    if spherical:
        displaced = project_to_spheres(displaced, placement)
    if retriangulate:
        displaced, good = usable_features(network, start.state, candidates)
        candidates = candidates & good[network.feature]
    used = candidates & (network.views(candidates) >= 2)[network.feature]
    state = replace(start.state, points=np.nan_to_num(displaced))
    if damping == "identity-mm":  # the identity weighs lengths by their unit
        state = state.scaled(truth.options.ball_radius_mm / radius)
    cost, converged = _adjust_plainly(network, state, used, damping)
    best, _ = _adjust_plainly(network, _true_state(network, truth), used, "diagonal")
    n = int(used.sum())
    return {
        "rms_px": float(np.sqrt(2 * cost / n)), "best_px": float(np.sqrt(2 * best / n)),
        "minimiser_converged": converged, "converged": cost <= best * _SAME_RMS**2,
    }  # fmt: skip


def _timed(session: Session, settings: CalibrationSettings) -> tuple[Calibration, float]:
    """A calibration and the processor time it took: unlike wall time the same beside other work."""
    began = time.process_time()
    calibration = calibrate(session, settings)
    return calibration, time.process_time() - began


def _session(
    preset: str, seed: int, sigma_px: float | None, placements: int | None, layout: Layout
) -> tuple[Session, Truth]:  # fmt: skip
    if sigma_px is None:
        return rendered_ball(preset, seed, placements, layout)
    options = SimulationOptions(placements=placements, layout=layout, sigma_px=sigma_px, bar_poses=BAR_POSES)
    return simulate_session(preset, seed, options)


def _with_bars(session: Session, preset: str, seed: int, sigma_px: float | None) -> Session:
    """The session in which the check bars are observed: rendered ones are a session of their own."""
    return session if sigma_px is not None else observed(rendered_bars(preset, seed), Context(), bar_poses_only=True)


def some_cameras(session: Session, truth: Truth, count: int) -> tuple[Session, Truth]:
    """The session of the `count` cameras nearest to the rig's middle: they overlap most."""
    centres = np.array([c.centre_mm for c in truth.cameras])
    off = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    kept = np.sort(np.argsort(off, kind="stable")[:count])
    cameras = tuple(session.cameras[c] for c in kept)
    truth = replace(
        truth, cameras=tuple(truth.cameras[c] for c in kept), sigma_px=truth.sigma_px[kept],
        misfit_phases=truth.misfit_phases[kept],
    )  # fmt: skip
    o = session.observations
    if o is None:
        ids = {camera.id for camera in cameras}
        placements = tuple(
            replace(p, images={camera: path for camera, path in p.images.items() if camera in ids})
            for p in session.placements
        )
        return replace(session, cameras=cameras, placements=placements), truth
    keep = np.isin(o.camera, kept)
    own = o.select(keep)
    own = replace(own, cameras=tuple(o.cameras[c] for c in kept), camera=np.searchsorted(kept, own.camera))
    truth = replace(truth, uv_true_px=truth.uv_true_px[keep], outlier=truth.outlier[keep])
    return replace(session, cameras=cameras, observations=own), truth


def _local(session: Session, search: Search) -> tuple[Network, LocalNetwork, FloatArray]:
    recording = Recording.of(session)
    network = describe_network(recording, CalibrationSettings(method="free", search=search))
    known = np.array([camera.prior for camera in session.cameras])
    local = reconstruct_locally(recording.observations, recording.features, known, search, 0, Context())
    return network, local, known


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
        np.array([c.rotation for c in truth.cameras]), np.array([c.translation_mm for c in truth.cameras]),
        np.array([c.intrinsics for c in truth.cameras]), np.zeros((network.n_features, 3)),
    )  # fmt: skip
    located = network.locate(state, np.ones(len(network.uv), dtype=bool))
    return replace(state, points=np.nan_to_num(located.points))


def _adjust_plainly(network: Network, state: State, used: BoolArray, damping: str) -> tuple[float, bool]:
    """Half the sum of squares that a plain adjustment of all unknowns ends with, and whether it says it converged."""
    placed = np.isfinite(state.translation[:, 0])
    problem, _ = network.problem(used, network.free, placed, weighted=True)
    if damping != "diagonal":
        minimum = minimise_with_identity(problem, state)
    else:
        minimum = minimise(problem, state, Settings(max_iterations=_ITERATIONS))
    return minimum.cost, minimum.converged


KINDS: dict[str, Callable[..., dict[str, Any]]] = {
    "ball": ball, "board": board, "bar": bar, "wand": wand, "paths": paths, "noise": noise,
    "session": calibrate_session,
    "render": render,
    "recorded": recorded,
    "recorded-paths": recorded_paths,
}  # fmt: skip
