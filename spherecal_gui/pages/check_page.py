"""Check: one placement against the calibration in use; OK, watch, or recalibrate."""

from pathlib import Path

from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout

from spherecal.base.errors import SpherecalError
from spherecal_gui import languages
from spherecal_gui import limits_in_force as limits
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.languages import reason_text, verdict_word
from spherecal_gui.pages.wizard_page import Page
from spherecal_gui.presenters.check_presenter import (
    check_cells,
    check_notes,
    check_verdict,
    repaired_text,
    repaired_verdict,
)
from spherecal_gui.presenters.results_presenter import VerdictText
from spherecal_gui.presenters.step_states import CheckFacts, check_says
from spherecal_gui.project import usable
from spherecal_gui.rig_scenes import check_scene, rig_scene
from spherecal_gui.standing import Level, Said
from spherecal_gui.widgets.basic import Card, add, button, enable, label, say
from spherecal_gui.widgets.scene_panel import ScenePanel, SceneSplit
from spherecal_gui.widgets.table import Table
from spherecal_gui.workflow import Status
from spherecal_rigs.check_rig import Check
from spherecal_rigs.store import open_profile


class CheckPage(Page):
    """The answer, and each camera's numbers."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.deeds = {"check": controller.checks.check, "use": controller.checks.use_repair}
        self.headline = self.word = label("", "huge")
        self.sentence = label("", "big")
        self.why_not = label("", level="caution", hidden=True)  # a tooltip is not seen from three metres
        headings = [
            self.tr("Camera"), self.tr("state"), self.tr("moved\npx"), self.tr("a point is off\nmm"),
            self.tr("shift\nmm"), self.tr("turn\ndeg"), self.tr("rms now\npx"), self.tr("rms then\npx"),
        ]  # fmt: skip
        self.table = Table(headings, sortable=False, spare=(7, 6, 5, 4, 2))
        self.panel = ScenePanel()
        self.panel.said.connect(self.controller.tell)
        # The profile's folder, and what was found.
        self._drawn: tuple[Path | None, Check | None] = (None, None)
        self.notes = Card()
        self.message = label("", "soft")
        self.notes.body.addWidget(self.message)
        head = add(QHBoxLayout(), (self.word, 1), 14, (self.sentence, 1))
        split = SceneSplit(self.panel, self.table, (540, 560))
        add(QVBoxLayout(self), head, self._mending(), self.why_not, (split, 1), self.notes)

    def _mending(self) -> QHBoxLayout:
        """What can be done where the rig is no longer as it was."""
        self.mended = label("", "big")
        self.repair = button(self.tr("Repair"), "repair-cameras", act=self.controller.checks.repair_cameras)
        self.repair.setToolTip(self.tr("Calibrates only the cameras that moved, from this placement; seconds."))
        self.use = button(self.tr("Put the repair to use"), "use-repair", act=self.controller.checks.use_repair)
        self.calibrate = button(self.tr("Calibrate the rig"), "calibrate-rig", act=self.controller.calibrate_like_this)
        self.again = button(self.tr("Check again"), "check-again", act=self.controller.checks.check)
        return add(QHBoxLayout(), (self.mended, 1), self.repair, self.use, self.calibrate, self.again)

    @property
    def _after(self) -> Check | None:
        """The check after a repair; None where nothing is repaired."""
        return self.controller.checks.after if self.open_project.repaired is not None else None

    @property
    def _in_use(self) -> bool:
        return self.open_state.status is Status.DONE

    def _verdict(self, found: Check) -> VerdictText:
        return check_verdict(found) if self._after is None else repaired_verdict(self._after, self._in_use)

    def _show_mending(self, there: bool) -> None:
        found, after, in_use = self.controller.checks.found, self._after, self._in_use
        idle, repaired_run = self.controller.runner.running is None, self.open_project.repaired
        moved = found.to_repair if there and found is not None else ()
        repaired = there and after is not None
        self.repair.setText(self.tr("Repair {cameras}").format(cameras=languages.listed(moved)))
        self.repair.setVisible(bool(moved) and not repaired)
        self.repair.setEnabled(idle)
        good = repaired_run is not None and usable(repaired_run.verdict)
        allowed = limits.now().unverified_use
        self.use.setVisible(repaired and not in_use and not (good and allowed))  # else the large button does it
        bad = self.tr("The repair is not valid: calibrate the rig.")
        forbidden = self.tr("No bar has verified it, and the limits forbid its use: calibrate the rig and verify it.")
        why = "" if good and allowed else bad if not good else forbidden
        enable(self.use, idle and not why, why)
        say(self.why_not, why if repaired and not in_use else "", "caution")
        done = repaired_text(found, after, in_use) if there and found is not None and after is not None else ("",)
        say(self.mended, *done, hides=False)

    def show_project(self) -> None:
        """Show what was found."""
        found, state = self.controller.checks.found, self.open_state
        there = found is not None and state.status is not Status.STALE
        self.table.setVisible(there)
        self.notes.setVisible(there)
        if not there:
            self._draw(None)
        self.sentence.setText("")
        checked = self.open_project.checked
        ill = checked is not None and checked.verdict != "ok"
        self.calibrate.setVisible(ill and not self.controller.runner.running)
        self._show_mending(there)
        self.again.setVisible("check-again" in self.said().also)
        if there and found is not None:
            self.sentence.setText(self._verdict(found).sentence)
            self._fill()
        elif checked is not None and state.status in (Status.DONE, Status.CARE, Status.FAILED):
            self.sentence.setText(self.tr("Check again to see the numbers."))
        elif self.controller.runner.running != "check":
            self.sentence.setText(reason_text(state.reason))
        self.sentence.setVisible(bool(self.sentence.text()))  # else the headline has half of the page

    def _fill(self) -> None:
        found = self.controller.checks.after or self.controller.checks.found
        if found is None:
            return
        self.table.fill(check_cells(found))
        self._draw(found)
        self.message.setText("\n".join(check_notes(found)))

    def _draw(self, found: Check | None) -> None:
        """The rig as it was calibrated, with the cameras that moved; without a check (None) as it is in use."""
        folder = self.controller.profile_folder
        if folder is None or (self._drawn[0] == folder and self._drawn[1] is found):
            return
        self._drawn = folder, found
        try:
            rig = open_profile(folder).rig()
        except SpherecalError:  # said where the check itself reads it
            self.panel.show_scene(None)
            return
        self.panel.show_scene(check_scene(rig, found) if found is not None else rig_scene(rig))

    def says(self) -> Said:
        """Check; once the rig is known to be well, finish."""
        project, state, running = self.open_project, self.open_state, self.controller.runner.running or ""
        found, checked = self.controller.checks.found, project.checked
        shown: tuple[str, Level] | None = None
        if state.status is not Status.STALE and found is not None:
            verdict = self._verdict(found)
            shown = verdict.word, verdict.level
        elif checked is not None and state.status in (Status.DONE, Status.CARE, Status.FAILED):
            levels: dict[str, Level] = {"ok": "good", "watch": "caution"}
            shown = verdict_word(checked.verdict), levels.get(checked.verdict, "bad")
        well = self._in_use or (checked is not None and checked.verdict == "ok")
        waits = project.repaired if self._after is not None and not self._in_use else None
        usable_now = waits is not None and usable(waits.verdict) and limits.now().unverified_use
        return check_says(CheckFacts(state.status, shown, reason_text(state.reason), well, running, usable_now))
