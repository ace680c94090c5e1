"""When each frame of a recording's videos was taken: the table that caliscope keeps beside its videos.

`timestamps.csv` has the columns cam_id and frame_time, the older `frame_time_history.csv` sync_index, port,
frame_index and frame_time. Times are in seconds of one clock, rows in any order; frame i of a video is its camera's
i-th in time.
"""

import csv
import io
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.filesystem import read_file
from spherecal.base.messages.values import Phrase

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
