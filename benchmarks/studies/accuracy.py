"""How near the calibration comes to the Cramer-Rao bound, and whether its stated uncertainties are true.

Monte-Carlo: one rig, its ball at four placements and forty bars, recorded again and again with new noise. The
adjustment starts at the true network, which saves time; some runs go through the whole of `calibrate` as well and must
end in the same minimum.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies.alignment import centres, similarity
from benchmarks.studies.bound import BarBound, DenseNetwork, bar_bound, dense_network
from benchmarks.studies.report import Report
from benchmarks.studies.simulated import RIGS, Bars, Estimate, Simulated, estimate_from_truth, make_bars, simulate
from spherecal.adjust.covariance import covariance
from spherecal.arrays import FloatArray, IntArray
from spherecal.calibrate import calibrate
from spherecal.geometry.camera import INTRINSIC_NAMES
from spherecal.rig import Calibration
from spherecal.simulate.session import observe_again
from spherecal.simulate.truth import SimulationOptions

RUNS = 200
WHOLE_RUNS = 20  # of those, through `calibrate`
SEED_RIG, SEED_BARS, SEED_NOISE = 1, 5, 1000
SAME_MINIMUM = 1e-6
_PAIRS = 40  # lengths between ball points, for the covariance's functional


@dataclass(frozen=True)
class Normalised:
    """Errors over their predicted standard deviations: mean squares (runs, k) of k quantities, pooled as one."""

    squares: FloatArray

    @property
    def ratio(self) -> float:
        """Empirical over predicted standard deviation."""
        return float(np.sqrt(self.squares.mean()))

    @property
    def standard_error(self) -> float:
        """Of the ratio, from the scatter between runs."""
        by_run = self.squares.mean(axis=1)
        return float(by_run.std(ddof=1) / np.sqrt(len(by_run)) / (2 * self.ratio)) if len(by_run) > 1 else np.inf

    @property
    def extremes(self) -> tuple[float, float]:
        """Smallest and largest ratio of a single quantity."""
        single = np.sqrt(self.squares.mean(axis=0))
        return float(single.min()), float(single.max())


@dataclass(frozen=True)
class WholeRun:
    """A run through `calibrate` beside the one from the truth: observations that differ, costs, bars."""

    other_used: int
    cost_difference: float
    bar_difference_um: float


@dataclass(frozen=True)
class Accuracy:
    """The figures of one rig."""

    rig: str
    observations: int
    bound: BarBound
    covariance_difference: float
    bar_squares: FloatArray  # (runs, bars) mm^2
    by_length: FloatArray
    chi2: FloatArray
    redundancy: int
    normalised: dict[str, Normalised]
    whole: list[WholeRun]
    sigma_stated: Normalised | None

    @property
    def rmse_um(self) -> float:
        """Over all bars and runs."""
        return 1e3 * float(np.sqrt(self.bar_squares.mean()))

    @property
    def bound_um(self) -> float:
        """The same for an estimator on the bound."""
        return 1e3 * float(np.sqrt(self.bound.total.mean()))

    @property
    def ratio(self) -> float:
        """RMSE over the bound."""
        return self.rmse_um / self.bound_um

    @property
    def ratio_error(self) -> float:
        """Standard error of the ratio, from the scatter between runs (errors within a run are correlated)."""
        by_run = self.bar_squares.mean(axis=1)
        return float(by_run.std(ddof=1) / np.sqrt(len(by_run)) / (2 * by_run.mean()) * self.ratio)


def study(rig: str, runs: int, whole_runs: int, options: SimulationOptions | None = None) -> Accuracy:
    """The Monte-Carlo of one rig."""
    simulated = simulate(rig, SEED_RIG, options or SimulationOptions())
    bars = make_bars(simulated.truth, SEED_BARS)
    dense = dense_network(simulated)
    bound, difference = bar_bound(simulated, bars, dense), _covariance_difference(simulated, dense)
    del dense
    pairs = _pairs(simulated)
    errors, chi2, whole, collected, stated = [], [], [], [], []
    redundancy = 0
    for run in range(runs):
        rng = np.random.default_rng([SEED_NOISE, run])
        again = simulated.with_session(observe_again(simulated.session, simulated.truth, rng)[0])
        noise = rng.normal(size=bars.uv.shape)
        estimate = estimate_from_truth(again)
        errors.append(bars.errors_of(estimate.solution.state, noise))
        chi2.append(estimate.adjusted.variance / float(simulated.truth.sigma_px[0]) ** 2)
        redundancy = estimate.adjusted.redundancy
        collected.append(_normalised(again, estimate, pairs))
        if run < whole_runs:
            calibration = calibrate(again.session)
            whole.append(_compare(again, estimate, calibration, bars))
            if np.isfinite(whole[-1].bar_difference_um):
                stated.append(_stated_sigmas(again, calibration))
    return Accuracy(
        rig, int(simulated.usable.sum()), bound, difference, np.array(errors) ** 2, bars.lengths_mm, np.array(chi2),
        redundancy, {name: Normalised(np.array([c[name] for c in collected])) for name in collected[0]}, whole,
        Normalised(np.array(stated)) if stated else None,
    )  # fmt: skip


def _covariance_difference(simulated: Simulated, dense: DenseNetwork) -> float:
    """Largest relative difference between the product's standard deviations at the truth and the dense ones."""
    network, n = simulated.network, len(simulated.network.group)
    problem, _ = network.problem(simulated.usable, network.free, np.ones(n, dtype=bool), weighted=False)
    state = replace(simulated.true, points=np.nan_to_num(simulated.true.points))
    ours = covariance(problem, state, "numba")
    assert ours is not None
    sigma = float(simulated.truth.sigma_px[0])
    cameras = sigma * np.sqrt(np.einsum("cii->ci", ours.cameras))
    points = sigma * np.sqrt(np.einsum("pii->pi", ours.points[dense.points]))
    pairs = ((cameras, dense.camera_sd()), (points, dense.point_sd()))
    return float(max(np.abs(a / b - 1).max() for a, b in pairs))


