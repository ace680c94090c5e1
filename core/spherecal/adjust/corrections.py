"""Fields of lenses and motions of images: what the cameras do beyond the lens model and one pose each.

A network's observations are corrected by them (`Network.correction`), so that everything else works with the lens model
and one pose a camera. Both are random effects, with amplitudes by restricted maximum likelihood (`variance_components`)
in one adjustment with all other unknowns, and each is taken only where the data ask for it beside the other.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from spherecal.adjust.ball_model import Deformable, Free, Rigid, Stored
from spherecal.adjust.bundle import Adjustment, refine
from spherecal.adjust.camera_effects import (
    BENDING,
    FIELD,
    MOTION,
    TURN,
    Corrections,
    Design,
    Field,
    bending_of,
)
from spherecal.adjust.covariance import inverted, with_effects
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.datum import Places
from spherecal.adjust.effect_elimination import effects_of
from spherecal.adjust.lens_field import beyond_lens, field_basis
from spherecal.adjust.network import Network
from spherecal.adjust.space_strain import strain_columns, strain_variance
from spherecal.adjust.variance_components import (
    Effects,
    Estimate,
    effect_cofactors,
    estimated,
    least_cost,
    others_eliminated,
    solved,
)
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.context import Context
from spherecal.base.threads import one_blas_thread

# -2 log of the likelihood must fall by more than this for the effects to be taken; noise gave 0 to 2.
LEAST_EVIDENCE = 30.0
# Fields that gain more for each coefficient are no such thing as what errors of neighbouring points have in common: it
# was 1 on dome15, and 3 to 80 with lenses off by 0.03 to 0.3 px.
CLEAR = 2.0
# In the rigid form variances are at most so many times the free form's: more is what the ball changed its shape by.
MOST_GROWTH = 4.0
# Better image points than this need no effects.
LEAST_NOISE_PX = 1e-3
# The real cameras of dome15 drift by 2 px, and real lenses deviate by 0.3 px. What is more in a camera, rms, is a wrong
# pose, or another lens model or a lens of its own (1.5 % of focal length: 2 px) that it wants.
MOST_PX, MOST_FIELD_PX = 4.0, 1.0
LEAST_VARIANCE = 1e-12
# A lens' field begins with this amplitude, px; a turn with that which moves its images by this.
FIRST_PX = 0.05
# Lenses seen by fewer observations have no field of their own.
LEAST_OBSERVATIONS = 60
# All fields together have at most so many coefficients, 30 functions a coordinate: large rigs have stiffer fields.
MOST_COEFFICIENTS, MOST_FUNCTIONS = 2000, 80
# All turns together have at most so many columns (800 images): from there on consecutive placements share a turn.
MOST_TURNS = 2400
# Eigenfunctions that hold less of a field's variance are left out; where its amplitude is more than so many standard
# deviations of an image coordinate, what they hold is more than noise (rig A, 0.3 px: chi2 1.04 without them).
LEAST_SHARE, FINE_SHARE, LARGE = 1e-4, 1e-5, 10.0
# Amplitudes that a field may have though it is not taken, px: as far above the best as a standard uncertainty, where
# -2 log of the likelihood is one more. Only where fields gain more than noise does (5 on rig A with 100 targets; one in
# 1,000 of such amplitudes gains 9.5): clean results stay as they are. Real lenses deviate by up to 0.3 px.
NOT_EXCLUDED_PX, NOT_EXCLUDED, MORE_THAN_NOISE = tuple(0.4 / 2**k for k in range(7, -1, -1)), 1.0, 10.0
# A ball taken as rigid that bends a little: each polynomial's amplitude over the ball's size, at up to so many
# placements. Bent by 0.01 mm of 250, centres of cameras were off by 3.3 of their standard uncertainties, rms, and are
# now by 0.9 (seed 1245; lengths 2.3 and 1.1).
MOST_BENDING, BENT = 10, tuple(2e-4 / 2**k for k in range(9, -1, -1))
# Beyond the last points, of their longer side, to where a field goes on. Bars are seen there: 33.8 um in place of 43.9
# (rig A, 0.3 px, 8 rigs), 19.3 in place of 20.0 (0.1 px); at twice as much 21 (0.1 px), and a camera "unsteady" (1231).
MARGIN = 0.06
ROUNDS = 4
SETTLED_PX = 1e-3
# A round that lowers -2 log of the likelihood by less says nothing new: effects are taken from 30 on. What a lens, a
# pose and a field may share went on changing by a tenth of a pixel without any gain.
SETTLED = 5.0
ALIKE = 0.01  # the gate adds and takes away less than this share of observations


def design_of(network: Network, adjusted: Adjustment, least_share: float = LEAST_SHARE) -> Design:
    """The effects that a network may have; fields without functions of less than `least_share` of the variance."""
    problem, intrinsics = adjusted.problem, adjusted.state.intrinsics
    seen = np.bincount(problem.camera, minlength=problem.n_cameras)
    shared = [np.flatnonzero((network.group == group) & (seen > 0)) for group in np.unique(network.group)]
    # cameras that share a lens by the session share its field: else fields would hide that they do not
    groups = [own for own in shared if seen[own].sum() >= LEAST_OBSERVATIONS]
    most = min(MOST_FUNCTIONS, MOST_COEFFICIENTS // (2 * max(len(groups), 1)))
    fields, first = [], 0
    for own in groups:
        lens = intrinsics[own[0]]
        free = network.free[own[0]] | (np.arange(16) < 4)
        # Over the whole image, functions as fine as a ball shows that fills a part have amplitudes of 5 to 160 px. They
        # were refused: 0.149 mm on 500 in place of 0.021 (seed 1229), a pose 7.4 mm off in place of 1.3 (1231).
        uv = network.measured[adjusted.rows[np.isin(problem.camera, own)]]
        size = np.ptp(uv, axis=0).clip(min=1.0)
        low, size = uv.min(axis=0) - MARGIN * size.max(), size + 2 * MARGIN * size.max()
        basis = field_basis(low, size, lens, free, most, least_share)
        fields.append(Field(basis, first, own))
        first += basis.count
    n_placements = int(network.placement.max()) + 1
    images = np.unique(network.camera * n_placements + network.placement)
    together = -(-TURN * len(images) // MOST_TURNS)
    camera, placement = np.divmod(images, n_placements)
    turns = np.unique(np.stack([camera, placement // together]), axis=1)
    return Design(tuple(fields), turns[0], turns[1], problem.n_cameras, together)


def corrected(
    network: Network,
    adjusted: Adjustment,
    placed: BoolArray,
    places: Places | None,
    first: Corrections | None,
    context: Context,
) -> tuple[Network, Adjustment]:
    """The network with its lenses' fields and images' motions, where the data ask for them, adjusted with them.

    `placed`: cameras that have a pose, (c,); `places` None in the free form; `first`: its `first_effects`.
    """
    found = network.corrections
    if not _may_have_effects(network, adjusted) or (found is None and first is None):
        return network, adjusted
    limit = None if found is None or isinstance(network.ball, Free) else MOST_GROWTH * found.variances
    for _ in range(ROUNDS):
        before, found = found, first if found is None else _estimated(network, adjusted, places, found, limit)
        assert found is not None
        if _is_settled(before, found):
            break  # what lens, pose and field share would go on wandering, of one weak camera from 0.4 to 1.5 px
        found = replace(found, turning=network.turning)
        again = network.corrected(found, adjusted.state.intrinsics)
        if is_beyond(found, again, adjusted.state.intrinsics):
            # no small effect: the lenses or the poses are wrong
            network = replace(network.corrected(None, adjusted.state.intrinsics), sizes=None, is_beyond=True)
            return network, refine(network, adjusted.state, adjusted.used, placed, context)
        change = np.abs(again.uv - network.uv).max(initial=0.0)
        network = again
        if change == 0.0:
            break
        adjusted = refine(network, adjusted.state, adjusted.used, placed, context)
        if change < SETTLED_PX:
            break
    return network, adjusted


def _is_settled(before: Corrections | None, found: Corrections) -> bool:
    """Whether a round gained nothing on the one before, with about as many observations."""
    if before is None or abs(found.redundancy / before.redundancy - 1) > ALIKE:
        return False
    gain = before.deviance / before.redundancy - found.deviance / found.redundancy
    return gain * found.redundancy < SETTLED


def _may_have_effects(network: Network, adjusted: Adjustment) -> bool:
    """Whether fields and motions may be estimated of a network at all: not where a field has no other placement.

    camcal's lens then went 0.011 mm from what two programs published; it is within 0.004 without a field.
    """
    if adjusted.redundancy <= 0 or isinstance(network.ball, Deformable):
        return False
    several = (np.bincount(network.placement) >= LEAST_OBSERVATIONS).sum() > 1
    is_exact = not np.sqrt(adjusted.variance) / np.median(adjusted.problem.weight) > LEAST_NOISE_PX
    return has_estimated_lenses(network, adjusted) and bool(several) and not is_exact


def has_estimated_lenses(network: Network, adjusted: Adjustment) -> bool:
    """Whether effects may be estimated: what a given lens cannot do is for the test of given lenses to say."""
    return network.sizes is not None and bool(network.free[np.unique(adjusted.problem.camera), 0].all())


def drifts(network: Network) -> bool:
    """Whether cameras turn from image to image by the data, but not in the network."""
    found = network.corrections
    return found is not None and not found.turning and MOTION in found.evidence


def drift_alike(network: Network) -> bool:
    """Whether cameras turn by the data, but not in the network, none in one step and none far more than the others."""
    found = network.corrections
    return found is not None and drifts(network) and not (found.moved_once | found.turns_more).any()


def one_moved(network: Network) -> bool:
    """Whether a camera turns in one step, or for one image."""
    return network.corrections is not None and bool(network.corrections.moved_once.any())


def is_beyond(found: Corrections, network: Network, intrinsics: FloatArray) -> bool:
    """Whether the image points of some camera are corrected by more than effects are, lenses (c,16) adjusted to them.

    Over a part of the image fields and lens models are alike: of a field of 1.0 px, where a ball had stickers on one
    half, the lens had taken up all but 0.3 px.
    """
    for c in np.unique(network.camera):
        own = network.camera == c
        measured = network.measured[own]
        field = beyond_lens(found.field(int(c), measured), measured, intrinsics[c], network.free[c])
        whole = np.sqrt((network.correction[own] ** 2).sum(axis=1).mean())
        if whole > MOST_PX or np.sqrt((field**2).sum(axis=1).mean()) > MOST_FIELD_PX:
            return True
    return False


def with_corrections(given: Covariance, network: Network, adjusted: Adjustment) -> Covariance:
    """The covariance of an adjusted network with its corrections estimated, from that in which they are known.

    Fields that the data do not ask for take part with the largest amplitude that the data do not exclude, and so do
    changes of shape of a ball that is taken as rigid.
    """
    found = network.corrections
    if isinstance(network.ball, Deformable):
        return given
    if found is None and not _may_have_effects(network, adjusted):
        return given
    with one_blas_thread(), suppress(np.linalg.LinAlgError):
        design = design_of(network, adjusted).of_fields if found is None else found.design
        if isinstance(network.ball, Rigid | Stored) and adjusted.problem.n_placements <= MOST_BENDING:
            design = replace(design, bending=bending_of(adjusted.problem, adjusted.state.points))
        if not design.count:
            return given
        start = None if found is None else np.append(found.applied, np.zeros(design.count - design.n_of_cameras))
        system = effects_of(network, adjusted, design, given, start, True)
        taken = np.zeros(len(design.kind))
        if found is not None:
            taken[: len(found.variances)] = found.variances
        considered = _considered(design, system.quadratic, taken, adjusted)
        own = _with_considered(system.quadratic, taken, considered)
        if design.bending is not None:
            is_stored = isinstance(network.ball, Stored)
            columns = strain_columns(design, adjusted.state.placement_rotation, is_stored)
            variance = max(adjusted.variance, LEAST_VARIANCE)
            strain = strain_variance(system.quadratic, taken + considered, columns, variance)
            by = own @ (system.quadratic.matrix @ columns) - columns
            own += by @ strain @ by.T
        used = np.flatnonzero(own.any(axis=0))
        if len(used):
            own = own[np.ix_(used, used)]
            return with_effects(given, system.by_columns[:, used], system.shifts[:, used], own)
    return given


def _considered(design: Design, effects: Effects, variances: FloatArray, adjusted: Adjustment) -> FloatArray:
    """The variances (parts,) of effects that were not taken and may exist, beside those taken (parts,).

    Such are fields that the data do not exclude, and changes of the shape of a ball that is taken as rigid.
    """
    more, gain = np.zeros_like(variances), 0.0
    if not (variances[design.kind == FIELD] > 0).any():
        more, gain = _not_excluded(design, effects, variances, adjusted)
    if design.bending is None or gain > LEAST_EVIDENCE:  # either may be the cause
        return more
    is_bent = design.kind == BENDING
    alone = others_eliminated(effects, variances + more, is_bent)
    squared = design.bending.size**2 / max(adjusted.variance, LEAST_VARIANCE)
    tried = [(solved(alone, np.array([squared * size**2])).deviance, size) for size in (0.0, *BENT)]
    least, size = min(tried)
    return more + is_bent * squared * size**2 * (tried[0][0] - least > MORE_THAN_NOISE)


def _with_considered(effects: Effects, variances: FloatArray, considered: FloatArray) -> FloatArray:
    """Cofactors (m,m) of effects of variances (parts,) and of others that all else takes up, as nobody estimates them.

    Consider covariance (S. Schmidt, 1966).
    """
    own, taken_up = effect_cofactors(effects, variances), considered[effects.part] > 0
    by = own @ effects.matrix[:, taken_up]
    by[taken_up] = -np.eye(int(taken_up.sum()))
    return own + by * considered[effects.part[taken_up]] @ by.T


def _not_excluded(
    design: Design, effects: Effects, variances: FloatArray, adjusted: Adjustment
) -> tuple[FloatArray, float]:
    """The variances (parts,) of fields of the largest amplitude that the data hardly speak against; what these gain.

    Long lenses whose balls covered 23 % of the images (seed 1093) had fields of 0.03 px, which lowered -2 log of the
    likelihood by 23: a camera was 3.9 times its U off. What gains more than fields that are taken, and was not taken,
    is something else: a ball that bends by 0.02 mm, 159.
    """
    squared = (design.kind == FIELD) / max(adjusted.variance, LEAST_VARIANCE)
    px, before, least = 0.0, 0.0, np.inf
    for next_px in (0.0, *NOT_EXCLUDED_PX):
        now = solved(effects, variances + squared * next_px**2).deviance
        if now > least + NOT_EXCLUDED:  # between the two, so that alike recordings have alike uncertainties
            px += (next_px - px) * (least + NOT_EXCLUDED - before) / (now - before)
            break
        px, before, least = next_px, now, min(least, now)
    gain = solved(effects, variances).deviance - least
    return squared * px**2 * (MORE_THAN_NOISE < gain <= LEAST_EVIDENCE), gain


def first_effects(network: Network, adjusted: Adjustment) -> Corrections | None:
    """The effects that a free form asks for which has none yet; None for none."""
    if network.corrections is not None or not isinstance(network.ball, Free):
        return None  # what only the ball as one object asks for may be its own change of shape
    if not _may_have_effects(network, adjusted):
        return None
    with one_blas_thread(), suppress(np.linalg.LinAlgError):  # a network that hardly hangs together has no effects
        system = inverted(adjusted.problem, adjusted.state, None)
        if system is None:
            return None
        large = (LARGE / np.median(adjusted.problem.weight)) ** 2
        for share in (LEAST_SHARE, FINE_SHARE):
            design = design_of(network, adjusted, share)
            effects = effects_of(network, adjusted, design, system, None).quadratic
            found = chosen(design, effects, _first_variances(design, adjusted))
            if found is None or not (found.variances[design.kind == FIELD] > large).any():
                break
        if found is None or _predicts(network, adjusted, found):
            return found
        return chosen(design, effects, _first_variances(design, adjusted), frozenset({MOTION}))
    return None


def _estimated(
    network: Network, adjusted: Adjustment, places: Places | None, before: Corrections, limit: FloatArray | None
) -> Corrections:
    with one_blas_thread(), suppress(np.linalg.LinAlgError):
        system = inverted(adjusted.problem, adjusted.state, places)
        if system is None:
            return before
        effects = effects_of(network, adjusted, before.design, system, before.applied).quadratic
        found = estimated(effects, before.variances, limit)
        return replace(before, **vars(found), redundancy=effects.redundancy)
    return before


def chosen(
    design: Design, effects: Effects, first: FloatArray, kinds: frozenset[int] | None = None
) -> Corrections | None:
    """The effects that the data ask for beside the others, taken one kind after the other; None for none.

    `first` (parts,): variances to begin with, over sigma0 squared; `kinds`: those that may be taken, None for all.
    """

    def of(kinds: frozenset[int]) -> Estimate:
        return estimated(effects, np.where(np.isin(design.kind, list(kinds)), first, 0.0))

    taken: frozenset[int] = frozenset()
    tried = {taken: of(taken)}
    every = frozenset(design.kind.tolist()) if kinds is None else kinds
    while taken != every:
        for kind in every - taken:
            tried[taken | {kind}] = of(taken | {kind})
        best = min((taken | {kind} for kind in sorted(every - taken)), key=lambda kinds: tried[kinds].deviance)
        if tried[taken].deviance - tried[best].deviance <= LEAST_EVIDENCE:
            break
        taken = best
    evidence: dict[int, float] = {}
    for kind in sorted(taken):  # one that came later may explain all that an earlier one did
        less = taken - {kind}
        tried[less] = tried[less] if less in tried else of(less)
        evidence[kind] = tried[less].deviance - tried[taken].deviance
        if evidence[kind] <= LEAST_EVIDENCE:
            taken = less
    found = tried[taken]
    if not taken:
        return None
    kept = {kind: size for kind, size in evidence.items() if kind in taken}
    return Corrections(**vars(found), design=design, evidence=kept, redundancy=effects.redundancy)


def _predicts(network: Network, adjusted: Adjustment, found: Corrections) -> bool:
    """Whether fields that one half of the placements shows fit the other half better than none do, both ways together.

    What the errors of neighbouring points have in common looks like a field in the placements that it is estimated
    from: on dome15 the likelihood gained 260, and placements held out had residuals of 0.513 px instead of 0.504. A
    field that gains much for each of its numbers needs no such proof.
    """
    design = found.design
    worth = float(found.freedom[design.kind == FIELD].sum())
    if found.evidence.get(FIELD, np.inf) > CLEAR * worth:  # or it has no fields
        return True
    fields = design.kind[design.part] == FIELD
    one, other = (_half(network, adjusted, design, number) for number in (0, 1))
    if one is None or other is None:
        return True  # too little is left of a half to say
    turning = np.where(design.kind == MOTION, found.variances, 0.0)
    gain = 0.0
    for of, by in ((one, other), (other, one)):
        learnt = np.where(fields, solved(by, found.variances).coefficients, 0.0)
        gain += least_cost(of, turning, np.zeros_like(learnt)) - least_cost(of, turning, learnt)
    return gain > 0.0


def _half(network: Network, adjusted: Adjustment, design: Design, number: int) -> Effects | None:
    """The effects by every other placement alone, at the same state; None where that says too little."""
    problem, of_row = adjusted.problem, network.placement[adjusted.rows]
    seen = np.unique(of_row)
    mine = np.isin(of_row, seen[number::2])
    mine &= (np.bincount(problem.point[mine], minlength=problem.n_points) >= 2)[problem.point]
    if not mine.any():
        return None
    half = problem.select(mine)
    looking = np.bincount(half.camera, minlength=half.n_cameras) > 0
    half = replace(half, free_pose=half.free_pose & looking, free_intrinsics=half.free_intrinsics & looking[:, None])
    system = inverted(half, adjusted.state, None)
    if system is None:
        return None
    own = replace(adjusted, problem=half, rows=adjusted.rows[mine])
    return effects_of(network, own, design, system, None).quadratic


def _first_variances(design: Design, adjusted: Adjustment) -> FloatArray:
    turns = FIRST_PX / adjusted.state.intrinsics[:, 0]
    first = np.concatenate([np.full(len(design.fields), FIRST_PX), turns])
    return first**2 / max(adjusted.variance, LEAST_VARIANCE)
