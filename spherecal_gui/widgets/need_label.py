"""A line that names cameras; a click on a name asks for its picture."""

from html import escape

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QLabel

from spherecal_gui import languages, theme
from spherecal_gui.presenters.placement_presenter import NeedLine
from spherecal_gui.widgets.basic import set_level


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
