"""The page of each kind of step; imported when it is first needed, so that the window opens at once."""

import threading
from collections.abc import Callable

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.wizard_page import Page
from spherecal_gui.workflow import StepKind

loaded: list[StepKind] = []  # kinds of step whose pages are imported, of those that `load_pages` imports


def load_pages() -> None:
    """Import the later steps' pages in a thread of its own: the window would stand still for it, at each a little."""
    kinds: tuple[StepKind, ...] = ("placement", "scale", "calibrate", "results", "verify", "save")

    def load() -> None:
        for kind in kinds:
            page_class(kind)
            loaded.append(kind)

    threading.Thread(target=load, name="pages", daemon=True).start()


def page_class(kind: str) -> Callable[[Controller], Page]:
    """The page of a kind of step."""
    if kind == "connect":
        from spherecal_gui.pages.connect_page import ConnectPage as Made
    elif kind == "look":
        from spherecal_gui.pages.look_page import LookPage as Made
    elif kind == "placement":
        from spherecal_gui.pages.placement_page import PlacementPage as Made
    elif kind == "scale":
        from spherecal_gui.pages.bars_page import ScalePage as Made
    elif kind == "calibrate":
        from spherecal_gui.pages.calibrate_page import CalibratePage as Made
    elif kind == "results":
        from spherecal_gui.pages.results_page import ResultsPage as Made
    elif kind == "verify":
        from spherecal_gui.pages.verify_page import VerifyPage as Made
    elif kind == "measure":
        from spherecal_gui.pages.measure_page import MeasurePage as Made
    elif kind == "check":
        from spherecal_gui.pages.check_page import CheckPage as Made
    else:
        from spherecal_gui.pages.save_page import SavePage as Made
    return Made
