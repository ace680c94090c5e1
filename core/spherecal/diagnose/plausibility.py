"""The consistency of a session, checked before anything is computed: sizes, repeated images, times.

Nothing here needs a camera's pose. Findings are those of a calibration; what cannot be calibrated at all is refused by
the reader of the session.
"""

import hashlib
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError, reason
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, leave_out
from spherecal.data.observations import Observations
from spherecal.data.session import CapturedSet, Session
from spherecal.scale.bar_temperature import temperature_findings
from spherecal.targets.image_facts import ImageFacts, image_facts
from spherecal.targets.images import read_image
from spherecal.targets.why_nothing import reads_mirrored

# Printers err by 0.1 to 0.5 % in size; beyond twice that the distance is another one, or another set.
MOST_PRINT_ERROR = 0.01
# What a pixel shows of an object: 3 um at a magnification of one third on pixels of 1 um, the least that no microscope
# needs; beyond 50 mm no board, ball or mark is seen. Recordings here and shared ones have 0.04 to 2 mm. The two lenses
# of a stereo endoscope are 4 mm apart.
LEAST_PIXEL_MM, MOST_PIXEL_MM, LEAST_APART_MM, AT_ONE_PLACE = 3e-3, 50.0, 1.0, 1e-4
# The same dots of the same camera lie within this in two images of a ball that was not moved (noise 0.02 to 0.1 px);
# placements of rigs A, B and of halls differ by hundreds of pixels, the least turn of the ball by tens. Targets
# that rest in the background are fewer than most of an image's dots.
SAME_PX, LEAST_COMMON, MOSTLY = 1.0, 12, 0.8
# A mirrored image has few targets: of 54, 9 read, 3 of them as others. Only the poorest images are looked at, by the
# median of all: 0.2 s each.
POOR, LOOKED_AT, LEAST_DOTS = 0.25, 4, 4
# So many copies of one dot are compared with each other; a placement is a copy when it is for almost all cameras.
NEIGHBOURS, MOST_CAMERAS = 4, 0.8
# Between two placements cameras' clocks run alike; triggers by software and drift (100 ppm) differ by less.
CLOCKS_S, DRIFT = 0.5, 1e-3
# Images of one set that hosts note this far apart belong to different ones: 0.2 s is usual for twelve cameras of 5 MP.
EXPOSED_S = 2.0


_Image = tuple[int, str, str, Path]  # of the ball: its dots, camera, placement and file


def implausible(session: Session) -> tuple[Finding, ...]:
    """Findings on a session with observations; each image named as wrong has a hint how to leave it out."""
    o, scale = session.observations, session.scale
    assert o is not None
    o = o.select(o.placement < len(session.placements))
    size, names = _sizes(o), [camera.id for camera in session.cameras]
    repeated = _repeated(session, o, size)
    images = [
        (int(size[names.index(camera), t]), camera, p.id, path)
        for t, p in enumerate(session.placements)
        for camera, path in p.images.items()
        if camera in names
    ]
    return (
        *_target_distance(session),
        *([] if scale is None or scale.bar is None else temperature_findings(session.bar_poses, (scale.bar,))),
        *repeated,
        *_one_image_of_two_cameras(o, size),
        *_same_files(images, repeated),
        *_mirrored_images(session, size, images),
        *_capture_times(session),
        *image_settings(session),
    )


def implausible_size(depth_mm: FloatArray, focal_px: FloatArray, centres_mm: FloatArray) -> list[Finding]:
    """Lengths off by a power of a thousand: depths (n,), focal lengths in px (n,), and the cameras' centres (c,3)."""
    if len(centres_mm) < 2 or not len(depth_mm):
        return []
    pixel = float(np.median(depth_mm / focal_px))
    gaps = np.linalg.norm(centres_mm[:, None] - centres_mm, axis=2) + np.diag(np.full(len(centres_mm), np.inf))
    apart = float(gaps.min())
    at_one_place = apart < AT_ONE_PLACE * float(np.median(depth_mm))  # one camera under two names
    if LEAST_PIXEL_MM <= pixel <= MOST_PIXEL_MM and (apart >= LEAST_APART_MM or at_one_place):
        return []
    return [Finding("size-implausible", "error", {"pixel_um": 1e3 * pixel, "apart_mm": apart})]


