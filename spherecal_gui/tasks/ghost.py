"""The ball where it should go, as every camera would see it, and the ball where it is now."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.geometry.camera import image_reach, project
from spherecal.geometry.rotation import log_rotation
from spherecal.geometry.sphere import fit_sphere
from spherecal.geometry.transform import PosedCameras, fit_similarity
from spherecal.geometry.triangulation import triangulate
from spherecal_gui.coverage import Dots, SetDots, dot_keys

if TYPE_CHECKING:  # the simulator, and what only reads results needs
    from spherecal.data.rig import Calibration, Rig
    from spherecal_cameras.simulated.stage import Stage

_OUTLINE = 72  # points of an outline
# Dots that must be known again for the ball's turn: three define it, and a few may be wrong.
_LEAST_DOTS = 8
# A live dot that does not fit its other views by so much is misread: 99 % fit to 1.9 px with the cameras as one
# placement gives them, and to 0.1 px as two do (simulated demo rig, 0.05 px of noise).
_MISFIT_PX = 6.0
_TRIM = 3.0  # times the median misfit: what lies beyond is left out of the ball's pose
# Of the radius, and degrees. At this distance along each axis, or turned by so much more or less, a length of 500 mm
# is measured to between 0.99 and 1.06 of what it is at the proposed place (demo rig, after one and two placements).
NEAR, NEAR_DEG = 0.2, 12.0
_UPRIGHT = 0.7  # an axis this steep is upright: the ball is turned on its stand, else it is tipped


@dataclass(frozen=True, eq=False)
class Lenses:
    """The cameras as they are known: `intrinsics` (c, 16), poses (c, 3, 3) and (c, 3), image sizes (c, 2)."""

    names: tuple[str, ...]
    intrinsics: FloatArray
    rotation: FloatArray
    translation: FloatArray
    size: FloatArray

    @staticmethod
    def of(rig: "Rig") -> "Lenses":
        """Those of a calibrated rig."""
        known = [(c.intrinsics, c.rotation, c.translation_mm, np.array(c.image_size, float)) for c in rig.cameras]
        return Lenses(tuple(c.id for c in rig.cameras), *map(np.array, zip(*known, strict=True)))


@dataclass(frozen=True, eq=False)
class LastBall:
    """The ball as it stood last: known dots `keys` (k,) at `dots` (k, 3) mm, its centre and the way up (3,)."""

    keys: IntArray
    dots: FloatArray
    centre: FloatArray
    radius_mm: float
    up: FloatArray


@dataclass(frozen=True, eq=False)
class Ghost:
    """Where the ball should go: centre (3,) mm and turn (3, 3) against how it stood last."""

    lenses: Lenses
    body: LastBall
    centre: FloatArray
    turn: FloatArray


@dataclass(frozen=True, eq=False)
class Lying:
    """Where the ball is now: centre (3,) mm, turn (3, 3) against how it stood last (None: its dots are not known)."""

    centre: FloatArray
    turn: FloatArray | None


@dataclass(frozen=True)
class ToGo:
    """How far the ball still is from where it should go."""

    away_mm: float
    turn_deg: float | None  # None: not known
    near: bool
    level_mm: float = 0.0  # towards camera `towards`
    up_mm: float = 0.0  # higher
    towards: str = ""
    to_the_left: bool = False  # turned on its stand
    tips_towards: str = ""  # the camera to which its top is tipped; else it is turned


@dataclass(frozen=True, eq=False)
class Drawn:
    """What is drawn into one camera's image, px: outlines (n, 2), poles (2, 2); of a bar both are its line."""

    wanted: FloatArray
    wanted_pole: FloatArray
    lying: FloatArray
    lying_pole: FloatArray


def body_of(calibration: "Calibration", last: str, up: FloatArray) -> LastBall | None:
    """The ball as it stood at a placement, with dots that others have shown; None where it was not fitted there."""
    spheres = {sphere.placement: sphere for sphere in calibration.spheres}
    if last not in spheres:
        return None
    features, points = calibration.features, calibration.points_mm
    placements = calibration.observations.placements
    parts: dict[str, tuple[IntArray, FloatArray]] = {}
    for name in spheres:
        own = (features.placement == placements.index(name)) & np.isfinite(points[:, 0])
        parts[name] = (dot_keys(features.target[own], features.point[own]), points[own])
    keys, dots = parts.pop(last)
    for other_keys, other_dots in parts.values():
        common, a, b = np.intersect1d(keys, other_keys, return_indices=True)
        if len(common) < _LEAST_DOTS:
            continue
        new = ~np.isin(other_keys, keys)
        moved = fit_similarity(other_dots[b], dots[a], with_scale=False)
        keys, dots = np.concatenate([keys, other_keys[new]]), np.vstack([dots, moved.apply(other_dots[new])])
    return LastBall(keys, dots, spheres[last].centre_mm, float(spheres[last].radius_mm), up)


