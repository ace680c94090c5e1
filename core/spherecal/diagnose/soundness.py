"""Tests of a calibration as a whole: what was left out, the ball's size, given intrinsics, contradictions."""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from scipy.spatial import KDTree
from scipy.special import chdtri

from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, leave_out
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.image_findings import LEAST_POINTS, MOST_LEFT_OUT
from spherecal.diagnose.influence import length_functions
from spherecal.diagnose.moves import LEAST_POINTS as LEAST_FOR_POSE
from spherecal.diagnose.plausibility import implausible_size
from spherecal.diagnose.score import LEAST_POINTS as LEAST_FOR_FIELDS
from spherecal.diagnose.score import ScoreTest, change_of, conditional, field_values
from spherecal.geometry.camera import estimated_mask, project_with_derivatives, undistort

# On clean rigs A, B, halls and domes a camera keeps 96 to 100 % of its observations, with 5 % wrong matches 88 %.
LEAST_USED = 0.6
# Wrong observations beyond this share, by more than chance, are more than reflections and wrong codes.
MANY_OUTLIERS, SURE = 0.05, 3.0
# A globe is as large as it is called within 0.2 % (bumps of 1 mm on 500), and printers err by 0.1 to 0.5 %; beyond 2 %
# something was typed, or printed, wrong.
DOUBTFUL_DIAMETER, WRONG_DIAMETER = 0.005, 0.02
# What is not round within this share of its radius is no ball, whatever the session calls it.
ROUND = 0.05
# Cameras with 30 points each ended 543 mm off, all in one wrong minimum, at 9 times the stated noise; lenses beyond the
# model reach twice to three times.
FEW_POINTS, FITS_BADLY = 60, 5.0
# Lenses on most cameras and another test fail together: nothing can be blamed. So it is where residuals are large in
# pixels and against the noise between neighbouring dots: lenses beyond their model reach 0.8 px and twice the noise
# (dome15), 0.2 px and 3 times (camcal); a ball moved by 1 mm between exposures 0.4 px and more than 6 times (demo).
MOST_CAMERAS, LARGE_PX, LARGE = 0.6, 0.3, 5.0
# Lenses beyond their model by 0.04 to 0.25 px make the rigid form's variance 1.08 to 1.35 times the free one's.
CHANGED_BY_LENSES = 2.0


def unsound(e: Evidence, reported: Sequence[Finding]) -> list[Finding]:
    """Findings on the calibration as a whole, beside those reported already."""
    blamed = {name for finding in reported for name in finding.where if finding.code in _BLAMES}
    moved = {name for f in reported if f.code in ("camera-moved", "cameras-moved") for name in f.where}
    lenses = [] if locked(e) else contradicted_lenses(e, moved)
    found = [*_size(e), *_rejected(e, blamed), *ball_diameter(e), *lenses, *_fits_badly(e)]
    return [*found, *_contradicting(e, [*reported, *found])]


def _size(e: Evidence) -> list[Finding]:
    """The finding on lengths in another unit."""
    if e.solution.scale.source == "none":
        return []
    o, state, used = e.observations, e.solution.state, np.flatnonzero(e.used)
    camera, points = o.camera[used], state.points[e.features.of_observation[used]]
    depth = np.einsum("nj,nj->n", state.rotation[camera, 2], points) + state.translation[camera, 2]
    centres = -np.einsum("cji,cj->ci", state.rotation, state.translation)[e.placed & ~e.is_earlier_pose]
    return implausible_size(depth, state.intrinsics[camera, 0], centres)


# Findings that explain why a camera's observations were left out.
_MOTIONS = ("cameras-moved", "camera-unsteady", "ball-moved")
_BLAMES = ("camera-moved", *_MOTIONS, "wrong-placement", "image-contradicts", "cameras-swapped")


def outlier_share(e: Evidence) -> tuple[BoolArray, int, bool]:
    """Observations that contradict the rest (n,), how many could be checked, and whether they are more than a few.

    Of a point that two cameras see both views are left out where one is wrong: they count as one.
    """
    placed = e.placed[e.observations.camera]
    feature = e.features.of_observation
    views = np.bincount(feature[placed], minlength=len(e.features))
    candidates = placed & (views >= 2)[feature]
    out = candidates & e.contradicting
    gone = np.bincount(feature[out], minlength=len(e.features)) == 2
    wrong = int(out.sum()) - int((gone & (views == 2)).sum())
    n = max(int(candidates.sum()), 1)
    chance = SURE * np.sqrt(MANY_OUTLIERS * (1 - MANY_OUTLIERS) / n)
    return out, n, wrong / n > MANY_OUTLIERS + chance


