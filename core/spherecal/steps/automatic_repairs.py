"""Repairs that nobody needs to ask for: wrong images left out, moved cameras split, where the findings are certain.

A calibration that is not valid is repeated with the repairs that its findings advise. They stay only where the result
is valid after them, or at least has fewer reasons not to be; rig.json lists them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import IntArray
from spherecal.base.errors import InputError
from spherecal.data.findings import AdvisedRepair, Finding, leave_out
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.data.verdict import effect
from spherecal.diagnose.camera_findings import pose_scatter
from spherecal.diagnose.image_findings import LEAST_POINTS
from spherecal.diagnose.moves import most_moved
from spherecal.geometry.rotation import log_rotation
from spherecal.steps.repairs import Repairs, placements_seen_by, repaired

TURNS = 3
# A camera that was knocked is this near its former pose; what is farther is another image (stale ones were
# 373 to 1128 mm and 51 degrees off; knocks tried are up to 50 mm and 3 degrees).
FAR_MM, FAR_RAD = 250.0, 0.3
# A camera that was knocked and nothing else fits as before: 1.0 to 1.3 times the median; one whose region of interest
# was shifted by 64 px ended at 10 times.
WORSE = 3.0
# The images of a repaired camera then agree as those of others do. One that was late by 0.3 mm at each placement passed
# for moved; without that image its others scattered 5.3 times as much as noise, and it was 3.8 times its U off.
MOST_SCATTER = 3.0
# A repaired camera's lens has a field like the others' (by rms px): what a pose does not explain goes into it. Of a
# focus changed by 0.1 % that passed for a move it was 14 times the others', 0.1 px, and lengths were 3.2 U off; of a
# region of interest shifted by 64 px 0.77 px, and 10.6 U.
MOST_FIELD, LEAST_FIELD_PX = 4.0, 0.02
# Of cameras that drift by 10 to 40 urad groups seemed to move by 0.024 to 0.054 px (7 of 100 recordings); a ball that
# moved by 0.05 mm between exposures shifts image points by 0.097.
GROUP_MOVED_PX = 0.07
# Findings whose repairs are certain; those without a scale cannot distinguish a knock from another image.
_CERTAIN = ("image-repeated", "mirrored", "placements-repeated", "wrong-placement", "cameras-swapped", "camera-moved",
            "cameras-moved", "placements-contradict", "image-contradicts", "capture-times")  # fmt: skip
_OF_AN_IMAGE = ("image-repeated", "mirrored", "placements-repeated", "wrong-placement")
# Of these, findings on images that may show the camera's new pose.
_OF_THE_CAMERA = ("camera-moved", "image-contradicts", "capture-times")


def is_settled(now: Calibration) -> bool:
    """Whether nothing is left to repair: the calibration is valid, or the user stopped it."""
    return now.rig.quality.valid or any(f.code == "stopped-early" for f in now.rig.quality.findings)


def certain_repairs(session: Session, now: Calibration, done: Repairs) -> Iterator[tuple[Repairs, Session]]:
    """Repairs of all certain faults of a calibration, in the order to try them, each with the repaired session."""
    for way in ways(session, now, done):
        if _names_are_certain(session, way):
            try:
                mended = repaired(session, way)
            except InputError:  # there is nothing to split
                continue
            if keeps_a_tested_pose(mended, way):
                yield way, mended


def helps(tried: Calibration, now: Calibration, best: Calibration | None) -> bool:
    """Whether repairs leave no fault, or fewer than before and than the best repairs so far."""
    if tried.rig.quality.valid or has_fewer_faults(tried, now if best is None else best):
        return True
    return best is None and not _named(tried) & _named(now) and _faults(tried) <= _faults(now)


def has_fewer_faults(one: Calibration, other: Calibration) -> bool:
    """Whether a calibration is valid, or has fewer reasons not to be than another."""
    return one.rig.quality.valid or _faults(one) < _faults(other)


def moves_are_all(calibration: Calibration) -> bool:
    """Whether a calibration is not valid by moved cameras, or groups that hardly moved, and by nothing else."""
    said = [f for f in calibration.rig.quality.findings if effect(f) == "not-valid"]
    groups = [f for f in said if f.code in ("cameras-moved", "ball-moved") and f.values["px"] < GROUP_MOVED_PX]
    return bool(said) and sum(f.code == "camera-moved" for f in said) + len(groups) == len(said)


def _named(calibration: Calibration) -> set[tuple[str, tuple[str, ...]]]:
    """What makes a calibration not valid, and where."""
    return {(f.code, f.where) for f in calibration.rig.quality.findings if effect(f) == "not-valid"}


def _faults(calibration: Calibration) -> tuple[int, int]:
    """Reasons not to be valid; fewer cameras count as one each."""
    findings = calibration.rig.quality.findings
    return sum(effect(f) == "not-valid" for f in findings), -len(calibration.rig.cameras)


def ways(session: Session, now: Calibration, done: Repairs) -> Iterator[Repairs]:
    """Repairs of all certain faults together, in the order to try them; none if too much is wrong."""
    findings = now.rig.quality.findings
    # of two equal images `wrong-placement` knows the old one
    reported = {frozenset(f.where) for f in findings if f.code == "wrong-placement"}
    findings = tuple(f for f in findings if f.code != "image-repeated" or frozenset(f.where) not in reported)
    steps = [step for f in findings if (step := _step(f, session)) is not None]
    steps = [step for step in steps if _with(done, step.first) != done]
    single = {name for step in steps if step.code != "cameras-moved" for name in step.cameras}
    if not steps or len(single) > most_moved(len(session.cameras)):  # the others cannot prove that more are wrong
        return
    # one placement, not the last, contradicts the others grossly, for no known reason: other repairs would hide it
    gross = [f.where[-1:] for f in findings if f.code == "placements-contradict" and not f.repairs]
    unmended = any(where not in ((), (_last(session),)) for where in gross)
    if not unmended:
        yield _with(done, [option for step in steps for option in step.first])
    for other in () if unmended else steps:  # one at a time: what is wrong is rarely two things
        if other.second:
            rest = [option for step in steps if step is not other for option in step.first]
            yield _with(done, [*rest, *other.second])
    sure = [step for step in steps if step.code in _OF_AN_IMAGE]
    if sure and (unmended or len(sure) < len(steps)):
        yield _with(done, [option for step in sure for option in step.first])


@dataclass(frozen=True)
class _Step:
    """What one finding advises: options with values, another way if the first does not help, cameras concerned."""

    code: str
    first: tuple[AdvisedRepair, ...]
    second: tuple[AdvisedRepair, ...]
    cameras: tuple[str, ...]


def _step(finding: Finding, session: Session) -> _Step | None:
    """The repair that a finding is certain about."""
    if finding.code not in _CERTAIN:
        return None
    names = [camera.id for camera in session.cameras]
    cameras = tuple(name for name in finding.where if name in names)
    options = finding.repairs
    if not options or (finding.code == "camera-moved" and len(cameras) != 1):  # two may have moved: which is not known
        return None
    if finding.code == "cameras-swapped" and "@" not in options[0].target:  # in the whole session: a matter of names
        return None
    of_the_end = not finding.where or finding.where[-1] == _last(session)
    if of_the_end and finding.code in ("cameras-moved", "placements-contradict"):
        return None  # which of the two states the rig has kept is not known
    ways = [options, _second_way(finding, session, cameras)]
    if finding.code in _OF_THE_CAMERA:  # without its last image nothing would show where the camera is now
        ways = [
            way for way in ways if not any(one.kind == "leave-out" and is_last_pose(session, one.target) for one in way)
        ]
    first, second, *_ = (*ways, (), ())
    return _Step(finding.code, first, second, cameras) if first else None


def _second_way(finding: Finding, session: Session, cameras: tuple[str, ...]) -> tuple[AdvisedRepair, ...]:
    """What to try where the repairs that a finding advises do not help."""
    if finding.code == "image-repeated" and len(finding.where) == 3 and len(cameras) == 1:
        return leave_out(f"{cameras[0]}@{finding.where[1]}")
    if finding.repairs[0].kind == "split" and finding.code != "cameras-moved":
        return leave_out(f"{cameras[0]}@{finding.where[-1]}")
    if finding.code == "camera-moved" and finding.repairs[0].target.endswith(f"@{_last(session)}"):
        return (AdvisedRepair("split", finding.repairs[0].target),)
    return ()


def is_last_pose(session: Session, image: str) -> bool:
    """Whether no image of the ball after `C05@P3` has enough points to show where its camera is.

    A region of interest was shifted at the last two images of a camera before one of 7 dots. Both were left out, and
    lengths were 8.8 times their U off.
    """
    camera, _, place = image.partition("@")
    names = [one.id for one in session.placements]
    if session.observations is None or place not in names or camera not in session.observations.cameras:
        return False
    showing = _images_showing(session, camera)
    return not len(showing) or int(showing[-1]) <= names.index(place)


def _images_showing(session: Session, camera: str) -> IntArray:
    """Placements at which a camera's image of the ball has enough points to show its pose."""
    o, places = session.observations, len(session.placements)
    if o is None or camera not in o.cameras:
        return np.zeros(0, dtype=np.int64)
    own = o.placement[(o.camera == o.cameras.index(camera)) & (o.placement < places)]
    return np.flatnonzero(np.bincount(own, minlength=places) >= LEAST_POINTS)


