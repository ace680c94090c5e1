"""Temperatures of bars that no workshop has: typed in another unit, or mistyped."""

from collections.abc import Collection, Sequence

from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.session import BarPose

# Workshops, and bars that are certified at 20 degrees. 70 and 120 typed for Fahrenheit were VALID, 8 to 17 U off.
TEMPERATURES_C = (5.0, 45.0)


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
