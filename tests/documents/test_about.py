"""About SphereCal: versions, all parts of others with their licences, what the LGPL asks to be said about Qt."""

import os

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtWidgets import QApplication, QTextBrowser, QWidget

from spherecal_documents.support.licences import parts
from spherecal_gui.wizard.dialogs import about_dialog


def test_about_lists_every_part_with_its_licence_and_says_how_qt_may_be_replaced(qapp: QApplication) -> None:
    parent = QWidget()
    shown = about_dialog(parent).findChild(QTextBrowser)
    assert shown is not None
    text = " ".join(shown.toPlainText().split())
    known = parts()
    assert {"numpy", "PySide6_Essentials"} <= {part.name for part in known}
    for part in known:
        assert part.name in text and part.version in text
        assert " ".join(part.licence.split()) in text
    assert "GNU Lesser General Public License" in text and "replace them by your own builds" in text
    assert "spherecal licences --texts" in text
    parent.close()
