"""A field to type into with its name above and what is wrong with it below, said while somebody types."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLineEdit, QSizePolicy, QVBoxLayout, QWidget

from spherecal_gui.widgets.basic import add, bare, label

_LONGEST = 200


class TextField(QWidget):
    """One line of text; `edited` (its key, the text) with every letter."""

    edited = Signal(str, str)

    def __init__(self, key: str, title: str, example: str = "", tip: str = "", parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.key, self.title = key, title
        column = bare(QVBoxLayout(self), 2)
        caption = label(title, wrap=False)
        self.line = QLineEdit()
        self.line.setObjectName(key)
        self.line.setPlaceholderText(example)
        self.line.setAccessibleName(title)
        self.line.setToolTip(tip)
        self.line.setMaxLength(_LONGEST)
        self.line.textEdited.connect(lambda text: self.edited.emit(self.key, text))
        caption.setBuddy(self.line)
        self.problem = label("", level="bad", hidden=True)
        add(column, caption, self.line, self.problem)
        column.addStretch(1)
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Maximum)

    def show_text(self, text: str) -> None:
        """What the draft has; the cursor stays where somebody types."""
        if self.line.text() != text:
            self.line.setText(text)

    def show_problem(self, text: str) -> None:
        """What is wrong, in plain words; empty where nothing is."""
        self.problem.setText(f"✕ {text}" if text else "")
        self.problem.setVisible(bool(text))
        self.line.setAccessibleDescription(text)