def _target_distance(session: Session) -> list[Finding]:
    """The distance that gives the scale, compared with the layout of the targets."""
    scale, targets = session.scale, session.target_set
    if scale is None or targets is None or scale.distance_mm is None:
        return []
    start, end = scale.from_point, scale.to_point
    pairs = [(x[start], x[end]) for x in targets.layouts.values() if start in x and end in x]
    if not pairs:
        return []
    printed = [float(np.linalg.norm(np.subtract(a, b))) for a, b in pairs]
    off = scale.distance_mm / np.array([min(printed), max(printed)]) - 1
    if off[0] >= -MOST_PRINT_ERROR and off[1] <= MOST_PRINT_ERROR:
        return []
    far = float(np.median(printed))
    values = {
        "first": scale.from_point, "second": scale.to_point, "stated_mm": scale.distance_mm, "printed_mm": far,
        "percent": 100 * (scale.distance_mm / far - 1),
    }  # fmt: skip
    return [Finding("target-distance", "error", values)]


def _sizes(o: Observations) -> IntArray:
    """How many dots each image has, (cameras, placements)."""
    count = np.zeros((len(o.cameras), len(o.placements)), dtype=np.int64)
    np.add.at(count, (o.camera, o.placement), 1)
    return count


def _alike(o: Observations, of: IntArray, among: IntArray, size: IntArray) -> dict[tuple[int, int], list[int]]:
    """Pairs `among` (n,) that have most dots at one place, and `of` (n,) which; size (of, among): dots of each."""
    count = size.shape[1]
    order = np.lexsort((among, o.uv[:, 0], o.point, o.target, of))
    found: dict[tuple[int, int, int], int] = {}
    for apart in range(1, NEIGHBOURS + 1):
        a, b = order[:-apart], order[apart:]
        near = (of[a] == of[b]) & (o.target[a] == o.target[b]) & (o.point[a] == o.point[b]) & (among[a] != among[b])
        near &= (np.abs(o.uv[a] - o.uv[b]) < SAME_PX).all(axis=1)
        low, high = np.minimum(among[a], among[b])[near], np.maximum(among[a], among[b])[near]
        keys, number = np.unique((of[a][near] * count + low) * count + high, return_counts=True)
        for key, n in zip(keys.tolist(), number.tolist(), strict=True):
            name = key // count // count, key // count % count, key % count
            found[name] = found.get(name, 0) + n
    same: dict[tuple[int, int], list[int]] = {}
    for (i, low, high), n in sorted(found.items()):
        if n >= max(LEAST_COMMON, MOSTLY * min(size[i, low], size[i, high])):
            same.setdefault((low, high), []).append(i)
    return same


def _repeated(session: Session, o: Observations, size: IntArray) -> list[Finding]:
    """Placements that are the same for all cameras, and images of single cameras that show another placement's."""
    found: list[Finding] = []
    gone: set[int] = set()
    for (s, t), same in sorted(_alike(o, o.camera, o.placement, size).items()):
        if s in gone or t in gone:
            continue
        both = int(((size[:, s] >= LEAST_COMMON) & (size[:, t] >= LEAST_COMMON)).sum())
        a, b = session.placements[s].id, session.placements[t].id
        if len(same) >= MOST_CAMERAS * both and both > 1:
            gone.add(t)
            values = {"first": a, "second": b, "limit_px": SAME_PX}
            found.append(Finding("placements-repeated", "warning", values, (a, b), leave_out(f"placement:{b}")))
        elif 2 * len(same) < both:
            for name in (session.cameras[c].id for c in same):
                values = {"camera": name, "first": a, "second": b}
                repairs = leave_out(f"{name}@{b}")
                found.append(Finding("image-repeated", "warning", values, (name, a, b), repairs, "stale"))
    return found


