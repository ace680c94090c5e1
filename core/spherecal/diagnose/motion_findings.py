"""Findings: cameras that moved, images that belong elsewhere, cameras whose images were exchanged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import AdvisedRepair, Finding, leave_out
from spherecal.diagnose.anomalies import Anomalies
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.group_motion import GroupMotion
from spherecal.diagnose.image_findings import LEAST_POINTS, WrongImage
from spherecal.diagnose.moves import LEAST_STATISTIC, Move, alike
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.resection import resect
from spherecal.geometry.rotation import log_rotation

# Moves larger than this are measured by resection: linear tests are good for small ones.
FAR_PX = 3.0
# Nothing turns over between two placements; images do, by a setting (180 degrees to 1 in the cases tried).
HALF_TURN_RAD = 0.1
_TINY_RAD = 1.7e-4  # 0.01 degrees: smaller turns are said in microradians
# A camera that was knocked and kept in the adjustment has many times the others' noise, which hides the knock from the
# linear tests: 9 to 250 times, turned by 1 mrad and by 1 degree behind lenses off by 0.03 px, and VALID with residuals
# of 17 px. Two poses fit it 2.2 and 3.3 times better, as far as its bent lens lets them; what is only blurred, not.
MANY_TIMES, CLEARLY_BETTER = 5.0, 2.0


@dataclass(frozen=True)
class TwoPoseFit:
    """A camera's images in `placements` are from elsewhere, by a motion (mm); `fit_px` with one pose and with two."""

    camera: int
    placements: tuple[int, ...]
    rotation_rad: float
    translation: float
    fit_px: tuple[float, float]


def motion_findings(e: Evidence, anomalies: Anomalies, wrong: Sequence[WrongImage]) -> list[Finding]:
    """A finding for every camera that moved, the largest move first; images that belong elsewhere are not moves."""
    if (motion := anomalies.group_motion) is not None:
        return [_by(motion.image_change_px, _group_motion(e, motion))]
    if anomalies.explained:
        return [_moved(e, move) for move in anomalies.moves]
    mixed_up = {image.camera for image in wrong if image.kind in ("other-camera", "other-placement")}
    contradicting = {i.camera for i in wrong if i.kind in ("moved", "unknown")} if not mixed_up else set()
    far = {move.camera for move in anomalies.moves if move.image_change_px > FAR_PX} - mixed_up
    found = [fit for c in sorted(contradicting | far) if (fit := resect_two_poses(e, c)) is not None]
    found += _knocked(e, {move.camera for move in anomalies.moves} | contradicting | mixed_up)
    reported = {fit.camera for fit in found} | mixed_up
    seen_elsewhere = [] if mixed_up else [i for i in wrong if i.kind == "moved" and i.camera not in reported]
    cameras = {image.camera for image in seen_elsewhere}
    left_out = [_left_out(e, [i for i in seen_elsewhere if i.camera == c], anomalies.moves) for c in sorted(cameras)]
    reported |= cameras
    rest = [_moved(e, move) for move in anomalies.moves if move.camera not in reported]
    return [*(_from_two_poses(e, fit) for fit in found), *left_out, *rest]


def _knocked(e: Evidence, known: set[int]) -> list[TwoPoseFit]:
    """Two poses of cameras that are far noisier than the others, and clearly less so with two."""
    noise = e.noise_px
    usual = noise[e.placed & np.isfinite(noise)]
    median = float(np.median(usual)) if len(usual) else np.inf
    noisy = set(np.flatnonzero(e.placed & (noise > MANY_TIMES * median)).tolist()) - known
    found = (resect_two_poses(e, c) for c in sorted(noisy))
    return [fit for fit in found if fit is not None and fit.fit_px[0] > CLEARLY_BETTER * fit.fit_px[1]]


def _by(image_change_px: float, finding: Finding) -> Finding:
    """The finding with what the motion shifts image points by."""
    return replace(finding, values={**finding.values, "px": image_change_px})


