"""What the wizard does: each button ends here. Knows no widgets; every change is saved before it is shown."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from PySide6.QtCore import QCoreApplication, QObject, Signal

from spherecal.context import Context
from spherecal_gui import project as changes
from spherecal_gui.presenters.coverage import Dots
from spherecal_gui.presenters.guidance import Guidance, Guide
from spherecal_gui.project import Project
from spherecal_gui.project_folder import load_project, new_folder, save_project, taken_in
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.task import Runner, Work
from spherecal_gui.texts import error_text, verdict_word
from spherecal_gui.workflow import Running, WorkflowState, resolve

log = logging.getLogger("spherecal.gui")
translate = QCoreApplication.translate

# Sight of the cameras while somebody aims them; detection takes 45 ms an image of 1.3 MP here and sets its own pace.
LIVE_HZ = 5.0


class Controller(QObject):
    """The open project and all that can be done with it.

    `changed` when the workflow's state may be another, `said` (kind, what, what to do) when people should know,
    `logged` for the log pane, `taken` when a set was taken, `result_changed` when there is another result.
    """

    changed = Signal()
    said = Signal(str, str, str)
    logged = Signal(str)
    taken = Signal(str)
    result_changed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.runner = Runner(self)
        self.runner.started.connect(self._work_started)
        self.runner.ended.connect(self._work_ended)
        self.project: Project | None = None
        self.connection: Any = None
        self.live: Any = None
        self.dots: dict[str, Mapping[str, Dots]] = {}
        self.result: Any = None
        self.guide: Guide | None = None
        self._recorded: Any = None
        self._checks: Any = None
        self._store: jobs.DotStore | None = None

    # --- state -------------------------------------------------------------------------------------------------------

    @property
    def state(self) -> WorkflowState | None:
        """The workflow's state; None without a project."""
        if self.project is None:
            return None
        return resolve(self.project, Running(self.runner.running, self.connection is not None))

    def _update(self, project: Project) -> None:
        """Take over a changed project: on disk first."""
        save_project(project)
        self.project = project
        self.changed.emit()

    def _work_started(self, name: str) -> None:
        self.note(translate("Log", "{step}: started").format(step=name))
        self.changed.emit()

    def _work_ended(self, name: str) -> None:
        self.note(translate("Log", "{step}: ended").format(step=name))
        self.changed.emit()

    def note(self, text: str) -> None:
        """A line for the log pane and the log file."""
        log.info("%s", text)
        self.logged.emit(f"{datetime.now():%H:%M:%S}  {text}")

    def tell(self, kind: str, text: str, hint: str = "") -> None:
        """Something that people should know: kind is `good`, `bad` or `info`."""
        self.note(f"{text} {hint}".strip())
        self.said.emit(kind, text, hint)

    def _failed(self, step: str) -> Callable[[BaseException], None]:
        def tell(error: BaseException) -> None:
            text, hint = error_text(error)
            log.error("%s", text, exc_info=error)
            if self.project is not None:
                self._update(changes.with_failure(self.project, step, f"{text} {hint}".strip()))
            self.tell("bad", text, hint)

        return tell

    # --- projects ----------------------------------------------------------------------------------------------------

    def new_project(self, source: str, parent: Path, bench: str = "") -> None:
        """Begin a calibration in a new folder; OutputError where it cannot be made."""
        self.close_project()
        project = Project(new_folder(parent, datetime.now()), source, bench)
        save_project(project)
        self._begin(project)

    def open_project(self, folder: Path) -> None:
        """Go on with a project where it was left; InputError where the folder holds none."""
        self.close_project()
        self._begin(load_project(folder))

    def _begin(self, project: Project) -> None:
        self.project = project
        self._store = jobs.DotStore(project.folder)
        loaded = {name: self._store.load(name, at) for name, at in project.taken.items()}
        self.dots = {name: dots for name, dots in loaded.items() if dots is not None}
        self.note(translate("Log", "project {folder}").format(folder=project.folder))
        self.changed.emit()
        self.connect_cameras()

    def close_project(self) -> None:
        """Let go of cameras and project; all is on disk already."""
        self.runner.close()
        self._disconnect()
        self.project, self.result, self._recorded, self._checks, self._store = None, None, None, None, None
        self.dots = {}
        self.changed.emit()

    def _disconnect(self) -> None:
        if self.live is not None:
            self.live.stop()
            self.live = None
        if self.connection is not None:
            self.connection.source.close()
            self.connection = None

    def go(self, step: str) -> None:
        """Go to a step, if it is not blocked."""
        state = self.state
        if state is None or self.project is None or step == self.project.step or not state.of(step).open:
            return
        self._update(replace(self.project, step=step))

    # --- connect and look --------------------------------------------------------------------------------------------

    def connect_cameras(self) -> None:
        """Open the source and its cameras."""
        project = self.project
        if project is None or self.runner.running:
            return
        self._disconnect()
        project = changes.without_failure(project, "connect")
        self._update(project)
        self.runner.start(
            "connect", lambda context: jobs.connect(project, context), self._connected, self._failed("connect")
        )

    def _connected(self, connection: Any) -> None:
        from spherecal_gui.tasks.live import LiveView

        if self.project is None:
            connection.source.close()
            return
        self.connection = connection
        project = changes.with_cameras(self.project, tuple(connection.names))
        if not project.taken and project.artefacts is None:
            placements, scale, checks = jobs.planned_sets(connection.plan)
            project = replace(
                project, placements=placements or project.placements, scale_poses=scale, check_poses=checks
            )
        self.live = LiveView(connection)
        self.live.start(LIVE_HZ)
        self._update(project)
        if project.artefacts is not None:
            self._open_folders()
        self._read_result()

    def missing_cameras(self) -> tuple[str, ...]:
        """Serials of the project's cameras that were not found now."""
        if self.project is None or self.connection is None:
            return ()
        return tuple(serial for serial in self.project.cameras if serial not in self.connection.names)

    def choose_bench(self, path: str) -> None:
        """Take targets, ball and bars from another file, and connect again."""
        if self.project is not None:
            self._update(replace(self.project, bench=path, artefacts=None))
            self.connect_cameras()

    def confirm_bench(self) -> None:
        """Somebody has looked: what the page says is what stands on the bench."""
        if self.project is None or self.connection is None:
            return
        artefacts = jobs.artefacts_of(self.connection.plan)
        if artefacts is None:
            text = translate("Connect", "It is not known which targets are on the ball.")
            self.tell("bad", text, translate("Connect", "Choose the file that describes the bench."))
            return
        self._update(changes.with_artefacts(self.project, artefacts))
        self._open_folders()

    def _open_folders(self) -> None:
        """Make or take up the two session folders: of the calibration, and of the check bars."""
        from spherecal_gui.recorded import RecordedSession

        project, connection = self.project, self.connection
        if project is None or connection is None:
            return
        try:
            plan = jobs.calibration_plan(connection.plan, project.sets)
            self._recorded = RecordedSession(project.folder, plan, connection.cameras, connection.source)
            self._recorded.start()
            if project.check_poses:
                plan = jobs.calibration_plan(connection.plan, project.check_poses)
                folder = project.verification_folder
                self._checks = RecordedSession(folder, plan, connection.cameras, connection.source)
                self._checks.start()
            self._find_lost_dots()
        except Exception as error:
            self._recorded = self._checks = None
            self._failed("connect")(error)

    def _find_lost_dots(self) -> None:
        """Detect again what the store does not have; counters are as they were."""
        project = self.project
        if project is None:
            return
        lost = [name for name in project.taken if name not in self.dots]
        images = {name: self._folder_of(name).images(name) for name in lost if self._folder_of(name) is not None}
        target_set = self.connection.plan.target_set
        if not images or target_set is None:
            return

        def work(context: Context) -> dict[str, Mapping[str, Dots]]:
            return {name: jobs.dots_of_images(paths, target_set, context) for name, paths in images.items()}

        self.runner.start("connect", work, self._dots_found, self._failed("connect"))

    def _dots_found(self, found: dict[str, Mapping[str, Dots]]) -> None:
        self.dots |= found
        if self.project is not None and self._store is not None:
            for name, dots in found.items():
                self._store.save(name, self.project.taken.get(name, ""), dots)
        self.changed.emit()

    def accept_look(self) -> None:
        """The images are good."""
        if self.project is not None:
            self._update(changes.with_looked(self.project))

    # --- sets --------------------------------------------------------------------------------------------------------

    def _folder_of(self, set_id: str) -> Any:
        checks = self.project.check_poses if self.project is not None else ()
        return self._checks if set_id in checks else self._recorded

    @property
    def staged_poses(self) -> tuple[str, ...]:
        """What a simulated or recorded source can show; empty for real cameras."""
        source = self.connection.source if self.connection is not None else None
        return tuple(getattr(source, "poses", ()))

    def show_pose(self, pose: str) -> None:
        """Have a simulated or recorded rig show a pose: there nobody moves the ball by hand."""
        source = self.connection.source if self.connection is not None else None
        if source is None or not self.staged_poses:
            return
        if pose in self.staged_poses:
            if source.shown != pose:
                source.show(pose)
        elif hasattr(source, "stage"):  # one more placement than the rig was simulated with
            placed = [one for one in self.staged_poses if one in source.stage.truth.placements]
            number = int(pose[1:]) if pose[1:].isdecimal() else 1
            source.show(placed[number % len(placed)])
            source.stage.move((40.0, -30.0, 60.0), (25.0, 40.0, 0.0))
        if self.live is not None:
            self.live.forget()

    def take(self, set_id: str, step: str) -> bool:
        """Take a set (again); False where that is not possible now."""
        folder = self._folder_of(set_id)
        if self.connection is None or folder is None or self.project is None:
            return False
        self._update(changes.without_failure(self.project, step))
        connection, real = self.connection, not self.staged_poses

        def work(context: Context) -> jobs.Taken:
            taken = jobs.take_set(connection, set_id, context, real)
            context.report("writing the images", 0.9, set_id)
            folder.add(folder.planned(set_id), taken.frames, taken.stillness)
            return taken

        return self.runner.start(step, work, self._set_taken, self._failed(step))

    def _set_taken(self, taken: jobs.Taken) -> None:
        folder = self._folder_of(taken.set_id)
        if self.project is None or folder is None or self._store is None:
            return
        at = folder.taken_at(taken.set_id)
        self._store.save(taken.set_id, at, taken.dots)
        self.dots[taken.set_id] = taken.dots
        self._update(changes.with_set(self.project, taken.set_id, at))
        self.taken.emit(taken.set_id)
        missing = ", ".join(self.connection.names[one.camera] for one in taken.frames.missing)
        moved = ", ".join(self.connection.names[s] for s, one in taken.stillness.items() if not one.still)
        if missing:
            text = translate("Placement", "{name} is taken, but without {cameras}.").format(
                name=taken.set_id, cameras=missing
            )
            self.tell("bad", text, translate("Placement", "Check these cameras, then take it again."))
        elif moved:
            text = translate("Placement", "{name} is taken, but {cameras} saw it move.").format(
                name=taken.set_id, cameras=moved
            )
            self.tell("bad", text, translate("Placement", "Let it come to rest, then take it again."))
        else:
            self.tell("good", translate("Placement", "{name} is taken.").format(name=taken.set_id))

    def delete(self, set_id: str) -> None:
        """Put a set aside."""
        folder = self._folder_of(set_id)
        if folder is None or self.project is None or self.runner.running:
            return
        folder.remove(set_id)
        self.dots.pop(set_id, None)
        self._update(changes.without_set(self.project, set_id))

    @property
    def can_undo(self) -> str | None:
        """The set that `undo` would bring back."""
        return self._recorded.can_undo if self._recorded is not None else None

    def undo(self) -> None:
        """Bring back the set that was deleted or replaced last."""
        if self._recorded is None or self.project is None or self.runner.running:
            return
        set_id = self._recorded.undo()
        if set_id is None:
            return
        self._update(replace(self.project, taken=taken_in(self.project.folder)))
        loaded = self._store.load(set_id, self.project.taken[set_id]) if self._store else None
        self.dots.pop(set_id, None)
        if loaded is not None:
            self.dots[set_id] = loaded
        else:
            self._find_lost_dots()

    def guidance(self) -> Guidance | None:
        """Where to put the ball next, by the engine's guide; None where there is none."""
        if self.guide is None or self.project is None:
            return None
        return self.guide({name: self.dots[name] for name in self.project.placements if name in self.dots})

    def add_placement(self) -> None:
        """Plan one more placement and go there."""
        from spherecal.cameras.plan import PlannedSet

        if self.project is None or self._recorded is None:
            return
        project = changes.with_another_placement(self.project)
        self._recorded.plan_more(PlannedSet(project.placements[-1]))
        self._update(replace(project, step=f"placement:{project.placements[-1]}"))

    def drop_placement(self, set_id: str) -> None:
        """Do without a planned placement that was not taken."""
        if self.project is not None:
            self._update(changes.without_placement(self.project, set_id))

    # --- computing ---------------------------------------------------------------------------------------------------

    def calibrate(self) -> bool:
        """Start the calibration."""
        project = self.project
        if project is None or self.runner.running:
            return False
        self._update(changes.without_failure(project, "calibrate"))
        return self.runner.start(
            "calibrate", self._alone(lambda context: jobs.calibrate(project.folder, project.result_folder, context)),
            self._calibrated, self._computing_failed("calibrate"), self._cancelled,
        )  # fmt: skip

    def _calibrated(self, outcome: tuple[Any, changes.Verdict]) -> None:
        self._resume_live()
        self.result, verdict = outcome
        if self.project is not None:
            self._update(changes.with_calibration(self.project, verdict))
        self.result_changed.emit()
        kind = "good" if verdict == "valid" else "bad"
        text = translate("Calibrate", "The calibration is finished: {verdict}.").format(verdict=verdict_word(verdict))
        self.tell(kind, text)

    def _computing_failed(self, step: str) -> Callable[[BaseException], None]:
        tell = self._failed(step)

        def resume(error: BaseException) -> None:
            self._resume_live()
            tell(error)

        return resume

    def _cancelled(self) -> None:
        self._resume_live()
        self.tell("info", translate("Calibrate", "Cancelled. What was taken is kept."))

    def cancel(self) -> None:
        """Ask the running work to stop."""
        self.runner.cancel()
        self.changed.emit()

    def _alone(self, work: Work) -> Work:
        """The work without live images: it needs their cores. They are ended beside the window, which never waits."""
        live = self.live

        def run(context: Context) -> Any:
            if live is not None:
                live.stop()
            return work(context)

        return run

    def _resume_live(self) -> None:
        if self.live is not None:
            self.live.start(LIVE_HZ)

    def accept_results(self) -> None:
        """The results were looked at."""
        if self.project is not None:
            self._update(changes.with_accepted(self.project))

    def verify(self) -> bool:
        """Measure the check bars in the poses taken."""
        project = self.project
        if project is None or self.runner.running:
            return False
        self._update(changes.without_failure(project, "verify"))
        work = self._alone(lambda context: jobs.verify(project.verification_folder, project.result_folder, context))
        return self.runner.start(
            "verify", work,
            self._verified, self._computing_failed("verify"), self._cancelled,
        )  # fmt: skip

    def _verified(self, outcome: tuple[Any, changes.Verdict]) -> None:
        self._resume_live()
        self.result, verdict = outcome
        if self.project is not None:
            self._update(changes.with_verification(self.project, verdict))
        self.result_changed.emit()
        text = translate("Verify", "The verification is finished: {verdict}.").format(verdict=verdict_word(verdict))
        self.tell("good" if verdict == "consistent" else "bad", text)

    def _read_result(self) -> None:
        """The result on disk, after a project was opened."""
        project = self.project
        if project is None or project.calibrated is None or self.result is not None or self.runner.running:
            return

        def work(context: Context) -> Any:
            from spherecal.report.result_folder import read_result

            context.report("reading the result", 0.0)
            return read_result(project.result_folder)

        self.runner.start("results", work, self._result_read, self._failed("results"))

    def _result_read(self, result: Any) -> None:
        self.result = result
        self.result_changed.emit()

    # --- saving ------------------------------------------------------------------------------------------------------

    def _save(self, work: Callable[[Context], Any], told: str) -> bool:
        def done(what: Any) -> None:
            if self.project is not None:
                self._update(changes.with_saved(self.project))
            self.tell("good", told.format(what=what))

        if self.project is None:
            return False
        self._update(changes.without_failure(self.project, "save"))
        return self.runner.start("save", work, done, self._failed("save"))

    def write_report(self, output: Path) -> bool:
        """The report as a PDF."""
        project = self.project
        if project is None:
            return False
        told = translate("Save", "The report is in {what}.")
        return self._save(lambda context: jobs.report(project.result_folder, project.folder, output, context), told)

    def save_profile(self, profile: Path, put_to_use: bool) -> bool:
        """The calibration into a rig profile's history, and to use."""
        project = self.project
        if project is None:
            return False
        told = translate("Save", "Saved in the rig's profile as calibration {what}.")
        return self._save(
            lambda context: jobs.save_profile(project.result_folder, project.folder, profile, put_to_use, context), told
        )

    def export(self, form: str, output: Path) -> bool:
        """The rig in another program's format."""
        project = self.project
        if project is None:
            return False
        told = translate("Save", "Written to {what}.")
        return self._save(lambda context: jobs.export(project.result_folder, form, output, context), told)

    def commands(self) -> tuple[str, ...]:
        """The command lines that give the same bytes."""
        import shlex

        if self.project is None:
            return ()
        session, result = str(self.project.folder), str(self.project.result_folder)
        lines = [["spherecal", "calibrate", session, "-o", result]]
        if self.project.check_poses:
            checks = str(self.project.verification_folder)
            lines.append(["spherecal", "verify", checks, "--rig", f"{result}/rig.json", "-o", result])
        return tuple(shlex.join(line) for line in lines)
