"""Connect: the cameras that were found, and what is on the bench."""

from dataclasses import replace

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QComboBox, QFileDialog, QGridLayout, QHBoxLayout, QVBoxLayout, QWidget

from spherecal_gui import languages, theme
from spherecal_gui.controllers.controller import Controller
from spherecal_gui.pages.connect_dialogs import CameraDialog, DriversPanel
from spherecal_gui.pages.live_page import RigSpace
from spherecal_gui.pages.wizard_page import Page
from spherecal_gui.presenters.connect_presenter import (
    LENSES_MM,
    BenchRow,
    CameraLine,
    LensLine,
    bench_rows,
    camera_lines,
    connect_summary,
    drawn_bench,
    lens_line,
    recording_text,
)
from spherecal_gui.presenters.drivers_presenter import DriverNote, driver_notes, network_notes
from spherecal_gui.presenters.step_states import ConnectFacts, connect_says
from spherecal_gui.standing import Said
from spherecal_gui.tasks.jobs import artefacts_of
from spherecal_gui.widgets.basic import (
    MARKS,
    Card,
    Downwards,
    Elided,
    add,
    bare,
    button,
    clear,
    enable,
    label,
    named,
    option,
    plain,
    say,
    set_level,
    spaced,
)
from spherecal_gui.widgets.connect_views import BenchView, Thumbnail
from spherecal_gui.widgets.fields import number_field

_ROOMY_PX = 1200
_BENCH_PT = 237  # what its rows need in two lines at most; Chinese has no wide word that would ask for it
_BESIDE_SCENE = 4  # ... that leave room for the scene below them
_ONE_COLUMN = 7  # rows of cameras that a screen of 800 px shows one below the other


class CameraRow(QWidget):
    """One camera: whether it is in the rig, its live picture, what it is, how it is, and what cures it."""

    def __init__(self, page: "ConnectPage", line: CameraLine, narrow: bool) -> None:
        super().__init__(page)
        self.line, self._page = line, page
        row = bare(spaced(QGridLayout(self), theme.SMALL, 0))
        row.setColumnStretch(2, 1)
        says = self.tr("{name} in this rig").format(name=line.name)
        tip = self.tr("In this rig: whoever is left out is not opened and hinders nobody.")
        self.in_rig = named(option(""), f"in-rig-{line.name}", says, tip)
        self.in_rig.clicked.connect(lambda on: page.controller.cameras.set_in_rig(self.line.serial, on))
        self.picture = Thumbnail()
        self.picture.clicked.connect(lambda: page.open_camera(self.line.serial))
        self.picture.setFixedSize(int(theme.pt(60 if narrow else 76)), int(theme.pt(45 if narrow else 57)))
        self.name = Elided("", "big")
        self.about = Elided("", "soft")
        self.word = label("")  # what to do about it, in full
        tip = self.tr("Its picture, its name, exposure and gain; its light, where it has one.")
        self.which = button(self.tr("Which is it?"), f"camera-{line.name}", "link" if narrow else "", tip=tip)
        if narrow:
            self.which.setText("?")
        self.which.clicked.connect(lambda: page.open_camera(self.line.serial))
        tip = self.tr("A free one of this computer's network, kept in the camera.")
        text = self.tr("Address") if narrow else self.tr("Give it an address")
        self.cure = button(text, f"cure-{line.name}", act=self._cure, tip=tip)
        row.addWidget(self.in_rig, 0, 0, 3, 1)
        row.addWidget(self.picture, 0, 1, 3, 1)
        for number, words in enumerate((self.name, self.about)):
            row.addWidget(words, number, 2)
        row.addWidget(self.which, 0, 3, 2, 1, Qt.AlignmentFlag.AlignVCenter)
        row.addWidget(self.cure, 0, 3, 2, 1, Qt.AlignmentFlag.AlignVCenter)
        row.addWidget(self.word, 2, 2, 1, 2)

    def show_line(self, line: CameraLine) -> None:
        """Show how the camera is now."""
        self.line = line
        controller = self._page.controller
        connection, project = controller.cameras.connection, self._page.project
        ours = connection is not None and line.serial in connection.names
        self.name.setText(f"{MARKS[line.level]}  {line.name}")
        self.about.setText(" · ".join(part for part in (line.model, line.about) if part))
        self.word.setText("" if line.level == "good" else line.word)
        self.word.setVisible(line.level != "good")
        self.word.setToolTip(plain(line.details or line.word))
        for part in (self.name, self.word):
            set_level(part, line.level if line.level in ("bad", "caution") else "none")
        for part in (self.name, self.about, self.word):
            part.setEnabled(line.in_rig)
        self.show_picture()
        self.picture.show_past(line.level == "bad")
        self.in_rig.setVisible(line.listed and project is not None and project.source.startswith("genicam"))
        self.in_rig.setChecked(line.in_rig)
        taken = project is not None and bool(project.taken)
        busy = controller.runner.running is not None
        why = self.tr("Placements are captured already: begin a new calibration.") if taken else ""
        enable(self.in_rig, not taken and not busy, why or self.tr("Work is running."))
        self.which.setVisible(ours)
        narrow = self.which.text() == "?"
        self.cure.setVisible(line.cured_at is not None or line.builtin)
        if line.builtin:
            self.cure.setText(self.tr("Driver") if narrow else self.tr("Use the built-in driver"))
            self.cure.setToolTip(self.tr("For GigE and USB3 Vision cameras of any maker."))
        self.cure.setEnabled(not busy)

    def show_picture(self) -> None:
        """The picture, or its room where the camera is left out; neither on a small screen with large text."""
        policy = self.picture.sizePolicy()
        policy.setRetainSizeWhenHidden(self._page.has_room)
        self.picture.setSizePolicy(policy)
        self.picture.setVisible(self._page.has_room and self.line.in_rig)

    def follow(self) -> None:
        """Show the newest image and the dots in it."""
        live = self._page.controller.cameras.live
        frame = live.frame(self.line.serial) if live is not None and self.line.in_rig else None
        if live is None or frame is None:
            return
        self.picture.show_image(frame.image, frame.bits, frame.arrived_s)
        sight = live.sight(self.line.serial)
        if sight is not None:
            self.picture.show_dots(sight.dots.uv, sight.dots.image_size)

    def _cure(self) -> None:
        if self.line.builtin:
            self._page.controller.cameras.use_builtin_driver()
        elif self.line.cured_at is not None:
            self._page.controller.cameras.give_address(self.line.cured_at)


