"""The procedure of a verification after VDI/VDE 2634-1 (reduced): budgets, decision, departures."""

from dataclasses import dataclass

from spherecal.base.messages.values import Phrase
from spherecal.data.session import Bar
from spherecal.verify.budget import Budget
from spherecal.verify.limit import Acceptance


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
