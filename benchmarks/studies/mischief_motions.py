"""Mischief with motions: of cameras, of what they hang on, and of the ball between exposures."""

from dataclasses import replace

import numpy as np

from benchmarks.studies.mischief_case import (
    IMAGE,
    MOVED,
    Case,
    aligned_from,
    any_camera,
    direction,
    displaced,
    later_placement,
    make_case,
    seen_placement,
)
from benchmarks.studies.mischief_world import Pose, World
from spherecal.base.arrays import FloatArray
from spherecal.data.observations import Features, Observations
from spherecal.geometry.rotation import exp_rotation


def moved(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera is knocked before a placement: a shift in mm, and as many mrad."""
    c, t = seen_placement(world, rng)
    shift, turn = size * direction(rng), 1e-3 * size * direction(rng)

    def pose_of(camera: int, placement: int) -> Pose:
        pose = world.pose(camera, placement)
        return displaced(pose, shift, turn) if camera == c and placement >= t else pose

    return make_case(replace(world, pose_of=pose_of), rng, MOVED, (world.ids[c],))


def moved_once(world: World, size: float, rng: np.random.Generator) -> Case:
    """A camera is elsewhere at one placement and comes back."""
    c, t = any_camera(world, rng), int(rng.integers(0, len(world.turns) - 1))
    shift, turn = size * direction(rng), 1e-3 * size * direction(rng)

    def pose_of(camera: int, placement: int) -> Pose:
        pose = world.pose(camera, placement)
        return displaced(pose, shift, turn) if camera == c and placement == t else pose

    return make_case(replace(world, pose_of=pose_of), rng, (*MOVED, *IMAGE), (world.ids[c],))


def two_moved(world: World, size: float, rng: np.random.Generator) -> Case:
    """Two cameras are knocked before different placements, at which they see the ball."""
    first = seen_placement(world, rng)
    second = first
    while second[0] == first[0] or second[1] == first[1]:
        second = seen_placement(world, rng)
    pair, at = zip(first, second, strict=True)
    shift, turn = [size * direction(rng) for _ in pair], [1e-3 * size * direction(rng) for _ in pair]

    def pose_of(camera: int, placement: int) -> Pose:
        pose = world.pose(camera, placement)
        for c, t, s, w in zip(pair, at, shift, turn, strict=True):
            if camera == c and placement >= t:
                pose = displaced(pose, s, w)
        return pose

    return make_case(replace(world, pose_of=pose_of), rng, MOVED, tuple(world.ids[c] for c in pair))


def beam(world: World, size: float, rng: np.random.Generator) -> Case:
    """Half of the cameras hang on one beam that sags, turned a little, before a placement."""
    t = later_placement(world, rng)
    centres = np.array([c.centre_mm for c in world.cameras])
    side = centres @ direction(rng)
    group = set(np.argsort(side)[: max(3, len(side) // 2)].tolist())
    middle = centres[sorted(group)].mean(axis=0)
    turn, fall = exp_rotation(1e-3 * size * direction(rng)), size * np.array([0.0, 0.0, -1.0])

    def pose_of(camera: int, placement: int) -> Pose:
        r, v = world.pose(camera, placement)
        if camera not in group or placement < t:
            return r, v
        # the camera's world moves with the beam: x_camera = R turn' (x - middle - fall) + ...
        back = turn.T
        return r @ back, r @ (middle - back @ (middle + fall)) + v

    case = make_case(replace(world, pose_of=pose_of), rng, (*MOVED, "group", "beam"))
    return aligned_from(case, t)


def drifting(world: World, size: float, rng: np.random.Generator) -> Case:
    """All cameras drift from the first to the last placement by a total of so many mm and a tenth as many mrad."""
    n = len(world.cameras)
    shift, turn = [size * direction(rng) for _ in range(n)], [1e-4 * size * direction(rng) for _ in range(n)]
    last = len(world.turns) - 1

    def pose_of(camera: int, placement: int) -> Pose:
        share = placement / last
        return displaced(world.pose(camera, placement), share * shift[camera], share * turn[camera])

    return make_case(replace(world, pose_of=pose_of), rng, (*MOVED, "drift"))


def warming(world: World, size: float, rng: np.random.Generator) -> Case:
    """The rig expands by so many ppm from the first to the last placement.

    The ball's places, by which the result is aligned, are those in the rig's frame, which grows with it.
    """
    last = len(world.turns) - 1
    centres = np.array([-c.rotation.T @ c.translation_mm for c in world.cameras])
    middle = centres.mean(axis=0)

    def pose_of(camera: int, placement: int) -> Pose:
        rotation = world.cameras[camera].rotation
        centre = middle + (centres[camera] - middle) * (1 + 1e-6 * size * placement / last)
        return rotation, -rotation @ centre

    case = make_case(replace(world, pose_of=pose_of), rng, (*MOVED, "size", "drift"))
    fixed = case.reference.places_of

    def places_of(features: Features, o: Observations) -> FloatArray:
        grown = (1 + 1e-6 * size) / (1 + 1e-6 * size * features.placement / last)
        return middle + grown[:, None] * (fixed(features, o) - middle)

    return replace(case, reference=replace(case.reference, places_of=places_of))


def trigger_groups(world: World, size: float, rng: np.random.Generator) -> Case:
    """The ball is displaced by so many mm between the exposures of two groups of cameras, at each placement."""
    second = set(rng.permutation(len(world.cameras))[: len(world.cameras) // 2].tolist())
    shift = [size * direction(rng) for _ in world.turns]

    def ball_of(camera: int, placement: int) -> Pose:
        return world.turns[placement], world.places_mm[placement] + (shift[placement] if camera in second else 0.0)

    return make_case(replace(world, ball_of=ball_of), rng, ("ball-moved", "camera-drifts", "moving"))


def late_camera(world: World, size: float, rng: np.random.Generator) -> Case:
    """One camera is late, and the ball is still moving: displaced by so many mm for it, each time elsewhere."""
    c = any_camera(world, rng)
    shift = [size * direction(rng) for _ in world.turns]

    def ball_of(camera: int, placement: int) -> Pose:
        return world.turns[placement], world.places_mm[placement] + (shift[placement] if camera == c else 0.0)

    blame = ("unsteady", "trigger", "exposure", "moving", *MOVED, "image-contradicts")
    return make_case(replace(world, ball_of=ball_of), rng, blame, (world.ids[c],))


def rolling_ball(world: World, size: float, rng: np.random.Generator) -> Case:
    """The ball rolls during the exposures: every camera sees it turned by up to so many degrees."""
    late = rng.uniform(0, 1, (len(world.turns), len(world.cameras)))
    axis = [np.deg2rad(size) * direction(rng) for _ in world.turns]
    radius = world.ball.radius_mm

    def ball_of(camera: int, placement: int) -> Pose:
        turn = late[placement, camera] * axis[placement]
        way = radius * np.cross(turn, [0.0, 0.0, 1.0])  # on a table below it
        return exp_rotation(turn) @ world.turns[placement], world.places_mm[placement] + way

    return make_case(replace(world, ball_of=ball_of), rng, ("ball-moved", "camera-drifts", "moving"))
