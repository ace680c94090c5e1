"""What wrong observations do: exchanged ids, poor centres and points anywhere, against the same recording without."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies.alignment import similarity
from benchmarks.studies.report import Report
from benchmarks.studies.simulated import RIGS, Bars, Simulated, make_bars, simulate
from spherecal.arrays import FloatArray
from spherecal.calibrate import calibrate
from spherecal.rig import Calibration
from spherecal.simulate.truth import SimulationOptions

RUNS = 20
SEED_BARS = 5
SHARES = (0.005, 0.02, 0.05)
WORST_RATIO = 1.3


@dataclass(frozen=True)
class Outcome:
    """One recording: cameras linked, wrong ones still used, good ones given up, squares of bar errors (n,) mm^2.

    `clean_squares` are those of the same recording without wrong observations; `worst_missed_px` is the largest
    displacement among the wrong ones still used.
    """

    linked: int
    cameras: int
    wrong: int
    missed: int
    worst_missed_px: float
    dropped: int
    squares: FloatArray
    clean_squares: FloatArray


def study(rig: str, runs: int, options: SimulationOptions | None = None) -> dict[float, list[Outcome]]:
    """`runs` recordings, each of a rig of its own, for every share of wrong observations."""
    options = options or SimulationOptions()
    out: dict[float, list[Outcome]] = {share: [] for share in SHARES}
    for seed in range(1, runs + 1):
        clean = simulate(rig, seed, options)
        bars = make_bars(clean.truth, SEED_BARS)
        reference = calibrate(clean.session)
        for share in SHARES:
            spoilt = simulate(rig, seed, replace(options, outlier_fraction=share))
            out[share].append(_compare(clean, reference, spoilt, bars, seed))
    return out


def _compare(clean: Simulated, reference: Calibration, spoilt: Simulated, bars: Bars, seed: int) -> Outcome:
    noise = np.random.default_rng(seed).normal(size=bars.uv.shape)
    result = calibrate(spoilt.session)
    wrong = spoilt.truth.outlier
    off = np.linalg.norm(spoilt.observations.uv - spoilt.truth.uv_true_px, axis=1)
    missed = wrong & result.used
    return Outcome(
        len(result.rig.cameras), len(clean.truth.cameras), int(wrong.sum()), int(missed.sum()),
        float(off[missed].max(initial=0.0)), int((reference.used & ~wrong & ~result.used).sum()),
        _bar_squares(result, clean, bars, noise), _bar_squares(reference, clean, bars, noise),
    )  # fmt: skip


def _bar_squares(calibration: Calibration, simulated: Simulated, bars: Bars, noise: FloatArray) -> FloatArray:
    """With the scale removed: it is noise of its own, the same with and without wrong observations."""
    if len(calibration.rig.cameras) < len(simulated.truth.cameras):
        return np.full(len(bars.lengths_mm), np.nan)
    measured = bars.errors_of_rig(calibration, noise) + bars.lengths_mm
    known = np.isfinite(calibration.points_mm[:, 0]) & np.isfinite(simulated.true.points[:, 0])
    stretch = similarity(calibration.points_mm[known], simulated.true.points[known]).scale
    return (stretch * measured - bars.lengths_mm) ** 2


def report(runs: int | None, rigs: Sequence[str] = RIGS, options: SimulationOptions | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    page = Report("Outliers", f"dev.py studies outliers --runs {runs}")
    page.text(
        f"{runs} recordings (seeds 1 to {runs}, each a rig of its own) for each rig and share. Of the wrong "
        "observations half are exchanged target ids, 30 % are 0.5 to 3 px off and 20 % lie anywhere. Bars as in the "
        "study of accuracy, the scale removed; `ratio` compares with the same recordings, same noise, without wrong "
        "observations."
    )
    rows, goals = [], []
    for rig in rigs:
        for share, outcomes in study(rig, runs, options).items():
            linked = sum(o.linked == o.cameras for o in outcomes)
            rmse, clean = (1e3 * float(np.sqrt(np.mean([getattr(o, name) for o in outcomes])))
                           for name in ("squares", "clean_squares"))  # fmt: skip
            single = [float(np.sqrt(o.squares.mean() / o.clean_squares.mean())) for o in outcomes]
            rows.append((
                rig, f"{100 * share:g} %", f"{linked} of {runs}", clean, rmse, rmse / clean, float(np.median(single)),
                max(single), _mean(outcomes, "wrong"), _mean(outcomes, "missed"),
                max(o.worst_missed_px for o in outcomes), _mean(outcomes, "dropped"),
            ))  # fmt: skip
            goals.append((f"{rig} {100 * share:g} %", linked, rmse / clean))
    page.table(
        ("rig", "wrong", "all cameras linked", "clean RMSE um", "RMSE um", "ratio", "median ratio of a run",
         "largest", "wrong ones", "of them missed", "largest missed px", "good ones given up"), rows,
    )  # fmt: skip
    page.heading("Goals")
    for name, linked, ratio in goals:
        page.verdict(f"{name}: all cameras linked", linked == runs, f"{linked} of {runs}")
        page.verdict(f"{name}: bar RMSE <= {WORST_RATIO} x clean", ratio <= WORST_RATIO, f"{ratio:.3f}")
    return page


def _mean(outcomes: list[Outcome], name: str) -> float:
    return float(np.mean([getattr(o, name) for o in outcomes]))
