"""Arguments of the Python interface against their annotations: another kind is named with what is accepted."""

import contextlib
import functools
import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from spherecal.data.from_arrays import of_kind

P = ParamSpec("P")
R = TypeVar("R")

_KINDS: dict[Any, tuple[type, ...]] = {
    bool: (bool, np.bool_), int: (int, np.integer), float: (int, float, np.integer, np.floating),
    tuple: (tuple, list, np.ndarray), Literal: (str,),
}  # fmt: skip
_WORDS = {
    bool: "True or False", int: "a whole number", float: "a number", str: "a string", Mapping: "a dict",
    os.PathLike: "a path (a string or Path)", NoneType: "None", datetime: "a datetime",
}  # fmt: skip
_BY_NAME = {"image_size": "(width, height) in px, for all cameras or by camera"}
_FILES = {"Rig": "a rig.json or result folder", "Session": "its folder", "TargetSet": "a targets.json"}
_MADE_BY = {
    "BallProfile": "load_ball reads one", "Body": "load_body reads one", "Calibration": "calibrate_session gives one",
    "CalibrationSettings": "such as CalibrationSettings(method='rigid')", "Context": "such as Context(on_progress)",
    "LengthLimit": "also as '0.03+L/20000'", "RegisteredBar": "load_bars reads them", "Rig": "load_rig reads one",
    "Scale": "such as Scale('bar', bar='B1'); the ball's diameter is sphere_diameter_mm",
    "Session": "load_session reads one", "SimulationOptions": "such as SimulationOptions(targets=80)",
    "TargetSet": "load_targets reads one", "UserFrame": "load_frame reads one", "Verification": "verify_rig gives one",
}  # fmt: skip


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, with an InputError for arguments of another kind than it is annotated with."""
    signature = inspect.signature(function)
    hints: dict[str, Any] = {}

    @functools.wraps(function)
    def inner(*args: P.args, **kwargs: P.kwargs) -> R:
        hints.update({} if hints else get_type_hints(function))
        with contextlib.suppress(TypeError):  # Python says which argument is unknown
            for name, value in signature.bind_partial(*args, **kwargs).arguments.items():
                _check(name, value, hints[name])
        return function(*args, **kwargs)

    return inner


def _check(name: str, value: Any, hint: Any) -> None:
    members = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    origins = [get_origin(one) or one for one in members]
    if any(o in (object, np.ndarray, Any) or getattr(o, "_is_protocol", isinstance(o, TypeVar)) for o in origins):
        return  # isinstance cannot tell: left to the function
    said = " or ".join(map(_word, members)).replace("a string or a path", "a path")
    for made, place in _FILES.items():
        said = said.replace(f" ({_MADE_BY[made]}) or {_WORDS[os.PathLike]}", f", or the path of {place}")
    of_kind(name, value, tuple(kind for o in origins for kind in _KINDS.get(o, (o,))), _BY_NAME.get(name, said))
    for item in [get_args(one)[0] for one in members if get_origin(one) is Sequence and isinstance(value, Sequence)]:
        for each in value if isinstance(item, type) and item is not str else ():
            of_kind(f"Each item of {name}", each, item, _word(item))


def _word(hint: Any) -> str:
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin is Literal:
        return f"one of {', '.join(map(repr, args))}"
    if origin is tuple:
        return f"{len(args)} numbers"
    if origin in (Sequence, Iterable):
        return f"a list of {'strings' if args[0] is str else args[0].__name__}"
    name = origin.__name__
    made = f" ({_MADE_BY[name]})" if name in _MADE_BY else ""
    return _WORDS.get(origin) or f"{'' if name.endswith('s') else 'a '}{name}{made}"
