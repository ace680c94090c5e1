"""Frames of videos for a calibration, and which frames and images are of one moment: by number, table or name."""

import csv
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.file_reading import read_file
from spherecal.base.messages.values import Phrase
from spherecal.targets.images import LARGEST_MEGAPIXELS
from spherecal_files.png_file import png_bytes

STAGE = "looking at videos"
_WIDTH_PX = 480  # at which frames are judged: a blur of 2 px of a full HD frame still shows
_SMALL_PX = (40, 30)
_MOST_FRAMES = 50_000  # half an hour
# A frame within this factor of the stillest one of its stretch is as still: the noise of the measure itself is 10 %
# between frames of a camera that sees a wall.
_AS_STILL = 1.25
# Two frames that differ by less than this many times what two successive still ones do show the same.
_SAME = 2.0
_SAME_GREY = 0.2
# Still frames differ by 0.1 to 0.5 grey levels in the small images, whatever the noise and compression: where all steps
# are larger, every frame shows another pose.
_STILL_GREY = 0.6
_SAME_RATE = 1.01  # 29.97 and 30 are one
# What the container formats begin with; anything else, such as a play list that leads elsewhere, is not opened.
_MAGIC = ((4, b"ftyp"), (4, b"moov"), (4, b"mdat"), (4, b"wide"), (0, b"RIFF"), (0, b"\x1aE\xdf\xa3"))


# Successive frames of a camera are at most 1.2 times its usual interval apart where none was dropped; the nearest frame
# is then within 0.6 of it.
_NEAR = 0.6


@dataclass(frozen=True)
class ChosenFrames:
    """Frames of common moments: each camera's ascending frame numbers, a moment each, and its image size (px)."""

    numbers: Mapping[str, list[int]]
    sizes: Mapping[str, tuple[int, int]]
    apart_s: float | None  # how far apart the frames of a moment are at most, where their times are known
    rates: Mapping[str, float]  # frames a second of the videos where they differ, else empty


@dataclass(frozen=True)
class _Watched:
    """A video: motion to the frame before (n,), sharpness (n,), small images (n,h,w), size in px, frames a second."""

    motion: FloatArray
    sharpness: FloatArray
    small: NDArray[np.uint8]
    size: tuple[int, int]
    rate: float


def choose_frames(
    videos: Mapping[str, Path], most: int, context: Context, times: Mapping[str, FloatArray] | None
) -> ChosenFrames:
    """Frames of common moments: of each stretch the sharpest of the stillest, unless like the one before."""
    watched = {}
    for number, (camera, path) in enumerate(videos.items()):
        context.report(STAGE, 0.7 * number / len(videos), path.name)
        watched[camera] = _watch(path, context)
    counts = {camera: len(one.motion) for camera, one in watched.items()}
    known = [one.rate for one in watched.values()]
    rates = {c: one.rate for c, one in watched.items()} if max(known) > _SAME_RATE * min(known) > 0 else {}
    stated = times
    if times is None and rates:  # as their files say, from a common beginning on
        times = {camera: np.arange(counts[camera]) / rate for camera, rate in rates.items()}
    if times is None and len(set(counts.values())) > 1:
        shown = ", ".join(f"{videos[camera].name} {count}" for camera, count in counts.items())
        raise InputError(Phrase("error-frame-counts", {"counts": shown}))
    for camera, own in ({} if times is None else times).items():
        if len(own) != counts[camera]:
            values = {"video": videos[camera].name, "frames": counts[camera], "times": len(own)}
            raise InputError(Phrase("error-frame-times-count", values))
    if times is None:
        moments = np.tile(np.arange(min(counts.values()))[:, None], len(watched))
    else:
        moments = common_moments([times[camera] for camera in watched])
    if not len(moments):
        raise InputError(Phrase("error-no-common-moment", {"videos": [path.name for path in videos.values()]}))
    chosen = moments[_chosen(list(watched.values()), moments, most)]
    apart = None
    if times is not None:
        taken = np.array([times[camera][own] for camera, own in zip(watched, chosen.T, strict=True)])
        apart = float(np.ptp(taken, axis=0).max())
    numbers = {camera: own.tolist() for camera, own in zip(watched, chosen.T, strict=True)}
    sizes = {camera: one.size for camera, one in watched.items()}
    return ChosenFrames(numbers, sizes, apart, rates if stated is None else {})


