"""Whether stated 95 % intervals hold the truth in 95 % of the cases, with clean cameras and with a blurred one.

Then what whole calibrations state: errors over their standard uncertainties, on clean and on rendered recordings.
"""

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import ndtri

from benchmarks.studies.alignment import centres, similarity
from benchmarks.studies.bound import derivatives
from benchmarks.studies.groups import MIDDLE_MM
from benchmarks.studies.realistic import dot_places
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
from spherecal.base.context import Context
from spherecal.calibrate import calibrate
from spherecal.data.observations import find_features
from spherecal.data.session import Session
from spherecal.detect.session_images import observed
from spherecal.geometry.triangulation import triangulate
from spherecal_files.read_session import read_session
from spherecal_sim.dot_truth import ball_dots
from spherecal_sim.render_session import RENDERED, render_session
from spherecal_sim.rigs import Turns
from spherecal_sim.simulate_session import observe_again, simulate_session
from spherecal_sim.truth import SimulationOptions, Truth

RUNS = 400
BLOCK = 50  # runs of one job
SEED_RIG, SEED_BARS, SEED_NOISE = 1, 5, 2000
BLURRED = {"C04": 0.15}
CASES: dict[str, dict[str, object]] = {"clean": {}, "one blurred": {"blurred": BLURRED}}
LEAST, MOST = 0.93, 0.97
# Through the whole of `calibrate`: the rig, how the ball is turned, and whether two walls of it share no dot.
WHOLE: dict[str, tuple[str, Turns, bool]] = {
    "rig A": ("rigA", "turned", False),
    "rig A, ball only moved": ("rigA", "moved", False),
    "rig B": ("rigB", "turned", False),
    "two walls without a common view": ("rigB", "turned", True),
}
CLEAN_SHARE, RENDERED_SHARE = 10, 100  # of the runs one in so many, for each of them
FIRST_WHOLE, WALLS_SEED = 1, 100  # walls are other recordings than rig B's
NORMALISED, MOST_U, HELD = (0.8, 1.2), 2.5, (0.94, 0.98)
_PAIRS = 12
_EXACT_PX = 1e-4
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


def walls(session: Session, truth: Truth) -> tuple[Session, Truth]:
    """The lower row of rig B, three cameras that face three; what both sides see at a placement, one keeps."""
    low = np.flatnonzero([c.centre_mm[2] < MIDDLE_MM for c in truth.cameras])
    o = session.observations
    assert o is not None
    o = o.select(np.flatnonzero(np.isin(o.camera, low)))
    behind = np.array([c.centre_mm[1] < 0 for c in truth.cameras])[o.camera]
    feature = find_features(o).of_observation
    both = np.logical_and(*(np.bincount(feature[side], minlength=feature.max() + 1) > 0 for side in (behind, ~behind)))
    o = o.select(np.flatnonzero(behind | ~both[feature]))
    o = replace(o, cameras=tuple(o.cameras[c] for c in low), camera=np.searchsorted(low, o.camera))
    cameras, phases = tuple(truth.cameras[c] for c in low), truth.misfit_phases[low]
    truth = replace(truth, cameras=cameras, sigma_px=truth.sigma_px[low], misfit_phases=phases)
    places, poses = (tuple(replace(p, images={}) for p in each) for each in (session.placements, session.bar_poses))
    cameras = tuple(session.cameras[c] for c in low)
    return replace(session, observations=o, cameras=cameras, placements=places, bar_poses=poses), truth


def whole(name: str, seed: int, rendered: bool) -> dict[str, FloatArray] | None:
    """Errors over stated uncertainties of a whole calibration, lengths' errors and U in um; None where cameras lack.

    Lengths by exact images of their ends: the calibration's errors alone, and its uncertainty with the lenses' fields.
    """
    rig, turns, parted = WHOLE[name]
    options = replace(RENDERED if rendered else SimulationOptions(scale="bar", bar_poses=6), turns=turns)
    seed += WALLS_SEED if parted else 0
    session, truth = simulate_session(rig, seed, options)
    with tempfile.TemporaryDirectory() as scratch:
        if rendered:
            folder = Path(os.environ.get("SPHERECAL_STUDY_CACHE") or scratch) / f"rendered-{rig}-{turns}-{seed}"
            if not folder.exists():
                render_session(rig, seed, folder, options=options)
            session, targets = read_session(folder), session.target_set
            assert targets is not None
            # a dot's image is that of the plane of its rim, 4.5 um below the surface: else 2.1 in place of 0.8 sigmas
            rims = ball_dots(truth.ball, targets.dot_diameter_mm / 2, targets.size_mm / 2).rims.mean(axis=1)
            truth = replace(truth, ball=replace(truth.ball, dots_mm=rims))
        if parted:
            session, truth = walls(observed(session, Context()), truth)
        done = calibrate(session)
    cameras = done.rig.cameras
    if len(cameras) < len(truth.cameras) or done.rig.covariance is None:
        return None
    places = dot_places(truth, len(truth.placements), done.features, done.observations)
    known = np.isfinite(places[:, 0]) & np.isfinite(done.points_sigma_mm[:, 0])
    fit = similarity(places[known], done.points_mm[known])
    centre = fit.points(np.array([c.centre_mm for c in truth.cameras]))
    bars = replace(make_bars(truth, SEED_BARS), sigma_px=np.full(len(cameras), _EXACT_PX))
    error, u = bars.errors_of_rig(done, None), bars.stated_of_rig(done, truth)
    return {
        "points": ((done.points_mm[known] - fit.points(places[known])) / done.points_sigma_mm[known]).ravel(),
        "centres": np.ravel(
            [(c.centre_mm - at) / c.sigma.centre_mm for c, at in zip(cameras, centre, strict=True) if c.sigma]
        ),
        "lengths": error / u,
        "error": 1e3 * error,
        "U": 2e3 * u,
        "valid": np.array([done.rig.quality.verdict == "valid"]),
    }


