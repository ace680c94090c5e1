"""The explicit, complete set-up of a camera: every feature that matters is written, whatever the camera remembers."""

import time
from collections.abc import Callable
from typing import Any

from spherecal.cameras.gentl.features import NAMES, FeatureError, NodeFeatures
from spherecal.cameras.protocol import CameraSettings, FeatureReport, Region, SetupReport

# What would change grey values or geometry behind our back, in the order in which it can be switched off. Values are
# tried one after the other; a camera without the feature is as good as one that has it off.
_NEUTRAL: tuple[tuple[str, tuple[Any, ...]], ...] = (
    ("AcquisitionMode", ("Continuous",)),
    ("ExposureMode", ("Timed",)),
    ("ExposureAuto", ("Off",)),
    ("GainAuto", ("Off",)),
    ("BalanceWhiteAuto", ("Off",)),
    ("BlackLevelAuto", ("Off",)),
    ("GammaEnable", (False,)),
    ("Gamma", (1.0,)),
    ("LUTEnable", (False,)),
    ("TestPattern", ("Off",)),
    ("TestImageSelector", ("Off",)),
    ("TestPatternGeneratorSelector", ("Off",)),
    ("BinningHorizontal", (1,)),
    ("BinningVertical", (1,)),
    ("DecimationHorizontal", (1,)),
    ("DecimationVertical", (1,)),
    ("ReverseX", (False,)),
    ("ReverseY", (False,)),
    ("ChunkModeActive", (False,)),
    ("TriggerDelay", (0.0,)),
    ("TriggerDelayAbs", (0.0,)),
    ("TriggerActivation", ("RisingEdge",)),
)
# Their absence is worth a line in the report; that of the others is not.
_EXPECTED = ("exposure", "gain", "pixel format", "trigger mode", "temperature")
_PACKETS = ("packet size", "packet delay", "frame delay")
# An exposure may be rounded to a camera's line time (steps of 1 to 30 us): 1 % is not worth a word.
_ROUNDING = 0.01
_NEAREST_FORMAT = ("Mono8", "Mono10", "Mono12", "Mono16", "Mono12p", "Mono10p", "Mono12Packed", "Mono10Packed")


def set_up(serial: str, features: NodeFeatures, settings: CameraSettings) -> SetupReport:
    """Write all features of a camera that is open and not acquiring; reports each, raises nothing of the camera's."""
    began = time.perf_counter()
    reports: list[FeatureReport] = []
    for name, values in _NEUTRAL:
        reports += _neutral(features, name, values)
    reports += _region(features, settings.region)
    reports.append(_pixel_format(features, settings.pixel_format))
    reports.append(_number(features, "exposure", settings.exposure_us))
    reports.append(_number(features, "gain", settings.gain_db))
    reports += _frame_rate(features, settings)
    reports += _trigger(features, settings)
    for feature, value in zip(
        _PACKETS, (settings.packet_size, settings.packet_delay, settings.frame_delay), strict=True
    ):
        if value is not None:
            reports.append(_number(features, feature, value))
    reports.append(
        FeatureReport("temperature", features.name("temperature"), got=_text(features.number("temperature")))
    )
    return SetupReport(serial, tuple(reports), image_size(features), time.perf_counter() - began)


def describe(features: NodeFeatures) -> tuple[FeatureReport, ...]:
    """All our features as the camera names them, with their present values."""
    return tuple(
        FeatureReport(feature, name, got=_text(features.read(name)) if feature != "software trigger" else "")
        for feature in NAMES
        for name in [features.name(feature)]
    )


def image_size(features: NodeFeatures) -> tuple[int, int] | None:
    """Width and height of the images that the camera will send."""
    width, height = features.number("width"), features.number("height")
    return None if width is None or height is None else (int(width), int(height))


def _neutral(features: NodeFeatures, name: str, values: tuple[Any, ...]) -> list[FeatureReport]:
    node = features.node(name)
    if node is None or features.access(node) in ("NA", "RO"):
        return []  # without effect in the camera's present state
    problem = ""
    for value in values:
        try:
            return [FeatureReport(name, name, _text(value), _text(features.write(name, value)))]
        except FeatureError as error:
            problem = str(error)
    return [FeatureReport(name, name, _text(values[0]), _text(features.read(name)), problem)]


def _write(
    features: NodeFeatures, feature: str, name: str, wanted: Any, agrees: Callable[[Any], bool]
) -> FeatureReport:
    try:
        got = features.write(name, wanted)
    except FeatureError as error:
        return FeatureReport(feature, name, _text(wanted), _text(features.read(name)), str(error))
    problem = "" if agrees(got) else f"the camera took {_text(got)}"
    return FeatureReport(feature, name, _text(wanted), _text(got), problem)


