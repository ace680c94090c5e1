"""The adjustment from outside: where its time goes, and what it is without fields and motions."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from spherecal.adjust import corrections, engine, least_squares, levenberg
from spherecal.adjust.parameter_layout import Layout

# where the minimiser finds its helpers, and what the table calls them
_HELPERS: dict[str, tuple[Any, str]] = {
    "linear_model": (engine, "linearise"),
    "reduce": (engine, "reduce"),
    "back_substitute": (engine, "back_substitute"),
    "residuals": (engine, "residuals"),
    "fold_matrix": (Layout, "fold"),
    "fold_vector": (Layout, "fold"),
    "cho_factor": (levenberg, "factorise"),
    "cho_solve": (levenberg, "solve"),
    "moved": (least_squares, "move"),
}
STAGES = tuple(dict.fromkeys(stage for _, stage in _HELPERS.values()))


@contextmanager
def timed_stages() -> Iterator[dict[str, float]]:
    """Within, every stage of the minimiser adds its seconds to the dictionary."""
    seconds = dict.fromkeys(STAGES, 0.0)

    def timed(stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            begin = time.perf_counter()
            try:
                return function(*arguments, **named)
            finally:
                seconds[stage] += time.perf_counter() - begin

        return call

    saved = [(place, name, getattr(place, name)) for name, (place, _) in _HELPERS.items() if hasattr(place, name)]
    for place, name, function in saved:
        setattr(place, name, timed(_HELPERS[name][1], function))
    try:
        yield seconds
    finally:
        for place, name, function in saved:
            setattr(place, name, function)


@contextmanager
def without_effects() -> Iterator[None]:
    """Within, calibrations know neither fields of lenses nor motions of images: the plain adjustment."""
    saved = corrections._may_have_effects
    corrections._may_have_effects = lambda network, adjusted: False
    try:
        yield
    finally:
        corrections._may_have_effects = saved
