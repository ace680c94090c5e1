"""How the window looks: palette, type scale, spacing and style sheet. docs/design.md is the page on it."""

from dataclasses import asdict, dataclass
from string import Template

from PySide6.QtGui import QColor, QFont, QFontDatabase, QPalette
from PySide6.QtWidgets import QApplication

from spherecal.base.resources import resource_path
from spherecal_files.programs import elsewhere


@dataclass(frozen=True)
class Colours:
    """The colours by their role; `good`, `caution`, `bad` mean the same everywhere and never appear without a word."""

    dark: bool
    window: str  # the ground of the page
    surface: str  # ... of cards and bars
    raised: str  # ... of controls
    border: str
    text: str  # letters, as is `soft`
    soft: str
    accent: str
    on_accent: str
    good: str
    caution: str
    bad: str
    idle: str  # what is disabled or not yet done
    scene: str  # the ground of the 3-D view

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
    ground, other = ("dark", "light") if c.dark else ("light", "dark")

    def icon(name: str) -> str:
        return resource_path("icons", f"{name}.svg").as_posix()

    words = {
        **asdict(c), "chosen": mixed(c.surface, c.accent, 0.22), "card": mixed(c.surface, c.accent, 0.12),
        "card_edge": mixed(c.surface, c.accent, 0.5), "card_hover": mixed(c.surface, c.accent, 0.2),
        "up": icon(f"up-on-{ground}"), "down": icon(f"down-on-{ground}"), "check": icon(f"check-on-{other}"),
        "side": side, "side_focus": side - 1, "tab": 10 if is_far() else 18, "footer": f"{pt(34) + 18 + 2 * SMALL:.0f}",
    }  # fmt: skip
    words |= {f"{level}_tint": c.tint(level) for level in ("good", "caution", "bad")}
    words |= {f"px{size}": f"{pt(size):.0f}" for size in (7, 12, 14, 16, 20, 22, 26, 28, 30, 34)}
    sizes = {"caption": CAPTION, "body": BODY, "lead": LEAD, "heading": HEADING, "title": TITLE, "display": DISPLAY}
    words |= {name: f"{pt(size):.1f}" for name, size in sizes.items()}
    return Template(resource_path("window.qss").read_text(encoding="utf-8")).substitute(words)
