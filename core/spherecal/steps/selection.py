"""The forms of the network, `free`, `soft` and `rigid`, and which of them the data support.

Free: every dot at every placement is a point of its own [Tao21]. Rigid: the ball is one object. Soft: it is, but its
dots have some shape noise from placement to placement. See docs/formulation.md, The rigid ball, and
docs/decisions/0006-rigid-ball.md, 0012-soft-ball.md.
"""

from dataclasses import replace

import numpy as np

from spherecal.adjust.bundle import Adjustment, refine, robust_start
from spherecal.adjust.corrections import corrected
from spherecal.adjust.intrinsic_priors import LEAST_NOISE
from spherecal.adjust.network import Network
from spherecal.adjust.state import State
from spherecal.ball.fit import (
    BallFit,
    Run,
    adjusted_with,
    estimate_shape_variance,
    rigid_solution,
    solve_free,
    solve_from,
    solve_with_priors,
    without_priors,
)
from spherecal.ball.image_poses import link_camera_groups
from spherecal.ball.rigid import (
    LEAST_SHARED,
    NOTICEABLE,
    Alignment,
    BallNetwork,
    ModelChoice,
    RigidNetwork,
    agreement,
    share_shape,
)
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError, PartialResultAccepted
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.session import Recording
from spherecal.diagnose.anomalies import explained_by_moves
from spherecal.diagnose.ball_changes import sizes_to_fit
from spherecal.initialise.incremental import InitialPoses, grow, resect_camera
from spherecal.initialise.local import LocalNetwork, reconstruct_locally
from spherecal.scale.metric import MetricFit, in_millimetres, metric_solution
from spherecal.scale.stored_ball import on_known_ball
from spherecal.steps.ball_stages import StartValues
from spherecal.steps.settings import CalibrationSettings, Method

# A ball that changed its shape by 0.05 mm rms between placements (turned) or 0.017 mm (only moved) makes the rigid form
# as bad as the free one; the variance of unit weight is then 1.45 and 1.12 times the free form's.
MOST_WORSE_TURNED, MOST_WORSE_MOVED = 1.15, 1.05
# A ball that bends a little (smoothly, by 0.02, 0.05, 0.1 mm rms on 500 mm; the shape noise found is 0.3e-4, 0.8e-4,
# 1.7e-4 of its radius). Turned, the soft form gave 26, 45, 71 um where free points gave 53, 51, 53 (rig A), and 14, 25,
# 41 where they gave 53, 70, 57 (rig B); the limit lies where it is no worse on either. Only moved: 21, 35, 62 against
# 39, 43, 48 (rig A; ratios 1.2, 2.3, 6), 48, 76, 102 against 45, 46, 48 (rig B; 2.4, 9, 32): studies/shape.md.
MOST_SHAPE_SD, MOST_WORSE_SOFT, MOST_WORSE_SOFT_MOVED = 1.2e-4, 30.0, 1.5
# Up to this ratio lenses that the model does not follow explain it, where cameras do not agree on how dots moved: 1.08
# to 1.59 in realistic recordings, in which the rigid form's lengths were 2 to 24 times better than the free one's.
MOST_WORSE_BY_LENSES = 2.0
# Three cameras alone leave a redundancy of some 200 a group, so that the free form's variance is unsure by a tenth (one
# of 48 linked recordings was at 1.25): groups are linked while the ratio is within three standard deviations of that.
SURE = 3.0
# Sizes of the ball at its placements are found to first order: twice for those of 0.1 %.
SIZE_ROUNDS = 2
# Below this turn the placements are as good as only moved.
TURNED_DEG = 15.0


def ball_network(recording: Recording, network: Network, local: LocalNetwork, free: BallFit) -> BallNetwork:
    """The dots of the ball in the free network; no two-view gate judges a camera that is alone."""
    candidates = local.keep | ~free.placed[network.camera]
    return BallNetwork(network, recording.features, recording.n_placements, recording.n_ball, candidates)


