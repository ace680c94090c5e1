"""Live measurement beside the window: a thread of its own measures, the page looks at the newest set."""

import queue
import threading
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from spherecal.data.rig import Rig
    from spherecal_cameras.protocol import CameraSource
    from spherecal_measuring.measured_sets import MeasuredSet
    from spherecal_measuring.measurer import Measurer
    from spherecal_measuring.measuring_task import Ruler, Task

# Imported inside functions: scipy, OpenCV and the kernels, for which the page does not wait.

_KEPT = 200  # values of the chart
_WAITING = 100  # sets between measuring and writing: 10 s at 10 Hz
_END_S = 10.0
_RATE_HZ = 10.0


class LiveMeasurement:
    """Measures through an open source until it is stopped; what the window reads is exchanged whole, without a lock."""

    def __init__(self, source: "CameraSource", names: dict[str, str], rig: "Rig", task: "Task") -> None:
        from spherecal_measuring.live_sets import LiveSets, LiveSettings
        from spherecal_measuring.measurer import Measurer

        cameras = {serial: camera for serial, name in names.items() if (camera := rig.camera(name)) is not None}
        assert task.target_set is not None
        self._measurer = Measurer(rig, task)
        self._live = LiveSets(source, cameras, task.target_set, LiveSettings(_RATE_HZ))
        self.latest: MeasuredSet | None = None
        self.history: deque[tuple[float, MeasuredSet]] = deque(maxlen=_KEPT)
        self.moved: tuple[str, ...] = ()
        self.problem: BaseException | None = None
        self._recorder: SeriesRecorder | None = None
        self._thread = threading.Thread(target=self._run, name="measurement", daemon=True)
        self._thread.start()

    def ask(self, rulers: "tuple[Ruler, ...]") -> None:
        """Measure these distances and angles from the next set on."""
        self._measurer.task = replace(self._measurer.task, rulers=rulers)

    def record(self, folder: Path) -> None:
        """Write all sets from now on into a series folder."""
        self._recorder = SeriesRecorder(self._measurer, folder)

    @property
    def recorded(self) -> int | None:
        """Sets recorded so far; None while nothing is recorded."""
        recorder = self._recorder
        return None if recorder is None else recorder.taken

    def end_recording(self) -> int:
        """Put the series in its place; how many sets it has. Raises what went wrong with it."""
        recorder, self._recorder = self._recorder, None
        return 0 if recorder is None else recorder.end()

    def stop(self) -> None:
        """End after the present set; what is recorded is written."""
        self._live.stop()
        self._thread.join(_END_S)
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            recorder.end()

    def _run(self) -> None:
        from spherecal_measuring.measurer import measure_sets

        try:
            for measured in measure_sets(self._live, self._measurer):
                self.latest, self.moved = measured, self._measurer.health.moved
                self.history.append((measured.time_s or 0.0, measured))
                recorder = self._recorder
                if recorder is not None:
                    recorder.add(measured)
        except Exception as error:
            self.problem = error


class SeriesRecorder:
    """Writes sets into a series folder from a thread of its own."""

    def __init__(self, measurer: "Measurer", folder: Path) -> None:
        self._sets: queue.Queue[MeasuredSet | None] = queue.Queue(_WAITING)
        self._measurer, self._folder = measurer, folder
        self._error: BaseException | None = None
        self.taken = 0
        self._thread = threading.Thread(target=self._run, name="series", daemon=True)
        self._thread.start()

    def add(self, measured: "MeasuredSet") -> None:
        """One more set; the measurement waits where the disk does not keep up."""
        self.taken += self._put(measured)

    def end(self) -> int:
        """Write what is left, put the folder in its place; the number of sets. Raises what went wrong."""
        self._put(None)
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self.taken

    def _put(self, one: "MeasuredSet | None") -> bool:
        """Whether it was taken; not where writing has ended, as by an error."""
        while self._thread.is_alive():
            try:
                self._sets.put(one, timeout=1.0)
            except queue.Full:
                continue
            return True
        return False

    def _run(self) -> None:
        from spherecal_measuring.series_file import write_series

        try:
            write_series(iter(self._sets.get, None), self._measurer, self._folder)
        except Exception as error:
            self._error = error
