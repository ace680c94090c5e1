"""Sets of a session, measured and recorded."""

from collections.abc import Callable, Iterable, Iterator
from datetime import datetime
from pathlib import Path

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Observations
from spherecal.data.rig import Rig
from spherecal.data.session import CapturedSet, Session
from spherecal.detect.session_images import observed
from spherecal_files.capture_file import read_captured_sets
from spherecal_measuring.measured_sets import MeasuredSet, ObservedSet
from spherecal_measuring.measurer import Measurer, measure_sets
from spherecal_measuring.series_file import TableKind, write_series
from spherecal_verify.participation import cameras_in_rig


def sets_of_session(session: Session, rig: Rig, context: Context | None = None) -> Iterator[ObservedSet]:
    """The session's sets in order; times in seconds since the first, where capture.json has them."""
    session = observed(session, context or Context())
    o = session.observations
    assert o is not None
    cameras_in_rig(session, o, rig, Phrase("same-settings"))
    if not len(o):
        raise InputError(Phrase("error-nothing-to-measure", {"folder": session.where}))
    captured = {one.id: one for one in ([] if session.folder is None else read_captured_sets(session.folder))}
    begin = min((one.taken for one in captured.values() if one.taken is not None), default=None)
    for number, name in enumerate(o.placements, start=1):
        mine = o.placement == o.placements.index(name)
        time_s, exposure_s = _times(captured.get(name), begin)
        yield ObservedSet(number, name, one_set(o, mine), time_s, exposure_s)


def one_set(o: Observations, mine: np.ndarray) -> Observations:
    """Some observations as those of one set, with a single placement; `mine`: which are the set's, (n,) bool."""
    own = o.select(mine)
    name = o.placements[int(own.placement[0])] if len(own) else ""
    return Observations(
        (name,), o.cameras, o.points, np.zeros(len(own), dtype=np.int64), own.camera, own.target, own.point, own.uv,
        own.sigma,
    )  # fmt: skip


def _times(captured: CapturedSet | None, begin: datetime | None) -> tuple[float | None, dict[str, float] | None]:
    """The moment of a set and of its exposures, s since the first set."""
    if captured is None or begin is None:
        return None, None
    exposed = {
        camera: (frame.exposed - begin).total_seconds()
        for camera, frame in captured.frames.items()
        if frame.exposed is not None
    }
    if exposed:
        return float(np.mean(list(exposed.values()))), exposed
    return None if captured.taken is None else (captured.taken - begin).total_seconds(), None


def run(
    sets: Iterable[ObservedSet],
    measurer: Measurer,
    seen: Callable[[MeasuredSet], None],
    output: Path | None = None,
    table: TableKind = "csv",
    context: Context | None = None,
) -> int:
    """Measure all sets, give each to `seen`, record them in `output`, also where it ends early; how many there were."""
    measured = measure_sets(sets, measurer, context)
    if output is not None:
        return write_series(measured, measurer, output, table, seen)
    count = 0
    for one in measured:
        seen(one)
        count += 1
    return count
