"""Every image with a pose of its own relative to the ball: valid however cameras and ball were moved.

Only the ball's shape and the lenses are common to the images. So neither a camera that moved nor a placement that is
mixed up spoils anything; a ball that changed its shape does. What the images say of their poses together is kept as
normal equations, from which `diagnose.pose_graph` reads which cameras did not move.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spherecal.adjust import engine
from spherecal.adjust.bundle import RobustStep, refine, residual_size, robust_adjustment, robust_start, triangulated
from spherecal.adjust.least_squares import normal_equations
from spherecal.adjust.linear import Linearisation
from spherecal.adjust.network import Network, free_network
from spherecal.adjust.parameter_layout import POSE, symmetric
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.ball.rigid import Alignment, BallNetwork
from spherecal.base.arrays import BoolArray, FloatArray, IntArray, sum_by
from spherecal.base.context import Context
from spherecal.base.threads import one_blas_thread
from spherecal.data.observations import Features
from spherecal.geometry.transform import IDENTITY, Similarity
from spherecal.initialise.incremental import InitialPoses, adjust_placed, resect_rest

# An image with fewer points has no pose of its own worth having.
LEAST_POINTS = 8
# The normal matrix of so many images takes 26 MB; more cameras and placements are left to the linear tests.
MOST_IMAGES = 300
# Once every image has its pose, most points are off by less than this unless a large move has bent a lens (0.03 to
# 0.5 px; 2 px and more).
FIXED_LENS_MISFIT_PX = 1.0


@dataclass(frozen=True)
class ImagePoses:
    """Poses x_camera = rotation (m,3,3) @ x_ball + translation (m,3) of all images, each of a camera at a placement.

    - `points` (m,): number used of each.
    - `normal` (6m,6m): what turns (rad, applied to the whole pose) and shifts in the cameras' frames add to v'Pv,
      lenses and dots following.
    - `by_pose_px2` (m,6,6): the squares by which they shift the image's own points.
    - `variance`: of unit weight; `n_cameras`: of the rig, with images or without.
    """

    camera: IntArray
    placement: IntArray
    points: IntArray
    rotation: FloatArray
    translation: FloatArray
    normal: FloatArray
    by_pose_px2: FloatArray
    variance: float
    n_cameras: int

    def of(self, camera: int, placements: Collection[int]) -> BoolArray:
        """Which images (m,) are a camera's at some placements."""
        return (self.camera == camera) & np.isin(self.placement, list(placements))

    def change_px(self, rows: IntArray, change: FloatArray) -> float:
        """By how much (rms per axis, px) changes of pose (k,6) shift the points of some images (k,)."""
        steps = np.broadcast_to(change, (len(rows), POSE))
        squares = float(np.einsum("ni,nij,nj->", steps, self.by_pose_px2[rows], steps))
        return float(np.sqrt(squares / (2 * max(int(self.points[rows].sum()), 1))))


def images_of(network: Network, features: Features, rows: IntArray, n_ball: int) -> Network:
    """The network of images of the ball that does not move, of rows (k,): image = camera * n_ball + placement."""
    image = network.camera[rows] * n_ball + features.placement[network.feature[rows]]
    dots = np.stack([features.target, features.point], axis=1)[network.feature[rows]]
    dot = np.unique(dots, axis=0, return_inverse=True)[1].reshape(-1)
    free, group = np.repeat(network.free, n_ball, axis=0), np.repeat(network.group, n_ball)
    images = free_network(dot, image, network.uv[rows], int(dot.max(initial=-1)) + 1, free, group)
    return replace(images, sigma=network.sigma[rows], noise=np.repeat(network.noise, n_ball))


