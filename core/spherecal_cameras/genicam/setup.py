"""The explicit, complete set-up of a camera: every feature that matters is written, whatever the camera remembers."""

import math
import re
import time
from collections.abc import Callable, Sequence
from typing import Any

from spherecal_cameras.genicam.features import NAMES, TABLE, FeatureError, NodeFeatures
from spherecal_cameras.protocol import CameraSettings, FeatureReport, Region, SetupReport

_IN_US = {"us": 1.0, "\N{MICRO SIGN}s": 1.0, "\N{GREEK SMALL LETTER MU}s": 1.0, "ms": 1e3, "s": 1e6, "ns": 1e-3}
_ALL_GAINS = ("All", "AnalogAll")
# Their absence is worth a line in the report; that of the others is not.
_EXPECTED = ("exposure", "gain", "pixel format", "trigger mode", "temperature")
_PACKETS = ("packet size", "packet delay", "frame delay", "throughput limit")
_LIMITED = ("On", "StreamBytesPerSecond")  # of a throughput switch
# An exposure may be rounded to a camera's line time (steps of 1 to 30 us): 1 % is not worth a word.
_ROUNDING = 0.01
_NEAREST_FORMAT = ("Mono8", "Mono10", "Mono12", "Mono16", "Mono12p", "Mono10p", "Mono12Packed", "Mono10Packed")
# What is left, the best first: a mosaic keeps the sharpness, YUV has half the grey values' neighbours.
_OTHER_FORMATS = (
    r"Bayer..8",
    r"Bayer..1\d(p|Packed)?",
    r"(RGB|BGR)a?8(Packed)?",
    r"(RGB|BGR)a?1\d",
    r"Y.*422.*8.*|Y.*422Packed|YUYVPacked",
)
_TRIGGERS = ("FrameStart", "ExposureStart", "FrameBurstStart", "AcquisitionStart")  # of one image, the best first
_ACTIONS = ("Action1", "Action0")
# What an action command must name so that a camera obeys it; other programs' commands should not name the same.
ACTION_DEVICE_KEY, ACTION_GROUP_KEY, ACTION_GROUP_MASK = 0x53434131, 1, 1
_SOFTWARE = ("Software", "TriggerSoftware", "SoftwareTrigger")


def set_up(serial: str, features: NodeFeatures, settings: CameraSettings) -> SetupReport:
    """Write all features of a camera that is open and not acquiring; a report of each, also of what it refuses."""
    began = time.perf_counter()
    reports: list[FeatureReport] = []
    for name, values in TABLE["neutral"].items():
        reports += _neutral(features, name, values)
    reports += _region(features, settings.region)
    reports.append(_pixel_format(features, settings.pixel_format))
    reports.append(_exposure(features, settings.exposure_us))
    reports += _gain(features, settings.gain_db)
    reports += _frame_rate(features, settings)
    reports += _common_clock(features)
    reports += _trigger(features, settings)
    for feature, value in zip(
        _PACKETS[:3], (settings.packet_size, settings.packet_delay, settings.frame_delay), strict=True
    ):
        if value is not None:
            reports.append(_number(features, feature, value))
    if settings.throughput_bytes_s is not None:
        reports += _throughput(features, settings.throughput_bytes_s)
    reports.append(
        FeatureReport("temperature", features.name("temperature"), got=_text(features.number("temperature")))
    )
    pitch = features.number("pixel pitch")
    if pitch is not None and pitch > 0:
        reports.append(FeatureReport("pixel pitch", features.name("pixel pitch"), got=_text(pitch)))
    return SetupReport(serial, tuple(reports), image_size(features), time.perf_counter() - began)


def describe(features: NodeFeatures) -> tuple[FeatureReport, ...]:
    """All our features as the camera names them, with their present values."""
    return tuple(
        FeatureReport(feature, name, got=_text(features.read(name)) if feature != "software trigger" else "")
        for feature in NAMES
        for name in [features.name(feature)]
    )


def image_size(features: NodeFeatures) -> tuple[int, int] | None:
    """Width and height (px) of the images that the camera will send; None where it does not say."""
    width, height = features.number("width"), features.number("height")
    return None if width is None or height is None else (int(width), int(height))


