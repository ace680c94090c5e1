"""The classical method: a board (or rigid figure) in many placements; cameras alone, chained, adjusted together."""

from dataclasses import replace
from functools import cache

import numpy as np

from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.context import Context, Stopwatch
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.lens_model import estimated_intrinsics
from spherecal.data.observations import Features, Observations
from spherecal.data.rig import Calibration, RigScale
from spherecal.data.session import UNMEASURED_PRINT, Recording, Session
from spherecal.diagnose.camera_findings import FLIPS, Flip, flipped
from spherecal.diagnose.plausibility import implausible
from spherecal.geometry.camera import project
from spherecal.initialise.view_graph import groups_of
from spherecal.result.build_result import unsolved
from spherecal.steps.settings import CalibrationSettings
from spherecal_boards import camera_lag
from spherecal_boards.board_adjustment import (
    BoardNetwork,
    ViewPoses,
    adjust_boards,
    board_points,
    leave_chained,
    residuals_px,
)
from spherecal_boards.board_chain import BoardStart, chain, common_placements, compare_views, find_links, whole
from spherecal_boards.board_findings import Fit, assemble_fit, common_findings, diagnosed, scale_finding, unlinked
from spherecal_boards.board_images import BoardImages, find_boards
from spherecal_boards.board_shape import BoardSolution, estimated_solution, nominal_solution, shape_finding
from spherecal_boards.board_start import LEAST_POINTS, BoardViews, board_views, poses, start_intrinsics, usable_views
from spherecal_boards.frames_evidence import frame_evidence
from spherecal_boards.pattern_entry import board_shape, board_uncertainty, read_board_pattern

METHOD = "board"


def calibrate_board(
    session: Session, settings: CalibrationSettings | None = None, context: Context | None = None
) -> Calibration:
    """The rig by the session's board, from observations or images; without cameras that share no placement, invalid."""
    settings, context, watch = settings or CalibrationSettings(), context or Context(), Stopwatch()
    board = session.board
    if board is None:
        raise InputError(Phrase("error-board-needed", {"folder": session.where}))
    images = None
    if session.observations is None:
        images = find_boards(session, read_board_pattern(session), context)
        session = replace(session, observations=images.observations)
        watch.lap("detection")
    observations, point, foreign = _on_board(session)
    recorded = observations
    points_mm = np.array([p.xyz_mm for p in board])
    views = board_views(observations, points_mm, point)
    free = estimated_intrinsics(session, settings.intrinsics == "free")
    start = _start(session, views, free, context)
    observations, views, start, late = _in_step(session, observations, views, start, free, context)
    point = views.point
    if images is not None and np.isfinite(images.diameter):
        pattern = read_board_pattern(session)
        radius = (pattern.dot_diameter_mm or images.diameter * pattern.pitch_mm) / 2
        views = replace(views, uv=views.uv - eccentricity(views, start.poses, start.intrinsics, radius))
        observations = replace(observations, uv=views.uv)
        start = _start(session, views, free, context)
    watch.lap("each camera alone")

    names = [c.id if settings.own_intrinsics else c.intrinsics_group for c in session.cameras]
    group = np.unique(names, return_inverse=True)[1].reshape(-1)
    findings = [*_about_observations(images, foreign), *late, *implausible(replace(session, observations=recorded))]
    if not start.poses:
        features = _features(observations, session, point, np.zeros(0, dtype=np.int64))[0]
        lost = Finding("nothing-reconstructed", "error", {"least": LEAST_POINTS}, kind="board")
        return unsolved(Recording(session, observations, features), [lost, *findings], METHOD, watch.seconds)
    network, state, groups = _chained(session, views, start, free, group, context)
    placed = np.isfinite(state.translation[:, 0])
    solution, about_shape = _adjusted(session, network, state, start.candidates, context, settings.joint)
    watch.lap("joint adjustment")
    common = common_placements(start.poses, views.n_cameras, views.n_placements)
    findings += unlinked(tuple(camera.id for camera in session.cameras), common, placed, "board", LEAST_POINTS)
    findings += about_shape
    if len(groups) > 1:
        named = [[session.cameras[c].id for c in group] for group in groups]
        findings.append(Finding("groups-of-cameras", "info", {"groups": named}))
    session = replace(session, observations=observations)
    return _result(session, solution, network, placed, findings, watch, context)