def _rejected(e: Evidence, blamed: set[str]) -> list[Finding]:
    """Cameras of which too little is left, and images rejected by majority, where nothing else explains it."""
    out, seen = e.image_counts(e.contradicting), e.image_counts(e.candidates)
    found = []
    for c in np.flatnonzero(e.placed):
        name, total = e.camera_ids[c], int(seen[:, c].sum())
        images = np.flatnonzero((seen[:, c] >= LEAST_POINTS) & (out[:, c] > MOST_LEFT_OUT * seen[:, c]))
        used = 1 - out[:, c].sum() / max(total, 1)
        if name in blamed or (used >= LEAST_USED and not len(images)) or total < LEAST_POINTS:
            continue
        places = [e.observations.placements[t] for t in images]
        values = {"percent": 100 * (1 - used), "camera": name, "places": places}
        kind, repairs = "images" if places else "camera", leave_out(f"camera:{name}")
        found.append(Finding("images-rejected", "warning", values, (name, *places), repairs, kind))
    return found


def _fits_badly(e: Evidence) -> list[Finding]:
    """The finding where residuals are large and no camera has enough points to find the cause or a better minimum."""
    sigma = e.observations.sigma
    count = np.bincount(e.observations.camera[e.used], minlength=len(e.placed))[e.placed]
    if not len(count) or np.median(count) >= FEW_POINTS:
        return []
    usual = np.full((1, 2), LARGE_PX / FITS_BADLY) if sigma is None else sigma[e.used]
    times = float(np.sqrt(np.mean((e.residual_px[e.used] / usual) ** 2)))
    if times <= FITS_BADLY:
        return []
    values = {"times": times, "points": np.median(count)}
    return [Finding("fits-badly", "warning", values, kind="usual" if sigma is None else "stated")]


def ball_diameter(e: Evidence) -> list[Finding]:
    """The finding where the ball is not as large as the session says."""
    off = diameter_error(e)
    if off is None or abs(off) <= DOUBTFUL_DIAMETER:
        return []
    nominal = e.session.sphere_diameter_mm
    assert nominal is not None
    wrong = abs(off) > WRONG_DIAMETER
    by_bar = e.solution.scale.source == "bar"
    values = {"measured_mm": nominal * (1 + off), "nominal_mm": nominal, "percent": 100 * off}
    return [Finding("ball-diameter", "error" if wrong else "info" if by_bar else "warning", values)]


def diameter_error(e: Evidence) -> float | None:
    """The relative excess of the ball over its nominal diameter; None where that cannot be decided."""
    nominal = e.session.sphere_diameter_mm
    if nominal is None or e.solution.scale.source in ("none", "ball") or "ball" in e.session.struck:
        return None
    radii = [s.radius for s in e.solution.spheres.values() if s.radial_sd < ROUND * s.radius]
    return 2 * float(np.median(radii)) / nominal - 1 if radii else None


def further_scale_uncertainty(e: Evidence) -> float:
    """The relative standard uncertainty that a ball of another size than the nominal one adds to the scale.

    Twice it covers the difference; 0 for a scale from a bar, which is surer than a ball's name.
    """
    off = diameter_error(e)
    if off is None or abs(off) <= DOUBTFUL_DIAMETER or e.solution.scale.source == "bar":
        return 0.0
    return abs(off) / 2


def locked(e: Evidence) -> bool:
    """Whether cameras are locked at the poses of another calibration: their errors then appear as other faults."""
    return (~e.adjusted.problem.free_pose[e.placed]).sum() > 1  # one is the frame of a board's or bar's network