def _last(session: Session) -> str:
    return session.placements[-1].id if session.placements else ""


def _with(done: Repairs, more: Sequence[AdvisedRepair]) -> Repairs:
    """Repairs and more of them, each once."""
    known = ("leave-out", done.leave_out), ("split", done.split), ("swap", done.swap)
    of_kinds = ((*before, *(one.target for one in more if one.kind == kind)) for kind, before in known)
    return Repairs(*(tuple(dict.fromkeys(targets)) for targets in of_kinds))


def _names_are_certain(session: Session, way: Repairs) -> bool:
    """Whether exchanged cameras have their own names before and after, and at most placements.

    Exchanged from the third of four placements on, the first two were exchanged "back": 290 mm off, and valid; from the
    second on, the first was: 536 mm off. None may have been exchanged unseen, either.
    """
    for pair in {value.partition("@")[0] for value in way.swap}:
        swapped = {value.partition("@")[2] for value in way.swap if value.partition("@")[0] == pair}
        seen = placements_seen_by(session, pair.split(","))
        if 2 * len(swapped) >= len(seen) or swapped & {seen[0], seen[-1]}:
            return False
    return not any(may_be_swapped(session, way, value.partition("@")[0]) for value in way.leave_out)


def may_be_swapped(session: Session, way: Repairs, camera: str) -> bool:
    """Whether a camera's first images are left out, and another camera saw the ball only after them.

    A camera was exchanged from P3 on with one that had not seen the ball before. Its first two images were left out:
    926 mm off if the names of these are the right ones.
    """
    seen = placements_seen_by(session, [camera])
    out = {place for name, _, place in (value.partition("@") for value in way.leave_out) if name == camera}
    if not out or out != set(seen[: len(out)]):
        return False
    ids = [placement.id for placement in session.placements]
    later = set(ids[ids.index(seen[len(out) - 1]) + 1 :])
    others = (placements_seen_by(session, [one.id]) for one in session.cameras if one.id != camera)
    return any(own and set(own) <= later for own in others)


