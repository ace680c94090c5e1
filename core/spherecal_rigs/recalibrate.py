"""Some cameras calibrated again, the others locked, with what their covariance follows."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherecal.adjust.bundle import MIN_ANGLE_RAD, usable_features
from spherecal.adjust.network import Network
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.state import State
from spherecal.ball.fit import Run, solve_free
from spherecal.ball.rigid import ModelChoice
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.context import Context, Stopwatch
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.threads import on_one_blas_thread
from spherecal.calibrate import calibrate
from spherecal.data.lens_model import like
from spherecal.data.observations import find_features
from spherecal.data.rig import Calibration, CameraCovariance, CameraSigma, Quality, Rig, RigCamera
from spherecal.data.rig_camera import posed
from spherecal.data.session import Recording, Session
from spherecal.detect.session_images import observed
from spherecal.geometry.length_uncertainty import Cameras, LengthMap, Volume, length_map
from spherecal.geometry.transform import fit_similarity
from spherecal.geometry.triangulation import triangulate
from spherecal.initialise.incremental import InitialPoses, resect_camera
from spherecal.initialise.local import LocalNetwork, reconstruct_locally
from spherecal.result.build_result import build_failed_result, build_result
from spherecal.scale.metric import MetricFit, Solution, fit_spheres
from spherecal.steps.ball_stages import describe_network
from spherecal.steps.selection import ball_network, select_ball_model
from spherecal.steps.settings import CalibrationSettings
from spherecal_verify.consistency import camera_normal
from spherecal_verify.departures import volume_box
from spherecal_verify.outlying_views import triangulate_checked
from spherecal_verify.verify_bars import views_of

What = Literal["all", "pose", "intrinsics"]


def followed_covariance(
    session: Session, rig: Rig, before: CameraCovariance, cameras: tuple[str, ...], what: What
) -> CameraCovariance:
    """All cameras' covariance: what is new of `cameras` has its own noise and the locked cameras' errors."""
    o = session.observations
    assert o is not None
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    in_rig = np.array([index.get(name, -1) for name in o.cameras], dtype=np.int64)
    own = o.select((o.placement < len(session.placements)) & (in_rig[o.camera] >= 0))
    features = find_features(own)
    views, expected = views_of(own, features, in_rig[own.camera], rig)
    checked = triangulate_checked(views, expected)
    normal = camera_normal(views, checked.kept, replace(rig, covariance=before))
    w = POSE + len(before.intrinsics)
    own_columns = {"pose": np.arange(POSE), "intrinsics": np.arange(POSE, w), "all": np.arange(w)}[what]
    free = np.concatenate([index[name] * w + own_columns for name in cameras])
    rest = np.setdiff1d(np.arange(len(normal)), free)
    inverse = np.linalg.pinv(normal[np.ix_(free, free)], rcond=1e-12, hermitian=True)
    follow = np.zeros((len(normal), len(normal)))
    follow[rest, rest] = 1.0
    follow[np.ix_(free, rest)] = -inverse @ normal[np.ix_(free, rest)]
    matrix = follow @ before.matrix @ follow.T
    matrix[np.ix_(free, free)] += checked.noise**2 * inverse
    return CameraCovariance((matrix + matrix.T) / 2, before.intrinsics)


def with_sigma(rig: Rig, i: int, cameras: tuple[str, ...]) -> RigCamera:
    """A camera with what is new of it and the standard uncertainties from the covariance."""
    camera, covariance = rig.cameras[i], rig.covariance
    if covariance is None or camera.id not in cameras:
        return camera
    w = POSE + len(covariance.intrinsics)
    own = covariance.matrix[i * w : (i + 1) * w, i * w : (i + 1) * w]
    centre = camera.rotation.T @ own[3:POSE, 3:POSE] @ camera.rotation
    intrinsics = np.zeros(16)
    intrinsics[covariance.intrinsics] = _root(own)[POSE:]
    sigma = CameraSigma(np.degrees(_root(own)[:3]), _root(centre), intrinsics)
    return replace(camera, sigma=sigma)


def _root(matrix: FloatArray) -> FloatArray:
    return np.sqrt(np.maximum(np.diag(matrix), 0.0))


def map_as_before(rig: Rig, before: Rig) -> LengthMap | None:
    """The map of a length's uncertainty in the volume of the former map, if there was one."""
    if before.length_map is None or rig.covariance is None or rig.reference_camera != before.reference_camera:
        return None
    box = volume_box(before, (np.zeros(3), np.ones(3)))
    cameras = Cameras(
        np.array([c.intrinsics for c in rig.cameras]), np.array([c.rotation for c in rig.cameras]),
        np.array([c.translation_mm for c in rig.cameras]), np.array([c.image_size for c in rig.cameras], dtype=float),
        rig.covariance.matrix, rig.covariance.intrinsics, tuple(c.field for c in rig.cameras),
    )  # fmt: skip
    return length_map(cameras, Volume(box.middle, box.axes, box.half), before.length_map.sigma_px)