def lying_ball(lenses: Lenses, body: LastBall, dots: Mapping[str, Dots]) -> Lying | None:
    """Where the ball is, from the dots that the cameras see now; None where too few are seen by two of them."""
    keys, points = live_points(lenses, dots)
    if len(keys) < _LEAST_DOTS:
        return None
    _, known, seen = np.intersect1d(body.keys, keys, return_indices=True)
    pose = None
    for _ in range(3):  # what is misread is left out
        if len(known) < _LEAST_DOTS:
            pose = None
            break
        pose = fit_similarity(body.dots[known], points[seen], with_scale=False)
        misfit = np.linalg.norm(pose.apply(body.dots[known]) - points[seen], axis=1)
        good = misfit <= max(_TRIM * float(np.median(misfit)), 1e-3)
        known, seen = known[good], seen[good]
    if pose is not None:
        return Lying(pose.apply(body.centre[None])[0], pose.rotation)
    centre = _middle(points, body.radius_mm)
    return None if centre is None else Lying(centre, None)


def live_points(lenses: Lenses, dots: Mapping[str, Dots]) -> tuple[IntArray, FloatArray]:
    """The dots that two cameras or more see now: keys (n,) and places (n, 3) mm."""
    rows = [(lenses.names.index(name), one) for name, one in dots.items() if name in lenses.names and len(one)]
    if len(rows) < 2:
        return np.empty(0, np.int64), np.empty((0, 3))
    camera = np.repeat([c for c, _ in rows], [len(one) for _, one in rows])
    every = np.concatenate([one.keys for _, one in rows])
    keys, feature = np.unique(every, return_inverse=True)
    feature = feature.reshape(-1)
    uv = np.concatenate([one.uv for _, one in rows])
    cameras = PosedCameras(lenses.intrinsics, lenses.rotation, lenses.translation)
    found = triangulate(feature, camera, uv, np.ones(len(uv)), len(keys), cameras)
    worst = np.zeros(len(keys))
    np.maximum.at(worst, feature, np.nan_to_num(np.linalg.norm(found.residual, axis=1), nan=np.inf))
    good = np.isfinite(found.points[:, 0]) & (found.views >= 2) & found.in_front & (worst < _MISFIT_PX)
    return keys[good], found.points[good]


def bar_ends(lenses: Lenses, dots: Mapping[str, Dots], targets: Collection[int]) -> FloatArray | None:
    """The two ends (2, 3) mm of a bar by the outermost of its marks that two cameras see; None where none are."""
    own = {name: one.of_targets(targets) for name, one in dots.items()}
    _, points = live_points(lenses, own)
    if len(points) < 2:
        return None
    away = np.linalg.norm(points[:, None] - points[None], axis=2)
    first, last = np.unravel_index(int(np.argmax(away)), away.shape)
    return points[[first, last]]


def _middle(points: FloatArray, radius_mm: float) -> FloatArray | None:
    """The middle of a ball of known radius of which these points (n, 3) are seen; three steps of Gauss and Newton."""
    start = fit_sphere(points)
    if start is None:
        return None
    middle = start.centre
    for _ in range(10):
        way = middle - points
        far = np.linalg.norm(way, axis=1)
        step = np.linalg.lstsq(way / far[:, None], radius_mm - far, rcond=None)[0]
        middle = middle + step
    return middle if np.isfinite(middle).all() else None


def to_go(ghost: Ghost, lying: Lying) -> ToGo:
    """How far the ball still is from where it should go."""
    up, lenses, way = ghost.body.up, ghost.lenses, ghost.centre - lying.centre
    away = float(np.linalg.norm(way))
    level = way - (way @ up) * up
    axis = None if lying.turn is None else log_rotation(ghost.turn @ lying.turn.T)
    turn = None if axis is None else float(np.degrees(np.linalg.norm(axis)))
    near = away <= NEAR * ghost.body.radius_mm and (turn is None or turn <= NEAR_DEG)
    left, tips = False, ""
    if axis is not None and turn is not None and turn > 0:
        steep = float(axis @ up) / np.radians(turn)
        left = steep > 0
        tips = "" if abs(steep) >= _UPRIGHT else _towards(lenses, ghost.centre, np.cross(axis, up))
    towards = _towards(lenses, lying.centre, level)
    return ToGo(away, turn, near, float(np.linalg.norm(level)), float(way @ up), towards, left, tips)


def _towards(lenses: Lenses, start: FloatArray, way: FloatArray) -> str:
    """The camera that lies best in a direction (3,) from a place (3,) mm."""
    to = -np.einsum("cji,cj->ci", lenses.rotation, lenses.translation) - start
    along = to @ way / np.maximum(np.linalg.norm(to, axis=1), 1e-9)
    return lenses.names[int(np.argmax(along))]


