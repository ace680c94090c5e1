"""The design system: contrast of all colours where they appear, the font and the icons that are shipped."""

import os
import re
from itertools import product
from pathlib import Path

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import QEvent, QSize, Qt
from PySide6.QtGui import QFontInfo
from PySide6.QtWidgets import QAbstractButton, QFileDialog, QLabel, QWidget

from spherecal.base.resources import resource_path
from spherecal_documents.scene.model import ramp
from spherecal_documents.support.licences import parts
from spherecal_gui import theme
from spherecal_gui.widgets.icons import LEVEL_ICONS, give_icon, pixmap, svg_pixmap
from tests.conftest import ROOT
from tests.gui.test_gui_pages import contrast

PALETTES = pytest.mark.parametrize("c", [theme.LIGHT, theme.DARK], ids=["light", "dark"])
LETTERS, LARGE = 4.5, 3.0


@PALETTES
def test_letters_have_contrast_on_every_ground(c):
    for role, ground in product(("text", "soft", "accent", "good", "caution", "bad"), ("window", "surface", "scene")):
        assert contrast(getattr(c, role), getattr(c, ground)) >= LETTERS, (role, ground)
    for role in ("text", "soft", "good", "caution", "bad"):
        assert contrast(getattr(c, role), c.raised) >= LETTERS, role
    for ground in (c.window, c.surface, c.raised, c.scene):
        assert contrast(c.text, ground) >= 7
        assert contrast(c.idle, ground) >= LARGE  # disabled, or a number that is not done yet
    assert contrast(c.on_accent, c.accent) >= LETTERS


@PALETTES
def test_words_of_a_state_have_contrast_on_its_tint(c):
    """Chips, banners and the marks of the rail."""
    for level in ("good", "caution", "bad"):
        assert contrast(c.of(level), c.tint(level)) >= LETTERS, level
        assert contrast(c.text, c.tint(level)) >= 7
        assert contrast(c.soft, c.tint(level)) >= LETTERS
    for share in (0.12, 0.22):  # the ground of cards' buttons and of what is chosen
        assert contrast(c.text, theme.mixed(c.surface, c.accent, share)) >= 7


@PALETTES
def test_a_level_never_fills_a_large_area_with_its_full_colour(c):
    sheet = theme.style_sheet(c)
    for colour in (c.good, c.caution, c.bad):
        assert f"background: {colour}" not in sheet


@pytest.mark.parametrize("dark", [False, True])
def test_colours_of_residuals_are_seen_on_the_ground_of_the_scene(dark):
    import numpy as np

    c = theme.DARK if dark else theme.LIGHT
    for tint in ramp(np.linspace(0, 1, 9), dark):
        assert contrast("#{:02x}{:02x}{:02x}".format(*tint), c.scene) >= 2.2, tint


def test_the_type_scale_rises_and_spacing_is_in_steps_of_four():
    scale = (theme.CAPTION, theme.BODY, theme.LEAD, theme.HEADING, theme.TITLE, theme.DISPLAY)
    assert list(scale) == sorted(set(scale))
    assert all(one % 4 == 0 for one in (theme.TIGHT, theme.SMALL, theme.GAP, theme.PAD, theme.WIDE))
    used = {float(size) for size in re.findall(r"font-size: ([\d.]+)pt", theme.style_sheet(theme.LIGHT))}
    assert used <= set(scale)


def test_the_shipped_font_is_used_with_figures_of_equal_width(qapp, qtbot):
    theme.apply(qapp, dark=False)
    assert QFontInfo(qapp.font()).family() == theme.FAMILY
    assert QFontInfo(theme.font(theme.TITLE, bold=True)).family() == theme.FAMILY
    shown = QLabel("0")
    qtbot.addWidget(shown)
    shown.show()
    metrics = shown.fontMetrics()
    assert len({metrics.horizontalAdvance(figure * 4) for figure in "0123456789"}) == 1


def test_font_and_icons_are_listed_with_their_licences():
    known = {part.name: part for part in parts()}
    assert known["Inter"].licence == "OFL-1.1" and "SIL OPEN FONT LICENSE" in known["Inter"].texts[0][1]
    assert (
        known["Tabler Icons"].licence == "MIT" and "Permission is hereby granted" in known["Tabler Icons"].texts[0][1]
    )