def _neutral(features: NodeFeatures, name: str, values: Sequence[Any]) -> list[FeatureReport]:
    node = features.node(name)
    if node is None or features.access(node) in ("NA", "RO"):
        return []  # not to be changed in the camera's present state
    problem = ""
    for value in values:
        try:
            return [FeatureReport(name, name, _text(value), _text(features.write(name, value)))]
        except FeatureError as error:
            problem = str(error)
    return [FeatureReport(name, name, _text(values[0]), _text(features.read(name)), problem)]


def _write(
    features: NodeFeatures, feature: str, name: str, wanted: Any, agrees: Callable[[Any], bool] | None = None
) -> FeatureReport:
    """A feature written; what the camera took instead is a problem unless it `agrees`, by default: is the same."""
    try:
        got = features.write(name, wanted)
    except FeatureError as error:
        return FeatureReport(feature, name, _text(wanted), _text(features.read(name)), str(error))
    as_meant = isinstance(wanted, bool | str) and got == features.meant(name, wanted)
    well = as_meant or (got == wanted if agrees is None else agrees(got))
    problem = "" if well else f"the camera took {_text(got)}"
    return FeatureReport(feature, name, _text(wanted), _text(got), problem)


def _number(features: NodeFeatures, feature: str, wanted: float) -> FeatureReport:
    name = features.name(feature)
    if name is None:
        problem = "the camera does not have it" if feature in _PACKETS else ""
        return FeatureReport(feature, None, _text(wanted), problem=problem)
    near = max(abs(wanted) * _ROUNDING, 0.1)
    return _write(features, feature, name, wanted, lambda got: abs(float(got) - wanted) <= near)


def _exposure(features: NodeFeatures, wanted_us: float) -> FeatureReport:
    """The exposure in whatever unit the camera has it."""
    name = features.name("exposure")
    scale = None if name is None else exposure_unit_us(features, name)
    if name is None or scale == 1.0:
        return _number(features, "exposure", wanted_us)
    own = wanted_us / (scale or 1.0)
    near = max(abs(own) * _ROUNDING, 0.1 / (scale or 1.0), 0.5 if features.whole(name) else 0.0)
    report = _write(features, "exposure", name, own, lambda got: abs(float(got) - own) <= near)
    problem = report.problem or ("" if scale else "is in the camera's own units, taken for microseconds")
    return FeatureReport("exposure", name, report.wanted, report.got, problem)


def exposure_unit_us(features: NodeFeatures, name: str) -> float | None:
    """Microseconds of one step of the camera's exposure; None where it does not say."""
    if name == "ExposureTimeRaw":
        base = features.read("ExposureTimeBaseAbs")  # of older Basler cameras
        known = float(base) if isinstance(base, int | float) and base > 0 else None
        return known or _IN_US.get(features.unit(name))
    return _IN_US.get(features.unit(name), 1.0)


def exposure_us(features: NodeFeatures) -> float | None:
    """The present exposure, us; None where it cannot be read."""
    name, value = features.name("exposure"), features.number("exposure")
    return None if name is None or value is None else value * (exposure_unit_us(features, name) or 1.0)


def _gain(features: NodeFeatures, wanted_db: float) -> list[FeatureReport]:
    """The gain of all channels: of cameras with several amplifiers the analogue one has it, the digital ones none."""
    selector = "GainSelector"
    offered = features.choices(selector) if features.node(selector) is not None else ()
    chosen = next((one for one in _ALL_GAINS if one in offered), offered[0] if offered else None)
    reports: list[FeatureReport] = []
    for other in offered:
        if other.startswith("Digital") and chosen not in ("All", other):
            reports += _neutral(features, selector, (other,))
            reports.append(_one_gain(features, 0.0))
    if chosen is not None:
        reports += _neutral(features, selector, (chosen,))
    return [*(one for one in reports if one.problem), _one_gain(features, wanted_db)]


def _one_gain(features: NodeFeatures, wanted_db: float) -> FeatureReport:
    name = features.name("gain")
    scale = None if name is None else _gain_scale(features, name)
    if name is None or scale == "dB":
        return _number(features, "gain", wanted_db)
    if scale == "factor":
        factor = 10 ** (wanted_db / 20)
        return _write(features, "gain", name, factor, lambda got: abs(float(got) - factor) <= _ROUNDING * factor)
    # device units: the lowest is the nearest to 0 dB, others cannot be known from outside
    lowest = features.limit(name, "min") or 0
    report = _write(features, "gain", name, lowest)
    problem = report.problem or ("is in the camera's own units: left at its lowest" if wanted_db else "")
    return FeatureReport("gain", name, _text(wanted_db), report.got, problem)