def _on_board(session: Session) -> tuple[Observations, IntArray, int]:
    """The placements' observations of board points, the board point of each (n,), and the number of other ones."""
    o, board = session.observations, session.board
    assert o is not None and board is not None
    names = tuple(sorted(set(o.points) | {p.point for p in board}))
    index = {(p.target, names.index(p.point)): i for i, p in enumerate(board)}
    to_new = np.array([names.index(name) for name in o.points], dtype=np.int64)
    o = replace(o, points=names, point=to_new[o.point] if len(o) else o.point)
    on_placement = o.placement < len(session.placements)
    keys = zip(o.target.tolist(), o.point.tolist(), strict=True)
    point = np.fromiter((index.get(key, -1) for key in keys), np.int64, len(o))
    keep = on_placement & (point >= 0)
    if not keep.any():
        raise InputError(Phrase("error-no-board-points", {"folder": session.where}))
    return o.select(keep), point[keep], int((on_placement & (point < 0)).sum())


def _in_step(
    session: Session,
    observations: Observations,
    views: BoardViews,
    start: BoardStart,
    free: BoolArray,
    context: Context,
) -> tuple[Observations, BoardViews, BoardStart, list[Finding]]:
    """The same with what cameras that are behind, ahead or flipped saw put back, and what was."""
    widths = np.array([camera.image_size[0] for camera in session.cameras])

    @cache
    def put_back(camera: int, how: Flip) -> tuple[ViewPoses, float]:
        """The poses by a camera put back, and how far its principal point then is from what is known, px."""
        own = views.camera == camera
        uv = np.where(own[:, None], flipped(views.uv, how, widths[camera]), views.uv)
        alone = _start(session, replace(views, uv=uv), free, context, own)
        return alone.poses, float(np.linalg.norm(alone.intrinsics[camera, 2:4] - session.cameras[camera].prior[2:4]))

    def compare(a: int, b: int, shifted: bool) -> camera_lag.Compared:
        found = compare_views(views, (start.poses, start.poses), start.intrinsics, a, b, shifted)
        if not shifted or found[0] <= camera_lag.AGREE_PX:
            return found
        fits = []
        for how in FLIPS:  # turned by 90 degrees the wrong one may fit too, with another principal point
            seen, off_px = put_back(b, how)
            error = compare_views(views, (start.poses, seen), start.intrinsics, a, b, False)[0]
            if error < min(found[0], camera_lag.AGREE_PX):
                fits.append((off_px, error, how))
        if fits:
            return min(fits)[1], np.zeros_like(found[1]), min(fits)[2]
        for shift in camera_lag.neighbours(views.points_mm):
            own = {
                view: [replace(pose, translation=pose.translation + pose.rotation[:, :2] @ shift) for pose in some]
                for view, some in start.poses.items()
                if view[0] == b
            }
            error = compare_views(views, (start.poses, own), start.intrinsics, a, b, False)[0]
            if error < min(found[0] / camera_lag.BETTER, camera_lag.AGREE_PX):
                return error, np.zeros_like(found[1]), shift
        return found

    lags = camera_lag.find_lags(common_placements(start.poses, views.n_cameras, views.n_placements), compare)
    if not lags:
        return observations, views, start, []
    findings = camera_lag.lag_findings(observations, lags, observations.placements)
    uv = camera_lag.flipped_back(lags, views.camera, views.uv, widths)
    placement, keep = camera_lag.in_step(lags, views.camera, views.placement)
    point, known = _renumbered(lags, views)
    placement, keep = placement[known[keep]], keep[known[keep]]
    observations = replace(observations.select(keep), placement=placement, uv=uv[keep])
    board, views = session.board or (), replace(views, point=point)
    observations = replace(
        observations,
        target=np.array([p.target for p in board])[point[keep]],
        point=np.array([observations.points.index(p.point) for p in board])[point[keep]],
    )
    sigma = None if views.sigma is None else views.sigma[keep]
    views = replace(
        views, placement=placement, camera=views.camera[keep], point=views.point[keep], uv=uv[keep], sigma=sigma
    )
    return observations, views, _start(session, views, free, context), findings


