"""Findings: cameras that moved, images that belong elsewhere, cameras whose images were exchanged."""

from collections.abc import Sequence

import numpy as np

from spherecal.diagnose.anomalies import Anomalies
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.group_motion import GroupMotion
from spherecal.diagnose.images import WrongImage
from spherecal.diagnose.knocked import Knock, find_knock
from spherecal.diagnose.moves import LEAST_STATISTIC, Move
from spherecal.findings import Finding

# Moves larger than this are measured by resection: linear tests are good for small ones.
FAR_PX = 3.0


def motion_findings(e: Evidence, anomalies: Anomalies, wrong: Sequence[WrongImage]) -> list[Finding]:
    """A finding for every camera that moved, the grossest first; images that belong elsewhere are no moves."""
    if anomalies.group_motion is not None:
        return [_group_motion(e, anomalies.group_motion)]
    if anomalies.explained:
        return [_moved(e, move) for move in anomalies.moves]
    mixed_up = {image.camera for image in wrong if image.kind in ("other-camera", "other-placement")}
    contradicting = {i.camera for i in wrong if i.kind in ("moved", "unknown")} if not mixed_up else set()
    far = {move.camera for move in anomalies.moves if move.image_change_px > FAR_PX} - mixed_up
    knocks = [knock for c in sorted(contradicting | far) if (knock := find_knock(e, c)) is not None]
    told = {knock.camera for knock in knocks} | mixed_up
    seen_elsewhere = [] if mixed_up else [i for i in wrong if i.kind == "moved" and i.camera not in told]
    left_out = [_left_out(e, own, anomalies.moves) for own in _by_camera(seen_elsewhere)]
    told |= {image.camera for image in seen_elsewhere}
    rest = [_moved(e, move) for move in anomalies.moves if move.camera not in told]
    return [*(_knocked(e, knock) for knock in knocks), *left_out, *rest]


def _group_motion(e: Evidence, found: GroupMotion) -> Finding:
    """The finding on cameras that moved together, on a ball that moved between exposures, or on another rig."""
    at = tuple(e.observations.placements[t] for t in found.placements)
    size = f"{_shift(e, found.shift * e.solution.factor)} and {np.rad2deg(found.turn_rad):.2g} degrees"
    sure = (
        f"that shifts image points by {found.image_change_px:.2g} px (chi-square {found.statistic:.0f} on {found.dof} "
        f"degrees of freedom) and explains what the images' poses differ by, to {found.variance_factor:.1f} times noise"
    )
    if found.kind == "placement":
        return _another_rig(at[0], size, sure)
    if len(found.cameras) == 1 and (found.kind == "cameras" or len(at) == 1):
        return _finding(e, found.cameras[0], set(found.placements), size, sure)
    names = tuple(e.camera_ids[c] for c in found.cameras)
    return (_cameras_moved if found.kind == "cameras" else _ball_moved)(names, at, size, sure, found.ambiguous)


def _another_rig(at: str, size: str, sure: str) -> Finding:
    return Finding(
        "warning", "placements-contradict",
        f"At {at} all cameras have other poses relative to each other than at the other placements, by up to {size}: "
        f"{sure}.",
        "Was it recorded before the rig was changed, or was something moving? Calibrate again with "
        f"--leave-out placement:{at}, or record it again.",
        (at,),
    )  # fmt: skip


def _cameras_moved(names: tuple[str, ...], at: tuple[str, ...], size: str, sure: str, ambiguous: bool) -> Finding:
    other = f" It may as well be that the ball moved at {at[0]} between their exposures." if ambiguous else ""
    split = " ".join(f"--split {name}@{at[0]}" for name in names)
    return Finding(
        "warning", "cameras-moved",
        f"Cameras {', '.join(names)} moved together before {at[0]}, by about {size}: {sure}.{other}",
        "Was the part of the frame that they hang on touched, or did it sag? Fasten it. Calibrate again with "
        f"{split}, or record again.",
        (*names, at[0]),
    )  # fmt: skip


def _ball_moved(names: tuple[str, ...], at: tuple[str, ...], size: str, sure: str, ambiguous: bool) -> Finding:
    several = len(names) > 1
    who = f"{'cameras' if several else 'camera'} {', '.join(names)}"
    other = f" It may as well be that {who} moved together." if ambiguous and several else ""
    return Finding(
        "warning", "ball-moved",
        f"At {', '.join(at)} the ball was in another place for {who} than for the others, by up to {size}: "
        f"{sure}.{other}",
        "The ball moved between their exposures" + ("" if several else ", or the camera hangs loose")
        + ". Trigger all cameras at once, let the ball come to rest, and record again.",
        (*names, *at),
    )  # fmt: skip


