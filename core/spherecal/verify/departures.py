"""How a verification departs from VDI/VDE 2634 part 1: computed from what was measured, listed in its report."""

from collections.abc import Mapping, Sequence

import numpy as np

from spherecal.data.session import Bar
from spherecal.verify.limit import LengthLimit
from spherecal.verify.pose_plan import LEAST_LENGTHS, LINES, MeasuringVolume
from spherecal.verify.verification import MeasuredLength

TITLE = "Verification based on VDI/VDE 2634 part 1 (reduced)"
# Half the least angle between two neighbouring lines of a cube (edge and diagonal: 54.7 degrees).
_ON_LINE_DEG = 27.0
# An end point is in a corner when it is in the outer third of the box along all three axes.
_CORNER = 2.0 / 3.0
# The artefact should be five times better than what it is to prove.
_ARTEFACT_SHARE = 0.2


def departures(
    measured: Sequence[MeasuredLength], bars: Mapping[str, Bar], box: MeasuringVolume | None, limit: LengthLimit | None
) -> tuple[str, ...]:
    """The departures in plain words, with the figures; never empty, since the limit and budget are the user's own."""
    found: list[str] = []
    if box is not None and measured:
        found += _of_artefact(measured, box) + _of_lines(measured, box) + _of_corners(measured, box)
    if any(m.temperature_c is None for m in measured):
        found.append("The bar's temperature was not measured in every pose; within 5 K of its reference is assumed.")
    if limit is None:
        found.append("No limit of the length error was stated: errors are judged by their uncertainty alone.")
    else:
        found += _of_uncertainty(measured, bars, limit)
        found.append(
            "The limit is the user's own; the uncertainty in the decision holds the rig's own share too, which makes "
            "pass and fail harder to reach, never easier."
        )
    found.append("Bars are laid by hand in the volume that the rig sees, not in a volume that its maker states.")
    return tuple(found)


def _of_artefact(measured: Sequence[MeasuredLength], box: MeasuringVolume) -> list[str]:
    longest = max(m.reference_mm for m in measured)
    wanted, shortest = 2 / 3 * box.diagonal_mm, float(box.sides_mm[0])
    found = []
    if longest < wanted:
        found.append(
            f"The longest test length, {longest:.0f} mm, is {100 * longest / box.diagonal_mm:.0f} % of the volume's "
            f"space diagonal; the guideline asks for two thirds, {wanted:.0f} mm."
        )
    if longest < shortest:
        found.append(f"It is shorter than the volume's shortest side, {shortest:.0f} mm.")
    return found


def lengths_on_lines(measured: Sequence[MeasuredLength], box: MeasuringVolume) -> np.ndarray:
    """How many measured lengths run along each of the seven lines (7,)."""
    directions, count = box.directions(), np.zeros(LINES, dtype=int)
    for m in measured:
        if m.ends_mm is None:
            continue
        along = m.ends_mm[1] - m.ends_mm[0]
        cosine = np.abs(directions @ along) / np.linalg.norm(along)
        if cosine.max() >= np.cos(np.radians(_ON_LINE_DEG)):
            count[int(cosine.argmax())] += 1
    return count


def _of_lines(measured: Sequence[MeasuredLength], box: MeasuringVolume) -> list[str]:
    count = lengths_on_lines(measured, box)
    used, enough = int((count > 0).sum()), int((count >= LEAST_LENGTHS).sum())
    found = []
    if used < LINES:
        found.append(f"Lengths were measured along {used} of {LINES} lines (edges and space diagonals of the volume).")
    if enough < used:
        found.append(f"Lines with fewer than {LEAST_LENGTHS} measured lengths: {used - enough} of {used}.")
    return found


def _of_corners(measured: Sequence[MeasuredLength], box: MeasuringVolume) -> list[str]:
    ends = [m.ends_mm for m in measured if m.ends_mm is not None]
    if not ends:
        return []
    unit = box.unit(np.concatenate(ends))
    at = unit[(np.abs(unit) > _CORNER).all(axis=1)] > 0
    reached = len({tuple(corner) for corner in at.tolist()})
    return [] if reached == 8 else [f"End points lie in {reached} of the volume's 8 corners."]


def _of_uncertainty(measured: Sequence[MeasuredLength], bars: Mapping[str, Bar], limit: LengthLimit) -> list[str]:
    worst = 0.0
    for m in measured:
        certified = next(
            x for x in bars[m.bar].lengths if (x.from_mark, x.to_mark) == (m.from_mark, m.to_mark)
        )  # fmt: skip
        worst = max(worst, certified.expanded_uncertainty_mm / limit.at(m.reference_mm))
    if worst <= _ARTEFACT_SHARE:
        return []
    return [f"The bars' certificates are uncertain by up to {100 * worst:.0f} % of the limit; a fifth is customary."]
