"""The complete result: rig, points, residuals, spheres and findings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherecal.adjust.ball_model import Rigid
from spherecal.adjust.bundle import Adjustment
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.ball.ball_shape import shape_cofactors
from spherecal.ball.fit import BallFit, Run
from spherecal.base.arrays import BoolArray, FloatArray, blocks
from spherecal.base.memory import release_freed
from spherecal.base.messages.catalogue import phrase
from spherecal.data.findings import Finding, Findings
from spherecal.data.observations import Features, Observations
from spherecal.data.rig import (
    Affected,
    BallShape,
    Calibration,
    CameraCovariance,
    CameraSigma,
    Form,
    PlacedSphere,
    Quality,
    Rig,
    RigCamera,
    RigScale,
)
from spherecal.data.rig_camera import posed
from spherecal.data.session import CameraSpec, Recording
from spherecal.data.verdict import affected, is_valid, ruled, widening
from spherecal.diagnose.ball_changes import SizeChange, possible_sizes, size_change
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.run_checks import STOPPED, run_checks, unlinked
from spherecal.diagnose.scale_findings import bar_doubt
from spherecal.diagnose.soundness import further_scale_uncertainty
from spherecal.diagnose.sticker_size import sticker_doubt
from spherecal.geometry.camera import N_INTRINSICS, project
from spherecal.geometry.field_table import FieldTable
from spherecal.geometry.length_uncertainty import Cameras, LengthMap, length_map, measured_volume
from spherecal.geometry.sphere import fit_sphere
from spherecal.initialise.local import LocalNetwork
from spherecal.result import camera_effects as effects
from spherecal.result.widening import Uncertain, by_findings, drifting, either_lens, either_pose, either_size
from spherecal.scale.bar_scale import within_growth
from spherecal.scale.metric import MetricFit, Solution

# Where the typical length is more uncertain than this share of it, uncertainties to first order say little: of eight
# cameras above a plane that was only shifted (203 mm on 500) two were 14 times their U off.
MOST_UNCERTAIN = 0.1
# Of U: a ball off its nominal diameter by this is 3 standard uncertainties off.
COVERED_DIAMETER = 1.5
# Of U: what a move shifts points by, k = 2, adds 5 % to U, in quadrature. Four of 170 realistic recordings were refused
# for moves of 0.02 to 0.14 of it: what a drift of 5 um, or coma out of focus, does to single images. Four of 300 others
# were for motions of up to 0.2 of it in several images.
COVERED_MOVE = 1 / 3
# What moves images by more is no drift: what a beam bent by 2 mm is itself so uncertain that it "covers" that.
# Of the realistic ones none was above 0.3 px.
COVERED_PX = 0.5
# A camera that is late at each image is off by up to four times what its images are, since no pose of it suits them all
# (the ball displaced by 0.05 mm: 0.2 mm off).
PULLED = 4.0
MOVES = ("camera-moved", "cameras-moved", "camera-unsteady")
# Findings on what parts of the recording disagree by: fields that are held are a cause of that.
OF_PARTS = ("poses-scatter", "parts-disagree")


def build_result(recording: Recording, local: LocalNetwork, fit: MetricFit, method: str, run: Run) -> Calibration:
    """The calibration of a recording from its metric solution."""
    session, observations, features = recording.session, recording.observations, recording.features
    solved, choice, solution, adjusted = fit.solved, fit.choice, fit.solution, fit.solved.adjusted
    reference = run.reference_in(adjusted)
    measured, observations = observations, replace(observations, uv=solved.network.uv)
    corrections, used = solved.network.corrections, adjusted.used
    placed = _observed(observations, solved)
    residual = _residuals(observations, features, placed, solution)
    recorded, judged = (session, observations, features), _for_diagnosis(solved)
    evidence = Evidence(*recorded, local, placed, judged, choice, solution, residual, used, run.context)
    lasting = placed & np.array([camera.earlier_pose_of is None for camera in session.cameras])
    every = {c: _camera(recording, fit, residual, c) for c in np.flatnonzero(placed).tolist()}
    cameras, earlier = (tuple(every[c] for c in np.flatnonzero(some).tolist()) for some in (lasting, placed & ~lasting))
    rig = Uncertain(cameras, _camera_covariance(lasting, adjusted, solution))
    ball_size = size_change(evidence)
    uv = {session.cameras[c].id: measured.uv[used & (measured.camera == c)] for c in every}
    motions = effects.image_motions(session, observations.placements, corrections)
    found = run_checks(evidence) + fit.findings + _said_of_size(ball_size, evidence)
    findings = ruled(_all_said(found, effects.effects_findings(cameras, motions, uv)))
    release_freed()
    names = [camera.id for camera in cameras]
    share = effects.not_of_fields(corrections, solution.covariance, len(placed))[lasting]
    parts, others = ([f for f in findings if (f.code in OF_PARTS) == by_parts] for by_parts in (True, False))
    grown = zip(widening(parts, names, choice.form), widening(others, names, choice.form), strict=True)
    factor, of_poses = (np.maximum(np.sqrt(1 + (part**2 - 1) * share), other) for part, other in grown)
    findings = ruled(within_growth(findings, float(factor.max(initial=1.0))))
    ball_size = ball_size or possible_sizes(evidence, float(factor.max(initial=1.0)))
    of_size = ball_size.largest if ball_size else 0.0
    further = [further_scale_uncertainty(evidence), of_size, sticker_doubt(findings), bar_doubt(findings)]
    doubt = float(np.linalg.norm(further))
    scale = _doubted(solution.scale, doubt)
    rig = by_findings(rig, of_poses, factor, solution.scale, scale)
    rig = replace(rig, cameras=effects.shared_with_fields(rig.cameras, uv))
    rig = either_pose(rig, evidence, findings)
    known = solution.state.points[np.isfinite(solution.state.points[:, 0])]
    middle = known.sum(axis=0) / max(len(known), 1)
    rig = drifting(rig, effects.turn_sds(corrections, np.flatnonzero(lasting), adjusted.variance), middle)
    rig = either_lens(rig, evidence, findings)
    if ball_size is not None:
        from_middle = np.array([camera.centre_mm for camera in cameras]) - middle
        rig = either_size(rig, ball_size.by_camera[:, lasting], ball_size.largest * from_middle)
    lengths = None
    if solution.scale.source != "none":
        noise = dot_noise_px(observations, used, adjusted.variance)
        lengths = map_of_lengths(rig.cameras, rig.covariance, known, noise)
        findings, moved = _moves_within_lengths(findings, rig.cameras, lengths, middle)
        rig = drifting(rig, moved, middle)
        lengths = map_of_lengths(rig.cameras, rig.covariance, known, noise) if moved.any() else lengths
    findings = _ball_within_lengths(findings, lengths, 2 * doubt)
    findings = ruled([*findings, *_said_of(lengths), *_missed(lengths, session.wanted_uncertainty_mm)])
    sigma0 = _sigma0(observations, residual, adjusted) if adjusted.redundancy > 0 else None
    weak = _weak_region(lengths, session.wanted_uncertainty_mm)
    quality = quality_of(residual[used], sigma0, findings, names, weak)
    rig_of_all = Rig(
        session.cameras[reference].id if placed[reference] else None,
        rig.cameras,
        scale,
        quality,
        session.input_sha256,
        rig.covariance,
        lengths,
        earlier_poses=earlier,
        recorded_at=session.recorded_at,
        form=Form(choice.form, phrase(choice.reason), choice.shape_sd_mm, choice.stated),
    )
    sigma = _points_sigma(fit, observations, features, lasting, factor)
    views = np.bincount(features.of_observation[used], minlength=len(features))
    of_points, of_rows = (solution.state.points, sigma, views), (residual, used)
    spheres = tuple(
        PlacedSphere(session.placements[p].id, sphere.centre, sphere.radius, sphere.radial_sd)
        for p, sphere in solution.spheres.items()
    )
    of_run, ball = (method, run.watch.seconds), _ball_shape(observations, features, solved, solution)
    done = Calibration(rig_of_all, measured, features, *of_points, *of_rows, spheres, *of_run, ball, motions)
    return stopped_early(done) if fit.stopped else done


def cameras_of(recording: Recording, fit: MetricFit) -> list[RigCamera]:
    """The rig's cameras as they are adjusted, without residuals, uncertainties and fields."""
    placed, specs = _observed(recording.observations, fit.solved), recording.session.cameras
    lasting = [c for c in np.flatnonzero(placed).tolist() if specs[c].earlier_pose_of is None]
    return [placed_camera(specs[c], fit.solution.state, c, np.zeros((0, 2)), None, None) for c in lasting]