class LensBar(QWidget):
    """The lenses of all cameras in one line: a focal length, or that nobody knows it; the pixel pitch."""

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self._controller = controller
        tip = self.tr("On the lens. Not known: the calibration finds it from the ball.")
        self.focal = named(QComboBox(), "lens-focal", self.tr("Focal length of all lenses"), tip)
        self.focal.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.focal.setMinimumContentsLength(8)
        self.focal.addItem(self.tr("not known: found from the ball"), None)
        for length in LENSES_MM:
            self.focal.addItem(languages.by_locale(f"{length:g} mm"), length)
        tip = self.tr("From the camera or its data sheet; only needed with a focal length in mm.")
        self.pitch = number_field("lens-pitch", self.tr("Pixel pitch"), (0.0, 50.0), "µm", step=0.05, tip=tip)
        self.pitch.setKeyboardTracking(False)
        self._words = label(self.tr("All lenses"), "soft", wrap=False)
        self._of_pitch = label(self.tr("pixels"), "soft", wrap=False)
        add(bare(QHBoxLayout(self)), self._words, (self.focal, 1), self._of_pitch, self.pitch)
        self.focal.activated.connect(self._set)
        self.pitch.valueChanged.connect(self._set)

    def show_lenses(self, line: LensLine | None, why_not: str) -> None:
        """Show what is stated. `line` None: nothing is to be stated here."""
        self.setVisible(line is not None)
        if line is None:
            return
        at, found = self.focal.findData(line.focal_mm), ", ".join(f"{one:g}" for one in line.found_um)
        with QSignalBlocker(self.focal), QSignalBlocker(self.pitch):
            if at < 0 and line.focal_mm is not None:
                self.focal.addItem(languages.by_locale(f"{line.focal_mm:g} mm"), line.focal_mm)
                at = self.focal.count() - 1
            self.focal.setCurrentIndex(-1 if line.differ else at)
            self.pitch.setValue(line.pitch_um or 0.0)
        self.focal.setPlaceholderText(self.tr("different ones"))
        self.pitch.setSpecialValueText(languages.by_locale(f"{found} µm") if found else self.tr("not known"))
        needed = line.focal_mm is not None and not found and not line.pitch_um
        set_level(self._of_pitch, "bad" if needed else "none")
        for field in (self.focal, self.pitch):
            enable(field, not why_not, why_not)

    def _set(self) -> None:
        self._controller.cameras.set_lenses(self.focal.currentData(), self.pitch.value() or None)