def _contradicting(e: Evidence, reported: Sequence[Finding]) -> list[Finding]:
    """The finding where the tests of lenses and others fail together on most cameras, so that no cause can be named."""
    if any(f.code in ("fixed-intrinsics-contradicted", *_MOTIONS) for f in reported):  # explains it
        return []
    lenses = {name for f in reported if f.code == "lens-misfit" and f.severity == "warning" for name in f.where}
    if len(lenses) < MOST_CAMERAS * e.placed.sum():
        return []
    others = [f.code for f in reported if f.code in _FAIL_WITH_LENSES and f.severity == "warning"]
    if (e.choice.ratio or 0.0) < CHANGED_BY_LENSES:
        others = [code for code in others if code not in ("ball-shape-changed", "rigid-form-misfit")]
    size = np.linalg.norm(e.residual_px[e.used & np.isfinite(e.residual_px[:, 0])], axis=1)
    rms = float(np.sqrt((size**2).mean())) if len(size) else 0.0
    if not others and rms <= max(LARGE_PX, LARGE * np.sqrt(2) * _neighbours_noise_px(e)):
        return []
    values = {"cameras": int(e.placed.sum()), "rms_px": rms, "tests": list(dict.fromkeys(others))}
    where = tuple(name for name in e.camera_ids if name in lenses)
    return [Finding("recording-contradicts", "warning", values, where, kind="others" if others else "lenses")]


def _neighbours_noise_px(e: Evidence) -> float:
    """Standard deviation of a coordinate by nearest neighbours in one image, the median over cameras."""
    noise, o = [], e.observations
    for c in np.flatnonzero(e.placed):
        own = np.flatnonzero(e.used & (o.camera == c))
        if len(own) < LEAST_POINTS:
            continue
        place = np.column_stack([o.uv[own], 1e6 * o.placement[own]])  # neighbours are of one image
        near = np.asarray(KDTree(place).query(place, k=2)[1])[:, 1]
        noise.append(np.sqrt(((e.residual_px[own] - e.residual_px[own[near]]) ** 2).sum(axis=1).mean() / 4))
    return float(np.median(noise)) if noise else np.inf


_FAIL_WITH_LENSES = (
    "camera-moved", "ball-shape-changed", "rigid-form-misfit", "placements-contradict", "image-contradicts",
)  # fmt: skip


# --- intrinsics that are held fixed and that the data contradict -----------------------------------------------------
#
# One test for all methods. A lens that its model does not follow leaves structure in the residuals, which intrinsics
# take up a little whatever they are. So what the intrinsics explain is compared, number by number, with what smooth
# fields explain beyond them.

# Fixed intrinsics that noise alone contradicts so much in one of a million recordings. 0.15 % of the focal length of
# all cameras is found on the demo rig.
FALSE_ALARM = 1e-6
# Each camera's intrinsics, or one factor of all focal lengths, estimated beside the rest: where that changes a length
# by more than this many times U, lengths are wrong; below it, its share is added to the uncertainty.
MOST_OFF = 1.0
_BROWN = np.flatnonzero(estimated_mask("brown"))


def contradicted_lenses(e: Evidence, moved: Collection[str]) -> list[Finding]:
    """Findings on cameras whose given intrinsics the data contradict, moved ones left out."""
    problem, probe = e.adjusted.problem, e.probe
    fixed = np.flatnonzero(e.placed & ~problem.free_intrinsics[:, 0])
    if probe is None or probe.shift is None or not len(fixed):
        return []
    fixed = [int(c) for c in fixed if (problem.camera == c).sum() >= LEAST_FOR_POSE and e.camera_ids[c] not in moved]
    blocks = {c: np.flatnonzero(problem.camera == c) for c in fixed}
    values = {c: _by_intrinsics(probe, e.adjusted.state.intrinsics, blocks[c]) for c in fixed}
    structure = {c: _structure(e, probe, blocks[c], values[c]) for c in fixed}
    level = FALSE_ALARM / (len(fixed) + 1)
    found = [
        one for c in fixed if (one := _tested(e, probe, (c,), blocks[c], values[c], structure[c], level)) is not None
    ]
    if len(fixed) > 1 and len(found) < len(fixed):
        rows = np.concatenate(list(blocks.values()))
        focal = e.adjusted.state.intrinsics[:, :2, None]  # derivatives by one factor of all focal lengths
        common = np.concatenate([values[c][:, :, :2] @ focal[c] for c in fixed])
        usual = float(np.median(list(structure.values())))
        all_of_them = _tested(e, probe, tuple(fixed), rows, common, usual, level)
        found = found if all_of_them is None else [*found, all_of_them]
    return found


def _structure(e: Evidence, probe: ScoreTest, rows: IntArray, values: FloatArray) -> float:
    """What a number of a camera's smooth fields explains beyond its intrinsics, over noise; at least 1."""
    if len(rows) < LEAST_FOR_FIELDS:
        return 1.0
    size = np.array(e.session.cameras[int(probe.problem.camera[rows[0]])].image_size, dtype=float)
    both = np.concatenate([values, field_values(probe, rows, size)], axis=2)
    rest = change_of(*conditional(*probe.block(rows, both), np.arange(values.shape[2])), probe.variance)
    return max(rest.statistic / rest.dof, 1.0) if rest.dof else 1.0


