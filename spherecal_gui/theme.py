"""How the window looks: palette, type scale, spacing and style sheet. docs/design.md is the page on it."""

from dataclasses import dataclass

from PySide6.QtGui import QColor, QFont, QFontDatabase, QPalette
from PySide6.QtWidgets import QApplication

from spherecal.base.resources import resource_path
from spherecal.base.working_folder import elsewhere


@dataclass(frozen=True)
class Colours:
    """The colours by their role; `good`, `caution`, `bad` mean the same everywhere and never appear without a word.

    `window` is the ground of the page, `surface` that of cards and bars. `raised` is that of controls, `scene` that of
    the 3-D view. `text` and `soft` are letters, `idle` what is disabled or not yet done.
    """

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
    scene: str

    def of(self, level: str) -> str:
        """The colour of a level `good`, `caution`, `bad`, else that of nothing in particular."""
        return {"good": self.good, "caution": self.caution, "bad": self.bad}.get(level, self.idle)

    def tint(self, level: str) -> str:
        """The ground of a chip or banner of a level: its colour, thinned with the surface's."""
        return mixed(self.surface, self.of(level), _TINT)


# Contrast (WCAG 2) of text and state colours on every ground where they appear: at least 4.5:1, `text` 7:1; large
# letters and marks 3:1. tests/gui/test_design.py computes all pairs.
_ROLES = {  # in the light look, in the dark one
    "window": ("#f2f4f6", "#0f1317"), "surface": ("#ffffff", "#171c22"), "raised": ("#f5f7f9", "#212830"),
    "border": ("#d0d7de", "#37424d"), "text": ("#141c24", "#e8edf2"), "soft": ("#4a5763", "#aab6c1"),
    "accent": ("#1d5d97", "#74b4e6"), "on_accent": ("#ffffff", "#08131c"), "good": ("#17683c", "#63cf98"),
    "caution": ("#855000", "#eeb457"), "bad": ("#ad2a20", "#ff8c82"), "idle": ("#66727e", "#8b98a4"),
    "scene": ("#e9edf1", "#12171c"),
}  # fmt: skip
LIGHT, DARK = (Colours(dark, **{role: both[dark] for role, both in _ROLES.items()}) for dark in (False, True))
_TINT = 0.13

FAMILY = "Inter"
# What is not in Inter comes from the system, Chinese from the first of these that is there.
_FALLBACKS = ("Noto Sans CJK SC", "Noto Sans SC", "Source Han Sans SC", "Microsoft YaHei", "PingFang SC")
_FONT_FILES = ("Inter-Regular.otf", "Inter-SemiBold.otf")

# The type scale, points at the normal text size.
CAPTION, BODY, LEAD, HEADING, TITLE, DISPLAY = 9.5, 11.0, 12.0, 14.0, 19.0, 26.0
# Spacing, px: multiples of four, eight between parts.
TIGHT, SMALL, GAP, PAD, WIDE = 4, 8, 12, 16, 24

_now = LIGHT
_factor = 1.0
_fonts: dict[tuple[float, bool], QFont] = {}  # made in this look: a font takes 70 us, and each drawing needs some
# A capital letter of 26 pt is 6.6 mm high on a usual screen: 7.5 minutes of arc from three metres, what a driver's
# sight test asks for with a margin of 1.5. Numbers that matter are drawn at least so large with large text.
FAR_FACTOR = 1.35


def now() -> Colours:
    """The colours in use."""
    return _now


def is_far() -> bool:
    """Whether the text is large, to be read from three metres."""
    return _factor > 1.0


def pt(size: float) -> float:
    """A font size in points, as large as the mode asks for."""
    return size * _factor


def font(size: float, bold: bool = False) -> QFont:
    """The window's font in this size."""
    made = _fonts.get((size, bold))
    if made is None:
        made = _fonts[size, bold] = QFont(QApplication.font())
        made.setPointSizeF(pt(size))
        made.setWeight(QFont.Weight.DemiBold if bold else QFont.Weight.Normal)
    return QFont(made)


def rgb(name: str) -> tuple[int, int, int]:
    """A colour's parts, each to 255."""
    made = QColor(name)
    return made.red(), made.green(), made.blue()


def mixed(first: str, second: str, share: float) -> str:
    """The colour between two, as `#rrggbb`."""
    parts = zip(rgb(first), rgb(second), strict=True)
    return "#" + "".join(f"{round(x + share * (y - x)):02x}" for x, y in parts)


