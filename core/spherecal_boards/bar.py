"""The 1-D method: a bar with two or more marks waved through the volume in many frames.

Pairs of cameras are solved from the marks they share and chained by shortest paths. Then everything is adjusted
together with the bar's lengths as rows; the cameras' intrinsics are known or free. After Deng et al. and Sun et al.,
with whose methods [Tao21] compares.
"""

from dataclasses import replace

import numpy as np
from scipy.stats import rankdata

from spherecal.adjust.bundle import usable_features
from spherecal.adjust.network import free_network
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context, Stopwatch
from spherecal.data.findings import Finding
from spherecal.data.lens_model import estimated_intrinsics
from spherecal.data.observations import find_features
from spherecal.data.rig import Calibration, RigScale
from spherecal.data.session import Placement, Recording, Session
from spherecal.detect.session_images import observed
from spherecal.diagnose.plausibility import image_settings, implausible
from spherecal.result.build_result import unsolved
from spherecal.steps.settings import CalibrationSettings
from spherecal_boards.bar_adjustment import BarAdjusted, BarNetwork, adjust_bar, chain_pairs, located, residuals_px
from spherecal_boards.bar_marks import BarRecording, bar_recording, known_lengths, scale_bar, standard_uncertainty
from spherecal_boards.bar_start import LEAST_COMMON, BarStart, lags_of, start_from_pairs
from spherecal_boards.board_findings import Fit, assemble_fit, common_findings, diagnosed, scale_finding, unlinked
from spherecal_boards.camera_lag import flipped_back, in_step, lag_findings
from spherecal_boards.frames_evidence import frame_evidence, frame_test

# Ranks of lengths before and after differ by so many standard deviations, and their medians by so many times what the
# lengths scatter. Of 70 recordings on two rigs A and two B, marks loose by 0.06 to 1 mm had 9 to 13, and 4.6 to 26
# times (one of 1 mm was left out as wrong instead, and the rig not valid), those loose by 0.03 mm 2.5 to 4.9 times;
# clean ones, moves, drift, drops on lenses, skew and focus at most 8.6, and 1.4 times. A bar that a hand warms changes
# slowly: by 500 ppm, lengths were 3.5 U off where the scale did not hold that.
LEAST_RANKS, LEAST_STEP = 6.0, 3.0
# A loose mark of 0.5 mm on 300 left lengths 4.5 U off. Below this share the scale's uncertainty holds the change.
MOST_STEP = 1e-3
# A step has so many lengths, and this share of all, on either side.
LEAST_LENGTHS, LEAST_SHARE = 8, 0.05


def bar_step(work: BarNetwork, adjusted: BarAdjusted) -> tuple[Finding, float] | None:
    """The finding on the clearest change of a length during the recording, and the change over the length."""
    network, recording = work.network, work.recording
    lengths = known_lengths(work.session, recording, np.ones(recording.n_points, dtype=bool))
    points, good = usable_features(network, adjusted.state, adjusted.used)  # not held by the certificates
    seen = replace(adjusted.state, points=np.where(good[:, None], points, np.nan))
    # marks that were left out, since with them the bar is too long, where cameras agree: of rig B's, that two or three
    # see, hardly any was left after one was loose by 1 mm
    seen = located(network, seen, work.placed, adjusted.used)
    off = np.linalg.norm(replace(adjusted.model, lengths=lengths).differences(seen), axis=1) - lengths.length
    steps = []
    for number in np.unique(lengths.certificate):
        own = np.flatnonzero((lengths.certificate == number) & np.isfinite(off))
        if (step := _clearest(off[own])) is not None:
            steps.append((step[2], step[1], int(own[step[0]])))
    if not steps:
        return None
    times, change, row = max(steps, key=lambda step: step[0])
    relative = abs(change) / float(lengths.length[row])
    if times < LEAST_STEP:
        values = {"worst_mm": 2 * change, "times": times}  # from end to end, where halves differ by half of it
        return Finding("bar-poses-disagree", "info", values, (recording.bar.id,), kind="slowly"), 2 * relative
    pose = recording.observations.placements[int(recording.pose[lengths.frame[row]])]
    severity, values = "error" if relative > MOST_STEP else "warning", {"worst_mm": change, "times": times}
    where = (recording.bar.id, pose)
    return Finding("bar-poses-disagree", severity, {"place": pose, **values}, where, kind="from-a-frame"), relative


