"""Doubts about a verification: expired certificates, thermometers, bars that contradict each other in one rig."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date

import numpy as np

from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, Severity
from spherecal.data.session import Bar, BarPose
from spherecal.scale.bar_temperature import temperature_findings
from spherecal_verify.budget import pooled_scatter
from spherecal_verify.consistency import Consistency
from spherecal_verify.expiry import expiry
from spherecal_verify.limit import Acceptance
from spherecal_verify.verification import Decision, MeasuredLength

# Findings under which no rig passes: what was measured, or what it was measured with, is in doubt.
DOUBTS = (
    "camera-moved", "camera-contradicts", "camera-not-verified", "outlying-views", "certificate-expired",
    "temperatures-differ", "bars-disagree", "length-doubtful", "rig-not-valid",
)  # fmt: skip
# Findings that say that the rig is not as calibrated, whatever the lengths of the other cameras are.
_OF_THE_RIG = ("camera-moved", "camera-contradicts")
# Bars that lie in one shop for an hour are within 1 to 2 K of each other; more is a wrong reading or a cold bar.
_TEMPERATURE_RANGE_K = 3.0
# Lengths of 100 to 500 mm on one bar; of alike ones every error is in proportion. What a scale of 1 % leaves of the
# squares of the demo's errors is 0.1 %, errors of one wrong length more than half.
_DIFFERENT, _UNEXPLAINED = 1.5, 0.05
# A false alarm once in 15 000; benchmarks/studies/verification.md counts them.
_CONTRADICTION = 4.0


def contradicted(decision: Decision, findings: Sequence[Finding]) -> Decision:
    """The decision, which is also inconsistent if a camera is not where the calibration has it."""
    cameras = tuple(dict.fromkeys(name for f in findings if f.code in _OF_THE_RIG for name in f.where))
    if not cameras:
        return decision
    return replace(decision, verdict="inconsistent", cameras=cameras)


def failures(measured: Sequence[MeasuredLength], decision: Decision, acceptance: Acceptance | None) -> list[Finding]:
    """Findings that say that the rig fails: its errors contradict what it states, or exceed the user's limit."""
    found = []
    if decision.verdict == "inconsistent":
        worst = max((m for m in measured if m.certified), key=lambda m: abs(m.error_mm) / m.budget.combined_mm)
        values = {
            "exceeding": len(decision.exceeding), "n": sum(m.certified for m in measured), "worst_mm": worst.error_mm,
            "times": abs(worst.error_mm) / worst.budget.combined_mm, "k": decision.coverage_factor,
            "chi": decision.chi_square or 0.0, "chi_limit": decision.most_chi_square or 0.0,
        }  # fmt: skip
        places = tuple(dict.fromkeys(pose for pose, _, _ in decision.exceeding))
        ratio = in_proportion([m for m in measured if m.certified])
        kind = "scale" if ratio is not None else "each" if places else "together"
        values |= {"percent": 100 * (ratio or 0.0)}
        found.append(Finding("lengths-contradict", "error", values, places, kind=kind))
    if acceptance is not None and acceptance.verdict == "fail":
        failed = [x for x in acceptance.lengths if x.verdict == "fail"]
        worst_length = max(failed, key=lambda x: abs(x.worst_error_mm) - x.limit_mm)
        values = {"worst_mm": worst_length.worst_error_mm, "limit_mm": worst_length.limit_mm}
        places = tuple(dict.fromkeys(x.worst_pose for x in failed))
        found.append(Finding("limit-exceeded", "error", values | {"limit": acceptance.limit.words()}, places))
    return found


def in_proportion(measured: Sequence[MeasuredLength]) -> float | None:
    """The relative error that explains the errors of different lengths, as a wrong scale does; None where none does."""
    length = np.array([m.reference_mm for m in measured])
    over = np.array([m.budget.combined_mm for m in measured])
    error = np.array([m.error_mm for m in measured])
    if not len(length) or length.max() < _DIFFERENT * length.min():
        return None
    ratio = float((length * error / over**2).sum() / (length**2 / over**2).sum())
    left = (error - ratio * length) / over
    explained = (left**2).sum() < _UNEXPLAINED * ((error / over) ** 2).sum()
    return ratio if np.abs(left).max() < _CONTRADICTION and explained else None