def _observed(observations: Observations, solved: BallFit) -> BoolArray:
    """Cameras (c,) with a pose, and with observations that were used."""
    seen = np.bincount(observations.camera[solved.adjusted.used], minlength=len(solved.placed))
    return solved.placed & (seen > 0)


def quality_of(
    residual: FloatArray, sigma0: float | None, findings: Findings, names: Sequence[str], region: Affected | None = None
) -> Quality:
    """How good a fit is, by the residuals (n,2) px of the observations that it used, and what was found."""
    size = np.linalg.norm(residual, axis=1)
    size = size[np.isfinite(size)]  # not those of points behind a camera
    rms, mean = (float(np.sqrt((size**2).mean())), float(size.mean())) if len(size) else (None, None)
    return Quality(is_valid(findings), rms, mean, sigma0, findings, affected(findings, names, region))


def stopped_early(done: Calibration) -> Calibration:
    """The calibration with the finding that somebody stopped the work behind it; it is not valid."""
    quality = done.rig.quality
    if STOPPED in quality.findings:
        return done
    quality = replace(quality, valid=False, findings=(STOPPED, *quality.findings))
    return replace(done, rig=replace(done.rig, quality=quality))


def _points_sigma(
    fit: MetricFit, observations: Observations, features: Features, lasting: BoolArray, factor: FloatArray
) -> FloatArray:
    """Standard uncertainties (p,3) mm of points: what cameras add to a point's own noise is wider as these are.

    `lasting` (c,): cameras of which `factor` is, in order; others, former poses, have the largest. Of a point's cameras
    the rms of its observations counts.
    """
    adjusted, covariance = fit.solved.adjusted, fit.solution.covariance
    if covariance is None:
        return np.full((len(features), 3), np.nan)
    of_camera = np.full(len(lasting), factor.max(initial=1.0))
    of_camera[lasting] = factor
    used, count = adjusted.used, len(features)
    point, squared = features.of_observation[used], of_camera[observations.camera[used]] ** 2
    wider = np.bincount(point, squared, count) / np.maximum(np.bincount(point, minlength=count), 1)
    whole, noise = (np.einsum("pii->pi", one) for one in (covariance.points, covariance.own_noise))
    cofactors = whole + (wider.clip(min=1.0) - 1)[:, None] * (whole - noise).clip(min=0.0)
    return np.sqrt(np.maximum(adjusted.variance * cofactors, 0.0)) * fit.solution.factor


