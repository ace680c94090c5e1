"""What a verification found: word, sentence, errors with limits and guard bands, lengths, budget."""

from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import QHBoxLayout, QSplitter, QTabWidget

from spherecal_documents.scene.model import SceneData
from spherecal_gui import theme
from spherecal_gui.presenters.bars_presenter import (
    budget_cells,
    camera_cells,
    errors_of,
    length_cells,
    rule_text,
)
from spherecal_gui.presenters.results_presenter import bar_verdict
from spherecal_gui.standing import Level
from spherecal_gui.widgets.basic import Card, add, label
from spherecal_gui.widgets.charts import ErrorChart
from spherecal_gui.widgets.scene_panel import ScenePanel
from spherecal_gui.widgets.table import Table

if TYPE_CHECKING:  # imports scipy
    from spherecal_files.verification_file import BarReport

_LEAST_PX = 40  # of the plot
_LOWEST_PX = -20  # two lines more, and it leaves its room to the tables
_MOST, _MOST_CAMERAS, _MOST_FROM_AFAR = 4, 8, 1  # rows in sight at 1280 x 800; the plot gives way to the cameras


class VerificationView(QSplitter):
    """Above the verdict and the plot, below the tables."""

    def __init__(self) -> None:
        super().__init__(Qt.Orientation.Vertical)
        self.words = ("", "none")  # verdict and level
        self._explained = self._measured = False
        self._low_px, self._rows_px = _LEAST_PX, (0, 0)  # the tables' height with one row, and with all that matter
        outcome = Card()
        self.word = label("", "huge", wrap=False)
        self.word.setMinimumWidth(240)
        self.sentence = label("", "big")
        for watched in (outcome, self.sentence):  # another text is asked of the card, another width of the label
            watched.installEventFilter(self)
        self.rule = label("", "soft")
        self.errors = ErrorChart()
        self.panel = ScenePanel()
        self.pictures = QTabWidget()
        self.pictures.addTab(self.errors, self.tr("Errors"))
        self.pictures.addTab(self.panel, self.tr("In space"))
        words = add(QHBoxLayout(), self.word, 14, (self.sentence, 1))
        add(outcome.body, words, (self.pictures, 1), self.rule)
        self.tables = QTabWidget()
        headings = [
            self.tr("Length"), self.tr("n"), self.tr("mean error, mm"), self.tr("sd, mm"), self.tr("largest, mm"),
            self.tr("±, mm"), self.tr("limit, mm"), self.tr("decision"),
        ]  # fmt: skip
        self.table = Table(headings)
        headings = [
            self.tr("Length"), self.tr("contribution"), self.tr("u, mm"), self.tr("share"),
            self.tr("what would help most"),
        ]  # fmt: skip
        self.budget = Table(headings, sortable=False)
        self.cameras = Table(
            [self.tr("Camera"), self.tr("views of marks"), self.tr("used"), self.tr("rms, px"), self.tr("state")]
        )
        self.tables.addTab(self.table, self.tr("Lengths"))
        self.tables.addTab(self.cameras, self.tr("Cameras"))
        self.tables.addTab(self.budget, self.tr("Budget"))
        self.tables.currentChanged.connect(self._fit_tables)
        for number, (part, stretch) in enumerate(((outcome, 3), (self.tables, 2))):
            self.addWidget(part)
            self.setStretchFactor(number, stretch)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """A splitter does not ask how high a sentence is in its width; without this its first line was cut off."""
        if event.type() == (QEvent.Type.Resize if watched is self.sentence else QEvent.Type.LayoutRequest):
            self._give_room()
        return super().eventFilter(watched, event)

    def _give_room(self) -> None:
        self.sentence.setMinimumHeight(max(self.sentence.heightForWidth(self.sentence.width()), 0))
        few = self.sentence.minimumHeight() < 3 * self.sentence.fontMetrics().lineSpacing()
        self.rule.setVisible((few or not theme.is_far()) and self._explained)
        more = max(self.sentence.minimumHeight() - self.sentence.fontMetrics().lineSpacing(), 0)
        far = theme.is_far()  # then the tables scroll, else the plot is lower
        self.tables.setMinimumHeight(max(self._rows_px[0], self._rows_px[1] - (more if far else 0)))
        low = max(self._low_px - (0 if far else more), _LEAST_PX)
        self.pictures.setVisible(self._measured and (far or self._low_px - more >= _LOWEST_PX))
        self.errors.setMinimumHeight(low)
        self.panel.view.setMinimumSize(200, low)

    def show_rig(self, data: SceneData | None) -> None:
        """The bars in the rig."""
        self.pictures.setTabEnabled(1, data is not None)
        self.panel.show_scene(data)

    def show_bars(self, bars: "BarReport", stale: bool) -> None:
        """Show a verification."""
        verdict = bar_verdict(bars)
        between = "\n" if theme.is_far() else "  "  # in one line it would leave the sentence no room
        word = between.join([verdict.word, self.tr("(out of date)")]) if stale else verdict.word
        self.words: tuple[str, Level] = (word, "caution" if stale else verdict.level)
        self.sentence.setText(verdict.sentence)
        self._measured = bool(bars.measured)  # else axes without anything on them
        self._give_room()
        self.errors.show_errors(errors_of(bars))
        self.rule.setText(rule_text(bars))
        self.table.fill([[*map(_cell, row)] for row in length_cells(bars)])
        self.cameras.fill(camera_cells(bars))
        self.budget.fill(budget_cells(bars))
        self._fit_tables()

    def _fit_tables(self) -> None:
        """Room for the rows of the table that is shown, as far as the plot can spare it."""
        most = _MOST_FROM_AFAR if theme.is_far() else _MOST_CAMERAS if self.tables.currentIndex() == 1 else _MOST
        rows = min(self.cameras.rowCount() if self.tables.currentIndex() == 1 else self.table.rowCount(), most)
        low = 60 if most == _MOST_CAMERAS else 100  # the tables need room at 800 px
        self._low_px, self._explained = low, low == 100 and self._measured
        row, head = self.table.verticalHeader().defaultSectionSize(), self.table.horizontalHeader().sizeHint().height()
        none = self.tables.tabBar().sizeHint().height() + head + 6
        self._rows_px = none + min(rows, 1) * row, none + rows * row
        self._give_room()


def _cell(text: str) -> tuple[str, float | str, str]:
    """A number is sorted by its value."""
    try:
        return text, float(text), ""
    except ValueError:
        return text, text, ""