def _window_font() -> QFont:
    """Inter as it is shipped, figures of equal width, so that columns and changing numbers keep their place."""
    if FAMILY not in QFontDatabase.families():
        with elsewhere():  # Qt has fontconfig load a file ":/non-existent", which may be there
            for name in _FONT_FILES:
                QFontDatabase.addApplicationFont(str(resource_path("fonts", name)))
    made = QFont(QApplication.font())
    made.setFamilies([FAMILY, *_FALLBACKS, made.defaultFamily()])
    made.setPointSizeF(pt(BODY))
    made.setFeature(QFont.Tag("tnum"), 1)
    return made


def colour(name: str) -> QColor:
    """A colour of the palette by its name."""
    return QColor(getattr(_now, name))


def apply(application: QApplication, dark: bool, far: bool = False) -> None:
    """Dress the whole program; nothing is done where it is dressed so already, as each widget is styled again."""
    global _now, _factor
    _now, _factor = (DARK if dark else LIGHT), (FAR_FACTOR if far else 1.0)
    sheet, bare = style_sheet(_now), not application.styleSheet()
    if application.styleSheet() == sheet:
        return
    if bare:
        application.setStyle("Fusion")
    _fonts.clear()
    application.setFont(_window_font())
    application.setPalette(_palette(_now))
    application.setStyleSheet(sheet)


def _palette(c: Colours) -> QPalette:
    palette, role = QPalette(), QPalette.ColorRole
    for value, names in (
        (c.window, (role.Window,)), (c.surface, (role.Base, role.Light)), (c.border, (role.Mid, role.Dark)),
        (c.raised, (role.AlternateBase, role.Button, role.ToolTipBase)), (c.accent, (role.Highlight, role.Link)),
        (c.text, (role.WindowText, role.Text, role.ButtonText, role.ToolTipText)), (c.soft, (role.PlaceholderText,)),
        (c.on_accent, (role.HighlightedText,)),
    ):  # fmt: skip
        for name in names:
            palette.setColor(name, QColor(value))
    for name in (role.WindowText, role.Text, role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, name, QColor(c.idle))
    return palette


