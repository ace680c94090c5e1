"""Whether stated 95 % intervals hold the truth in 95 % of the cases, with clean cameras and with a blurred one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from benchmarks.studies.alignment import centres, similarity
from benchmarks.studies.bound import derivatives
from benchmarks.studies.report import Report
from benchmarks.studies.simulated import (
    FORMS,
    Bars,
    Estimate,
    Form,
    Simulated,
    estimates_from_truth,
    make_bars,
    simulate,
)
from benchmarks.studies.workers import Job, spread
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.triangulation import triangulate
from spherecal_sim.simulate_session import observe_again
from spherecal_sim.truth import SimulationOptions

RUNS = 400
BLOCK = 50  # runs of one job
SEED_RIG, SEED_BARS, SEED_NOISE = 1, 5, 2000
BLURRED = {"C04": 0.15}
CASES: dict[str, dict[str, object]] = {"clean": {}, "one blurred": {"blurred": BLURRED}}
LEAST, MOST = 0.93, 0.97
_PAIRS = 12
_QUANTILE = float(ndtri(0.975))


@dataclass(frozen=True)
class Coverage:
    """Of one quantity: the share (runs,) of intervals that hold the truth, mean squares (runs,) of error over sd."""

    inside: FloatArray
    squares: FloatArray

    @property
    def share(self) -> float:
        """Over all runs."""
        return float(self.inside.mean())

    @property
    def standard_error(self) -> float:
        """From the scatter between runs: errors of one run are correlated."""
        return float(self.inside.std(ddof=1) / np.sqrt(len(self.inside))) if len(self.inside) > 1 else np.inf

    @property
    def ratio(self) -> float:
        """Empirical over predicted standard deviation."""
        return float(np.sqrt(self.squares.mean()))


def study(
    rig: str, case: str, first: int, runs: int, options: SimulationOptions | None = None
) -> dict[Form, list[dict[str, FloatArray]]]:
    """Errors over stated standard uncertainties, by form and run."""
    changed = replace(options or SimulationOptions(), **CASES[case])  # type: ignore[arg-type]
    simulated = simulate(rig, SEED_RIG, changed)
    bars = make_bars(simulated.truth, SEED_BARS)
    often = np.flatnonzero(simulated.network.views(simulated.usable) >= 3)
    pairs = np.random.default_rng(SEED_BARS).choice(often, (_PAIRS, 2), replace=False)
    out: dict[Form, list[dict[str, FloatArray]]] = {form: [] for form in FORMS}
    for run in range(first, first + runs):
        rng = np.random.default_rng([SEED_NOISE, run])
        again = simulated.with_session(observe_again(simulated.session, simulated.truth, rng)[0])
        noise = rng.normal(size=bars.uv.shape)
        for form, estimate in estimates_from_truth(again).items():
            out[form].append(_scores(again, estimate, bars, noise, pairs))
    return out


def _scores(
    simulated: Simulated, estimate: Estimate, bars: Bars, noise: FloatArray, pairs: IntArray
) -> dict[str, FloatArray]:
    """Errors over standard uncertainties (k,) of each quantity, the truth brought to the datum of the covariance."""
    state, cofactors, variance = estimate.state, estimate.cofactors, estimate.adjusted.variance
    known = np.isfinite(cofactors.points[:, 0, 0])
    fit = similarity(simulated.places_mm[known], state.points[known])
    true = fit.state(replace(simulated.true, points=simulated.places_mm))
    cameras = variance * cofactors.cameras
    focal = (state.intrinsics[:, :2] - true.intrinsics[:, :2]) / np.sqrt(np.einsum("cii->ci", cameras)[:, 6:8])
    centre = np.einsum("cji,cjk,ckl->cil", state.rotation, cameras[:, 3:6, 3:6], state.rotation)
    shift = (centres(state) - centres(true)) / np.sqrt(np.einsum("cii->ci", centre))
    return {
        "focal lengths": focal.ravel(),
        "camera centres": shift.ravel(),
        "lengths between dots": _between_dots(estimate, true, pairs),
        "triangulated bars": _of_bars(
            estimate, state, variance * cofactors.all_cameras(), fit.scale * bars.lengths_mm, bars, noise
        ),
        "triangulated bars in mm": _of_bars(
            estimate, estimate.solution.state, estimate.solution.cameras, bars.lengths_mm, bars, noise
        ),
    }


def _between_dots(estimate: Estimate, true: State, pairs: IntArray) -> FloatArray:
    """By `Covariance.functional`."""
    points, scores = estimate.state.points, []
    for first, second in pairs:
        difference = points[second] - points[first]
        length = np.linalg.norm(difference)
        gradient = np.zeros_like(points)
        gradient[second], gradient[first] = difference / length, -difference / length
        sd = np.sqrt(estimate.adjusted.variance * estimate.cofactors.functional(gradient))
        scores.append((length - np.linalg.norm(true.points[second] - true.points[first])) / sd)
    return np.array(scores)


def _of_bars(
    estimate: Estimate, state: State, covariance: FloatArray | None, true: FloatArray, bars: Bars, noise: FloatArray
) -> FloatArray:
    """By all cameras' joint covariance and the image noise that the adjustment found for each; true lengths (n,)."""
    variance, network = estimate.adjusted.variance, estimate.solved.network
    assert covariance is not None
    sigma = network.noise * np.sqrt(variance)
    uv, n_ends = bars.noisy_uv(noise), 2 * len(bars.lengths_mm)
    weight = 1.0 / sigma[bars.camera] ** 2
    ends = triangulate(bars.end, bars.camera, uv, weight, n_ends, state.cameras).points
    columns = estimate.adjusted.problem.intrinsic_columns
    by_camera, by_point = derivatives(state, bars.camera, ends[bars.end], columns)
    root = np.sqrt(weight)[:, None, None]
    by_camera, by_point = by_camera * root, by_point * root
    normal = np.zeros((n_ends, 3, 3))
    np.add.at(normal, bars.end, np.einsum("nki,nkj->nij", by_point, by_point))
    own = np.linalg.inv(normal)
    difference = ends[1::2] - ends[::2]
    length = np.linalg.norm(difference, axis=1)
    along = difference / length[:, None]
    pull = np.stack([-along, along], axis=1).reshape(-1, 3)  # of every end
    # an end moves by -N^-1 J' J_c dc when its cameras move
    by_row = -np.einsum("ni,nij,nkj,nkw->nw", pull[bars.end], own[bars.end], by_point, by_camera)
    gradient = np.zeros((len(length), len(state.rotation), by_camera.shape[2]))
    np.add.at(gradient, (bars.end // 2, bars.camera), by_row)
    flat = gradient.reshape(len(length), -1)
    by_cameras = np.einsum("bi,ij,bj->b", flat, covariance, flat)
    by_noise = np.einsum("ei,eij,ej->e", pull, own, pull).reshape(-1, 2).sum(axis=1)
    return (length - true) / np.sqrt(by_cameras + by_noise)


def coverage(runs: list[dict[str, FloatArray]]) -> dict[str, Coverage]:
    """By quantity."""
    return {
        name: Coverage(
            np.array([(np.abs(run[name]) <= _QUANTILE).mean() for run in runs]),
            np.array([(run[name] ** 2).mean() for run in runs]),
        )
        for name in runs[0]
    }


def report(runs: int | None, rigs: Sequence[str] = ("rigA",), options: SimulationOptions | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    page = Report("Coverage of stated uncertainties", f"dev.py studies coverage --runs {runs}")
    page.text(
        f"{runs} recordings of one rig and ball (rig seed {SEED_RIG}, noise ({SEED_NOISE}, run)), four placements, "
        "ball turned by 30 to 60 degrees, 0.04 px; `one blurred`: one camera of ten has 0.15 px, which the adjustment "
        "is not told. Intervals are the estimate +- 1.96 standard uncertainties, in the datum in which they are stated "
        "(docs/conventions.md): the truth is brought there by the similarity over the features' places. Started at the "
        "truth.",
        "Lengths between dots: `Covariance.functional`. Triangulated bars: forty bars as in the study of accuracy, by "
        "the joint covariance of all cameras and each camera's noise as the adjustment found it; scale apart (in the "
        "datum), and in mm with the scale's share in the cameras' covariance, as the result states it.",
    )
    blocks = [(first, min(BLOCK, runs - first)) for first in range(0, runs, BLOCK)]
    cases = [(rig, case) for rig in rigs for case in CASES]
    jobs = [Job(study, (*case, *block, options)) for case in cases for block in blocks]
    found = spread(jobs)
    rows, goals = [], []
    for i, (rig, case) in enumerate(cases):
        parts = found[i * len(blocks) : (i + 1) * len(blocks)]
        for form in FORMS:
            for name, c in coverage([run for part in parts for run in part[form]]).items():
                rows.append((rig, case, form, name, 100 * c.share, 100 * c.standard_error, c.ratio))
                goals.append((f"{rig} {case}, {form}: {name}", c))
    page.table(("rig", "cameras", "form", "quantity", "inside %", "s.e. %", "empirical / stated sd"), rows)
    page.heading("Goals")
    for name, c in goals:
        page.verdict(
            f"{name}: 95 % intervals cover {100 * LEAST:g} to {100 * MOST:g} %",
            LEAST <= c.share <= MOST,
            f"{100 * c.share:.2f} +- {100 * c.standard_error:.2f} %",
        )
    return page
