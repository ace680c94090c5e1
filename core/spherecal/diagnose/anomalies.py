"""Effects in the solved network that its model does not contain: cameras that moved, lenses beyond the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.ball_model import Free
from spherecal.adjust.bundle import MIN_ANGLE_RAD, datum_defect
from spherecal.adjust.covariance import covariance
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.network import Network
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import NO_LENGTHS, NO_PRIORS
from spherecal.ball.fit import BallFit
from spherecal.ball.image_poses import solve_images
from spherecal.ball.rigid import BallNetwork
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.memory import release_freed
from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import STAGE, Evidence
from spherecal.diagnose.group_motion import GroupMotion, find_group_motion, unstable_camera
from spherecal.diagnose.moves import (
    Move,
    confirmed,
    credible,
    differ,
    find_moves,
    least_visible,
    pose_values,
    prepare,
    rows_of,
    scatters,
)
from spherecal.diagnose.pose_graph import EXPLAINED, explain
from spherecal.diagnose.score import Misfit, ScoreTest, change_of, make_score_test, misfits

# What the tried fields do not follow of a lens looks like moves that change the image by up to 0.8 times the misfit.
MORE_THAN_LENS = 3.0

# Moves that shift image points by more bend the network too much to judge lenses before they are repaired.
SMALL_PX = 3.0
# One camera's images that move by so many times what their points are off have poses that they hardly determine: by 169
# px, where points were off by 0.1 (seed 1548). Cameras that shook, sank or were late by 0.1 to 3 mm: 0.9 to 4.1 times.
UNSEEN = 20.0


@dataclass(frozen=True)
class Anomalies:
    """Moved cameras and misfits; `in_shape` says that the rigid form has more of them than the free one explains.

    `explained`: the motions, read from the images' own poses, are all that is wrong with poses and placements.
    `least_shift` (c,2): what a camera must have moved to be found, in network units (`least_visible`). `scatter` (c,):
    how many times more the poses of a camera's images differ than noise lets them (`scatters`).
    """

    moves: tuple[Move, ...] = ()
    group_motion: GroupMotion | None = None
    misfits: tuple[Misfit, ...] = ()
    in_shape: bool = False
    explained: bool = False
    least_shift: FloatArray | None = None
    scatter: FloatArray | None = None


def find_anomalies(e: Evidence, contradicting: bool = False) -> Anomalies:
    """The changes that the solved network requires; none where it is singular or has no misfit.

    Moves and misfits come from score tests (score.py). Where images differ or contradict each other, or the rigid form
    fits too badly, the images' own poses are asked too, and go before these (decision 0009).
    """
    probe = e.probe
    if probe is None:
        return Anomalies()
    placement = e.observations.placement[e.adjusted.rows]
    e.context.report(STAGE, 0.1)
    sizes = np.array([camera.image_size for camera in e.session.cameras], dtype=float)
    tests = prepare(probe, placement, e.context)
    moves, suspicious, shifts, scatter = [], False, None, None
    if tests is not None:
        moves, suspicious, shifts = find_moves(probe, tests), differ(probe, tests), least_visible(probe, tests)
        scatter = scatters(probe, tests)
    del tests  # 75 MB of 100 cameras at 36 placements
    release_freed()
    fields = _fields(e, probe, placement, moves, sizes)
    if e.solved.rigid is not None and (suspicious or contradicting or e.choice.beyond):
        context = e.context.part_of(STAGE, 0.3)
        every, counts = np.ones(len(e.used), dtype=bool), (len(e.observations.placements), len(e.session.placements))
        ball = BallNetwork(_free_network(e), e.features, *counts, every)
        found = explained_by_moves(ball, e.solved, context)
        if found.group_motion is not None and _is_seen(e, found.group_motion):
            return replace(found, explained=True, least_shift=shifts)
        if found.moves:
            small = all(move.image_change_px <= SMALL_PX for move in found.moves)
            fields = _fields(e, probe, placement, list(found.moves), sizes) if small else []
            beyond = tuple(beyond_the_lens(found.moves, fields))
            return Anomalies(beyond, None, tuple(fields), explained=bool(beyond), least_shift=shifts)
    in_shape = False
    if (moves or fields) and e.solved.rigid is not None:  # may be the ball's shape, which the free form does not know
        free = _free_form(e)
        if free is not None:
            before = len(fields) + len(moves)
            moves = confirmed(*free, moves)
            fields = _fields(e, *free, moves, sizes)
            in_shape = len(fields) + len(moves) <= before / 2
    moves = beyond_the_lens(moves, fields) if credible(moves, probe.problem.n_cameras) else []
    return Anomalies(tuple(moves), None, tuple(fields), in_shape, least_shift=shifts, scatter=scatter)


def _is_seen(e: Evidence, motion: GroupMotion) -> bool:
    """Whether one camera's image points are off at all as they are after such a motion."""
    if len(motion.cameras) != 1:
        return True
    o = e.observations
    off = np.linalg.norm(e.residual_px, axis=1)
    own = (o.camera == motion.cameras[0]) & e.candidates & np.isfinite(off)
    by_image = [off[own & (o.placement == t)] for t in motion.placements]
    medians = [float(np.median(of_image)) for of_image in by_image if len(of_image)]
    return motion.image_change_px < UNSEEN * max(medians, default=np.inf)


def beyond_the_lens(moves: Sequence[Move], fields: Sequence[Misfit]) -> list[Move]:
    """The moves that shift image points by more than their cameras' lenses deviate from the model."""
    lens = {m.camera: m.rms_px for m in fields}
    return [move for move in moves if move.image_change_px > MORE_THAN_LENS * lens.get(move.camera, 0.0)]