def _renumbered(lags: list[camera_lag.Lag], views: BoardViews) -> tuple[IntArray, BoolArray]:
    """The board point of each observation (n,) with those of shifted cameras put back, and which are on the board."""
    point, known = views.point.copy(), np.ones(len(views), dtype=bool)
    for lag in lags:
        if isinstance(lag.flip, tuple):
            own = np.flatnonzero(views.camera == lag.camera)
            off = views.points_mm[point[own], None, :2] - np.array(lag.flip) - views.points_mm[None, :, :2]
            distance = np.linalg.norm(off, axis=2)
            point[own] = distance.argmin(axis=1)
            known[own] = distance.min(axis=1) < 0.1 * np.linalg.norm(lag.flip)
    return point, known


def _start(
    session: Session, views: BoardViews, free: BoolArray, context: Context, some: BoolArray | None = None
) -> BoardStart:
    usable = usable_views(views, np.ones(len(views), dtype=bool) if some is None else some)
    intrinsics = start_intrinsics(views, usable, session.cameras, free, context)
    found = {view: poses(views, views.of(*view), intrinsics[view[0]]) for view in usable}
    found = {view: some for view, some in found.items() if some}
    candidates = np.zeros(len(views), dtype=bool)
    for view in found:
        candidates[views.of(*view)] = True
    return BoardStart(intrinsics, candidates, found)


def _chained(
    session: Session, views: BoardViews, start: BoardStart, free: BoolArray, group: IntArray, context: Context
) -> tuple[BoardNetwork, State, list[list[int]]]:
    """The network, its state with NaN for cameras and placements that are not linked, and the groups behind it."""
    links = find_links(views, start.poses, start.intrinsics, context)
    known = np.array([camera.prior for camera in session.cameras])
    assumed = np.array(["focal_length" in camera.assumed for camera in session.cameras])
    known = np.where(assumed[:, None], start.intrinsics, known)  # nobody knows better than the first images
    # the camera of the largest linked group that shares most placements with its neighbours
    linked = np.zeros((views.n_cameras, views.n_cameras), dtype=np.int64)
    seen = np.zeros(views.n_cameras, dtype=np.int64)
    for camera, _ in start.poses:
        seen[camera] += 1
    for a, b in links:
        linked[a, b] = sum((a, t) in start.poses and (b, t) in start.poses for t in range(views.n_placements))
    largest = max(groups_of(linked, np.zeros(views.n_cameras, dtype=bool)), key=lambda g: (len(g), seen[g].sum()))
    reference = int(max(largest, key=lambda c: (linked[c].sum(), seen[c], -c)))
    network = BoardNetwork(views, free, group, known, reference)
    state, groups = chain(network, start, links, context)
    placed = np.isfinite(state.translation[:, 0])
    count = np.bincount(views.camera[start.candidates], minlength=len(placed))
    for g in np.unique(group):  # who shares intrinsics starts from one set of them
        members = np.flatnonzero((group == g) & placed)
        if len(members) > 1:
            state.intrinsics[members] = state.intrinsics[members[np.argmax(count[members])]]
    return network, state, groups


def _adjusted(
    session: Session, network: BoardNetwork, state: State, candidates: BoolArray, context: Context, joint: bool
) -> tuple[BoardSolution, list[Finding]]:
    """The joint adjustment with the board's points fixed or estimated, and the findings on its shape."""
    views = network.views
    linked = np.isfinite(state.translation[views.camera, 0])
    linked &= np.isfinite(state.placement_translation[views.placement, 0])
    if not joint:
        return nominal_solution(leave_chained(network, whole(state), candidates & linked, context)), []
    adjusted = adjust_boards(network, whole(state), candidates & linked, linked, context)
    stated = board_shape(session)
    doubts = [] if stated == "estimated" else shape_finding(adjusted)
    if stated == "nominal" or (stated is None and not doubts):
        return nominal_solution(adjusted), doubts
    solution = estimated_solution(network, adjusted, linked, context)
    found = solution.adjusted
    if stated is None and not (solution.tested and found.minimum.converged and found.variance < adjusted.variance):
        return nominal_solution(adjusted), doubts
    kind = "asked" if stated else "by-itself"
    return solution, [Finding("board-shape-estimated", "info", {"off_mm": solution.print_mm}, kind=kind)]


