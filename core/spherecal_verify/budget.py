"""The GUM budget of the test value of a certified length: contributions, effective degrees of freedom, k, Pareto."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import ndtri, stdtrit

from spherecal.base.messages.values import Phrase
from spherecal.data.session import Bar, BarLength
from spherecal.scale.bar_temperature import expansion_kelvin, temperature_sd
from spherecal_verify.limit import OfLength
from spherecal_verify.uncertainty import COVERAGE
from spherecal_verify.verification import MeasuredLength

# Below this k no certificate means Student's t: 2.0 and 1.96 are the normal distribution's.
_NORMAL_FACTOR = 2.05
_AS_GOOD_AS_EXACT = 1e6  # degrees of freedom
# Of conformance and of nonconformance alike: the default of ISO 14253-1:2017.
CONFORMANCE = 0.95
_REMEDY = {
    "certificate": Phrase("remedy-certificate"),
    "thermometer": Phrase("remedy-thermometer"),
    "expansion": Phrase("remedy-expansion"),
    "centring": Phrase("remedy-centring"),
    "resolution": Phrase("remedy-resolution"),
}


@dataclass(frozen=True)
class Contribution:
    """A contribution: name, GUM type, standard uncertainty, degrees of freedom (inf: exact), share of the variance."""

    name: str
    evaluation: Literal["A", "B"]
    distribution: str
    standard_mm: float
    freedom: float = math.inf
    share: float = 0.0


@dataclass(frozen=True)
class Budget(OfLength):
    """The test value's uncertainty of one certified length (ISO 14253-5, 95.45 %), mm; effective degrees of freedom."""

    contributions: tuple[Contribution, ...]
    combined_mm: float
    coverage_factor: float
    expanded_mm: float
    freedom: float = math.inf

    def guard_mm(self, n: int = 1) -> float:
        """By how much n errors must all be within (n = 1), or one of n beyond its limit (Bonferroni), with 95 %."""
        level = 1 - (1 - CONFORMANCE) / n
        return self.combined_mm * float(stdtrit(self.freedom, level) if math.isfinite(self.freedom) else ndtri(level))

    def shares(self) -> list[tuple[str, float]]:
        """The Pareto: contributions that count with their share of the variance, largest first."""
        return sorted([(c.name, c.share) for c in self.contributions if c.share > 0], key=lambda one: -one[1])

    def remedy(self) -> Phrase | None:
        """The first step to a smaller uncertainty; None if there is none."""
        shares = self.shares()
        return _REMEDY.get(shares[0][0]) if shares else None


def length_budgets(
    measured: Sequence[MeasuredLength], bars: Mapping[str, Bar], noise_share: float
) -> tuple[Budget, ...]:
    """The test value's uncertainty (ISO 14253-5) of each length: bar, temperature, marks, and not the tested rig."""
    groups: dict[tuple[str, str, str], list[MeasuredLength]] = {}
    for m in measured:
        groups.setdefault(m.key, []).append(m)
    return tuple(_budget(group, bars[group[0].bar], noise_share) for group in groups.values())


def pooled_scatter(groups: Sequence[Sequence[MeasuredLength]]) -> tuple[float | None, int]:
    """Scatter about each length's mean over the image noise's standard uncertainty, and its degrees of freedom."""
    squares, freedom = 0.0, 0
    for group in groups:
        if len(group) < 2 or any(m.budget.noise_mm <= 0 for m in group):
            continue
        errors = np.array([m.error_mm for m in group])
        weight = np.array([m.budget.noise_mm for m in group]) ** -2.0
        squares += float((weight * (errors - weight @ errors / weight.sum()) ** 2).sum())
        freedom += len(group) - 1
    return (math.sqrt(squares / freedom), freedom) if freedom else (None, 0)


def _budget(group: Sequence[MeasuredLength], bar: Bar, noise_share: float) -> Budget:
    first = group[0]
    certified = next(x for x in bar.lengths if (x.from_mark, x.to_mark) == (first.from_mark, first.to_mark))
    marks = noise_share * math.sqrt(float(np.mean([m.budget.noise_mm**2 for m in group])))
    # by the thermometer and by the expansion coefficient
    by_kelvin = certified.length_mm * abs(bar.expansion_per_kelvin)
    warmer = [0.0 if m.temperature_c is None else m.temperature_c - bar.reference_temperature_c for m in group]
    sd_k = [temperature_sd(m.temperature_c) for m in group]
    squares = [expansion_kelvin(bar, w, sd) ** 2 for w, sd in zip(warmer, sd_k, strict=True)]
    thermometer = by_kelvin * math.sqrt(float(np.mean(np.square(sd_k))))
    expansion = by_kelvin * math.sqrt(float(np.mean(squares)))
    stated, k = certified.expanded_uncertainty_mm / certified.coverage_factor, certified.coverage_factor
    contributions = (
        Contribution("certificate", "B", "normal", stated, certificate_freedom(k)),
        Contribution("thermometer", "B", "rectangular", thermometer),
        Contribution("expansion", "B", "rectangular", expansion),
        Contribution("centring", "B", "normal", marks),
        Contribution("resolution", "B", "rectangular", resolution_mm(certified) / math.sqrt(12)),
    )
    return combine(first.key, contributions)


def combine(key: tuple[str, str, str], contributions: Sequence[Contribution]) -> Budget:
    """The budget of independent contributions: Welch-Satterthwaite's degrees of freedom, Student's k for 95.45 %."""
    combined = math.sqrt(math.fsum(c.standard_mm**2 for c in contributions))
    spread = math.fsum(c.standard_mm**4 / c.freedom for c in contributions)
    # k for a million degrees of freedom and for infinitely many agree to 2 in a million
    freedom = combined**4 / spread if spread * _AS_GOOD_AS_EXACT > combined**4 else math.inf
    factor = float(stdtrit(freedom, (1 + COVERAGE) / 2)) if math.isfinite(freedom) else float(ndtri((1 + COVERAGE) / 2))
    total = combined**2 or math.inf
    shared = tuple(replace(c, share=c.standard_mm**2 / total) for c in contributions)
    return Budget(*key, shared, combined, factor, factor * combined, freedom)


def certificate_freedom(coverage_factor: float) -> float:
    """The degrees of freedom for which Student's factor for 95.45 % is the certificate's k; infinite up to k = 2.05."""
    if coverage_factor <= _NORMAL_FACTOR:
        return math.inf
    at_one = float(stdtrit(1.0, (1 + COVERAGE) / 2))
    if coverage_factor >= at_one:
        return 1.0
    from scipy.optimize import brentq  # not with every result that is read

    return float(brentq(lambda freedom: stdtrit(freedom, (1 + COVERAGE) / 2) - coverage_factor, 1.0, 1e4))  # type: ignore[arg-type]


def resolution_mm(certified: BarLength) -> float:
    """The last digit in mm in which a certificate states a length: that of its length or uncertainty, the finer one."""
    if certified.expanded_uncertainty_mm == 0:
        return 0.0
    both = certified.length_mm, certified.expanded_uncertainty_mm  # a trailing zero in the file is lost
    return 10.0 ** -max(len(f"{value:.12f}".rstrip("0").partition(".")[2]) for value in both)