def explained_by_moves(
    ball: BallNetwork, fit: BallFit, context: Context, most_variance: float | None = None
) -> Anomalies:
    """What moved, if moves alone and no change of the ball's shape explain the misfit; else nothing.

    Free points hide much of a move, which then passes for a change of shape: on rig B 16 % of the moves by 0.5 to 50 mm
    were named wrongly. The images' own poses know of neither (decision 0009).
    """
    state, alignment = fit.by_features.state, ball.aligned(fit.by_features.state.points)
    network = replace(ball.network, free=ball.network.free & ~fit.has_prior[:, None], priors=NO_PRIORS)
    images = solve_images(replace(ball, network=network), state, fit.placed, alignment, context)
    if images is None or (most_variance is not None and images.variance > most_variance):
        return Anomalies()
    found = explain(images, context)
    if found is None or found.is_simple:
        return Anomalies(() if found is None else found.moves)
    suffices = found.variance_factor <= EXPLAINED and credible(list(found.moves), int(fit.placed.sum()))
    once = len({move.camera for move in found.moves}) == len(found.moves)
    own = (ball.features.placement == np.bincount(alignment.root).argmax()) & np.isfinite(state.points[:, 0])
    middle = state.points[own].mean(axis=0) if own.any() else np.zeros(3)  # of the dots, in the ball's frame
    group = find_group_motion(images, middle, found.fitted if suffices and once else None, context)
    if group is None and suffices and not once:
        group = unstable_camera(found)
    return Anomalies(found.moves if suffices and group is None else (), group)


def _fields(e: Evidence, probe: ScoreTest, placement: IntArray, moves: list[Move], sizes: FloatArray) -> list[Misfit]:
    """Misfits of all cameras with the moves included in the model, as long as these are credible."""
    known: dict[int, FloatArray] = {}
    for move in moves if credible(moves, probe.problem.n_cameras) else []:
        rows, moved = rows_of(probe, placement, move)
        values = pose_values(probe, rows, moved)
        probe = probe.after(rows, values, change_of(*probe.block(rows, values), probe.variance))
        known[move.camera] = np.concatenate([known.get(move.camera, values[:, :, :0]), values], axis=2)
    return misfits(probe, sizes, e.noise_px, known, e.context.part_of(STAGE, 0.2))


def _free_network(e: Evidence) -> Network:
    return replace(
        e.solved.network, feature=e.features.of_observation, n_features=len(e.features), ball=Free(), lengths=NO_LENGTHS
    )


def _free_form(e: Evidence) -> tuple[ScoreTest, IntArray] | None:
    """The free form of a network that was solved in the rigid one, and its rows' placements; None without a misfit."""
    network = _free_network(e)
    state = e.solved.by_features.state
    used = e.used & (network.views(e.used) >= 2)[network.feature]
    used &= (network.triangulated(state, used).max_angle_rad >= MIN_ANGLE_RAD)[network.feature]
    if not used.any():
        return None
    problem, rows = network.problem(used, network.free, e.solved.placed, weighted=True)
    redundancy = problem.rows - problem.unknowns + datum_defect(problem)
    if redundancy <= 0:
        return None
    known = replace(state, points=np.where(np.isfinite(state.points), state.points, 0.0))
    minimum = minimise(problem, known, Settings(max_iterations=10), lambda *_: e.context.report(STAGE, 0.5))
    cofactors = covariance(problem, minimum.state)
    if cofactors is None:
        return None
    probe = make_score_test(problem, minimum.state, cofactors, minimum.cost, redundancy)
    return probe, e.observations.placement[rows]


# --- A lens that was zoomed or focused again during the recording looks like a camera that is unsteady, or moved ---

# One factor explains this much of what a pose for each of the camera's images does: all of it where a focal length
# changed by 0.1 %. A zoom of all cameras explains 0.1 to 0.5 of it, cameras on a beam that sags 0.02 to 0.1.
MOST_BY_FOCUS = 0.8


def focus_change(e: Evidence, motion: GroupMotion) -> list[Finding]:
    """The finding on one camera's focal length that changed before a placement, where this is what seems to move."""
    probe = e.probe
    if probe is None or len(motion.cameras) != 1:
        return []
    (camera,) = motion.cameras
    rows = np.flatnonzero(probe.problem.camera == camera)
    placement, weight = e.observations.placement[e.adjusted.rows][rows], probe.problem.weight[rows]
    centred = ((probe.problem.uv[rows] - e.adjusted.state.intrinsics[camera, 2:4]) * weight)[:, :, None]
    seen, image = np.unique(placement, return_inverse=True)
    poses = np.zeros((len(rows), 2, len(seen), POSE))
    poses[np.arange(len(rows)), :, image] = probe.by_pose(rows)
    by_poses = change_of(*probe.block(rows, poses.reshape(len(rows), 2, -1)), probe.variance).statistic
    changes = {
        int(first): change_of(*probe.block(rows, centred * (placement >= first)[:, None, None]), probe.variance)
        for first in seen[1:]
    }
    if not changes:
        return []
    first, best = max(changes.items(), key=lambda one: one[1].statistic)
    if best.statistic < MOST_BY_FOCUS * by_poses:
        return []
    name, place = e.camera_ids[camera], e.observations.placements[first]
    values = {"camera": name, "place": place, "percent": 100 * float(best.value[0]), "chi_square": best.statistic}
    return [Finding("focus-changed", "error", values, (name, place))]