def keeps_a_tested_pose(mended: Session, way: Repairs) -> bool:
    """Whether cameras that need two repairs or more keep one pose over two images: else something else is wrong.

    A region of interest that was shifted by 8 px before P2 of four was repaired by three poses of one image each and
    one image left out. Nothing tests those, and a length was 4 times its U off.
    """
    of = [value.partition("@")[0] for value in (*way.split, *way.leave_out)]
    several = {name for name in of if of.count(name) > 1}
    poses = ([one.id for one in mended.cameras if name in (one.id, one.earlier_pose_of)] for name in several)
    return all(any(len(_images_showing(mended, pose)) >= 2 for pose in of_one) for of_one in poses)


def is_credible(tried: Calibration, way: Repairs) -> bool:
    """Whether split cameras are near their earlier poses and fit as well as others: otherwise they were not bumped."""
    if any(f.code == "stopped-early" for f in tried.rig.quality.findings):
        return False
    fits = {camera.id: camera.rms_px or 0.0 for camera in tried.rig.cameras}
    for earlier in tried.rig.earlier_poses:
        cut = (value.partition("@") for value in way.split)
        now = tried.rig.camera(next(name for name, _, place in cut if earlier.id == f"{name} before {place}"))
        if now is None:
            return False
        rotation = float(np.linalg.norm(log_rotation(now.rotation @ earlier.rotation.T)))
        translation = float(np.linalg.norm(now.centre_mm - earlier.centre_mm))
        if rotation > FAR_RAD or (translation > FAR_MM and tried.rig.scale.source != "none"):
            return False
        if fits[now.id] > WORSE * np.median(list(fits.values())):
            return False
    mended = {value.partition("@")[0] for value in (*way.split, *way.leave_out)}
    return not _still_scatters(tried, mended) and not _is_in_the_lens(tried, mended)


def _is_in_the_lens(tried: Calibration, cameras: set[str]) -> bool:
    """Whether the fields of some cameras' lenses are much larger than those of the others."""
    size = {}
    for camera in tried.rig.cameras:
        own = tried.used & (tried.observations.camera == tried.observations.cameras.index(camera.id))
        seen = tried.observations.uv[own]
        size[camera.id] = 0.0 if camera.field is None else float(np.sqrt((camera.field.at(seen) ** 2).mean()))
    usual = float(np.median([rms for name, rms in size.items() if name not in cameras] or [0.0]))
    return any(size.get(name, 0.0) > max(MOST_FIELD * usual, LEAST_FIELD_PX) for name in cameras)


def _still_scatters(tried: Calibration, cameras: set[str]) -> bool:
    """Whether the images of some cameras contradict each other, while those of most others do not."""
    scatter = pose_scatter(tried.rig.quality.findings)
    usual = float(np.median([scatter.get(camera.id, 1.0) for camera in tried.rig.cameras]))
    return any(scatter.get(name, 1.0) > MOST_SCATTER * usual for name in cameras)