def _gain_scale(features: NodeFeatures, name: str) -> str:
    """What a camera's gain counts in: `dB`, `factor` (IDS and Baumer: 1 is none) or `raw`."""
    if features.unit(name) in ("db", "decibel"):
        return "dB"
    if name == "GainRaw" or features.whole(name):
        return "raw"
    return "factor" if features.limit(name, "min") == 1.0 else "dB"


def gain_db(features: NodeFeatures) -> float | None:
    """The present gain, dB; None where the camera has none, or has it in units of its own."""
    name, value = features.name("gain"), features.number("gain")
    if name is None or value is None:
        return None
    scale = _gain_scale(features, name)
    if scale == "factor":
        return 20 * math.log10(value) if value > 0 else None
    return value if scale == "dB" else None


def _region(features: NodeFeatures, region: Region | None) -> list[FeatureReport]:
    """The image region: offsets to their least first, since they limit the size."""
    reports = []
    for feature in ("left", "top"):
        name = features.name(feature)
        if name is not None and features.read(name):
            reports.append(_write(features, feature, name, int(features.limit(name, "min") or 0)))
    sizes = (("width", region and region.width), ("height", region and region.height))
    for feature, wanted in sizes:
        name = features.name(feature)
        most = None if name is None else features.limit(name, "max") if wanted is None else wanted
        if name is not None and most is not None:
            # the most that a camera names may lie between its steps
            most = features.meant(name, most) if wanted is None else most
            reports.append(_write(features, feature, name, int(most)))
    if region is not None:
        for feature, wanted in (("left", region.x), ("top", region.y)):
            name = features.name(feature)
            if name is not None:
                reports.append(_write(features, feature, name, wanted))
            elif wanted:
                reports.append(FeatureReport(feature, None, _text(wanted), problem="the camera does not have it"))
    return reports


def _pixel_format(features: NodeFeatures, wanted: str) -> FeatureReport:
    name = features.name("pixel format")
    if name is None:
        return FeatureReport("pixel format", None, wanted)
    offered = features.choices(name)
    order = [wanted, *_NEAREST_FORMAT]
    order += [f for kind in _OTHER_FORMATS for f in offered if re.fullmatch(kind, f)]
    report = _write(features, "pixel format", name, wanted)
    for chosen in [f for f in dict.fromkeys(order) if f in offered]:
        report = _write(features, "pixel format", name, chosen)
        if not report.problem:  # an entry may be listed and yet not be had with this sensor
            break
    problem = report.problem
    if report.got != wanted and offered:
        problem = f"the camera has no {wanted}; it offers {', '.join(offered)}. {problem}".strip()
    return FeatureReport("pixel format", name, wanted, report.got, problem)


def _frame_rate(features: NodeFeatures, settings: CameraSettings) -> list[FeatureReport]:
    """The free-running rate; with a trigger, or none wanted, the camera's own limit is taken away."""
    limited = settings.trigger == "free" and settings.frame_rate_hz is not None
    reports = []
    switch = features.name("frame rate limit")
    if switch is not None:
        on: Any = limited if switch != "AcquisitionFrameRateMode" else ("Basic" if limited else "Off")
        reports.append(_write(features, "frame rate limit", switch, on))
    if limited and settings.frame_rate_hz is not None:
        reports.append(_number(features, "frame rate", settings.frame_rate_hz))
    return reports


def _throughput(features: NodeFeatures, wanted_bytes_s: int) -> list[FeatureReport]:
    """The most that a camera sends, bytes/s, by whatever name it has that; less than wanted is well."""
    name, switch = features.name("throughput limit"), features.name("throughput switch")
    if name is None:
        return [_number(features, "throughput limit", wanted_bytes_s)]
    reports = []
    if switch is not None:
        on = next((one for one in _LIMITED if one in features.choices(switch)), _LIMITED[0])
        reports.append(_write(features, "throughput switch", switch, on))
    most = wanted_bytes_s * (1 + _ROUNDING)
    return [*reports, _write(features, "throughput limit", name, wanted_bytes_s, lambda got: float(got) <= most)]


