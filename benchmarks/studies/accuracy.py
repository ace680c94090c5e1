"""How near the calibration comes to the Cramer-Rao bound, and whether its stated uncertainties are true.

Monte-Carlo: one rig, its ball at four placements (turned in between or only moved) and forty bars, recorded again and
again with new noise; both forms of the network from every recording, and the free form with a reference bar inside the
adjustment. The adjustment starts at the true network, which saves time; some runs go through the whole of `calibrate`
as well and must end in the same minimum.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies import accuracy_page
from benchmarks.studies.accuracy_figures import Normalised, WholeRun
from benchmarks.studies.alignment import centres, similarity
from benchmarks.studies.bound import BarBound, DenseNetwork, bar_bound, dense_network
from benchmarks.studies.report import Report
from benchmarks.studies.simulated import (
    FORMS,
    RIGS,
    Bars,
    Estimate,
    Form,
    Simulated,
    estimates_from_truth,
    make_bars,
    simulate,
)
from benchmarks.studies.workers import Job, spread
from spherecal.adjust.covariance import covariance
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.data.session import Recording
from spherecal.geometry.camera import INTRINSIC_NAMES, project
from spherecal.scale.bar_scale import length_rows
from spherecal.steps.settings import CalibrationSettings
from spherecal_sim.simulate_session import observe_again
from spherecal_sim.truth import SimulationOptions

RUNS = 200
WHOLE_RUNS = 20  # of those, through `calibrate`
BLOCK = 25  # runs of one job
SEED_RIG, SEED_BARS, SEED_NOISE = 1, 5, 1000
BAR_POSES = 10
_PAIRS = 40  # lengths between ball points, for the covariance's functional

# What is simulated beside the rig: the ball turned or only moved, and the poses of a bar that gives the scale.
CASES: dict[str, tuple[dict[str, object], tuple[Form, ...]]] = {
    "turned": ({"turns": "turned"}, FORMS),
    "moved": ({"turns": "moved"}, FORMS),
    f"turned, {BAR_POSES} poses of a bar inside": ({"scale": "bar", "bar_poses": BAR_POSES}, ("free",)),
}


@dataclass(frozen=True)
class Accuracy:
    """The figures of one rig, case and form."""

    rig: str
    case: str
    form: Form
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
    def name(self) -> str:
        """Rig, case and form."""
        return f"{self.rig} {self.case}, {self.form}"

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


def study(
    rig: str, case: str, first: int, runs: int, whole_runs: int, options: SimulationOptions | None = None
) -> dict[Form, list["Run"]]:
    """Recordings from `first` on of one rig and case, in the case's forms; of all, the first `whole_runs` go whole."""
    simulated, forms = _simulated(rig, case, options)
    bars = make_bars(simulated.truth, SEED_BARS)
    pairs = _pairs(simulated)
    collected: dict[Form, list[Run]] = {form: [] for form in forms}
    for run in range(first, first + runs):
        rng = np.random.default_rng([SEED_NOISE, run])
        again = simulated.recorded_again(observe_again(simulated.session, simulated.truth, rng)[0], rng)
        noise = rng.normal(size=bars.uv.shape)
        for form, estimate in estimates_from_truth(again, forms).items():
            collected[form].append(_run(again, estimate, bars, noise, pairs, run < whole_runs))
    return collected


def _simulated(rig: str, case: str, options: SimulationOptions | None) -> tuple[Simulated, tuple[Form, ...]]:
    changed, forms = CASES[case]
    return simulate(rig, SEED_RIG, replace(options or SimulationOptions(), **changed)), forms  # type: ignore[arg-type]


@dataclass(frozen=True)
class Run:
    """One recording in one form; `stated` (k,): squares of errors over what rig.json states."""

    bar_errors: FloatArray
    chi2: float
    redundancy: int
    normalised: dict[str, FloatArray]
    whole: WholeRun | None
    stated: FloatArray | None


