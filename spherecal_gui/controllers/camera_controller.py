"""The cameras of the open project: connected, looked at, live, lost, moved."""

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from PySide6.QtCore import Signal

from spherecal.base.context import Context
from spherecal_gui import project as changes
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import error_text, translate
from spherecal_gui.project import Project, Rectangle
from spherecal_gui.tasks import jobs

if TYPE_CHECKING:  # cameras and detection need scipy and numba, for which the window does not wait
    from spherecal.data.session import Bar
    from spherecal_cameras.builtin_driver import BuiltinDriver, DriverTrouble
    from spherecal_cameras.camera_network import InterfaceFact, WireCamera
    from spherecal_cameras.genicam.trust import Ask, Driver
    from spherecal_cameras.in_process import Staged
    from spherecal_cameras.protocol import CameraSource, CameraStatus
    from spherecal_gui.controllers.controller import Controller
    from spherecal_gui.tasks.live_detection import Connection, LiveView

# Sight of the cameras while somebody aims them; detection takes 45 ms an image of 1.3 MP here and sets its own pace.
LIVE_HZ = 5.0

# Damaged images, and not one whole, until a camera counts as lost; the first ones may break while it starts.
_ALL_DAMAGED = 5

_Found = TypeVar("_Found")  # what a piece of work gives


