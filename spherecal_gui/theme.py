"""How the window looks: our own light and dark palette, sizes that can be read from three metres."""

from dataclasses import dataclass

from PySide6.QtGui import QColor, QFont, QPalette
from PySide6.QtWidgets import QApplication

from spherecal.base.resources import resource_path


@dataclass(frozen=True)
class Colours:
    """The colours by what they mean; `good`, `caution`, `bad` mean the same everywhere and never stand alone."""

    dark: bool
    window: str
    surface: str
    raised: str
    border: str
    text: str
    soft: str
    accent: str
    on_accent: str
    good: str
    caution: str
    bad: str
    idle: str

    def of(self, level: str) -> str:
        """The colour of a level `good`, `caution`, `bad`, else that of nothing in particular."""
        return {"good": self.good, "caution": self.caution, "bad": self.bad}.get(level, self.idle)


# Contrast of text against its ground is at least 7:1, of the state colours against the surface at least 4.5:1
# (tests/test_gui_pages.py computes both).
LIGHT = Colours(
    dark=False, window="#eef1f4", surface="#ffffff", raised="#f6f8fa", border="#c8d0d8", text="#101a23",
    soft="#46535f", accent="#0b5a99", on_accent="#ffffff", good="#13733f", caution="#925400", bad="#b3201a",
    idle="#66727e",
)  # fmt: skip
DARK = Colours(
    dark=True, window="#0f1419", surface="#182028", raised="#202a34", border="#3a4754", text="#f0f4f8",
    soft="#b4c0cc", accent="#5ab0ee", on_accent="#06121c", good="#46d58a", caution="#ffb545", bad="#ff8078",
    idle="#8c99a6",
)  # fmt: skip

_now = LIGHT
_factor = 1.0
BASE_PT = 11.0
# A capital letter of 26 pt is 6.6 mm high on a usual screen: 7.5 minutes of arc from three metres, what a driver's
# sight test asks for with a margin of 1.5. Numbers that matter are drawn at least so large in distance mode.
FAR_PT = 26.0
FAR_FACTOR = 1.35


def now() -> Colours:
    """The colours in use."""
    return _now


def is_far() -> bool:
    """Whether the letters are those for three metres."""
    return _factor > 1.0


def pt(size: float) -> float:
    """A font size in points, as large as the mode asks for."""
    return size * _factor


def font(size: float, bold: bool = False) -> QFont:
    """The window's font in this size."""
    made = QFont(QApplication.font())
    made.setPointSizeF(pt(size))
    made.setBold(bold)
    return made


def colour(name: str) -> QColor:
    """A colour of the palette by its name."""
    return QColor(getattr(_now, name))


def apply(application: QApplication, dark: bool, far: bool = False) -> None:
    """Dress the whole program."""
    global _now, _factor
    _now, _factor = (DARK if dark else LIGHT), (FAR_FACTOR if far else 1.0)
    application.setStyle("Fusion")
    base = QFont(application.font())
    base.setPointSizeF(pt(BASE_PT))
    application.setFont(base)
    application.setPalette(_palette(_now))
    application.setStyleSheet(style_sheet(_now))


def _palette(c: Colours) -> QPalette:
    palette, role = QPalette(), QPalette.ColorRole
    for name, value in {
        role.Window: c.window, role.WindowText: c.text, role.Base: c.surface, role.AlternateBase: c.raised,
        role.Text: c.text, role.Button: c.raised, role.ButtonText: c.text, role.ToolTipBase: c.raised,
        role.ToolTipText: c.text, role.Highlight: c.accent, role.HighlightedText: c.on_accent, role.Link: c.accent,
        role.PlaceholderText: c.soft, role.Mid: c.border, role.Dark: c.border, role.Light: c.surface,
    }.items():  # fmt: skip
        palette.setColor(name, QColor(value))
    for name in (role.WindowText, role.Text, role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, name, QColor(c.idle))
    return palette


