"""Recordings that are wrong in one way, at the level of observations."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.data.observations import Observations
from spherecal.data.rig import Calibration
from spherecal.data.session import Placement, Session
from spherecal.geometry.camera import project
from spherecal.geometry.rotation import exp_rotation
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import CameraMove, SimulationOptions, Truth

Pose = tuple[FloatArray, FloatArray]


def recording(rig: str = "demo", seed: int = 1, **options: object) -> tuple[Session, Truth]:
    """A faultless recording and its truth; small, so that a test takes seconds."""
    return simulate_session(rig, seed, SimulationOptions(**{"targets": 80, "bar_poses": 6, **options}))  # type: ignore[arg-type]


def again(
    session: Session,
    truth: Truth,
    pose: Callable[[int, int], Pose],
    shift: Callable[[int, int], FloatArray],
    distort: Callable[[int, FloatArray], FloatArray] | None = None,
) -> Session:
    """The recording's rows on the ball seen once more: by cameras at `pose(c, t)`, the ball moved by `shift(c, t)`.

    The noise of every row is as it was; `distort` of a camera changes exact image points (n, 2).
    """
    o = session.observations
    assert o is not None
    uv, noise = truth.uv_true_px.copy(), o.uv - truth.uv_true_px
    dot = {
        (int(i), int(p)): k for k, (i, p) in enumerate(zip(truth.ball.dot_target, truth.ball.dot_point, strict=True))
    }
    for t in range(len(truth.placements)):
        points = truth.points_mm(t)
        for c, camera in enumerate(truth.cameras):
            rows = np.flatnonzero((o.placement == t) & (o.camera == c))
            if not len(rows):
                continue
            index = [dot[int(o.target[r]), int(o.point[r])] for r in rows]
            rotation, translation = pose(c, t)
            x = (points[index] + shift(c, t)) @ rotation.T + translation
            seen = project(x, np.broadcast_to(camera.intrinsics, (len(x), 16)))
            uv[rows] = seen if distort is None else distort(c, seen)
    return replace(session, observations=replace(o, uv=uv + noise))


def as_built(truth: Truth) -> Callable[[int, int], Pose]:
    """The cameras where they stand."""
    return lambda c, t: (truth.cameras[c].rotation, truth.cameras[c].translation_mm)


def still(_: int, __: int) -> FloatArray:
    """The ball where it lies."""
    return np.zeros(3)


def with_rows(o: Observations, keep: IntArray | np.ndarray, placement: IntArray) -> Observations:
    """Some rows (k,) of observations under other placements (k,)."""
    return replace(
        o,
        placement=placement,
        camera=o.camera[keep],
        target=o.target[keep],
        point=o.point[keep],
        uv=o.uv[keep],
        sigma=None if o.sigma is None else o.sigma[keep],
    )


def stale_image(session: Session, camera: int, placement: int, shown: int) -> Session:
    """A camera delivers the image of another placement once more, noise and all (case A)."""
    o = session.observations
    assert o is not None
    kept = np.flatnonzero((o.placement != placement) | (o.camera != camera))
    copied = np.flatnonzero((o.placement == shown) & (o.camera == camera))
    rows = np.concatenate([kept, copied])
    at = np.concatenate([o.placement[kept], np.full(len(copied), placement)])
    return replace(session, observations=with_rows(o, rows, at))


def copies(session: Session, count: int) -> Session:
    """One placement, listed `count` times (case I)."""
    o = session.observations
    assert o is not None
    rows = np.flatnonzero(o.placement == 0)
    every = np.tile(rows, count)
    names = tuple(f"P{k + 1}" for k in range(count))
    observations = replace(with_rows(o, every, np.repeat(np.arange(count), len(rows))), placements=names)
    return replace(
        session, placements=tuple(Placement(n) for n in names), bars=(), bar_poses=(), observations=observations
    )


def sagged(session: Session, truth: Truth, cameras: list[int], mm: float) -> Session:
    """A beam with several cameras sinks between the second and the third placement (case F)."""

    def pose(c: int, t: int) -> Pose:
        rotation, translation = as_built(truth)(c, t)
        if c not in cameras or t < 2:
            return rotation, translation
        return rotation, translation - rotation @ np.array([0.0, 0.0, -mm])

    return again(session, truth, pose, still)


def moved_between_exposures(session: Session, truth: Truth, mm: float, seed: int = 0) -> Session:
    """The ball moves while the cameras record one after the other (case G)."""
    rng = np.random.default_rng(seed)
    step = rng.normal(size=(len(truth.cameras), len(truth.placements), 3))
    step *= mm / np.linalg.norm(step, axis=2, keepdims=True)
    return again(session, truth, as_built(truth), lambda c, t: step[c, t])


def skewed(session: Session, truth: Truth, px: float) -> Session:
    """Pixels that are sheared by `px` over the image's height (case J)."""
    height = np.array([camera.kind.image_size[1] for camera in truth.cameras])

    def distort(c: int, uv: FloatArray) -> FloatArray:
        return uv + np.stack([px * (uv[:, 1] / height[c] - 0.5), np.zeros(len(uv))], axis=1)

    return again(session, truth, as_built(truth), still, distort)


