"""The best next place and turn of the ball: what every candidate would do for a length of 500 mm in the volume."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from spherecal.adjust.ball_model import Rigid
from spherecal.adjust.covariance import camera_cofactors
from spherecal.adjust.datum import Places
from spherecal.adjust.problem import sorted_problem
from spherecal.adjust.state import State
from spherecal.base.arrays import ByValue, FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.threads import on_one_blas_thread
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.geometry.camera import is_unfolded, project
from spherecal.geometry.length_uncertainty import DIRECTIONS, LENGTH_MM, Cameras, Volume, predict_lengths
from spherecal.geometry.rotation import exp_rotation
from spherecal_rigs.known_problem import KnownNetwork, what_is_known

COVERAGE_FACTOR = 2.0
STAGE = "guidance"
# Dots are found at up to 65 degrees of view with a recall of 99 %.
VIEW_LIMIT_DEG = 62.0
# Places and turns that are tried. A turn of 45 degrees leaves half of the dots in view and shows as many new ones.
PLACES = 8
TURN_DEG = 45.0
# The ball must be seen by this many cameras, its middle at least this part of its radius inside their images.
LEAST_CAMERAS, INSIDE = 3, 0.5
# On the unknown side of the ball dots are as dense as on the known one; a dot nearer than this part of the radius to a
# known one would be the same sticker.
GHOST = 0.15
# Dots that a camera should see at a placement, where nobody has set another limit (profile.limits_file).
ENOUGH_DOTS = 100
# Of the dots that were predicted a camera then saw 0.92 and more (demo rig, drawn images, three seeds): targets at the
# edge of the image are found whole or not at all.
FOUND = 0.85


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(ByValue):
    """One way to put the ball: its centre (3,) in the rig's frame, mm, and its turn against the last placement."""

    centre_mm: FloatArray
    turn_deg: float
    axis: FloatArray | None  # (3,) unit vector in the rig's frame, None where it is not turned
    expanded_mm: float  # what a length of 500 mm would be measured to (k = 2, median over the volume)
    cameras: int
    nearest: str  # the camera that the ball would be closest to
    fewest_dots: int  # what the camera that sees least of it is sure to find


@dataclass(frozen=True, eq=False, repr=False)
class Guidance(ByValue):
    """What stopping now would give (k = 2, 500 mm, median over the volume), and the candidates, best first."""

    now_mm: float | None
    candidates: tuple[Candidate, ...]
    placements: tuple[str, ...]
    placements_mm: FloatArray
    volume: Volume

    @property
    def best(self) -> Candidate | None:
        """The candidate that helps most."""
        return self.candidates[0] if self.candidates else None

    def words(self) -> str:
        """The advice in a sentence or two."""
        if self.now_mm is None or not np.isfinite(self.now_mm):
            now = "So far the placements do not determine the rig."
        else:
            now = f"If you stop now: a length of {LENGTH_MM:.0f} mm to {self.now_mm:.3f} mm (k = 2)."
        if self.best is None:
            return now
        x, y, z = self.best.centre_mm
        turned = f", turned by {self.best.turn_deg:.0f} degrees" if self.best.axis is not None else ", not turned"
        return (
            f"{now} After one more placement at ({x:.0f}, {y:.0f}, {z:.0f}) mm, towards camera {self.best.nearest}"
            f"{turned}: {self.best.expanded_mm:.3f} mm."
        )


@on_one_blas_thread
def advise(
    session: Session, calibration: Calibration, context: Context | None = None, enough_dots: int = ENOUGH_DOTS
) -> Guidance | None:
    """Where to put the ball next, by the placements so far and to first order, in mm; None without a ball."""
    context = context or Context()
    known = what_is_known(session, calibration)
    if known is None:
        return None
    context.report(STAGE, 0.0)
    volume = _volume(known)
    # all over the volume in seven directions
    half = LENGTH_MM / 2 * DIRECTIONS @ volume.axes
    middles = volume.grid(3)
    tests = np.stack([middles[:, None] - half, middles[:, None] + half], axis=2).reshape(-1, 2, 3)
    now = _expanded(known, known.state, None, tests)
    ghosts = _with_far_side(known)
    found = []
    places = _candidate_places(known, volume)
    rotations = [None, *(volume.axes[k] for k in (0, 2))]
    for number, place in enumerate(places):
        context.report(STAGE, number / len(places))
        for axis in rotations:
            candidate = _try(ghosts, known, place, axis, tests)
            if candidate is not None:
                found.append(candidate)
    found.sort(key=lambda c: (c.fewest_dots < enough_dots, c.expanded_mm))
    return Guidance(now, tuple(found), known.placement_ids, known.centres, volume)


