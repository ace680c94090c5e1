"""The result of a verification: measured lengths with their uncertainty budgets, statistics and a decision."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from spherecal.base.arrays import ByValue, FloatArray, IntArray
from spherecal.base.messages.values import Phrase
from spherecal.base.notebook import html_table
from spherecal.data.findings import Finding
from spherecal_verify.limit import OfLength

if TYPE_CHECKING:
    from spherecal_verify.consistency import Consistency
    from spherecal_verify.departures import Procedure
    from spherecal_verify.participation import CameraViews

Verdict = Literal["consistent", "inconsistent", "no data"]


@dataclass(frozen=True)
class LengthBudget:
    """Standard uncertainties (k = 1) of one length's error in mm: image noise, cameras, scale, bar, temperature."""

    noise_mm: float
    calibration_mm: float
    scale_mm: float
    certificate_mm: float
    temperature_mm: float

    @property
    def combined_mm(self) -> float:
        """The combined standard uncertainty; the parts are independent."""
        return math.hypot(self.noise_mm, self.calibration_mm, self.scale_mm, self.certificate_mm, self.temperature_mm)


@dataclass(frozen=True)
class MeasuredLength:
    """One certified length in one pose; error = measured length - reference length at the pose's temperature.

    `certified`: the reference's uncertainty is stated; otherwise the error decides nothing. `views` counts the cameras
    of that mark which fewer of them see. `ends_mm` (2, 3) are the marks in the rig's world. `by_cameras` (c*w,) is how
    the length follows the cameras' parameters, `by_point` (k, 3) how it follows its points, `features` (k,).
    """

    bar: str
    pose: str
    from_mark: str
    to_mark: str
    length_mm: float
    reference_mm: float
    budget: LengthBudget
    views: int
    temperature_c: float | None = None
    ends_mm: FloatArray | None = field(default=None, compare=False)
    by_cameras: FloatArray | None = field(default=None, compare=False)
    certified: bool = True
    features: IntArray | None = field(default=None, compare=False)
    by_point: FloatArray | None = field(default=None, compare=False)

    @property
    def key(self) -> tuple[str, str, str]:
        """Bar and marks: the certified length."""
        return self.bar, self.from_mark, self.to_mark

    @property
    def error_mm(self) -> float:
        """Measured minus reference length; [Tao21] (21) has the opposite sign."""
        return self.length_mm - self.reference_mm


@dataclass(frozen=True)
class LengthStatistics(OfLength):
    """One certified length over all its poses; None is what a single pose or a file does not say.

    `expanded_uncertainty_mm` is that of the mean error (GUM, 95.45 %), `repeatability_mm` its type A part; `budget`
    holds the type B parts. A file's parts are not read.
    """

    n: int
    mean_error_mm: float | None
    sd_mm: float | None
    max_abs_error_mm: float | None
    expanded_uncertainty_mm: float | None
    coverage_factor: float | None
    repeatability_mm: float | None = None
    budget: LengthBudget | None = None


@dataclass(frozen=True)
class Overall:
    """All measured lengths together; None where there are too few.

    `expanded_uncertainty_mm` is that of the mean error, with what the lengths have in common.
    """

    n: int
    mean_error_mm: float | None
    sd_mm: float | None
    rms_error_mm: float | None
    max_abs_error_mm: float | None
    expanded_uncertainty_mm: float | None = None


@dataclass(frozen=True)
class Decision:
    """Whether the errors agree with their uncertainties; `exceeding` names the lengths (pose, from, to) that do not.

    `cameras` are those that contradict the others, which makes it inconsistent too. `chi_square` is that of all errors
    together with their covariance, on as many degrees of freedom as there are errors; at most `most_chi_square`.
    """

    rule: Phrase
    verdict: Verdict
    coverage_factor: float | None
    exceeding: tuple[tuple[str, str, str], ...]
    cameras: tuple[str, ...] = ()
    chi_square: float | None = None
    most_chi_square: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Verification(ByValue):
    """The result of verifying a rig with reference bars; `consistency` of its cameras by the bars' marks.

    `cameras`: what each camera of the rig saw of the marks.
    """

    measured: tuple[MeasuredLength, ...]
    lengths: tuple[LengthStatistics, ...]
    overall: Overall
    decision: Decision
    findings: tuple[Finding, ...]
    procedure: "Procedure | None" = None
    consistency: "Consistency | None" = None
    cameras: "tuple[CameraViews, ...]" = ()

    @property
    def failed(self) -> bool:
        """Whether the rig is shown to be wrong: exit code 3."""
        acceptance = None if self.procedure is None else self.procedure.acceptance
        return is_failed(self.decision.verdict, None if acceptance is None else acceptance.verdict, self.findings)

    def __repr__(self) -> str:
        said = "".join(f"; {f.severity}: {f.message}" for f in self.findings if f.severity != "info")
        most = self.overall.max_abs_error_mm
        errors = "" if most is None or self.decision.verdict == "no data" else f", largest error {most:.4g} mm"
        return f"<Verification: {self.decision.verdict}, {len(self.measured)} lengths{errors}{said}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: the verdict, and each length over its poses."""
        columns = {
            "bar": [s.bar for s in self.lengths],
            "length": [f"{s.from_mark}-{s.to_mark}" for s in self.lengths],
            "n": [s.n for s in self.lengths],
            "mean error mm": [s.mean_error_mm for s in self.lengths],
            "U mm": [s.expanded_uncertainty_mm for s in self.lengths],
            "largest error mm": [s.max_abs_error_mm for s in self.lengths],
        }
        return html_table(f"Verification: {self.decision.verdict.upper()}", columns)


def is_failed(agreement: str, conformity: str | None, findings: Iterable[Finding]) -> bool:
    """Whether a rig is shown to be wrong: by its stated uncertainties, by its limit, or by an error found."""
    return agreement == "inconsistent" or conformity == "fail" or any(f.severity == "error" for f in findings)