def _by_camera(images: Sequence[WrongImage]) -> list[list[WrongImage]]:
    return [[i for i in images if i.camera == c] for c in sorted({i.camera for i in images})]


def _left_out(e: Evidence, images: list[WrongImage], moves: Sequence[Move]) -> Finding:
    """A camera some of whose images were left out, but show their points from another pose."""
    camera = images[0].camera
    out = {image.placement for image in images}
    o = e.observations
    seen = set(np.unique(o.placement[o.camera == camera]).tolist())
    # of those that were kept some may stand elsewhere too, and a set and the rest are the same test
    tested = next((set(move.placements) for move in moves if move.camera == camera), set[int]())
    ways = (out | tested, out | (seen - out - tested), out) if tested else (out,)
    placements = next((way for way in ways if way != seen and _from(sorted(seen), way) is not None), out)
    rows = (o.camera == camera) & np.isin(o.placement, sorted(out)) & np.isfinite(e.residual_px[:, 0])
    size = f"{np.median(np.linalg.norm(e.residual_px[rows], axis=1)):.2g} px in its images"
    sure = f"{sum(i.left_out for i in images)} of {sum(i.points for i in images)} points there contradict the other "
    return _finding(e, camera, placements, size, sure + "cameras and agree with each other from another pose")


def moved_cameras(e: Evidence, findings: Sequence[Finding]) -> set[str]:
    """Ids of the cameras that some findings say have moved."""
    codes = ("camera-moved", "cameras-moved", "ball-moved")
    where = {name for finding in findings if finding.code in codes for name in finding.where}
    return where & set(e.camera_ids)


def _moved(e: Evidence, move: Move) -> Finding:
    turn, shift = np.linalg.norm(move.step[:3]), np.linalg.norm(move.step[3:]) * e.solution.factor
    size = f"{_shift(e, float(shift))} and {1e6 * turn:.0f} microradians"
    sure = f"chi-square {move.statistic:.0f} on {move.dof} degrees of freedom; noise stays below {LEAST_STATISTIC:.0f}"
    effect = f"its image points shift by {move.image_change_px:.2g} px"
    return _finding(e, move.camera, set(move.placements), size, f"{effect} ({sure})", move.rivals)


def _knocked(e: Evidence, knock: Knock) -> Finding:
    size = f"{_shift(e, knock.shift)} and {np.rad2deg(knock.turn_rad):.2g} degrees"
    sure = f"resected with two poses its points are off by {knock.fit_px[1]:.1f} px in the mean, "
    sure += f"with one by {knock.fit_px[0]:.1f} px"
    return _finding(e, knock.camera, set(knock.placements), size, sure)


def _shift(e: Evidence, shift: float) -> str:
    return f"{shift:.2g} mm" if e.solution.scale.source != "none" else f"{shift:.2g} (no scale)"


def _finding(
    e: Evidence, camera: int, placements: set[int], size: str, sure: str, rivals: Sequence[int] = ()
) -> Finding:
    """The finding on a camera that moved: with the placement from which on it has its second pose, if there is one.

    `rivals`: cameras of which the same may be said.
    """
    name, names = e.camera_ids[camera], e.observations.placements
    o = e.observations
    seen = np.unique(o.placement[o.camera == camera])
    first = _from(seen.tolist(), placements)
    others = tuple(e.camera_ids[c] for c in rivals)
    if others:
        sure += f"; the observations cannot tell whether it was {name} or {' or '.join(others)}"
    if first is None:
        at = " and ".join(names[t] for t in sorted(placements))
        options = " ".join(f"--leave-out {name}@{names[t]}" for t in sorted(placements))
        return Finding(
            "warning", "camera-moved",
            f"Camera {name} stood elsewhere at {at} only, by about {size}: {sure}.",
            f"Was it touched, or did the ball still move? Calibrate again with {options}.",
            (name, *others, *(names[t] for t in sorted(placements))),
        )  # fmt: skip
    return Finding(
        "warning", "camera-moved",
        f"Camera {name} has moved before {names[first]}, by about {size}: {sure}.",
        f"Fix the camera's mount. Calibrate again with --split {name}@{names[first]}: it gets a second pose from there "
        "on, the one that rig.json then has. Nothing is lost by it.",
        (name, *others, names[first]),
    )  # fmt: skip