@on_one_blas_thread
def first_guess(session: Session, calibration: Calibration, enough_dots: int) -> Guidance | None:
    """A place that enough cameras see, turned about the volume's thin axis: by geometry alone, at once."""
    known = what_is_known(session, calibration)
    if known is None:
        return None
    volume = _volume(known)
    places = _candidate_places(known, volume)
    ghosts, axis = _with_far_side(known), volume.axes[2]
    found = [_shown_at(ghosts, known, place, axis) for place in places]
    found.sort(key=lambda c: c.fewest_dots < enough_dots)
    return Guidance(None, tuple(found), known.placement_ids, known.centres, volume)


def _volume(known: KnownNetwork) -> Volume:
    """The box in which the ball's middle is seen by enough cameras."""
    centres = -np.einsum("cji,cj->ci", known.state.rotation, known.state.translation)
    axes = np.linalg.svd(centres - centres.mean(axis=0))[2]
    axes *= np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])[:, None]
    every = np.vstack([centres, known.centres - known.body.radius_mm, known.centres + known.body.radius_mm])
    along = every @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    half = np.maximum((high - low) / 2, 1.5 * known.body.radius_mm)
    box = Volume((low + high) / 2 @ axes, axes, half)
    places = box.grid(9)
    good = places[_cameras_at(known, places).sum(axis=1) >= LEAST_CAMERAS]
    if len(good) < 2:
        return Volume(known.centres.mean(axis=0), axes, np.full(3, known.body.radius_mm))
    along = good @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    return Volume((low + high) / 2 @ axes, axes, np.maximum((high - low) / 2, 1.0))


def _cameras_at(known: KnownNetwork, places: FloatArray) -> FloatArray:
    """Which cameras see a ball at places (n,3) well, (n,c)."""
    x = np.einsum("cij,pj->pci", known.state.rotation, places) + known.state.translation
    n, c = x.shape[:2]
    k = np.broadcast_to(known.state.intrinsics, (n, c, 16)).reshape(-1, 16)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        uv = project(x.reshape(-1, 3), k).reshape(n, c, 2)
        margin = INSIDE * known.body.radius_mm * known.state.intrinsics[:, 0] / x[:, :, 2]
    inside = ((uv >= margin[:, :, None]) & (uv <= known.size - 1 - margin[:, :, None])).all(axis=2)
    inside &= x[:, :, 2] > 1.5 * known.body.radius_mm
    place, camera = np.nonzero(inside)
    inside[place, camera] = is_unfolded(x[place, camera], known.state.intrinsics[camera])
    return inside


def _candidate_places(known: KnownNetwork, volume: Volume) -> FloatArray:
    """Places (n,3) that enough cameras see, as far from the placements so far and from each other as can be."""
    grid = volume.grid(5)
    grid = grid[_cameras_at(known, grid).sum(axis=1) >= LEAST_CAMERAS]
    taken, chosen = known.centres, []
    while len(chosen) < PLACES and len(grid):
        distance = np.linalg.norm(grid[:, None] - taken, axis=2).min(axis=1)
        best = int(np.argmax(distance))
        if distance[best] < 0.3 * known.body.radius_mm:
            break
        chosen.append(grid[best])
        taken = np.vstack([taken, grid[best]])
    return np.array(chosen).reshape(-1, 3)


@dataclass(frozen=True)
class _Ball:
    """The ball with its far side: dots (k,3), normals (k,3), their points, how many points the problem then has."""

    dots: FloatArray
    normals: FloatArray
    point: IntArray
    n_points: int


def _with_far_side(known: KnownNetwork) -> _Ball:
    """The known dots and, where none are known, the antipodes of known ones as unknown points."""
    body = known.body
    antipodes = body.centre - body.radius_mm * body.normals
    free = KDTree(body.dots).query(antipodes)[0] > GHOST * body.radius_mm
    # as thin as the thinned known ones
    new = known.network.n_features + np.arange(int(free.sum()))
    return _Ball(
        np.vstack([body.dots, antipodes[free]]),
        np.vstack([body.normals, -body.normals[free]]),
        np.concatenate([body.point, new]),
        known.network.n_features + len(new),
    )


@dataclass(frozen=True)
class _Shown:
    """A further placement as predicted: observations of points in cameras, and the pose of the ball."""

    camera: IntArray
    point: IntArray
    rotation: FloatArray
    translation: FloatArray