def fit_ball_model(
    recording: Recording, start: StartValues, free: BallFit, settings: CalibrationSettings, run: Run
) -> MetricFit:
    """The network in millimetres, in the ball model that the data support (decision 0006); free if the user stops."""
    ball = ball_network(recording, start.network, start.local, free)
    try:
        fit = _in_its_model(recording, free, ball, settings, run.accepting_partial())
    except PartialResultAccepted:
        if run.context.has_partial_result:  # the caller's result is further on
            raise
        solved, solution = in_millimetres(recording, free, run)
        fit = MetricFit(solved, ModelChoice("free", Phrase("form-stopped")), solution, stopped=True)
    # the cameras that it or the free form left out because two poses fit them equally well
    left_out = [form.ambiguous for form in (free, fit.solved) if form.ambiguous is not None]
    ambiguous = np.any(left_out, axis=0) if left_out else None
    return replace(fit, solved=replace(fit.solved, ambiguous=ambiguous))


def _in_its_model(
    recording: Recording, free: BallFit, ball: BallNetwork, settings: CalibrationSettings, run: Run
) -> MetricFit:
    """The network in millimetres: on a stored ball, as rigid as the data allow, or free; with its findings."""
    refused: tuple[Finding, ...] = ()
    if settings.ball is not None:
        stored = on_known_ball(recording, free, ball, settings.ball, run)
        run.watch.lap("known ball")
        if isinstance(stored, MetricFit):
            return stored
        refused = (stored,)
    fit, choice = free, ModelChoice("free", Phrase("form-asked-alone"))
    if settings.method in ("auto", "soft", "rigid"):
        fit, choice = select_ball_model(recording, free, ball, settings, run)
        run.watch.lap("rigid ball")
    fit, solution = in_millimetres(recording, fit, run)
    return MetricFit(fit, choice, solution, refused)


Chosen = tuple[BallFit, ModelChoice]


def select_ball_model(
    recording: Recording, free: BallFit, ball: BallNetwork, settings: CalibrationSettings, run: Run
) -> Chosen:
    """The rigid form if the data support it, else the soft or the free one; and the choice with its reasons."""
    fit, choice = _chosen(recording, free, ball, settings, run)
    if settings.method not in ("auto", choice.form):
        raise InputError(Phrase("error-form-not-possible", {"form": settings.method, "why": choice.reason}))
    return fit, choice


def _chosen(recording: Recording, free: BallFit, ball: BallNetwork, settings: CalibrationSettings, run: Run) -> Chosen:
    """The form, or that which is asked for as far as there is one.

    Where motions of cameras or of the ball explain what the rigid form does not, it is kept (decisions 0006, 0009,
    0012).
    """
    run.context.report("rigid ball", 0.0)
    alignment = ball.aligned(free.adjusted.state.points)
    if not free.placed.all():
        groups = [free, *_solve_others(recording, ball.network, free.placed, settings, run)]
        linked = _linked(groups, ball, alignment, settings.method, run)
        if linked is not None:
            return _with_more_cameras(*_with_more_placements(*linked, ball, run), ball, run)
    if not alignment.moved.any():
        return free, ModelChoice("free", _nothing_shared(alignment, ball.n_ball), alignment=alignment)
    # with the free form's weights, so that the two variances are of one unit
    again = replace(ball.network, noise=free.network.noise, priors=free.network.priors).corrected_as(free.network)
    rigid, start = share_shape(again, ball.features, free.adjusted.state, alignment)
    first = _first_rigid(rigid.network, start, free, run)
    network, first = corrected(rigid.network, first, free.placed, rigid.places, None, run.context)
    rigid = replace(rigid, network=network)
    sizes = None
    if settings.intrinsics != "fixed":  # a focal length that is wrong looks like other sizes
        first, sizes = _of_several_sizes(recording, rigid, first, free, run)
    choice = replace(_judged(first, [free], alignment, settings.method, rigid.feature), sizes=sizes)
    # asked before the soft form, which takes as long as all else of a camera that moved
    if choice.refused and choice.limit is not None and _is_moved(free, ball, choice.limit, run):
        if not free.placed.all():  # it may link more cameras
            fit, choice = _chosen(recording, free, ball, replace(settings, method="rigid"), run)
            return fit, _kept(choice)
        choice = _kept(replace(choice, form="rigid"))
    if choice.form == "soft":
        unit_mm = metric_solution(recording, free).factor
        soft = _soft_solution(rigid, first, free, choice, settings.shape_sd_mm, unit_mm, run)
        if soft is not None:
            return soft
        choice = replace(choice, form="free")
    if choice.form == "free":
        return free, choice
    fit = rigid_solution(without_priors(rigid), first, free.placed, run, rigid.network.priors)
    return _with_more_cameras(*_with_more_placements(fit, choice, ball, run), ball, run)