class ConnectPage(Page):
    """Two cards: cameras on the left, the bench on the right."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self.deeds = {"confirm": controller.recording.confirm_bench, "describe": self.bench_wanted.emit}
        self.dialog: CameraDialog | None = None
        self._shown: list[CameraLine] = []
        self._columns = 1
        self.cameras = Card(self.tr("Cameras"))
        self.headline = self.summary = label("", "big")
        self.again = button(self.tr("Search again"), "search-again", act=self.controller.cameras.connect_all)
        top = add(QHBoxLayout(), (self.summary, 1), (self.again, Qt.AlignmentFlag.AlignTop))
        self.why = label("", "soft")
        self.other = button(self.tr("Choose another"), "choose-recording", act=self.recording_wanted)
        add(self.cameras.body, top, self.why, (self.other, Qt.AlignmentFlag.AlignLeft))
        self.lenses = LensBar(controller)
        self._rows: dict[str, CameraRow] = {}
        inner, inside = QWidget(), QWidget()
        self._grid = bare(spaced(QGridLayout(inner), theme.PAD, theme.SMALL))
        self.drivers = DriversPanel()
        self.drivers.allowed.connect(self.controller.cameras.allow_driver)
        self.drivers.builtin.connect(self.controller.cameras.use_builtin_driver)
        self.network = DriversPanel(of_drivers=False)
        self.network.cured.connect(self.controller.cameras.cure_network)
        add(bare(QVBoxLayout(inside)), self.drivers, self.network, inner, None)
        self.space = RigSpace(controller)
        add(self.cameras.body, self.lenses, (Downwards(inside), 2), (self.space.view, 3))
        add(QHBoxLayout(self), (self.cameras, 5), (self._bench(), 2))

    def _bench(self) -> Card:
        """What should lie on the bench, and how that is chosen."""
        self.bench = Card(self.tr("On the bench"))
        hint = self.tr("Compare with what lies there: the targets' numbers, the names and lengths on the bars.")
        rows = QWidget()
        self._bench_rows, self.drawn = spaced(QVBoxLayout(), 12), BenchView()
        add(bare(QVBoxLayout(rows)), label(hint, "soft"), self._bench_rows, (self.drawn, 1))
        self.choose = button(self.tr("Choose another description"), "choose-bench", act=self._choose)
        self.describe = button(self.tr("Describe the bench"), "describe-bench", act=self.bench_wanted)
        self.describe.setToolTip(self.tr("Ball, targets, bars with their certificates, limits."))
        add(self.bench.body, (Downwards(rows), 1), self.describe, self.choose)
        return self.bench

    def show_project(self) -> None:
        """Show what is there."""
        project, connection = self.open_project, self.controller.cameras.connection
        running = self.controller.runner.running
        lines = self._lines()
        failure = project.failures.get("connect", "")
        wrong = recording_text(project.source) if failure else ""
        self.show_standing()
        say(self.why, failure if wrong else "")
        self.other.setVisible(bool(wrong))
        self.again.setVisible(not wrong)
        self.bench.setMinimumWidth(int(theme.pt(_BENCH_PT)) + 2 * theme.PAD)
        self._show_lines(lines)
        taken = self.tr("Placements are captured already: begin a new calibration.") if project.taken else ""
        self.lenses.show_lenses(lens_line(connection), taken or (self.tr("Work is running.") if running else ""))
        notes = [] if running == "connect" else self._notes()
        if notes and self.summary.text().startswith(notes[0].title):  # the headline says it, with the first step
            notes[0] = replace(notes[0], title="", steps=notes[0].steps[1:])
        self.drivers.show_notes(notes)
        all_well = not any(line.level == "bad" for line in lines)
        self.network.show_notes([] if running == "connect" else network_notes(self.controller.cameras.facts, all_well))
        self._show_bench(bench_rows(connection, project.artefacts))
        self.drawn.show_bench(drawn_bench(connection))
        self.again.setEnabled(running is None)
        self.describe.setEnabled(running is None)
        self.describe.setVisible(project.source.startswith("genicam"))  # else it would describe the real bench
        self.choose.setEnabled(running is None and not project.taken)
        wanted = self.tr("A session.json, or the folder of an earlier session.")
        too_late = self.tr("Placements are captured already: begin a new calibration for another bench.")
        self.choose.setToolTip(too_late if project.taken else wanted)

    def _lines(self) -> list[CameraLine]:
        expected = self.project.cameras if self.project is not None else ()
        cameras = self.controller.cameras
        return camera_lines(cameras.connection, expected, cameras.wire, cameras.builtin_helps)

    def _notes(self) -> list[DriverNote]:
        return driver_notes(self.controller.cameras.driver_troubles, builtin=self.controller.cameras.builtin)

    def tick(self) -> None:
        """States of cameras change by themselves."""
        if self.project is not None and self.controller.cameras.connection is not None:
            self.controller.cameras.take_in_again()
            if self._lines() != self._shown:
                self.refresh()
            for row in self._rows.values():
                row.follow()
            if self.has_room:
                seen = self.space.view.isHidden()
                self._follow_space()
                if seen != self.space.view.isHidden():
                    self.refresh()

    def _follow_space(self) -> None:
        """The rig in space, once it is known where its cameras are; without a bench nobody knows how large it is."""
        live, connection = self.controller.cameras.live, self.controller.cameras.connection
        if connection is None or artefacts_of(connection.plan) is None:
            return
        rows = {row.line.name: row for row in self._rows.values() if row.line.in_rig}
        found = {name: live.sight(row.line.serial) for name, row in rows.items()} if live is not None else {}
        self.space.follow(
            {name: sight for name, sight in found.items() if sight is not None},
            {name: row.line.level for name, row in rows.items()},
            {name: row.picture.image for name, row in rows.items() if row.picture.image is not None},
        )

    def pictures(self) -> tuple[Thumbnail, ...]:
        """The images of the rig's cameras, in the order of the list."""
        return tuple(row.picture for serial, row in self._rows.items() if serial in self.controller.cameras.names)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """With large text a small screen has no room for pictures."""
        super().resizeEvent(event)
        if not self.has_room:
            self.space.view.hide()
        for row in self._rows.values():
            row.show_picture()

    @property
    def has_room(self) -> bool:
        """Whether there is room for pictures."""
        return not theme.is_far() or self.width() > _ROOMY_PX

    def _show_lines(self, lines: list[CameraLine]) -> None:
        self._shown = lines
        most = _ONE_COLUMN if self.space.view.isHidden() else _BESIDE_SCENE
        columns = 1 if not self.has_room or len(lines) <= most else 2
        if [line.serial for line in lines] != list(self._rows) or columns != self._columns:
            clear(self._grid)
            self._columns = columns
            self._rows = {line.serial: CameraRow(self, line, narrow=columns > 1) for line in lines}
            below = -(-len(lines) // columns)
            self._grid.setVerticalSpacing(theme.SMALL if columns == 1 else theme.TIGHT)
            for number, row in enumerate(self._rows.values()):
                self._grid.addWidget(row, number % below, number // below)
            for number in range(2):
                self._grid.setColumnStretch(number, int(number < columns))
        for line in lines:
            self._rows[line.serial].show_line(line)

    def open_camera(self, serial: str) -> None:
        """One camera large, with what can be set at it."""
        if self.controller.cameras.connection is not None:
            if self.dialog is not None:  # not deleted on close: PySide crashes where its page goes at that very moment
                self.dialog.deleteLater()
            self.dialog = CameraDialog(self.controller, serial, self)
            self.dialog.show()

    def _show_bench(self, rows: list[BenchRow]) -> None:
        clear(self._bench_rows)
        for row in rows:
            box = QWidget()
            add(bare(QVBoxLayout(box), 0), label(row.title, "soft"), label(row.value, "big", level=row.level))
            self._bench_rows.addWidget(box)

    def _choose(self) -> None:
        path, _ = QFileDialog.getOpenFileName(
            self, self.tr("Description of the bench"), str(self.open_project.folder.parent), "session.json (*.json)"
        )
        if path:
            self.controller.cameras.choose_bench(path)

    def says(self) -> Said:
        """Whether the cameras are there and the bench is confirmed."""
        connection, running = self.controller.cameras.connection, self.controller.runner.running
        failure = self.open_project.failures.get("connect", "")
        notes = self._notes() if running != "connect" else []
        wrong = recording_text(self.open_project.source) if failure else ""
        summary = connect_summary(self._lines(), running == "connect", wrong or failure, notes)
        there, confirmed = connection is not None and bool(connection.names), self.open_project.artefacts is not None
        described = connection is None or artefacts_of(connection.plan) is not None
        return connect_says(ConnectFacts(summary, there, confirmed, running is not None, described))