class CameraController(ControllerPart):
    """The connection to the cameras and their live images."""

    live_hz = LIVE_HZ
    connected = Signal()  # the cameras were opened
    driver_asked = Signal(object)  # a DriverQuestion: one that was never allowed; only where `somebody_answers`

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.connection: Connection | None = None
        self.live: LiveView | None = None
        self.somebody_answers = False
        self.driver_troubles: tuple[DriverTrouble, ...] = ()  # of the last search
        self.wire: tuple[WireCamera, ...] = ()  # who answered on the network then
        self.builtin: BuiltinDriver | None = None  # as it was before that search
        self.facts: tuple[InterfaceFact, ...] = ()  # of this computer's network

    @property
    def names(self) -> "Mapping[str, str]":
        """The names of the rig's cameras by serial; none without a connection."""
        return self.connection.names if self.connection is not None else {}

    @property
    def source(self) -> "CameraSource | None":
        """The open source; None without a connection."""
        return self.connection.source if self.connection is not None else None

    @property
    def bars(self) -> "tuple[Bar, ...]":
        """The bars on the bench; none without a connection."""
        return tuple(self.connection.plan.bars) if self.connection is not None else ()

    def close(self) -> None:
        """Let go of the cameras."""
        self._disconnect()
        self.driver_troubles, self.wire, self.facts = (), (), ()

    def _disconnect(self) -> None:
        if self.live is not None:
            self.live.stop()
            self.live = None
        if self.connection is not None:
            self.connection.source.close()
            self.connection = None

    # --- connected ---------------------------------------------------------------------------------------------------

    def connect_all(self) -> None:
        """Open the source and its cameras."""
        project = self.project
        if project is None or self.runner.running:
            return
        self._disconnect()
        project = changes.without_failure(project, "connect")
        self.driver_troubles, self.wire, self.facts = (), (), ()
        self.main.update(project)

        def work(context: Context) -> "Connection":
            from spherecal_cameras.builtin_driver import state  # as above; starts programs that take their time

            self.builtin = state()
            connection = jobs.connect(project, context, self._asker(context))
            self.facts = jobs.network_facts(connection, self.live_hz)
            return connection

        self.runner.start("connect", work, self._connected, self._not_connected)

    def _not_connected(self, error: BaseException) -> None:
        """Say what is in the way; what drivers have to do with it is kept for the page."""
        self.driver_troubles, self.wire = getattr(error, "troubles", ()), getattr(error, "wire", ())
        self.main.failed("connect")(error)

    def allow_driver(self, file: str) -> None:
        """Allow a driver that was refused, and search again."""
        from spherecal_cameras.genicam.trust import TrustStore  # the window starts without the cameras' modules

        def allow() -> None:
            store = TrustStore()
            driver = store.look(file)
            if driver.state in ("new", "changed"):
                store.allow(driver)

        if self.main.attempt(allow):
            self.connect_all()

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
        from spherecal_cameras.builtin_driver import driver_troubles
        from spherecal_gui.tasks.live_detection import LiveView

        if self.project is None:
            connection.source.close()
            return
        self.connection, self.wire = connection, connection.wire
        self.driver_troubles = driver_troubles(connection.discovery, connection.wire)
        project = changes.with_cameras(self.project, tuple(connection.names))
        if not project.taken and project.artefacts is None and project.purpose != "check":
            placements, scale, checks = jobs.planned_sets(connection.plan)
            if project.purpose == "verify":
                project = replace(project, check_poses=checks)
            else:
                placements = placements or project.placements
                project = replace(project, placements=placements, scale_poses=scale, check_poses=checks)
        self.live = LiveView(connection)
        self.apply_masks(project)
        self.live.start(self.live_hz)
        self.main.update(project)
        self.connected.emit()

    # --- each camera by itself ---------------------------------------------------------------------------------------

    def set_in_rig(self, serial: str, on: bool) -> None:
        """Take a camera into the rig, or leave it out; kept in the camera profile."""
        if self.connection is not None and self.main.attempt(lambda: keep_in_profile((serial,), in_rig=on)):
            self.connect_all()

    def set_lenses(self, focal_mm: float | None, pitch_um: float | None) -> None:
        """State the lens of all cameras of the rig, None where nobody knows it; nothing is opened again."""
        connection, project = self.connection, self.project
        if connection is None or project is None:
            return
        serials = connection.profile.rig_of(connection.discovery.serials)
        kept = {"focal_length_mm": focal_mm, "pixel_pitch_um": pitch_um}
        if self.main.attempt(lambda: keep_in_profile(serials, **kept)):
            c = connection
            self._go_on_with(jobs.joined(project, c.source, c.discovery, c.reports, c.plan, c.wire))

    def take_in_again(self) -> None:
        """Cameras that could not be opened before and send images now join the others."""
        connection, project = self.connection, self.project
        if connection is None or project is None or self.runner.running or not (back := connection.answering_again):
            return
        self._work(lambda _: jobs.taken_in_again(project, connection, back), self._go_on_with)

    def _work(self, work: Callable[[Context], _Found], done: Callable[[_Found], None] | None = None) -> None:
        """Begin work that belongs to this step; `done` None: search again after it."""
        self.runner.start("connect", work, done or (lambda _: self.connect_all()), self.main.failed("connect"))

    def _go_on_with(self, connection: "Connection") -> None:
        if self.live is not None:
            self.live.stop()
        self._connected(connection)

    def give_address(self, camera: "WireCamera") -> None:
        """Give a camera a free address of this computer's network, for good, and search again."""
        from spherecal_cameras.camera_network import give_address, proposed_address  # as above
        from spherecal_cameras.protocol import CameraError

        others = self.wire

        def work(context: Context) -> None:
            context.report("giving the camera an address", 0.2, camera.model)
            free = proposed_address(camera, others)
            if free is None:
                text = translate("Connect", "This computer's network does not say which addresses are free.")
                hint = translate("Connect", "Give the camera an address with its maker's program.")
                raise CameraError(text, hint)
            give_address(camera.mac, free.ip, free.mask)

        self._work(work)

    @property
    def builtin_helps(self) -> bool:
        """Whether the built-in driver can be used and is not: cameras that no other one lists would be reached."""
        from spherecal_cameras.makers import ANY_MAKER  # as above

        found = self.connection.discovery.producers if self.connection is not None else ()
        used = any(one.usable and Path(one.file).name in ANY_MAKER.files for one in found)
        return self.builtin is not None and self.builtin.kind != "lacking" and bool(found) and not used

    def use_builtin_driver(self) -> None:
        """Build the built-in driver where it is not there yet, allow it, and search again."""
        from spherecal_cameras.builtin_driver import prepare  # as above

        self._work(prepare)

    def cure_network(self, cure: str) -> None:
        """Run the command that cures this computer's network, as its system allows, and search again."""
        from spherecal_cameras.camera_network import apply_cure  # as above

        def refused(error: BaseException) -> None:
            self.main.tell("bad", *error_text(error))

        self.runner.start("connect", lambda _: apply_cure(cure), lambda _: self.connect_all(), refused)

    def choose_bench(self, path: str) -> None:
        """Take targets, ball and bars from another file, and connect again."""
        self.main.change(bench=path, artefacts=None)
        self.connect_all()

    def accept_look(self) -> None:
        """The images are good."""
        if self.project is not None:
            self.main.update(replace(self.project, looked=self.project.cameras))  # a step that the disk refused too

    # --- lost, moved -------------------------------------------------------------------------------------------------

    def lost(self) -> tuple[str, ...]:
        """The names of cameras that send no images now, or none that is whole."""
        statuses = self.source.statuses() if self.source is not None else {}
        return tuple(
            name for serial, name in self.names.items() if serial in statuses and not _delivers(statuses[serial])
        )

    def moved(self) -> tuple[str, ...]:
        """The names of cameras that were moved, and that nobody has seen to yet."""
        bumped = self.live.watch.bumped if self.live is not None else {}
        return tuple(self.names[serial] for serial in bumped if serial in self.names)

    def accept_moved(self) -> None:
        """The cameras that were moved count as they stand now; what was taken before has to be taken again."""
        moved = self.moved()
        if self.live is None or self.project is None or not moved:
            return
        self.live.watch.forgive()
        self.main.update(changes.with_moved(self.project, moved))

    # --- live images -------------------------------------------------------------------------------------------------

    def apply_masks(self, project: Project) -> None:
        """Examine live images without what the project's masks cover."""
        if self.live is not None:
            self.live.masks = {serial: masks_of(project, name) for serial, name in self.names.items()}

    def start_alone(self, step: str, work: Callable[[Context], _Found], done: Callable[[_Found], None]) -> bool:
        """Start work without live images, which need its cores; they end beside the window and go on after it."""
        project, live = self.project, self.live
        if project is None or self.runner.running:
            return False
        self.main.update(changes.without_failure(project, step))

        def run(context: Context) -> _Found:
            if live is not None:
                live.stop()
            return work(context)

        def live_again(then: Callable[..., None]) -> Callable[..., None]:
            def ended(*found: object) -> None:
                if self.live is not None:
                    self.live.start(self.live_hz)
                then(*found)

            return ended

        cancelled = partial(self.main.tell, "info", translate("Calibrate", "Cancelled. What was captured is kept."))
        ends = done, self.main.failed(step), cancelled
        return self.runner.start(step, run, *map(live_again, ends))

    # --- simulated and recorded ones ---------------------------------------------------------------------------------

    @property
    def staged(self) -> "Staged | None":
        """The simulated or recorded source, which shows what it is asked for; None for real cameras."""
        if self.source is None:
            return None
        from spherecal_cameras.in_process import Staged  # the window starts without the cameras' modules

        return self.source if isinstance(self.source, Staged) else None

    @property
    def staged_poses(self) -> tuple[str, ...]:
        """What a simulated or recorded source can show; empty for real cameras."""
        return self.staged.poses if self.staged is not None else ()


