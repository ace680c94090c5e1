"""What a trial measures of a calibrated rig: residuals, reference bars, errors of the calibration alone."""

from dataclasses import replace
from typing import Any

import numpy as np

from spherecal.data.rig import Calibration
from spherecal.data.rig_camera import posed
from spherecal.data.session import Session
from spherecal.geometry.triangulation import triangulate
from spherecal.verify.verify_bars import verify
from spherecal_sim.simulated_bars import study_bars
from spherecal_sim.truth import Truth

_BARS_SEED = 99


def residual_figures(calibration: Calibration) -> dict[str, Any]:
    """Mean absolute residuals and standard deviations in x and y, and their mean and root mean square length, px.

    None where no observation was used.
    """
    du = calibration.residuals_px[calibration.used]
    quality = calibration.rig.quality
    if not len(du):
        return {"mean_abs_px": [None, None], "sd_px": [None, None], "mean_px": None, "rms_px": None}
    return {
        "mean_abs_px": np.abs(du).mean(axis=0).tolist(),
        "sd_px": du.std(axis=0).tolist(),
        "mean_px": quality.mean_px,
        "rms_px": quality.rms_px,
    }


def outcome(calibration: Calibration, cpu_s: float) -> dict[str, Any]:
    """Whether it is valid, how many cameras were placed, the seconds of each stage, the processor time of all."""
    return {
        "valid": calibration.rig.quality.valid,
        "cameras": len(calibration.rig.cameras),
        "seconds": {stage: float(s) for stage, s in calibration.seconds.items()},
        "cpu_s": cpu_s,
    }


def bar_figures(session: Session, calibration: Calibration) -> dict[str, Any]:
    """Errors in mm of the check bars of a session by length, and the stated standard uncertainty of each length, mm.

    The latter is the root mean square of the combined standard uncertainties of a length in all poses.
    """
    if not calibration.rig.cameras:
        return {"bars": {}, "bars_u_mm": {}}
    verification = verify(session, calibration.rig)
    errors: dict[str, list[float]] = {}
    stated: dict[str, list[float]] = {}
    for m in verification.measured:
        label = f"{m.from_mark}{m.to_mark}"
        errors.setdefault(label, []).append(float(m.error_mm))
        stated.setdefault(label, []).append(float(m.budget.combined_mm))
    return {"bars": errors, "bars_u_mm": {k: float(np.sqrt(np.square(v).mean())) for k, v in stated.items()}}


def calibration_only(truth: Truth, calibration: Calibration) -> dict[str, Any]:
    """Errors in mm of forty bars of 100 to 500 mm whose image points are perfect: what the calibration alone does."""
    exact = study_bars(replace(truth, sigma_px=np.zeros(len(truth.cameras))), np.random.default_rng(_BARS_SEED))
    o = exact.observations
    rig = calibration.rig
    index = np.array([next((i for i, c in enumerate(rig.cameras) if c.id == name), -1) for name in o.cameras])
    rows = np.flatnonzero(index[o.camera] >= 0)
    if len(rig.cameras) < 2 or not len(rows):
        return {"exact_errors_mm": []}
    point = 2 * o.placement[rows] + o.target[rows] - 1
    found = triangulate(
        point,
        index[o.camera[rows]],
        o.uv[rows],
        np.ones(len(rows)),
        2 * len(exact.lengths_mm),
        posed(rig.cameras),
    )
    ends = found.points.reshape(-1, 2, 3)
    error = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) - exact.lengths_mm
    return {"exact_errors_mm": error[np.isfinite(error)].tolist()}


def all_errors(result: dict[str, Any]) -> list[float]:
    """The errors of all bars of a trial's result in one list, mm."""
    return [float(error) for errors in result["bars"].values() for error in errors]