def certificate_doubts(bars: Sequence[Bar], today: date) -> list[Finding]:
    """Findings on certificates expired, soon to expire or not valid yet, and on registered bars without one."""
    found = []
    for bar in bars:
        said = None if bar.serial is None and bar.certificate is None else expiry(bar.certificate, today)
        if said is None:
            continue
        word, state = said
        code, severity = _CERTIFICATES[word]
        found.append(Finding(code, severity, {"bar": bar.serial or bar.id, "state": state}, (bar.id,)))
    return found


_CERTIFICATES: dict[str, tuple[str, Severity]] = {
    "expired": ("certificate-expired", "warning"),
    "not-yet": ("certificate-not-yet", "warning"),
    "expires-soon": ("certificate-expires-soon", "info"),
    "no-certificate": ("no-certificate", "info"),
}


def temperature_doubts(poses: Sequence[BarPose], bars: Mapping[str, Bar]) -> list[Finding]:
    """Findings on readings that differ by more than bars in one shop do, 3 K: of one bar, and between bars."""
    by_bar: dict[str, list[BarPose]] = {}
    for pose in poses:
        if pose.bar in bars and pose.temperature_c is not None:
            by_bar.setdefault(pose.bar, []).append(pose)
    middle = {bar: float(np.median([p.temperature_c for p in own])) for bar, own in by_bar.items()}  # type: ignore[misc]
    odd = [
        p.id
        for bar, own in by_bar.items()
        for p in own
        if p.temperature_c is not None and abs(p.temperature_c - middle[bar]) > _TEMPERATURE_RANGE_K
    ]
    found = temperature_findings(poses, bars)
    if odd:
        limit = {"limit_kelvin": _TEMPERATURE_RANGE_K}
        found.append(Finding("temperatures-differ", "warning", limit, tuple(odd), kind="one-bar"))
    if len(middle) > 1 and max(middle.values()) - min(middle.values()) > _TEMPERATURE_RANGE_K:
        readings = [Phrase("bar-at-celsius", {"bar": bar, "celsius": value}) for bar, value in middle.items()]
        by_kelvin = max(abs(bar.expansion_per_kelvin) for bar in bars.values())
        effect = 500.0 * by_kelvin * (max(middle.values()) - min(middle.values()))
        values = {"readings": readings, "effect_mm": effect}
        found.append(Finding("temperatures-differ", "warning", values, tuple(middle), kind="bars"))
    return found


def camera_doubts(consistency: Consistency) -> list[Finding]:
    """Findings on cameras that are no longer where the rig says, one for each."""
    found = []
    for camera in consistency.moved:
        rotation, translation = np.degrees(np.linalg.norm(camera.turn_rad)), np.linalg.norm(camera.shift_mm)
        values = {"degrees": rotation, "shift_mm": translation, "px": camera.move_px}
        found.append(Finding("camera-moved", "warning", values, (camera.id,), kind="since"))
    return found


@dataclass(frozen=True)
class _Mean:
    """A certified length's mean error in mm, its length, and the standard uncertainty of bar and scatter alone."""

    key: tuple[str, str, str]
    error_mm: float
    length_mm: float
    own_mm: float
    temperature_relative: float


def bar_doubts(measured: Sequence[MeasuredLength], bars: Mapping[str, Bar]) -> list[Finding]:
    """Findings on single lengths that contradict the others of their bar, and on bars that contradict one another."""
    means = _means(measured)
    found, doubtful = [], _doubtful(means)
    for mean in doubtful:
        bar, start, end = mean.key
        off, ratio = _alone(mean, means)
        values = {"first": start, "second": end, "off_mm": off, "times": abs(ratio)}
        found.append(Finding("length-doubtful", "warning", values, (bar,)))
    named = {mean.key[0] for mean in doubtful}
    return found + _between_bars([mean for mean in means if mean.key[0] not in named], bars)