def _doubted(scale: RigScale, doubt: float) -> RigScale:
    if scale.relative_uncertainty is None or not doubt:
        return scale
    return replace(scale, relative_uncertainty=float(np.hypot(scale.relative_uncertainty, doubt)))


def _all_said(found: Sequence[Finding], of_effects: Findings) -> list[Finding]:
    """All findings; where the ball moves between the exposures of most cameras, no camera alone is unsteady."""
    moves = any(f.code == "camera-drifts" and f.kind == "most" for f in of_effects)
    return [*(f for f in found if not (moves and f.code == "camera-unsteady")), *of_effects]


def _said_of_size(size: SizeChange | None, e: Evidence) -> Findings:
    if size is None:
        return ()
    radii = [sphere.radius for sphere in e.solution.spheres.values()]
    return (size.finding(e.observations.placements, 2 * float(np.median(radii)) if radii else 0.0),)


def _weak_region(lengths: LengthMap | None, wanted_mm: float | None) -> Affected | None:
    """The box about the places of the map where lengths are more uncertain than is wanted, or not seen at all."""
    if lengths is None or wanted_mm is None:
        return None
    weak = lengths.places_mm[~(lengths.expanded_mm <= wanted_mm).all(axis=1)]
    if not len(weak):
        weak = lengths.places_mm
    low, high = ([float(x) for x in corner.round(3)] for corner in (weak.min(axis=0), weak.max(axis=0)))
    return Affected(region_mm=((low[0], low[1], low[2]), (high[0], high[1], high[2])))