def _kept(choice: ModelChoice) -> ModelChoice:
    return replace(choice, reason=Phrase("form-kept", {"facts": choice.facts}), asked=False)


def _is_moved(free: BallFit, ball: BallNetwork, limit: float, run: Run) -> bool:
    """Whether motions of cameras or of the ball leave no more than so many times the free form's variance."""
    weighted = replace(ball.network, noise=free.network.noise).corrected_as(free.network)
    most = limit * free.adjusted.variance
    found = explained_by_moves(replace(ball, network=weighted), free, run.context, most)
    return bool(found.moves) or found.group_motion is not None


def _first_rigid(network: Network, start: State, free: BallFit, run: Run) -> Adjustment:
    """The rigid form from the state of the free one's cameras, through robust adjustments if that one is distorted.

    Free points hide that a camera moved which alone holds two halves of a rig together. The halves then are turned
    against each other, and plain least squares never found back (0.5 mm on rig B ended at 8 px instead of 0.04).
    """
    used, placed = free.adjusted.used, free.placed
    first = refine(network, start, used, placed, run.context)
    if first.minimum.converged and first.variance <= MOST_WORSE_SOFT * free.adjusted.variance:
        return first
    state, kept = robust_start(network, start, used, placed, run.context)
    again = refine(network, state, kept, placed, run.context)
    return again if again.variance < first.variance else first


def _of_several_sizes(
    recording: Recording, rigid: RigidNetwork, first: Adjustment, free: BallFit, run: Run
) -> tuple[Adjustment, FloatArray | None]:
    """The rigid form with a size of the ball for each placement, and these sizes, if they explain its misfit."""
    total: FloatArray | None = None
    root, moved = rigid.alignment.root, rigid.alignment.moved
    for _ in range(SIZE_ROUNDS):
        free_variance = free.adjusted.variance if total is None else None  # of sizes that are fitted, what they lack
        sizes = sizes_to_fit(rigid, first, recording.observations.placement, recording.n_ball, free_variance)
        if sizes is None:
            break
        every = np.zeros(len(root))
        every[: len(sizes)] = sizes
        times = np.concatenate([[1.0], (1 + every[moved]) / (1 + every[root[moved]])])
        start = replace(first.state, placement_rotation=first.state.placement_rotation * times[:, None, None])
        again = refine(rigid.network, start, free.adjusted.used, free.placed, run.context)
        if not again.variance < first.variance:
            break
        first, total = again, sizes if total is None else total + sizes
    return first, total