def _pairs(simulated: Simulated) -> IntArray:
    """Pairs (k, 2) of points in three or more views, all over the volume."""
    often = np.flatnonzero(simulated.network.views(simulated.usable) >= 3)
    return np.random.default_rng(SEED_BARS).choice(often, (_PAIRS, 2), replace=False)


def _normalised(simulated: Simulated, estimate: Estimate, pairs: IntArray) -> dict[str, FloatArray]:
    """Squares of error over predicted standard deviation of all that the covariance predicts, (k,) each.

    The truth is brought to the estimate by the similarity over the points: that is the datum of the covariance.
    """
    state, cofactors, variance = estimate.adjusted.state, estimate.cofactors, estimate.adjusted.variance
    known = np.isfinite(cofactors.points[:, 0, 0]) & np.isfinite(simulated.true.points[:, 0])
    fit = similarity(simulated.true.points[known], state.points[known])
    true = fit.state(simulated.true)
    cameras = variance * cofactors.cameras
    out = {}
    sd = np.sqrt(np.einsum("cii->ci", cameras))
    for k, column in enumerate(estimate.adjusted.problem.intrinsic_columns):
        error = state.intrinsics[:, column] - true.intrinsics[:, column]
        out[INTRINSIC_NAMES[column]] = (error / sd[:, 6 + k]) ** 2
    turn = state.rotation @ true.rotation.transpose(0, 2, 1)
    angles = 0.5 * np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    out["rotation"] = ((angles / sd[:, :3]) ** 2).ravel()
    centre = np.einsum("cji,cjk,ckl->cil", state.rotation, cameras[:, 3:6, 3:6], state.rotation)
    out["centre"] = ((centres(state) - centres(true)) ** 2 / np.einsum("cii->ci", centre)).ravel()
    spread = variance * np.einsum("pii->pi", cofactors.points[known])
    z2 = (state.points[known] - true.points[known]) ** 2 / spread
    out["points"] = z2.mean(keepdims=True).ravel()
    out["point lengths"] = _length_squares(estimate, true.points, pairs)
    found = estimate.solution.scale.relative_uncertainty
    assert found is not None
    out["scale"] = np.array([((estimate.solution.factor * fit.scale - 1) / found) ** 2])
    return out


