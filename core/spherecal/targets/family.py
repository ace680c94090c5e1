"""The target family dots8: eight dots on a square sticker, five the same on all of them and three that carry the id.

Places are those of the 28 mm sticker, x right and y down as printed (docs/conventions.md); other sizes scale. The
template lets a decoder start from one dot: D divides the diagonal A-E at 5/8 and the middle of B-C is on it at 3/4.
It has no other symmetry than that about A-E. A target seen in a mirror therefore shows the template with another code,
which is that of another target for 18 of 100 (benchmarks/studies/detection.md). One image does not distinguish them
from real ones. An adjusted network does, as its targets come out inside out (finding "mirrored").
"""

import json
from functools import cache

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import resource_path
from spherecal.targets.target_set import Polarity, TargetSet

FAMILY = "dots8"
SIZE_MM = 28.0
DOT_DIAMETER_MM = 3.0
LATTICE_MM = 2.5
CODE_COUNT = 344

TEMPLATE_DOTS: tuple[str, ...] = ("A", "B", "C", "D", "E")
CODE_DOTS: tuple[str, ...] = ("M1", "M2", "M3")
DOTS: tuple[str, ...] = TEMPLATE_DOTS + CODE_DOTS
TEMPLATE_MM = np.array([[-10.0, 10.0], [0.0, -10.0], [10.0, 0.0], [2.5, -2.5], [10.0, -10.0]])


@cache
def _code_book() -> FloatArray:
    table = json.loads(resource_path("target_sets", "dots8.json").read_text(encoding="utf-8"))
    return np.array(table["codes"], dtype=float) * table["lattice_mm"]


def code_book() -> FloatArray:
    """Places of M1 M2 M3, row by row from the left, for ids 1, 2, ..., (344, 3, 2) mm (made by code_book.py)."""
    return _code_book().copy()


def make_target_set(
    count: int = 200, size_mm: float = SIZE_MM, polarity: Polarity = "light-on-dark", start_id: int = 1
) -> TargetSet:
    """The targets with ids start_id .. start_id + count - 1 of family dots8."""
    last_id = start_id + count - 1
    if count < 1 or start_id < 1 or last_id > CODE_COUNT:
        values = {"family": FAMILY, "most": CODE_COUNT, "first": start_id, "last": last_id}
        raise InputError(Phrase("error-family-ids", values))
    if not size_mm > 0:
        raise InputError(Phrase("error-target-width", {"size": size_mm}))
    scale = size_mm / SIZE_MM
    codes = code_book()
    layouts = {
        target: dict(zip(DOTS, scale * np.vstack([TEMPLATE_MM, codes[target - 1]]), strict=True))
        for target in range(start_id, last_id + 1)
    }
    return TargetSet(FAMILY, polarity, size_mm, scale * DOT_DIAMETER_MM, layouts)
