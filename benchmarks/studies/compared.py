"""One recording calibrated in every form, and what each makes of the bars."""

from dataclasses import dataclass

import numpy as np

from benchmarks.studies.simulated import BarErrors, Bars, Form, bar_errors
from spherecal.arrays import FloatArray
from spherecal.calibrate import CalibrationSettings, Method, calibrate
from spherecal.session.model import Session
from spherecal.simulate.truth import Truth


@dataclass(frozen=True)
class Measured:
    """A calibration's bars, its variance of unit weight over the simulated one, and the form it was made in."""

    bars: BarErrors
    chi2: float
    form: Form


def measured(session: Session, truth: Truth, bars: Bars, noise: FloatArray, method: Method) -> Measured:
    """The whole of `calibrate`, and the bars with the rig that it gives."""
    calibration = calibrate(session, CalibrationSettings(method=method))
    sigma0 = calibration.rig.quality.sigma0
    codes = {finding.code for finding in calibration.rig.quality.findings}
    return Measured(
        bar_errors(calibration, truth, bars, noise),
        np.nan if sigma0 is None else (sigma0 / truth.options.sigma_px) ** 2,
        "rigid" if "form-rigid" in codes else "free",
    )


def in_every_form(session: Session, truth: Truth, bars: Bars, noise: FloatArray) -> dict[str, Measured]:
    """`free`, `rigid` and `auto`, which is one of the two."""
    auto = measured(session, truth, bars, noise, "auto")
    other: Form = "free" if auto.form == "rigid" else "rigid"
    return {"auto": auto, auto.form: auto, other: measured(session, truth, bars, noise, other)}


def rmse_um(found: list[Measured], kind: str = "measured") -> float:
    """Over all bars and runs; `measured` or `rescaled`."""
    return 1e3 * float(np.sqrt(np.mean([getattr(m.bars, kind) for m in found])))


def ratio_error(one: list[Measured], other: list[Measured]) -> float:
    """Standard error of the ratio of two RMSEs of the same runs, by leaving out one run at a time (jackknife)."""
    a, b = (np.array([m.bars.measured.mean() for m in found]) for found in (one, other))
    n = len(a)
    if n < 2:
        return np.inf
    left_out = np.sqrt((a.sum() - a) / (b.sum() - b))
    return float(np.sqrt((n - 1) / n * ((left_out - left_out.mean()) ** 2).sum()))
