"""Calibrations of parts of a recorded session: some placements, some cameras, another search."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.session import Session
from spherecal.detect.redetection import Located, with_missed_targets
from spherecal.detect.session_images import observed
from spherecal.geometry.transform import fit_similarity
from spherecal.initialise.camera_path import Search
from spherecal.steps.repairs import Repairs
from spherecal.steps.settings import CalibrationSettings, Method
from spherecal_files.read_session import read_session
from spherecal_files.table_file import read_observations, write_observations
from spherecal_study.study_agreement import bar_figures, outcome, residual_figures


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
