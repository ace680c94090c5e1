"""Findings on single cameras: blurred ones, lenses beyond the model, focal lengths that are not those of the prior."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.problem import POSE
from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.diagnose.anomalies import Anomalies
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.lens_models import WORTH, best_lenses
from spherecal.diagnose.score import make_probe, settle
from spherecal.findings import Finding, counted
from spherecal.geometry.camera import undistort
from spherecal.network.resection import resect

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
# A fixed focal length that noise alone contradicts so much in one of 10 million cases.
CONTRADICTED = 30.0
# An unplaced camera is tried with other focal lengths; points within this of their place count (unknown distortion).
TRIED_FACTORS = np.geomspace(1 / 3, 3.0, 24)
TRIED_PX, TRIED_SHARE, TRIED_POINTS = 12.0, 0.7, 30


def noisy_cameras(e: Evidence, moved: Collection[str]) -> list[Finding]:
    """Cameras whose points scatter more than twice as much as the others'."""
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
        found.append(
            Finding(
                "warning", "camera-noisy",
                f"The points of camera {name} scatter by {noise[c]:.3f} px, {noise[c] / median:.1f} times as much as "
                f"the others' ({median:.3f} px); known to {100 / np.sqrt(2 * count):.0f} % from {count} points.",
                "Check its focus, aperture and exposure, and that it does not shake. It counts with the weight that "
                f"this leaves it; --leave-out camera:{name} would calibrate without it.",
                (name,),
            )
        )  # fmt: skip
    return found


def misfitting_lenses(e: Evidence, anomalies: Anomalies, moved: Collection[str]) -> list[Finding]:
    """One finding on all cameras whose residuals have structure over their image, moved ones left out."""
    misfits = [m for m in anomalies.misfits if e.camera_ids[m.camera] not in moved]
    if not misfits or anomalies.in_shape:
        return []
    worst = max(misfits, key=lambda misfit: misfit.rms_px)
    limit = HARMFUL_RIGID_PX if e.choice.form == "rigid" else HARMFUL_FREE_PX
    names = tuple(e.camera_ids[m.camera] for m in misfits)
    # no model can take away more than all smooth fields together
    share = sum(m.statistic - m.dof for m in misfits) / (2 * len(e.adjusted.rows))
    other = best_lenses(e.solved, "numba", e.context) if share > WORTH else None
    better = "" if other is None else f" {other.words[0].upper()}{other.words[1:]}."
    take = "" if other is None else f"Calibrate with {other.option}. "
    return [
        Finding(
            "warning" if worst.rms_px > limit else "info", "lens-misfit",
            f"The lens model does not follow {len(names)} camera{'s' if len(names) > 1 else ''} quite: the residuals "
            f"have structure over the image, worst in {e.camera_ids[worst.camera]} ({worst.rms_px:.3f} px rms, "
            f"chi-square {worst.statistic:.0f} on {worst.dof} degrees of freedom).{better}{_unseen(e, anomalies)}",
            f"{take}Lengths suffer several times less in the rigid form, with the ball turned at every placement. Look "
            "at the residual maps; check lengths with a bar.",
            names,
        )
    ]  # fmt: skip


def scattering_poses(e: Evidence, anomalies: Anomalies) -> list[Finding]:
    """The finding on cameras whose images' poses differ by more than noise; its values widen their uncertainties."""
    if anomalies.scatter is None:
        return []
    own = np.flatnonzero(e.placed & (anomalies.scatter > SCATTERING))
    if not len(own):
        return []
    worst = own[np.argmax(anomalies.scatter[own])]
    return [
        Finding(
            "info", "poses-scatter",
            f"The poses of single images differ more than noise lets them in {counted(len(own), 'camera')} (worst: "
            f"{e.camera_ids[worst]}, {anomalies.scatter[worst]:.1f} times); the stated uncertainties are wider by as "
            "much.",
            "Lenses beyond their model do that, and small motions of ball or cameras while they record.",
            tuple(e.camera_ids[c] for c in own), tuple(float(anomalies.scatter[c]) for c in own),
        )
    ]  # fmt: skip


def _unseen(e: Evidence, anomalies: Anomalies) -> str:
    """What moves the scatter of the images' poses hides, where it hides more than noise does."""
    if anomalies.least_shift is None or e.solution.scale.source == "none":
        return ""
    shift = np.where(e.placed[:, None], anomalies.least_shift, np.nan) * e.solution.factor
    hides = np.isfinite(shift).all(axis=1) & (shift[:, 0] > HIDES * shift[:, 1])
    if not hides.any():
        return ""
    c = int(np.argmax(np.where(hides, shift[:, 0], 0.0)))
    return (
        f" It makes their images differ as small moves would: one of {e.camera_ids[c]} below about "
        f"{shift[c, 0]:.2g} mm would not be seen (with noise alone below {shift[c, 1]:.2g} mm)."
    )


@dataclass(frozen=True)
class FixedFocal:
    """Of cameras whose focal length is not estimated: the relative change that would fit and its chi-square (c,)."""

    change: FloatArray
    statistic: FloatArray


def fixed_focal_lengths(e: Evidence) -> FixedFocal:
    """The tests of all focal lengths that were fixed by the user, one by one; zeros for other cameras."""
    out = FixedFocal(np.zeros(len(e.placed)), np.zeros(len(e.placed)))
    a, problem = e.adjusted, e.adjusted.problem
    fixed = np.flatnonzero(e.placed & ~problem.free_intrinsics[:, 0])
    if not len(fixed) or e.solved.cofactors is None or a.redundancy <= 0 or not a.variance > 0:
        return out
    probe = make_probe(problem, a.state, e.solved.cofactors, a.minimum.cost, a.redundancy)
    for c in fixed:
        rows = np.flatnonzero(problem.camera == c)
        if not len(rows):
            continue
        predicted = problem.uv[rows] + probe.linear.residual[rows] / problem.weight[rows]
        values = ((predicted - a.state.intrinsics[c, 2:4]) * problem.weight[rows])[:, :, None]
        found = settle(*probe.block(rows, values), probe.variance)
        out.change[c], out.statistic[c] = float(found.value[0]), found.statistic
    return out


