"""Fields: of a number with its unit; of a text with its name above and what is wrong with it below, said at once."""

from PySide6.QtWidgets import QDoubleSpinBox, QLineEdit, QSizePolicy, QVBoxLayout, QWidget

from spherecal_gui.widgets.basic import add, bare, label, named, say

_LONGEST = 200


def number_field(
    name: str, says: str, span: tuple[float, float], unit: str, digits: int = 2, step: float = 1.0, tip: str = ""
) -> QDoubleSpinBox:
    """A field for a number from `span`, with its unit."""
    made = QDoubleSpinBox(suffix=f" {unit}" if unit else "", decimals=digits, singleStep=step)
    made.setRange(*span)
    return named(made, name, says, tip)


class TextField(QWidget):
    """One line of text."""

    def __init__(self, key: str, title: str, example: str = "", tip: str = "") -> None:
        super().__init__()
        column = bare(QVBoxLayout(self), 2)
        caption = label(title, wrap=False)
        self.line = named(QLineEdit(placeholderText=example, maxLength=_LONGEST), key, title, tip)
        caption.setBuddy(self.line)
        self.problem = label("", level="bad", hidden=True)
        add(column, caption, self.line, self.problem, None)
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Maximum)

    def show_text(self, text: str) -> None:
        """What the draft has; the cursor stays where somebody types."""
        if self.line.text() != text:
            self.line.setText(text)

    def show_problem(self, text: str) -> None:
        """What is wrong, in plain words; empty where nothing is."""
        say(self.problem, f"✕ {text}" if text else "", "bad")
        self.line.setAccessibleDescription(text)