def _number(features: NodeFeatures, feature: str, wanted: float) -> FeatureReport:
    name = features.name(feature)
    if name is None:
        problem = "the camera does not have it" if feature in _PACKETS else ""
        return FeatureReport(feature, None, _text(wanted), problem=problem)
    if name == "GainRaw":  # device units: the lowest is the nearest to 0 dB, others cannot be told from outside
        lowest = getattr(features.node(name), "min", 0)
        report = _write(features, feature, name, lowest, lambda got: got == lowest)
        problem = report.problem or ("is in the camera's own units: left at its lowest" if wanted else "")
        return FeatureReport(feature, name, _text(wanted), report.got, problem)
    near = max(abs(wanted) * _ROUNDING, 0.1)
    return _write(features, feature, name, wanted, lambda got: abs(float(got) - wanted) <= near)


def _region(features: NodeFeatures, region: Region | None) -> list[FeatureReport]:
    """The image region: offsets to zero first, since they limit the size."""
    reports = []
    for feature in ("left", "top"):
        name = features.name(feature)
        if name is not None and features.read(name):
            reports.append(_write(features, feature, name, 0, lambda got: got == 0))
    sizes = (("width", region and region.width), ("height", region and region.height))
    for feature, wanted in sizes:
        name = features.name(feature)
        if name is not None:
            most = getattr(features.node(name), "max", None) if wanted is None else wanted
            if most is not None:
                reports.append(_write(features, feature, name, most, lambda got, most=most: got == most))
    if region is not None:
        for feature, wanted in (("left", region.x), ("top", region.y)):
            name = features.name(feature)
            if name is not None:
                reports.append(_write(features, feature, name, wanted, lambda got, wanted=wanted: got == wanted))
            elif wanted:
                reports.append(FeatureReport(feature, None, _text(wanted), problem="the camera does not have it"))
    return reports


def _pixel_format(features: NodeFeatures, wanted: str) -> FeatureReport:
    name = features.name("pixel format")
    if name is None:
        return FeatureReport("pixel format", None, wanted)
    offered = features.choices(name)
    order = [wanted, *_NEAREST_FORMAT, *(f for f in offered if f.startswith("Bayer") and f.endswith("8"))]
    order += [f for f in offered if f.startswith(("Bayer", "RGB", "BGR"))]
    chosen = next((f for f in order if f in offered), wanted)
    report = _write(features, "pixel format", name, chosen, lambda got: got == chosen)
    problem = report.problem
    if chosen != wanted:
        problem = f"the camera has no {wanted}; it offers {', '.join(offered)}. {problem}".strip()
    return FeatureReport("pixel format", name, wanted, report.got, problem)


def _frame_rate(features: NodeFeatures, settings: CameraSettings) -> list[FeatureReport]:
    """The free-running rate; with a trigger, or none wanted, the camera's own limit is taken away."""
    limited = settings.trigger == "free" and settings.frame_rate_hz is not None
    reports = []
    switch = features.name("frame rate limit")
    if switch is not None:
        on: Any = limited if switch != "AcquisitionFrameRateMode" else ("Basic" if limited else "Off")
        reports.append(_write(features, "frame rate limit", switch, on, lambda got: got == on))
    if limited and settings.frame_rate_hz is not None:
        reports.append(_number(features, "frame rate", settings.frame_rate_hz))
    return reports


def _trigger(features: NodeFeatures, settings: CameraSettings) -> list[FeatureReport]:
    """Every trigger but that of a frame off, that one as wanted."""
    name = features.name("trigger mode")
    if name is None:
        problem = "" if settings.trigger == "free" else "the camera has no trigger: it runs freely"
        return [FeatureReport("trigger mode", None, settings.trigger, problem=problem)]
    reports = []
    selector = "TriggerSelector"
    if features.node(selector) is not None:
        for other in features.choices(selector):
            if other != "FrameStart":
                reports += _selected_off(features, selector, other, name)
        reports += _neutral(features, selector, ("FrameStart",))
    if settings.trigger == "free":
        return [*reports, _write(features, "trigger mode", name, "Off", lambda got: got == "Off")]
    source = "Software" if settings.trigger == "software" else settings.trigger_source
    source_name = features.name("trigger source")
    if source_name is not None:
        report = _write(features, "trigger source", source_name, source, lambda got: got == source)
        offered = features.choices(source_name)
        if report.problem and source not in offered:
            problem = f"the camera has no {source}; it offers {', '.join(offered)}"
            report = FeatureReport("trigger source", source_name, source, report.got, problem)
        reports.append(report)
    reports.append(_write(features, "trigger mode", name, "On", lambda got: got == "On"))
    return reports


def _selected_off(features: NodeFeatures, selector: str, other: str, mode: str) -> list[FeatureReport]:
    try:
        features.write(selector, other)
        if features.read(mode) not in (None, "Off"):
            features.write(mode, "Off")
    except FeatureError as error:
        return [FeatureReport(f"trigger {other}", mode, "Off", problem=str(error))]
    return []


def _text(value: object) -> str:
    if value is None:
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)


def lacks(report: SetupReport) -> tuple[str, ...]:
    """The features, of those that matter, that a camera does not have."""
    return tuple(feature for feature in report.missing if feature in _EXPECTED)