def _one_image_of_two_cameras(o: Observations, size: IntArray) -> list[Finding]:
    """Two cameras that show the same dots at the same places: one image stored under two names."""
    found = []
    for (c, d), at in _alike(o, o.placement, o.camera, size.T).items():
        both = int(((size[c] >= LEAST_COMMON) & (size[d] >= LEAST_COMMON)).sum())
        names = o.cameras[c], o.cameras[d]
        if len(at) > 1 and len(at) >= MOST_CAMERAS * both:
            values = {"first": names[0], "second": names[1], "count": len(at)}
            found.append(Finding("image-repeated", "error", values, names, kind="twins"))
        else:
            for place in (o.placements[t] for t in at):
                values = {"first": names[0], "second": names[1], "place": place}
                repairs = leave_out(*(f"{name}@{place}" for name in names))
                found.append(Finding("image-repeated", "error", values, (*names, place), repairs, "two-cameras"))
    return found


def _same_files(images: Sequence[_Image], reported: Sequence[Finding]) -> list[Finding]:
    """Images whose files are the same to the byte, where their dots have not said so."""
    named = {frozenset(f.where) for f in reported}
    repeated = {f.where for f in reported if f.code == "placements-repeated"}
    found = []
    for first, second in _identical(images):
        (camera, at), (other, then) = first, second
        if (at, then) in repeated or frozenset((camera, at, other, then)) in named:
            continue
        if camera != other:
            values = {"first": camera, "first_place": at, "second": other, "second_place": then}
            where = tuple(dict.fromkeys((camera, other, at, then)))
            found.append(Finding("image-repeated", "error", values, where, kind="files-of-two"))
        else:
            values = {"camera": camera, "first": at, "second": then}
            repairs = leave_out(f"{camera}@{then}")
            found.append(Finding("image-repeated", "warning", values, (camera, at, then), repairs, "files-of-one"))
    return found


