"""What the temperature of a bar does to its lengths, and temperatures that no workshop has."""

import math
from collections.abc import Collection, Sequence

from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.session import Bar, BarLength, BarPose

# Workshops, and bars that are certified at 20 degrees. 70 and 120 typed for Fahrenheit were VALID, 8 to 17 U off.
TEMPERATURES_C = (5.0, 45.0)
# A hand-held thermometer and a bar not quite at the air's temperature: +-0.5 K, evenly distributed. Unmeasured, a
# workshop is within +-5 K of the reference temperature.
_MEASURED_TEMPERATURE_SD_K = 0.5 / math.sqrt(3)
_ASSUMED_TEMPERATURE_SD_K = 5.0 / math.sqrt(3)
# Handbook values of metals hold to 10 %, evenly distributed.
EXPANSION_RELATIVE_SD = 0.1 / math.sqrt(3)
# Not stated, it is taken as steel's and may be anything from none (carbon fibre, Invar) to twice that (aluminium).
_UNKNOWN_EXPANSION_RELATIVE_SD = 1 / math.sqrt(3)


def temperature_findings(poses: Sequence[BarPose], bars: Collection[str]) -> list[Finding]:
    """Findings on poses of some bars whose temperature no workshop has: typed in another unit, or mistyped."""
    low, high = TEMPERATURES_C
    odd: dict[float, list[str]] = {}
    for pose in poses:
        if pose.bar in bars and pose.temperature_c is not None and not low <= pose.temperature_c <= high:
            odd.setdefault(pose.temperature_c, []).append(pose.id)
    found = []
    for celsius, names in odd.items():
        fahrenheit, kelvin = (celsius - 32) / 1.8, celsius - 273.15
        guess = Phrase("perhaps-nothing")
        if low <= fahrenheit <= high:
            guess = Phrase("perhaps-fahrenheit", {"celsius": fahrenheit})
        elif low <= kelvin <= high:
            guess = Phrase("perhaps-kelvin", {"celsius": kelvin})
        found.append(Finding("bar-temperature", "error", {"celsius": celsius, "guess": guess}, tuple(names)))
    return found


def reference_length(certified: BarLength, bar: Bar, temperature_c: float | None) -> float:
    """The certified length in mm at the bar's temperature; as certified where that was not measured."""
    warmer_k = 0.0 if temperature_c is None else temperature_c - bar.reference_temperature_c
    return certified.length_mm * (1 + bar.expansion_per_kelvin * warmer_k)


def temperature_part(length_mm: float, bar: Bar, temperature_c: float | None) -> float:
    """The standard uncertainty of a length in mm by the thermometer and the coefficient of expansion."""
    warmer_k = 0.0 if temperature_c is None else temperature_c - bar.reference_temperature_c
    sd_k = temperature_sd(temperature_c)
    return length_mm * abs(bar.expansion_per_kelvin) * math.hypot(sd_k, expansion_kelvin(bar, warmer_k, sd_k))


def expansion_kelvin(bar: Bar, warmer_k: float, sd_k: float) -> float:
    """The effect of an unknown expansion (kelvin) of a bar that is warmer by an amount known to `sd_k` (GUM 5.1.2)."""
    if "expansion_per_kelvin" in bar.assumed:
        return _UNKNOWN_EXPANSION_RELATIVE_SD * math.hypot(warmer_k, sd_k)
    return warmer_k * EXPANSION_RELATIVE_SD


def temperature_sd(temperature_c: float | None) -> float:
    """The standard uncertainty in kelvin of a bar's temperature, measured or (None) assumed."""
    return _ASSUMED_TEMPERATURE_SD_K if temperature_c is None else _MEASURED_TEMPERATURE_SD_K
