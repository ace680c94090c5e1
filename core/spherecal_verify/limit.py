"""The user's limit of length errors, E = A + L/K, and the decision against it after ISO 14253-1:2017."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase

if TYPE_CHECKING:  # a limit alone is read before the window is shown
    from spherecal_verify.budget import Budget
    from spherecal_verify.verification import MeasuredLength

Conformity = Literal["pass", "fail", "cannot tell"]

_NUMBER = r"([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)"
_LIMIT = re.compile(rf"{_NUMBER}(mm|um|µm)?(?:\+L/{_NUMBER})?")
RULE = (
    "ISO 14253-1:2017, default rule (95 %), test value uncertainty u after ISO 14253-5:2015 (bar, temperature, marks; "
    "not the rig): pass where |E| + 1.65 u <= limit for every measured length, fail where |E| - k u > limit for one, "
    "with k for all lengths together, cannot tell between"
)


@dataclass(frozen=True)
class OfLength:
    """What is said of one certified length."""

    bar: str
    from_mark: str
    to_mark: str

    @property
    def key(self) -> tuple[str, str, str]:
        """Bar and marks."""
        return self.bar, self.from_mark, self.to_mark


@dataclass(frozen=True)
class LengthLimit:
    """The largest permissible |E| of a length L: `constant_mm` + L / `divisor`; divisor None: the constant alone."""

    constant_mm: float
    divisor: float | None = None

    def at(self, length_mm: float) -> float:
        """The limit in mm of a length in mm."""
        return self.constant_mm + (0.0 if self.divisor is None else length_mm / self.divisor)

    def words(self) -> str:
        """The limit as a formula: `E = 0.03 mm + L/20000`."""
        tail = "" if self.divisor is None else f" + L/{self.divisor:g}"
        return f"E = {self.constant_mm:g} mm{tail}"


def parse_limit(text: str) -> LengthLimit:
    """The limit in a text such as `0.03+L/20000` (millimetres) or `30um + L/20000`."""
    found = _LIMIT.fullmatch(text.replace(" ", ""))
    if found is not None:
        constant = float(found[1]) * (1.0 if found[2] in (None, "mm") else 1e-3)
        divisor = None if found[3] is None else float(found[3])
        sensible = constant < 1e6 and (constant > 0 if divisor is None else 1.0 <= divisor < 1e12)
        if sensible:
            return LengthLimit(constant, divisor)
    raise InputError(Phrase("error-no-limit", {"text": text[:60]}), Phrase("error-limit-form"))


@dataclass(frozen=True)
class LengthConformity(OfLength):
    """One certified length against the limit: the pose with the largest |E|, the limit there, U of the test value."""

    worst_pose: str
    worst_error_mm: float
    limit_mm: float
    expanded_uncertainty_mm: float
    verdict: Conformity


@dataclass(frozen=True)
class Acceptance:
    """The decision of all lengths (None: nothing to compare) and each; `doubts`: codes that made it "cannot tell"."""

    limit: LengthLimit
    verdict: Conformity | None
    lengths: tuple[LengthConformity, ...]
    doubts: tuple[str, ...] = ()


def judge_against(
    limit: LengthLimit, measured: "Sequence[MeasuredLength]", budgets: "Sequence[Budget]", comparable: bool
) -> Acceptance:
    """Whether all measured errors keep the limit, with a guard band on either side: ISO 14253-1 (see RULE)."""
    rows, n = [], len(measured)
    for budget in budgets if comparable else ():
        own = [m for m in measured if m.key == budget.key]
        if not own:
            continue
        verdicts: list[Conformity] = [_verdict(m, limit, budget.guard_mm(), budget.guard_mm(n)) for m in own]
        # the pose that comes nearest to its limit or exceeds it most
        worst = max(own, key=lambda m: abs(m.error_mm) - limit.at(m.reference_mm))
        most, verdict = limit.at(worst.reference_mm), _overall(verdicts)
        rows.append(LengthConformity(*budget.key, worst.pose, worst.error_mm, most, budget.expanded_mm, verdict))
    return Acceptance(limit, _overall([row.verdict for row in rows]) if rows else None, tuple(rows))


def with_doubts(
    acceptance: Acceptance, doubts: tuple[str, ...], doubtful: Collection[tuple[str, str, str]]
) -> Acceptance:
    """The decision in doubt: no pass, and no fail (which a camera that moved leaves) only by contradicting lengths."""
    if acceptance.verdict == "pass" and doubts:
        return replace(acceptance, verdict="cannot tell", doubts=doubts)
    failed = [(x.bar, x.from_mark, x.to_mark) for x in acceptance.lengths if x.verdict == "fail"]
    if failed and set(failed) <= set(doubtful) and "camera-moved" not in doubts:
        return replace(acceptance, verdict="cannot tell", doubts=doubts)
    return acceptance


def _verdict(m: "MeasuredLength", limit: LengthLimit, within_mm: float, beyond_mm: float) -> Conformity:
    size, most = abs(m.error_mm), limit.at(m.reference_mm)
    if size + within_mm <= most:
        return "pass"
    return "fail" if size - beyond_mm > most else "cannot tell"


def _overall(verdicts: Sequence[Conformity]) -> Conformity:
    return "fail" if "fail" in verdicts else "cannot tell" if "cannot tell" in verdicts else "pass"
