"""Other lens models on a solved network: how much better each of them fits, by a short adjustment from the solution."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.ball_model import Free, Rigid
from spherecal.adjust.bundle import refine, residual_size
from spherecal.adjust.intrinsic_priors import with_intrinsic_priors
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.network import Network
from spherecal.adjust.problem import NO_PRIORS
from spherecal.adjust.state import State
from spherecal.ball.fit import BallFit, Run
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.lens_model import with_lens_model
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.geometry.camera import LENS_MODELS, LensModel, estimated_mask, is_fisheye
from spherecal.geometry.lens_fit import fit_lens

_ITERATIONS = 15
# Image points of a lens by which another model is fitted to it, as a start.
_FITTED_POINTS = 2000
_LEAST_FITTED = 40
# A model is proposed where it makes the variance of unit weight smaller by this share, and far beyond chance by
# Schwarz's criterion. Of 36 simulated rigs (demo, A, B) with Brown lenses that misfit by 0, 0.03 or 0.1 px at random,
# one (0.1 px) was offered another, the rational one, for 4 %.
WORTH = 0.03
BEYOND_CHANCE = 20.0


@dataclass(frozen=True)
class LensTrial:
    """The gain by other lenses: rms in px of the image points before and after, the ratio of the variances.

    `model` None: the same model with a lens for each camera instead of one for several. `variance_ratio`: of unit
    weight. `criterion`: by how much Schwarz's criterion (BIC) falls; above 0 the change is worth its numbers.
    """

    model: LensModel | None
    rms_before_px: float
    rms_px: float
    variance_ratio: float
    criterion: float

    @property
    def better(self) -> bool:
        """Whether it is to be preferred to what is in use."""
        return self.variance_ratio < 1 - WORTH and self.criterion > BEYOND_CHANCE

    @property
    def option(self) -> str:
        """The option of `spherecal calibrate` that takes it."""
        return "--own-intrinsics" if self.model is None else f"--lens {self.model}"

    @property
    def better_by(self) -> Phrase:
        """How it is better, for a finding."""
        lens = Phrase("lens-each") if self.model is None else Phrase("lens-model", {"model": self.model})
        values = {"px": self.rms_px, "before_px": self.rms_before_px, "ratio": self.variance_ratio}
        return Phrase("lens-better", {"lens": lens, **values})

    def chosen(self, cameras: tuple[str, ...]) -> Finding:
        """The finding that the model was used for these cameras instead of the session's."""
        values = {"better": self.better_by, "model": self.model}
        return Finding("lens-misfit", "info", values, cameras, kind="other-taken")

    def applied(self, session: Session) -> Session:
        """The session with this model for all cameras."""
        return session if self.model is None else with_lens_model(session, self.model)

    def noted_in(self, done: Calibration) -> Calibration:
        """The calibration with this model, and the finding that it was used; its validity does not change."""
        chosen = self.chosen(tuple(camera.id for camera in done.rig.cameras))
        quality = replace(done.rig.quality, findings=(*done.rig.quality.findings, chosen))
        return replace(done, rig=replace(done.rig, quality=quality))


def wants_another(fit: BallFit) -> bool:
    """Whether another lens model is worth a trial: where there are effects, or were refused."""
    return fit.network.is_beyond or fit.network.corrections is not None


def best_lens_model(fit: BallFit, run: Run) -> LensTrial | None:
    """The best of the models that are better for the lenses that were estimated; None where none is."""
    fit = _without_fields(fit, run.context)
    best = _best([trial for trial in try_lenses(fit, run.context) if trial.model is not None])
    run.watch.lap("lens models")
    return best


def _without_fields(fit: BallFit, context: Context) -> BallFit:
    """The fit by the measured image points: a field would do for every model what it cannot."""
    if fit.network.corrections is None:
        return fit
    network = fit.network.corrected(None, fit.adjusted.state.intrinsics)
    return replace(
        fit, network=network, adjusted=refine(network, fit.adjusted.state, fit.adjusted.used, fit.placed, context)
    )


def best_lenses(fit: BallFit, context: Context) -> LensTrial | None:
    """The best of the models, or separate lenses for cameras that share one; None where none is better."""
    return _best(try_lenses(fit, context))