def _linked(
    groups: list[BallFit], ball: BallNetwork, alignment: Alignment, requested: Method, run: Run
) -> tuple[BallFit, ModelChoice] | None:
    """The rigid form of more cameras than the first group has; None where the ball's shape links no more."""
    every = [InitialPoses(one.adjusted.state, one.placed) for one in groups]
    linked, together = link_camera_groups(ball, every, alignment, run.context)
    if linked.placed.sum() == groups[0].placed.sum():
        return None
    rigid, state = share_shape(ball.network, ball.features, linked.state, together)
    fit = _rigid_from(rigid, InitialPoses(state, linked.placed), ball.candidates, run)
    choice = _judged(fit.adjusted, groups, together, requested, rigid.feature)
    return (fit, choice) if choice.form == "rigid" else None


def _rigid_from(rigid: RigidNetwork, start: InitialPoses, candidates: BoolArray, run: Run) -> BallFit:
    """The rigid form from cameras that are only roughly in place."""
    everything = candidates & start.placed[rigid.network.camera]

    def solution(described: Network) -> BallFit:
        return solve_from(described, start, everything, run, rigid)

    return solve_with_priors(rigid.network, everything, start.placed, solution, run)


def _with_more_placements(fit: BallFit, choice: ModelChoice, ball: BallNetwork, run: Run) -> Chosen:
    """The rigid form, repeated while the dots that it located connect more placements.

    Where two sides see the ball, each ties other placements to it; only both together tie all. Of two times three
    cameras, a third of the observations stayed unused and bars were 2 to 4 times worse.
    """
    while fit.rigid is not None:
        known, before = fit.by_features.state, fit.rigid.alignment
        alignment = ball.aligned(known.points)
        if alignment.moved.sum() <= before.moved.sum():
            break
        again = replace(ball.network, noise=fit.network.noise).corrected_as(fit.network)
        rigid, start = share_shape(again, ball.features, known, alignment)
        fit = _rigid_from(rigid, InitialPoses(start, fit.placed), ball.candidates, run)
        choice = replace(choice, alignment=alignment, sizes=None)
    return fit, choice


def _with_more_cameras(fit: BallFit, choice: ModelChoice, ball: BallNetwork, run: Run) -> tuple[BallFit, ModelChoice]:
    """The rigid form with cameras that share too few dots with others at one placement, resected from all of the ball.

    A camera that saw 8 to 20 dots in six placements shared 5 at most: the rig of ten was refused for it.
    """
    state, missing = fit.adjusted.state, ~fit.placed
    if fit.rigid is None or not missing.any():
        return fit, choice
    if fit.ambiguous is not None:
        missing &= ~fit.ambiguous
    known = ball.candidates & np.isfinite(state.points[fit.network.feature, 0])
    rotation, translation, placed = state.rotation.copy(), state.translation.copy(), fit.placed.copy()
    for c in np.flatnonzero(missing).tolist():
        pose = resect_camera(fit.network, state, c, np.flatnonzero(known & (fit.network.camera == c)))
        if pose is not None:
            (rotation[c], translation[c]), placed[c] = pose, True
    if not (placed & missing).any():
        return fit, choice
    start = InitialPoses(replace(state, rotation=rotation, translation=translation), placed)
    rigid = without_priors(replace(fit.rigid, network=fit.network))
    return _rigid_from(rigid, start, ball.candidates, run), choice


def _soft_solution(
    rigid: RigidNetwork,
    first: Adjustment,
    free: BallFit,
    choice: ModelChoice,
    stated_mm: float | None,
    unit_mm: float,
    run: Run,
) -> Chosen | None:
    """The soft form of the cameras that the free one places, with its shape noise; None where that would do harm."""
    noise = max(float(np.sqrt(free.adjusted.variance)), LEAST_NOISE)
    if stated_mm is None:
        shape_sd, start = estimate_shape_variance(rigid, first, free, noise**2, run.context)
    else:
        shape_sd = stated_mm / unit_mm / noise
        start = adjusted_with(rigid, first, free, shape_sd)
    points = start.state.points[np.unique(start.problem.point)]
    radius = float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))  # of the ball, rms of its dots
    if choice.limit is not None and not choice.asked and shape_sd * noise > MOST_SHAPE_SD * radius:
        return None
    fit = rigid_solution(without_priors(rigid).softened(shape_sd), start, free.placed, run)
    sd_mm = shape_sd * noise * unit_mm
    source = Phrase("play-estimated" if stated_mm is None else "play-stated")
    reason = Phrase("form-play", {"reason": choice.reason, "sd_mm": sd_mm, "source": source})
    return replace(fit, free=free), replace(choice, reason=reason, shape_sd_mm=sd_mm, stated=stated_mm is not None)


