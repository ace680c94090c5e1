"""What `verify` and `check` say of wrong rigs: a check bar and one more placement, recorded by the true rig."""

from dataclasses import dataclass

import numpy as np

from benchmarks.studies.judged import BEYOND_U, Judged, TooLong, processor_limit
from benchmarks.studies.mischief_case import Case
from spherecal.base.errors import SpherecalError
from spherecal_rigs.check_rig import check
from spherecal_verify.limit import LengthLimit
from spherecal_verify.verify_bars import VerifySettings, verify

LIMIT_MM = 0.2
_POSES = 10
# A camera whose rays miss by more is no use, whatever lengths the others measure.
_MISS_MM = 1.0
_LIMIT_S = 60.0


@dataclass(frozen=True)
class Said:
    """What was said: `acceptance` against the limit, `decision` without one, `checked` of one more placement."""

    bad: bool
    acceptance: str
    decision: str
    checked: str

    @property
    def passed(self) -> bool:
        """Whether a bad rig passed."""
        return self.bad and self.acceptance == "pass"

    @property
    def ok(self) -> bool:
        """Whether a bad rig was found to be as it was calibrated: nothing has moved since, so check may say so."""
        return self.bad and self.checked == "ok"


def bad(judged: Judged) -> bool:
    """Whether the rig is useless: a length beyond the limit or a camera whose rays miss, either beyond 3 U."""
    lengths = (np.abs(judged.lengths_mm) > LIMIT_MM) & ~(judged.lengths_over_u <= BEYOND_U)
    return bool(lengths.any()) or any(c.miss_mm > _MISS_MM and not c.over_u <= BEYOND_U for c in judged.cameras)


def said_of(case: Case, judged: Judged, rng: np.random.Generator) -> Said | None:
    """Verification and check of a result by the rig as it is; None where the rig cannot be recorded again."""
    rig, world = judged.rig, case.world
    if rig is None or world is None or not rig.cameras:
        return None
    session = world.verification(case.session, _POSES, rng)
    acceptance = decision = checked = "refused"
    try:
        with processor_limit(_LIMIT_S):
            found = verify(session, rig, None, VerifySettings(LengthLimit(LIMIT_MM)))
        decision = found.decision.verdict
        accepted = None if found.procedure is None else found.procedure.acceptance
        acceptance = "none" if accepted is None else str(accepted.verdict)
    except SpherecalError as error:
        acceptance = f"refused: {error.message[:60]}"
    except TooLong:
        acceptance = "no result"
    try:
        with processor_limit(_LIMIT_S):
            checked = check(world.one_more_placement(rng)[0], rig).verdict
    except SpherecalError as error:
        checked = f"refused: {error.message[:60]}"
    except TooLong:
        checked = "no result"
    return Said(bad(judged), acceptance, decision, checked)