def _run(simulated: Simulated, estimate: Estimate, bars: Bars, noise: FloatArray, pairs: IntArray, whole: bool) -> Run:
    errors = bars.errors_of(estimate.solution.state, noise)
    residual = _residuals(simulated, estimate)[estimate.adjusted.used]
    redundancy = estimate.adjusted.redundancy
    chi2 = float((residual**2).sum()) / redundancy / float(simulated.truth.sigma_px[0]) ** 2
    compared = stated = None
    if whole:
        calibration = calibrate(simulated.session, CalibrationSettings(method=estimate.form))
        compared = _compare(simulated, estimate, calibration, bars)
        stated = _stated_sigmas(simulated, calibration) if np.isfinite(compared.bar_difference_um) else None
    return Run(errors, chi2, redundancy, _normalised(simulated, estimate, pairs), compared, stated)


@dataclass(frozen=True)
class Bound:
    """What no estimator goes below, by form: the bars' variances, and how far the product's covariance is from it."""

    observations: int
    lengths_mm: FloatArray
    bars: BarBound
    covariance_difference: float


def bounds(rig: str, case: str, options: SimulationOptions | None = None) -> dict[Form, Bound]:
    """The bounds of one rig and case in the case's forms."""
    simulated, forms = _simulated(rig, case, options)
    bars = make_bars(simulated.truth, SEED_BARS)
    out: dict[Form, Bound] = {}
    for form in forms:
        dense = dense_network(simulated, form)
        out[form] = Bound(
            int(simulated.usable_in(form).sum()),
            bars.lengths_mm,
            bar_bound(simulated, bars, dense),
            _covariance_difference(simulated, form, dense),
        )
    return out


def figures(rig: str, case: str, form: Form, bound: Bound, runs: list[Run]) -> Accuracy:
    """All runs of one rig, case and form put together."""
    stated = [run.stated for run in runs if run.stated is not None]
    names = runs[0].normalised
    return Accuracy(
        rig,
        case,
        form,
        bound.observations,
        bound.bars,
        bound.covariance_difference,
        np.array([run.bar_errors for run in runs]) ** 2,
        bound.lengths_mm,
        np.array([run.chi2 for run in runs]),
        runs[-1].redundancy,
        {name: Normalised(np.array([run.normalised[name] for run in runs])) for name in names},
        [run.whole for run in runs if run.whole is not None],
        Normalised(np.array(stated)) if stated else None,
    )


def _residuals(simulated: Simulated, estimate: Estimate) -> FloatArray:
    """Predicted minus observed (n,2) px, NaN without a point."""
    network, state = estimate.solved.network, estimate.adjusted.state
    with np.errstate(divide="ignore", invalid="ignore"):
        return project(network.camera_points(state), state.intrinsics[network.camera]) - simulated.network.uv


def _covariance_difference(simulated: Simulated, form: Form, dense: DenseNetwork) -> float:
    """Largest relative difference between the product's standard deviations at the truth and the dense ones."""
    network, places = simulated.network_in(form), simulated.places_in(form)
    sigma = float(simulated.truth.sigma_px[0])
    if dense.with_lengths:
        scale, known = simulated.session.scale, np.where(dense.known[:, None], simulated.places_mm, np.nan)
        assert scale is not None and scale.bar is not None
        rows = length_rows(Recording(simulated.session, simulated.observations, simulated.features), scale.bar, known)
        assert rows is not None
        # certified at the truth, and with the thermometer that the bound has
        difference = np.einsum("mk,mki->mi", rows.coefficient, simulated.places_mm[rows.points])
        length = np.linalg.norm(difference, axis=1)
        assert dense.length_covariance is not None
        rows = replace(rows, length=length, covariance=dense.length_covariance / sigma**2)
        network = replace(network, lengths=rows)
    problem, _ = network.problem(simulated.usable_in(form), network.free, simulated.placed, weighted=True)
    state = simulated.state_in(form)
    ours = covariance(problem, replace(state, points=np.nan_to_num(state.points)), places)
    assert ours is not None
    assert (np.isfinite(ours.points[:, 0, 0]) == dense.known).all()
    cameras = sigma * np.sqrt(np.einsum("cii->ci", ours.cameras))
    points = sigma * np.sqrt(np.einsum("pii->pi", ours.points[dense.known]))
    pairs = ((cameras, dense.camera_sd()), (points, dense.place_sd()))
    return float(max(np.abs(a / b - 1).max() for a, b in pairs))


