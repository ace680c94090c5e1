"""Findings: what, where, what to do, and the buttons that do it; above them what is mended already."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QHBoxLayout, QScrollArea, QVBoxLayout, QWidget

from spherecal_gui import theme
from spherecal_gui.presenters.results_presenter import Action, FindingAdvice, repair_text
from spherecal_gui.widgets.basic import add, bare, button, clear, details_button, label, spaced
from spherecal_gui.widgets.icons import level_pixmap


class FindingsList(QScrollArea):
    """All findings, errors first; `asked` (kind, target) when a button is pressed, `taken_back` for a repair."""

    asked = Signal(str, str)
    taken_back = Signal(str, str)

    def __init__(self) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        self._inner = QWidget()
        self._column = QVBoxLayout(self._inner)
        self._column.setSpacing(theme.SMALL)
        self.setWidget(self._inner)
        self.shown: list[FindingAdvice] = []
        self.repairs: tuple[tuple[str, str], ...] = ()
        self._worn: tuple[theme.Colours, float] | None = None

    def show_advice(self, advice: list[FindingAdvice], repairs: tuple[tuple[str, str], ...] = ()) -> None:
        """Show these findings, and the repairs that were asked for."""
        look = theme.now(), theme.pt(1.0)  # marks are pictures in the colours and the size of the look
        if (advice, repairs, look) == (self.shown, self.repairs, self._worn) and self._column.count():
            return
        self.shown, self.repairs, self._worn = advice, repairs, look
        clear(self._column)
        for option, value in repairs:
            self._column.addWidget(self._repair(option, value))
        if not repairs and all(one.level == "none" for one in advice):
            self._column.addWidget(label(self.tr("Nothing to complain about."), "big", level="good"))
        for one in advice:
            self._column.addWidget(self._row(one))
        self._column.addStretch(1)

    def _row(self, one: FindingAdvice) -> QWidget:
        box = QWidget()
        mark = label("", "", wrap=False)
        tint = theme.now().soft if one.level == "none" else None
        mark.setPixmap(level_pixmap(one.level, theme.pt(20), tint))
        words, folded = spaced(QVBoxLayout(), 2), QWidget()
        more = bare(QVBoxLayout(folded), 2)
        named = self.tr("{title}: {where}").format(title=one.title, where=one.where) if one.where else one.title
        first = add(QHBoxLayout(), (label(named, "big" if one.level != "none" else "", level=one.level), 1))
        words.addLayout(first)
        todo = more if one.level == "none" else words  # what asks for nothing stays one line
        if one.hint:
            todo.addWidget(label(one.hint))
        if one.actions:
            todo.addLayout(add(QHBoxLayout(), *map(self._button, one.actions), None))
        if one.message:
            more.addWidget(label(one.message, "soft"))
        if more.count():
            add(first, (details_button(folded), Qt.AlignmentFlag.AlignTop))
        words.addWidget(folded)
        add(bare(QHBoxLayout(box)), (mark, Qt.AlignmentFlag.AlignTop), theme.SMALL, (words, 1))
        return box

    def _button(self, action: Action) -> QWidget:
        done = (action.kind, action.target) in self.repairs
        do = button(action.text, f"finding-{action.kind.lstrip('-')}")
        do.clicked.connect(lambda: self.asked.emit(action.kind, action.target))
        do.setEnabled(not done)
        do.setToolTip(self.tr("It is already requested: calibrate again.") if done else "")
        return do

    def _repair(self, option: str, value: str) -> QWidget:
        box = QWidget()
        message = self.tr("Asked for: {repair}").format(repair=repair_text(option, value))
        back = button(self.tr("Take back"), "take-back", act=lambda: self.taken_back.emit(option, value))
        add(bare(QHBoxLayout(box)), (label(message, "big", level="caution"), 1), back)
        return box