def _length_squares(estimate: Estimate, true: FloatArray, pairs: IntArray) -> FloatArray:
    """Of distances between points, by `Covariance.functional`."""
    points, squares = estimate.adjusted.state.points, []
    for first, second in pairs:
        difference = points[second] - points[first]
        length = np.linalg.norm(difference)
        gradient = np.zeros_like(points)
        gradient[second], gradient[first] = difference / length, -difference / length
        predicted = estimate.adjusted.variance * estimate.cofactors.functional(gradient)
        squares.append((length - np.linalg.norm(true[second] - true[first])) ** 2 / predicted)
    return np.array(squares)


def _compare(simulated: Simulated, estimate: Estimate, calibration: Calibration, bars: Bars) -> WholeRun:
    adjusted = estimate.adjusted
    if len(calibration.rig.cameras) < len(simulated.truth.cameras):
        return WholeRun(int((calibration.used != adjusted.used).sum()), np.inf, np.inf)
    cost = 0.5 * float((calibration.residuals_px[calibration.used] ** 2).sum())
    bar_difference = bars.errors_of_rig(calibration, None) - bars.errors_of(estimate.solution.state, None)
    return WholeRun(
        int((calibration.used != adjusted.used).sum()),
        abs(cost / adjusted.minimum.cost - 1),
        1e3 * float(np.abs(bar_difference).max()),
    )


def _stated_sigmas(simulated: Simulated, calibration: Calibration) -> FloatArray:
    """Squares of error over the standard uncertainties that rig.json states, all cameras' parameters together."""
    known = np.isfinite(calibration.points_mm[:, 0]) & np.isfinite(simulated.true.points[:, 0])
    true = similarity(simulated.true.points[known], calibration.points_mm[known]).state(simulated.true)
    squares = []
    for c, camera in enumerate(calibration.rig.cameras):
        assert camera.sigma is not None
        turn = camera.rotation @ true.rotation[c].T
        angles = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        free = camera.sigma.intrinsics > 0
        squares += [
            (np.rad2deg(angles) / camera.sigma.rotation_deg) ** 2,
            ((camera.centre_mm - centres(true)[c]) / camera.sigma.centre_mm) ** 2,
            ((camera.intrinsics - true.intrinsics[c])[free] / camera.sigma.intrinsics[free]) ** 2,
        ]
    return np.concatenate(squares)


