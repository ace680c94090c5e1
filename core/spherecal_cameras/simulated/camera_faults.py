"""Faults of simulated cameras, by script or by hand."""

from dataclasses import dataclass
from typing import Literal, get_args

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase

FaultKind = Literal["lose", "delay", "drop", "blur", "dim", "bump"]
_USUAL: dict[str, float] = {"lose": 0.0, "delay": 2.0, "drop": 0.0, "blur": 3.0, "dim": 0.25, "bump": 0.5}


@dataclass(frozen=True)
class SimulatedFault:
    """What goes wrong with a simulated camera (its id or serial) from set `first_set` to `last_set` (None: for good).

    `lose`: it is unplugged. `delay`: its images come `amount` s late. `drop`: it ignores the first trigger of each set.
    `blur`: its lens is out of focus by `amount` px. `dim`: its images have `amount` times the light. `bump`: it is
    turned by `amount` degrees. `first_set` 0 includes the live view before the first set.
    """

    kind: FaultKind
    camera: str
    amount: float | None = None
    first_set: int = 0
    last_set: int | None = None

    @property
    def size(self) -> float:
        """The amount, or the usual one of its kind."""
        return _USUAL[self.kind] if self.amount is None else self.amount

    def active(self, number: int) -> bool:
        """Whether it is there in the set of this number."""
        return number >= self.first_set and (self.last_set is None or number <= self.last_set)


def parse_fault(text: str) -> SimulatedFault:
    """A fault written as KIND:CAMERA[:AMOUNT][@FIRST[-LAST]], such as `lose:C03@2-3`."""
    body, _, sets = text.partition("@")
    kind, _, rest = body.partition(":")
    camera, _, amount = rest.partition(":")
    first, dash, last = sets.partition("-")
    try:
        known = next((known for known in get_args(FaultKind) if known == kind), None)
        if known is None or not camera:
            raise ValueError
        until = int(last) if last else (None if dash or not sets else int(first))
        return SimulatedFault(known, camera, float(amount) if amount else None, int(first) if first else 0, until)
    except ValueError:
        raise InputError(Phrase("error-bad-fault", {"text": repr(text), "kinds": list(get_args(FaultKind))})) from None