def keep_in_profile(serials: Iterable[str], **changes: object) -> None:
    """Write what somebody says of cameras into the camera profile."""
    from spherecal_cameras.camera_settings import default_profile_path, read_profile, write_profile  # as above

    path = default_profile_path()
    profile = read_profile(path)
    for serial in serials:
        profile = profile.with_entry(replace(profile.entry(serial), **changes))
    write_profile(path, profile)


def masks_of(project: Project, camera: str) -> tuple[Rectangle, ...]:
    """The parts of a camera's image in which nothing is a target: left, top, width and height in px."""
    return tuple(rectangle for name, rectangle in project.masks if name == camera)


def _delivers(status: "CameraStatus") -> bool:
    """Whether a camera sends images, and some of them whole."""
    counted = status.counters
    return status.state.usable and (counted.delivered > 0 or counted.incomplete + counted.underrun < _ALL_DAMAGED)


_LOOK_S = 0.1


class DriverQuestion:
    """Whether a driver file may be loaded: which one, the hash of its contents, whether it was another one before."""

    def __init__(self, file: str, sha256: str, changed: bool) -> None:
        self.file, self.sha256, self.changed = file, sha256, changed
        self._answered = threading.Event()
        self._answer = False

    def answer(self, yes: bool) -> None:
        """Say yes or no; the first answer counts."""
        if not self._answered.is_set():
            self._answer = yes
            self._answered.set()

    def wait(self, context: Context) -> bool:
        """The answer; Cancelled where the work is to stop."""
        while not self._answered.wait(_LOOK_S):
            context.check()
        return self._answer
