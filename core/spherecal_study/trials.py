"""The trials of the studies: each a function of plain settings whose result is plain JSON."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.data.session import STANDARD_PLACEMENTS, Recording, Session
from spherecal.detect.redetection import Located, with_missed_targets
from spherecal.detect.session_images import observed
from spherecal.geometry.transform import fit_similarity
from spherecal.initialise.camera_path import Search, find_paths
from spherecal.initialise.local import LocalNetwork
from spherecal.initialise.view_graph import EdgeWeights
from spherecal.steps.repairs import Repairs
from spherecal.steps.settings import CalibrationSettings, Method
from spherecal.steps.tao2021 import adjacency, local_reconstruction, optimal_path_transformation, plain_state
from spherecal_files.read_session import read_session
from spherecal_files.table_file import read_observations, write_observations
from spherecal_sim.rigs import Layout, TrueCamera
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_boards import simulate_board, simulate_waved_bar
from spherecal_sim.truth import SimulationOptions, Truth
from spherecal_study.batch_of_sessions import calibrate_session
from spherecal_study.displacement import PERCENT, displaced_cases, path_length, published_cases
from spherecal_study.rendered import render, rendered_ball, rendered_bars, rendered_board, rendered_waved_bar
from spherecal_study.study_agreement import bar_figures, calibration_only, outcome, residual_figures
from spherecal_study.wand import errors_and_bounds


def recorded(
    session: str, fingerprint: str, method: Method = "auto", search: Search = "opt", without: list[str] | None = None
) -> dict[str, Any]:
    """Calibrate a session without some of it (`--leave-out`): residuals, check bars, centres, or a message."""
    del fingerprint
    loaded = detected(Path(session))
    settings = CalibrationSettings(method=method, search=search, repairs=Repairs(leave_out=tuple(without or ())))
    try:
        calibration = calibrate(loaded, settings)
    except InputError as error:
        return {"valid": False, "cameras": 0, "mean_px": None, "bars": {}, "centres": {}, "message": str(error)}
    check = {bar.id for bar in loaded.bars if bar.role == "check"}
    bars = {"bars": {}, "bars_u_mm": {}}
    if any(pose.bar in check for pose in loaded.bar_poses):
        bars = bar_figures(loaded, calibration)
    return {
        **outcome(calibration, 0.0),
        **residual_figures(calibration),
        **bars,
        "method": calibration.method,
        "centres": {camera.id: camera.centre_mm.tolist() for camera in calibration.rig.cameras},
        "message": "",
    }


def detected(folder: Path) -> Session:
    """A session with observations: its own, or those found in its images once and then kept in the user's cache."""
    session = read_session(folder)
    if session.observations is not None:
        return session
    from platformdirs import user_cache_path

    kept = user_cache_path("spherecal", appauthor=False) / "studies" / f"detected-{session.input_sha256[:16]}.csv"
    names = [p.id for p in (*session.placements, *session.bar_poses)]
    cameras, sizes = [c.id for c in session.cameras], [c.image_size for c in session.cameras]
    if not kept.exists():
        seen = observed(session, Context())
        seen = with_missed_targets(seen, Located.of(calibrate(seen)), Context())
        assert seen.observations is not None
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_observations(kept, seen.observations)
    return replace(session, observations=read_observations(kept, names, cameras, sizes))


def apart_mm(centres: dict[str, list[float]], whole: dict[str, list[float]]) -> float | None:
    """How far (rms, mm) cameras are from where the whole recording has them, after a rigid motion; None below 3."""
    common = sorted(set(centres) & set(whole))
    if len(common) < 3:
        return None
    here, there = (np.array([places[name] for name in common]) for places in (centres, whole))
    fit = fit_similarity(here, there, with_scale=False)
    return float(np.sqrt(((fit.apply(here) - there) ** 2).sum(axis=1).mean()))


def seen_along_the_thinnest(centres: dict[str, list[float]], ids: list[str]) -> FloatArray:
    """Places (c, 2) of cameras' centres (3,) in the plane in which they spread most; NaN where not placed."""
    known = np.array(list(centres.values()))
    axes = np.linalg.svd(known - known.mean(axis=0))[2][:2]
    nowhere = [np.nan] * 3
    return (np.array([centres.get(name, nowhere) for name in ids]) - known.mean(axis=0)) @ axes.T