def style_sheet(c: Colours) -> str:
    """The style sheet: targets large enough for gloves, one accent, states by colour and word."""
    side = SMALL if is_far() else PAD  # German in large text needs all of 1280 px
    ground = "dark" if c.dark else "light"
    chosen = mixed(c.surface, c.accent, 0.22)
    down = resource_path("icons", f"down-on-{ground}.svg").as_posix()
    up = resource_path("icons", f"up-on-{ground}.svg").as_posix()
    check = resource_path("icons", "check-on-light.svg" if c.dark else "check-on-dark.svg").as_posix()
    return f"""
    QWidget {{ font-size: {pt(BODY):.1f}pt; }}
    QToolTip {{ background: {c.raised}; color: {c.text}; border: 1px solid {c.border}; padding: 6px; }}
    QFrame#card {{ background: {c.surface}; border: 1px solid {c.border}; border-radius: 8px; }}
    QFrame#header {{ background: {c.surface}; border: none; border-bottom: 1px solid {c.border}; }}
    QFrame#footer {{ background: {c.surface}; border: none; border-top: 1px solid {c.border};
        min-height: {pt(34) + 18 + 2 * SMALL:.0f}px; }}
    QFrame#banner {{ border-radius: 8px; border: 1px solid {c.border}; background: {c.surface}; }}
    QFrame#banner[level="good"] {{ background: {c.tint("good")}; border-color: {c.good}; }}
    QFrame#banner[level="caution"] {{ background: {c.tint("caution")}; border-color: {c.caution}; }}
    QFrame#banner[level="bad"] {{ background: {c.tint("bad")}; border-color: {c.bad}; }}
    QFrame#rail {{ background: {c.surface}; border: none; border-right: 1px solid {c.border}; }}
    QLabel#title {{ font-size: {pt(TITLE):.1f}pt; font-weight: 600; }}
    QLabel#huge {{ font-size: {pt(DISPLAY):.1f}pt; font-weight: 600; }}
    QLabel#big {{ font-size: {pt(HEADING):.1f}pt; font-weight: 600; }}
    QLabel#soft, QLabel#task, QLabel#caption {{ color: {c.soft}; }}
    QLabel#caption {{ font-size: {pt(CAPTION):.1f}pt; }}
    QLabel#task {{ font-size: {pt(LEAD):.1f}pt; }}
    QLabel[level="good"] {{ color: {c.good}; }}
    QLabel[level="caution"] {{ color: {c.caution}; }}
    QLabel[level="bad"] {{ color: {c.bad}; }}
    QPushButton, QToolButton {{
        background: {c.raised}; color: {c.text}; border: 1px solid {c.border}; border-radius: 8px;
        padding: 7px {side}px; min-height: {pt(20):.0f}px;
    }}
    QFileDialog QToolButton, QFileDialog QToolButton:focus {{ padding: 2px; min-height: 0; }}
    QPushButton:hover, QToolButton:hover {{ border-color: {c.accent}; }}
    QPushButton:focus, QToolButton:focus {{ border: 2px solid {c.accent}; padding: 6px {side - 1}px; }}
    QPushButton:pressed {{ background: {c.border}; }}
    QPushButton:checked, QToolButton:checked {{ background: {chosen}; color: {c.text};
        border-color: {c.accent}; }}
    QPushButton:disabled {{ color: {c.idle}; background: {c.window}; }}
    QPushButton#primary {{
        background: {c.accent}; color: {c.on_accent}; border: 1px solid {c.accent}; font-weight: 600;
        font-size: {pt(HEADING):.1f}pt; min-height: {pt(34):.0f}px; padding: 8px 26px;
    }}
    QPushButton#primary:focus {{ border: 3px solid {c.text}; padding: 6px 24px; }}
    QPushButton#primary:disabled {{ background: {c.raised}; color: {c.idle}; border-color: {c.border}; }}
    QPushButton#card {{ background: {mixed(c.surface, c.accent, 0.12)}; border-color: {mixed(c.surface, c.accent, 0.5)};
        font-weight: 600; font-size: {pt(LEAD):.1f}pt; min-height: {pt(28):.0f}px; }}
    QPushButton#card:hover {{ background: {mixed(c.surface, c.accent, 0.2)}; border-color: {c.accent}; }}
    QPushButton#card:disabled {{ background: {c.window}; border-color: {c.border}; color: {c.idle}; }}
    QPushButton#pose {{ padding: 4px 8px; min-height: {pt(16):.0f}px; }}
    QPushButton#pose[level="good"] {{ color: {c.good}; }}
    QPushButton#pose:checked {{ color: {c.text}; }}
    QPushButton#link {{ background: transparent; border: none; color: {c.accent}; text-decoration: underline;
        padding: 4px; min-height: 0; }}
    QPushButton#link:focus {{ border: 1px solid {c.accent}; }}
    QTableView {{ background: {c.surface}; alternate-background-color: {c.raised}; gridline-color: {c.border};
        border: 1px solid {c.border}; border-radius: 6px; selection-background-color: {chosen};
        selection-color: {c.text}; }}
    QTableView::item {{ padding: 0 4px; }}
    QHeaderView {{ background: {c.raised}; }}
    QHeaderView::section {{ background: {c.raised}; color: {c.soft}; border: none;
        border-bottom: 1px solid {c.border}; padding: 8px 5px; font-weight: 600; }}
    QTableCornerButton::section {{ background: {c.raised}; border: none; }}
    QProgressBar {{ background: {c.raised}; border: 1px solid {c.border}; border-radius: 6px; text-align: center;
        min-height: {pt(22):.0f}px; color: {c.text}; }}
    QProgressBar#hold-still {{ min-height: 0; border-radius: 4px; }}
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
    QMenu::item:selected {{ background: {chosen}; color: {c.text}; }}
    QMenu::separator {{ height: 1px; background: {c.border}; margin: 4px 8px; }}
    QComboBox QAbstractItemView {{ background: {c.surface}; color: {c.text}; }}
    QScrollArea {{ border: none; background: transparent; }}
    QScrollArea > QWidget > QWidget {{ background: transparent; }}
    QTabWidget::pane {{ border: 1px solid {c.border}; border-radius: 6px; background: {c.surface}; }}
    QTabBar::tab {{ background: {c.raised}; color: {c.soft}; padding: 8px {10 if is_far() else 18}px;
        border: 1px solid {c.border}; border-bottom: none; border-top-left-radius: 6px; border-top-right-radius: 6px; }}
    QTabBar::tab:selected {{ background: {c.surface}; color: {c.text}; font-weight: 600; }}
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