def _ball_shape(observations: Observations, features: Features, fit: BallFit, solution: Solution) -> BallShape | None:
    """The shape of a rigid ball, centred in it; None where the ball has none of its own, or no scale."""
    rigid, cofactors = fit.rigid, fit.cofactors
    has_shape = isinstance(fit.network.ball, Rigid) and solution.scale.source != "none"
    if rigid is None or cofactors is None or not has_shape:
        return None
    root = rigid.alignment.root[features.placement]
    moved = rigid.alignment.moved
    home = int(np.bincount(rigid.alignment.root[moved]).argmax())
    point = rigid.places.point
    seen = np.diff(fit.adjusted.problem.point_start) > 0
    first = np.unique(point[(root == home) & seen[point]])
    feature = np.full(len(seen), -1)
    feature[point] = np.arange(len(point))
    places = fit.adjusted.state.points[first] * solution.factor
    sphere = fit_sphere(places)
    scatter = shape_cofactors(cofactors, fit.adjusted.state.points, first)
    named = feature[first]
    points = tuple(observations.points[i] for i in features.point[named])
    middle = places.mean(axis=0) if sphere is None else sphere.centre
    in_mm2 = fit.adjusted.variance * solution.factor**2
    return BallShape(features.target[named], points, places - middle, scatter * in_mm2, solution.scale)


def _for_diagnosis(fit: BallFit) -> BallFit:
    """The form in which faults are visible: the solution itself, or the free form instead of the soft one."""
    if fit.free is None:
        cofactors = None if fit.cofactors is None else fit.cofactors.given_effects
        return replace(fit, cofactors=cofactors)
    free = fit.free.adjusted
    converged = free.minimum.converged and fit.adjusted.minimum.converged
    return replace(fit.free, adjusted=replace(free, minimum=replace(free.minimum, converged=converged)))


def build_failed_result(
    recording: Recording, local: LocalNetwork, method: str, seconds: dict[str, float]
) -> Calibration:
    """The result where not even three cameras could be reconstructed: no camera has a pose."""
    lost = Finding("nothing-reconstructed", "error", kind="ball")
    apart = unlinked(recording.observations, local.counts, [], np.zeros(len(recording.session.cameras), dtype=bool))
    return unsolved(recording, [lost, *apart], method, seconds)


def unsolved(recording: Recording, findings: Sequence[Finding], method: str, seconds: dict[str, float]) -> Calibration:
    """The result where no camera could be placed."""
    observations, features = recording.observations, recording.features
    quality = Quality(False, None, None, None, tuple(findings))
    rig = Rig(None, (), RigScale("none", None), quality, recording.session.input_sha256)
    unknown, views = np.full((len(features), 3), np.nan), np.zeros(len(features), dtype=np.int64)
    of_rows = np.full((len(observations), 2), np.nan), np.zeros(len(observations), dtype=bool)
    return Calibration(rig, observations, features, unknown, unknown, views, *of_rows, (), method, seconds)


def _residuals(observations: Observations, features: Features, placed: BoolArray, solution: Solution) -> FloatArray:
    """Predicted minus observed (n,2) px, NaN without a prediction."""
    state = solution.state
    every = np.flatnonzero(placed[observations.camera] & np.isfinite(state.points[features.of_observation, 0]))
    residual = np.full((len(observations), 2), np.nan)
    for some in blocks(len(every)):
        rows = every[some]
        camera, points = observations.camera[rows], state.points[features.of_observation[rows]]
        x = np.einsum("nij,nj->ni", state.rotation[camera], points) + state.translation[camera]
        residual[rows] = project(x, state.intrinsics[camera]) - observations.uv[rows]
    return residual