PathNumbers = Sequence[float]  # xi1, xi2, TH_er in px, b

BAR_POSES = 20  # of each bar, as in the paper
_SEARCHED = 21


def ball(
    preset: str,
    seed: int,
    sigma_px: float | None,
    placements: int = STANDARD_PLACEMENTS,
    layout: Layout = "spread",
    method: Method = "auto",
    search: Search = "opt",
    spherical: bool = True,
    cameras: int | None = None,
    print_sd_mm: float = 0.0,
    known: bool = False,
    paths: PathNumbers | None = None,
) -> dict[str, Any]:
    """One calibration with the ball: residuals, bars, the calibration alone; `sigma_px` None: rendered images."""
    session, truth = _session(preset, seed, sigma_px, placements, layout, print_sd_mm, known)
    bars = _with_bars(session, preset, seed, sigma_px)
    if cameras is not None:
        session, truth = some_cameras(session, truth, cameras)
    settings = CalibrationSettings(method=method, search=search, spherical_projection=spherical, **_of_paths(paths))
    calibration, cpu_s = _timed(session, settings)
    figures = _figures(calibration, cpu_s, bars, truth)
    return {**figures, **by_camera(calibration), "method": calibration.method}


def _figures(calibration: Calibration, cpu_s: float, bars: Session, truth: Truth) -> dict[str, Any]:
    return {
        **outcome(calibration, cpu_s),
        **residual_figures(calibration),
        **bar_figures(bars, calibration),
        **calibration_only(truth, calibration),
    }


def board(
    preset: str,
    seed: int,
    sigma_px: float | None,
    placements: int,
    print_sd_mm: float = 0.0,
    joint: bool = True,
    known: bool = False,
) -> dict[str, Any]:
    """One calibration of the rig with a plane board, bars those of the ball's session; `sigma_px` None: rendered."""
    if sigma_px is None:
        session = rendered_board(preset, seed, placements, print_sd_mm)
    else:
        session = simulate_board(preset, seed, placements, sigma_px=sigma_px, print_sd_mm=print_sd_mm).session
    return _rival(session, CalibrationSettings(method="board", joint=joint), preset, seed, sigma_px, known)


def bar(
    preset: str, seed: int, sigma_px: float | None, frames: int, joint: bool = True, known: bool = False
) -> dict[str, Any]:
    """One calibration of the rig with a waved bar, check bars of the ball's session; `sigma_px` None: rendered."""
    if sigma_px is None:
        session = rendered_waved_bar(preset, seed, frames)
    else:
        session = simulate_waved_bar(preset, seed, frames, sigma_px=sigma_px).session
    settings = CalibrationSettings(method="bar", joint=joint, intrinsics="fixed" if known and not joint else "free")
    return _rival(session, settings, preset, seed, sigma_px, known)


def _rival(
    recorded: Session, settings: CalibrationSettings, preset: str, seed: int, sigma_px: float | None, known: bool
) -> dict[str, Any]:
    session, truth = _session(preset, seed, sigma_px, 1, "spread")
    recorded = _with_known(recorded, truth.cameras) if known else recorded
    calibration, cpu_s = _timed(recorded, settings)
    return _figures(calibration, cpu_s, _with_bars(session, preset, seed, sigma_px), truth)


def wand(preset: str, seed: int, sigma_px: float, frames: int, known: bool = False) -> dict[str, Any]:
    """One calibration with a waved bar, against the truth and its bound."""
    recording = simulate_waved_bar(preset, seed, frames, sigma_px=sigma_px)
    session = _with_known(recording.session, recording.cameras) if known else recording.session
    calibration, cpu_s = _timed(session, CalibrationSettings(method="bar"))
    return {**outcome(calibration, cpu_s), **errors_and_bounds(recording, calibration, sigma_px)}