def common_moments(times: Sequence[NDArray[np.floating[Any]]]) -> IntArray:
    """Frames of one moment (moments, cameras): of the slowest camera, with the nearest of all others, each once."""
    usual = [float(np.median(np.diff(own))) for own in times]
    clock = times[int(np.argmax(usual))]
    moments, near = [], np.full(len(clock), True)
    for own, interval in zip(times, usual, strict=True):
        after = np.clip(np.searchsorted(own, clock), 1, len(own) - 1)
        nearest = np.where(clock - own[after - 1] <= own[after] - clock, after - 1, after)
        near &= np.abs(own[nearest] - clock) <= _NEAR * interval
        moments.append(nearest)
    found = np.array(moments).T[near]
    return found[np.append(True, (np.diff(found, axis=0) > 0).all(axis=1))[: len(found)]]


def grey_frames(path: Path, frames: Sequence[int]) -> list[NDArray[np.uint8]]:
    """Some frames of a video as grey images (h, w), in ascending order."""
    wanted = set(frames)
    return [grey for number, grey in zip(range(max(wanted) + 1), _frames(path), strict=False) if number in wanted]


def keep_frames(path: Path, frames: Sequence[int], keep: Callable[[int, bytes], None], context: Context) -> None:
    """Pass some frames of a video on, ascending: `keep(number, bytes)` with each as a grey PNG file."""
    wanted = set(frames)
    for number, grey in enumerate(_frames(path)):
        if number in wanted:
            context.report(STAGE, 0.85, Phrase("frame-of", {"file": path.name, "frame": number}))
            keep(number, png_bytes(grey))
        if number >= max(wanted):
            break


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    head = b""
    if path.is_file():  # opening a pipe would wait
        with path.open("rb") as file:
            head = file.read(16)
    if not any(head[at : at + len(magic)] == magic for at, magic in _MAGIC):
        raise InputError(Phrase("error-not-video", {"file": path}))
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        width, height = (video.get(one) for one in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if not video.isOpened() or width * height > LARGEST_MEGAPIXELS * 1e6:
            raise InputError(Phrase("error-unreadable-video", {"file": path}))
        yield video
    finally:
        video.release()


def _frames(path: Path) -> Iterator[NDArray[np.uint8]]:
    """The frames as grey images."""
    with _opened(path) as video:
        video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # as the sensor has them, like images
        for _ in range(_MOST_FRAMES):
            there, frame = video.read()
            if not there:
                return
            grey = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
            yield cast(NDArray[np.uint8], grey)
    raise InputError(Phrase("error-long-video", {"file": path, "most": _MOST_FRAMES}))


def _watch(path: Path, context: Context) -> _Watched:
    motion, sharpness, small = [0.0], [], []
    before, size = None, (0, 0)
    for grey in _frames(path):
        if len(sharpness) % 50 == 0:
            context.check()
        size = grey.shape[1], grey.shape[0]
        scale = min(1.0, _WIDTH_PX / size[0])
        judged = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        sharpness.append(float(cv2.Laplacian(judged, cv2.CV_32F, ksize=3).var()))
        if before is not None:
            motion.append(float(cv2.absdiff(judged, before).mean()))
        before = judged
        small.append(cv2.resize(judged, _SMALL_PX, interpolation=cv2.INTER_AREA))
    if len(sharpness) < 2:
        raise InputError(Phrase("error-short-video", {"file": path, "frames": len(sharpness)}))
    motion[0] = motion[1]
    # frames a second as the file says; 0 where it does not, or says what no camera does
    with _opened(path) as video:
        said = float(video.get(cv2.CAP_PROP_FPS))
    rate = said if 0 < said < 1000 else 0.0
    return _Watched(np.array(motion), np.array(sharpness), np.array(small, dtype=np.uint8), size, rate)


def _chosen(watched: Sequence[_Watched], moments: IntArray, most: int) -> list[int]:
    """Which rows of `moments` (n, cameras) to take."""
    count = len(moments)
    moved, sharp = np.zeros(count), np.full(count, np.inf)
    for one, own in zip(watched, moments.T, strict=True):
        both = np.maximum(one.motion, np.append(one.motion[1:], one.motion[-1]))  # before and after the frame
        moved = np.maximum(moved, both[own] / max(float(np.median(both)), 1e-6))
        sharp = np.minimum(sharp, one.sharpness[own] / max(float(np.percentile(one.sharpness, 90)), 1e-6))
    chosen: list[int] = []
    for stretch in np.array_split(np.arange(count), min(most, count)):
        still = stretch[moved[stretch] <= _AS_STILL * moved[stretch].min()]
        best = int(still[np.argmax(sharp[still])])
        before = moments[chosen[-1]] if chosen else ()
        if not chosen or not all(map(_same, watched, moments[best], before)):
            chosen.append(best)
    return chosen


def _same(one: _Watched, a: int, b: int) -> bool:
    """Whether two frames show the same: they differ like successive still ones, as seen in the small images."""
    steps = np.abs(one.small[1:].astype(np.int16) - one.small[:-1]).mean(axis=(1, 2))
    difference = np.abs(one.small[a].astype(np.int16) - one.small[b]).mean()
    return bool(difference <= _SAME * min(float(np.percentile(steps, 5)), _STILL_GREY) + _SAME_GREY)


# caliscope's, with cam_id and frame_time (the older: sync_index, port, frame_index, frame_time): seconds of one clock,
# in any order; frame i of a video is its camera's i-th in time.
NAMES = ("timestamps.csv", "frame_time_history.csv")
_MOST_BYTES = 1 << 28


def frame_times(videos: Mapping[str, Path]) -> tuple[Path, dict[str, FloatArray]] | None:
    """The table beside the videos and each camera's ascending frame times (s); None for another program's, or none."""
    folders = {path.parent for path in videos.values()}
    beside = [folder / name for folder in folders for name in NAMES if (folder / name).is_file()]
    if len(folders) > 1 or not beside:
        return None
    table = beside[0]
    rows = csv.DictReader(io.StringIO(read_file(table, _MOST_BYTES).decode("utf-8-sig", errors="replace")))
    of_camera = next((name for name in ("cam_id", "port") if name in (rows.fieldnames or ())), None)
    if of_camera is None or "frame_time" not in (rows.fieldnames or ()):
        return None  # another program's
    found: dict[str, list[float]] = {}
    for row in rows:
        try:
            time = float(row["frame_time"])
        except (TypeError, ValueError):
            time = np.nan
        if not np.isfinite(time):
            raise InputError(Phrase("error-frame-time", {"file": table, "line": rows.line_num}))
        found.setdefault((row[of_camera] or "").strip(), []).append(time)
    return table, {camera: np.sort(_of(found, path, table)) for camera, path in videos.items()}


def _of(found: Mapping[str, list[float]], video: Path, table: Path) -> FloatArray:
    """The times of a video's camera, which the table knows by the number that ends the video's name."""
    number = re.search(r"\d+$", video.stem)
    for name in (video.stem, "" if number is None else str(int(number[0]))):
        if name in found:
            return np.array(found[name])
    raise InputError(Phrase("error-frame-times-of", {"file": table, "video": video.name, "known": sorted(found)}))


# Digits of a time since 1970 by its unit: seconds until 2286, and so on.
_NANOSECONDS = {10: 10**9, 13: 10**6, 16: 10**3, 19: 1}
_DATE = re.compile(r"(?:19|20)\d{12}(\d*)")


def grouped_by_time(names: Mapping[str, list[str]]) -> tuple[IntArray, str] | None:
    """Which of each camera's ascending names are of one moment, (moments, cameras), and how: by time, else by order."""
    times = [[_nanoseconds(name) for name in own] for own in names.values()]
    known = [[time for time in own if time is not None] for own in times]
    if known != times:
        return None
    origin = min(time for own in known for time in own)
    seconds = [1e-9 * np.array([time - origin for time in own]) for own in known]
    counts = {len(own) for own in seconds}
    moments = common_moments(seconds) if min(counts) > 1 else np.zeros((0, len(seconds)), dtype=np.int64)
    how = "by nearest time"
    if not len(moments) and len(counts) == 1:
        moments, how = np.tile(np.arange(counts.pop())[:, None], len(seconds)), "by order, since their clocks differ"
    if not len(moments):
        return None
    return moments, f"images put together {how}: those of a moment are up to {_gap(seconds, moments)} apart"


def _gap(seconds: list[FloatArray], moments: IntArray) -> str:
    taken = np.array([own[rows] for own, rows in zip(seconds, moments.T, strict=True)])
    gap = float(np.ptp(taken, axis=0).max())
    unit, size = next(((u, s) for u, s in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)) if gap >= s), ("ns", 1e-9))
    return f"{gap / size:.3g} {unit}"


def _nanoseconds(name: str) -> int | None:
    """The time of a name: a count since 1970, or a date with its time of day."""
    digits = re.sub(r"[-_.:T ]", "", name)
    if not digits.isdecimal():
        return None
    if (date := _DATE.fullmatch(digits)) is not None:
        try:
            moment = datetime.strptime(digits[:14], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
        except ValueError:
            return None
        return int(moment.timestamp()) * 10**9 + int(f"{date[1]:0<9}"[:9])
    return int(digits) * _NANOSECONDS[len(digits)] if len(digits) in _NANOSECONDS else None
