"""What a calibration knows, as a problem that a further placement can be added to."""

from dataclasses import dataclass

import numpy as np

from spherecal.adjust.datum import Places
from spherecal.adjust.network import Network, free_network
from spherecal.adjust.state import State
from spherecal.ball.rigid import Alignment, align, share_shape
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.data.rig import Calibration
from spherecal.data.session import Session

# Observations beyond this many are thinned out and the rest weighs as much: four times faster, the same to a percent.
ENOUGH = 2500


@dataclass(frozen=True)
class PlacedBall:
    """The ball where it was put, in its root's world: dots (k,3) as points (k,), normals (k,3), centre, radius, mm."""

    point: IntArray
    dots: FloatArray
    normals: FloatArray
    centre: FloatArray
    radius_mm: float


@dataclass(frozen=True)
class KnownNetwork:
    """A calibration's network in millimetres: observations with their weights, state, and the ball."""

    network: Network
    state: State
    places: Places
    body: PlacedBall
    size: FloatArray  # (c,2) images, px
    camera_ids: tuple[str, ...]
    placement_ids: tuple[str, ...]
    sigma_px: float  # of one image coordinate, the same of all cameras
    scale_relative: float  # standard uncertainty of the scale
    centres: FloatArray  # (t,3) where the ball was, against its root
    turns: FloatArray  # (t,3,3)


def what_is_known(session: Session, calibration: Calibration) -> KnownNetwork | None:
    """The network behind a calibration; None where it has no covariance or no ball."""
    rig, covariance = calibration.rig, calibration.rig.covariance
    n_ball = len(session.placements)
    placed = {sphere.placement for sphere in calibration.spheres}
    if covariance is None or not placed or calibration.rig.quality.sigma0 is None:
        return None
    features, points = calibration.features, calibration.points_mm
    rigid = rig.form is not None and rig.form.name == "rigid"
    n_all = len(calibration.observations.placements)
    alignment = align(features, points, n_all, n_ball) if rigid else _apart(n_all)
    network, state = _network(session, calibration)
    shared, start = share_shape(network, features, state, alignment)
    world = np.full((shared.network.n_features, 3), np.nan)
    at_root = alignment.root[features.placement] == features.placement
    # any placement gives a dot's place on the ball; those of the root itself come last and win
    located = np.isfinite(points[:, 0])
    for rows in (np.flatnonzero(~at_root & located), np.flatnonzero(at_root & located)):
        rotation, translation = (
            alignment.rotation[features.placement[rows]],
            alignment.translation[features.placement[rows]],
        )
        world[shared.places.point[rows]] = np.einsum("fji,fj->fi", rotation, points[rows] - translation)
    body = _body(session, calibration, alignment, shared.places, world)
    if body is None:
        return None
    root, body = body
    mine = [t for t in range(n_ball) if alignment.root[t] == root and session.placements[t].id in placed]
    return KnownNetwork(
        shared.network,
        State(
            start.rotation,
            start.translation,
            start.intrinsics,
            np.nan_to_num(world),
            start.placement_rotation,
            start.placement_translation,
        ),
        shared.places,
        body,
        np.array([camera.image_size for camera in rig.cameras], dtype=float),
        tuple(camera.id for camera in rig.cameras),
        tuple(session.placements[t].id for t in mine),
        _noise(calibration),
        rig.scale.relative_uncertainty or 0.0,
        np.array([alignment.rotation[t] @ body.centre + alignment.translation[t] for t in mine]),
        np.array([alignment.rotation[t] for t in mine]),
    )


def _apart(n: int) -> Alignment:
    """Placements that share nothing."""
    return Alignment(np.arange(n), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), np.zeros((n, n), dtype=np.int64))


def _noise(calibration: Calibration) -> float:
    """The noise of one image coordinate: the adjustment's, in the unit of the observations' own sigmas."""
    sigma0, sigma = calibration.rig.quality.sigma0, calibration.observations.sigma
    assert sigma0 is not None
    return max(sigma0 * (1.0 if sigma is None else float(np.median(sigma[calibration.used]))), 1e-4)


def _network(session: Session, calibration: Calibration) -> tuple[Network, State]:
    """The used observations of the placed cameras, thinned out and weighted by the noise, and the cameras."""
    rig, o, covariance = calibration.rig, calibration.observations, calibration.rig.covariance
    assert covariance is not None
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    camera = np.array([index.get(name, -1) for name in o.cameras])[o.camera]
    use = calibration.used & (camera >= 0) & np.isfinite(calibration.points_mm[calibration.features.of_observation, 0])
    share = min(1.0, ENOUGH / max(int(use.sum()), 1))
    dot = np.unique(np.stack([o.target, o.point], axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    drawn = np.random.default_rng(0).random(dot.max(initial=0) + 1) < share  # a dot with all its observations, or not
    rows = np.flatnonzero(use & drawn[dot])
    groups = {spec.id: spec.intrinsics_group for spec in session.cameras}
    group = np.unique([groups[c.id] for c in rig.cameras], return_inverse=True)[1].reshape(-1)
    free = np.zeros((len(rig.cameras), 16), dtype=bool)
    free[:, covariance.intrinsics] = True
    sigma = np.full((len(rows), 2), _noise(calibration) * np.sqrt(share))
    network = free_network(
        calibration.features.of_observation[rows], camera[rows], o.uv[rows], len(calibration.features), free, group
    ).with_sigma(sigma)
    state = State(
        np.array([c.rotation for c in rig.cameras]),
        np.array([c.translation_mm for c in rig.cameras]),
        np.array([c.intrinsics for c in rig.cameras]),
        calibration.points_mm,
    )
    return network, state


def _body(
    session: Session, calibration: Calibration, alignment: Alignment, places: Places, world: FloatArray
) -> tuple[int, PlacedBall] | None:
    """The ball with most known dots and its root placement."""
    ball = {
        session.placements.index(p): s for p in session.placements for s in calibration.spheres if s.placement == p.id
    }
    features = calibration.features
    best: tuple[int, PlacedBall] | None = None
    for root in sorted({int(alignment.root[t]) for t in ball}):
        if root not in ball:
            continue
        own = np.unique(places.point[alignment.root[features.placement] == root])
        own = own[np.isfinite(world[own, 0])]
        sphere = ball[root]
        normals = world[own] - sphere.centre_mm
        distance = np.linalg.norm(normals, axis=1)
        good = np.abs(distance / sphere.radius_mm - 1) < 0.2  # strays are no part of the ball
        body = PlacedBall(
            own[good], world[own[good]], normals[good] / distance[good, None], sphere.centre_mm, sphere.radius_mm
        )
        if best is None or len(body.point) > len(best[1].point):
            best = (root, body)
    return best