def doubtful_lengths(measured: Sequence[MeasuredLength]) -> frozenset[tuple[str, str, str]]:
    """The certified lengths (bar and marks) that contradict the others of their bar: their own error, not the rig's."""
    return frozenset(mean.key for mean in _doubtful(_means(measured)))


def _doubtful(means: Sequence["_Mean"]) -> list["_Mean"]:
    """The worst length of each bar: a wrong length affects the others of a short list."""
    found: dict[str, _Mean] = {}
    for mean in sorted((m for m in means if _stands_alone(m, means)), key=lambda m: -abs(_alone(m, means)[1])):
        found.setdefault(mean.key[0], mean)
    return list(found.values())


def _means(measured: Sequence[MeasuredLength]) -> list[_Mean]:
    groups: dict[tuple[str, str, str], list[MeasuredLength]] = {}
    for m in measured:
        groups.setdefault(m.key, []).append(m)
    ratio = max(pooled_scatter(list(groups.values()))[0] or 1.0, 1.0)
    means = []
    for key, group in groups.items():
        noise = np.array([m.budget.noise_mm for m in group])
        weight = 1 / np.maximum(noise, 1e-9) ** 2
        scatter = ratio / np.sqrt(weight.sum())
        length = float(np.mean([m.reference_mm for m in group]))
        own = float(np.hypot(scatter, group[0].budget.certificate_mm))
        warm = float(np.mean([m.budget.temperature_mm for m in group])) / length
        error = float((weight * [m.error_mm for m in group]).sum() / weight.sum())
        means.append(_Mean(key, error, length, own, warm))
    return means


def _slope(means: Sequence[_Mean]) -> tuple[float, float]:
    """Error per length and its standard uncertainty, by scatter and certificates."""
    length, error, own = (np.array([getattr(m, name) for m in means]) for name in ("length_mm", "error_mm", "own_mm"))
    weight = length**2 / own**2
    return float((weight * error / length).sum() / weight.sum()), float(1 / np.sqrt(weight.sum()))


def _alone(mean: _Mean, means: Sequence[_Mean]) -> tuple[float, float]:
    """The deviation of a length from the slope of its bar's others: in mm and in standard deviations."""
    others = [m for m in means if m.key[0] == mean.key[0] and m.key != mean.key]
    slope, sd = _slope(others)
    off = mean.error_mm - slope * mean.length_mm
    return off, off / float(np.hypot(mean.own_mm, sd * mean.length_mm))


def _stands_alone(mean: _Mean, means: Sequence[_Mean]) -> bool:
    """Whether a length contradicts at least two others of its bar that agree with each other."""
    others = [m for m in means if m.key[0] == mean.key[0] and m.key != mean.key]
    if len(others) < 2 or abs(_alone(mean, means)[1]) <= _CONTRADICTION:
        return False
    return all(abs(_alone(m, others)[1]) <= _CONTRADICTION for m in others)


def _between_bars(means: Sequence[_Mean], bars: Mapping[str, Bar]) -> list[Finding]:
    slopes = {}
    for bar in dict.fromkeys(mean.key[0] for mean in means):
        own = [mean for mean in means if mean.key[0] == bar]
        slope, sd = _slope(own)
        slopes[bar] = slope, float(np.hypot(sd, own[0].temperature_relative))
    if len(slopes) < 2:
        return []
    names = sorted(slopes, key=lambda bar: slopes[bar][0])
    low, high = names[0], names[-1]
    apart = slopes[high][0] - slopes[low][0]
    if apart <= _CONTRADICTION * float(np.hypot(slopes[low][1], slopes[high][1])):
        return []
    suspect = max((low, high), key=lambda bar: abs(slopes[bar][0]))
    kelvin = apart / max(abs(bars[suspect].expansion_per_kelvin), 1e-7)
    values = {"first": low, "second": high, "ppm": 1e6 * apart, "mm": 500 * apart, "kelvin": kelvin}
    return [Finding("bars-disagree", "warning", values, (suspect,))]
