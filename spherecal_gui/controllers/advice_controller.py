"""Advice for the next placement, worked out beside everything else, and where the ball is against it."""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import Signal

from spherecal_gui import limits_in_force as limits
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.coverage import SetDots
from spherecal_gui.languages import translate
from spherecal_gui.project import fingerprint
from spherecal_gui.rig_scenes import GuidanceView, without_balls
from spherecal_gui.tasks.placement_advice import plan_coarse, plan_next, survey
from spherecal_gui.tasks.task import Runner

if TYPE_CHECKING:  # ghosts and live images need scipy, for which the window does not wait
    from spherecal_gui.controllers.controller import Controller
    from spherecal_gui.tasks.ghost import Lying, ToGo
    from spherecal_gui.tasks.live_detection import Sight

_PATIENCE_MS = 3_000  # the engine looks five times a second whether it should stop
_CARRIED = 0.3  # of its radius: a ball as far from where it lay has been lifted
# Dots of a camera from which a first look at the rig is worth it, and the pause after one that gave nothing.
_LEAST_DOTS, _SURVEY_AGAIN_S = 40, 5.0
_KEPT = 8  # answers, for placements that are deleted and brought back


class AdviceController(ControllerPart):
    """Where the ball should be next; worked out while a placement is shown: other pages need the processors."""

    guidance_changed = Signal()  # there is other advice
    ball_seen = Signal()  # the ball was looked at again

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.planner, self.seer = Runner(self), Runner(self)
        self.lying: Lying | None = None  # where the ball is now
        self.guidance: GuidanceView | None = None
        self._known: GuidanceView | None = None
        self._surveyed_s = -_SURVEY_AGAIN_S
        self._planned_for: tuple[tuple[str, str], ...] | None = None
        self._asked: tuple[tuple[str, str], ...] | None = None
        self._answers: dict[object, GuidanceView] = {}
        main.changed.connect(self.plan_next)

    def close(self) -> None:
        """Stop what is worked out."""
        self.planner.abandon(_PATIENCE_MS)
        self.seer.abandon(_PATIENCE_MS)
        self.lying = None
        self.guidance, self._planned_for, self._known = None, None, None
        self._answers.clear()
        self.guidance_changed.emit()

    def plan_next(self) -> None:
        """Have the engine work out the next placement, beside everything else; the last question asked counts."""
        project, session, connection = self.project, self.main.recording.session, self.main.cameras.connection
        if project is None or session is None or connection is None or project.purpose != "calibrate":
            return
        if project.by_board or project.source.startswith("replay"):  # a recorded ball goes nowhere
            return
        if not self._is_wanted:
            if self.planner.running != "survey":
                self.planner.cancel()
            return
        known = self.main.recording.dots
        dots = {name: known[name] for name in project.placements if name in project.taken and name in known}
        masks = (("masks", fingerprint(project.masks)),) if dots else ()
        key = (*((name, project.taken[name]) for name in dots), *masks)
        if key == self._planned_for:
            return
        self.guidance, self._planned_for = self._answers.get(self._kept_as(key)), key
        self.planner.cancel()
        self.lying = None
        if dots and self.guidance is None and self.planner.running is None:
            self._asked = key
            self._ask(dots, coarse=True)
        self.guidance_changed.emit()

    @property
    def _is_wanted(self) -> bool:
        """Whether a placement is shown, the only page with advice."""
        return self.project is not None and self.project.step.startswith("placement:")

    @staticmethod
    def _kept_as(key: tuple[tuple[str, str], ...] | None) -> object:
        """What an answer depends on: the placements as they were captured, masks, and the limit of dots."""
        return key, limits.now().needed_dots

    def _ask(self, dots: Mapping[str, SetDots], coarse: bool) -> None:
        """Have the engine work it out: first coarsely, then well."""
        session, connection = self.main.recording.session, self.main.cameras.connection
        if session is None or connection is None:  # closed between the two answers, as by a full disk
            return
        document, target_set = session.document(), connection.plan.target_set
        work = plan_coarse if coarse else plan_next

        def done(found: GuidanceView | None) -> None:
            if coarse and not self._is_wanted:
                self._planned_for = None
            elif coarse and self._asked == self._planned_for:
                if found is not None:
                    self.guidance = found
                self._ask(dots, coarse=False)
                self.guidance_changed.emit()
            else:
                self._planned(found)

        def failed(error: BaseException) -> None:
            if not coarse:  # advice is a help, not a need
                self.main.note(translate("Log", "no advice for the next placement: {why}").format(why=error))
            done(None)

        self.planner.start(
            "guidance", lambda context: work(document, target_set, dots, context), done, failed, self._plan_again
        )

    @property
    def planning_s(self) -> float | None:
        """For how long it has been worked out; None where nothing is."""
        task = self.planner.task
        return time.perf_counter() - task.began_s if task is not None else None

    @property
    def known(self) -> GuidanceView | None:
        """The last that is known of rig and ball: by the placements, before the first one by what is in sight."""
        if self.guidance is not None and self.guidance.scene is not None:
            self._known = self.guidance
        return self._known

    def survey(self, sights: Mapping[str, "Sight"]) -> None:
        """Before the first placement: work out where cameras and ball are from the ball that lies in sight."""
        project, connection, now = self.project, self.main.cameras.connection, time.monotonic()
        dots = {name: sight.dots for name, sight in sights.items() if len(sight.dots) >= _LEAST_DOTS and sight.still}
        if project is None or connection is None or self.planner.running is not None:
            return
        new = set(dots) - set(self.known.cameras if self.known is not None else ())
        if project.by_board or project.taken or len(dots) < 2 or not new or now - self._surveyed_s < _SURVEY_AGAIN_S:
            return
        self._surveyed_s = now
        document, target_set = self.main.recording.outline(), connection.plan.target_set

        def done(found: GuidanceView | None) -> None:
            if found is not None and found.scene is not None and self.guidance is None:
                self._known = replace(found, scene=without_balls(found.scene))
            again()

        def failed(error: BaseException) -> None:
            self.main.note(f"survey: {error}")
            again()

        def again() -> None:
            self._plan_again()  # what was asked for meanwhile
            self.guidance_changed.emit()

        work = self.planner.start
        work("survey", lambda context: survey(document, target_set, dots, context), done, failed, again)

    def look_at_ball(self, sights: Mapping[str, "Sight"]) -> bool:
        """Work out where the ball is now against its ghost, beside the window; whether that was begun."""
        from spherecal_gui.tasks.ghost import lying_ball  # needs scipy

        known = self.known
        if known is None or known.ghost is None or self.seer.running is not None:
            return False
        ghost, dots = known.ghost, {name: sight.dots for name, sight in sights.items()}

        def seen(lying: "Lying | None") -> None:
            if self.known is known:
                self.lying = lying
                self.ball_seen.emit()

        def failed(error: BaseException) -> None:
            self.main.note(f"ball: {error}")

        return self.seer.start("ball", lambda _: lying_ball(ghost.lenses, ghost.body, dots), seen, failed)

    @property
    def to_go(self) -> "ToGo | None":
        """How far the ball still is from its ghost; None where either is not known."""
        from spherecal_gui.tasks.ghost import to_go  # needs scipy

        if self.guidance is None or self.guidance.ghost is None or self.lying is None:
            return None
        return to_go(self.guidance.ghost, self.lying)

    def _planned(self, found: GuidanceView | None) -> None:
        if self._asked != self._planned_for:
            self._plan_again()
            return
        found = self._kept_under_way(found)
        self.guidance = found
        if found is not None:
            self._answers[self._kept_as(self._asked)] = found
            while len(self._answers) > _KEPT:
                del self._answers[next(iter(self._answers))]
        self.guidance_changed.emit()

    def _kept_under_way(self, found: GuidanceView | None) -> GuidanceView | None:
        """The answer; where somebody already carries the ball to the first one, that place with the better figures."""
        first, to_go = self.guidance, self.to_go
        if found is None or first is None or first.ghost is None or self.lying is None or to_go is None:
            return found
        carried = float(np.linalg.norm(self.lying.centre - first.ghost.body.centre))
        if carried < _CARRIED * first.ghost.body.radius_mm:
            return found
        return replace(first, now_mm=found.now_mm, next_mm=None, coarse=False)

    def _plan_again(self) -> None:
        self._planned_for = None
        self.plan_next()
