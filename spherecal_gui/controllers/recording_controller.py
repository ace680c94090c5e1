"""What was recorded: the bench confirmed, the session folders, placements and poses taken, their dots, the masks."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.context import Context
from spherecal_gui import languages
from spherecal_gui import project as changes
from spherecal_gui.controllers.camera_controller import masks_of
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.coverage import Dots, DotStore, unmasked
from spherecal_gui.languages import translate
from spherecal_gui.project import Project, Rectangle
from spherecal_gui.project_folder import Document, require_project, taken_in
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.task import BackgroundTask

if TYPE_CHECKING:  # cameras and detection need scipy and numba, for which the window does not wait
    import numpy as np
    from numpy.typing import NDArray

    from spherecal_cameras.capture import SessionCamera
    from spherecal_gui.controllers.controller import Controller
    from spherecal_gui.recorded_sets import RecordedSession
    from spherecal_gui.tasks.live_detection import Connection


class RecordingController(ControllerPart):
    """The session folders of the open project: `session` of the calibration, `check_session` of the check bars."""

    def __init__(self, main: "Controller") -> None:
        super().__init__(main)
        self.session: RecordedSession | None = None
        self.check_session: RecordedSession | None = None
        self._store: DotStore | None = None
        self._found: dict[str, Mapping[str, Dots]] = {}  # before masks
        self._clear: dict[str, tuple[object, object, Mapping[str, Dots]]] = {}
        self._small: dict[str, Mapping[str, NDArray[np.uint8]]] = {}  # of placements, since it was opened
        self._left: dict[str, list[Rectangle]] = {}  # spots that somebody wants to leave as they are
        self.spots: dict[str, tuple[Rectangle, ...]] = {}  # proposed as masks, by camera
        main.cameras.connected.connect(self._open_folders)

    def load(self, project: Project) -> None:
        """Take up the dots that are kept with a project."""
        self._store = DotStore(project.folder)
        loaded = {name: self._store.load(name, at) for name, at in project.taken.items()}
        self._found = {name: dots for name, dots in loaded.items() if dots is not None}

    def close(self) -> None:
        """Forget what was recorded; all is on disk already."""
        self.session, self.check_session, self._store = None, None, None
        self._found, self._clear, self._small, self._left, self.spots = {}, {}, {}, {}, {}

    # --- session folders ---------------------------------------------------------------------------------------------

    def confirm_bench(self) -> None:
        """Somebody has looked: what the page says is what is on the bench."""
        connection = self.main.cameras.connection
        if self.project is None or connection is None:
            return
        artefacts = jobs.artefacts_of(connection.plan)
        if artefacts is None:
            text = translate("Connect", "It is not known which targets are on the ball.")
            self.main.tell("bad", text, translate("Connect", "Choose the file that describes the bench."))
            return
        self.main.change(artefacts=artefacts)
        self._open_folders()

    def _open_folders(self) -> None:
        """Make or take up the session folders of the calibration and of the check bars, of a confirmed bench."""
        project, connection = self.project, self.main.cameras.connection
        if project is None or connection is None or project.artefacts is None:
            return
        try:
            self.session = _session_of(project, connection)
            self.session.start()
            if project.check_poses:
                self._open_checks(project, connection)
            if (taken := taken_in(project.folder)) != project.taken:  # a set whose retaking was cut short is back
                self.main.update(replace(self.project or project, taken=taken))
            self.find_lost_dots()
        except Exception as error:
            self.session = self.check_session = None
            self.main.failed("connect")(error)
        self.main.changed.emit()

    def outline(self) -> Document:
        """What session.json says, or would say, of cameras and bench."""
        project, connection = self.project, self.main.cameras.connection
        assert project is not None and connection is not None
        return (self.session or _session_of(project, connection)).document()

    def _open_checks(self, project: Project, connection: "Connection") -> None:
        """Make or take up the session folder of the check bars."""
        self.check_session = _session_of(project, connection, of_checks=True)
        self.check_session.start()

    def plan_checks(self, project: Project) -> None:
        """Have the check bars' folder take the poses that a changed project has."""
        connection = self.main.cameras.connection
        if connection is not None and self.check_session is not None:
            planned = jobs.calibration_plan(connection.plan, project.check_poses, dict(project.pose_bars))
            self.check_session.plan_instead(planned.sets)
        elif connection is not None and self.session is not None:
            self.main.attempt(lambda: self._open_checks(project, connection))

    def folder_of(self, set_id: str) -> "RecordedSession | None":
        """The session folder that a set is in: of the check bars, or of the calibration."""
        checks = self.project.check_poses if self.project is not None else ()
        return self.check_session if set_id in checks else self.session

    def image_path(self, set_id: str, camera: str) -> Path | None:
        """The image that a camera took of a set; None where it took none."""
        folder = self.folder_of(set_id)
        return folder.images(set_id).get(camera) if folder is not None else None

    # --- dots --------------------------------------------------------------------------------------------------------

    @property
    def dots(self) -> dict[str, Mapping[str, Dots]]:
        """The dots of every set taken, by camera, without those that lie in masks."""
        masks = self.project.masks if self.project is not None else ()
        for name, found in self._found.items():
            known = self._clear.get(name)
            if known is None or known[0] is not found or known[1] != masks:
                project = self.project
                assert project is not None
                clear = {camera: unmasked(one, masks_of(project, camera)) for camera, one in found.items()}
                self._clear[name] = (found, masks, clear)
        return {name: self._clear[name][2] for name in self._found}

    def keep_dots(self, set_id: str, at: str, dots: Mapping[str, Dots]) -> None:
        """Keep what was found in a set, on disk as well."""
        if self._store is not None:
            self._store.save(set_id, at, dots)
            self._found[set_id] = dots

    def drop_dots(self, set_id: str) -> None:
        """Forget the dots of a set that was put aside."""
        self._found.pop(set_id, None)
        self._small.pop(set_id, None)

    def restore_dots(self, set_id: str) -> None:
        """Take up the dots of a set that was brought back; where the store has them no more, detect them again."""
        assert self.project is not None
        loaded = self._store.load(set_id, self.project.taken[set_id]) if self._store else None
        self._found.pop(set_id, None)
        if loaded is not None:
            self._found[set_id] = loaded
        else:
            self.find_lost_dots()

    def find_lost_dots(self) -> None:
        """Detect again what the store does not have; counters are as they were."""
        project, connection = self.project, self.main.cameras.connection
        if project is None or connection is None:
            return
        lost = {name: self.folder_of(name) for name in project.taken if name not in self._found}
        images = {name: folder.images(name) for name, folder in lost.items() if folder is not None}
        plan = connection.plan
        if not images or jobs.artefacts_of(plan) is None:
            return

        def work(context: Context) -> dict[str, Mapping[str, Dots]]:
            return {name: jobs.dots_of_images(paths, plan, context) for name, paths in images.items()}

        self.runner.start("connect", work, self._dots_found, self.main.failed("connect"))

    def _dots_found(self, found: dict[str, Mapping[str, Dots]]) -> None:
        self._found |= found
        if self.project is not None and self._store is not None:
            for name, dots in found.items():
                self._store.save(name, self.project.taken.get(name, ""), dots)
        self.main.changed.emit()

    # --- masks -------------------------------------------------------------------------------------------------------

    def mask(self, serial: str, rectangle: Rectangle) -> None:
        """Nothing in this part of a camera's image is a target from now on, in what was taken as well."""
        if self.project is not None and serial in self.main.cameras.names:
            self._with_masks(changes.with_mask(self.project, self.main.cameras.names[serial], rectangle))

    def look_for_spots(self, set_id: str, small: "Mapping[str, NDArray[np.uint8]]") -> None:
        """A set was taken, with these images by camera: propose masks over what stays where the ball was moved."""
        from spherecal.targets.staying_spots import staying_spots  # needs OpenCV

        if self.project is None or set_id not in self.project.placements or self.project.by_board:
            return
        self._small[set_id] = small
        self.spots = {}
        for camera in small:
            sets = [name for name, of in self._small.items() if camera in of and camera in self._found.get(name, {})]
            uv = [(self._found[name][camera].uv + 0.5) / jobs.SMALLER - 0.5 for name in sets]
            found = staying_spots([self._small[name][camera] for name in sets], uv)
            known = [*masks_of(self.project, camera), *self._left.get(camera, ())]
            new = tuple(one for one in (_larger(spot) for spot in found) if not any(_meet(one, k) for k in known))
            if new:
                self.spots[camera] = new

    def mask_spots(self) -> None:
        """Take the masks that are proposed."""
        project, spots, self.spots = self.project, self.spots, {}
        if project is not None:
            for camera, rectangle in ((camera, one) for camera, some in spots.items() for one in some):
                project = changes.with_mask(project, camera, rectangle)
            self._with_masks(project)

    def leave_spots(self) -> None:
        """They are no reflections: propose them no more."""
        for camera, some in self.spots.items():
            self._left.setdefault(camera, []).extend(some)
        self.spots = {}
        self.main.changed.emit()

    def undo_mask(self) -> None:
        """Take the mask back that was drawn last."""
        if self.project is not None:
            self._with_masks(replace(self.project, masks=self.project.masks[:-1]))

    def clear_masks(self) -> None:
        """Take all masks back."""
        if self.project is not None:
            self._with_masks(replace(self.project, masks=()))

    def _with_masks(self, project: Project) -> None:
        """On disk first: wizard.json, then the two session folders that calibration and verification read."""
        self.main.update(project)
        self.main.cameras.apply_masks(project)
        connection = self.main.cameras.connection
        for folder in (self.session, self.check_session):
            if folder is not None and connection is not None:
                self.main.attempt(lambda folder=folder: folder.set_cameras(_masked_cameras(project, connection)))
        self.main.changed.emit()