def _group_motion(e: Evidence, found: GroupMotion) -> Finding:
    """The finding on cameras that moved together, on a ball that moved between exposures, or on another rig."""
    at = tuple(e.observations.placements[t] for t in found.placements)
    if len(found.cameras) == 1 and abs(found.rotation_rad - np.pi) < HALF_TURN_RAD:
        return _half_turned(e, found.cameras[0])
    turned = np.rad2deg(found.rotation_rad)
    size = Phrase("move-degrees", {"shift": _shift(e, found.translation * e.solution.factor), "degrees": turned})
    sure = Phrase(
        "shows-group",
        {"px": found.image_change_px, "chi_square": found.statistic, "dof": found.dof, "noise": found.variance_factor},
    )
    if found.kind == "placement":
        values, repairs = {"size": size, "evidence": sure}, leave_out(f"placement:{at[0]}")
        return Finding("placements-contradict", "warning", values, at[:1], repairs, "another-rig")
    if len(found.cameras) == 1 and (found.kind == "cameras" or len(at) == 1):
        return _finding(e, found.cameras[0], set(found.placements), size, sure)
    names = tuple(e.camera_ids[c] for c in found.cameras)
    return (_cameras_moved if found.kind == "cameras" else _ball_moved)(names, at, size, sure, found.ambiguous)


def _half_turned(e: Evidence, camera: int) -> Finding:
    return Finding("mirrored", "error", where=(e.camera_ids[camera],), kind="turned")


def _cameras_moved(names: tuple[str, ...], at: tuple[str, ...], size: Phrase, sure: Phrase, ambiguous: bool) -> Finding:
    other = Phrase("or-the-ball", {"place": at[0]}) if ambiguous else None
    values = {"cameras": names, "place": at[0], "size": size, "evidence": sure, "instead": other}
    repairs = tuple(AdvisedRepair("split", f"{name}@{at[0]}") for name in names)
    return Finding("cameras-moved", "warning", values, (*names, at[0]), repairs)


def _ball_moved(names: tuple[str, ...], at: tuple[str, ...], size: Phrase, sure: Phrase, ambiguous: bool) -> Finding:
    if len(names) == 1:  # the ball was at rest for all others: what touches one camera alone is that camera's
        values = {"camera": names[0], "places": at, "size": size, "evidence": sure}
        return Finding("camera-unsteady", "warning", values, (*names, *at), leave_out(f"camera:{names[0]}"))
    other = Phrase("or-the-cameras", {"cameras": names}) if ambiguous else None
    values = {"cameras": names, "places": at, "size": size, "evidence": sure, "instead": other}
    return Finding("ball-moved", "warning", values, (*names, *at))


def _left_out(e: Evidence, images: list[WrongImage], moves: Sequence[Move]) -> Finding:
    """A camera some of whose images were left out, but show their points from another pose."""
    camera = images[0].camera
    out = {image.placement for image in images}
    o, seen = e.observations, _seen_by(e, camera)
    # of those that were kept some may be from elsewhere too, and a set and the rest are the same test
    tested = next((set(move.placements) for move in moves if move.camera == camera), set[int]())
    ways = (out | tested, out | (seen - out - tested), out) if tested else (out,)
    placements = next((way for way in ways if way != seen and _from(sorted(seen), way) is not None), out)
    rows = (o.camera == camera) & np.isin(o.placement, sorted(out)) & np.isfinite(e.residual_px[:, 0])
    size = Phrase("move-pixels", {"px": np.median(np.linalg.norm(e.residual_px[rows], axis=1))})
    counts = {"out": sum(i.left_out for i in images), "points": sum(i.points for i in images)}
    return _finding(e, camera, placements, size, Phrase("shows-left-out", counts))


def moved_cameras(e: Evidence, findings: Sequence[Finding]) -> set[str]:
    """Ids of the cameras that some findings say have moved."""
    codes = ("camera-moved", "cameras-moved", "camera-unsteady", "ball-moved")
    where = {name for finding in findings if finding.code in codes for name in finding.where}
    return where & set(e.camera_ids)


def _moved(e: Evidence, move: Move) -> Finding:
    rotation, translation = (float(np.linalg.norm(part)) for part in (move.step[:3], move.step[3:] * e.solution.factor))
    if abs(rotation - np.pi) < HALF_TURN_RAD:
        return _half_turned(e, move.camera)
    size = _size(e, move.camera, translation, rotation)
    if rotation < _TINY_RAD:
        size = Phrase("move-microradians", {"shift": _shift(e, translation), "microradians": 1e6 * rotation})
    sure = Phrase(
        "shows-move",
        {"px": move.image_change_px, "chi_square": move.statistic, "dof": move.dof, "limit": LEAST_STATISTIC},
    )
    return _by(move.image_change_px, _finding(e, move.camera, set(move.placements), size, sure, move.rivals))


def _from_two_poses(e: Evidence, fit: TwoPoseFit) -> Finding:
    if abs(fit.rotation_rad - np.pi) < HALF_TURN_RAD:
        return _half_turned(e, fit.camera)
    sure = Phrase("shows-knock", {"one_px": fit.fit_px[0], "two_px": fit.fit_px[1]})
    size = _size(e, fit.camera, fit.translation, fit.rotation_rad)
    return _finding(e, fit.camera, set(fit.placements), size, sure)