def _pose_at(known: KnownNetwork, place: FloatArray, axis: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """The ball's turn (3,3) and shift (3,) where its centre is at a place, turned on from the last placement."""
    rotation = known.turns[-1] if axis is None else exp_rotation(np.deg2rad(TURN_DEG) * axis) @ known.turns[-1]
    return rotation, place - rotation @ known.body.centre


def _shown_at(ball: _Ball, known: KnownNetwork, place: FloatArray, axis: FloatArray | None) -> Candidate:
    """A place and turn with the dots that the cameras would see; no length is predicted."""
    dots = _in_view(ball, known, *_pose_at(known, place, axis)).sum(axis=1)
    centres = -np.einsum("cji,cj->ci", known.state.rotation, known.state.translation)
    return Candidate(
        place,
        0.0 if axis is None else TURN_DEG,
        axis,
        float("nan"),
        int((dots > 0).sum()),
        known.camera_ids[int(np.argmin(np.linalg.norm(centres - place, axis=1)))],
        int(FOUND * dots.min()),
    )


def _try(
    ball: _Ball, known: KnownNetwork, place: FloatArray, axis: FloatArray | None, tests: FloatArray
) -> Candidate | None:
    shown = _predicted(ball, known, *_pose_at(known, place, axis))
    if shown is None:
        return None
    state = replace(known.state, points=np.vstack([known.state.points, ball.dots[len(known.body.dots) :]]))
    expanded = _expanded(known, state, shown, tests)
    return None if expanded is None else replace(_shown_at(ball, known, place, axis), expanded_mm=expanded)


def _in_view(ball: _Ball, known: KnownNetwork, rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Which dots of the ball in a pose the cameras would see, (c,k)."""
    dots, normals = ball.dots @ rotation.T + translation, ball.normals @ rotation.T
    x = np.einsum("cij,pj->cpi", known.state.rotation, dots) + known.state.translation[:, None]
    c, p = x.shape[:2]
    k = np.repeat(known.state.intrinsics, p, axis=0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        uv = project(x.reshape(-1, 3), k).reshape(c, p, 2)
    sight = -np.einsum("cji,cpj->cpi", known.state.rotation, x)
    facing = np.einsum("cpi,pi->cp", sight, normals) / np.linalg.norm(sight, axis=2)
    inside = ((uv > 4) & (uv < known.size[:, None] - 5)).all(axis=2) & (x[:, :, 2] > 0)
    inside &= facing > np.cos(np.deg2rad(VIEW_LIMIT_DEG))
    camera, dot = np.nonzero(inside)
    inside[camera, dot] = is_unfolded(x[camera, dot], known.state.intrinsics[camera])
    return inside


def _predicted(ball: _Ball, known: KnownNetwork, rotation: FloatArray, translation: FloatArray) -> _Shown | None:
    """What the cameras would see of the ball in a pose."""
    in_view = _in_view(ball, known, rotation, translation)
    camera, dot = np.nonzero(in_view)
    p = in_view.shape[1]
    new = dot >= len(known.body.dots)
    often = np.bincount(dot, minlength=p) >= 2  # a dot of the far side is known only where two cameras meet
    keep = ~new | often[dot]
    # the known dots take part only as far as the thinned network has them
    there = np.zeros(ball.n_points, dtype=bool)
    there[known.network.feature] = True
    keep &= new | there[ball.point[dot]]
    share = max(there[known.body.point].mean(), 1e-3)
    drawn = np.random.default_rng(1).random(p) < share
    keep &= ~new | drawn[dot]
    camera, dot = camera[keep], dot[keep]
    return _Shown(camera, ball.point[dot], rotation, translation) if len(camera) else None


def _expanded(known: KnownNetwork, state: State, shown: _Shown | None, tests: FloatArray) -> float | None:
    """The test lengths' expanded uncertainty (median) with a further placement; None where it is not determined."""
    network = known.network
    camera, point, sigma, placement = network.camera, network.feature, network.sigma, network.ball.placement
    free = network.ball.free_placement
    if shown is not None:
        n = len(shown.camera)
        camera, point = np.concatenate([camera, shown.camera]), np.concatenate([point, shown.point])
        placement = np.concatenate([placement, np.full(n, len(free))])
        sigma = np.concatenate([sigma, np.full((n, 2), sigma[0, 0])])
        state = replace(
            state,
            placement_rotation=np.concatenate([state.placement_rotation, shown.rotation[None]]),
            placement_translation=np.concatenate([state.placement_translation, shown.translation[None]]),
        )
        free = np.append(free, True)
    n_points = len(state.points)
    once = np.bincount(point, minlength=n_points) >= 2
    keep = once[point]
    problem, _ = sorted_problem(
        camera[keep], point[keep], np.zeros((int(keep.sum()), 2)), sigma[keep], n_points,
        free_pose=np.ones(len(known.camera_ids), dtype=bool), free_intrinsics=network.free, group=network.group,
        ball=Rigid(placement[keep], free),
    )  # fmt: skip
    seen = np.unique(np.stack([problem.point, problem.placement], axis=1), axis=0)
    cofactors = camera_cofactors(problem, state, Places(seen[:, 0], seen[:, 1]))
    if cofactors is None:
        return None
    cameras = Cameras(
        state.intrinsics, state.rotation, state.translation, known.size, cofactors, problem.intrinsic_columns
    )
    found = predict_lengths(cameras, tests, known.sigma_px)
    variance = found.calibration + found.own + (known.scale_relative * LENGTH_MM) ** 2
    seen_lengths = variance[np.isfinite(variance)]
    return COVERAGE_FACTOR * float(np.sqrt(np.median(seen_lengths))) if len(seen_lengths) else None
