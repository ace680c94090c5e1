"""Fields of numbers and texts, with what is wrong said at once; a line of cameras to click on."""

from collections.abc import Mapping
from html import escape

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QDoubleSpinBox, QLabel, QLineEdit, QSizePolicy, QVBoxLayout, QWidget

from spherecal_gui import languages, theme
from spherecal_gui.presenters.placement_presenter import NeedLine
from spherecal_gui.widgets.basic import add, bare, label, named, say, set_level

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


def show_fields(fields: Mapping[str, TextField], draft: object, problems: Mapping[str, str], place: str = "") -> None:
    """What a draft has, by the names of its fields, and what is wrong with it, by `place` and name."""
    for key, one in fields.items():
        text, problem = getattr(draft, key), problems.get(f"{place}{key}", "")
        if one.line.text() != text:  # else the cursor leaves the place where somebody types
            one.line.setText(text)
        say(one.problem, f"✕ {problem}" if problem else "", "bad")
        one.line.setAccessibleDescription(problem)


class NeedLabel(QLabel):
    """What some cameras need; `asked` names the camera that was clicked, empty for all of them."""

    asked = Signal(str)

    def __init__(self, level: str) -> None:
        super().__init__()
        self.setObjectName("big")
        self.setWordWrap(True)
        self.setTextFormat(Qt.TextFormat.RichText)
        flags = Qt.TextInteractionFlag
        self.setTextInteractionFlags(flags.LinksAccessibleByMouse | flags.LinksAccessibleByKeyboard)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click leaves the space bar with the large button
        self.linkActivated.connect(self.asked)
        self._level = level
        self.hide()

    def show_need(self, need: NeedLine | None, level: str | None = None) -> None:
        """Show it in the colour of a level, the label's own unless given; hidden without a need."""
        shown = level or self._level
        set_level(self, shown)
        self.setVisible(need is not None)
        if need is None:
            self.clear()
            return
        colour = theme.now().of(shown) if shown != "none" else theme.now().text
        links = [("", need.all_words)] if need.everyone else [(name, name) for name in need.cameras]
        message = languages.listed(f'<a style="color: {colour}" href="{escape(a)}">{escape(b)}</a>' for a, b in links)
        self.setText(f"{escape(languages.unbroken(languages.by_locale(need.message)))} {message}")
        self.setAccessibleName(need.text)