def paths(
    preset: str,
    seed: int,
    sigma_px: float | None,
    search: Search,
    known: bool = False,
    paths: PathNumbers | None = None,
) -> dict[str, Any]:
    """The graph, the paths of one search, and the chained start; `sigma_px` None: rendered images."""
    session, truth = _session(preset, seed, sigma_px, None, "spread", known=known)
    figures = path_figures(observed(session, Context()), search, paths)
    return {**figures, "places": [c.centre_mm.tolist() for c in truth.cameras]}


def path_figures(session: Session, search: Search, numbers: PathNumbers | None = None) -> dict[str, Any]:
    """The result of `paths` for a session with observations, but for the cameras' places; by the paper's own pipeline.

    `count_share`: the median share of xi2 / N in an edge's weight, [Tao21] (13); `changed_by_count`: how many cameras
    have another path without it; `search_s`: processor time of a search of all paths. `numbers`: xi1, xi2, TH_er in px
    and b; None leaves all to the method.
    """
    settings = CalibrationSettings(method="tao2021", search=search, **_of_paths(numbers))
    recording = Recording.of(session)
    local = local_reconstruction(recording, settings, Context())
    start = optimal_path_transformation(recording, local, settings)
    triangulated = start.network.triangulated(plain_state(start), start.candidates)
    size = np.linalg.norm(triangulated.residual, axis=1)
    size = size[np.isfinite(size)]
    graph, lengths = local.graph, {c: path_length(local, path, settings) for c, path in local.paths.items()}
    of_count, changed = _part_of_count(local, settings)
    times = [time.process_time()]
    for _ in range(_SEARCHED if local.triples else 0):
        find_paths(graph, local.triples, search, settings.base)
        times.append(time.process_time())
    return {
        "search_s": float(np.median(np.diff(times))) if len(times) > 1 else None,
        "count_share": of_count,
        "changed_by_count": changed,
        "start_px": float(np.median(size)) if len(size) else None,
        "start_mean_px": float(np.minimum(size, 1000.0).mean()) if len(size) else None,
        "lengths": {str(c): length if np.isfinite(length) else None for c, length in lengths.items()},
        "paths": {str(c): list(path.cameras) for c, path in local.paths.items()},
        "edges": [[a, b, edge.weight] for a, edges in enumerate(graph.edges) for b, edge in edges.items() if a < b],
        "reference": graph.reference,
        "ids": [c.id for c in session.cameras],
    }


def recorded_paths(session: str, fingerprint: str, search: Search) -> dict[str, Any]:
    """The graph, paths and start of a recorded session (see `path_figures`)."""
    del fingerprint
    return path_figures(detected(Path(session)), search)


def displaced(
    preset: str,
    seed: int,
    sigma_px: float | None,
    damping: Literal["diagonal", "identity"],
    known: bool = False,
    percents: Sequence[int] = PERCENT,
) -> dict[str, Any]:
    """How the paper's adjustment ends from points displaced by % of the radius, [Tao21] (22); see displacement.py."""
    session, truth = _session(preset, seed, sigma_px, STANDARD_PLACEMENTS, "spread", known=known)
    session = observed(session, Context())
    return displaced_cases(session, truth, seed, CalibrationSettings(method="tao2021", damping=damping), percents)


def published(
    preset: str,
    seed: int,
    sigma_px: float | None,
    known: bool = False,
    th_pt: int | None = None,
    paths: PathNumbers | None = None,
) -> dict[str, Any]:
    """How the paper's adjustment ends from every variant of its start, and our robust start; None: as the method."""
    session, truth = _session(preset, seed, sigma_px, STANDARD_PLACEMENTS, "spread", known=known)
    session = observed(session, Context())
    settings = CalibrationSettings(method="tao2021", **_of_paths(paths))
    done = published_cases(session, truth, settings if th_pt is None else replace(settings, th_pt=th_pt))
    ours, cpu_s = _timed(session, CalibrationSettings(method="free"))
    quality = ours.rig.quality
    return {**done, "ours": {"rms_px": quality.rms_px, "cameras": len(ours.rig.cameras), "cpu_s": cpu_s}}