def _larger(spot: Rectangle) -> Rectangle:
    """A rectangle of the small image in px of the whole one."""
    left, top, width, height = (jobs.SMALLER * one for one in spot)
    return left + (jobs.SMALLER - 1) / 2, top + (jobs.SMALLER - 1) / 2, width, height


def _meet(a: Rectangle, b: Rectangle) -> bool:
    return all(abs(2 * (a[k] - b[k]) + a[k + 2] - b[k + 2]) <= a[k + 2] + b[k + 2] for k in (0, 1))


def _session_of(project: Project, connection: "Connection", of_checks: bool = False) -> "RecordedSession":
    """The session folder of the calibration, or of the check bars; nothing is on disk yet."""
    from spherecal_gui.recorded_sets import RecordedSession  # needs scipy and numba

    folder, sets, bars = project.folder, project.sets, {}
    if of_checks:
        folder, sets, bars = project.verification_folder, project.check_poses, dict(project.pose_bars)
    plan = jobs.calibration_plan(connection.plan, sets, bars)
    return RecordedSession(folder, plan, _masked_cameras(project, connection), connection.source)


def _masked_cameras(project: Project, connection: "Connection") -> "tuple[SessionCamera, ...]":
    """The cameras as session.json has them, with their masks."""
    cameras = []
    for camera in connection.cameras:
        entry = {key: value for key, value in camera.entry.items() if key != "ignore"}
        masks = [list(one) for one in masks_of(project, camera.id)]
        cameras.append(replace(camera, entry={**entry, "ignore": masks} if masks else entry))
    return tuple(cameras)