def without_map(quality: Quality) -> Quality:
    """The findings without the one on lengths, which does not include the locked cameras' uncertainty."""
    return replace(quality, findings=tuple(f for f in quality.findings if f.code != "length-uncertainty"))


@dataclass(frozen=True)
class Selection:
    """Which cameras to calibrate (ids), and what to estimate for them; all others stay as in the rig."""

    cameras: tuple[str, ...]
    what: What = "all"


@on_one_blas_thread
def recalibrate(
    session: Session,
    rig: Rig,
    selection: Selection,
    settings: CalibrationSettings | None = None,
    context: Context | None = None,
) -> Calibration:
    """The rig with the selected cameras recalibrated, frame and scale of the locked (else the first locked) ones."""
    settings, context, watch = settings or CalibrationSettings(), context or Context(), Stopwatch()
    rig = _with_reference(rig, selection)
    _check(session, rig, selection)
    session, lenses = observed(session, context), {camera.id: camera.intrinsics for camera in rig.cameras}
    session = replace(session, cameras=tuple(like(camera, lenses[camera.id]) for camera in session.cameras))
    session = without_fields(session, rig)
    watch.lap("detection")
    selected = np.array([camera.id in selection.cameras for camera in session.cameras])
    before = _state(session, rig)
    recording = Recording.of(session)
    observations, features = recording.observations, recording.features
    local = reconstruct_locally(observations, features, before.intrinsics, settings.seed, context)
    if not local.triples:
        return build_failed_result(recording, local, settings.method, watch.seconds)
    reference = next(i for i, camera in enumerate(session.cameras) if camera.id == rig.reference_camera)
    network = replace(describe_network(recording, settings), sizes=None)  # the rig's fields hold
    free = network.free & selected[:, None] & (selection.what != "pose")
    # a locked camera's intrinsics are its own, whatever group it was calibrated in
    group = np.where(selected, network.group, network.group.max() + 1 + np.arange(len(selected)))
    network = replace(network, free=free, group=group, locked=~selected | (selection.what == "intrinsics"))
    start = _start(network, before, selected, selection.what, local)
    watch.lap("start values")

    run = Run(before.intrinsics, reference, context=context, watch=watch)
    fit = solve_free(network, start, local.keep & start.placed[network.camera], run)
    choice = ModelChoice("free", Phrase("form-asked-alone"))
    if settings.method in ("auto", "soft", "rigid"):
        ball = ball_network(recording, network, local, fit)
        fit, choice = select_ball_model(recording, fit, ball, settings, run)
    watch.lap("bundle adjustment")
    # the locked cameras are in millimetres; their own uncertainty is not part of the result
    state, cofactors = fit.by_features.state, fit.cofactors
    spheres = fit_spheres(state.points, features.placement, len(session.placements))
    cameras = None if cofactors is None else fit.adjusted.variance * cofactors.all_cameras()
    solution = Solution(state, cofactors, 1.0, rig.scale, spheres, cameras)
    done = build_result(recording, local, MetricFit(fit, choice, solution), "selected", run)
    done = replace(done, rig=_with_uncertainties(session, done.rig, rig, selection))
    return with_fields(done, rig)