def _features(
    observations: Observations, session: Session, point: IntArray, placements: IntArray
) -> tuple[Features, IntArray, IntArray]:
    """Features: all board points at `placements`, and all others observed; their placement and board point."""
    board = session.board
    assert board is not None
    count = len(board)
    key = np.union1d(observations.placement * count + point, (placements[:, None] * count + np.arange(count)).ravel())
    placement, of_board = (part.astype(np.int64) for part in np.divmod(key, count))
    target = np.array([p.target for p in board])[of_board]
    name = np.array([observations.points.index(p.point) for p in board])[of_board]
    order = np.lexsort((name, target, placement))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    of_observation = rank[np.searchsorted(key, observations.placement * count + point)]
    features = Features(placement[order], target[order], name[order], of_observation)
    return features, placement[order], of_board[order]


def _result(
    session: Session,
    solution: BoardSolution,
    network: BoardNetwork,
    placed: BoolArray,
    findings: list[Finding],
    watch: Stopwatch,
    context: Context,
) -> Calibration:
    observations, adjusted, views = session.observations, solution.adjusted, network.views
    state, used, covariance = adjusted.state, adjusted.used, adjusted.covariance
    assert observations is not None
    residual = residuals_px(views, state)
    placed = placed & (np.bincount(views.camera[used], minlength=len(placed)) > 0)
    frame, point, _ = board_points(views, used)
    shown = np.unique(frame)
    residual[~(placed[views.camera] & np.isin(views.placement, shown))] = np.nan
    features, placement, of_board = _features(observations, session, views.point, shown)
    position = np.full((views.n_placements, len(views.points_mm)), -1)
    position[frame, point] = np.arange(len(frame))
    at = position[placement, of_board]
    points = np.einsum("pij,pj->pi", state.placement_rotation[placement], state.points[of_board])
    points = np.where((at >= 0)[:, None], points + state.placement_translation[placement], np.nan)
    cofactor = np.full((len(features), 3, 3), np.nan)
    if covariance is not None:
        cofactor = np.where((at >= 0)[:, None, None], covariance.points[at], np.nan)
    tested, lenses = solution.tested, (network.free, network.group)
    fit = Fit(observations, features, network.reference, placed, adjusted, points, cofactor, residual, tested, *lenses)
    scale = RigScale("board", None)
    if covariance is not None and np.isfinite(adjusted.variance):
        own = board_uncertainty(session)
        noise = float(np.hypot(np.sqrt(adjusted.variance) * covariance.relative_scale, solution.print_relative))
        relative = float(np.hypot(noise, UNMEASURED_PRINT if own is None else own))
        scale = RigScale("board", relative)
        findings = [*findings, scale_finding("board" if own is None else "certified-board", relative)]
    evidence = frame_evidence(session, fit, scale, "rigid", context)
    findings = [*findings, *common_findings(session, fit, "board"), *diagnosed(evidence, "board")]
    watch.lap("diagnosis")
    return assemble_fit(evidence, session, fit, scale, findings, METHOD, watch.seconds)


def _about_observations(images: BoardImages | None, foreign: int) -> list[Finding]:
    found = []
    if images is not None and images.missed:
        shown = [Phrase("camera-at", {"camera": camera, "place": place}) for place, camera in images.missed[:8]]
        values = {"missed": len(images.missed), "images": images.images, "shown": shown}
        where = tuple(sorted({camera for _, camera in images.missed}))
        kind = "more" if len(images.missed) > 8 else "all"
        found.append(Finding("board-not-found", "info", values, where, kind=kind))
    if foreign:
        found.append(Finding("not-on-board", "warning", {"observations": foreign}))
    return found


def eccentricity(views: BoardViews, poses: ViewPoses, intrinsics: FloatArray, radius_mm: float) -> FloatArray:
    """Centre of the ellipse minus image of the centre, (n,2) px, for dots of one radius; 0 where no pose is known.

    A circle's dual about C with radii a, b is a a' + b b' - C C'; the ellipse's centre is its image's third column.
    """
    out = np.zeros_like(views.uv)
    for (camera, placement), found in poses.items():
        if not found:
            continue
        rows, pose = views.of(camera, placement), found[0]
        centre = views.points_mm[views.point[rows]] @ pose.rotation.T + pose.translation
        a, b = radius_mm * pose.rotation[:, 0], radius_mm * pose.rotation[:, 1]
        dual = np.outer(a, a) + np.outer(b, b) - centre[:, :, None] * centre[:, None]
        middle = np.column_stack([dual[:, :2, 2] / dual[:, 2:3, 2], np.ones(len(rows))])
        out[rows] = project(middle, intrinsics[camera]) - project(centre, intrinsics[camera])
    return out
