"""The page of each kind of step; imported when it is first needed, so that the window opens at once."""

from collections.abc import Callable

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.base import Page


def page_class(kind: str) -> Callable[[Controller], Page]:
    """The page of a kind of step."""
    if kind == "connect":
        from spherecal_gui.pages.connect import ConnectPage as Made
    elif kind == "look":
        from spherecal_gui.pages.look import LookPage as Made
    elif kind == "placement":
        from spherecal_gui.pages.placement import PlacementPage as Made
    elif kind == "scale":
        from spherecal_gui.pages.bars import ScalePage as Made
    elif kind == "calibrate":
        from spherecal_gui.pages.calibrate import CalibratePage as Made
    elif kind == "results":
        from spherecal_gui.pages.results import ResultsPage as Made
    elif kind == "verify":
        from spherecal_gui.pages.verify import VerifyPage as Made
    elif kind == "measure":
        from spherecal_gui.pages.measure import MeasurePage as Made
    elif kind == "check":
        from spherecal_gui.pages.check import CheckPage as Made
    else:
        from spherecal_gui.pages.save import SavePage as Made
    return Made