def _tested(
    e: Evidence,
    probe: ScoreTest,
    cameras: tuple[int, ...],
    rows: IntArray,
    values: FloatArray,
    structure: float,
    level: float,
) -> Finding | None:
    """The finding on cameras whose intrinsics, or one factor of their focal lengths, explain more than chance."""
    change = change_of(*probe.block(rows, values), probe.variance)
    limit = structure * float(chdtri(change.dof, level)) if change.dof else np.inf
    if change.statistic <= limit:
        return None
    step = np.zeros((len(e.placed), POSE + len(_BROWN)))
    intrinsics, is_factor = e.adjusted.state.intrinsics, len(change.value) == 1
    for c in cameras:
        own = intrinsics[c, :2] * change.value[0] if is_factor else change.value
        step[c, POSE : POSE + len(own)] = own
    width = probe.linear.width
    force = probe.forces(rows, values.reshape(-1, values.shape[2]) @ change.value[:, None])[0][0]
    followed = -(probe.inverse @ force)[: len(e.placed) * width].reshape(-1, width)
    step[:, :POSE] += followed[:, :POSE]
    at = np.searchsorted(_BROWN, probe.problem.intrinsic_columns)
    known = np.isin(probe.problem.intrinsic_columns, _BROWN)
    step[:, POSE + at[known]] += followed[:, POSE:][:, known]
    lengths, poses = _effect(e, probe, step)
    said: dict[str, Any] = {
        "chi_square": change.statistic, "dof": change.dof, "limit": limit, "times": change.statistic / limit,
        "lengths": lengths / 2, "grow_lengths": float(np.hypot(1, lengths)), "grow_poses": float(np.hypot(1, poses)),
    }  # fmt: skip
    camera, *others = cameras
    if others:
        said |= {"worst": Phrase("all-focal-lengths")}
    else:
        prior, focal = e.session.cameras[camera].prior[:2].mean(), step[camera, POSE] / intrinsics[camera, 0]
        said |= {"fixed_px": prior, "fitting_px": prior * (1 + float(focal))}
    # not valid where lengths are off by more than U; else the change is added to the uncertainties
    severity, kind = "error" if lengths > 2 * MOST_OFF else "warning", "all" if others else "one"
    ids = tuple(e.camera_ids[c] for c in cameras)
    return Finding("fixed-intrinsics-contradicted", severity, said, ids, kind=kind)


def _effect(e: Evidence, probe: ScoreTest, step: FloatArray) -> tuple[float, float]:
    """Changes of lengths and of poses by a step (c, 6 + 9) of the cameras, the largest over their uncertainties."""
    assert e.solved.cofactors is not None
    covariance = probe.variance * e.solved.cofactors.all_cameras()
    by_all, length = length_functions(e, _BROWN)
    by_own, _ = length_functions(e, probe.problem.intrinsic_columns)
    off = by_all @ step.ravel()
    if not e.has_own_scale and len(off):  # the scale is measured in the changed network anew
        off = off - off.mean()
    scale = length * (e.solution.scale.relative_uncertainty or 0.0)
    sd = np.sqrt(np.einsum("mi,mi->m", by_own @ covariance, by_own).clip(0) + scale**2)
    pose = np.sqrt(covariance.diagonal().clip(0)).reshape(len(e.placed), -1)[:, :POSE]
    turned = np.abs(step[:, :POSE]) / np.where(pose > 1e-9 * pose.max(initial=0.0), pose, np.inf)
    return float((np.abs(off) / sd).max(initial=0.0)), float(turned.max(initial=0.0))


def _by_intrinsics(probe: ScoreTest, intrinsics: FloatArray, rows: IntArray) -> FloatArray:
    """Weighted derivatives (k,2,9) of some rows of one camera by Brown's intrinsics."""
    problem, c = probe.problem, int(probe.problem.camera[rows[0]])
    predicted = problem.uv[rows] + probe.linear.residual[rows] / problem.weight[rows]
    xy = np.nan_to_num(undistort(predicted, intrinsics[c])[0])
    x = np.column_stack([xy, np.ones(len(rows))])
    by_all = project_with_derivatives(x, intrinsics[c])[2]
    return by_all[:, :, _BROWN] * problem.weight[rows][:, :, None]