def _sigma0(observations: Observations, residual: FloatArray, adjusted: Adjustment) -> float:
    """The standard deviation of unit weight with the observations' own sigmas as weights, or 1 px where there are none.

    The adjustment's own has weights by camera besides. In the soft form the dots' shape noise is observed too, as zero.
    """
    weighted = residual[adjusted.used]
    if observations.sigma is not None:
        weighted = weighted / observations.sigma[adjusted.used]
    shape_sd, shape_residual = adjusted.problem.ball.shape_sd, adjusted.state.shape_residual
    tied = shape_sd > 0
    ties = float(((shape_residual[tied] / shape_sd[tied, None]) ** 2).sum())
    return float(np.sqrt(((weighted**2).sum() + ties) / adjusted.redundancy))


def _camera(recording: Recording, fit: MetricFit, residual: FloatArray, c: int) -> RigCamera:
    """Camera c of the session as calibrated; `residual` (n,2) px of all observations."""
    spec, adjusted, solution, sigma = recording.session.cameras[c], fit.solved.adjusted, fit.solution, None
    if solution.covariance is not None:
        cofactors = solution.covariance.cameras[c] * adjusted.variance
        sigma = camera_sigma(cofactors, solution.state.rotation[c], adjusted.problem, c, solution.factor)
    own = residual[adjusted.used & (recording.observations.camera == c)]
    field = effects.lens_field(fit.solved, solution.covariance, c, spec.image_size)
    return placed_camera(spec, solution.state, c, own, sigma, field)


def placed_camera(
    spec: CameraSpec, state: State, c: int, residual: FloatArray, sigma: CameraSigma | None, field: FieldTable | None
) -> RigCamera:
    """The camera as calibrated, of index c in the state; `residual` (n,2) px of its observations that were used."""
    known = residual[np.isfinite(residual[:, 0])]
    rms = float(np.sqrt((known**2).sum(axis=1).mean())) if len(known) else None
    pose = state.intrinsics[c], state.rotation[c], state.translation[c]
    return RigCamera(spec.id, spec.serial, spec.image_size, *pose, rms, len(residual), sigma, field)


def camera_sigma(
    covariance: FloatArray, rotation: FloatArray, problem: Problem, c: int, factor: float = 1.0
) -> CameraSigma:
    """Standard uncertainties of a camera's pose and intrinsics, by their covariance (w,w) (datum: conventions.md)."""
    centre = rotation.T @ covariance[3:POSE, 3:POSE] @ rotation * factor**2
    diagonal = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    columns, intrinsics = problem.intrinsic_columns, np.zeros(N_INTRINSICS)
    intrinsics[columns] = np.where(problem.free_intrinsics[c, columns], diagonal[POSE:], 0.0)
    return CameraSigma(np.rad2deg(diagonal[:3]), np.sqrt(np.maximum(np.diag(centre), 0.0)), intrinsics)


def _camera_covariance(placed: BoolArray, adjusted: Adjustment, solution: Solution) -> CameraCovariance | None:
    if solution.cameras is None:
        return None
    width = len(solution.cameras) // len(placed)
    keep = np.repeat(placed, width)
    return CameraCovariance(solution.cameras[np.ix_(keep, keep)], adjusted.problem.intrinsic_columns)


def map_of_lengths(
    cameras: tuple[RigCamera, ...], covariance: CameraCovariance | None, points: FloatArray, noise_px: float
) -> LengthMap | None:
    """The map of a length's uncertainty over points (m,3) mm that were shown; None where none can be measured."""
    known = np.isfinite(points[:, 0])
    if covariance is None or known.sum() < 2 or len(cameras) < 2:
        return None
    sizes, fields = np.array([c.image_size for c in cameras], dtype=float), tuple(c.field for c in cameras)
    looking = Cameras(
        **vars(posed(cameras)), size=sizes, covariance=covariance.matrix, columns=covariance.intrinsics, fields=fields
    )
    volume = measured_volume(points[known], np.array([c.centre_mm for c in cameras]))
    return length_map(looking, volume, noise_px)


