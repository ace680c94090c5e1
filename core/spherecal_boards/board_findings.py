"""What a calibration by a board or a bar says about itself."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.data.findings import Finding
from spherecal.data.observations import Features, Observations
from spherecal.data.rig import Calibration, CameraCovariance, CameraSigma, Rig, RigCamera, RigScale
from spherecal.data.session import UNMEASURED_PRINT, Session
from spherecal.data.verdict import ruled, widening
from spherecal.diagnose import run_checks
from spherecal.diagnose.anomalies import Anomalies, beyond_the_lens
from spherecal.diagnose.camera_findings import (
    fixed_focal_lengths,
    misfitting_lenses,
    noisy_cameras,
    scattering_poses,
    wrong_focal_lengths,
)
from spherecal.diagnose.evidence import STAGE
from spherecal.diagnose.image_findings import wrong_images
from spherecal.diagnose.influence import bent_by_lenses, dependent_parts
from spherecal.diagnose.motion_findings import mixed_up_images, motion_findings, moved_cameras, unexplained_images
from spherecal.diagnose.moves import (
    LEAST_POINTS,
    credible,
    find_moves,
    least_visible,
    pose_values,
    prepare,
    rows_of,
    scatters,
)
from spherecal.diagnose.run_checks import STATED_LENGTH_MM
from spherecal.diagnose.score import misfits
from spherecal.diagnose.soundness import MANY_OUTLIERS, MOST_CAMERAS, unsound
from spherecal.diagnose.swapped_cameras import swapped_cameras, swapped_images
from spherecal.geometry.field_table import FieldTable
from spherecal.initialise.view_graph import groups_of
from spherecal.result.build_result import camera_sigma, dot_noise_px, map_of_lengths, placed_camera, quality_of
from spherecal_boards.frames_adjustment import Adjusted
from spherecal_boards.frames_evidence import FrameEvidence, Tested


@dataclass(frozen=True)
class Fit:
    """What an adjustment over frames found, in millimetres and the reference camera's frame.

    `placed` (c,); points (m,3) and cofactors (m,3,3), NaN where unknown, of `features`; residual (n,2) px; intrinsics
    `free` (c,16) are estimated, cameras of one `group` (c,) share them.
    """

    observations: Observations
    features: Features
    reference: int
    placed: BoolArray
    adjusted: Adjusted
    points: FloatArray
    points_cofactor: FloatArray
    residual: FloatArray
    tested: Tested | None
    free: BoolArray
    group: IntArray


def assemble_fit(
    e: FrameEvidence | None,
    session: Session,
    fit: Fit,
    scale: RigScale,
    findings: list[Finding],
    method: str,
    seconds: dict[str, float],
) -> Calibration:
    """The calibration of a session from its fit and what its diagnosis rests on."""
    names = [session.cameras[c].id for c in np.flatnonzero(fit.placed)]
    lengths, poses = widening(ruled(findings), names, "free" if method == "bar" else "rigid")
    most = float(lengths.max(initial=1.0))
    scale = _wider_scale(fit, scale, most)
    of_length = {} if scale.relative_uncertainty is None else {"mm": scale.relative_uncertainty * STATED_LENGTH_MM}
    of_scale = ("scale-uncertainty", "print-unmeasured")
    ordered = ruled([replace(f, values={**f.values, **of_length}) if f.code in of_scale else f for f in findings])
    used, of_unit = fit.adjusted.used, fit.adjusted.variance
    sigma0 = float(np.sqrt(of_unit)) if np.isfinite(of_unit) else None
    quality = quality_of(fit.residual[used], sigma0, ordered, names)
    placed, (bent, fields) = zip(np.flatnonzero(fit.placed), poses, strict=True), _by_lenses(e, findings)
    cameras = tuple(_camera(session, fit, int(c), factor, fields) for c, factor in placed)
    covariance, noise_px = _covariance(fit, scale, lengths, bent), dot_noise_px(fit.observations, used, of_unit)
    reference, shown = session.cameras[fit.reference].id, map_of_lengths(cameras, covariance, fit.points, noise_px)
    rig = Rig(
        reference, cameras, scale, quality, session.input_sha256, covariance, shown, recorded_at=session.recorded_at
    )
    sigma = np.sqrt(np.maximum(most**2 * of_unit * np.einsum("pii->pi", fit.points_cofactor), 0.0))
    points = fit.points, sigma, np.bincount(fit.features.of_observation[used], minlength=len(fit.features))
    return Calibration(rig, fit.observations, fit.features, *points, fit.residual, used, (), method, seconds)


def _wider_scale(fit: Fit, scale: RigScale, factor: float) -> RigScale:
    """The scale with the share of noise in its uncertainty times a factor."""
    if scale.relative_uncertainty is None or fit.adjusted.covariance is None:
        return scale
    more = np.sqrt((factor**2 - 1) * fit.adjusted.variance) * fit.adjusted.covariance.relative_scale
    return replace(scale, relative_uncertainty=float(np.hypot(scale.relative_uncertainty, more)))


def _camera(session: Session, fit: Fit, c: int, wider: float, fields: dict[int, FieldTable]) -> RigCamera:
    own = fit.residual[fit.adjusted.used & (fit.observations.camera == c)]
    return placed_camera(session.cameras[c], fit.adjusted.state, c, own, _sigma(fit, c, wider), fields.get(c))


def _sigma(fit: Fit, c: int, wider: float) -> CameraSigma | None:
    adjusted = fit.adjusted
    covariance, variance = adjusted.covariance, adjusted.variance
    if covariance is None or not np.isfinite(variance):
        return None
    cofactors = covariance.cameras[c] * variance * wider**2
    return camera_sigma(cofactors, adjusted.state.rotation[c], adjusted.model.problem, c)


def _by_lenses(e: FrameEvidence | None, findings: list[Finding]) -> tuple[FloatArray | None, dict[int, FieldTable]]:
    """What lenses beyond their model may have done, those that are named, or all where most are; and their fields."""
    named = {name for f in findings if f.code == "lens-misfit" for name in f.where}
    if e is None or not named:
        return None, {}
    own = np.isin(e.camera_ids, list(named))
    return bent_by_lenses(e, np.flatnonzero(e.placed if own.sum() >= MOST_CAMERAS * e.placed.sum() else own)) or (
        None,
        {},
    )


def _covariance(fit: Fit, scale: RigScale, wider: FloatArray, bent: FloatArray | None) -> CameraCovariance | None:
    """The covariance of all placed cameras, noise `wider` (k,), with the scale's and the lenses' share."""
    covariance, variance = fit.adjusted.covariance, fit.adjusted.variance
    if covariance is None or not np.isfinite(variance) or scale.relative_uncertainty is None:
        return None
    stretch = covariance.stretch * scale.relative_uncertainty
    columns = fit.adjusted.model.problem.intrinsic_columns
    keep, each = np.repeat(fit.placed, POSE + len(columns)), np.repeat(wider, POSE + len(columns))
    noise = variance * covariance.all_cameras[np.ix_(keep, keep)] * np.outer(each, each)
    further = np.array([stretch, np.zeros_like(stretch) if bent is None else bent])[:, keep]
    return CameraCovariance(noise + further.T @ further, columns)


# Share of the variance that own poses take away, and the median F of these tests, on a rig of ten cameras: 0.84 and 87
# with a board that moved by 0.2 mm, 0.98 and 1000 by 1 mm; 0.53 and 10 with a beam that sagged, below 0.04 and 1 of a
# clean board, one that bends, or one camera that was knocked; 0.78 and 67, 0.79 and 98 of pixels skewed by 2 and 4 px.
LEAST_SHARE, LEAST_F = 0.8, 30.0
# What is explained by the board's motion, and would be blamed on single cameras.
INSTEAD = ("camera-moved", "cameras-moved", "camera-unsteady", "ball-moved", "recording-contradicts", "wrong-placement")


def moving_board(e: FrameEvidence, found: list[Finding]) -> list[Finding]:
    """The findings, with one on a board that moved instead of those that it explains."""
    if any(f.code in ("fixed-intrinsics-contradicted", "cameras-swapped", "image-repeated") for f in found):
        return found
    # placements of which most have no two cameras that agree
    seen, kept = e.image_counts(e.candidates), e.image_counts(e.used)
    shared = (seen >= LEAST_POINTS).sum(axis=1) >= 2
    agree = ((seen >= LEAST_POINTS) & (2 * kept > seen)).sum(axis=1) >= 2
    count, of = int((shared & ~agree).sum()), int(shared.sum())
    apart = Finding("board-moving", "error", {"count": count, "of": of}, kind="apart")
    moving = apart if 2 * count > of else _between(e)
    if moving is None:
        return found
    wrong = any(f.code in INSTEAD for f in found)
    moving = replace(moving, severity="error") if wrong else moving
    return [moving, *(f for f in found if f.code not in INSTEAD)]


def _between(e: FrameEvidence) -> Finding | None:
    """The finding on images that each fit alone and do not fit together."""
    probe = e.probe
    if probe is None or e.placed.sum() < 2:
        return None
    by_pose, residual, rows = probe.by_pose(), probe.residual.reshape(-1, 2), e.adjusted.rows
    image = np.unique(np.stack([e.observations.placement, e.observations.camera])[:, rows], axis=1, return_inverse=True)
    tested = []
    label = image[1].reshape(-1)
    order = np.argsort(label, kind="stable")
    for own in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        if len(own) >= LEAST_POINTS:
            x, y = by_pose[own].reshape(-1, POSE), residual[own].reshape(-1)
            rest = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
            tested.append((y @ y / len(y), rest @ rest / (len(y) - POSE), len(y)))
    if not tested:
        return None
    before, after, count = np.array(tested).T
    share = 1 - after.sum() / before.sum()
    f = ((before - after) * count / POSE + after) / after
    if share < LEAST_SHARE or np.median(f) < LEAST_F:
        return None
    o, state, used = e.observations, e.solution.state, e.used
    camera, points = o.camera[used], state.points[e.features.of_observation[used]]
    depth = np.einsum("nj,nj->n", state.rotation[camera, 2], points) + state.translation[camera, 2]
    size_px = np.sqrt((2 * (before - after)).mean())
    size_mm = float(size_px * np.nanmedian(depth / state.intrinsics[camera, 0]))
    return Finding("board-moving", "warning", {"size_mm": size_mm, "size_px": float(size_px)}, kind="between")


Shown = Literal["board", "bar"]


def unlinked(
    camera_ids: tuple[str, ...], linked: IntArray, placed: BoolArray, what: Shown, least: int
) -> list[Finding]:
    """The finding on cameras that could not be linked (c,c), group by group; none where all are placed."""
    if placed.all():
        return []
    ids = np.array(camera_ids)
    groups = groups_of(np.where(placed[:, None] == placed, linked, 0) + np.outer(placed, placed), placed)
    named = [ids[group] for group in groups]
    where = tuple(str(name) for group in named for name in group)
    kind = what if placed.any() else f"{what}-none"
    return [Finding("cameras-unlinked", "error", {"groups": named, "least": least}, where, kind=kind)]


def common_findings(session: Session, fit: Fit, what: Shown) -> list[Finding]:
    """Findings that boards and bars share."""
    return [
        *_convergence(fit, what),
        *run_checks.held_lenses(session, fit.adjusted.state.intrinsics, fit.adjusted.has_prior & fit.placed, what),
        *_weak(session, fit, what),
        *run_checks.little_coverage(
            session, fit.placed, run_checks.image_coverage(fit.observations, fit.adjusted.used, session), what
        ),
        *_outliers(session, fit),
    ]


def diagnosed(e: FrameEvidence | None, what: Shown) -> list[Finding]:
    """Findings on cameras, placements and lenses by the tests that are the ball's too."""
    if e is None:
        return []
    e.context.report(STAGE, 0.0)
    wrong = wrong_images(e)
    exchanged = swapped_images(e) if wrong and what == "board" else []
    if exchanged:  # the network is bent by them: what else it shows is judged once they are where they belong
        return mixed_up_images(e, exchanged)
    found = [*mixed_up_images(e, wrong), *swapped_cameras(e)]
    anomalies = _anomalies(e)
    moves = motion_findings(e, anomalies, wrong)
    moved = moved_cameras(e, moves)
    found += [*moves, *unexplained_images(e, wrong, moved), *misfitting_lenses(e, anomalies, moved)]
    found += [*scattering_poses(e, anomalies), *wrong_focal_lengths(e), *noisy_cameras(e, moved), *dependent_parts(e)]
    found += unsound(e, found)
    if what == "board":
        found = moving_board(e, found)
    if what == "board":
        return found
    # a stretch of frames is named by its first one: that frame alone is nothing to leave out
    whole = [[r for r in f.repairs if r.kind != "leave-out" or r.target.startswith("camera:")] for f in found]
    return [replace(f, repairs=tuple(kept)) for f, kept in zip(found, whole, strict=True)]


