"""Findings: what, where, what to do, and the buttons that do it; above them what is mended already."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QHBoxLayout, QScrollArea, QVBoxLayout, QWidget

from spherecal_gui import theme
from spherecal_gui.presenters.results_presenter import Action, FindingAdvice, repair_text
from spherecal_gui.widgets.basic import bare, button, clear, details_button, label, set_level
from spherecal_gui.widgets.icons import level_pixmap


class FindingsList(QScrollArea):
    """All findings, errors first; `asked` (kind, target) when a button is pressed, `taken_back` for a repair."""

    asked = Signal(str, str)
    taken_back = Signal(str, str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
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
            nothing = label(self.tr("Nothing to complain about."), "big", level="good")
            self._column.addWidget(nothing)
        for one in advice:
            self._column.addWidget(self._row(one))
        self._column.addStretch(1)

    def _row(self, one: FindingAdvice) -> QWidget:
        box = QWidget()
        row = bare(QHBoxLayout(box))
        mark = label("", "", wrap=False)
        tint = theme.now().soft if one.level == "none" else None
        mark.setPixmap(level_pixmap(one.level, theme.pt(20), tint))
        row.addWidget(mark, 0, Qt.AlignmentFlag.AlignTop)
        row.addSpacing(theme.SMALL)
        words, folded = QVBoxLayout(), QWidget()
        words.setSpacing(2)
        more = bare(QVBoxLayout(folded), 2)
        named = self.tr("{title}: {where}").format(title=one.title, where=one.where) if one.where else one.title
        title = label(named, "big" if one.level != "none" else "")
        set_level(title, one.level)
        first = QHBoxLayout()
        first.addWidget(title, 1)
        words.addLayout(first)
        todo = more if one.level == "none" else words  # what asks for nothing stays one line
        if one.hint:
            todo.addWidget(label(one.hint))
        if one.actions:
            buttons = QHBoxLayout()
            for action in one.actions:
                buttons.addWidget(self._button(action))
            buttons.addStretch(1)
            todo.addLayout(buttons)
        if one.message:
            more.addWidget(label(one.message, "soft"))
        if more.count():
            first.addWidget(details_button(folded), 0, Qt.AlignmentFlag.AlignTop)
        words.addWidget(folded)
        row.addLayout(words, 1)
        return box

    def _button(self, action: Action) -> QWidget:
        done = (action.kind, action.target) in self.repairs
        do = button(action.text, f"finding-{action.kind.lstrip('-')}")
        do.setProperty("asks", [action.kind, action.target])
        do.setEnabled(not done)
        do.setToolTip(self.tr("It is already requested: calibrate again.") if done else "")
        do.clicked.connect(self._pressed)
        return do

    def _repair(self, option: str, value: str) -> QWidget:
        box = QWidget()
        row = bare(QHBoxLayout(box))
        message = label(self.tr("Asked for: {repair}").format(repair=repair_text(option, value)), "big")
        set_level(message, "caution")
        row.addWidget(message, 1)
        back = button(self.tr("Take back"), "take-back")
        back.setProperty("asks", [option, value])
        back.clicked.connect(self._back)
        row.addWidget(back)
        return box

    def _pressed(self) -> None:
        sender = self.sender()
        if sender is not None:
            kind, target = sender.property("asks")
            self.asked.emit(kind, target)

    def _back(self) -> None:
        sender = self.sender()
        if sender is not None:
            option, value = sender.property("asks")
            self.taken_back.emit(option, value)
