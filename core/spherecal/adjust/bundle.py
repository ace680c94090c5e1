"""The bundle adjustment of (2), from a rough start: robust first, then a gate, then plain least squares.

Robust losses protect the start; the final estimate is plain least squares over the gated observations, which is
unbiased and has a valid covariance.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust import engine
from spherecal.adjust.ball_model import Deformable, Free, Stored
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Minimum, Settings
from spherecal.adjust.network import Network
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray, blocks
from spherecal.base.context import Context
from spherecal.geometry.camera import INTRINSIC_NAMES, project

# Rays of a point closer to parallel than this fix its depth worse than its position a hundredfold; the smallest angle
# of a good point on rigs A and B is 9 degrees.
MIN_ANGLE_RAD = np.deg2rad(2.0)
# A start's wild points, 0.6 to 3 % of two-view points in halls, had residuals up to 4e5 px and alone stopped the
# adjustment; those beyond 20 times the median never came back as good ones. Below 100 px nothing is wild: a camera just
# added to an adjusted network is off by tens of pixels.
WILD_FACTOR, WILD_LEAST_PX, WILD_IN_CAMERA = 20.0, 100.0, 5.0
# Scale of the robust loss, once the start's errors of tens of pixels are gone; good dots end below 0.1 px. It begins at
# the size of those errors: at 3 px from the beginning one start in 80 (focal lengths 10 % off) stayed stuck.
CAUCHY_PX = 3.0
# Quantiles of the length of a residual with unit standard deviation in each coordinate (Rayleigh's distribution). With
# Student's t of 5 degrees of freedom the gate by the median threw out 2.2 % of the good observations, by both 0.4 %.
RAYLEIGH_MEDIAN = 1.1774
UPPER, RAYLEIGH_UPPER = 0.97, 2.6482
# Heavy tails make the two differ by 1.4 (5 degrees of freedom) to 1.8 (3); more is the wrong observations themselves.
HEAVIEST = 2.0
# The gate: 4.5 standard deviations lose 4 of 100,000 good points; below 0.15 px an error does no harm that the
# covariance does not tell. With both, 0 to 9 of the outliers of a 5 % series were missed, harmless ones.
GATE_SIGMAS, GATE_LEAST_PX = 4.5, 0.15
GATE_ROUNDS = 6
# A point that two views alone locate is less certain than one of all: so many gates are allowed to find who agrees.
PAIR_GATES = 2.0
# From this number of columns on (40 cameras) each step takes seconds, and from a good start none needs damping: hall100
# is at its minimum after 3 steps instead of 7.
LARGE_COLUMNS, LARGE_DAMPING = 600, 1e-8
# Two halves of a rig that hardly see each other (rig B) swing into place slowly: 15 steps left one in 12 starts askew,
# and its cross links were then gated as outliers.
START_ITERATIONS = 100
# Poses alone come first: with free intrinsics from a start of 60 px one in 100 focal lengths ran away to -85 %.
START_INTRINSICS = ("fu", "fv", "u0", "v0", "k1", "k2")
# From so many observations on the start takes so many of each camera, from all over its images. (With those that most
# cameras see, lenses were left to guess beyond the middle: 12 of 100 cameras stood out, and were resected for 30 s.)
LARGE_START, START_OBSERVATIONS = 100_000, 400


@dataclass(frozen=True)
class Adjustment:
    """An adjusted network: its state, the final problem (rows: observation of each), used (n,), sigma0 squared."""

    state: State
    problem: Problem
    rows: IntArray
    used: BoolArray
    minimum: Minimum
    redundancy: int

    @property
    def variance(self) -> float:
        """v'Pv / redundancy, the square of sigma0; NaN without redundancy."""
        return 2 * self.minimum.cost / self.redundancy if self.redundancy > 0 else float("nan")

    @property
    def is_settled(self) -> bool:
        """Whether another adjustment of the same problem would not move it: by 6e-11 mm with a million observations.

        With the damping of small networks, or a soft ball, it went on for up to 5e-7 mm.
        """
        return self.minimum.converged and _is_large(self.problem) and not isinstance(self.problem.ball, Deformable)