def _pairs(simulated: Simulated) -> IntArray:
    """Pairs (k, 2) of points in three or more views, all over the volume."""
    often = np.flatnonzero(simulated.network.views(simulated.usable) >= 3)
    return np.random.default_rng(SEED_BARS).choice(often, (_PAIRS, 2), replace=False)


def _normalised(simulated: Simulated, estimate: Estimate, pairs: IntArray) -> dict[str, FloatArray]:
    """Squares of error over predicted standard deviation of all that the covariance predicts, (k,) each.

    The truth is brought to the estimate by the similarity over the points: that is the datum of the covariance.
    """
    state, cofactors, variance = estimate.state, estimate.cofactors, estimate.adjusted.variance
    places = simulated.places_mm
    known = np.isfinite(cofactors.points[:, 0, 0])
    fit = similarity(places[known], state.points[known])
    true = fit.state(replace(simulated.true, points=places))
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
    points, squares = estimate.state.points, []
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
    cost, ours = calibration.residuals_px[calibration.used], _residuals(simulated, estimate)[adjusted.used]
    bar_difference = bars.errors_of_rig(calibration, None) - bars.errors_of(estimate.solution.state, None)
    return WholeRun(
        int((calibration.used != adjusted.used).sum()),
        abs(float((cost**2).sum() / (ours**2).sum()) - 1),
        1e3 * float(np.abs(bar_difference).max()),
    )


def _stated_sigmas(simulated: Simulated, calibration: Calibration) -> FloatArray:
    """Squares of error over the standard uncertainties that rig.json states, all cameras' parameters together."""
    known = np.isfinite(calibration.points_sigma_mm[:, 0])
    true = similarity(simulated.places_mm[known], calibration.points_mm[known]).state(simulated.true)
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


def collect(runs: int, whole: int, rigs: Sequence[str], options: SimulationOptions | None) -> list[Accuracy]:
    """Every rig, case and form, computed block by block."""
    cases = [(rig, case) for case in CASES for rig in rigs]
    blocks = [(first, min(BLOCK, runs - first)) for first in range(0, runs, BLOCK)]
    jobs = [Job(study, (*case, *block, whole, options)) for case in cases for block in blocks]
    done = spread([*jobs, *(Job(bounds, (*case, options)) for case in cases)])
    out = []
    for i, (rig, case) in enumerate(cases):
        parts, bound = done[i * len(blocks) : (i + 1) * len(blocks)], done[len(jobs) + i]
        out += [figures(rig, case, f, bound[f], [run for part in parts for run in part[f]]) for f in CASES[case][1]]
    return out


def report(runs: int | None, rigs: Sequence[str] = RIGS, options: SimulationOptions | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    whole = min(runs, WHOLE_RUNS)
    found = collect(runs, whole, rigs, options)
    page = Report("Accuracy: simulated rigs against the Cramer-Rao bound", f"dev.py studies accuracy --runs {runs}")
    page.text(
        f"{runs} runs a rig, four placements, 0.04 px; rig seed {SEED_RIG}, bars {SEED_BARS}, noise "
        f"({SEED_NOISE}, run). Forty bars at random in the volume, eight each of 100 to 500 mm, every end in three or "
        "more views, are measured by triangulation with the same noise. The ball is turned by 30 to 60 degrees from "
        "placement to placement, or only moved. The scale comes from the targets' printed patterns, or from a bar "
        f"inside the adjustment: {BAR_POSES} poses of two marks 500 mm apart, certified anew in every run to 5 um "
        "(standard).",
    )
    page.text(
        "The bound is computed by brute force (bound.py), in the form of the network that is meant. RMSE is over all "
        "bars and runs; its standard error comes from the scatter between runs, since the errors of one run are "
        "correlated."
    )
    accuracy_page.write(page, found)
    return page