def _from(seen: list[int], placements: set[int]) -> int | None:
    """The placement from which on a camera stands elsewhere: what it sees splits in two there, None if it does not."""
    for k in range(1, len(seen)):
        if placements in (set(seen[k:]), set(seen[:k])):
            return seen[k]
    return None


def mixed_up_images(e: Evidence, wrong: Sequence[WrongImage]) -> list[Finding]:
    """Findings on exchanged cameras and images of another placement."""
    return [*_exchanged(e, wrong), *_wrong_placements(e, wrong)]


def unexplained_images(e: Evidence, wrong: Sequence[WrongImage], explained: set[str]) -> list[Finding]:
    """The finding on images that contradict the rest for no reason found; `explained` cameras are left out."""
    unknown = [i for i in wrong if i.kind in ("moved", "unknown") and not explained & set(_names(e, i))]
    if not unknown:
        return []
    where = [f"{e.camera_ids[i.camera]}@{e.observations.placements[i.placement]}" for i in unknown]
    some = unknown[0]
    return [
        Finding(
            "warning", "image-contradicts",
            f"{len(unknown)} image{'s' if len(unknown) > 1 else ''} contradict{'' if len(unknown) > 1 else 's'} all "
            f"others and {'are' if len(unknown) > 1 else 'is'} hardly used: {', '.join(where)} ({some.left_out} of "
            f"{some.points} points left out in the first).",
            "A wrong file, a camera that was touched, or a ball that moved during the recording? Look at them, or "
            f"calibrate with {' '.join('--leave-out ' + name for name in where)}.",
            tuple(dict.fromkeys(name for i in unknown for name in _names(e, i))),
        )
    ]  # fmt: skip


def _names(e: Evidence, image: WrongImage) -> tuple[str, str]:
    return e.camera_ids[image.camera], e.observations.placements[image.placement]


def _exchanged(e: Evidence, wrong: Sequence[WrongImage]) -> list[Finding]:
    placements: dict[tuple[int, int], list[int]] = {}
    mutual: set[tuple[int, int]] = set()
    shows = {(i.camera, i.placement): i.other for i in wrong if i.kind == "other-camera"}
    for (camera, placement), other in shows.items():
        assert other is not None
        pair = (min(camera, other), max(camera, other))
        placements.setdefault(pair, [])
        if placement not in placements[pair]:
            placements[pair].append(placement)
        if shows.get((other, placement)) == camera:
            mutual.add(pair)
    found = []
    for pair, at in placements.items():
        a, b = (e.camera_ids[c] for c in pair)
        names = [e.observations.placements[t] for t in sorted(at)]
        share = [i for i in wrong if i.camera in pair and i.placement in at]
        sure = f"{sum(i.left_out for i in share)} of {sum(i.points for i in share)} points there fit the other camera"
        if pair in mutual:
            repair = " ".join(f"--swap {a},{b}@{name}" for name in names)
            message = f"The images of cameras {a} and {b} are exchanged at {', '.join(names)}: {sure}."
        else:
            repair = " ".join(f"--leave-out {e.camera_ids[i.camera]}@{names[0]}" for i in share)
            message = f"Camera {_names(e, share[0])[0]} shows the image of {b if share[0].camera == pair[0] else a} "
            message += f"at {', '.join(names)}: {sure}."
        hint = f"Check the files and the cameras' serial numbers, or calibrate again with {repair}, which is safe here."
        found.append(Finding("error" if not e.placed[list(pair)].all() else "warning", "cameras-swapped", message, hint,
                             (a, b, *names)))  # fmt: skip
    return found


def _wrong_placements(e: Evidence, wrong: Sequence[WrongImage]) -> list[Finding]:
    found = []
    for image in (i for i in wrong if i.kind == "other-placement"):
        camera, placement = _names(e, image)
        assert image.other is not None
        shown = e.observations.placements[image.other]
        found.append(
            Finding(
                "warning", "wrong-placement",
                f"The image of camera {camera} at {placement} shows the ball at {shown}: {image.left_out} of "
                f"{image.points} points fit there.",
                "An old image was stored once more. Calibrate again with "
                f"--leave-out {camera}@{placement}, which is safe here.",
                (camera, placement, shown),
            )
        )  # fmt: skip
    return found