def _with_uncertainties(session: Session, now: Rig, before: Rig, selection: Selection) -> Rig:
    """The rig with the locked cameras' uncertainties as they were, which the selected ones inherit."""
    kept = {camera.id: camera for camera in before.cameras if camera.id not in selection.cameras}
    cameras = tuple(replace(c, sigma=kept[c.id].sigma) if c.id in kept else c for c in now.cameras)
    now = replace(now, cameras=cameras, covariance=None, length_map=None, quality=without_map(now.quality))
    placed = [camera.id for camera in before.cameras]
    if before.covariance is None or [camera.id for camera in cameras] != placed:
        return now
    mended = tuple(name for name in placed if name in selection.cameras)
    covariance = followed_covariance(session, now, before.covariance, mended, selection.what)
    now = replace(now, covariance=covariance)
    now = replace(now, cameras=tuple(with_sigma(now, i, mended) for i in range(len(cameras))))
    return replace(now, length_map=map_as_before(now, before))


def without_fields(session: Session, rig: Rig) -> Session:
    """The session with its image points as the lens models of the rig's cameras alone predict them."""
    o = session.observations
    fields = {camera.id: camera.field for camera in rig.cameras if camera.field is not None}
    if o is None or not fields:
        return session
    uv = o.uv.copy()
    for c, name in enumerate(o.cameras):
        if name in fields:
            uv[o.camera == c] -= fields[name].at(uv[o.camera == c])
    return replace(session, observations=replace(o, uv=uv))


def with_fields(done: Calibration, rig: Rig) -> Calibration:
    """A calibration of such a session with the rig's fields, and with the image points as measured."""
    fields = {camera.id: camera.field for camera in rig.cameras if camera.field is not None}
    if not fields:
        return done
    cameras = tuple(replace(camera, field=fields.get(camera.id)) for camera in done.rig.cameras)
    uv = done.observations.uv.copy()
    for c, name in enumerate(done.observations.cameras):
        if name in fields:
            own = done.observations.camera == c
            uv[own] = fields[name].measured(uv[own])
    observations = replace(done.observations, uv=uv)
    return replace(done, rig=replace(done.rig, cameras=cameras), observations=observations)


def _with_reference(rig: Rig, selection: Selection) -> Rig:
    """The rig in the frame of its reference camera; without one, of the first camera that stays."""
    first = next((camera for camera in rig.cameras if camera.id not in selection.cameras), None)
    if rig.reference_camera is not None or first is None:
        return rig
    moved = []
    for camera in rig.cameras:
        rotation = camera.rotation @ first.rotation.T
        moved.append(
            replace(camera, rotation=rotation, translation_mm=camera.translation_mm - rotation @ first.translation_mm)
        )
    moved[rig.cameras.index(first)] = replace(first, rotation=np.eye(3), translation_mm=np.zeros(3))
    return replace(rig, reference_camera=first.id, cameras=tuple(moved))


def _check(session: Session, rig: Rig, selection: Selection) -> None:
    known, recorded = {camera.id for camera in rig.cameras}, {camera.id for camera in session.cameras}
    unknown = sorted(set(selection.cameras) - recorded)
    if unknown or not selection.cameras:
        values = {"folder": session.where, "names": unknown, "cameras": sorted(recorded)}
        raise InputError(Phrase("error-no-such-cameras" if unknown else "error-none-selected", values))
    if missing := sorted(recorded - known):
        raise InputError(Phrase("error-rig-lacks-cameras", {"cameras": missing}))
    if len(recorded - set(selection.cameras)) < 2 or rig.reference_camera not in recorded:
        raise InputError(Phrase("error-few-remain"))
    if rig.scale.source == "none":
        raise InputError(Phrase("error-rig-no-scale"))


def _state(session: Session, rig: Rig) -> State:
    """The rig's cameras in the session's order."""
    cameras = [rig.camera(spec.id) for spec in session.cameras]
    found = [camera for camera in cameras if camera is not None]
    return State(
        np.array([c.rotation for c in found]),
        np.array([c.translation_mm for c in found]),
        np.array([c.intrinsics for c in found]),
        np.zeros((0, 3)),
    )


