"""The limits in use: read when the window is made, taken over when the responsible person changes them."""

from spherecal_rigs.limits_file import Limits

_now = [Limits()]


def now() -> Limits:
    """The limits in use."""
    return _now[0]


def use(limits: Limits) -> None:
    """These hold from now on."""
    _now[0] = limits