def usable_features(network: Network, state: State, candidates: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Triangulated points (m,3) and which of them may enter an adjustment: in front, well conditioned, no gross error.

    `candidates`: observations to locate points from, (n,).
    """
    triangulated = network.triangulated(state, candidates)
    good = triangulated.in_front & (triangulated.max_angle_rad >= MIN_ANGLE_RAD)
    size = np.linalg.norm(triangulated.residual, axis=1)
    size = np.where(np.isfinite(size), size, np.inf)
    feature, camera = network.feature[candidates], network.camera[candidates]
    counted = good[feature]
    if not counted.any():
        return triangulated.points, good
    limit = np.full(len(network.group), max(WILD_FACTOR * float(np.median(size[counted])), WILD_LEAST_PX))
    for c in np.unique(camera[counted]):  # a camera that starts askew is off in all its points, and must keep them
        limit[c] = max(limit[c], WILD_IN_CAMERA * float(np.median(size[counted & (camera == c)])))
    wild = np.zeros(network.n_features, dtype=bool)
    wild[feature[size > limit[camera]]] = True
    return triangulated.points, good & ~wild


@dataclass(frozen=True)
class RobustStep:
    """A short robust adjustment: the intrinsics that it estimates (None: all), its iterations and its stage's name."""

    intrinsics: tuple[str, ...] | None
    iterations: int = START_ITERATIONS
    stage: str = "robust adjustment"


def robust_adjustment(
    network: Network, state: State, candidates: BoolArray, placed: BoolArray, step: RobustStep, context: Context
) -> State:
    """A state after a short robust adjustment of the placed cameras and of the points that it knows.

    Points that are NaN take no part; they are 0 in the result.

    `candidates`, `placed`: observations to use (n,), and cameras that have a pose (c,).
    """
    good = np.isfinite(state.points[:, 0])
    used = candidates & good[network.feature]
    if not used.any():
        return state
    state = replace(state, points=np.where(good[:, None], state.points, 0.0))
    names, iterations = step.intrinsics, step.iterations
    free = network.free if names is None else network.free & np.isin(INTRINSIC_NAMES, names)
    problem, _ = network.problem(used, free, placed, weighted=False)
    typical = float(np.median(np.linalg.norm(engine.residuals(problem, state), axis=1)))
    for cauchy in (typical, CAUCHY_PX) if typical > CAUCHY_PX else (CAUCHY_PX,):
        settings = Settings(cauchy=cauchy, max_iterations=iterations, tolerance=1e-4)
        state = minimise(problem, state, settings, _watch(context, step.stage, iterations)).state
    return _with_shared_lenses(network, state, placed)


def _with_shared_lenses(network: Network, state: State, placed: BoolArray) -> State:
    """The state with the adjusted lens also for cameras of the same group that have no pose yet.

    An adjustment adds the same step to all members: one that joins later with its prior would keep the difference.
    """
    first = np.full(int(network.group.max()) + 1, -1)
    members = np.flatnonzero(placed)[::-1]
    first[network.group[members]] = members
    source = first[network.group]
    joins = ~placed & (source >= 0)
    if not joins.any():
        return state
    return replace(state, intrinsics=np.where(joins[:, None], state.intrinsics[source], state.intrinsics))


def robust_start(
    network: Network, state: State, candidates: BoolArray, placed: BoolArray, context: Context
) -> tuple[State, BoolArray]:
    """A network near its minimum from rough poses, by robust adjustments, and the observations (n,) that fit it."""
    large = np.count_nonzero(candidates) > LARGE_START
    some = spread_observations(network, candidates, START_OBSERVATIONS) if large else candidates
    for names in ((), START_INTRINSICS, None):
        state = robust_adjustment(network, triangulated(network, state, some), some, placed, RobustStep(names), context)
    state = triangulated(network, state, candidates)
    return state, candidates & np.isfinite(state.points[network.feature, 0])


def best_observations(network: Network, candidates: BoolArray, enough: int) -> BoolArray:
    """About so many of each camera's candidates (n,), of the features that most cameras see."""
    views = network.views(candidates)
    chosen = np.zeros(network.n_features, dtype=bool)
    for camera in np.unique(network.camera[candidates]):
        features = network.feature[candidates & (network.camera == camera)]
        features = features[views[features] >= 2]
        chosen[features[np.argsort(-views[features], kind="stable")[:enough]]] = True
    return candidates & chosen[network.feature]


def spread_observations(network: Network, candidates: BoolArray, enough: int) -> BoolArray:
    """At least so many of each camera's candidates (n,), if it has them, of features drawn at random."""
    draw = np.random.default_rng(0).permutation(network.n_features)
    several = network.views(candidates) >= 2
    chosen = np.zeros_like(several)
    for camera in np.unique(network.camera[candidates]):
        features = network.feature[candidates & (network.camera == camera)]
        lacking = max(enough - int(chosen[features].sum()), 0)
        features = features[several[features] & ~chosen[features]]
        chosen[features[np.argsort(draw[features])[:lacking]]] = True
    return candidates & chosen[network.feature]


def triangulated(network: Network, state: State, candidates: BoolArray) -> State:
    """The state with the points that may enter an adjustment (`usable_features`), NaN for the others.

    `candidates`: observations to locate points from, (n,).
    """
    points, good = usable_features(network, state, candidates)
    return replace(state, points=np.where(good[:, None], points, np.nan))


def refine(network: Network, state: State, used: BoolArray, placed: BoolArray, context: Context) -> Adjustment:
    """Gate and plain least squares in turns until the gate changes nothing, from a good start.

    `used`, `placed`: observations to begin with (n,), and cameras that have a pose (c,).
    """
    done = None
    for _ in range(GATE_ROUNDS):
        state = _triangulate_missing(network, state, used)
        state = _triangulate_missing(network, state, placed[network.camera])
        state = _triangulate_contradicted(network, state, placed, used)
        gated = _gate(network, state, placed, used)
        is_same = bool((gated == used).all())
        if done is not None and is_same and done.is_settled:
            break
        problem, rows = network.problem(gated, network.free, placed, weighted=True)
        known = np.where(np.isfinite(state.points), state.points, 0.0)
        # with the usual damping, long flexible chains of cameras converge slowly
        settings = Settings(first_damping=LARGE_DAMPING) if _is_large(problem) else Settings()
        minimum = minimise(problem, replace(state, points=known), settings, _watch(context, "bundle adjustment", 20))
        lost = (network.views(gated) == 0) & ~network.known
        state = replace(minimum.state, points=np.where(lost[:, None], np.nan, minimum.state.points))
        redundancy = problem.rows - problem.unknowns + datum_defect(problem) if gated.any() else 0
        if network.corrections is not None:
            redundancy -= round(float(network.corrections.freedom.sum()))
        done, used = Adjustment(state, problem, rows, gated, minimum, redundancy), gated
        if is_same:
            break
    assert done is not None
    return done


def _is_large(problem: Problem) -> bool:
    return problem.layout.expanded >= LARGE_COLUMNS


def _triangulate_missing(network: Network, state: State, candidates: BoolArray) -> State:
    """The state with points for features that had none, where candidates (n,) agree with the present cameras."""
    missing = np.isnan(state.points[:, 0])
    rows = candidates & missing[network.feature]
    rows &= (network.views(rows) >= 2)[network.feature]
    if not rows.any():
        return state
    points, good = usable_features(network, state, rows)
    return replace(state, points=np.where((missing & good)[:, None], points, state.points))


def _triangulate_contradicted(network: Network, state: State, placed: BoolArray, used: BoolArray) -> State:
    """The state with points whose views contradict each other located by those that agree.

    Least squares smears a wrong view over its point's others: of a track of three all would fail the gate.
    """
    size = residual_size(network, state)
    limit = gate_px(network, size, placed, used)
    rows = placed[network.camera] & np.isfinite(limit)
    outside = rows & (size > limit)
    contradicted = np.zeros(network.n_features, dtype=bool)
    contradicted[network.feature[outside]] = True
    contradicted &= (network.views(rows) >= 3) & ~network.known
    take = np.flatnonzero(rows & contradicted[network.feature])
    if not len(take):
        return state
    agree = np.zeros(len(rows), dtype=bool)
    agree[take] = network.agreeing(state, take, PAIR_GATES * limit[take])
    points, good = usable_features(network, state, agree)
    better = contradicted & good & (network.views(agree) >= network.views(rows & ~outside))
    return replace(state, points=np.where(better[:, None], points, state.points))


def datum_defect(problem: Problem) -> int:
    """Unknowns that no observation determines: seven of the free network, six when a length fixes its scale.

    One locked camera leaves the scale open, two or more nothing; a rigid ball's own frame is open in any case.
    """
    rigid = 6 if problem.n_placements and problem.ball.free_placement.all() else 0
    locked = int((~problem.free_pose & _observed(problem)).sum())
    scale = 1 if not (problem.has_lengths or isinstance(problem.ball, Stored)) and locked < 2 else 0
    return (6 if locked == 0 else 0) + scale + rigid


def _observed(problem: Problem) -> BoolArray:
    return np.bincount(problem.camera, minlength=problem.n_cameras) > 0


def gate_px(network: Network, size: FloatArray, placed: BoolArray, used: BoolArray) -> FloatArray:
    """How far (n,) px each observation may be from its predicted image point; NaN for cameras without a pose.

    The gate is wider for a camera that is noisier than the rest, so that a blurred camera is not thrown away.

    `placed`, `used` (c,).
    """
    noise = np.full(len(network.group), np.nan)
    overall = _noise(size[used])
    for c in np.flatnonzero(placed):
        noise[c] = max(_noise(size[used & (network.camera == c)]), overall)
    return np.maximum(GATE_SIGMAS * noise, GATE_LEAST_PX)[network.camera]


def _gate(network: Network, state: State, placed: BoolArray, used: BoolArray) -> BoolArray:
    """Observations within the gate of their predicted image point, of features that keep two views."""
    size = residual_size(network, state)
    keep = placed[network.camera] & (size <= gate_px(network, size, placed, used))
    keep &= ((network.views(keep) >= 2) | network.known)[network.feature]
    if not isinstance(network.ball, Free):  # one camera may see a dot of the ball twice along the same ray
        wide = network.known | (network.angles(state, _few_of_each(network, keep)) >= MIN_ANGLE_RAD)
        wide |= network.angles(state, keep & ~wide[network.feature]) >= MIN_ANGLE_RAD
        keep &= wide[network.feature]
    return keep


def _few_of_each(network: Network, rows: BoolArray) -> BoolArray:
    """Three of the rows (n,) of each feature; where two of these make a wide angle, the others need not be asked."""
    take = np.flatnonzero(rows)
    take = take[np.argsort(network.feature[take], kind="stable")]
    _, begin, count = np.unique(network.feature[take], return_index=True, return_counts=True)
    few = np.zeros_like(rows)
    few[take[(begin + np.array([[0], [1], [2]]) * (count - 1) // 2).ravel()]] = True
    return few


def _noise(size: FloatArray) -> float:
    """Robust standard deviation of one coordinate from lengths of residuals: from their median or an upper quantile.

    Both agree for normal noise. With heavy tails the median alone makes the gate so narrow that good observations fail.
    Infinite lengths, of points behind a camera, say nothing of its noise: they would open the gate to themselves.
    """
    size = size[np.isfinite(size)]
    if not len(size):
        return 0.0
    by_median = float(np.median(size)) / RAYLEIGH_MEDIAN
    return min(max(by_median, float(np.quantile(size, UPPER)) / RAYLEIGH_UPPER), HEAVIEST * by_median)


def residual_size(network: Network, state: State) -> FloatArray:
    """Lengths of the residuals (n,) px, infinite where there is no prediction in front of the camera."""
    out = np.empty(len(network.uv))
    for rows in blocks(len(out)):
        some = network.only(rows)
        x = some.camera_points(state)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            size = np.linalg.norm(project(x, state.intrinsics[some.camera]) - some.uv, axis=1)
            out[rows] = np.where(np.isfinite(size) & (x[:, 2] > 0), size, np.inf)
    return out


def _watch(context: Context, stage: str, expected: int):
    def on_step(iteration: int, cost: float) -> None:
        context.report_iteration(stage, iteration / (iteration + expected / 2), iteration, cost)

    return on_step
