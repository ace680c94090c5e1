"""Two groups of cameras that share no view, linked by the shape of the ball: three cameras that face three.

The lower row of rig B. As the rig is, cameras that face each other see some dots at the ball's limb in common, but no
three cameras of both sides do; in the strict series the limb's dots are taken from one side, so that nothing is seen
from both at the same placement.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies.bound import bar_bound, dense_network
from benchmarks.studies.report import Report
from benchmarks.studies.simulated import BarErrors, Bars, bar_errors, known_network, make_bars
from benchmarks.studies.workers import Job, spread
from spherecal.base.arrays import FloatArray
from spherecal.calibrate import calibrate
from spherecal.data.observations import Observations, find_features
from spherecal.data.session import Session
from spherecal.geometry.rotation import exp_rotation
from spherecal.steps.settings import CalibrationSettings
from spherecal_sim.observe import look, observe
from spherecal_sim.rigs import ball_turns
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions, Truth

RUNS = 12
FIRST_SEED, SEED_BARS = 501, 5
GOAL_UM = 6.0
MIDDLE_MM = 495.0  # height between rig B's two rows
LEAST_VIEWS = 4  # of a bar's end: from both sides


@dataclass(frozen=True)
class Series:
    """How the ball is turned from placement to placement, and whether dots seen from both sides at one are taken away.

    `step_deg` None: by 30 to 60 degrees about any axis; else about the vertical, and tilted by `tilt_deg` to and fro.
    """

    name: str
    step_deg: float | None
    tilt_deg: float
    strict: bool


SERIES = (
    Series("turned by 30 to 60 degrees", None, 0.0, False),
    Series("turned by 50 degrees about the vertical and tilted by 25", 50.0, 25.0, False),
    Series("turned by 90 degrees and tilted by 15, no dot seen from both sides", 90.0, 15.0, True),
    Series("turned by 50 degrees and tilted by 25, no dot seen from both sides", 50.0, 25.0, True),
)


@dataclass(frozen=True)
class Linked:
    """One recording: cameras placed, whether any placement shows a dot to both sides, the bars without noise of their
    own, and the bound of the cameras' part (um)."""

    cameras: int
    shared_dots: int
    bars: BarErrors
    bound_um: float
    chi2: float


def rotations_of(truth: Truth, series: Series, rng: np.random.Generator) -> FloatArray:
    """Rotations (t,3,3) of the ball at its placements."""
    count = len(truth.placements)
    if series.step_deg is None:
        return ball_turns(count, "turned", rng)
    # about one axis alone the cameras' part is five times larger: nothing then fixes them along it
    about_z = np.arange(count)[:, None] * np.deg2rad(series.step_deg) * np.array([0.0, 0.0, 1.0])
    tilt = np.resize([0.0, 1.0, -1.0], count)[:, None] * np.deg2rad(series.tilt_deg) * np.array([1.0, 0.0, 0.0])
    return exp_rotation(tilt) @ exp_rotation(about_z) @ ball_turns(1, "random", rng)[0]


def lower_row(session: Session, truth: Truth, rotations: FloatArray, strict: bool) -> tuple[Session, Truth, int]:
    """The session as the lower six cameras see it, with noise, and how many dots both sides see at a placement."""
    low = tuple(i for i, c in enumerate(truth.cameras) if c.centre_mm[2] < MIDDLE_MM)
    truth = replace(
        truth,
        cameras=tuple(truth.cameras[i] for i in low),
        ball_rotations=rotations,
        sigma_px=truth.sigma_px[list(low)],
    )
    session = replace(session, cameras=tuple(session.cameras[i] for i in low))
    view, ball = look(truth.cameras), truth.ball
    seen = [
        observe(view, truth.points_mm(t), ball.normals @ turn.T, truth.options.view_limit_deg)
        for t, turn in enumerate(rotations)
    ]
    dot = np.concatenate([s.point for s in seen])
    o = Observations(
        truth.placements,
        tuple(c.id for c in truth.cameras),
        ball.points,
        np.concatenate([np.full(len(s.camera), t) for t, s in enumerate(seen)]),
        np.concatenate([s.camera for s in seen]),
        ball.dot_target[dot],
        ball.dot_point[dot],
        np.concatenate([s.uv for s in seen]),
    )
    behind = np.array([c.centre_mm[1] < 0 for c in truth.cameras])[o.camera]
    feature = find_features(o).of_observation
    by_side = [np.bincount(feature[side], minlength=feature.max() + 1) > 0 for side in (behind, ~behind)]
    both = by_side[0] & by_side[1]
    if strict:
        o = o.select(behind | ~both[feature])
    noise = np.random.default_rng([truth.seed, 1]).normal(size=o.uv.shape) * truth.options.sigma_px
    truth = replace(truth, uv_true_px=o.uv, outlier=np.zeros(len(o), dtype=bool))
    return replace(session, observations=replace(o, uv=o.uv + noise)), truth, int(both.sum())


