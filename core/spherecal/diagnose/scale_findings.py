"""Findings: the sources of scale, weighed against each other: the bar, the print, the ball's diameter.

None of them proves another right: what contradicts is named with its size, until one is struck out by hand
(`--leave-out scale:print`, `scale:ball` or `scale:bar`).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.soundness import diameter_error
from spherecal.scale.metric import radii_of
from spherecal.scale.spacing import FoundScale, Located, Spacing, scale_from_spacing

# What printers err by as a whole: 0.1 to 0.5 %; beyond twice the largest of that something else is wrong.
MOST_PRINT_ERROR = 0.01
# Printers differ by up to so much between the feed of the paper and across it.
MOST_STRETCH = 0.005
# A smaller deviation is reported as a measurement of the print, where it is significant.
SURE = 4.0
# A source whose uncertainty was stated contradicts another beyond this many of both.
STATED = 3.0
# Print and ball agree against the bar where their mean is so many times what either is off from it (1.5 apart at most;
# of prints and balls that err by chance one pair in eight does), and each deviates by so many of its own uncertainties.
# Seen so on rig A: 1 mm on 800 mm (60 U); 0.2 mm (12 U) is less than the ball is known to.
AGREE, SEEN = 5.0, 2.0
# Of a ball's deviation from round (rms) the diameter of its visible part is off by about this share: 0.04 and 0.075 %
# at 0.15 % (rig A, bumps of 1 mm).
SHAPE_SHARE = 0.4
# Then the bar is doubted from any size on, and nothing is valid from this on: 7 mm mistyped on 800 mm were 132 U.
MOST_AGAINST_BAR = 0.005


def scale_conflict(e: Evidence) -> list[Finding]:
    """The findings where the bar's millimetres contradict the print, the ball, or both together."""
    cofactors, scale = e.solution.covariance, e.solution.scale
    if scale.source != "bar" or cofactors is None or scale.relative_uncertainty is None:
        return []
    bar = (e.session.scale.bar or "",) if e.session.scale is not None else ()
    sure = scale.relative_uncertainty
    by_print, by_ball = _print_deviation(e, sure), _ball_deviation(e, sure)
    together = _against_the_bar(by_print, by_ball, bar)
    if by_print is None:
        return together
    if abs(by_print.larger) > MOST_PRINT_ERROR + SURE * by_print.sd:
        return [*together, Finding("scale-conflict", "warning", by_print.values, bar)]
    seen = abs(by_print.larger) > SURE * by_print.sd and not together
    return [*together, *([Finding("print-scale", "info", by_print.values)] if seen else [])]


@dataclass(frozen=True)
class _Deviation:
    """How much larger a source is by the bar than it says, relatively: measured to `sd`; `stated` is its own error."""

    larger: float
    sd: float
    stated: float | None
    values: dict[str, Any]

    @property
    def contradicts(self) -> bool:
        """Whether it was measured, and is not what was measured."""
        return self.stated is not None and abs(self.larger) > STATED * float(np.hypot(self.sd, self.stated))


def _print_deviation(e: Evidence, sure: float) -> _Deviation | None:
    """Of the targets, measured in the bar's millimetres."""
    targets = None if "print" in e.session.struck else e.session.target_set
    seen = np.unique(e.features.target).tolist()
    printed = None if targets is None else targets.widest(seen, e.observations.points)
    found = None if printed is None else _measured(e, *printed)
    if printed is None or found is None:
        return None
    first, second, printed_mm = printed
    larger, sd = e.solution.factor / found.factor - 1, float(np.hypot(found.relative_uncertainty, sure))
    values = {
        "first": first, "second": second, "measured_mm": printed_mm * (1 + larger),
        "printed_mm": printed_mm, "percent": 100 * larger, "sd_percent": 100 * sd, "targets": found.count,
    }  # fmt: skip
    return _Deviation(larger, sd, None, values)


def _ball_deviation(e: Evidence, sure: float) -> _Deviation | None:
    """Of the ball's diameter; how far the ball is from round says how well it is measured."""
    larger = None if "ball" in e.session.struck else diameter_error(e)
    diameter, own = e.session.sphere_diameter_mm, e.session.sphere_sd_mm
    if larger is None or diameter is None:
        return None
    shape = [s.radial_sd / s.radius for s in e.solution.spheres.values()]
    sd = float(np.hypot(SHAPE_SHARE * np.median(shape), sure))
    return _Deviation(larger, sd, None if own is None else own / diameter, {})


def _against_the_bar(by_print: _Deviation | None, by_ball: _Deviation | None, bar: tuple[str, ...]) -> list[Finding]:
    """The finding where print and ball agree with each other by more than with the bar."""
    if by_ball is None or by_print is None:
        return []
    pair = (by_print, by_ball)
    mean, apart = (by_print.larger + by_ball.larger) / 2, abs(by_print.larger - by_ball.larger) / 2
    noise = float(np.hypot(by_print.sd, by_ball.sd)) / 2
    agree = abs(mean) > AGREE * max(apart - noise, 0.0) and all(abs(one.larger) > SEEN * one.sd for one in pair)
    if not (agree or by_ball.contradicts):
        return []
    values = {"print_percent": 100 * by_print.larger, "ball_percent": 100 * by_ball.larger, "mm": -500 * mean}
    wrong = abs(mean) > MOST_AGAINST_BAR or by_ball.contradicts
    return [Finding("scale-sources", "error" if wrong else "warning", values, bar)]


def bar_doubt(findings: Iterable[Finding]) -> float:
    """The relative standard uncertainty that print and ball against the bar add: twice it covers the difference.

    A certificate mistyped by 0.3 %: lengths 58 times U off where it was not.
    """
    return sum(abs(f.values["mm"]) / 1000 for f in findings if f.code == "scale-sources")


def stretched_print(e: Evidence) -> list[Finding]:
    """Where stickers that give the scale are longer in one direction of the print than across it, or of two sheets."""
    found = e.solution.found
    return [
        Finding("print-stretched", "warning" if off > MOST_STRETCH else "info", {"percent": 100 * off}, kind=kind)
        for off, kind in ([] if found is None else [(found.stretch, "across"), (found.sheets, "sheets")])
        if off
    ]


def _measured(e: Evidence, first: str, second: str, distance_mm: float) -> FoundScale | None:
    """The scale that the targets on the ball would give by two of their dots."""
    cofactors, factor = e.solution.covariance, e.solution.factor
    assert cofactors is not None
    radii = radii_of(e.solution.spheres, len(e.observations.placements)) / factor
    points = e.solution.state.points / factor
    points = np.where((e.features.placement < len(e.session.placements))[:, None], points, np.nan)
    names, on_sphere = e.observations.points, e.session.sphere_diameter_mm is not None
    spacing = Spacing(names.index(first), names.index(second), distance_mm, on_sphere)
    return scale_from_spacing(spacing, e.features, radii, Located(points, cofactors, e.adjusted.variance))
