"""Findings on single cameras: blurred ones, lenses beyond the model, focal lengths that are not those of the prior."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from spherecal.adjust.corrections import has_estimated_lenses
from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, leave_out
from spherecal.diagnose.anomalies import Anomalies
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.lens_models import WORTH, best_lenses
from spherecal.diagnose.score import change_of
from spherecal.geometry.camera import undistort
from spherecal.geometry.resection import resect
from spherecal.targets.images import read_image
from spherecal.targets.why_nothing import reads_mirrored

# Cameras of one kind scatter within 10 % of each other; twice the median is no chance (400 points: 3 % standard error).
NOISY = 2.0
# Where a misfit begins to harm: with 0.01 px the free form's bars were off by 73 instead of 43 um, with 0.03 px the
# rigid form's by 23 instead of 15 (rig A); half of a misfit is visible in the residuals.
HARMFUL_FREE_PX, HARMFUL_RIGID_PX = 0.007, 0.02
# Worth a word, and a wider uncertainty: with noise alone cameras reach 1.2 (18 clean rigs).
SCATTERING = 1.3
# The least visible move is worth a word where it is larger than noise alone makes it by this factor.
HIDES = 2.0
# Data sheets are good to 2 %.
WRONG_FOCAL = 0.05
# Farther from the prior than data sheets and guesses are, and poorly known too: eight cameras about one placement, in a
# wrong minimum, ended with focal lengths 64 % too short to 22 % too long, 62 times their uncertainty off.
ASTRAY_BY, ASTRAY_SD = 0.2, 0.01
# An unplaced camera is tried with other focal lengths; points within this of their place count (unknown distortion).
TRIED_FACTORS = np.geomspace(1 / 3, 3.0, 24)
TRIED_PX, TRIED_SHARE, TRIED_POINTS = 12.0, 0.7, 30
TRIED_IMAGES = 2  # of a camera without a pose, whether a mirror shows more: a second each
# What may have been done to all image points of a camera: left and right exchanged, or u and v.
Flip = Literal["camera", "axes"]
FLIPS: tuple[Flip, ...] = ("camera", "axes")


def flipped(uv: FloatArray, how: Flip, width: int | IntArray) -> FloatArray:
    """Image points (n,2) px with left and right, or u and v, exchanged."""
    return uv[:, ::-1] if how == "axes" else np.column_stack([width - 1 - uv[:, 0], uv[:, 1]])


def noisy_cameras(e: Evidence, moved: Collection[str]) -> list[Finding]:
    """Findings on cameras whose points scatter more than twice as much as the median camera's."""
    noise = e.noise_px
    known = e.placed & np.isfinite(noise)
    if known.sum() < 3:
        return []
    median = float(np.median(noise[known]))
    found = []
    for c in np.flatnonzero(known & (noise > NOISY * median)):
        name = e.camera_ids[c]
        if name in moved:
            continue
        count = int(e.image_counts(e.used)[:, c].sum())
        values = {"noise_px": noise[c], "times": noise[c] / median, "others_px": median}
        values |= {"percent": 100 / np.sqrt(2 * count), "points": count}
        found.append(Finding("camera-noisy", "warning", values, (name,), leave_out(f"camera:{name}")))
    return found


def misfitting_lenses(e: Evidence, anomalies: Anomalies, moved: Collection[str]) -> list[Finding]:
    """One finding on all cameras, moved ones left out, with structure in residuals that no ball's shape explains."""
    misfits = [m for m in anomalies.misfits if e.camera_ids[m.camera] not in moved]
    if not misfits or anomalies.in_shape:
        return []
    worst = max(misfits, key=lambda misfit: misfit.rms_px)
    limit = HARMFUL_RIGID_PX if e.choice.form == "rigid" else HARMFUL_FREE_PX
    names = tuple(e.camera_ids[m.camera] for m in misfits)
    # no model can take away more than all smooth fields together
    share = sum(m.statistic - m.dof for m in misfits) / (2 * len(e.adjusted.rows))
    other = best_lenses(e.solved, e.context) if share > WORTH and not e.has_own_scale else None
    if other is None and has_estimated_lenses(e.solved.network, e.adjusted):
        return []  # what the placements of a lens have in common is in its field, or they contradict each other
    values = {
        "worst": e.camera_ids[worst.camera],
        "rms_px": worst.rms_px,
        "chi_square": worst.statistic,
        "dof": worst.dof,
        "better": None if other is None else Phrase("sentence", {"text": other.better_by}),
        "hides": _unseen(e, anomalies),
        "take": None if other is None else Phrase("lens-take", {"option": other.option}),
        "turn": Phrase("lens-turn") if e.choice.form == "free" and not e.has_own_scale else None,
    }
    severity = "warning" if worst.rms_px > limit else "info"
    return [Finding("lens-misfit", severity, values, names, kind="structure")]