def bars_from_both_sides(truth: Truth) -> Bars:
    """The bars whose ends are in four views or more."""
    bars = make_bars(truth, SEED_BARS)
    often = np.bincount(bars.end, minlength=2 * len(bars.lengths_mm)) >= LEAST_VIEWS
    keep = often[::2] & often[1::2]
    study = replace(bars.study, ends_mm=bars.study.ends_mm[keep], lengths_mm=bars.study.lengths_mm[keep])
    rows = keep[bars.end // 2]
    number = np.cumsum(keep) - 1
    end = 2 * number[bars.end[rows] // 2] + bars.end[rows] % 2
    return replace(bars, study=study, end=end, camera=bars.camera[rows], uv=bars.uv[rows])


def study(series: Series, first: int, runs: int, options: SimulationOptions | None = None) -> list[Linked]:
    """Recordings, each of a rig and ball of its own, through the whole of `calibrate`."""
    out = []
    for seed in range(first, first + runs):
        session, truth = simulate_session("rigB", seed, replace(options or SimulationOptions(), bar_poses=0))
        rotations = rotations_of(truth, series, np.random.default_rng([seed, 2]))
        session, truth, shared = lower_row(session, truth, rotations, series.strict)
        bars = bars_from_both_sides(truth)
        calibration = calibrate(session, CalibrationSettings())
        cameras, bound = len(calibration.rig.cameras), np.nan
        if cameras == len(truth.cameras):
            simulated = known_network(session, truth)
            dense = dense_network(simulated, "rigid")
            bound = 1e3 * float(np.sqrt(bar_bound(simulated, bars, dense).calibration.mean()))
        sigma0 = calibration.rig.quality.sigma0
        chi2 = np.nan if sigma0 is None else (sigma0 / truth.options.sigma_px) ** 2
        errors = bar_errors(calibration, truth, bars, None)
        out.append(Linked(cameras, 0 if series.strict else shared, errors, bound, chi2))
    return out


def report(runs: int | None, _rigs: Sequence[str] = (), options: SimulationOptions | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    page = Report("Two groups of cameras without a common view", f"dev.py studies groups --runs {runs}")
    page.text(
        f"The six lower cameras of rig B, three that face three; {runs} recordings a series (seeds {FIRST_SEED} to "
        f"{FIRST_SEED + runs - 1}, each a rig and a ball of its own), four placements, 0.04 px, the whole of "
        f"`calibrate`. Bars as in the study of accuracy whose ends are in at least {LEAST_VIEWS} views, without noise "
        "of their own and after the scale that suits them best: what is left is the cameras' part. The bound is that "
        "of the rigid form for the same recordings, the scale's noise taken out."
    )
    half = (runs + 1) // 2
    blocks = [(FIRST_SEED, half), (FIRST_SEED + half, runs - half)]
    found = spread([Job(study, (series, *block, options)) for series in SERIES for block in blocks])
    by_series = {series.name: found[2 * i] + found[2 * i + 1] for i, series in enumerate(SERIES)}
    rows = []
    for series, outcomes in by_series.items():
        linked = [o for o in outcomes if o.cameras == 6]
        rows.append(
            (
                series,
                f"{len(linked)} of {len(outcomes)}",
                float(np.mean([o.shared_dots for o in outcomes])),
                _rmse_um(linked),
                _standard_error_um(linked),
                _bound_um(linked),
                float(np.mean([o.chi2 for o in linked])) if linked else np.nan,
            )
        )
    header = (
        "linked",
        "dots seen from both sides",
        "cameras' part um",
        "s.e.",
        "bound um",
        "chi2red",
    )
    page.table(("ball", *header), rows)
    page.text(
        "Without any dot of both sides the start hangs on what each side alone can locate: dots that two of its "
        "cameras see. Where each side ties other placements to the ball than the other (the last series: none is tied "
        "to the same dots by both), the groups are not linked, though the bound says that the data would allow it."
    )
    page.heading("Goals")
    for series, outcomes in by_series.items():
        linked = [o for o in outcomes if o.cameras == 6]
        page.verdict(f"{series}: linked", len(linked) == len(outcomes), f"{len(linked)} of {len(outcomes)}")
        limit = GOAL_UM + 2 * _standard_error_um(linked)
        rmse = _rmse_um(linked)
        page.verdict(f"{series}: cameras' part <= {GOAL_UM:g} um + 2 s.e.", rmse <= limit, f"{rmse:.2f} <= {limit:.2f}")
    return page


def _rmse_um(outcomes: list[Linked]) -> float:
    return 1e3 * float(np.sqrt(np.mean([o.bars.rescaled.mean() for o in outcomes]))) if outcomes else np.inf


def _bound_um(outcomes: list[Linked]) -> float:
    return float(np.sqrt(np.mean([o.bound_um**2 for o in outcomes]))) if outcomes else np.nan


def _standard_error_um(outcomes: list[Linked]) -> float:
    """Of the RMSE, from the scatter between recordings."""
    if len(outcomes) < 2:
        return 0.0
    by_run = np.array([1e6 * o.bars.rescaled.mean() for o in outcomes])
    return float(by_run.std(ddof=1) / np.sqrt(len(by_run)) / (2 * np.sqrt(by_run.mean())))