def _anomalies(e: FrameEvidence) -> Anomalies:
    if e.probe is None:
        return Anomalies()
    sizes = np.array([camera.image_size for camera in e.session.cameras], dtype=float)
    tests = prepare(e.probe, e.observations.placement[e.adjusted.rows], e.context)
    if tests is None:
        return Anomalies(misfits=tuple(misfits(e.probe, sizes, e.noise_px, {}, e.context)))
    fixed = fixed_focal_lengths(e)
    moves = [move for move in find_moves(e.probe, tests) if move.statistic > fixed[move.camera]]
    moves = moves if credible(moves, len(sizes)) else []
    known = {}
    for move in moves:
        rows, moved = rows_of(e.probe, e.observations.placement[e.adjusted.rows], move)
        known[move.camera] = pose_values(e.probe, rows, moved)
    fields = misfits(e.probe, sizes, e.noise_px, known, e.context)
    return Anomalies(
        tuple(beyond_the_lens(moves, fields)),
        misfits=tuple(fields),
        least_shift=least_visible(e.probe, tests),
        scatter=scatters(e.probe, tests),
    )


def scale_finding(source: Literal["waved-bar", "certified-board", "board"], relative: float) -> Finding:
    """How good the scale is, in millimetres on a length that a user can picture."""
    values = {"mm": relative * run_checks.STATED_LENGTH_MM, "length_mm": run_checks.STATED_LENGTH_MM}
    if source == "board":  # stretched by 0.3 %, lengths were 11 times U off where its own error was left out
        return Finding("print-unmeasured", "warning", values | {"percent": 100 * UNMEASURED_PRINT}, kind=source)
    return Finding("scale-uncertainty", "info", values, kind=source)