def _mirrored_images(session: Session, size: IntArray, images: Sequence[_Image]) -> list[Finding]:
    """Images of the ball that a mirror would show right, among those in which hardly any target was found."""
    targets = session.target_set
    if targets is None or not size.any():
        return []
    few = POOR * np.median(size[size > 0])
    whole = {camera.id for camera, own in zip(session.cameras, size, strict=True) if own.max() < few}
    poor = [image for image in images if image[0] < few and image[1] not in whole]  # of those the diagnosis says so
    found = []
    for dots, camera, place, path in sorted(poor, key=lambda image: image[0])[:LOOKED_AT]:
        try:
            mirrored = reads_mirrored(read_image(path), targets, dots // LEAST_DOTS)
        except InputError:  # recorded observations need no images
            continue
        if mirrored:
            where, repairs = (camera, place), leave_out(f"{camera}@{place}")
            found.append(Finding("mirrored", "error", {"camera": camera, "place": place}, where, repairs, "image"))
    return found


def _identical(images: Sequence[_Image]) -> Iterator[tuple[tuple[str, str], tuple[str, str]]]:
    """Pairs of the ball's images (camera, placement) with files of the same content; the first with each other one."""
    by_size: dict[int, list[tuple[str, str, Path]]] = {}
    for dots, camera, place, path in images:
        if dots and path.is_file():  # empty images may well be the same
            by_size.setdefault(path.stat().st_size, []).append((camera, place, path))
    first: dict[bytes, tuple[str, str]] = {}
    for group in (group for group in by_size.values() if len(group) > 1):
        for camera, placement, path in group:
            try:
                content = hashlib.sha256(path.read_bytes()).digest()
            except OSError as error:
                raise InputError(Phrase("error-cannot-read", {"file": path, "why": reason(error)})) from error
            before = first.setdefault(content, (camera, placement))
            if before != (camera, placement):
                yield before, (camera, placement)


def _capture_times(session: Session) -> list[Finding]:
    """Images that the cameras' own clocks, or the host's, put into another set."""
    ids = [p.id for p in session.placements]
    sets = {one.id: one for one in session.captured if one.id in ids}
    order = [sets[name] for name in ids if name in sets]
    late = {(c, s.id): why for s in order for c, why in _not_with_the_others(s)}
    for before, after in pairwise(order):
        for camera, why in _clocks_apart(before, after):
            late.setdefault((camera, after.id), why)
    known, found = {camera.id for camera in session.cameras}, []
    for (camera, place), why in late.items():
        if camera in known:
            values, repairs = {"camera": camera, "place": place, "why": why}, leave_out(f"{camera}@{place}")
            found.append(Finding("capture-times", "warning", values, (camera, place), repairs))
    return found


def _not_with_the_others(one: CapturedSet) -> list[tuple[str, Phrase]]:
    names = [name for name, frame in one.frames.items() if frame.exposed is not None]
    if len(names) < 3:
        return []
    seconds = np.array([frame.exposed.timestamp() for frame in one.frames.values() if frame.exposed is not None])
    off = seconds - np.median(seconds)
    late = np.flatnonzero(_apart(off, EXPOSED_S))
    return [(names[i], Phrase("exposed-apart", {"seconds": off[i]})) for i in late]


def _clocks_apart(before: CapturedSet, after: CapturedSet) -> list[tuple[str, Phrase]]:
    """Cameras whose clock ran differently from the others' between two sets, or did not run at all."""
    names, ticks = [], []
    found = []
    for name, frame in after.frames.items():
        earlier = before.frames.get(name)
        if earlier is None or earlier.time_stamp_ns is None or frame.time_stamp_ns is None:
            continue
        if (earlier.time_stamp_ns, earlier.frame_id) == (frame.time_stamp_ns, frame.frame_id):
            found.append((name, Phrase("same-frame", {"place": before.id})))
            continue
        names.append(name)
        ticks.append((frame.time_stamp_ns - earlier.time_stamp_ns) * 1e-9)
    if len(names) < 3:
        return found
    passed = np.array(ticks)
    usual = float(np.median(passed))
    apart = _apart(passed - usual, CLOCKS_S + DRIFT * abs(usual))
    return found + [
        (names[i], Phrase("clock-apart", {"seconds": passed[i], "place": before.id, "usual": usual}))
        for i in np.flatnonzero(apart)
    ]


def _apart(off: FloatArray, limit: float) -> BoolArray:
    """Which differ by more than a limit, if most do not: otherwise the clocks are not reliable."""
    apart = np.abs(off) > limit
    return apart if 2 * apart.sum() < len(off) else np.zeros(len(off), dtype=bool)


# --- images that their files say were taken by another camera, or with another size or region of its sensor -----------

_Setting = tuple[int, int] | str


def image_settings(session: Session) -> list[Finding]:
    """A finding for each camera whose images state different sizes, regions or serial numbers, from which one on.

    A lens and a pose are those of one region of one sensor: shifted by 8 px in mid-recording it passed for a move.
    An earlier pose of a camera that was split has its images too.
    """
    found = []
    of: dict[str, list[str]] = {}
    for camera in session.cameras:
        of.setdefault(camera.earlier_pose_of or camera.id, []).append(camera.id)
    for name, poses in of.items():
        shown = [
            (place.id, facts)
            for place in (*session.placements, *session.bar_poses)
            for pose in poses
            if pose in place.images and (facts := _facts(place.images[pose])) is not None
        ]
        for kind in ("image-serial", "image-size", "image-offset"):
            change = _change([(place, getattr(facts, kind.removeprefix("image-"))) for place, facts in shown])
            if change is not None:
                place, before, now = change
                what = {"before": _words(before), "now": _words(now)}
                values = {"camera": name, "place": place, "what": Phrase(kind, what)}
                found.append(Finding("image-settings", "warning", values, (name, place)))
                break
    return found


def _change(shown: list[tuple[str, _Setting | None]]) -> tuple[str, _Setting, _Setting] | None:
    """The first place at which a fact differs from the one before, and both; None where all that is stated is alike."""
    known = [(place, fact) for place, fact in shown if fact is not None]
    return next(((at, a, b) for (_, a), (at, b) in pairwise(known) if a != b), None)


def _words(fact: _Setting) -> str:
    return fact if isinstance(fact, str) else " x ".join(map(str, fact))


def _facts(path: Path) -> ImageFacts | None:
    """What an image's file says; None where there is no such image: recorded observations need none."""
    try:
        stat = path.stat()
        return _read(path, stat.st_size, stat.st_mtime_ns)
    except (OSError, InputError):
        return None


@lru_cache(maxsize=4096)
def _read(path: Path, size: int, changed_ns: int) -> ImageFacts:
    """The facts of a file as it is: repairs ask for them several times."""
    del size, changed_ns
    return image_facts(path)