def scattering_poses(e: Evidence, anomalies: Anomalies) -> list[Finding]:
    """The finding on cameras whose images' poses differ by more than noise; its values widen their uncertainties."""
    if anomalies.scatter is None:
        return []
    own = np.flatnonzero(e.placed & (anomalies.scatter > SCATTERING))
    if not len(own):
        return []
    worst = own[np.argmax(anomalies.scatter[own])]
    values = {"worst": e.camera_ids[worst], "worst_times": anomalies.scatter[worst], "times": anomalies.scatter[own]}
    return [Finding("poses-scatter", "info", values, tuple(e.camera_ids[c] for c in own))]


def pose_scatter(findings: Sequence[Finding]) -> dict[str, float]:
    """By what factor the poses of some cameras' images differ more than noise explains, as found."""
    found = (f for f in findings if f.code == "poses-scatter" and f.values)
    return {name: times for f in found for name, times in zip(f.where, f.values["times"], strict=True)}


def _unseen(e: Evidence, anomalies: Anomalies) -> Phrase | None:
    """The moves that the scatter of the images' poses hides, where it hides more than noise does."""
    if anomalies.least_shift is None or e.solution.scale.source == "none":
        return None
    shift = np.where(e.placed[:, None], anomalies.least_shift, np.nan) * e.solution.factor
    hides = np.isfinite(shift).all(axis=1) & (shift[:, 0] > HIDES * shift[:, 1])
    if not hides.any():
        return None
    c = int(np.argmax(np.where(hides, shift[:, 0], 0.0)))
    return Phrase("lens-hides", {"camera": e.camera_ids[c], "shift_mm": shift[c, 0], "noise_mm": shift[c, 1]})


def fixed_focal_lengths(e: Evidence) -> FloatArray:
    """Chi-square (c,) of all focal lengths that were fixed by the user, one by one; zeros for other cameras."""
    out = np.zeros(len(e.placed))
    a, problem = e.adjusted, e.adjusted.problem
    fixed = np.flatnonzero(e.placed & ~problem.free_intrinsics[:, 0])
    probe = e.probe if len(fixed) else None
    if probe is None:
        return out
    for c in fixed:
        rows = np.flatnonzero(problem.camera == c)
        if not len(rows):
            continue
        predicted = problem.uv[rows] + probe.linear.residual[rows] / problem.weight[rows]
        values = ((predicted - a.state.intrinsics[c, 2:4]) * problem.weight[rows])[:, :, None]
        out[c] = change_of(*probe.block(rows, values), probe.variance).statistic
    return out


def wrong_focal_lengths(e: Evidence) -> list[Finding]:
    """Priors that estimated focal lengths contradict by more than 5 %, or that leave a camera without a pose."""
    prior = np.array([camera.prior[:2].mean() for camera in e.session.cameras])
    ratio = e.solution.state.intrinsics[:, :2].mean(axis=1) / prior
    free = e.adjusted.problem.free_intrinsics[:, 0] & e.placed
    off = free & ~e.solved.has_prior & (np.abs(ratio - 1) > WRONG_FOCAL)
    return _estimated_otherwise(e, off, prior, ratio) + _unplaced(e, prior)


