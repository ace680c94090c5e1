"""How a verification departs from VDI/VDE 2634 part 1: computed from what was measured, listed in its report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig
from spherecal.data.session import Bar
from spherecal_verify.budget import Budget
from spherecal_verify.limit import Acceptance, LengthLimit
from spherecal_verify.verification import MeasuredLength

LINES = 7
LEAST_LENGTHS = 5  # test lengths on a line (VDI/VDE 2634-1)
_DIAGONALS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]], dtype=float)


@dataclass(frozen=True)
class MeasuringVolume:
    """The volume: its middle (3,), its axes as rows (3, 3), half its sides (3,), mm in the rig's world."""

    middle: FloatArray
    axes: FloatArray
    half: FloatArray

    @property
    def diagonal_mm(self) -> float:
        """The length of the space diagonal."""
        return 2 * float(np.linalg.norm(self.half))

    def point(self, unit: FloatArray) -> FloatArray:
        """A place (3,) in mm in the world, given in half sides from the middle."""
        return self.middle + (unit * self.half) @ self.axes

    def unit(self, place_mm: FloatArray) -> FloatArray:
        """Half sides from the middle to places (..., 3)."""
        return (place_mm - self.middle) @ self.axes.T / self.half

    def directions(self) -> FloatArray:
        """The seven lines' directions (7, 3) in the world, of length 1: three edges, then four space diagonals."""
        along = np.vstack([np.eye(3), _DIAGONALS * self.half])
        return (along / np.linalg.norm(along, axis=1, keepdims=True)) @ self.axes


def volume_box(rig: Rig, corners_mm: tuple[FloatArray, FloatArray]) -> MeasuringVolume:
    """The box to verify: that of the rig's map of lengths, with its axes, else the box between two corners (3,)."""
    found = rig.length_map
    if found is not None and len(found.places_mm) > 1 and len(found.directions) >= 3:
        middle, axes = found.places_mm.mean(axis=0), found.directions[:3]
        half = np.abs((found.places_mm - middle) @ axes.T).max(axis=0)
        if np.abs(axes @ axes.T - np.eye(3)).max() < 1e-3 and half.min() > 0:
            return MeasuringVolume(middle, axes, half)
    low, high = corners_mm
    return MeasuringVolume((low + high) / 2, np.eye(3), np.maximum((high - low) / 2, 1e-6))


@dataclass(frozen=True)
class Procedure:
    """Title, departures from the guideline, a budget of each length, the decision against the user's limit, the bars.

    `volume_mm` is the volume's three sides and its space diagonal, where the rig states it.
    """

    title: str
    departures: tuple[Phrase, ...]
    budgets: tuple[Budget, ...]
    acceptance: Acceptance | None
    bars: tuple[Bar, ...]
    volume_mm: tuple[tuple[float, ...], float] | None


TITLE = "Verification based on VDI/VDE 2634 part 1 (reduced)"
# Half the least angle between two neighbouring lines of a cube (edge and diagonal: 54.7 degrees).
_ON_LINE_DEG = 27.0
# An end point is in a corner when it is in the outer third of the box along all three axes.
_CORNER = 2.0 / 3.0
# The artefact should be five times better than what it is to prove.
_ARTEFACT_SHARE = 0.2


def departures(
    measured: Sequence[MeasuredLength], bars: Mapping[str, Bar], box: MeasuringVolume | None, limit: LengthLimit | None
) -> tuple[Phrase, ...]:
    """The departures from VDI/VDE 2634 part 1, with the figures; never empty: to state no limit is one."""
    found: list[Phrase] = []
    if box is not None and measured:
        found += _of_artefact(measured, box) + _of_lines(measured, box) + _of_corners(measured, box)
    if any(m.temperature_c is None for m in measured):
        found.append(Phrase("departure-temperature"))
    if limit is None:
        found.append(Phrase("departure-no-limit"))
    else:
        found += _of_uncertainty(measured, bars, limit)
        found.append(Phrase("departure-own-limit"))
    found.append(Phrase("departure-by-hand"))
    return tuple(found)


def _of_artefact(measured: Sequence[MeasuredLength], box: MeasuringVolume) -> list[Phrase]:
    longest = max(m.reference_mm for m in measured)
    requested, shortest = 2 / 3 * box.diagonal_mm, 2 * float(box.half.min())
    found = []
    if longest < requested:
        percent = 100 * longest / box.diagonal_mm
        found.append(Phrase("departure-longest", {"longest": longest, "percent": percent, "wanted": requested}))
    if longest < shortest:
        found.append(Phrase("departure-shortest", {"shortest": shortest}))
    return found


def lengths_on_lines(measured: Sequence[MeasuredLength], box: MeasuringVolume) -> np.ndarray:
    """How many measured lengths run along each of the seven lines (7,): within 27 degrees of its direction."""
    directions, count = box.directions(), np.zeros(LINES, dtype=int)
    for m in measured:
        if m.ends_mm is None:
            continue
        along = m.ends_mm[1] - m.ends_mm[0]
        cosine = np.abs(directions @ along) / np.linalg.norm(along)
        if cosine.max() >= np.cos(np.radians(_ON_LINE_DEG)):
            count[int(cosine.argmax())] += 1
    return count


def _of_lines(measured: Sequence[MeasuredLength], box: MeasuringVolume) -> list[Phrase]:
    count = lengths_on_lines(measured, box)
    used, enough = int((count > 0).sum()), int((count >= LEAST_LENGTHS).sum())
    found = []
    if used < LINES:
        found.append(Phrase("departure-lines", {"used": used, "lines": LINES}))
    if enough < used:
        few = {"least": LEAST_LENGTHS, "few": used - enough, "used": used}
        found.append(Phrase("departure-few-lengths", few))
    return found


def _of_corners(measured: Sequence[MeasuredLength], box: MeasuringVolume) -> list[Phrase]:
    ends = [m.ends_mm for m in measured if m.ends_mm is not None]
    if not ends:
        return []
    unit = box.unit(np.concatenate(ends))
    at = unit[(np.abs(unit) > _CORNER).all(axis=1)] > 0
    reached = len({tuple(corner) for corner in at.tolist()})
    return [] if reached == 8 else [Phrase("departure-corners", {"reached": reached})]


def _of_uncertainty(measured: Sequence[MeasuredLength], bars: Mapping[str, Bar], limit: LengthLimit) -> list[Phrase]:
    worst = 0.0
    for m in measured:
        certified = next(x for x in bars[m.bar].lengths if (x.from_mark, x.to_mark) == (m.from_mark, m.to_mark))
        worst = max(worst, certified.expanded_uncertainty_mm / limit.at(m.reference_mm))
    if worst <= _ARTEFACT_SHARE:
        return []
    return [Phrase("departure-certificates", {"percent": 100 * worst})]
