"""The link doctor: do all images arrive, do triggers work, which camera is which; and what to do where not."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from spherecal.base.context import Context
from spherecal.data.findings import Finding
from spherecal_cameras import protocol

# Of the rate asked for; less means that images are lost or the camera cannot do it (19.85 of 20 Hz is usual).
_RATE_KEPT = 0.9
_LOOK_S = 0.05
_COVERED = 0.5  # a lens under a hand lets through far less than half of the light
_TRIGGER_SETS = 10
_FIRST_IMAGE_S = 5.0
_DARK, _BRIGHT = 0.2, 0.02  # dots need some contrast over noise; highlights on a ball take less than 1 % of an image


@dataclass(frozen=True)
class LinkReport:
    """One camera after the test; `counters` are what was counted during the test only."""

    serial: str
    state: protocol.CameraState
    counters: protocol.Counters
    packet_size: str = ""
    temperature_c: float | None = None
    packets_missing: str = ""
    packets_resent: str = ""


@dataclass(frozen=True)
class TriggerReport:
    """Sets taken for the trigger test: how many were complete, median and longest time of a set, who was missing."""

    sets: int
    complete: int
    median_s: float
    longest_s: float
    missing: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Examination:
    """What the doctor found; nothing is wrong where no finding is an error or a warning."""

    links: tuple[LinkReport, ...]
    trigger: TriggerReport
    findings: tuple[Finding, ...]

    @property
    def well(self) -> bool:
        """Whether no finding is an error or a warning."""
        return all(finding.severity == "info" for finding in self.findings)


def examine(
    source: protocol.CameraSource, seconds: float = 5.0, rate_hz: float = 5.0, context: Context | None = None
) -> Examination:
    """What is found when the open cameras are watched for some seconds at a live rate and sets are taken; blocking."""
    context = context or Context()
    source.start_live(rate_hz)
    try:
        _warm_up(source, context)
        before = source.statuses()
        began = time.perf_counter()
        while (passed := time.perf_counter() - began) < seconds:
            context.report("watching the cameras", passed / seconds)
            time.sleep(_LOOK_S)
        after = source.statuses()
        passed = time.perf_counter() - began
        light = [f for serial in after if (f := _judge_light(source.latest(serial))) is not None]
    finally:
        source.stop_live()
    links = tuple(_link(source, after[serial], before.get(serial), passed) for serial in after)
    times, complete = [], 0
    missing: dict[str, int] = {}
    for number in range(_TRIGGER_SETS):
        context.report("testing the trigger", number / _TRIGGER_SETS)
        taken = source.capture_set(protocol.CaptureRequest(retries=0), context)
        times.append(taken.seconds)
        complete += taken.complete
        for one in taken.missing:
            missing[one.camera] = missing.get(one.camera, 0) + 1
        if number == 1 and not complete:  # every further one would wait in vain
            break
    source.stop_live()
    trigger = TriggerReport(len(times), complete, float(np.median(times)), max(times), missing)
    return Examination(links, trigger, (*_judge(links, after, trigger, passed), *light))


def _warm_up(source: protocol.CameraSource, context: Context) -> None:
    """Wait for the first image of every camera: the start does not count."""
    deadline = time.perf_counter() + _FIRST_IMAGE_S
    while time.perf_counter() < deadline:
        context.report("waiting for first images", 0.0)
        usable = [serial for serial, status in source.statuses().items() if status.state.usable]
        if all(source.latest(serial) is not None for serial in usable):
            return
        time.sleep(_LOOK_S)


def _judge_light(frame: protocol.Frame | None) -> Finding | None:
    """Whether an image is far too dark or too bright."""
    if frame is None:
        return None
    sample, full = frame.image[::5, ::5], 2**frame.bits - 1
    where = (frame.camera,)
    if float(np.percentile(sample, 99.5)) < _DARK * full:
        return Finding("dark", "info", {"limit": _DARK}, where)
    bright = float((sample >= full).mean())
    if bright > _BRIGHT:
        return Finding("overexposed", "info", {"share": bright}, where)
    return None


def _link(
    source: protocol.CameraSource, status: protocol.CameraStatus, before: protocol.CameraStatus | None, seconds: float
) -> LinkReport:
    now, old = status.counters, before.counters if before else protocol.Counters()
    old = old if now.delivered >= old.delivered else protocol.Counters(late=old.late)  # it was opened again meanwhile
    names = ("delivered", "incomplete", "underrun", "overwritten", "reopened", "triggered", "late")
    counted = replace(now, **{name: getattr(now, name) - getattr(old, name) for name in names})
    counted = replace(counted, rate_hz=counted.delivered / seconds)
    found = {feature.feature: feature.got for feature in protocol.features_of(source, status.serial)}
    return LinkReport(
        status.serial, status.state, counted, found.get("packet size", ""), status.temperature_c,
        found.get("packets missing", ""), found.get("packets resent", ""),
    )  # fmt: skip


def _judge(
    links: tuple[LinkReport, ...], statuses: Mapping[str, protocol.CameraStatus], trigger: TriggerReport, seconds: float
) -> Iterator[Finding]:
    """What is wrong, without what only follows: lost packets spoil images and sets, for late answers all wait."""
    late = {link.serial for link in links if link.counters.late}
    for link in links:
        yield from _judge_link(link, statuses[link.serial], bool(late), seconds)
    explained = {link.serial for link in links if late or link.counters.incomplete or not link.state.usable}
    for serial, count in trigger.missing.items():
        if serial not in explained:
            severity = "error" if count == trigger.sets else "warning"
            yield Finding("missing-in-sets", severity, {"missing": count, "sets": trigger.sets}, (serial,))


def _judge_link(link: LinkReport, status: protocol.CameraStatus, held_up: bool, seconds: float) -> Iterator[Finding]:
    counted, where = link.counters, (link.serial,)
    if not status.state.usable:
        yield Finding(_UNUSABLE[status.state], "error", {"cause": status.cause, "remedy": status.remedy}, where)
        return
    came = counted.delivered + counted.incomplete
    if counted.incomplete:
        values = {"incomplete": counted.incomplete, "images": came}
        yield Finding("incomplete-images", "warning" if counted.delivered else "error", values, where)
    elif counted.late:
        yield Finding("late-answers", "warning", {"times": counted.late}, where)
    if counted.underrun:
        yield Finding("underrun", "warning", {"images": counted.underrun}, where)
    # of triggers that came late because of another camera, this one's images come late too
    wanted = counted.triggered / seconds if held_up and counted.triggered else counted.wanted_hz
    if wanted and 0 < came < _RATE_KEPT * wanted * seconds - 1:  # the last may be on its way
        yield Finding("slow", "warning", {"rate_hz": came / seconds, "wanted_hz": wanted}, where)
    if not came:
        yield Finding("no-images", "error", where=where)


_UNUSABLE = {
    protocol.CameraState.FOUND: "camera-found",
    protocol.CameraState.NO_TRIGGER: "camera-no-trigger",
    protocol.CameraState.LOST: "camera-lost",
    protocol.CameraState.BUSY: "camera-busy",
    protocol.CameraState.ERROR: "camera-error",
}


def covered_camera(source: protocol.CameraSource, before: dict[str, float]) -> str | None:
    """The serial of the one camera whose image is dark now and was not when `before` was taken; else None."""
    now = brightness(source)
    # parts of all cameras' usual change, so that a cloud before the sun covers nobody
    ratios = {serial: now[serial] / before[serial] for serial in now if before.get(serial)}
    if not ratios:
        return None
    usual = float(np.median(list(ratios.values()))) if len(ratios) > 2 else 1.0
    dark = [serial for serial, ratio in ratios.items() if ratio < _COVERED * usual]
    return dark[0] if len(dark) == 1 else None


def brightness(source: protocol.CameraSource) -> dict[str, float]:
    """The mean grey of each camera's image over its darkest percentile, by serial; none without an image."""
    taken = source.capture_set(protocol.CaptureRequest(retries=1))
    means = {}
    for serial, frame in taken.frames.items():
        image = frame.image[::7, ::7]
        means[serial] = float(image.mean() - np.percentile(image, 1))
    return means
