"""Cameras that moved together, a ball that moved between exposures, a placement of another rig: from images' poses."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from spherecal.adjust.parameter_layout import POSE
from spherecal.ball.image_poses import ImagePoses
from spherecal.base.context import Context
from spherecal.diagnose.group_motion import GroupMotion, GroupSearch, find_group_motion, unstable_camera
from spherecal.diagnose.pose_graph import PoseComposition, explain, fit_layout
from spherecal.geometry.rotation import exp_rotation

CAMERAS, PLACEMENTS = 8, 4
NOISE = np.repeat([2e-5, 0.02], 3)  # of a pose: rad and mm
GROUP = (1, 4, 6)
MOTION = np.array([1e-4, -2e-4, 1e-4, 0.3, -0.2, 0.3])


def images(
    moved: dict[tuple[int, int], np.ndarray] | None = None,
    seed: int = 1,
    noise: float = 1.0,
    cameras: int = CAMERAS,
    placements: int = PLACEMENTS,
) -> ImagePoses:
    """Cameras about a ball at some places; `moved` (camera, placement): motion (6,) of the ball that the image sees."""
    rng = np.random.default_rng(seed)
    looks, turns = exp_rotation(rng.normal(size=(cameras, 3))), exp_rotation(rng.normal(size=(placements, 3)))
    away, places = rng.normal([0.0, 0.0, 1500.0], 200.0, (cameras, 3)), rng.normal(0.0, 150.0, (placements, 3))
    own = np.array([(c, t) for c in range(cameras) for t in range(placements)])
    rotation, translation = [], []
    for c, t in own:
        step = np.zeros(6) if moved is None else moved.get((int(c), int(t)), np.zeros(6))
        turn, shift = exp_rotation(step[:3]) @ turns[t], exp_rotation(step[:3]) @ places[t] + step[3:]
        turn, shift = looks[c] @ turn, looks[c] @ shift + away[c]
        off = noise * rng.normal(size=6) * NOISE
        rotation.append(exp_rotation(off[:3]) @ turn)
        translation.append(exp_rotation(off[:3]) @ shift + off[3:])
    m = len(own)
    return ImagePoses(
        own[:, 0],
        own[:, 1],
        np.full(m, 100),
        np.array(rotation),
        np.array(translation),
        np.diag(np.tile(1 / NOISE**2, m)),
        np.tile(np.diag([1e6] * 3 + [1.0] * 3), (m, 1, 1)),
        1.0,
        cameras,
    )


def found(some: ImagePoses) -> GroupMotion | None:
    return find_group_motion(some, np.zeros(3), None, Context())


@pytest.mark.parametrize("since", [1, 2, 3])
@pytest.mark.parametrize("size", [1.0, 10.0])
def test_cameras_on_one_beam_are_named_together(since: int, size: float) -> None:
    motion = found(images({(c, t): size * MOTION for c in GROUP for t in range(since, PLACEMENTS)}))
    assert motion is not None and motion.cameras == GROUP
    assert motion.variance_factor < 1.5 and motion.image_change_px > 0
    # before the second and before the last placement it may as well be the ball, at that one placement
    assert motion.ambiguous == (since in (1, PLACEMENTS - 1))
    if not motion.ambiguous:
        assert motion.kind == "cameras" and motion.placements == tuple(range(since, PLACEMENTS))
        assert motion.rotation_rad == pytest.approx(size * np.linalg.norm(MOTION[:3]), rel=0.2)


def test_a_ball_that_moved_between_exposures_differs_from_cameras_that_moved() -> None:
    rng = np.random.default_rng(3)
    motions = [np.concatenate([np.zeros(3), 0.3 * rng.normal(size=3)]) for _ in range(PLACEMENTS)]
    motion = found(images({(c, t): motions[t] for c in GROUP for t in range(PLACEMENTS)}))
    assert motion is not None and (motion.kind, motion.cameras) == ("ball", GROUP)
    assert motion.placements == tuple(range(PLACEMENTS)) and motion.variance_factor < 1.5


def test_a_placement_of_another_rig_is_named() -> None:
    rng = np.random.default_rng(4)
    motion = found(
        images(
            {
                (c, 1): rng.normal(size=6) * [1e-4] * 6 + 0.3 * rng.normal(size=6) * [0, 0, 0, 1, 1, 1]
                for c in range(CAMERAS)
            }
        )
    )
    assert motion is not None and (motion.kind, motion.placements) == ("placement", (1,))


def test_noise_and_scatter_of_all_images_name_nobody() -> None:
    for seed in range(10):
        assert found(images(seed=seed)) is None
        assert found(images(seed=seed, noise=5.0)) is None  # as of lenses beyond their model


def test_a_single_move_is_left_to_the_single_cameras() -> None:
    some = images({(2, t): 10 * MOTION for t in (2, 3)})
    single = explain(some, Context())
    assert single is not None and [move.camera for move in single.moves] == [2] and single.is_simple
    assert find_group_motion(some, np.zeros(3), single.fitted, Context()) is None


def test_two_cameras_that_moved_apart_are_named_each() -> None:
    """Either alone leaves what the other did, many times what noise leaves."""
    other = np.array([-2e-4, 1e-4, 0.0, -0.3, 0.4, 0.1])
    moved = {(2, t): 10 * MOTION for t in (2, 3)} | {(5, t): 10 * other for t in (1, 2, 3)}
    single = explain(images(moved), Context())
    assert single is not None and {move.camera for move in single.moves} == {2, 5} and single.variance_factor < 1.5


def test_a_group_among_many_cameras_is_found_by_growth() -> None:
    """With more than twelve cameras not every group is tried."""
    group = (0, 3, 7, 8, 12, 15)
    motion = found(images({(c, t): MOTION for c in group for t in (2, 3)}, cameras=17))
    assert motion is not None and (motion.kind, motion.cameras, motion.placements) == ("cameras", group, (2, 3))


def test_groups_of_many_motions_take_little_memory() -> None:
    """The matrices of all 2,510 groups of 12 cameras at once took 5 GB at 25 placements, 0.4 GB at these."""
    some = images(cameras=12, placements=8)
    still = fit_layout(some, PoseComposition.of(some))
    assert still is not None
    search = GroupSearch.of(some, still)
    tracemalloc.start()
    groups = search.groups(tuple((t,) for t in range(1, 8)), some.variance)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert groups and peak < 150e6


def test_a_camera_with_two_moves_is_unstable() -> None:
    moved = {(2, 1): 10 * MOTION, (2, 3): -20 * MOTION}
    single = explain(images(moved), Context())
    assert single is not None and [move.camera for move in single.moves] == [2, 2]
    motion = unstable_camera(single)
    assert (motion.kind, motion.cameras) == ("ball", (2,)) and motion.dof == 2 * POSE
    assert motion.translation == pytest.approx(max(np.linalg.norm(move.step[3:]) for move in single.moves))


def test_cameras_that_see_one_placement_say_nothing_of_others() -> None:
    some = images()
    rows = np.flatnonzero(some.placement == 0)
    columns = (POSE * rows[:, None] + np.arange(POSE)).ravel()
    one = replace(
        some,
        camera=some.camera[rows],
        placement=some.placement[rows],
        points=some.points[rows],
        rotation=some.rotation[rows],
        translation=some.translation[rows],
        normal=some.normal[np.ix_(columns, columns)],
        by_pose_px2=some.by_pose_px2[rows],
    )
    assert found(one) is None