def _common_clock(features: NodeFeatures) -> list[FeatureReport]:
    """IEEE 1588 switched on where a camera has it: it harms nothing, and exposures can be compared by its stamps."""
    name = features.name("common clock")
    if name is None:
        return []
    on: Any = "Auto" if name == "PtpMode" else True
    return [_write(features, "common clock", name, on)]


def _trigger(features: NodeFeatures, settings: CameraSettings) -> list[FeatureReport]:
    """Every trigger but that of a frame off, that one as wanted; free-running where it knows no software trigger."""
    name = features.name("trigger mode")
    if name is None:
        problem = "" if settings.trigger == "free" else "the camera has no trigger: it runs freely"
        return [FeatureReport("trigger mode", None, settings.trigger, problem=problem)]
    reports = []
    selector = "TriggerSelector"
    if features.node(selector) is not None:
        offered = features.choices(selector)
        of_frame = next((one for one in _TRIGGERS if one in offered), offered[0] if offered else "FrameStart")
        for other in offered:
            if other != of_frame:
                reports += _selected_off(features, selector, other, name)
        reports += _neutral(features, selector, (of_frame,))
    if settings.trigger == "free":
        return [*reports, _write(features, "trigger mode", name, "Off")]
    if settings.trigger == "software" and (lack := _no_software(features)):
        off = _write(features, "trigger mode", name, "Off")
        return [*reports, off, FeatureReport("software trigger", None, "software", problem=f"{lack}: it runs freely")]
    reports += _source(features, settings)
    if settings.trigger == "scheduled":
        reports += _action(features)
    reports.append(_write(features, "trigger mode", name, "On"))
    return reports


def _no_software(features: NodeFeatures) -> str:
    """Why a camera cannot be triggered by software; empty where it can."""
    if features.name("software trigger") is None:
        return "the camera has no software trigger"
    source = features.name("trigger source")
    offered = features.choices(source) if source is not None else ()
    if offered and not set(offered) & set(_SOFTWARE):
        return f"the camera's trigger has no source Software; it offers {', '.join(offered)}"
    return ""


def _source(features: NodeFeatures, settings: CameraSettings) -> list[FeatureReport]:
    name = features.name("trigger source")
    if name is None:
        return []
    offered = features.choices(name)
    source = settings.trigger_source
    if settings.trigger == "software":
        source = next((one for one in _SOFTWARE if one in offered), _SOFTWARE[0])
    if settings.trigger == "scheduled":
        source = next((one for one in _ACTIONS if one in offered), _ACTIONS[0])
    report = _write(features, "trigger source", name, source)
    if report.problem and source not in offered:
        problem = f"the camera has no {source}; it offers {', '.join(offered)}"
        report = FeatureReport("trigger source", name, source, report.got, problem)
    return [report]


def _action(features: NodeFeatures) -> list[FeatureReport]:
    """The keys by which a camera knows that an action command is for it."""
    reports = _neutral(features, "ActionUnconditionalMode", ("On",))
    choices = features.choices("ActionSelector")
    source = str(features.read(features.name("trigger source")) or "")
    number: Any = source.removeprefix("Action")
    if features.node("ActionSelector") is not None and number.isdigit():
        reports += _neutral(features, "ActionSelector", (f"Action{number}" if choices else int(number),))
    keys = {
        "ActionDeviceKey": ACTION_DEVICE_KEY,
        "ActionGroupKey": ACTION_GROUP_KEY,
        "ActionGroupMask": ACTION_GROUP_MASK,
    }
    for name, key in keys.items():
        if features.node(name) is None:
            reports.append(FeatureReport(name, None, str(key), problem="the camera takes no action commands"))
        else:
            reports.append(_write(features, name, name, key))
    return reports


def _selected_off(features: NodeFeatures, selector: str, other: str, mode: str) -> list[FeatureReport]:
    try:
        features.write(selector, other)
        if features.read(mode) not in (None, features.meant(mode, "Off")):
            features.write(mode, "Off")
    except FeatureError as error:
        return [FeatureReport(f"trigger {other}", mode, "Off", problem=str(error))]
    return []


def _text(value: object) -> str:
    if value is None:
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)