def _judged(
    rigid: Adjustment, free: list[BallFit], alignment: Alignment, requested: Method, feature: IntArray
) -> ModelChoice:
    """The free form of several groups of cameras together, for comparison; feature (n,) of the observations."""
    redundancy = sum(group.adjusted.redundancy for group in free)
    variance = sum(2 * group.adjusted.minimum.cost for group in free) / redundancy if redundancy > 0 else float("nan")
    ratio = (rigid.variance + LEAST_NOISE**2) / (variance + LEAST_NOISE**2)
    turned = float(np.median(alignment.turned_deg))
    limit = MOST_WORSE_TURNED if turned >= TURNED_DEG else MOST_WORSE_MOVED
    if len(free) > 1:
        limit = round(limit * (1 + SURE * np.sqrt(2 / max(redundancy, 1))), 2)
    moved = Phrase("ball-turned", {"degrees": turned}) if turned >= TURNED_DEG else Phrase("ball-hardly-turned")
    shared = int(alignment.shared.max(axis=1)[alignment.moved].min())
    facts = Phrase("form-facts", {"moved": moved, "shared": shared, "ratio": ratio, "limit": limit})
    agreed = None
    if min(NOTICEABLE, limit) < ratio < np.inf:
        agreed = agreement(rigid, feature, rigid.variance / ratio)
    choice = ModelChoice("rigid", facts, ratio, limit, alignment, facts=facts, agreement=agreed)
    if requested in ("rigid", "soft"):
        return replace(choice, form=requested, reason=Phrase("form-asked", {"facts": facts}), asked=True)
    if ratio <= limit:
        return choice
    if not choice.ball_changed and ratio <= MOST_WORSE_BY_LENSES:
        return replace(choice, reason=Phrase("form-not-the-ball", {"facts": facts}))
    soft = ratio <= (MOST_WORSE_SOFT if turned >= TURNED_DEG else MOST_WORSE_SOFT_MOVED)
    return replace(choice, form="soft" if soft else "free", reason=Phrase("form-changed", {"facts": facts}))


def _nothing_shared(alignment: Alignment, n_ball: int) -> Phrase:
    if n_ball < 2:
        return Phrase("form-one-placement")
    most = int(alignment.shared.max(initial=0))
    if most == 0:
        return Phrase("form-no-dot-twice")
    return Phrase("form-little-shared", {"least": LEAST_SHARED, "most": most})


def _solve_others(
    recording: Recording, network: Network, placed: BoolArray, settings: CalibrationSettings, run: Run
) -> list[BallFit]:
    """The free form of each group of cameras that has no common view with those placed, each in its own frame."""
    groups: list[BallFit] = []
    rest = ~placed
    observations, features = recording.observations, recording.features
    while rest.sum() >= 3:
        rows = np.flatnonzero(rest[observations.camera])
        own = observations.select(rows)
        own_features = replace(features, of_observation=features.of_observation[rows])
        local = reconstruct_locally(own, own_features, run.known, settings.seed, run.context)
        if not local.triples:
            break
        part = network.only(rows)
        start = grow(local, part, run.known, local.keep, run.context)
        candidates = local.keep & start.placed[part.camera]
        first, *others = local.graph.references
        alone = replace(run, reference=first, next_references=tuple(others))
        groups.append(solve_free(part, start, candidates, alone))
        rest &= ~start.placed
    return groups
