"""The ball at rest: every image is a camera of its own that looks at one ball.

Groups of cameras that share no view all see the same ball, each from its side and turned from placement to placement.
As seen from the ball, which does not move, their images overlap. One after the other is resected from the dots that
those before it located, until all are connected. It remains to compute the ball's pose at each placement and the
poses of the cameras of the other groups. In the groups' own frames too few dots are often located at two placements
to align anything. With two times three cameras facing each other, that way linked 30 of 48 recordings, this way 48.
"""

from dataclasses import replace

import numpy as np

from spherecal.adjust.network import Network
from spherecal.adjust.state import State
from spherecal.ball.image_poses import hang_together, images_of, known_intrinsics
from spherecal.ball.rigid import Alignment, BallNetwork
from spherecal.base.arrays import IntArray
from spherecal.base.context import Context
from spherecal.geometry.transform import IDENTITY, Similarity
from spherecal.initialise.incremental import InitialPoses, adjust_placed, resect_rest

# A camera of no group, which no two others share enough dots with, is resected too where it has so many. Five cameras
# around a ball, one every 72 degrees, had some 1,000 each in three placements, 320 to 496 in common with a neighbour,
# and no three of them 20.
LEAST_ALONE = 100
# Images that are linked together: the placements with most dots take part, and the others follow once the cameras are
# placed. The normal matrix of so many takes 100 MB; all 1,224 of 34 cameras at 36 placements took 4.4 GB.
MOST_IMAGES = 600


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
    taken = np.sort(np.argsort(-dots, kind="stable")[: max(MOST_IMAGES // len(known), 2)])  # in order, those seen most
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
