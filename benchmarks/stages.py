"""Where the adjustment's time goes: its inner stages timed from outside."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

from spherecal.adjust import levenberg
from spherecal.adjust.problem import Layout

_ENGINE = {
    "linear_model": "linearise",
    "reduce": "reduce",
    "back_substitute": "back_substitute",
    "residuals": "residuals",
}
# where the minimiser finds its other helpers, and what the table calls them
_OTHERS: dict[str, tuple[Any, str]] = {
    "fold_matrix": (Layout, "fold"),
    "fold_vector": (Layout, "fold"),
    "cho_factor": (levenberg, "factorise"),
    "cho_solve": (levenberg, "solve"),
    "moved": (levenberg, "move"),
}
STAGES = (*_ENGINE.values(), "fold", "factorise", "solve", "move")


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

    load = levenberg.load_engine

    def load_timed(name: levenberg.Engine) -> Any:
        engine = load(name)
        return SimpleNamespace(**{name: timed(stage, getattr(engine, name)) for name, stage in _ENGINE.items()})

    saved = [(place, name, getattr(place, name)) for name, (place, _) in _OTHERS.items() if hasattr(place, name)]
    levenberg.load_engine = load_timed
    for place, name, function in saved:
        setattr(place, name, timed(_OTHERS[name][1], function))
    try:
        yield seconds
    finally:
        levenberg.load_engine = load
        for place, name, function in saved:
            setattr(place, name, function)
