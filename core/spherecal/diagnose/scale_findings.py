"""Finding: the printed targets and the bar that gives the scale contradict each other."""

from dataclasses import dataclass

import numpy as np

from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence
from spherecal.scale.spacing import FoundScale, Spacing, scale_from_spacing

# What printers err by as a whole: 0.1 to 0.5 %; beyond twice the largest of that something else is wrong.
MOST_PRINT_ERROR = 0.01
# Printers differ by up to so much between the feed of the paper and across it.
MOST_STRETCH = 0.005
# A smaller deviation is reported as a measurement of the print, where it is significant.
SURE = 4.0


@dataclass(frozen=True)
class _Printed:
    """Two dots that every target has at one distance."""

    first: int
    second: int
    names: tuple[str, str]
    distance_mm: float


def scale_conflict(e: Evidence) -> list[Finding]:
    """The finding where the targets, measured in the bar's millimetres, are not as large as their layout says."""
    printed = _printed(e)
    cofactors, scale = e.solution.covariance, e.solution.scale
    if scale.source != "bar" or printed is None or cofactors is None or scale.relative_uncertainty is None:
        return []
    found = _measured(e, printed)
    if found is None:
        return []
    larger = e.solution.factor / found.factor - 1
    sure = float(np.hypot(found.relative_uncertainty, scale.relative_uncertainty))
    measured = printed.distance_mm * (1 + larger)
    values = {
        "first": printed.names[0],
        "second": printed.names[1],
        "measured_mm": measured,
        "printed_mm": printed.distance_mm,
        "percent": 100 * larger,
        "sd_percent": 100 * sure,
        "targets": found.count,
    }
    if abs(larger) > MOST_PRINT_ERROR + SURE * sure:
        assert e.session.scale is not None
        return [Finding("scale-conflict", "warning", values, (e.session.scale.bar or "",))]
    return [Finding("print-scale", "info", values)] if abs(larger) > SURE * sure else []


def stretched_print(e: Evidence) -> list[Finding]:
    """The finding where the stickers that give the scale are longer in one direction of the print than across it."""
    stretch = e.solution.stretch
    if not stretch:
        return []
    return [Finding("print-stretched", "warning" if stretch > MOST_STRETCH else "info", {"percent": 100 * stretch})]


def _printed(e: Evidence) -> _Printed | None:
    """The farthest two dots that all seen targets of the target set have, if at one distance on all of them."""
    targets, names = e.session.target_set, e.observations.points
    if targets is None:
        return None
    seen = [targets.layouts[t] for t in np.unique(e.features.target).tolist() if t in targets.layouts]
    if not seen:
        return None
    shared = sorted(set.intersection(*(set(layout) for layout in seen)) & set(names))
    best: _Printed | None = None
    for i, a in enumerate(shared):
        for b in shared[i + 1 :]:
            distances = [float(np.linalg.norm(np.subtract(layout[a], layout[b]))) for layout in seen]
            if np.ptp(distances) < 1e-6 and (best is None or distances[0] > best.distance_mm + 1e-6):
                best = _Printed(names.index(a), names.index(b), (a, b), distances[0])
    return best


def _measured(e: Evidence, printed: _Printed) -> FoundScale | None:
    """The scale that the targets on the ball would give."""
    cofactors, factor = e.solution.covariance, e.solution.factor
    assert cofactors is not None
    radius = np.full(len(e.observations.placements), np.nan)
    for placement, sphere in e.solution.spheres.items():
        radius[placement] = sphere.radius / factor
    points = e.solution.state.points / factor
    points = np.where((e.features.placement < len(e.session.placements))[:, None], points, np.nan)
    spacing = Spacing(printed.first, printed.second, printed.distance_mm, e.session.sphere_diameter_mm is not None)
    return scale_from_spacing(spacing, e.features, points, radius, cofactors, e.adjusted.variance)