def mirrored(session: Session, camera: int) -> Session:
    """One camera's images flipped."""
    o = session.observations
    assert o is not None
    width = session.cameras[camera].image_size[0]
    uv = o.uv.copy()
    own = o.camera == camera
    uv[own, 0] = width - 1 - uv[own, 0]
    return replace(session, observations=replace(o, uv=uv))


def camera_moved(rig: str, seed: int, camera: str, mm: float, at: int = 2, **options: object) -> tuple[Session, Truth]:
    """A camera knocked before a placement (case E)."""
    return recording(rig, seed, moved=CameraMove(camera, at, mm, mm / 1500), **options)


def errors(done: Calibration, truth: Truth, moved: CameraMove | None = None) -> FloatArray:
    """Errors (c,) of the cameras' centres in mm after the best rigid fit of the others, scale as it is."""
    true, found = [], []
    for camera in done.rig.cameras:
        built = next(c for c in truth.cameras if c.id == camera.id)
        rotation, translation = built.rotation, built.translation_mm
        if moved is not None and moved.camera == camera.id:
            turn = exp_rotation(moved.turn_rad * np.array(moved.direction_turn))
            translation = turn @ translation + moved.shift_mm * np.array(moved.direction_shift)
            rotation = turn @ rotation
        true.append(-rotation.T @ translation)
        found.append(camera.centre_mm)
    a, b = np.array(found), np.array(true)
    middle = np.median(a, axis=0), np.median(b, axis=0)
    keep, off = np.ones(len(a), dtype=bool), np.zeros(len(a))
    for _ in range(3):
        middle = a[keep].mean(axis=0), b[keep].mean(axis=0)
        u, _s, vt = np.linalg.svd((a[keep] - middle[0]).T @ (b[keep] - middle[1]))
        turn = vt.T @ np.diag([1, 1, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T
        off = np.linalg.norm((a - middle[0]) @ turn.T + middle[1] - b, axis=1)
        keep = off <= max(3 * float(np.median(off)), 1e-6)
    return off


def length_errors(done: Calibration, truth: Truth, length_mm: float = 500.0) -> tuple[float, float]:
    """Relative scale error over all pairs of cameras' centres, and U of the rig's lengths relatively."""
    a = np.array([c.centre_mm for c in done.rig.cameras])
    true = {c.id: -c.rotation.T @ c.translation_mm for c in truth.cameras}
    b = np.array([true[c.id] for c in done.rig.cameras])
    i, j = np.triu_indices(len(a), 1)
    ratio = np.linalg.norm(a[i] - a[j], axis=1) / np.linalg.norm(b[i] - b[j], axis=1)
    typical = None if done.rig.length_map is None else done.rig.length_map.typical_mm
    return float(np.median(ratio) - 1), float("nan") if typical is None else typical / length_mm
