"""Findings: what, why, what to do, and the button that does it."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QScrollArea, QVBoxLayout, QWidget

from spherecal_gui.presenters.results import Advice
from spherecal_gui.widgets.basic import MARKS, button, clear, label, set_level


class FindingsList(QScrollArea):
    """All findings, errors first; `asked` (kind, target) when a button is pressed."""

    asked = Signal(str, str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWidgetResizable(True)
        self._inner = QWidget()
        self._column = QVBoxLayout(self._inner)
        self._column.setSpacing(12)
        self.setWidget(self._inner)
        self.shown: list[Advice] = []

    def show_advice(self, advice: list[Advice]) -> None:
        """Show these findings."""
        self.shown = advice
        clear(self._column)
        if not advice:
            nothing = label(self.tr("Nothing to complain about."), "big")
            set_level(nothing, "good")
            self._column.addWidget(nothing)
        for one in advice:
            self._column.addWidget(self._row(one))
        self._column.addStretch(1)

    def _row(self, one: Advice) -> QWidget:
        box = QWidget()
        row = QHBoxLayout(box)
        row.setContentsMargins(0, 0, 0, 0)
        mark = label(MARKS[one.level] if one.level != "none" else "i", "big", wrap=False)
        set_level(mark, one.level)
        mark.setFixedWidth(26)
        row.addWidget(mark)
        words = QVBoxLayout()
        words.setSpacing(2)
        words.addWidget(label(one.message))
        if one.hint:
            words.addWidget(label(one.hint, "soft"))
        row.addLayout(words, 1)
        if one.action is not None:
            do = button(one.button, f"finding-{one.action}")
            do.setProperty("asks", [one.action, one.target])
            do.clicked.connect(self._pressed)
            row.addWidget(do)
        return box

    def _pressed(self) -> None:
        sender = self.sender()
        if sender is not None:
            kind, target = sender.property("asks")
            self.asked.emit(kind, target)