def _clearest(off: FloatArray) -> tuple[int, float, float] | None:
    """Where lengths (n,) in order of time change most, by how much and how clearly (by ranks: far frames scatter)."""
    n, least = len(off), max(LEAST_LENGTHS, round(LEAST_SHARE * len(off)))
    if n < 2 * least:
        return None
    first = np.arange(least, n - least + 1)
    before = np.cumsum(rankdata(off))[first - 1]
    ranks = np.abs(before - first * (n + 1) / 2) / np.sqrt(first * (n - first) * (n + 1) / 12)
    at = int(first[np.argmax(ranks)])
    one, change = float(np.median(off[:at])), float(np.median(off[at:]) - np.median(off[:at]))
    scatter = 1.4826 * float(np.median(np.abs(off - one - np.where(np.arange(n) < at, 0.0, change))))
    if ranks.max() < LEAST_RANKS:
        return None
    return at, change, abs(change) / max(scatter, 1e-9)


METHOD = "bar"
# With fewer frames in which both ends were measured the scale and the focal lengths hang on single images.
FEW_FRAMES = 50
# Steadier bars than this are what they should be: of 1 mm in 300 the mean is no longer certified.
MOST_SCATTER = 1e-3
# A camera that moves is told by stretches of frames: few enough to be fast, short enough to say when.
STRETCHES, LEAST_FRAMES = 24, 8


def calibrate_bar(
    session: Session, settings: CalibrationSettings | None = None, context: Context | None = None
) -> Calibration:
    """The rig by the poses of the scale's bar; cameras that share too few marks are left out (not valid then)."""
    settings, context, watch = settings or CalibrationSettings(), context or Context(), Stopwatch()
    bar = scale_bar(session)
    if session.observations is None:
        session = observed(session, context, bar_poses_only=True)
        watch.lap("detection")
    recording = bar_recording(session, bar)
    known = np.array([camera.prior for camera in session.cameras])
    free = estimated_intrinsics(session, settings.intrinsics == "free")
    about = [*implausible(_in_stretches(session, recording)), *image_settings(session)]
    recording, late = _in_step(session, recording, known, settings.seed)
    o = recording.observations
    names = [c.id if settings.own_intrinsics else c.intrinsics_group for c in session.cameras]
    group = np.unique(names, return_inverse=True)[1].reshape(-1)
    network = free_network(recording.point, o.camera, o.uv, recording.n_points, free, group).with_sigma(o.sigma)
    seen_twice = np.bincount(recording.point, minlength=recording.n_points) >= 2
    start = start_from_pairs(recording, known_lengths(session, recording, seen_twice), known, settings.seed, context)
    watch.lap("pairs of cameras")
    linking = [*about, *late, *unlinked(o.cameras, start.linked, start.placed, "bar", LEAST_COMMON)]
    if not start.placed.any():
        lost = Finding("nothing-reconstructed", "error", {"least": LEAST_COMMON}, kind="bar")
        return unsolved(Recording(session, o, find_features(o)), [lost, *linking], METHOD, watch.seconds)
    work = BarNetwork(session, recording, network, known, start.reference, start.placed)
    rotation = np.where(start.placed[:, None, None], start.rotation, np.eye(3))
    translation = np.where(start.placed[:, None], start.translation, 0.0)
    state = State(rotation, translation, known.copy(), np.full((recording.n_points, 3), np.nan))
    adjusted = adjust_bar(work, state, context) if settings.joint else chain_pairs(work, state, start.parents, context)
    watch.lap("joint adjustment")
    return _result(work, start, adjusted, linking, watch, context)


