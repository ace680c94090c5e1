"""Arguments of the Python interface against their annotations: another kind is named with what is accepted."""

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

_NUMBERS: dict[Any, tuple[type, ...]] = {
    float: (int, float, np.integer, np.floating),
    int: (int, np.integer),
    bool: (bool, np.bool_),
}
_WORDS = {
    bool: "True or False", int: "a whole number", float: "a number", str: "a string", Mapping: "a dict",
    os.PathLike: "a path (a string or Path)", NoneType: "None", datetime: "a datetime",
}  # fmt: skip
_BY_NAME = {"image_size": "(width, height) in px, for all cameras or by camera"}
_FILES = {
    "Rig": "a Rig, or the path of a rig.json or result folder",
    "Session": "a Session, or the path of its folder",
    "TargetSet": "a TargetSet, or the path of a targets.json",
}
_MADE_BY = {
    "BallProfile": "load_ball reads one", "Body": "load_body reads one", "Calibration": "calibrate_session gives one",
    "CalibrationSettings": "such as CalibrationSettings(method='rigid')", "Context": "such as Context(on_progress)",
    "LengthLimit": "also as '0.03+L/20000'", "RegisteredBar": "load_bars reads them", "Rig": "load_rig reads one",
    "Scale": "such as Scale('bar', bar='B1'); the ball's diameter is sphere_diameter_mm",
    "SimulationOptions": "such as SimulationOptions(targets=80)", "TargetSet": "load_targets reads one",
    "UserFrame": "load_frame reads one", "Verification": "verify_rig gives one",
}  # fmt: skip


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, with an InputError for arguments of another kind than it is annotated with."""
    signature = inspect.signature(function)
    hints: dict[str, Any] = {}

    @functools.wraps(function)
    def inner(*args: P.args, **kwargs: P.kwargs) -> R:
        hints.update({} if hints else get_type_hints(function))
        try:
            given = signature.bind_partial(*args, **kwargs).arguments
        except TypeError:
            return function(*args, **kwargs)  # Python says which argument is unknown
        for name, value in given.items():
            _check(name, value, hints[name])
        return function(*args, **kwargs)

    return inner


def _check(name: str, value: Any, hint: Any) -> None:
    members = _members(hint)
    if not all(_is_known(one) for one in members):
        return
    of_kind(name, value, tuple(kind for one in members for kind in _kinds(one)), _BY_NAME.get(name) or _wanted(members))
    for one in members:
        item = get_args(one)[0] if get_origin(one) is Sequence else str
        if isinstance(item, type) and item is not str and isinstance(value, Sequence):
            for each in value:
                of_kind(f"Each item of {name}", each, item, _word(item))


def _kinds(hint: Any) -> tuple[type, ...]:
    origin = get_origin(hint) or hint
    also: dict[Any, tuple[type, ...]] = {tuple: (tuple, list, np.ndarray), Literal: (str,), **_NUMBERS}
    return also.get(origin, (origin,))


def _members(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _is_known(hint: Any) -> bool:
    """Whether isinstance can tell: arrays, protocols and type variables are left to the function."""
    origin = get_origin(hint) or hint
    if origin is Literal:
        return True
    return (
        isinstance(origin, type) and origin not in (object, np.ndarray) and not getattr(origin, "_is_protocol", False)
    )


def _wanted(members: Sequence[Any]) -> str:
    """The kinds in words: "a Rig, or the path of a rig.json or result folder"."""
    origins = [get_origin(one) or one for one in members]
    paths = os.PathLike in origins
    said = []
    of_file = any(origin.__name__ in _FILES for origin in origins)
    for one, origin in zip(members, origins, strict=True):
        if not (paths and (origin is str or (origin is os.PathLike and of_file))):
            said.append(_FILES[origin.__name__] if paths and origin.__name__ in _FILES else _word(one))
    return " or ".join(said)


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