def _estimated_otherwise(e: Evidence, off: BoolArray, prior: FloatArray, ratio: FloatArray) -> list[Finding]:
    found = []
    cofactors, sd = e.solution.covariance, np.zeros(len(off))
    if cofactors is not None and len(e.adjusted.problem.intrinsic_columns):
        sd = np.sqrt(np.maximum(e.adjusted.variance * cofactors.cameras[:, POSE, POSE], 0.0))
    for c in np.flatnonzero(off):
        spec = e.session.cameras[c]
        values = _prior_values(prior[c], prior[c] * ratio[c])
        kind = "px"
        if spec.pixel_pitch_um and spec.focal_length_mm:
            kind = "mm"
            values["estimated_mm"] = spec.pixel_pitch_um * prior[c] * ratio[c] / 1e3
            values["prior_mm"] = spec.pixel_pitch_um * prior[c] / 1e3
        finding = Finding("prior-focal-length", "warning", values, (spec.id,), kind=kind)
        if abs(ratio[c] - 1) > ASTRAY_BY and sd[c] > ASTRAY_SD * ratio[c] * prior[c]:
            found.append(replace(finding, severity="error"))
        elif "focal_length" not in spec.assumed:  # nobody stated it, so nothing is contradicted
            found.append(finding)
    return found


def _prior_values(prior: float, estimated: float) -> dict[str, float]:
    return {"estimated_px": estimated, "prior_px": prior, "percent": 100 * (estimated / prior - 1)}


def _unplaced(e: Evidence, prior: FloatArray) -> list[Finding]:
    """Cameras without a pose that another focal length would place."""
    found = []
    points = e.solution.state.points[e.features.of_observation]
    seen, used = (np.bincount(e.observations.camera[some], minlength=len(prior)) for some in (slice(None), e.used))
    for c in np.flatnonzero((~e.placed | (2 * used < seen)) & ~e.is_earlier_pose):
        where = (e.camera_ids[c],)
        if _images_mirrored(e, e.camera_ids[c]):
            found.append(Finding("mirrored", "error", where=where, kind="camera"))
            continue
        if e.placed[c]:
            continue
        rows = np.flatnonzero((e.observations.camera == c) & np.isfinite(points[:, 0]))
        if len(rows) < TRIED_POINTS:
            continue
        share, how = max((_share_with(e, int(c), rows, points[rows], 1.0, how), how) for how in FLIPS)
        if share >= TRIED_SHARE:
            found.append(Finding("mirrored", "error", where=where, kind="camera" if how == "camera" else "axes"))
            continue
        shares = [_share_with(e, int(c), rows, points[rows], float(factor)) for factor in TRIED_FACTORS]
        best = int(np.argmax(shares))
        factor = float(TRIED_FACTORS[best])
        if shares[best] >= TRIED_SHARE and abs(factor - 1) > WRONG_FOCAL:
            values = _prior_values(prior[c], prior[c] * factor) | {"fit_percent": 100 * shares[best]}
            found.append(Finding("prior-focal-length", "warning", values, where, kind="unplaced"))
    return found


def _images_mirrored(e: Evidence, camera: str) -> bool:
    """Whether the images of a camera have far more targets as a mirror shows them (9 of 54, 3 of them as others)."""
    paths = [p.images[camera] for p in e.session.placements if camera in p.images]
    targets = e.session.target_set
    if targets is None:
        return False
    try:
        return any(reads_mirrored(read_image(path), targets) for path in paths[:TRIED_IMAGES])
    except InputError:  # recorded observations need no images
        return False


def _share_with(
    e: Evidence, c: int, rows: IntArray, points: FloatArray, factor: float, flip: Flip | None = None
) -> float:
    """The share of a camera's points that agree with a pose for a focal length `factor` times its prior's."""
    intrinsics = e.session.cameras[c].prior.copy()
    intrinsics[:2] *= factor
    uv = e.observations.uv[rows]
    if flip is not None:
        uv = flipped(uv, flip, e.session.cameras[c].image_size[0])
    xy, usable = undistort(uv, intrinsics)
    pose = resect(points[usable], xy[usable], TRIED_PX / intrinsics[0])
    return 0.0 if pose is None else pose[2] / len(rows)
