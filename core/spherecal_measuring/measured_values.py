"""Distances, angles and bars' lengths between measured places, with standard uncertainties (GUM, first order)."""

import math
from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.data.rig import Rig
from spherecal.data.session import Bar
from spherecal.scale.bar_temperature import reference_length
from spherecal_measuring.measured_sets import MeasuredValue
from spherecal_measuring.measuring_task import PointName, Ruler
from spherecal_measuring.places import LocatedPoints
from spherecal_verify.marks import MarkPlace
from spherecal_verify.uncertainty import PointErrors, length_budget

# Below it two points are one: the direction between them is noise.
_LEAST_MM = 1e-6
_LEAST_SINE = 1e-6  # of an angle near 0 or 180 degrees, where its derivative is not defined


@dataclass(frozen=True)
class Unmeasured:
    """Why a value could not be measured."""

    reason: str


def measure_ruler(ruler: Ruler, places: LocatedPoints, rig: Rig, with_scale: bool) -> MeasuredValue | Unmeasured:
    """A distance in mm or an angle in degrees with its standard uncertainty, or why there is none."""
    rows = [places.rows.get(name) for name in ruler.points]
    if missing := [str(name) for name, row in zip(ruler.points, rows, strict=True) if row is None]:
        return Unmeasured(f"{', '.join(missing)} not measured")
    chosen = [row for row in rows if row is not None]
    at = places.places_mm[chosen]
    if ruler.kind == "distance":
        between = at[1] - at[0]
        value = float(np.linalg.norm(between))
        if value < _LEAST_MM:
            return Unmeasured("the points are one")
        derivative = np.stack([-between, between]) / value
        variance = places.variance(chosen, derivative)
        if not with_scale:
            variance += ((rig.scale.relative_uncertainty or 0.0) * value) ** 2
        u = math.sqrt(variance)
    else:
        found = _angle(at)
        if found is None:
            return Unmeasured("the points are on one line")
        value, u = math.degrees(found[0]), math.degrees(math.sqrt(places.variance(chosen, found[1])))
    deviation = None if ruler.nominal is None else value - ruler.nominal
    return MeasuredValue(ruler.kind, ruler.name, value, u, ruler.nominal, deviation, None if deviation is None else u)


def _angle(at: FloatArray) -> tuple[float, FloatArray] | None:
    """The angle at the second of three places in rad, and its derivatives (3, 3); None near 0 and 180 degrees."""
    a, b = at[0] - at[1], at[2] - at[1]
    long_a, long_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if min(long_a, long_b) < _LEAST_MM:
        return None
    a, b = a / long_a, b / long_b
    cosine, sine = float(a @ b), float(np.linalg.norm(np.cross(a, b)))
    if sine < _LEAST_SINE:
        return None
    by_a, by_b = -(b - cosine * a) / (long_a * sine), -(a - cosine * b) / (long_b * sine)
    return math.atan2(sine, cosine), np.stack([by_a, -by_a - by_b, by_b])


def measure_bar(
    bar: Bar, places: LocatedPoints, errors: PointErrors, rig: Rig, temperature_c: float | None
) -> list[MeasuredValue | Unmeasured]:
    """Every certified length of a bar in mm and its deviation at its temperature; or why it was not measured."""
    found: list[MeasuredValue | Unmeasured] = []
    for certified in bar.lengths:
        ends = []
        for name in (certified.from_mark, certified.to_mark):
            mark = bar.marks[name]
            row = places.rows.get(PointName(mark.target, mark.point))
            if row is not None:
                at = places.places_mm[row], places.dots[row], places.by_dot[row], int(places.views[row])
                ends.append(MarkPlace(*at))
        if len(ends) < 2:
            found.append(Unmeasured(f"bar {bar.id}: {certified.from_mark} or {certified.to_mark} not measured"))
            continue
        pair = ends[0], ends[1]
        budget = length_budget(pair, errors, rig.scale.relative_uncertainty or 0.0, certified, bar, temperature_c)
        length = float(np.linalg.norm(pair[1].place_mm - pair[0].place_mm))
        reference = reference_length(certified, bar, temperature_c)
        u = math.hypot(budget.noise_mm, budget.calibration_mm, budget.scale_mm)
        name = f"{bar.id}:{certified.from_mark}-{certified.to_mark}"
        found.append(MeasuredValue("bar", name, length, u, reference, length - reference, budget.combined_mm))
    return found