def _best(trials: list[LensTrial]) -> LensTrial | None:
    return max((trial for trial in trials if trial.better), key=lambda trial: trial.criterion, default=None)


def try_lenses(fit: BallFit, context: Context) -> list[LensTrial]:
    """Every model except the one in use, for all cameras whose distortion is estimated; [] where that is not possible.

    Then the model in use with a lens for each camera, where some share one. All by a short adjustment from the
    solution, with its observations and weights.
    """
    network, state = fit.network, fit.adjusted.state
    # groups whose distortion is estimated, none of them with a prior; of placed cameras
    estimated = network.free[:, 4:].any(axis=1) & fit.placed
    groups = np.setdiff1d(np.unique(network.group[estimated]), np.unique(network.group[fit.has_prior]))
    members = np.isin(network.group, groups)
    now = {_model_of(network.free[c], state.intrinsics[c]) for c in np.flatnonzero(members)}
    if not now or None in now or not isinstance(network.ball, Free | Rigid) or not fit.adjusted.redundancy > 0:
        return []
    trials = []
    for model in LENS_MODELS:
        context.report("lens models", len(trials) / (len(LENS_MODELS) + 1), model)
        start = None if now == {model} else _start(fit, groups, model)
        if start is not None:
            free = np.where(members[:, None], estimated_mask(model), network.free)
            trials.append(_trial(fit, replace(network, free=free), start, model))
    if len(np.unique(network.group[members & fit.placed])) < (members & fit.placed).sum():
        own = replace(network, group=np.arange(len(network.group)))
        trials.append(_trial(fit, own, _with_known_points(state), None))
    return [trial for trial in trials if trial is not None]


def _trial(fit: BallFit, network: Network, start: State, model: LensModel | None) -> LensTrial | None:
    """The network with other lenses, from a start; None where it does not converge."""
    adjusted = fit.adjusted
    noise = float(np.sqrt(adjusted.variance))
    network = with_intrinsic_priors(replace(network, priors=NO_PRIORS), start.intrinsics, fit.has_prior, noise)
    problem, _ = network.problem(adjusted.used, network.free, fit.placed, weighted=True)
    found = minimise(problem, start, Settings(max_iterations=_ITERATIONS))
    rows, before, after = 2 * len(adjusted.rows), 2 * adjusted.minimum.cost, 2 * found.cost
    more = problem.layout.size - adjusted.problem.layout.size
    if not 0 < after < np.inf or adjusted.redundancy <= more:
        return None
    rms = _rms(fit.network, adjusted.state, adjusted.used), _rms(network, found.state, adjusted.used)
    ratio = float(after / (adjusted.redundancy - more) / adjusted.variance)
    return LensTrial(model, *rms, ratio, float(rows * np.log(before / after) - more * np.log(rows)))


def _model_of(free: BoolArray, intrinsics: FloatArray) -> LensModel | None:
    """The model by which a lens was estimated; None for other choices of parameters (the paper's)."""
    wide = bool(is_fisheye(intrinsics))
    return next((m for m in LENS_MODELS if (free == estimated_mask(m)).all() and (m == "fisheye") == wide), None)


def _start(fit: BallFit, groups: IntArray, model: LensModel) -> State | None:
    """The solution with the groups' lenses replaced by the nearest of the model; None where one cannot be."""
    network, state = fit.network, fit.adjusted.state
    intrinsics = state.intrinsics.copy()
    for group in groups:
        own = network.group == group
        seen = np.flatnonzero(fit.adjusted.used & own[network.camera])
        if len(seen) < _LEAST_FITTED:
            return None
        some = seen[np.unique(np.linspace(0, len(seen) - 1, _FITTED_POINTS).round().astype(int))]
        found = fit_lens(state.intrinsics[np.flatnonzero(own & fit.placed)[0]], network.uv[some], model)
        if found is None:
            return None
        intrinsics[own] = found.intrinsics
    return replace(_with_known_points(state), intrinsics=intrinsics)


def _with_known_points(state: State) -> State:
    return replace(state, points=np.where(np.isfinite(state.points), state.points, 0.0))


def _rms(network: Network, state: State, used: BoolArray) -> float:
    size = residual_size(network, state)[used]
    return float(np.sqrt((size**2).mean()))