def _timed(session: Session, settings: CalibrationSettings) -> tuple[Calibration, float]:
    """A calibration and the processor time it took: unlike wall time the same beside other work."""
    began = time.process_time()
    calibration = calibrate(session, settings)
    return calibration, time.process_time() - began


def _session(
    preset: str, seed: int, sigma_px: float | None, placements: int | None, layout: Layout, print_sd_mm: float = 0.0,
    known: bool = False,
) -> tuple[Session, Truth]:  # fmt: skip
    """The ball's session and its truth; `known`: with the true intrinsics."""
    if sigma_px is None:
        session, truth = rendered_ball(preset, seed, placements, layout)
    else:
        options = SimulationOptions(
            placements=placements, layout=layout, sigma_px=sigma_px, bar_poses=BAR_POSES, print_sd_mm=print_sd_mm
        )
        session, truth = simulate_session(preset, seed, options)
    return _with_known(session, truth.cameras) if known else session, truth


def _with_bars(session: Session, preset: str, seed: int, sigma_px: float | None) -> Session:
    """The session in which the check bars are observed: rendered ones are a session of their own."""
    return session if sigma_px is not None else observed(rendered_bars(preset, seed), Context(), bar_poses_only=True)


def some_cameras(session: Session, truth: Truth, count: int) -> tuple[Session, Truth]:
    """The session and truth of the cameras nearest to the rig's middle: they overlap most."""
    centres = np.array([c.centre_mm for c in truth.cameras])
    off = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    kept = np.sort(np.argsort(off, kind="stable")[:count])
    cameras = tuple(session.cameras[c] for c in kept)
    truth = replace(
        truth,
        cameras=tuple(truth.cameras[c] for c in kept),
        sigma_px=truth.sigma_px[kept],
        misfit_phases=truth.misfit_phases[kept],
    )
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


def _part_of_count(local: LocalNetwork, settings: CalibrationSettings) -> tuple[float, int]:
    """The median share of xi2 / N in the edges' weights, and how many paths are others without it."""
    weights = settings.weights
    shares = [
        weights.count / local.counts[a, b] / edge.weight
        for a, edges in enumerate(local.graph.edges)
        for b, edge in edges.items()
        if a < b
    ]
    plain = adjacency(local.triples, local.counts, replace(weights, count=0.0))
    other = find_paths(plain, local.triples, settings.search, settings.base) if local.triples else {}
    changed = sum(other.get(c) is None or other[c].cameras != path.cameras for c, path in local.paths.items())
    return float(np.median(shares)) if shares else 0.0, changed


def _of_paths(numbers: PathNumbers | None) -> dict[str, Any]:
    """The settings of a calibration for xi1, xi2, TH_er and b; none where they are left to the method."""
    if numbers is None:
        return {}
    return {"weights": EdgeWeights(*numbers[:3]), "base": numbers[3]}


def _with_known(session: Session, cameras: Sequence[TrueCamera]) -> Session:
    """The session with the true intrinsics as known before."""
    true = {camera.id: camera.intrinsics for camera in cameras}
    return replace(session, cameras=tuple(replace(c, prior=true[c.id]) for c in session.cameras))


def by_camera(calibration: Calibration) -> dict[str, Any]:
    """Mean absolute residuals and standard deviations in x and y, px, by camera in the rig's order."""
    o = calibration.observations
    rows = {c.id: calibration.used & (o.camera == o.cameras.index(c.id)) for c in calibration.rig.cameras}
    residuals = {name: calibration.residuals_px[own] for name, own in rows.items() if own.any()}
    return {
        "camera_mean_abs_px": {name: np.abs(r).mean(axis=0).tolist() for name, r in residuals.items()},
        "camera_sd_px": {name: r.std(axis=0).tolist() for name, r in residuals.items()},
    }


KINDS: dict[str, Callable[..., dict[str, Any]]] = {
    "ball": ball, "board": board, "bar": bar, "wand": wand, "paths": paths, "displaced": displaced,
    "published": published,
    "session": calibrate_session,
    "render": render,
    "recorded": recorded,
    "recorded-paths": recorded_paths,
}  # fmt: skip