def _said_of(lengths: LengthMap | None) -> Findings:
    if lengths is None or lengths.typical_mm is None or lengths.worst is None:
        return ()
    worst, place = lengths.worst
    values = {
        "length_mm": lengths.length_mm, "typical_mm": lengths.typical_mm, "k": lengths.coverage_factor,
        "worst_mm": worst, "place_mm": place,
    }  # fmt: skip
    said = (Finding("length-uncertainty", "info", values),)
    hardly = lengths.typical_mm > MOST_UNCERTAIN * lengths.length_mm
    return (*said, Finding("degenerate-geometry", "error", values, kind="hardly")) if hardly else said


def _ball_within_lengths(findings: Findings, lengths: LengthMap | None, doubt: float) -> Findings:
    """The findings; a ball off its nominal diameter by less than lengths are uncertain by says nothing about the scale.

    Not turned, behind lenses off by 0.06 and 0.12 px: 5.1 and 7.4 mm, where lengths of that size had U of 13 and 14 mm
    (realistic recordings 1080, 1084). Within 1.5 U the scale's uncertainty covers it: five recordings were right by 2.2
    to 10.6 % of 1.0 to 1.5 U, and one of 4.4 U was wrong (1396). `doubt`: the part of U, relatively, that the diameter
    itself calls for.
    """
    if lengths is None or lengths.typical_mm is None:
        return findings
    relative = float(np.sqrt(max((lengths.typical_mm / lengths.length_mm) ** 2 - doubt**2, 0.0)))

    def judged(f: Finding) -> Finding:
        if f.code != "ball-diameter" or f.severity == "info":
            return f
        times = abs(f.values["percent"]) / 100 / max(relative, 1e-12)
        return replace(f, severity="info" if times <= 1 else "warning" if times <= COVERED_DIAMETER else f.severity)

    return tuple(judged(f) for f in findings)


def _moves_within_lengths(
    findings: Findings, cameras: tuple[RigCamera, ...], lengths: LengthMap | None, middle_mm: FloatArray
) -> tuple[Findings, FloatArray]:
    """The findings, and turns (c,) rad of cameras that moved by so little of what lengths are uncertain by.

    Their moves are information: the turns, as far as the rays of each turned between its images, state them.
    """
    turns = np.zeros(len(cameras))
    if lengths is None or lengths.typical_mm is None:
        return findings, turns
    focal = np.array([camera.intrinsics[0] for camera in cameras])
    distance = np.linalg.norm([camera.centre_mm - middle_mm for camera in cameras], axis=1)
    out = list(findings)
    for i, f in enumerate(findings):
        own = np.array([camera.id in f.where for camera in cameras])
        # one that moved before it was split is none of the rig's cameras
        if f.code not in MOVES or not f.values.get("px", np.inf) <= COVERED_PX or not own.any():
            continue
        turn = np.where(own, f.values["px"] / focal, 0.0)
        if 2 * float((turn * distance).max()) <= COVERED_MOVE * lengths.typical_mm:
            turn *= PULLED if f.code == "camera-unsteady" else 1.0
            out[i], turns = replace(f, severity="info"), np.maximum(turns, turn)
    return tuple(out), turns


def _missed(lengths: LengthMap | None, wanted_mm: float | None) -> Findings:
    """The finding where some lengths of the map, or all if there is none, are less certain than is wanted."""
    if wanted_mm is None or (lengths is not None and lengths.worst is not None and lengths.worst[0] <= wanted_mm):
        return ()
    if lengths is None or lengths.worst is None:
        return (Finding("accuracy-missed", "warning", {"wanted_mm": wanted_mm}, kind="unknown"),)
    share = float((lengths.expanded_mm > wanted_mm).any(axis=1).mean())
    values = {"wanted_mm": wanted_mm, "worst_mm": lengths.worst[0], "percent": 100 * share}
    return (Finding("accuracy-missed", "warning", {**values, "length_mm": lengths.length_mm}, kind="volume"),)


def dot_noise_px(observations: Observations, used: BoolArray, variance: float) -> float:
    """The standard deviation of a typical dot's image coordinate in px, as the adjustment found it."""
    sigma = 1.0 if observations.sigma is None else float(np.median(observations.sigma[used]))
    return max(float(np.sqrt(variance)) * sigma, 1e-4)