def _size(e: Evidence, camera: int, translation: float, rotation_rad: float) -> Phrase:
    """How far a camera moved; only turned where its shift moves the images ten times less than its turn."""
    state = e.solution.state
    seen = state.points[np.unique(e.features.of_observation[(e.observations.camera == camera) & e.used])]
    distance = np.median(np.linalg.norm(seen @ state.rotation[camera].T + state.translation[camera], axis=1))
    key = "move-turned" if translation < 0.1 * rotation_rad * distance else "move-degrees"
    return Phrase(key, {"shift": _shift(e, translation), "degrees": np.rad2deg(rotation_rad)})


def _shift(e: Evidence, translation: float) -> Phrase:
    return Phrase("shift-mm" if e.solution.scale.source != "none" else "shift-no-scale", {"shift": translation})


def _finding(
    e: Evidence, camera: int, placements: set[int], size: Phrase, sure: Phrase, rivals: Sequence[int] = ()
) -> Finding:
    """The finding on a camera that moved, from which placement on if there is one; `rivals`: others that may have."""
    name, names = e.camera_ids[camera], e.observations.placements
    first = _from(sorted(_seen_by(e, camera)), placements)
    others = tuple(e.camera_ids[c] for c in rivals)
    if others:
        sure = Phrase("shows-rivals", {"evidence": sure, "camera": name, "others": others})
    values = {"camera": name, "size": size, "evidence": sure}
    if first is None:
        at = [names[t] for t in sorted(placements)]
        repairs = leave_out(*(f"{name}@{place}" for place in at))
        return Finding("camera-moved", "warning", {**values, "places": at}, (name, *others, *at), repairs, "only-at")
    place = names[first]
    split = (AdvisedRepair("split", f"{name}@{place}"),)
    return Finding("camera-moved", "warning", {**values, "place": place}, (name, *others, place), split, "before")


def _seen_by(e: Evidence, camera: int) -> set[int]:
    """The placements of the ball that a camera saw: of bars, which follow, it has too few points to show a pose."""
    o = e.observations
    return set(np.unique(o.placement[(o.camera == camera) & (o.placement < len(e.session.placements))]).tolist())


def _from(seen: list[int], placements: set[int]) -> int | None:
    """The placement from which a camera has another pose, if its observations are split in two there; else None."""
    for k in range(1, len(seen)):
        if placements in (set(seen[k:]), set(seen[:k])):
            return seen[k]
    return None


def mixed_up_images(e: Evidence, wrong: Sequence[WrongImage]) -> list[Finding]:
    """Findings on exchanged cameras and images of another placement."""
    return [*_swapped(e, wrong), *_wrong_placements(e, wrong)]


def unexplained_images(e: Evidence, wrong: Sequence[WrongImage], explained: set[str]) -> list[Finding]:
    """The finding on images that contradict the rest for unknown reasons."""
    unknown = [i for i in wrong if i.kind in ("moved", "unknown") and not explained & set(_names(e, i))]
    if not unknown:
        return []
    where = [f"{e.camera_ids[i.camera]}@{e.observations.placements[i.placement]}" for i in unknown]
    some = unknown[0]
    values = {"images": where, "out": some.left_out, "points": some.points}
    named = tuple(dict.fromkeys(name for i in unknown for name in _names(e, i)))
    return [Finding("image-contradicts", "warning", values, named, leave_out(*where), "images")]


def _names(e: Evidence, image: WrongImage) -> tuple[str, str]:
    return e.camera_ids[image.camera], e.observations.placements[image.placement]


def _swapped(e: Evidence, wrong: Sequence[WrongImage]) -> list[Finding]:
    placements: dict[tuple[int, int], set[int]] = {}
    shows = {(i.camera, i.placement): i.other for i in wrong if i.kind == "other-camera"}
    for (camera, placement), other in shows.items():
        assert other is not None
        placements.setdefault((min(camera, other), max(camera, other)), set()).add(placement)
    found = []
    for pair, at in placements.items():
        a, b = (e.camera_ids[c] for c in pair)
        names = [e.observations.placements[t] for t in sorted(at)]
        share = [i for i in wrong if i.kind == "other-camera" and {i.camera, i.other} == set(pair)]
        counts = {"fitting": sum(i.left_out for i in share), "points": sum(i.points for i in share), "places": names}
        is_mutual = any(shows.get((pair[0], t)) == pair[1] and shows.get((pair[1], t)) == pair[0] for t in at)
        if is_mutual:
            values = {"first": a, "second": b}
            repairs = tuple(AdvisedRepair("swap", f"{a},{b}@{name}") for name in names)
        else:
            values = {"camera": _names(e, share[0])[0], "other": b if share[0].camera == pair[0] else a}
            repairs = leave_out(*("@".join(_names(e, i)) for i in share))
        severity = "warning" if e.placed[list(pair)].all() else "error"
        kind = "exchanged" if is_mutual else "shows-other"
        found.append(Finding("cameras-swapped", severity, values | counts, (a, b, *names), repairs, kind))
    return found