def solve_images(
    ball: BallNetwork, state: State, placed: BoolArray, alignment: Alignment, context: Context
) -> ImagePoses | None:
    """The images' own poses from a rig's; None where there are too many, or too few for a statement."""
    network, features, n_ball = ball.network, ball.features, ball.n_ball
    roots = alignment.root[:n_ball]
    together = roots == np.bincount(roots).argmax()
    of_ball = features.placement[network.feature] < n_ball
    linked = of_ball & together[np.where(of_ball, features.placement[network.feature], 0)]
    images = images_of(network, features, np.flatnonzero(placed[network.camera] & linked), n_ball)
    enough = np.bincount(images.camera, minlength=len(images.group)) >= LEAST_POINTS
    if together.sum() < 2 or enough.sum() > MOST_IMAGES:
        return None
    rotation = np.einsum("cij,tjk->ctik", state.rotation, alignment.rotation[:n_ball])
    translation = np.einsum("cij,tj->cti", state.rotation, alignment.translation[:n_ball]) + state.translation[:, None]
    lenses, unknown = np.repeat(state.intrinsics, n_ball, axis=0), np.full((images.n_features, 3), np.nan)
    start = State(rotation.reshape(-1, 3, 3), translation.reshape(-1, 3), lenses, unknown)
    start, used = _settled(images, start, enough, context)
    fit = refine(images, start, used, enough, context)
    own = np.flatnonzero(np.bincount(fit.problem.camera, minlength=len(enough)))
    linear = engine.linearise(fit.problem, fit.state, None)
    normal = _of_poses(fit.problem, fit.state, linear, own)
    if normal is None or fit.redundancy <= 0 or not fit.minimum.converged:
        return None
    points = np.bincount(fit.problem.camera, minlength=len(enough))[own]
    by_pose = linear.by_camera[:, :, :POSE] / fit.problem.weight[:, :, None]
    squares = sum_by(fit.problem.camera, by_pose.transpose(0, 2, 1) @ by_pose, fit.problem.n_cameras)
    poses = fit.state.rotation[own], fit.state.translation[own]
    return ImagePoses(own // n_ball, own % n_ball, points, *poses, normal, squares[own], fit.variance, len(placed))


def _settled(images: Network, start: State, enough: BoolArray, context: Context) -> tuple[State, BoolArray]:
    """The images near their minimum, and the observations (n,) that fit: poses alone, and lenses if these were bent."""
    candidates = enough[images.camera]
    state = triangulated(images, start, candidates)
    state = robust_adjustment(images, state, candidates, enough, RobustStep((), stage="moved cameras"), context)
    state = triangulated(images, state, candidates)
    used = candidates & np.isfinite(state.points[images.feature, 0])
    if _fits(images, state, candidates, enough):
        return state, used
    return robust_start(images, start, candidates, enough, context)


def _fits(images: Network, state: State, candidates: BoolArray, enough: BoolArray) -> bool:
    """Whether every image shows the dots where it is said to: one of few points may have found a wrong pose."""
    judged = np.flatnonzero(candidates & np.isfinite(state.points[images.feature, 0]))
    off = np.bincount(images.camera[judged], residual_size(images, state)[judged] >= FIXED_LENS_MISFIT_PX, len(enough))
    return bool((2 * off < np.bincount(images.camera[judged], minlength=len(enough)))[enough].all())


def _of_poses(problem: Problem, state: State, linear: Linearisation, images: IntArray) -> FloatArray | None:
    """The normal matrix of the images' poses with dots and lenses eliminated; None where lenses are not determined."""
    layout = problem.layout
    with one_blas_thread():
        whole = symmetric(normal_equations(problem, state, linear, 0.0).matrix)
        poses = layout.column[layout.block_offset[images][:, None] + np.arange(POSE)].ravel()
        lenses = np.setdiff1d(np.arange(layout.size), poses)
        size = 1 / np.sqrt(whole.diagonal()[lenses])
        cross = whole[np.ix_(lenses, poses)] * size[:, None]
        try:
            factor = cho_factor(whole[np.ix_(lenses, lenses)] * size[:, None] * size)
        except (LinAlgError, ValueError):
            return None
        normal = whole[np.ix_(poses, poses)] - cross.T @ cho_solve(factor, cross)
    return (normal + normal.T) / 2


def hang_together(
    images: dict[tuple[int, int], Similarity],
    points: dict[tuple[int, int], int],
    cameras: dict[int, Similarity],
    placements: dict[int, Similarity],
) -> None:
    """Add cameras and placements that images lead to: the best one of which one end is known first."""
    while True:
        open_ended = [(c, t) for c, t in images if (c in cameras) != (t in placements)]
        if not open_ended:
            return
        c, t = max(open_ended, key=points.__getitem__)
        if c in cameras:
            placements[t] = cameras[c].inverse.after(images[c, t])
        else:
            cameras[c] = images[c, t].after(placements[t].inverse)


def known_intrinsics(images: Network) -> Network:
    """The images for start values: nothing of their lenses is estimated, all points weigh the same."""
    count, free = len(images.group), np.zeros_like(images.free)
    return replace(images, sigma=np.ones_like(images.uv), noise=np.ones(count), free=free, group=np.arange(count))


# --- the ball at rest ------------------------------------------------------------------------------------------------
#
# Groups of cameras that share no view all see the same ball, each from its side and turned from placement to
# placement. As seen from the ball, which does not move, their images overlap. One after the other is resected from
# the dots that those before it located, until all are connected. It remains to compute the ball's pose at each
# placement and the poses of the cameras of the other groups. In the groups' own frames too few dots are often located
# at two placements to align anything. With two times three cameras facing each other, that way linked 30 of 48
# recordings, this way 48.

# A camera of no group, which no two others share enough dots with, is resected too where it has so many. Five cameras
# around a ball, one every 72 degrees, had some 1,000 each in three placements, 320 to 496 in common with a neighbour,
# and no three of them 20.
LEAST_ALONE = 100
# Images that are linked together: the placements with most dots take part, and the others follow once the cameras are
# placed. The normal matrix of so many takes 100 MB; all 1,224 of 34 cameras at 36 placements took 4.4 GB.
MOST_LINKED = 600


def link_camera_groups(
    ball: BallNetwork, groups: list[InitialPoses], alignment: Alignment, context: Context
) -> tuple[InitialPoses, Alignment]:
    """Start values of all cameras that the ball's shape links, and how the placements are connected."""
    network, placement = ball.network, ball.features.placement[ball.network.feature]
    on_ball = ball.candidates & (placement < ball.n_ball)
    count = np.bincount(network.camera[on_ball], minlength=len(network.group))
    known = np.any([group.placed for group in groups], axis=0) | (count >= LEAST_ALONE)
    if not (known & ~groups[0].placed).any():
        return groups[0], alignment
    rows = on_ball & known[network.camera]
    dots = np.bincount(placement[rows], minlength=ball.n_ball)
    taken = np.sort(np.argsort(-dots, kind="stable")[: max(MOST_LINKED // len(known), 2)])  # in order, those seen most
    n_ball = len(taken)
    rows &= np.isin(placement, taken)
    renumbered = replace(ball.features, placement=np.searchsorted(taken, ball.features.placement))
    images = known_intrinsics(images_of(network, renumbered, np.flatnonzero(rows), n_ball))
    count = np.bincount(images.camera, minlength=len(images.group)).reshape(-1, n_ball)
    root, first = _first(images, groups, n_ball)
    every = np.ones(len(images.uv), dtype=bool)
    first = InitialPoses(adjust_placed(images, first.state, first.placed, every, context), first.placed)
    resected = resect_rest(images, first, every, context, lambda now: _whole_groups(now, groups, n_ball))
    return _rig(groups[0], resected, count, alignment, root, taken)


def _first(images: Network, groups: list[InitialPoses], n_ball: int) -> tuple[int, InitialPoses]:
    """The placement of which the first group sees most, and that group's images of it with their poses."""
    camera, placement = np.divmod(images.camera, n_ball)
    main = groups[0]
    twice = [(images.views(main.placed[camera] & (placement == t)) >= 2).sum() for t in range(n_ball)]
    root = int(np.argmax(twice))
    intrinsics = main.state.intrinsics.copy()
    for group in groups[1:]:
        intrinsics[group.placed] = group.state.intrinsics[group.placed]
    cameras = (main.state.rotation, main.state.translation, intrinsics)
    rotation, translation, lenses = (np.repeat(x, n_ball, axis=0) for x in cameras)
    state = State(rotation, translation, lenses, np.full((images.n_features, 3), np.nan))
    placed = np.repeat(main.placed, n_ball) & np.tile(np.arange(n_ball) == root, len(main.placed))
    return root, InitialPoses(state, placed)


def _whole_groups(now: InitialPoses, groups: list[InitialPoses], n_ball: int) -> InitialPoses:
    """Poses of whole groups: one camera's pose gives the others', once two of them have given the group's scale."""
    rotation, translation = now.state.rotation.copy(), now.state.translation.copy()
    placed = now.placed.reshape(-1, n_ball).copy()
    for group in groups:
        size = _size(now, group, n_ball)
        if size is None:
            continue
        members = np.flatnonzero(group.placed)
        for t in np.flatnonzero(placed[members].any(axis=0) & ~placed[members].all(axis=0)).tolist():
            leader = members[np.argmax(placed[members, t])].item()
            ball = _pose(group.state, leader, size).inverse.after(_pose(now.state, leader * n_ball + t))
            for c in members[~placed[members, t]].tolist():
                pose = _pose(group.state, c, size).after(ball)
                rotation[c * n_ball + t], translation[c * n_ball + t] = pose.rotation, pose.translation
            placed[members, t] = True
    return InitialPoses(replace(now.state, rotation=rotation, translation=translation), placed.reshape(-1))


def _size(now: InitialPoses, group: InitialPoses, n_ball: int) -> float | None:
    """The size of a group in the ball's frame relative to its own, from the distances between its cameras."""
    members = np.flatnonzero(group.placed)
    at_each = [(t, members[now.placed[members * n_ball + t]]) for t in range(n_ball)]
    sizes = [_spread(now.state, c * n_ball + t) / _spread(group.state, c) for t, c in at_each if len(c) >= 2]
    return float(np.median(sizes)) if sizes else None


def _spread(state: State, cameras: IntArray) -> float:
    """Root mean square distance of some cameras' centres from their middle."""
    centres = -np.einsum("cji,cj->ci", state.rotation[cameras], state.translation[cameras])
    return float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _pose(state: State, camera: int, size: float = 1.0) -> Similarity:
    return Similarity(1.0, state.rotation[camera], size * state.translation[camera])


def _rig(
    start: InitialPoses, resected: InitialPoses, count: IntArray, alignment: Alignment, root: int, taken: IntArray
) -> tuple[InitialPoses, Alignment]:
    """Cameras and taken placements (t,) from the images' poses, each from the image with most dots (count (c,t))."""
    n_ball = count.shape[1]
    placed = resected.placed.reshape(-1, n_ball) & (count > 0)
    image = {(c, t): _pose(resected.state, c * n_ball + t) for c, t in np.argwhere(placed).tolist()}
    cameras = {c: _pose(start.state, c) for c in np.flatnonzero(start.placed).tolist()}
    placements = {root: IDENTITY}
    hang_together(image, {at: int(count[at]) for at in image}, cameras, placements)
    rotation, translation = start.state.rotation.copy(), start.state.translation.copy()
    placed = start.placed.copy()
    for c, pose in cameras.items():
        rotation[c], translation[c], placed[c] = pose.rotation, pose.translation, True
    lenses = resected.state.intrinsics[::n_ball]
    state = replace(start.state, rotation=rotation, translation=translation, intrinsics=lenses)
    roots = np.arange(len(alignment.root))
    ball_rotation, ball_translation = alignment.rotation.copy(), alignment.translation.copy()
    for t, pose in placements.items():
        ball_rotation[taken[t]], ball_translation[taken[t]] = pose.rotation, pose.translation
        roots[taken[t]] = taken[root]
    linked = replace(alignment, root=roots, rotation=ball_rotation, translation=ball_translation)
    return InitialPoses(state, placed), linked
