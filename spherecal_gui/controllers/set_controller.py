"""Placements and bar poses: taken, taken again, deleted, brought back."""

from dataclasses import replace

from spherecal.base.context import Context
from spherecal_gui import languages
from spherecal_gui import project as changes
from spherecal_gui.controllers.project_controller import ControllerPart
from spherecal_gui.languages import translate
from spherecal_gui.project_folder import require_project, taken_in
from spherecal_gui.tasks import jobs
from spherecal_gui.tasks.task import BackgroundTask


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
