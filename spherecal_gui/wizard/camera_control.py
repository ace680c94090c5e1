"""Projects opened and closed, cameras connected and looked at, the bench confirmed."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QCoreApplication, QObject, Signal

from spherecal.base.context import Context
from spherecal.base.errors import OutputError
from spherecal.files.lock import InUse, locked
from spherecal_gui import limits
from spherecal_gui import project as changes
from spherecal_gui.presenters.coverage import Dots, unmasked
from spherecal_gui.project import Computation, Project, Rectangle
from spherecal_gui.project_folder import (
    FILE,
    discard,
    is_project,
    load_project,
    new_folder,
    profile_of,
    remove_if_empty,
    save_project,
    taken_in,
)
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.dot_store import DotStore
from spherecal_gui.tasks.driver_question import DriverQuestion
from spherecal_gui.tasks.outcome import Outcome, read_outcome
from spherecal_gui.wizard.project_control import ProjectControl

if TYPE_CHECKING:  # cameras and detection need scipy and numba, for which the window does not wait
    from spherecal.cameras.capture import SessionCamera
    from spherecal.cameras.driver_help import DriverTrouble
    from spherecal.cameras.gentl.trust import Ask, Driver
    from spherecal_gui.recorded import RecordedSession
    from spherecal_gui.tasks.live import Connection

translate = QCoreApplication.translate

# Sight of the cameras while somebody aims them; detection takes 45 ms an image of 1.3 MP here and sets its own pace.
LIVE_HZ = 5.0


class CameraControl(ProjectControl):
    """The cameras of the open project, its two session folders, and the dots of what was taken.

    `driver_asked` (DriverQuestion) when a driver was never allowed; it is only asked where `somebody_answers`.
    """

    live_hz = LIVE_HZ
    driver_asked = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.somebody_answers = False
        self.driver_troubles: tuple[DriverTrouble, ...] = ()  # of the last search
        self._is_new = False
        self.keeps_empty = False  # a project that never had a camera, too: it is opened again at once
        self._found: dict[str, Mapping[str, Dots]] = {}  # before masks
        self._clear: dict[str, tuple[object, object, Mapping[str, Dots]]] = {}
        self._recorded: RecordedSession | None = None
        self._checks: RecordedSession | None = None
        self._store: DotStore | None = None
        self._held = ExitStack()

    def new_project(self, source: str, parent: Path, bench: str = "") -> None:
        """Begin a calibration in a new folder.

        Parameters
        ----------
        source
            Where the images come from: `genicam`, `replay:FOLDER` or `simulated:RIG`, with faults after a plus sign.
        parent
            The folder in which the new one is made.
        bench
            The file that describes targets, ball and bars; empty where the source does.

        Raises
        ------
        OutputError
            Where the folder cannot be made.
        """
        self.close_project()
        limit = limits.now().verification_limit
        project = Project(new_folder(parent, datetime.now()), source, bench, limit=limit)
        save_project(project)
        self._begin(project)
        self._is_new = True

    def new_check(self, like: Project) -> None:
        """Begin a check with the cameras and the bench of an earlier calibration.

        Raises
        ------
        OutputError
            Where the folder cannot be made.
        """
        self.close_project()
        folder = new_folder(like.folder.parent, datetime.now(), "check")
        project = Project(folder, like.source, like.bench, placements=("P1",), purpose="check")
        save_project(project)
        self._begin(project)
        self._is_new = True

    def new_verification(self, like: Project) -> None:
        """Begin a verification of the calibration in use, with the cameras and the bench of an earlier project.

        Raises
        ------
        InputError
            Where no calibration is in use.
        OutputError
            Where the folder cannot be made.
        """
        from spherecal_gui.in_use import result_of  # needs scipy

        self.close_project()
        folder = new_folder(like.folder.parent, datetime.now(), "verification")
        project = Project(folder, like.source, like.bench, placements=(), purpose="verify")
        project = replace(project, limit=limits.now().verification_limit)
        try:
            number, verdict = result_of(profile_of(project), project.result_folder)
        except BaseException:
            if folder.is_dir():
                discard(folder)
            raise
        calibrated = Computation((("profile", number),), verdict)
        project = replace(project, calibrated=calibrated, accepted=calibrated)
        save_project(project)
        self._begin(project)

    def calibrate_like_this(self) -> None:
        """Begin a calibration with the cameras and the bench of the open check."""
        like = self.project
        if like is not None and self.runner.running is None:
            self.new_project(like.source, like.folder.parent, like.bench)

    def open_project(self, folder: Path) -> None:
        """Go on with a project where it was left.

        Raises
        ------
        InputError
            Where the folder holds none.
        OutputError
            Where it is open already: two windows would each write over what the other has done.
        """
        self.close_project()
        if is_project(folder):
            self._hold(folder)
        try:
            self._begin(load_project(folder))
        except BaseException:
            self._held.close()
            raise

    def _hold(self, folder: Path) -> None:
        try:
            self._held.enter_context(locked(folder / FILE, wait_s=0.0))
        except InUse:
            raise
        except OutputError:  # a folder that may only be read can be looked at
            return

    def _begin(self, project: Project) -> None:
        from spherecal_gui.tasks.kept_check import read_kept_check  # needs scipy

        self._hold(project.folder)
        self.project = project
        self._store = DotStore(project.folder)
        loaded = {name: self._store.load(name, at) for name, at in project.taken.items()}
        self._found = {name: dots for name, dots in loaded.items() if dots is not None}
        if project.checked is not None:
            kept = read_kept_check(project.folder)
            self.check_found = kept if kept is not None and kept.verdict == project.checked.verdict else None
        self.note(translate("Log", "project {folder}").format(folder=project.folder))
        self.changed.emit()
        self.connect_cameras()

    def close_project(self) -> None:
        """Let go of cameras and project; all is on disk already."""
        self.runner.close()
        self._disconnect()
        self._held.close()
        if self.project is not None and self._is_new and not self.keeps_empty:
            remove_if_empty(self.project)
        self._is_new = False
        self.project, self.outcome, self._recorded, self._checks, self._store = None, None, None, None, None
        self._found, self._clear, self.check_found, self.check_after = {}, {}, None, None
        self.course, self.driver_troubles = None, ()
        self.changed.emit()

    def _disconnect(self) -> None:
        if self.live is not None:
            self.live.stop()
            self.live = None
        if self.connection is not None:
            self.connection.source.close()
            self.connection = None

    def connect_cameras(self) -> None:
        """Open the source and its cameras."""
        project = self.project
        if project is None or self.runner.running:
            return
        self._disconnect()
        project = changes.without_failure(project, "connect")
        self.driver_troubles = ()
        self._update(project)
        self.runner.start(
            "connect",
            lambda context: jobs.connect(project, context, self._asker(context)),
            self._connected,
            self._not_connected,
        )

    def _not_connected(self, error: BaseException) -> None:
        """Say what is in the way; what drivers have to do with it is kept for the page."""
        self.driver_troubles = getattr(error, "troubles", ())
        self._failed("connect")(error)

    def allow_driver(self, file: str) -> None:
        """Allow a driver that was refused, and search again."""
        from spherecal.cameras.gentl.trust import TrustStore  # the window starts without the cameras' modules

        def allow() -> None:
            store = TrustStore()
            driver = store.look(file)
            if driver.state in ("new", "changed"):
                store.allow(driver)

        if self._try(allow):
            self.connect_cameras()

    def _asker(self, context: Context) -> "Ask | None":
        """Who is asked about drivers, from the thread that connects; None where nobody can answer."""
        if not self.somebody_answers:
            return None

        def ask(driver: "Driver") -> bool:
            question = DriverQuestion(driver.file, driver.sha256, driver.state == "changed")
            self.driver_asked.emit(question)
            return question.wait(context)

        return ask

    def _connected(self, connection: "Connection") -> None:
        # Loaded by the thread that connects the cameras; the second one needs scipy and numba.
        from spherecal.cameras.driver_help import driver_troubles
        from spherecal_gui.tasks.live import LiveView

        if self.project is None:
            connection.source.close()
            return
        self.connection = connection
        self.driver_troubles = driver_troubles(connection.discovery)
        project = changes.with_cameras(self.project, tuple(connection.names))
        if not project.taken and project.artefacts is None and project.purpose != "check":
            placements, scale, checks = jobs.planned_sets(connection.plan)
            if project.purpose == "verify":
                project = replace(project, check_poses=checks)
            else:
                placements = placements or project.placements
                project = replace(project, placements=placements, scale_poses=scale, check_poses=checks)
        self.live = LiveView(connection)
        self.live.masks = self._masks_by_serial(project)
        self.live.start(self.live_hz)
        self._update(project)
        if project.artefacts is not None:
            self._open_folders()
        self._read_result()

    def choose_bench(self, path: str) -> None:
        """Take targets, ball and bars from another file, and connect again."""
        if self.project is not None:
            self._update(replace(self.project, bench=path, artefacts=None))
            self.connect_cameras()

    def confirm_bench(self) -> None:
        """Somebody has looked: what the page says is what is on the bench."""
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
        from spherecal_gui.recorded import RecordedSession  # needs scipy and numba

        project, connection = self.project, self.connection
        if project is None or connection is None:
            return
        try:
            plan = jobs.calibration_plan(connection.plan, project.sets)
            cameras = self._masked_cameras(project, connection)
            self._recorded = RecordedSession(project.folder, plan, cameras, connection.source)
            self._recorded.start()
            if project.check_poses:
                self._open_checks(project, connection)
            if (taken := taken_in(project.folder)) != project.taken:  # a set whose retaking was cut short is back
                self._update(replace(self.project or project, taken=taken))
            self._find_lost_dots()
        except Exception as error:
            self._recorded = self._checks = None
            self._failed("connect")(error)
        self.changed.emit()

    def _open_checks(self, project: Project, connection: "Connection") -> None:
        """Make or take up the session folder of the check bars."""
        from spherecal_gui.recorded import RecordedSession  # needs scipy and numba

        plan = jobs.calibration_plan(connection.plan, project.check_poses, dict(project.pose_bars))
        cameras = self._masked_cameras(project, connection)
        self._checks = RecordedSession(project.verification_folder, plan, cameras, connection.source)
        self._checks.start()

    @staticmethod
    def masks_of(project: Project, camera: str) -> tuple[Rectangle, ...]:
        """The parts of a camera's image in which nothing is a target: left, top, width and height in px.

        Parameters
        ----------
        project
            Whose masks are meant.
        camera
            Its name.
        """
        return tuple(rectangle for name, rectangle in project.masks if name == camera)

    def _masks_by_serial(self, project: Project) -> dict[str, tuple[Rectangle, ...]]:
        names = self.connection.names if self.connection is not None else {}
        return {serial: self.masks_of(project, name) for serial, name in names.items()}

    def _masked_cameras(self, project: Project, connection: "Connection") -> "tuple[SessionCamera, ...]":
        """The cameras as session.json has them, with their masks."""
        cameras = []
        for camera in connection.cameras:
            entry = {key: value for key, value in camera.entry.items() if key != "ignore"}
            masks = [list(one) for one in self.masks_of(project, camera.id)]
            cameras.append(replace(camera, entry={**entry, "ignore": masks} if masks else entry))
        return tuple(cameras)

    @property
    def dots(self) -> dict[str, Mapping[str, Dots]]:
        """The dots of every set taken, by camera, without those that lie in masks."""
        masks = self.project.masks if self.project is not None else ()
        for name, found in self._found.items():
            known = self._clear.get(name)
            if known is None or known[0] is not found or known[1] != masks:
                assert self.project is not None
                clear = {camera: unmasked(one, self.masks_of(self.project, camera)) for camera, one in found.items()}
                self._clear[name] = (found, masks, clear)
        return {name: self._clear[name][2] for name in self._found}

    def _folder_of(self, set_id: str) -> "RecordedSession | None":
        """The session folder that a set is in: of the check bars, or of the calibration."""
        checks = self.project.check_poses if self.project is not None else ()
        return self._checks if set_id in checks else self._recorded

    def _find_lost_dots(self) -> None:
        """Detect again what the store does not have; counters are as they were."""
        project, connection = self.project, self.connection
        if project is None or connection is None:
            return
        lost = {name: self._folder_of(name) for name in project.taken if name not in self._found}
        images = {name: folder.images(name) for name, folder in lost.items() if folder is not None}
        plan = connection.plan
        if not images or jobs.artefacts_of(plan) is None:
            return

        def work(context: Context) -> dict[str, Mapping[str, Dots]]:
            return {name: jobs.dots_of_images(paths, plan, context) for name, paths in images.items()}

        self.runner.start("connect", work, self._dots_found, self._failed("connect"))

    def _dots_found(self, found: dict[str, Mapping[str, Dots]]) -> None:
        self._found |= found
        if self.project is not None and self._store is not None:
            for name, dots in found.items():
                self._store.save(name, self.project.taken.get(name, ""), dots)
        self.changed.emit()

    def _take_over_plan(self) -> None:
        """There may be another plan of the check bars' poses."""

    def accept_look(self) -> None:
        """The images are good."""
        if self.project is not None:
            self._update(changes.with_looked(self.project))

    def cameras_fixed(self) -> None:
        """Somebody has seen to the cameras that were moved: they count as they stand now.

        What was taken before shows them where they were, so it has to be taken again.
        """
        moved = self.moved_cameras()
        if self.live is None or self.project is None or not moved:
            return
        self.live.watch.forgive()
        self._update(changes.with_moved(self.project, moved))

    def keep_set(self, set_id: str) -> None:
        """Keep a set as it was taken, with what is wrong with it."""
        if self.project is not None:
            self._update(changes.with_kept(self.project, set_id))

    def _read_result(self) -> None:
        """The result on disk, after a project was opened."""
        project = self.project
        if project is None or project.calibrated is None or self.outcome is not None or self.runner.running:
            return

        self.runner.start("results", self._reading(project), self._result_read, self._failed("results"))

    def _reading(self, project: Project) -> Callable[[Context], Outcome]:
        """Read the project's result, and compare it with the calibration in use."""
        profile = profile_of(project)
        bars = self.connection.plan.bars if self.connection is not None else ()
        return lambda context: read_outcome(project.result_folder, project.folder, profile, bars, context)

    def _result_read(self, outcome: Outcome) -> None:
        self.outcome = outcome
        self._take_over_plan()
        self.result_changed.emit()