def test_every_icon_is_used_and_every_used_icon_is_there():
    there = {path.stem for path in resource_path("icons", "tabler").glob("*.svg")}
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "spherecal_gui").rglob("*.py"))
    named = {name for name in there if f'"{name}"' in sources}
    assert there - named == set(), "an icon that nothing uses"
    asked = set(re.findall(r'(?:give_icon\(self\.\w+|give_icon\(\w+|menu_icon\(|[^_]pixmap\()[, ]*"([\w-]+)"', sources))
    assert asked <= there and set(LEVEL_ICONS.values()) <= there


def test_icons_take_the_colour_of_their_role(qapp, qtbot):
    from PySide6.QtWidgets import QPushButton

    drawn = pixmap("check", 20, "#ff0000", 2.0).toImage()
    assert (drawn.width(), drawn.height()) == (40, 40)
    tints = {
        drawn.pixelColor(x, y).name() for x in range(40) for y in range(40) if drawn.pixelColor(x, y).alpha() > 250
    }
    assert tints == {"#ff0000"}
    theme.apply(qapp, dark=True)
    one = QPushButton("Help")
    qtbot.addWidget(one)
    give_icon(one, "help")
    assert not one.icon().isNull()
    theme.apply(qapp, dark=False)


@pytest.mark.parametrize("path", sorted((ROOT / "resources" / "drawings").glob("*.svg")), ids=lambda path: path.stem)
def test_drawings_are_drawn(qapp, path: Path):
    text = path.read_text(encoding="utf-8")
    for role in ("LINE", "ACCENT", "GROUND", "GOOD"):
        text = text.replace(role, "#336699")
    drawn = svg_pixmap(text, QSize(240, 120)).toImage()
    assert any(drawn.pixelColor(x, 60).alpha() for x in range(240))


def test_a_look_that_is_on_already_is_not_put_on_again(qapp, qtbot):
    """Each widget is styled again by it, 0.3 s in a window."""

    class Styled(QWidget):
        times = 0

        def changeEvent(self, event: QEvent) -> None:
            self.times += event.type() == QEvent.Type.StyleChange

    theme.apply(qapp, dark=False)
    one = Styled()
    qtbot.addWidget(one)
    one.show()
    small, before = theme.font(theme.BODY), one.times
    theme.apply(qapp, dark=False)
    assert one.times == before
    theme.font(theme.BODY).setPointSizeF(3.0)
    assert theme.font(theme.BODY) == small, "a font of its own for each who asks"
    theme.apply(qapp, dark=True, far=True)
    assert one.times > before
    assert theme.font(theme.BODY).pointSizeF() == pytest.approx(small.pointSizeF() * theme.FAR_FACTOR, abs=0.1)
    assert qapp.palette().window().color().name() == theme.DARK.window
    theme.apply(qapp, dark=False)
    assert theme.font(theme.BODY) == small


@pytest.mark.parametrize(("dark", "far"), list(product((False, True), repeat=2)))
def test_every_button_of_the_file_dialog_shows_what_it_does(qapp, qtbot, tmp_path, dark, far):
    """The padding of our buttons once left no room for Qt's icons: six blank buttons."""
    theme.apply(qapp, dark, far)
    dialog = QFileDialog(None, "", str(tmp_path))
    dialog.setOption(QFileDialog.Option.DontUseNativeDialog)
    qtbot.addWidget(dialog)
    dialog.show()
    shown = [one for one in dialog.findChildren(QAbstractButton) if one.isVisible()]
    assert len(shown) >= 8
    for one in shown:
        assert one.text().strip() or not one.icon().isNull(), one.objectName()
        one.setEnabled(True)
        for focused in (False, True):
            one.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            (one if focused else dialog).setFocus()
            qapp.processEvents()
            inner = one.grab(one.rect().adjusted(5, 5, -5, -5)).toImage()
            tints = {inner.pixel(x, y) for x in range(inner.width()) for y in range(inner.height())}
            assert len(tints) > 5, f"{one.objectName() or one.text()} is blank, focused: {focused}"