def _wrong_placements(e: Evidence, wrong: Sequence[WrongImage]) -> list[Finding]:
    found = []
    for image in (i for i in wrong if i.kind == "other-placement"):
        camera, placement = _names(e, image)
        assert image.other is not None
        shown = e.observations.placements[image.other]
        values = {"camera": camera, "place": placement, "shown": shown, "out": image.left_out, "points": image.points}
        where, repairs = (camera, placement, shown), leave_out(f"{camera}@{placement}")
        found.append(Finding("wrong-placement", "warning", values, where, repairs))
    return found


# --- cameras that were bumped far ------------------------------------------------------------------------------------
#
# A move of a pixel and more lets the gate take what it likes, and one of many pixels bends the camera's intrinsics,
# so that linear tests mislead. Here every way to part the camera's images in two is tried. Both parts are resected on
# the points that the other cameras gave, with the intrinsics found and, as these may be bent, with the prior's.

# Points beyond this count as wrong. Nominal intrinsics leave residuals of 1 to 5 px.
GATE_PX = 12.0
# Two poses must fit this many times better than one (mean size of the residuals).
BETTER = 1.5


def resect_two_poses(e: Evidence, camera: int) -> TwoPoseFit | None:
    """The best partition of a camera's images in two, None where one pose fits them as well."""
    both = (e.solution.state.intrinsics[camera], e.session.cameras[camera].prior)
    found = [fit for intrinsics in both if (fit := _best_partition(e, camera, intrinsics)) is not None]
    return min(found, key=lambda fit: fit.fit_px[1], default=None)


def _best_partition(e: Evidence, camera: int, intrinsics: FloatArray) -> TwoPoseFit | None:
    o, state = e.observations, e.solution.state
    points = state.points[e.features.of_observation]
    rows = np.flatnonzero((o.camera == camera) & np.isfinite(points[:, 0]))
    seen, count = np.unique(o.placement[rows], return_counts=True)
    seen = seen[count >= LEAST_POINTS]
    rows = rows[np.isin(o.placement[rows], seen)]
    if len(seen) < 2:
        return None
    xy, usable = undistort(o.uv[rows], intrinsics)
    rows, xy = rows[usable], xy[usable]
    one = _fit(points[rows], xy, o.uv[rows], intrinsics)
    best: tuple[float, tuple[int, ...], FloatArray, FloatArray] | None = None
    for some in alike(seen):
        there = np.isin(o.placement[rows], some)
        parts = [_fit(points[rows[p]], xy[p], o.uv[rows[p]], intrinsics) for p in (~there, there)]
        if parts[0] is None or parts[1] is None:
            continue
        error = float(np.average([parts[0][0], parts[1][0]], weights=[(~there).sum(), there.sum()]))
        if best is None or error < best[0]:
            rotation_change = log_rotation(parts[1][1] @ parts[0][1].T)
            centres = [-part[1].T @ part[2] for part in parts if part is not None]
            best = (error, some, rotation_change, centres[1] - centres[0])
    whole = GATE_PX if one is None else one[0]
    if best is None or whole < BETTER * best[0]:
        return None
    rotation_rad, shift = float(np.linalg.norm(best[2])), float(np.linalg.norm(best[3]))
    return TwoPoseFit(camera, best[1], rotation_rad, shift, (whole, best[0]))


def _fit(
    points: FloatArray, xy: FloatArray, uv: FloatArray, intrinsics: FloatArray
) -> tuple[float, FloatArray, FloatArray] | None:
    """Mean residual (px, wrong ones as the gate) and pose of a resection; None where there is none."""
    pose = resect(points, xy, GATE_PX / intrinsics[0])
    if pose is None:
        return None
    rotation, translation, _ = pose
    x = points @ rotation.T + translation
    with np.errstate(all="ignore"):
        size = np.linalg.norm(project(x, np.broadcast_to(intrinsics, (len(x), 16))) - uv, axis=1)
    return float(np.where(size < GATE_PX, size, GATE_PX).mean()), rotation, translation