def wrong_focal_lengths(e: Evidence, fixed: FixedFocal) -> list[Finding]:
    """Priors that the data contradict: estimated focal lengths off by more than 5 %, fixed ones that do not fit."""
    prior = np.array([camera.prior[:2].mean() for camera in e.session.cameras])
    ratio = e.solution.state.intrinsics[:, :2].mean(axis=1) / prior
    free = e.adjusted.problem.free_intrinsics[:, 0] & e.placed
    off = free & ~e.solved.held & (np.abs(ratio - 1) > WRONG_FOCAL)
    found = _estimated_otherwise(e, off, prior, ratio) + _unplaced(e, prior)
    for c in np.flatnonzero(fixed.statistic > CONTRADICTED):
        name = e.camera_ids[c]
        found.append(
            Finding(
                "warning", "fixed-intrinsics-contradicted",
                f"The fixed focal length of camera {name} ({prior[c]:.1f} px) contradicts the images: "
                f"{prior[c] * (1 + fixed.change[c]):.1f} px would fit (chi-square {fixed.statistic[c]:.0f}, limit "
                f"{CONTRADICTED:.0f}).",
                "Was its lens refocused or changed since these intrinsics were measured? Use --intrinsics free.",
                (name,),
            )
        )  # fmt: skip
    return found


def _estimated_otherwise(e: Evidence, off: BoolArray, prior: FloatArray, ratio: FloatArray) -> list[Finding]:
    found = []
    cofactors, sd = e.solution.covariance, np.zeros(len(off))
    if cofactors is not None and len(e.adjusted.problem.intrinsic_columns):
        sd = np.sqrt(np.maximum(e.adjusted.variance * cofactors.cameras[:, POSE, POSE], 0.0))
    for c in np.flatnonzero(off):
        spec = e.session.cameras[c]
        in_mm = ""
        if spec.pixel_pitch_um and spec.focal_length_mm:
            in_mm = f"; {spec.pixel_pitch_um * prior[c] * ratio[c] / 1e3:.2f} mm instead of "
            in_mm += f"{spec.pixel_pitch_um * prior[c] / 1e3:.2f} mm"
        finding = _wrong_prior(spec.id, prior[c], prior[c] * ratio[c], in_mm, "")
        if abs(ratio[c] - 1) > ASTRAY_BY and sd[c] > ASTRAY_SD * ratio[c] * prior[c]:
            found.append(replace(finding, severity="error"))
        elif "focal_length" not in spec.assumed:  # nobody stated it, so nothing is contradicted
            found.append(finding)
    return found


def _wrong_prior(name: str, prior: float, estimated: float, in_mm: str, how: str) -> Finding:
    return Finding(
        "warning", "prior-focal-length",
        f"Camera {name} has a focal length of about {estimated:.0f} px, not {prior:.0f} px as the session says "
        f"({100 * (estimated / prior - 1):+.0f} %{in_mm}){how}.",
        f"Correct focal_length_mm, pixel_pitch_um or the prior of {name} in session.json: there is another lens, "
        "another camera, or images of reduced size.",
        (name,),
    )  # fmt: skip


def _unplaced(e: Evidence, prior: FloatArray) -> list[Finding]:
    """Cameras without a pose that another focal length would place."""
    found = []
    points = e.solution.state.points[e.features.of_observation]
    for c in np.flatnonzero(~e.placed & ~e.is_earlier_pose):
        rows = np.flatnonzero((e.observations.camera == c) & np.isfinite(points[:, 0]))
        if len(rows) < TRIED_POINTS:
            continue
        if _share_with(e, int(c), rows, points[rows], 1.0, mirrored=True) >= TRIED_SHARE:
            found.append(_mirrored(e.camera_ids[c]))
            continue
        shares = [_share_with(e, int(c), rows, points[rows], float(factor)) for factor in TRIED_FACTORS]
        best = int(np.argmax(shares))
        factor = float(TRIED_FACTORS[best])
        if shares[best] >= TRIED_SHARE and abs(factor - 1) > WRONG_FOCAL:
            how = f"; with it {100 * shares[best]:.0f} % of its points fit, and it could be placed"
            found.append(_wrong_prior(e.camera_ids[c], prior[c], prior[c] * factor, "", how))
    return found


def _mirrored(name: str) -> Finding:
    return Finding(
        "error", "mirrored",
        f"The images of camera {name} are mirrored: with left and right exchanged its points fit the others'.",
        f"Switch off ReverseX or ReverseY (a flip) in the settings of camera {name}, or mirror its files back.",
        (name,),
    )  # fmt: skip


def _share_with(
    e: Evidence, c: int, rows: IntArray, points: FloatArray, factor: float, mirrored: bool = False
) -> float:
    """The share of a camera's points that agree with a pose for a focal length `factor` times its prior's."""
    intrinsics = e.session.cameras[c].prior.copy()
    intrinsics[:2] *= factor
    uv = e.observations.uv[rows]
    if mirrored:
        uv = np.column_stack([e.session.cameras[c].image_size[0] - 1 - uv[:, 0], uv[:, 1]])
    xy, usable = undistort(uv, intrinsics)
    pose = resect(points[usable], xy[usable], TRIED_PX / intrinsics[0])
    return 0.0 if pose is None else pose[2] / len(rows)
