"""A calibration on a ball profile: whether the recorded ball is that one, the solution, and the findings."""

import numpy as np

from spherecal.ball.ball_shape import KnownDots
from spherecal.ball.calibration_run import Run
from spherecal.ball.fit import BallFit, with_effects_unknown
from spherecal.ball.rigid import BallNetwork
from spherecal.ball.selection import ModelChoice
from spherecal.ball.stored_shape import solve_on_ball
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.recording import Recording
from spherecal.data.rig import BallProfile
from spherecal.data.session import Session
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
    number, shape = {name: i for i, name in enumerate(recording.observations.points)}, profile.shape
    point = np.array([number.get(name, -1) for name in shape.point], dtype=np.int64)
    keep = point >= 0
    dots = KnownDots(shape.target[keep], point[keep], shape.places_mm[keep], shape.covariance_mm2[keep])
    found = solve_on_ball(free, ball, dots, run)
    called = _profile_phrase(profile)
    if found.solved is None:
        return Finding("ball-profile-refused", "warning", {"profile": called, "reason": found.reason})
    solved = with_effects_unknown(found.solved)
    solution, longer = by_stored_ball(recording, solved, profile.shape.scale)
    reason = Phrase("form-profile", {"profile": called, "fit": found.reason})
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
