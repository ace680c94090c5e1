"""From an adjusted network to millimetres: reference frame, covariance, spheres and scale."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.bundle import Adjustment
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.state import State
from spherecal.ball.fit import BallFit, Run, with_effects_unknown, with_lengths
from spherecal.ball.rigid import ModelChoice
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.data.findings import Findings
from spherecal.data.rig import RigScale
from spherecal.data.session import Recording, Session
from spherecal.geometry.sphere import Sphere, fit_sphere
from spherecal.scale.bar_scale import length_rows, odd_poses, scale_from_bars
from spherecal.scale.spacing import FoundScale, Located, Spacing, scale_from_mean_distance, scale_from_spacing


@dataclass(frozen=True)
class Solution:
    """The network in the reference camera's frame and in millimetres (arbitrary lengths where `scale.source` is none).

    `covariance` is that of the unscaled network: `factor` brings its lengths to millimetres. `cameras` is the
    covariance of all cameras' parameters in millimetres, scale included (rig.CameraCovariance). `found`: what gave the
    scale; None without one, or where it is another's.
    """

    state: State
    covariance: Covariance | None
    factor: float
    scale: RigScale
    spheres: dict[int, Sphere]
    cameras: FloatArray | None = None
    found: FoundScale | None = None


@dataclass(frozen=True)
class MetricFit:
    """The ball model that was chosen, why, and its network in millimetres; `stopped` at the free form by the user."""

    solved: BallFit
    choice: ModelChoice
    solution: Solution
    findings: Findings = ()
    stopped: bool = False


def in_millimetres(recording: Recording, fit: BallFit, run: Run) -> tuple[BallFit, Solution]:
    """The network in millimetres; a bar that gives the scale becomes part of the adjustment."""
    fit = with_effects_unknown(fit)
    solution, scale = metric_solution(recording, fit, literal=run.plain), recording.session.scale
    if run.plain or solution.scale.source != "bar" or scale is None or scale.bar is None:
        return fit, solution
    rows = length_rows(recording, scale.bar, solution.state.points, solution.found and solution.found.odd)
    if rows is None:
        return fit, solution
    again = with_lengths(fit, rows, solution.factor, run)
    if again.cofactors is None or again.cofactors.stretch is None:
        return fit, solution
    rough = replace(solution, state=again.by_features.state, covariance=None)
    return (again, rough) if run.rough else _by_bar(recording, again, solution.found)


def with_uncertainty(recording: Recording, fit: MetricFit) -> MetricFit:
    """The network of a `rough` run with its covariance; any other as it is."""
    if fit.solution.covariance is not None or fit.solved.cofactors is None:
        return fit
    solved, solution = _by_bar(recording, fit.solved, fit.solution.found)
    return replace(fit, solved=solved, solution=solution)


def _by_bar(recording: Recording, fit: BallFit, found: FoundScale | None) -> tuple[BallFit, Solution]:
    fit = with_effects_unknown(fit)
    assert fit.cofactors is not None and fit.cofactors.stretch is not None
    state = fit.by_features.state
    spheres = fit_spheres(state.points, recording.features.placement, recording.n_ball)
    known = float(np.sqrt(fit.adjusted.variance * fit.cofactors.stretch))
    cameras = fit.adjusted.variance * fit.cofactors.with_size().all_cameras()
    return fit, Solution(state, fit.cofactors, 1.0, RigScale("bar", known), spheres, cameras, found)


def by_stored_ball(recording: Recording, fit: BallFit, ball: RigScale) -> tuple[Solution, float | None]:
    """A network based on a stored ball, in millimetres by the better of the ball's and the session's scale.

    A bar is better than printed targets; of two alike the surer one is taken. Beside it how much longer lengths are by
    the session's own scale, relatively (None without one).
    """
    own = metric_solution(recording, fit)
    differs = None if own.scale.source == "none" else own.factor - 1.0
    if differs is not None and _surer(own.scale, ball):
        return own, differs
    state = fit.by_features.state
    cameras = None
    if fit.cofactors is not None and ball.relative_uncertainty is not None:
        found = FoundScale(1.0, ball.relative_uncertainty, 1, np.zeros_like(state.points))
        cameras = _metric_cameras(state, 1.0, found, fit.cofactors, fit.adjusted.variance)
    spheres = fit_spheres(state.points, recording.features.placement, recording.n_ball)
    scale = RigScale("ball", ball.relative_uncertainty)
    return Solution(state, fit.cofactors, 1.0, scale, spheres, cameras), differs


def _surer(one: RigScale, other: RigScale) -> bool:
    rank = {"target_spacing": 0, "ball": 1, "board": 1, "bar": 2}
    a, b = rank.get(one.source, 0), rank.get(other.source, 0)
    return a > b or (a == b and (one.relative_uncertainty or np.inf) < (other.relative_uncertainty or np.inf))


def metric_solution(recording: Recording, fit: BallFit, literal: bool = False) -> Solution:
    """The adjusted network in its scale; lengths stay arbitrary without covariance or a usable scale."""
    session, adjusted, cofactors = recording.session, fit.by_features, fit.cofactors
    state = adjusted.state
    spheres = fit_spheres(state.points, recording.features.placement, recording.n_ball)
    found = None if cofactors is None else _find_scale(recording, adjusted, cofactors, spheres, literal)
    factor = found.factor if found else _nominal_factor(session, spheres)
    cameras, scale = None, RigScale("none", None)
    if found and session.scale:
        scale = RigScale(found.source or session.scale.kind, found.relative_uncertainty)
    if cofactors is not None:
        cameras = _metric_cameras(state.scaled(factor), factor, found, cofactors, adjusted.variance)
    spheres = {p: Sphere(s.centre * factor, s.radius * factor, s.radial_sd * factor) for p, s in spheres.items()}
    return Solution(state.scaled(factor), cofactors, factor, scale, spheres, cameras, found)


def _metric_cameras(
    state: State, factor: float, found: FoundScale | None, cofactors: Covariance, variance: float
) -> FloatArray:
    """Covariance of all cameras' parameters in the metric network `state`, the scale's share included.

    A scale too large by ds shortens all metric translations by it, and ds comes from the same points.
    """
    matrix = variance * cofactors.all_cameras()
    n = len(state.translation)
    unit = np.ones((n, len(matrix) // n))
    unit[:, 3:POSE] = factor
    matrix = matrix * unit.ravel() * unit.reshape(-1, 1)
    if found is None:
        return matrix
    by_scale = np.zeros_like(unit)
    by_scale[:, 3:POSE] = -state.translation
    along = by_scale.ravel()
    mixed = np.outer(variance * cofactors.cameras_with(found.gradient) * unit.ravel(), along)
    return matrix + mixed + mixed.T + found.relative_uncertainty**2 * np.outer(along, along)


def fit_spheres(points: FloatArray, placement: IntArray, n_placements: int) -> dict[int, Sphere]:
    """The sphere of every placement of the ball whose points define one."""
    spheres = {}
    for t in range(n_placements):
        own = points[(placement == t) & np.isfinite(points[:, 0])]
        if len(own):  # no farther from their middle than five times the median distance: a ball's stay below 2
            distance = np.linalg.norm(own - np.median(own, axis=0), axis=1)
            own = own[distance <= 5 * np.median(distance)]
        sphere = fit_sphere(own)
        if sphere is not None:
            spheres[t] = sphere
    return spheres


def radii_of(spheres: dict[int, Sphere], n_placements: int) -> FloatArray:
    """The radii (t,) of the spheres by placement, NaN for none."""
    nothing = Sphere(np.zeros(3), np.nan, np.nan)
    return np.array([spheres.get(t, nothing).radius for t in range(n_placements)])


def _find_scale(
    recording: Recording, adjusted: Adjustment, cofactors: Covariance, spheres: dict[int, Sphere], literal: bool
) -> FoundScale | None:
    session, names, scale = recording.session, recording.observations.points, recording.session.scale
    located = Located(adjusted.state.points, cofactors, adjusted.variance)
    if scale is None or scale.kind == "none":
        return None
    if scale.kind == "bar":
        assert scale.bar is not None
        odd = None if literal else odd_poses(recording, scale.bar, located)
        return scale_from_bars(recording, scale.bar, located, odd)
    assert scale.from_point is not None and scale.to_point is not None and scale.distance_mm is not None
    if scale.from_point not in names or scale.to_point not in names:
        return None
    ends = names.index(scale.from_point), names.index(scale.to_point)
    spacing = Spacing(*ends, scale.distance_mm, scale.surface == "sphere", _patterns(session, names))
    radii = radii_of(spheres, len(recording.observations.placements))
    found = (scale_from_mean_distance if literal else scale_from_spacing)(spacing, recording.features, radii, located)
    if found is None:
        return None
    known = float(np.hypot(found.relative_uncertainty, scale.print_sd))
    return _with_ball(replace(found, relative_uncertainty=known), session, spheres)


def _with_ball(found: FoundScale, session: Session, spheres: dict[int, Sphere]) -> FoundScale:
    """The print's scale and that of a ball of measured diameter, weighted by their uncertainties.

    How far the ball is from round counts in full: what its visible side shows of its diameter is no better.
    """
    if session.sphere_sd_mm is None or session.sphere_diameter_mm is None or not spheres or "ball" in session.struck:
        return found
    radius = float(np.median([s.radius for s in spheres.values()]))
    shape = float(np.median([s.radial_sd for s in spheres.values()])) / radius
    own = float(np.hypot(session.sphere_sd_mm / session.sphere_diameter_mm, shape))
    share = found.relative_uncertainty**-2 / (found.relative_uncertainty**-2 + own**-2)  # of the print
    mean = share * found.factor + (1 - share) * (session.sphere_diameter_mm / 2 / radius)
    known = float((found.relative_uncertainty**-2 + own**-2) ** -0.5)
    source = "target_spacing" if share > 0.5 else "ball"
    return replace(found, factor=mean, relative_uncertainty=known, gradient=share * found.gradient, source=source)


def _patterns(session: Session, names: tuple[str, ...]) -> dict[int, FloatArray] | None:
    """The places (names, 2) in mm of every target's dots on the flat sticker, NaN for names that it does not have."""
    if session.target_set is None:
        return None
    missing = np.full(2, np.nan)
    layouts = session.target_set.layouts.items()
    return {target: np.array([layout.get(name, missing) for name in names]) for target, layout in layouts}


def _nominal_factor(session: Session, spheres: dict[int, Sphere]) -> float:
    """Without a scale: a factor from the ball's nominal diameter, for handy numbers, not reliable millimetres."""
    if session.sphere_diameter_mm is None or not spheres:
        return 1.0
    return session.sphere_diameter_mm / 2 / float(np.median([s.radius for s in spheres.values()]))