def style_sheet(c: Colours) -> str:
    """The style sheet: large targets for gloves, one accent, states by colour and word."""
    side = 8 if is_far() else 16  # German from afar needs all of 1280 px
    ground = "dark" if c.dark else "light"
    down = resource_path("icons", f"down-on-{ground}.svg").as_posix()
    up = resource_path("icons", f"up-on-{ground}.svg").as_posix()
    check = resource_path("icons", "check-on-light.svg" if c.dark else "check-on-dark.svg").as_posix()
    return f"""
    QWidget {{ font-size: {pt(BASE_PT):.1f}pt; }}
    QToolTip {{ background: {c.raised}; color: {c.text}; border: 1px solid {c.border}; padding: 6px; }}
    QFrame#card {{ background: {c.surface}; border: 1px solid {c.border}; border-radius: 8px; }}
    QFrame#header {{ background: {c.surface}; border: none; border-bottom: 1px solid {c.border}; }}
    QFrame#footer {{ background: {c.surface}; border: none; border-top: 1px solid {c.border}; }}
    QFrame#rail {{ background: {c.surface}; border: none; border-right: 1px solid {c.border}; }}
    QLabel#title {{ font-size: {pt(20):.1f}pt; font-weight: bold; }}
    QLabel#huge {{ font-size: {pt(FAR_PT):.1f}pt; font-weight: bold; }}
    QLabel#big {{ font-size: {pt(15):.1f}pt; font-weight: bold; }}
    QLabel#soft, QLabel#task {{ color: {c.soft}; }}
    QLabel#task {{ font-size: {pt(12):.1f}pt; }}
    QLabel[level="good"] {{ color: {c.good}; }}
    QLabel[level="caution"] {{ color: {c.caution}; }}
    QLabel[level="bad"] {{ color: {c.bad}; }}
    QPushButton, QToolButton {{
        background: {c.raised}; color: {c.text}; border: 1px solid {c.border}; border-radius: 6px;
        padding: 7px {side}px; min-height: {pt(20):.0f}px;
    }}
    QPushButton:hover, QToolButton:hover {{ border-color: {c.accent}; }}
    QPushButton:focus, QToolButton:focus {{ border: 2px solid {c.accent}; padding: 6px {side - 1}px; }}
    QPushButton:pressed {{ background: {c.border}; }}
    QPushButton:checked, QToolButton:checked {{ background: {c.accent}; color: {c.on_accent}; }}
    QPushButton:disabled {{ color: {c.idle}; background: {c.window}; }}
    QPushButton#primary {{
        background: {c.accent}; color: {c.on_accent}; border: 1px solid {c.accent}; font-weight: bold;
        font-size: {pt(14):.1f}pt; min-height: {pt(34):.0f}px; padding: 8px 26px;
    }}
    QPushButton#primary:focus {{ border: 3px solid {c.text}; padding: 6px 24px; }}
    QPushButton#primary:disabled {{ background: {c.raised}; color: {c.idle}; border-color: {c.border}; }}
    QPushButton#pose {{ padding: 4px 8px; min-height: {pt(16):.0f}px; }}
    QPushButton#pose[level="good"] {{ color: {c.good}; }}
    QPushButton#pose:checked {{ color: {c.on_accent}; }}
    QPushButton#link {{ background: transparent; border: none; color: {c.accent}; text-decoration: underline;
        padding: 4px; min-height: 0; }}
    QPushButton#link:focus {{ border: 1px solid {c.accent}; }}
    QTableView {{ background: {c.surface}; alternate-background-color: {c.raised}; gridline-color: {c.border};
        border: 1px solid {c.border}; border-radius: 6px; selection-background-color: {c.accent};
        selection-color: {c.on_accent}; }}
    QHeaderView::section {{ background: {c.raised}; color: {c.soft}; border: none;
        border-bottom: 1px solid {c.border}; padding: 6px 4px; font-weight: bold; }}
    QTableCornerButton::section {{ background: {c.raised}; border: none; }}
    QProgressBar {{ background: {c.raised}; border: 1px solid {c.border}; border-radius: 6px; text-align: center;
        min-height: {pt(22):.0f}px; color: {c.text}; }}
    QProgressBar::chunk {{ background: {c.accent}; border-radius: 5px; }}
    QPlainTextEdit, QTextBrowser, QLineEdit, QComboBox {{ background: {c.surface}; color: {c.text};
        border: 1px solid {c.border}; border-radius: 6px; padding: 5px; }}
    QDoubleSpinBox {{ background: {c.surface}; color: {c.text}; border: 1px solid {c.border}; border-radius: 6px;
        padding: 5px 10px; min-height: {pt(22):.0f}px; }}
    QLineEdit:disabled, QDoubleSpinBox:disabled {{ background: {c.window}; color: {c.soft}; }}
    QDoubleSpinBox::up-button, QDoubleSpinBox::down-button {{ width: {pt(26):.0f}px; border: none; }}
    QDoubleSpinBox::up-arrow {{ image: url("{up}"); width: {pt(12):.0f}px; height: {pt(12):.0f}px; }}
    QDoubleSpinBox::down-arrow {{ image: url("{down}"); width: {pt(12):.0f}px; height: {pt(12):.0f}px; }}
    QComboBox {{ min-height: {pt(22):.0f}px; padding: 5px 10px; }}
    QComboBox::drop-down {{ border: none; width: {pt(26):.0f}px; }}
    QComboBox::down-arrow {{ image: url("{down}"); width: {pt(14):.0f}px; height: {pt(14):.0f}px; }}
    QPushButton[key="menu"] {{ padding-right: 26px; }}
    QPushButton::menu-indicator {{ image: url("{down}"); width: 12px; height: 12px; right: 8px;
        subcontrol-position: right center; subcontrol-origin: padding; }}
    QMenu {{ background: {c.surface}; color: {c.text}; border: 1px solid {c.border}; padding: 4px; }}
    QMenu::item {{ padding: {pt(7):.0f}px {pt(26):.0f}px; }}
    QMenu::item:selected {{ background: {c.accent}; color: {c.on_accent}; }}
    QComboBox QAbstractItemView {{ background: {c.surface}; color: {c.text}; }}
    QScrollArea {{ border: none; background: transparent; }}
    QScrollArea > QWidget > QWidget {{ background: transparent; }}
    QTabWidget::pane {{ border: 1px solid {c.border}; border-radius: 6px; background: {c.surface}; }}
    QTabBar::tab {{ background: {c.raised}; color: {c.soft}; padding: 8px {10 if is_far() else 18}px;
        border: 1px solid {c.border}; border-bottom: none; border-top-left-radius: 6px; border-top-right-radius: 6px; }}
    QTabBar::tab:selected {{ background: {c.surface}; color: {c.text}; font-weight: bold; }}
    QCheckBox {{ spacing: 10px; }}
    QCheckBox::indicator {{ width: {pt(20):.0f}px; height: {pt(20):.0f}px; border: 2px solid {c.soft};
        border-radius: 5px; background: {c.surface}; }}
    QCheckBox::indicator:focus {{ border-color: {c.accent}; }}
    QCheckBox::indicator:checked {{ background: {c.accent}; border-color: {c.accent}; image: url("{check}"); }}
    QScrollBar {{ background: {c.raised}; border: none; margin: 0; }}
    QScrollBar:vertical {{ width: {pt(14):.0f}px; }}
    QScrollBar:horizontal {{ height: {pt(14):.0f}px; }}
    QScrollBar::handle {{ background: {c.idle}; border-radius: 4px; margin: 2px; }}
    QScrollBar::handle:vertical {{ min-height: {pt(30):.0f}px; }}
    QScrollBar::handle:horizontal {{ min-width: {pt(30):.0f}px; }}
    QScrollBar::handle:hover {{ background: {c.accent}; }}
    QScrollBar::add-line, QScrollBar::sub-line {{ width: 0; height: 0; }}
    QScrollBar::add-page, QScrollBar::sub-page {{ background: none; }}
    QStatusBar {{ background: {c.surface}; border-top: 1px solid {c.border}; }}
    QSplitter::handle {{ background: {c.border}; }}
    """
