"""IEEE 1588 and scheduled action commands, with simulated GigE cameras on a simulated wire."""

import time
from collections.abc import Iterator

import pytest

from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.protocol import CameraSettings, CaptureRequest, FrameSet, TriggerMode
from spherecal_gentl.gige.gige_control import GigeRig
from tests.gige_rig import aravis_producer, wired


@pytest.fixture(name="rig", scope="module")
def three_cameras() -> Iterator[GigeRig]:
    with wired(3) as rig:
        yield rig


@pytest.fixture(name="source")
def opened_source(rig: GigeRig, monkeypatch: pytest.MonkeyPatch) -> Iterator[GenicamSource]:
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(aravis_producer().parent))
    with GenicamSource() as source:
        source.discover()
        yield source


def _open(source: GenicamSource, rig: GigeRig, trigger: TriggerMode) -> None:
    reports = source.open(rig.serials, dict.fromkeys(rig.serials, CameraSettings(1000.0, trigger=trigger)))
    assert [problem for report in reports for problem in report.problems] == []


def _whole(source: GenicamSource, seconds: float = 20.0) -> FrameSet:
    """The first whole set by the common clock: it takes a moment to be joined."""
    until = time.monotonic() + seconds
    while True:
        taken = source.capture_set(CaptureRequest(timeout_s=2.0, retries=1))
        if (taken.complete and taken.common_clock) or time.monotonic() > until:
            return taken


def test_scheduled_cameras_are_exposed_together(rig: GigeRig, source: GenicamSource) -> None:
    _open(source, rig, "scheduled")
    taken = _whole(source)
    assert (taken.complete, taken.common_clock) == (True, True), taken.missing
    # the simulated clocks are up to 0.4 us from the true time
    assert taken.spread_s is not None and taken.spread_s < 0.9e-6
    stamps = {frame.time_stamp_ns for frame in taken.frames.values()}
    assert len(stamps) == len(rig.serials)
    told = {feature.feature: feature.got for feature in source.describe(rig.serials[0])}
    assert told["clock state"] == "Slave"
    assert abs(int(told["clock offset"])) <= 400


def test_with_software_triggers_the_common_clock_says_how_far_apart_they_were(
    rig: GigeRig, source: GenicamSource
) -> None:
    _open(source, rig, "software")
    taken = _whole(source)
    assert (taken.complete, taken.common_clock) == (True, True), taken.missing
    assert taken.spread_s is not None and taken.spread_s > 0.9e-6