def _convergence(fit: Fit, what: Shown) -> list[Finding]:
    if not fit.adjusted.joint:
        return [Finding("no-joint-adjustment", "error", kind=what)]
    found = [] if fit.adjusted.minimum.converged else [Finding("not-converged", "error", kind=what)]
    degenerate = Finding("degenerate-geometry", "error", kind=what)
    return found if fit.adjusted.covariance is not None else [*found, degenerate]


def _weak(session: Session, fit: Fit, what: Shown) -> list[Finding]:
    adjusted, problem = fit.adjusted, fit.adjusted.model.problem
    columns = problem.intrinsic_columns
    if adjusted.covariance is None or not len(columns) or columns[0] != 0:
        return []
    cofactors = np.maximum(adjusted.covariance.cameras[:, POSE, POSE], 0.0)
    sd = np.sqrt(adjusted.variance * cofactors) / adjusted.state.intrinsics[:, 0]
    free = problem.free_intrinsics[:, 0] & fit.placed & ~adjusted.has_prior
    return run_checks.weak_focal_lengths(session, free, sd, what)


def _outliers(session: Session, fit: Fit) -> list[Finding]:
    candidates = np.isfinite(fit.residual[:, 0])
    out = candidates & ~fit.adjusted.used
    count, share = int(out.sum()), float(out.sum() / max(candidates.sum(), 1))
    if not count:
        return []
    by_camera = np.bincount(fit.observations.camera[out], minlength=len(session.cameras))
    most = int(np.argmax(by_camera))
    values = {"out": count, "observations": candidates.sum(), "percent": 100 * share, "most": by_camera[most]}
    return [run_checks.outliers(values, share > MANY_OUTLIERS, session.cameras[most].id)]
