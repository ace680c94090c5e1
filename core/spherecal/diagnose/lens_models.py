"""Other lens models on a solved network: how much better each of them fits, by a short adjustment from the solution."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.bundle import residual_size
from spherecal.adjust.held import hold
from spherecal.adjust.levenberg import Engine, Settings, minimise
from spherecal.adjust.network import Network
from spherecal.adjust.problem import State
from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.context import Context
from spherecal.findings import Finding
from spherecal.forms import Solved
from spherecal.geometry.camera import LENS_MODELS, LensModel, estimated_mask, is_fisheye
from spherecal.geometry.lens_fit import fit_lens

# From a lens fitted to the solution the cost is within 1e-4 of its minimum after 4 to 9 steps (dome15, rig A).
_ITERATIONS = 15
# Image points of a lens by which another model is fitted to it; more change the start by less than its step does.
_FITTED_POINTS = 2000
_LEAST_FITTED = 40
# A model is proposed where it makes the variance of unit weight smaller by this share, and far beyond chance by
# Schwarz's criterion: on 30 recordings whose lenses follow the model in use none of the others did either.
WORTH = 0.03
BEYOND_CHANCE = 20.0


@dataclass(frozen=True)
class LensTrial:
    """What a model brings: rms in px of the image points before and after, the ratio of the variances of unit weight.

    `criterion`: by how much Schwarz's criterion (BIC) falls; above 0 the model is worth its numbers.
    """

    model: LensModel
    rms_before_px: float
    rms_px: float
    variance_ratio: float
    criterion: float

    @property
    def better(self) -> bool:
        """Whether the model is to be preferred to the one in use."""
        return self.variance_ratio < 1 - WORTH and self.criterion > BEYOND_CHANCE

    @property
    def words(self) -> str:
        """In what it is better."""
        return (
            f"the {self.model} model fits better: {self.rms_px:.3f} px rms instead of {self.rms_before_px:.3f}, "
            f"variance of unit weight {self.variance_ratio:.2f} times as large"
        )

    @property
    def chosen(self) -> Finding:
        """That the model was taken instead of the session's."""
        return Finding(
            "info", "lens-model-chosen", f"The lens model was chosen by the data: {self.words}.",
            f"Give the cameras of the session \"lens_model\": \"{self.model}\" to have it without a trial.",
        )  # fmt: skip


def best_lens_model(solved: Solved, engine: Engine, context: Context) -> LensTrial | None:
    """The best of the models that are better for the lenses that were estimated; None where none is."""
    trials = [trial for trial in try_lens_models(solved, engine, context) if trial.better]
    return max(trials, key=lambda trial: trial.criterion, default=None)


def try_lens_models(solved: Solved, engine: Engine, context: Context) -> list[LensTrial]:
    """Every model but the one in use, for all cameras whose distortion is estimated; [] where it says nothing.

    The same observations, weights and points as in the solution, which each trial starts from.
    """
    network, adjusted = solved.network, solved.adjusted
    groups = _changeable(solved)
    if not len(groups) or network.play is not None or not adjusted.redundancy > 0:
        return []
    members = np.isin(network.group, groups)
    now = {_model_of(network.free[c], adjusted.state.intrinsics[c]) for c in np.flatnonzero(members)}
    if None in now:
        return []
    rows, before = 2 * len(adjusted.rows), 2 * adjusted.minimum.cost
    rms_before = _rms(network, adjusted.state, adjusted.used)
    trials = []
    for model in LENS_MODELS:
        context.report("lens models", len(trials) / len(LENS_MODELS), model)
        start = None if now == {model} else _start(solved, groups, model)
        if start is None:
            continue
        free = np.where(members[:, None], estimated_mask(model), network.free)
        changed = hold(
            replace(network, free=free, priors=None), start.intrinsics, solved.held, np.sqrt(adjusted.variance)
        )
        problem, _ = changed.problem(adjusted.used, free, solved.placed, weighted=True)
        found = minimise(problem, start, Settings(max_iterations=_ITERATIONS, engine=engine))
        after = 2 * found.cost
        if not 0 < after < np.inf:
            continue
        more = problem.layout.size - adjusted.problem.layout.size
        ratio = after / max(adjusted.redundancy - more, 1) / adjusted.variance
        criterion = rows * np.log(before / after) - more * np.log(rows)
        rms = _rms(changed, found.state, adjusted.used)
        trials.append(LensTrial(model, rms_before, rms, float(ratio), float(criterion)))
    return trials


def _changeable(solved: Solved) -> IntArray:
    """Intrinsics groups whose distortion is estimated, none of them held; of placed cameras."""
    network = solved.network
    estimated = network.free[:, 4:].any(axis=1) & solved.placed
    held = np.unique(network.group[solved.held])
    return np.setdiff1d(np.unique(network.group[estimated]), held)


def _model_of(free: BoolArray, intrinsics: FloatArray) -> LensModel | None:
    """The model by which a lens was estimated; None for a choice of numbers that is none of them (the paper's)."""
    return next(
        (
            model for model in LENS_MODELS
            if (free == estimated_mask(model)).all() and (model == "fisheye") == bool(is_fisheye(intrinsics))
        ),
        None,
    )  # fmt: skip


def _start(solved: Solved, groups: IntArray, model: LensModel) -> State | None:
    """The solution with the groups' lenses replaced by the nearest of the model; None where one cannot be."""
    network, state = solved.network, solved.adjusted.state
    intrinsics = state.intrinsics.copy()
    for group in groups:
        own = network.group == group
        seen = np.flatnonzero(solved.adjusted.used & own[network.camera])
        if len(seen) < _LEAST_FITTED:
            return None
        some = seen[np.unique(np.linspace(0, len(seen) - 1, _FITTED_POINTS).round().astype(int))]
        found = fit_lens(state.intrinsics[np.flatnonzero(own & solved.placed)[0]], network.uv[some], model)
        if found is None:
            return None
        intrinsics[own] = found.intrinsics
    return replace(state, intrinsics=intrinsics, points=np.where(np.isfinite(state.points), state.points, 0.0))


def _rms(network: Network, state: State, used: BoolArray) -> float:
    size = residual_size(network, state)[used]
    return float(np.sqrt((size**2).mean()))
