"""What all pages have in common; the page of each kind of step."""

import threading
from collections.abc import Callable, Mapping

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLabel, QWidget

from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import moved_text, reason_text
from spherecal_gui.project import Project
from spherecal_gui.standing import NEEDS_CAMERAS, Button, Deed, Part, Said, Standing, level_of, stand
from spherecal_gui.widgets.basic import set_level
from spherecal_gui.widgets.scene_view import SceneView
from spherecal_gui.workflow import Reason, Status, Step, StepKind, StepState


class Page(QWidget):
    """A page of the wizard."""

    action_changed = Signal()  # the buttons may be others
    finished = Signal()  # somebody leaves the project
    bench_wanted = Signal()  # somebody wants to describe the bench
    recording_wanted = Signal()  # ... or to choose another recorded session

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self.controller = controller
        self.step: Step | None = None
        self.alarmed = False  # a red message is on the screen
        self._standing: Standing | None = None
        self.headline: QLabel | None = None  # the label with the state of the page
        self.deeds: Mapping[Deed, Callable[[], object]] = {}  # how it does what its large button can do

    def enter(self, step: Step) -> None:
        """The page is shown for this step."""
        self.step = step
        self.refresh()

    def leave(self) -> None:
        """Another page is shown."""

    def refresh(self) -> None:
        """Something may have changed."""
        if self.project is not None:
            self.show_project()
            self.show_standing()
        self.action_changed.emit()

    def show_project(self) -> None:
        """Show the open project as it is."""

    def tick(self) -> None:
        """Called some ten times a second while the page is shown."""

    def dress(self) -> None:
        """The palette has changed."""
        for view in self.findChildren(SceneView):
            view.scene_changed()
        self.refresh()

    def close_page(self) -> None:
        """The program ends: let go of the 3-D views."""
        for view in self.findChildren(SceneView):
            view.close_view()

    def action(self) -> Button | None:
        """The large button; None for none."""
        return self.standing().said.button

    def act(self) -> None:
        """The large button was pressed."""
        action = self.action()
        if action is not None and action.enabled:
            own: dict[Deed, Callable[[], object]] = {"finish": self.finished.emit, **self.deeds}
            (self.controller.cancel if action.does == "cancel" else own[action.does])()

    def said(self) -> Said:
        """What the page's step says of itself; nothing where no step is shown."""
        return self.says() if self.project is not None and self.step is not None else Said("none", "")

    def says(self) -> Said:
        """What the step of the open project says (presenters/step_states.py)."""
        return Said("none", "")

    def show_standing(self) -> None:
        """Draw the headline; the window draws rail, chip and buttons from the same standing."""
        found = self.standing()
        if self.headline is not None:
            if self.headline.text() != found.text:
                self.headline.setText(found.text)
            set_level(self.headline, found.level)
        if found != self._standing:
            self._standing = found
            self.action_changed.emit()

    def standing(self) -> Standing:
        """The worst of the page's headline, its step's status and what is wrong elsewhere."""
        said, state, whole = self.said(), self.state, self.controller.state
        if state is None or whole is None:
            return Standing(said.level, said.text, said=said)
        if self.controller.gone:
            said = Said("none", "", stay=reason_text(state.reason))  # nothing can be done here
        after = whole.after(state.step.id)
        may_go_on = after is not None and after.open
        return stand(said, self._step_part(state), self._troubles(), may_go_on, self.alarmed)

    def _step_part(self, state: StepState) -> Part:
        """What the step's status says; one that is ready, or runs, says nothing."""
        if state.status in (Status.FAILED, Status.CARE, Status.STALE):
            return Part(level_of(state.status), reason_text(state.reason))
        return Part("none")

    def _troubles(self) -> tuple[Part, ...]:
        """Cameras that were moved or are lost, where that matters to the page."""
        running, kind = self.controller.running, self.step.kind if self.step is not None else "connect"
        found = []
        if running.moved and kind != "connect":
            found.append(Part("bad", moved_text(running.moved, kind in ("look", "placement"))))
        if running.lost and kind in NEEDS_CAMERAS:
            found.append(Part("bad", reason_text(Reason("cameras lost", running.lost, "connect"))))
        return tuple(found)

    @property
    def state(self) -> StepState | None:
        """The state of the page's step."""
        state = self.controller.state
        return state.of(self.step.id) if state is not None and self.step is not None else None

    @property
    def open_state(self) -> StepState:
        """The state of the page's step, for what is shown and done only while there is one."""
        assert self.state is not None
        return self.state

    @property
    def project(self) -> Project | None:
        """The open project; None where it was closed."""
        return self.controller.project

    @property
    def open_project(self) -> Project:
        """The open project, for what is shown and done only while there is one."""
        assert self.controller.project is not None
        return self.controller.project


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
        from spherecal_gui.pages.live_page import LookPage as Made
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