def _result(
    work: BarNetwork,
    start: BarStart,
    adjusted: BarAdjusted,
    findings: list[Finding],
    watch: Stopwatch,
    context: Context,
) -> Calibration:
    recording, network, session = work.recording, work.network, work.session
    o = recording.observations
    features = find_features(o)
    at = np.empty(len(features), dtype=np.int64)  # the problem's point of every feature
    at[features.of_observation] = recording.point
    cofactor = np.full((recording.n_points, 3, 3), np.nan)
    if adjusted.covariance is not None:
        cofactor[adjusted.points] = adjusted.covariance.points
    residual = residuals_px(network, adjusted.state)
    residual[~start.placed[o.camera]] = np.nan
    placed = start.placed & (np.bincount(o.camera[adjusted.used], minlength=len(start.placed)) > 0)
    points = adjusted.state.points
    whole = replace(adjusted.state, points=np.where(np.isfinite(points), points, 0.0))
    tested = frame_test(adjusted.model, whole, adjusted.minimum, adjusted.redundancy) if adjusted.joint else None
    places, lenses = (points[at], cofactor[at]), (network.free, network.group)
    fit = Fit(o, features, start.reference, placed, adjusted, *places, residual, tested, *lenses)
    scale = RigScale("none", None)
    if adjusted.covariance is not None and np.isfinite(adjusted.variance):
        noise = np.sqrt(adjusted.variance) * adjusted.covariance.relative_scale
        step, lengths = bar_step(work, adjusted), adjusted.model.lengths
        changed = 0.0 if step is None else step[1] / 2  # which of its two lengths is right is not known
        if step is not None:
            findings = [*findings, step[0]]
        elif lengths.scatter:
            severity = "warning" if lengths.scatter > MOST_SCATTER * float(lengths.length.max()) else "info"
            values, where = {"worst_mm": lengths.scatter}, (recording.bar.id,)
            findings = [*findings, Finding("bar-poses-disagree", severity, values, where, kind="at-random")]
        scale = RigScale("bar", float(np.linalg.norm([noise, _certificate(adjusted, recording), changed])))
    findings = [*findings, *common_findings(session, fit, "bar"), *_about_frames(adjusted, recording)]
    cut = _in_stretches(session, recording)
    assert cut.observations is not None
    evidence = frame_evidence(cut, replace(fit, observations=cut.observations), scale, "free", context)
    findings += diagnosed(evidence, "bar")
    watch.lap("diagnosis")
    if scale.relative_uncertainty is not None:
        findings.append(scale_finding("waved-bar", scale.relative_uncertainty))
    return assemble_fit(evidence, session, fit, scale, findings, METHOD, watch.seconds)


def _in_step(
    session: Session, recording: BarRecording, known: FloatArray, seed: int
) -> tuple[BarRecording, list[Finding]]:
    """The recording with the frames of cameras that are behind or ahead of the others put back, and what was."""
    o = recording.observations
    every = known_lengths(session, recording, np.ones(recording.n_points, dtype=bool))
    widths = np.array([camera.image_size[0] for camera in session.cameras])
    lags = lags_of(recording, every, known, widths, seed)
    if not lags:
        return recording, []
    frame, slot = np.divmod(recording.point, recording.slots)
    found = lag_findings(o, lags, tuple(o.placements[i] for i in recording.pose))
    uv = flipped_back(lags, o.camera, o.uv, widths)
    frame, keep = in_step(lags, o.camera, frame)
    o = replace(o.select(keep), placement=recording.pose[frame], uv=uv[keep])
    return replace(recording, observations=o, point=frame * recording.slots + slot[keep]), found


def _in_stretches(session: Session, recording: BarRecording) -> Session:
    """The frames as a few stretches, as placements: a single frame has too few marks to tell a camera's pose."""
    frame, slot = np.divmod(recording.point, recording.slots)
    size = max(-(-recording.n_frames // STRETCHES), LEAST_FRAMES)
    stretch, inside = np.divmod(frame, size)
    names = tuple(recording.observations.placements[i] for i in recording.pose[::size])
    o = replace(
        recording.observations,
        placements=names,
        placement=stretch,
        points=tuple(str(i) for i in range(size * recording.slots)),
        point=inside * recording.slots + slot,
    )
    return replace(session, placements=tuple(Placement(name) for name in names), bar_poses=(), observations=o)


def _certificate(adjusted: BarAdjusted, recording: BarRecording) -> float:
    """The certificates' share of the scale's relative uncertainty, which no number of frames averages."""
    lengths = adjusted.model.lengths
    squares = (lengths.length / lengths.sigma) ** 2
    share = np.bincount(lengths.certificate, squares, minlength=len(recording.bar.lengths))
    relative = np.array([standard_uncertainty(c) / c.length_mm for c in recording.bar.lengths])
    return float(np.sqrt(((share / share.sum()) ** 2 * relative**2).sum()))


def _about_frames(adjusted: BarAdjusted, recording: BarRecording) -> list[Finding]:
    frames = len(np.unique(adjusted.model.lengths.frame))
    where = (recording.bar.id,)
    if not frames:
        return [Finding("no-scale", "error", where=where, kind="no-frame")]
    if frames >= FEW_FRAMES:
        return []
    return [Finding("few-frames", "warning", {"frames": frames, "usual": 20 * FEW_FRAMES}, where)]