class SetController(ControllerPart):
    """What is done with placements and poses."""

    _taking: tuple[str, BackgroundTask | None] = ("", None)

    @property
    def taking(self) -> str | None:
        """The set whose images are being taken; None where none is."""
        set_id, task = self._taking
        return set_id if task is not None and task is self.runner.task else None

    def take(self, set_id: str, step: str) -> bool:
        """Take a set, or take it again; False where that is not possible now."""
        folder = self.main.recording.folder_of(set_id)
        self.main.look_for_folder()
        if self.main.cameras.connection is None or folder is None or self.project is None or self.main.gone:
            return False
        self.main.update(changes.without_failure(self.project, step))
        project_folder = self.project.folder
        connection, real = self.main.cameras.connection, not self.main.cameras.staged_poses
        warm = self.project.bar_celsius if set_id in self.project.check_poses else None

        def work(context: Context) -> jobs.Taken:
            taken = jobs.take_set(connection, set_id, context, real)
            context.report("writing the images", 0.9, set_id)
            require_project(project_folder)
            if warm is not None:
                folder.plan_anew(set_id, warm)
            folder.add(folder.planned(set_id), taken.frames, taken.stillness)
            return taken

        begun = self.runner.start(step, work, self._set_taken, self.main.failed(step))
        if begun:
            self._taking = (set_id, self.runner.task)
        return begun

    def _set_taken(self, taken: jobs.Taken) -> None:
        folder, connection = self.main.recording.folder_of(taken.set_id), self.main.cameras.connection
        if self.project is None or folder is None or connection is None:
            return
        at = folder.taken_at(taken.set_id)
        self.main.recording.keep_dots(taken.set_id, at, taken.dots)
        self.main.recording.look_for_spots(taken.set_id, taken.small)
        names = connection.names
        lacking = tuple(names[one.camera] for one in taken.frames.missing)
        moving = tuple(names[serial] for serial, one in taken.stillness.items() if not one.still)
        flaws: dict[changes.FlawCode, tuple[str, ...]] = {"taken without": lacking, "taken moving": moving}
        self.main.update(changes.with_set(self.project, taken.set_id, at, flaws))
        missing, moved = languages.listed(lacking), languages.listed(moving)
        if missing:
            text = translate("Placement", "{name} is captured, but without {cameras}.")
            text = text.format(name=taken.set_id, cameras=missing)
            self.main.tell("bad", text, translate("Placement", "Check these cameras, then retake it."))
        elif moved:
            text = translate("Placement", "{name} is captured, but {cameras} saw it move.")
            text = text.format(name=taken.set_id, cameras=moved)
            self.main.tell("bad", text, translate("Placement", "Let it come to rest, then retake it."))
        else:
            self.main.tell("good", translate("Placement", "{name} is captured.").format(name=taken.set_id))

    def delete(self, set_id: str) -> None:
        """Put a set aside."""
        folder = self.main.recording.folder_of(set_id)
        if folder is None or self.project is None or self.runner.running:
            return
        if not self.main.attempt(lambda: folder.remove(set_id)):
            return
        self.main.recording.drop_dots(set_id)
        self.main.update(changes.without_set(self.project, set_id))

    @property
    def can_undo(self) -> str | None:
        """The set that `undo` would bring back."""
        session = self.main.recording.session
        return session.can_undo if session is not None else None

    def undo(self) -> None:
        """Bring back the set that was deleted or replaced last."""
        session = self.main.recording.session
        if session is None or self.project is None or self.runner.running:
            return
        brought: list[str | None] = []
        if not self.main.attempt(lambda: brought.append(session.undo())) or brought[0] is None:
            return
        set_id = brought[0]
        self.main.update(replace(self.project, taken=taken_in(self.project.folder)))
        self.main.recording.restore_dots(set_id)

    def add_placement(self) -> None:
        """Plan one more placement and go there."""
        from spherecal_cameras.plan import PlannedSet  # needs scipy

        session = self.main.recording.session
        if self.project is None or session is None:
            return
        project = changes.with_another_placement(self.project)
        session.plan_more(PlannedSet(project.placements[-1]))
        self.main.update(replace(project, step=f"placement:{project.placements[-1]}"))
