"""One recording calibrated in every form, and what each makes of the bars."""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.studies.simulated import BarErrors, Bars, bar_errors
from spherecal.base.arrays import FloatArray
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.steps.settings import CalibrationSettings, Method
from spherecal_sim.truth import Truth


@dataclass(frozen=True)
class Measured:
    """A calibration's bars, its variance of unit weight over the simulated one, and the form it was made in.

    `normalised` (n,): absolute errors of the bars over their standard uncertainties as the rig states them.
    """

    bars: BarErrors
    chi2: float
    form: str
    shape_sd_mm: float | None = None
    normalised: FloatArray = field(default_factory=lambda: np.zeros(0))


def measured(session: Session, truth: Truth, bars: Bars, noise: FloatArray, method: Method) -> Measured:
    """The whole of `calibrate`, and the bars with the rig that it gives."""
    calibration = calibrate(session, CalibrationSettings(method=method))
    sigma0 = calibration.rig.quality.sigma0
    form = calibration.rig.form
    return Measured(
        bar_errors(calibration, truth, bars, noise),
        np.nan if sigma0 is None else (sigma0 / truth.options.sigma_px) ** 2,
        "free" if form is None else form.name,
        None if form is None else form.shape_sd_mm,
        _normalised(calibration, truth, bars, noise),
    )


def _normalised(calibration: Calibration, truth: Truth, bars: Bars, noise: FloatArray) -> FloatArray:
    if calibration.rig.covariance is None or len(calibration.rig.cameras) < len(truth.cameras):
        return np.full(len(bars.lengths_mm), np.inf)
    return np.abs(bars.errors_of_rig(calibration, noise)) / bars.stated_of_rig(calibration, truth)


def in_every_form(
    session: Session, truth: Truth, bars: Bars, noise: FloatArray, forms: tuple[Method, ...] = ("free", "rigid")
) -> dict[str, Measured]:
    """Each of the forms, and `auto`, which takes one."""
    auto = measured(session, truth, bars, noise, "auto")
    out = {"auto": auto}
    for form in forms:
        out[form] = auto if auto.form == form else measured(session, truth, bars, noise, form)
    return out


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
