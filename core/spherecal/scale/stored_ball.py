"""A calibration on a ball profile: whether the recorded ball is that one, the solution, and the findings."""

from dataclasses import replace

import numpy as np

from spherecal.adjust.bundle import Adjustment, refine
from spherecal.adjust.intrinsic_priors import LEAST_NOISE
from spherecal.ball.ball_shape import Anchored, anchored
from spherecal.ball.fit import BallFit, Run, rigid_solution, with_effects_unknown, without_priors
from spherecal.ball.rigid import LEAST_SHARED, BallNetwork, ModelChoice
from spherecal.base.arrays import BoolArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.rig import BallProfile, BallShape
from spherecal.data.session import Recording, Session
from spherecal.initialise.incremental import InitialPoses, resect_rest
from spherecal.scale.metric import MetricFit, Solution, by_stored_ball

# Scales that differ by more standard uncertainties than this contradict each other; a print beside a bar may be off by
# its own error, which its uncertainty does not tell (0.1 to 0.5 % are common).
MOST_DEVIATIONS, PRINT_ERROR = 3.0, 0.005


def on_known_ball(
    recording: Recording, free: BallFit, ball: BallNetwork, profile: BallProfile, run: Run
) -> MetricFit | Finding:
    """The solution on the profile where the recorded ball is the profile's; else the finding that says why not."""
    session = recording.session
    _check_targets(profile, session)
    solved, why = solve_on_ball(free, ball, profile.shape, recording.observations.points, run)
    called = _profile_phrase(profile)
    if solved is None:
        return Finding("ball-profile-refused", "warning", {"profile": called, "reason": why})
    solved = with_effects_unknown(solved)
    solution, longer = by_stored_ball(recording, solved, profile.shape.scale)
    reason = Phrase("form-profile", {"profile": called, "fit": why})
    said = _scale_conflict(profile, solution, longer, session)
    return MetricFit(solved, ModelChoice("rigid", reason), solution, tuple(said))


def _check_targets(profile: BallProfile, session: Session) -> None:
    """Compare a profile's targets with the session's; a figure that either does not know is not compared."""
    targets, family, size = session.target_set, profile.family, profile.target_size_mm
    if targets is None or family is None or size is None:
        return
    if targets.family != family or not np.isclose(targets.size_mm, size, rtol=1e-6):
        own = {"where": session.folder, "family": family, "size": size}
        raise InputError(Phrase("error-other-targets", {**own, "other": targets.family, "other_size": targets.size_mm}))


def _profile_phrase(profile: BallProfile) -> Phrase:
    name = {"name": profile.name}
    if profile.calibrated is None:
        return Phrase("profile-named", name) if profile.name else Phrase("profile")
    date = {"date": profile.calibrated.isoformat()}
    return Phrase("profile-named-dated", name | date) if profile.name else Phrase("profile-dated", date)


def _scale_conflict(profile: BallProfile, solution: Solution, longer: float | None, session: Session) -> list[Finding]:
    """The finding where the session's own scale and the profile's contradict each other."""
    own, stored = session.scale, profile.shape.scale
    if longer is None or own is None or stored.relative_uncertainty is None:
        return []
    other = solution.scale.relative_uncertainty if solution.scale.source != "ball" else 0.0
    allowed = MOST_DEVIATIONS * float(np.hypot(stored.relative_uncertainty, other or 0.0))
    if (own.kind == "bar") != (stored.source == "bar") or own.kind != "bar":
        allowed += PRINT_ERROR
    if abs(longer) <= allowed:
        return []
    return [Finding("ball-profile-scale", "warning", {"longer_ppm": longer * 1e6, "allowed_ppm": allowed * 1e6})]


# --- a calibration from a ball whose shape is already known (a ball profile) -----------------------------------------
#
# The stored dots are observations of the shape, each with its covariance; so the shape need not be found again, and
# fewer placements suffice. A test detects another ball, or one that has changed; its profile is then not used. See
# docs/decisions/0013-stored-shapes.md.

# What a profile adds to v'Pv over what it adds to the redundancy, in variances: 0.95 for the same ball (rig A, one
# recording each), 1.3 for one that changed by 0.02 mm rms, 3.4 for 0.05 mm.
MOST_MISFIT = 1.25


def solve_on_ball(
    free: BallFit, ball: BallNetwork, shape: BallShape, names: tuple[str, ...], run: Run
) -> tuple[BallFit | None, Phrase]:
    """The solution in the profile's millimetres, None on another ball; and why it was used or not, for a finding."""
    run.context.report("known ball", 0.0)
    described = replace(ball.network, noise=free.network.noise, priors=free.network.priors)
    variance = max(free.adjusted.variance, LEAST_NOISE**2)
    there = anchored(replace(ball, network=described), free.adjusted.state, shape, names, variance)
    if there is None:
        features, targets = ball.features, shape.target[np.isin(shape.point, names)]
        known = np.isin(features.target, targets) & (features.placement < ball.n_ball)
        most = int(np.bincount(features.placement[known], minlength=1).max())
        return None, Phrase("profile-other-ball", {"least": LEAST_SHARED, "most": most})
    first = refine(there.rigid.network, there.start, free.adjusted.used, free.placed, run.context)
    # the share of the stored shape, and of observations that need it, in v'Pv over their share of redundancy
    added, more = first.redundancy - free.adjusted.redundancy, first.minimum.cost - free.adjusted.minimum.cost
    misfit = 2 * more / added / variance if added > 0 and free.adjusted.variance > 0 else np.inf
    dots = round(float(there.common[there.matched].mean()))  # of each placement, known to the profile
    counts = {"placements": there.matched.sum(), "dots": dots}
    why = Phrase("profile-fits", {**counts, "ratio": misfit, "limit": MOST_MISFIT})
    if misfit > MOST_MISFIT or not np.isfinite(misfit):
        return None, Phrase("profile-changed", {"fit": why})
    first, placed = _with_the_rest(there, first, free.placed, ball.candidates, run)
    fit = rigid_solution(without_priors(there.rigid), first, placed, run)
    return replace(fit, free=free), why


def _with_the_rest(
    there: Anchored, first: Adjustment, placed: BoolArray, candidates: BoolArray, run: Run
) -> tuple[Adjustment, BoolArray]:
    """The adjustment with cameras that the free form did not link, but that see the known ball."""
    network = there.rigid.network
    resected = resect_rest(network, InitialPoses(first.state, placed), candidates, run.context)
    if resected.placed.sum() == placed.sum():
        return first, placed
    used = first.used | (candidates & (resected.placed & ~placed)[network.camera])
    return refine(network, resected.state, used, resected.placed, run.context), resected.placed