def _start(network: Network, before: State, selected: BoolArray, what: What, local: LocalNetwork) -> InitialPoses:
    """The rig before; selected cameras are resected from the points of the locked ones, where possible."""
    rows = local.keep & ~selected[network.camera]
    points, good = usable_features(network, replace(before, points=np.zeros((network.n_features, 3))), rows)
    state = replace(before, points=np.where(good[:, None], points, np.nan))
    rotation, translation = state.rotation.copy(), state.translation.copy()
    for camera in np.flatnonzero(selected) if what != "intrinsics" else []:
        seen = np.isfinite(state.points[network.feature, 0]) & local.keep & (network.camera == camera)
        pose = resect_camera(network, state, int(camera), np.flatnonzero(seen))
        if pose is not None:
            rotation[camera], translation[camera] = pose
    return InitialPoses(replace(state, rotation=rotation, translation=translation), np.ones(len(selected), dtype=bool))


STAGE = "cross-validation"


@dataclass(frozen=True)
class LeftOut:
    """One placement measured with the rig that the others gave.

    `rms_px`: how well its image points agree with that rig (2-D rms of triangulated dots). `shape_rms_mm`: how far its
    dots then are from where the whole session has them, after the best rigid motion. `length_error`: the relative
    difference in size. All three are None where the others do not give a valid rig, or fewer than four dots can be
    compared.
    """

    placement: str
    dots: int
    rms_px: float | None
    shape_rms_mm: float | None
    length_error: float | None


@on_one_blas_thread
def cross_validate(
    session: Session, settings: CalibrationSettings | None = None, context: Context | None = None
) -> tuple[Calibration, tuple[LeftOut, ...]]:
    """The calibration of the whole session, and every placement compared with the rig that the others give."""
    settings, context = settings or CalibrationSettings(), context or Context()
    if len(session.placements) < 3:
        values = {"folder": session.where, "placements": len(session.placements)}
        raise InputError(Phrase("error-few-placements", values))
    session = observed(session, context)
    whole = calibrate(session, settings, context)
    found = []
    for number, placement in enumerate(session.placements):
        context.report(STAGE, number / len(session.placements), Phrase("without", {"place": placement.id}))
        o = session.observations
        assert o is not None
        without = replace(session, observations=o.select(o.placement != number))
        found.append(_left_out(placement.id, number, whole, calibrate(without, settings, context).rig))
    context.report(STAGE, 1.0)
    return whole, tuple(found)


def _left_out(placement: str, number: int, whole: Calibration, rig: Rig) -> LeftOut:
    o = whole.observations
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    camera = np.array([index.get(name, -1) for name in o.cameras])[o.camera]
    rows = np.flatnonzero((o.placement == number) & whole.used & (camera >= 0))
    if not rig.quality.valid or not len(rows):
        return LeftOut(placement, 0, None, None, None)
    own = o.select(rows)
    features = find_features(own)
    weight = np.ones((len(own), 2)) if own.sigma is None else 1.0 / own.sigma**2
    points = triangulate(features.of_observation, camera[rows], own.uv, weight, len(features), posed(rig.cameras))
    full = whole.features.of_observation[rows]
    place = np.full((len(features), 3), np.nan)
    place[features.of_observation] = whole.points_mm[full]
    good = points.in_front & (points.max_angle_rad >= MIN_ANGLE_RAD) & np.isfinite(place[:, 0])
    if good.sum() < 4:
        return LeftOut(placement, int(good.sum()), None, None, None)
    sized = fit_similarity(place[good], points.points[good])
    rigid = fit_similarity(place[good], points.points[good], with_scale=False)
    off = np.linalg.norm(rigid.apply(place[good]) - points.points[good], axis=1)
    residual = points.residual[good[features.of_observation]]
    rms_px, shape_rms_mm = float(np.sqrt((residual**2).sum(axis=1).mean())), float(np.sqrt((off**2).mean()))
    return LeftOut(placement, int(good.sum()), rms_px, shape_rms_mm, sized.scale - 1.0)