def _write_whole(
    page: Report, found: dict[tuple[str, bool], list[dict[str, FloatArray] | None]]
) -> list[tuple[str, bool, str]]:
    """The table of whole calibrations; their goals."""
    page.heading("Whole calibrations: rms of error over stated standard uncertainty")
    page.text(
        f"Each recording a rig of its own (seeds {FIRST_WHOLE} on, of the walls {FIRST_WHOLE + WALLS_SEED} on), scale "
        "from a bar, the whole of `calibrate`; rendered: from images, with stickers printed to 0.02 mm. Walls: three "
        "cameras that face three, without a dot that both sides see. Lengths: bars by exact images of their ends, "
        "against the uncertainty of calibration and lenses' fields alone; those of one recording err alike."
    )
    rows, goals = [], []
    for (name, rendered), runs in found.items():
        own, kind = [run for run in runs if run is not None], "rendered" if rendered else "clean"
        if not own:
            rows.append((name, kind, f"0 of {len(runs)}", *[""] * 8))
            continue
        z = {key: np.concatenate([run[key] for run in own]) for key in own[0]}
        ratio = {key: float(np.sqrt((z[key] ** 2).mean())) for key in ("points", "centres", "lengths", "error")}
        held, wide = float((np.abs(z["lengths"]) <= _QUANTILE).mean()), float(np.median(z["U"])) / ratio["error"]
        case, valid = f"{name}, {kind}", f"{int(z['valid'].sum())} of {len(runs)}"
        figures = (ratio["points"], ratio["centres"], ratio["lengths"], 100 * held, ratio["error"])
        rows.append((name, kind, f"{len(own)} of {len(runs)}", *figures, float(np.median(z["U"])), wide, valid))
        for key in ("points", "centres", "lengths"):
            low, high = NORMALISED
            goals.append((f"{case}: {key} {low:g} to {high:g}", low <= ratio[key] <= high, f"{ratio[key]:.2f}"))
        goals.append(
            (f"{case}: median U at most {MOST_U:g} times the rms error of lengths", wide <= MOST_U, f"{wide:.2f}")
        )
        goals.append(
            (
                f"{case}: 95 % intervals of lengths hold {HELD[0]:.0%} to {HELD[1]:.0%}",
                HELD[0] <= held <= HELD[1],
                f"{held:.1%}",
            )
        )
    page.table(("rig", "recordings", "all cameras", "points", "centres", "lengths", "lengths inside %", "rms error um",
                "median U um", "U over error", "valid"), rows)  # fmt: skip
    return goals


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
    kinds = [(name, rendered) for rendered in (False, True) for name in WHOLE]
    counts = [max(runs // (RENDERED_SHARE if rendered else CLEAN_SHARE), 1) for _, rendered in kinds]
    each = [(*kind, FIRST_WHOLE + k) for kind, count in zip(kinds, counts, strict=True) for k in range(count)]
    found = spread([*jobs, *(Job(whole, (name, seed, rendered)) for name, rendered, seed in each)])
    rows, goals = [], []
    for i, (rig, case) in enumerate(cases):
        parts = found[i * len(blocks) : (i + 1) * len(blocks)]
        for form in FORMS:
            for name, c in coverage([run for part in parts for run in part[form]]).items():
                rows.append((rig, case, form, name, 100 * c.share, 100 * c.standard_error, c.ratio))
                goals.append((f"{rig} {case}, {form}: {name}", c))
    page.table(("rig", "cameras", "form", "quantity", "inside %", "s.e. %", "empirical / stated sd"), rows)
    by_kind = {
        kind: [run for (*of, _), run in zip(each, found[len(jobs) :], strict=True) if tuple(of) == kind]
        for kind in kinds
    }
    of_whole = _write_whole(page, by_kind)
    page.heading("Goals")
    for name, c in goals:
        page.verdict(
            f"{name}: 95 % intervals cover {100 * LEAST:g} to {100 * MOST:g} %",
            LEAST <= c.share <= MOST,
            f"{100 * c.share:.2f} +- {100 * c.standard_error:.2f} %",
        )
    for goal in of_whole:
        page.verdict(*goal)
    return page
