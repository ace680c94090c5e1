"""Methods other than the ball's, such as boards and bars: found by their entry points when one is asked for."""

from collections.abc import Callable
from typing import get_args

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.plugins import METHODS, load
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.steps.settings import CalibrationSettings, Method

# Methods that start from view graph and ball.
OF_THE_BALL = ("auto", "tao2021", "free", "soft", "rigid")

OtherMethod = Callable[[Session, CalibrationSettings, Context], Calibration]


def method_of(session: Session, asked: Method) -> Method:
    """The method asked for; `auto` takes the board of a session that has nothing of a ball."""
    of_ball = session.target_set is not None or session.sphere_diameter_mm is not None
    return "board" if asked == "auto" and session.board is not None and not of_ball else asked


def other_method(name: str) -> OtherMethod | None:
    """What calibrates a session by a method of this name; None for the ball's own."""
    if name in OF_THE_BALL:
        return None
    if (method := load(METHODS, name)) is None:
        raise InputError(Phrase("error-no-method", {"name": name, "names": list(get_args(Method))}))
    return method