def drawn(ghost: Ghost, lying: Lying | None) -> dict[str, Drawn]:
    """The ghost and the ball in every camera's image. `lying` None: not known, and nothing is drawn of it."""
    nothing = np.empty((0, 2))
    pole = ghost.body.up * ghost.body.radius_mm
    found = {}
    for c, name in enumerate(ghost.lenses.names):
        wanted = outline(ghost.lenses, c, ghost.centre, ghost.body.radius_mm)
        top = _seen(ghost.lenses, c, np.stack([ghost.centre, ghost.centre + ghost.turn @ pole]))
        now, now_top = nothing, nothing
        if lying is not None:
            now = outline(ghost.lenses, c, lying.centre, ghost.body.radius_mm)
            if lying.turn is not None:
                now_top = _seen(ghost.lenses, c, np.stack([lying.centre, lying.centre + lying.turn @ pole]))
        found[name] = Drawn(wanted, top, now, now_top)
    return found


def drawn_bar(lenses: Lenses, wanted: FloatArray, lying: FloatArray | None) -> dict[str, Drawn]:
    """A bar's ends (2, 3) mm where it should lie and where it lies (None: not known), in every camera's image."""
    found = {}
    for c, name in enumerate(lenses.names):
        line = _seen(lenses, c, wanted)
        now = np.empty((0, 2)) if lying is None else _seen(lenses, c, lying)
        found[name] = Drawn(line, line, now, now)
    return found


def outline(lenses: Lenses, camera: int, centre: FloatArray, radius_mm: float) -> FloatArray:
    """A ball's outline in a camera, (72, 2) px; empty where the ball is not before the camera."""
    place = lenses.rotation[camera] @ centre + lenses.translation[camera]
    far = float(np.linalg.norm(place))
    if place[2] <= radius_mm or far <= radius_mm:
        return np.empty((0, 2))
    way = place / far
    across = np.cross(way, (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across)
    down = np.cross(way, across)
    # rays touch the ball along a circle whose plane is at right angles to the way to its centre
    angle = np.linspace(0, 2 * np.pi, _OUTLINE, endpoint=False)
    ring = radius_mm * np.sqrt(1 - (radius_mm / far) ** 2)
    middle = way * (far - radius_mm**2 / far)
    circle = middle + ring * (np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * down)
    return _projected(lenses, camera, circle)


def _projected(lenses: Lenses, camera: int, places: FloatArray) -> FloatArray:
    """Places (n, 3) in a camera's frame, px; drawn in to the edge of its lens model. Empty where all lie beyond."""
    reach = image_reach(lenses.intrinsics[camera : camera + 1], lenses.size[camera : camera + 1])[0]
    flat = places[:, :2] / places[:, 2:]
    tan = np.linalg.norm(flat, axis=1)
    if not (tan < reach).any():
        return np.empty((0, 2))
    # beyond it the model folds over: a place far outside the image would be drawn in the middle of it
    drawn_in = flat * np.minimum(1.0, reach / np.maximum(tan, 1e-12))[:, None]
    return project(np.column_stack([drawn_in, np.ones(len(places))]), lenses.intrinsics[camera])


def _seen(lenses: Lenses, camera: int, places: FloatArray) -> FloatArray:
    """Places (n, 3) mm in a camera's image; empty where one is behind it."""
    x = places @ lenses.rotation[camera].T + lenses.translation[camera]
    return _projected(lenses, camera, x) if (x[:, 2] > 0).all() else np.empty((0, 2))


def thinned(dots: SetDots, most: int) -> SetDots:
    """The same with about this many dots in each camera at most, the same dots in all of them: a coarse answer soon."""
    largest = max((len(one) for one in dots.values()), default=0)
    every = int(np.ceil(largest / most)) if largest > most else 1
    if every == 1:
        return dots
    kept = {}
    for name, one in dots.items():
        keep = one.keys * 2654435761 % 2**32 % every == 0
        kept[name] = Dots(one.target[keep], one.point[keep], one.uv[keep], one.image_size)
    return kept


def stage_ball(stage: "Stage", ghost: Ghost, lying: Lying | None) -> None:
    """Move the ball of a simulated rig from where it is seen to the ghost, as hands would, led by the cameras."""
    if lying is None:
        return
    lenses, truth = ghost.lenses, stage.truth
    true = {camera.id: camera for camera in truth.cameras}
    first = lenses.names[0]
    turn = true[first].rotation.T @ lenses.rotation[0]  # from the rig's frame to that of the simulation
    shift = turn @ (ghost.centre - lying.centre)
    rotation = np.eye(3) if lying.turn is None else turn @ (ghost.turn @ lying.turn.T) @ turn.T
    stage.move(tuple(shift.tolist()), tuple(np.degrees(log_rotation(rotation)).tolist()))