def report(runs: int | None, rigs: Sequence[str] = RIGS, options: SimulationOptions | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    whole = min(runs, WHOLE_RUNS)
    page = Report("Accuracy: simulated rigs against the Cramer-Rao bound", f"dev.py studies accuracy --runs {runs}")
    page.text(
        f"{runs} runs a rig, four placements, 0.04 px; rig seed {SEED_RIG}, bars {SEED_BARS}, noise "
        f"({SEED_NOISE}, run). Forty bars at random in the volume, eight each of 100 to 500 mm, every end in three or "
        "more views, are measured by triangulation with the same noise; the scale comes from the targets' A-E "
        "distances.",
    )
    page.text(
        "The bound is computed by brute force (bound.py). RMSE is over all bars and runs; its standard error comes "
        "from the scatter between runs, since the errors of one run are correlated."
    )
    figures = [study(rig, runs, whole, options) for rig in rigs]
    _bar_tables(page, figures)
    _spread_tables(page, figures)
    page.heading("Goals")
    for f in figures:
        _verdicts(page, f)
    return page


def _bar_tables(page: Report, figures: list[Accuracy]) -> None:
    page.heading("Bars")
    rows = []
    for f in figures:
        share = [1e3 * float(np.sqrt(v.mean())) for v in (f.bound.calibration, f.bound.own, f.bound.scale)]
        rows.append((f.rig, f.observations, f.rmse_um, f.bound_um, *share, f.ratio, f.ratio_error))
    header = (
        "rig",
        "observations",
        "RMSE um",
        "bound um",
        "cameras um",
        "own noise um",
        "scale um",
        "RMSE/bound",
        "s.e.",
    )
    page.table(header, rows)
    rows = []
    for f in figures:
        for length in np.unique(np.round(f.by_length)):
            own = np.round(f.by_length) == length
            rmse, bound = np.sqrt(f.bar_squares[:, own].mean()), np.sqrt(f.bound.total[own].mean())
            rows.append((f.rig, int(length), 1e3 * float(rmse), 1e3 * float(bound), float(rmse / bound)))
    page.table(("rig", "length mm", "RMSE um", "bound um", "ratio"), rows)


def _spread_tables(page: Report, figures: list[Accuracy]) -> None:
    page.heading("Empirical over predicted standard deviation")
    page.text(
        "Pooled over cameras or points; s.e. from the scatter between runs; lowest and highest ratio of a single "
        "camera's parameter (of a single length) beside it, which scatter more."
    )
    rows = [
        (f.rig, name, n.ratio, n.standard_error, *n.extremes)
        for f in figures
        for name, n in f.normalised.items()
    ]  # fmt: skip
    rows += [
        (f.rig, f"rig.json ({len(f.whole)} whole runs)", n.ratio, n.standard_error, *n.extremes)
        for f in figures
        if (n := f.sigma_stated) is not None
    ]
    page.table(("rig", "quantity", "ratio", "s.e.", "lowest", "highest"), rows)
    page.heading("The variance of unit weight and the whole computation")
    rows = []
    for f in figures:
        z = (f.chi2.mean() - 1) / np.sqrt(2 / f.redundancy / len(f.chi2))
        expected = np.sqrt(2 / f.redundancy)
        rows.append((f.rig, float(f.chi2.mean()), float(z), float(f.chi2.std(ddof=1)), float(expected),
                     float(f.chi2.min()), float(f.chi2.max()), f.redundancy))  # fmt: skip
    page.table(("rig", "chi2red mean", "z", "sd of a run", "expected sd", "lowest", "highest", "redundancy"), rows)
    rows = []
    for f in figures:
        same = [w for w in f.whole if w.other_used == 0]
        rows.append((f.rig, len(f.whole), len(same), max((w.cost_difference for w in same), default=0.0),
                     max((w.bar_difference_um for w in same), default=0.0),
                     max((w.other_used for w in f.whole), default=0),
                     max((w.bar_difference_um for w in f.whole), default=0.0)))  # fmt: skip
    page.table(
        ("rig", "whole runs", "with the same observations", "their cost differs by", "their bars by um",
         "most observations that differ", "bars then differ by um"), rows,
    )  # fmt: skip
    page.text(
        "The product's covariance at the truth differs from the dense one by at most "
        + ", ".join(f"{f.covariance_difference:.1e} ({f.rig})" for f in figures)
        + " of a standard deviation (every camera parameter, every point coordinate)."
    )


def _verdicts(page: Report, f: Accuracy) -> None:
    limit = 1.05 + 2 * f.ratio_error
    page.verdict(f"{f.rig} bar RMSE / bound <= 1.05 + 2 s.e.", f.ratio <= limit, f"{f.ratio:.3f} <= {limit:.3f}")
    mean = float(f.chi2.mean())
    page.verdict(f"{f.rig} chi2red within 1 +- 0.05", abs(mean - 1) <= 0.05, f"{mean:.4f}")
    worst = max(f.normalised.items(), key=lambda item: abs(item[1].ratio - 1))
    inside = all(abs(n.ratio - 1) <= 0.10 for n in f.normalised.values())
    page.verdict(
        f"{f.rig} empirical sd within 10 % of the predicted", inside,
        f"farthest is {worst[0]}, {worst[1].ratio:.3f} +- {worst[1].standard_error:.3f}",
    )  # fmt: skip
    same = [w for w in f.whole if w.other_used == 0]
    worst_cost = max((w.cost_difference for w in same), default=np.inf)
    page.verdict(
        f"{f.rig} the whole computation ends in the same minimum to 1e-6", worst_cost <= SAME_MINIMUM,
        f"{len(same)} of {len(f.whole)} runs used the same observations, costs equal to {worst_cost:.1e}",
    )  # fmt: skip
    page.verdict(
        f"{f.rig} covariance equals the dense one", f.covariance_difference < 1e-6, f"{f.covariance_difference:.1e}"
    )
