"""Do a verification's errors agree with the uncertainty that the rig states: each, and all together.

A rig with wrong fixed lenses had 25 errors within 3.5 u each and a chi-square of 86 (99.9 %: 52.6). Their covariance
holds what they share: cameras, scale, marks of a pose, a length's certificate, thermometer, a bar's expansion.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import chdtri, fdtri, ndtri, stdtrit

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Bar
from spherecal.scale.bar_temperature import expansion_kelvin, temperature_sd
from spherecal_verify.budget import certificate_freedom
from spherecal_verify.uncertainty import COVERAGE, PointErrors
from spherecal_verify.verification import Decision, MeasuredLength

# INCONSISTENT turns a technician away (exit code 3): a right rig may be called so once in 100 times, by both tests
# together. The test of all errors needs the whole covariance to be right, so that it has the smaller share.
EACH_FALSE_ALARM, TOGETHER_FALSE_ALARM = 0.009, 0.001
# How well a mark sits on the bar's line, relative to the length (0.5 um on 500 mm), as in scale/bar_scale.py.
_LEAST_OWN = 1e-6


def decide(
    measured: Sequence[MeasuredLength],
    bars: Mapping[str, Bar],
    errors: PointErrors | None,
    scale_relative: float,
    comparable: bool,
) -> Decision:
    """Whether errors agree: each by Student's k for all (Bonferroni), together by chi-square; else "no data".

    Lengths whose own uncertainty is not stated decide nothing.
    """
    measured = [m for m in measured if m.certified]
    if not measured or not comparable:
        return Decision(Phrase("decision-nothing"), "no data", None, ())
    n = len(measured)
    freedom = np.array([_freedom(m, bars[m.bar]) for m in measured])
    factor = np.array([_two_sided(EACH_FALSE_ALARM / n, one) for one in freedom])
    ratio = np.array([abs(m.error_mm) / m.budget.combined_mm for m in measured])
    exceeding = tuple(
        (m.pose, m.from_mark, m.to_mark) for m, beyond in zip(measured, ratio > factor, strict=True) if beyond
    )
    k, values = float(factor.max()), {"n": n, "k": float(factor.max()), "most": float(ratio.max())}
    chi, limit = None, None
    rule = Phrase("decision-each", values)
    if errors is not None and all(m.by_point is not None for m in measured):
        chi = chi_square(measured, bars, errors, scale_relative)
        limit = _most_chi_square(n, float(freedom.min()))
        rule = Phrase("decision-together", values | {"chi": chi, "chi_limit": limit})
    wrong = bool(exceeding) or (chi is not None and limit is not None and chi > limit)
    return Decision(rule, "inconsistent" if wrong else "consistent", k, exceeding, (), chi, limit)


def _freedom(m: MeasuredLength, bar: Bar) -> float:
    """Effective degrees of freedom of one error's uncertainty (Welch-Satterthwaite): only a certificate has few."""
    certified = next(x for x in bar.lengths if (x.from_mark, x.to_mark) == (m.from_mark, m.to_mark))
    own = certificate_freedom(certified.coverage_factor)
    part = m.budget.certificate_mm
    return np.inf if not np.isfinite(own) or part == 0 else own * (m.budget.combined_mm / part) ** 4


def _two_sided(false_alarm: float, freedom: float) -> float:
    level = 1 - false_alarm / 2
    return float(stdtrit(freedom, level)) if freedom < 1e6 else float(ndtri(level))


def _most_chi_square(n: int, freedom: float) -> float:
    """The chi-square that a right rig exceeds once in 1000; Hotelling's where a variance has few degrees of freedom."""
    if freedom < 1e6:
        return n * float(fdtri(n, freedom, 1 - TOGETHER_FALSE_ALARM))
    return float(chdtri(n, TOGETHER_FALSE_ALARM))


def chi_square(
    measured: Sequence[MeasuredLength], bars: Mapping[str, Bar], errors: PointErrors, scale_relative: float
) -> float:
    """All errors together in units of their covariance; with nothing or everything in common within a laboratory."""
    error = np.array([m.error_mm for m in measured])
    return min(
        float(error @ np.linalg.solve(error_covariance(measured, bars, errors, scale_relative, shared), error))
        for shared in (False, True)
    )


def mean_uncertainty(
    measured: Sequence[MeasuredLength], bars: Mapping[str, Bar], errors: PointErrors, scale_relative: float
) -> float | None:
    """The expanded uncertainty of the mean of all errors in mm, certificates of one laboratory being added as alike."""
    known = [m for m in measured if m.by_point is not None and m.certified]
    if not known or len(known) < len(measured):
        return None
    total = error_covariance(known, bars, errors, scale_relative, True).sum() / len(known) ** 2
    return _two_sided(1 - COVERAGE, np.inf) * float(np.sqrt(total))


def error_covariance(
    measured: Sequence[MeasuredLength],
    bars: Mapping[str, Bar],
    errors: PointErrors,
    scale_relative: float,
    one_laboratory: bool,
) -> FloatArray:
    """The covariance (n, n) mm^2 of errors, `one_laboratory`: certificates of one laboratory err alike."""
    length = np.array([m.reference_mm for m in measured])
    found = _by_noise(measured, errors) + np.diag((_LEAST_OWN * length) ** 2)
    gradient = np.stack([m.by_cameras for m in measured if m.by_cameras is not None])
    found += gradient @ errors.cameras @ gradient.T
    if not errors.with_scale:
        found += np.outer(length, length) * scale_relative**2
    certificate = np.array([m.budget.certificate_mm for m in measured])
    laboratory = [_laboratory(bars[m.bar]) if one_laboratory else m.key for m in measured]
    found += np.outer(certificate, certificate) * _same(laboratory)
    known = [m.temperature_c is not None for m in measured]
    by_kelvin = np.array([m.reference_mm * abs(bars[m.bar].expansion_per_kelvin) for m in measured])
    thermometer = by_kelvin * [temperature_sd(m.temperature_c) for m in measured]
    found += np.outer(thermometer, thermometer) * _same(known)
    expansion = by_kelvin * [_expansion_kelvin(m, bars[m.bar]) for m in measured]
    return found + np.outer(expansion, expansion) * _same([m.bar for m in measured])


def _by_noise(measured: Sequence[MeasuredLength], errors: PointErrors) -> FloatArray:
    """What the image noise of common points adds (n, n)."""
    by_feature: dict[int, list[tuple[int, FloatArray]]] = {}
    for i, m in enumerate(measured):
        assert m.features is not None and m.by_point is not None
        for feature, row in zip(m.features.tolist(), m.by_point, strict=True):
            by_feature.setdefault(feature, []).append((i, row))
    found = np.zeros((len(measured), len(measured)))
    for feature, rows in by_feature.items():
        index, gradient = np.array([i for i, _ in rows]), np.stack([row for _, row in rows])
        np.add.at(found, (index[:, None], index), gradient @ errors.covariance[feature] @ gradient.T)
    return found


def _laboratory(bar: Bar) -> str:
    """Who certified a bar; bars of which that is not known may all come from one."""
    return "" if bar.certificate is None else bar.certificate.laboratory.casefold().strip()


def _same(names: Sequence[object]) -> BoolArray:
    number = np.unique([str(name) for name in names], return_inverse=True)[1].reshape(-1)
    return number[:, None] == number


def _expansion_kelvin(m: MeasuredLength, bar: Bar) -> float:
    warmer = 0.0 if m.temperature_c is None else m.temperature_c - bar.reference_temperature_c
    return expansion_kelvin(bar, warmer, temperature_sd(m.temperature_c))
