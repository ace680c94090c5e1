"""Help for the step, and about the program."""

import platform
import sys
from html import escape
from pathlib import Path

from PySide6 import __version__ as qt_version
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QMessageBox, QTextBrowser, QVBoxLayout, QWidget

import spherecal
from spherecal.base.resources import resource_path
from spherecal_documents.support.licences import LGPL_NOTE, parts
from spherecal_gui import languages
from spherecal_gui.controllers.camera_controller import DriverQuestion
from spherecal_gui.languages import translate
from spherecal_gui.widgets.basic import plain


def help_dialog(kind: str, parent: QWidget) -> QDialog:
    """Help for a kind of step, offline, in the language in use."""
    missing = translate("Help", "There is no help for this step.")
    path = resource_path("help", languages.now(), f"{kind}.html")
    if not path.is_file():
        path = resource_path("help", "en", f"{kind}.html")
    html = path.read_text(encoding="utf-8") if path.is_file() else missing
    return text_dialog(translate("Help", "Help"), html, parent, path.parent)


def text_dialog(title: str, html: str, parent: QWidget, folder: Path | None = None) -> QDialog:
    """A dialog with a text to read, which is shown. `folder` None for a text without pictures."""
    dialog = QDialog(parent)
    dialog.setWindowTitle(title)
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    text = QTextBrowser(openExternalLinks=False)
    text.setSearchPaths([str(folder)] if folder is not None else [])
    text.setHtml(html)
    QVBoxLayout(dialog).addWidget(text)
    dialog.resize(720, 560)
    dialog.show()
    return dialog


def _question(title: str, text: str, about: str, details: str, parent: QWidget) -> QMessageBox:
    box = QMessageBox(QMessageBox.Icon.Question, title, text, parent=parent)
    box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    box.setInformativeText(plain(about))
    box.setDetailedText(plain(details))
    return box


def driver_dialog(question: DriverQuestion, parent: QWidget) -> QDialog:
    """The dialog that asks whether a driver may be loaded, which is shown; closing it is a no."""
    new = translate("Drivers", "May this camera driver be loaded? It was never used here before.")
    changed = translate("Drivers", "May this camera driver be loaded? Its file has changed since it was allowed.")
    message = translate("Drivers", "A driver is a program. Load it only if you or its maker have installed it.")
    title, about = translate("Drivers", "A new camera driver"), f"{question.file}\n\n{message}"
    box = _question(title, changed if question.changed else new, about, f"SHA-256 {question.sha256}", parent)
    yes = box.addButton(translate("Drivers", "Load it"), QMessageBox.ButtonRole.YesRole)
    no = box.addButton(translate("Drivers", "Do not load it"), QMessageBox.ButtonRole.NoRole)
    yes.setProperty("key", "driver-yes")
    no.setProperty("key", "driver-no")
    box.setDefaultButton(no)
    box.setEscapeButton(no)
    box.finished.connect(lambda _: question.answer(box.clickedButton() is yes))
    box.open()
    return box


def bundle_dialog(files: int, contents: str, parent: QWidget) -> QDialog:
    """The dialog that says what a support bundle would hold, before it is written; accepted where somebody wants it."""
    text = translate("Bundle", "Save a support bundle of {n} files? It contains no images.").format(n=files)
    box = _question(translate("Bundle", "Support bundle"), text, contents.partition("\n")[0], contents, parent)
    save = box.addButton(translate("Bundle", "Save"), QMessageBox.ButtonRole.AcceptRole)
    box.addButton(QMessageBox.StandardButton.Cancel)
    save.setProperty("key", "bundle-save")
    box.open()
    return box


def versions() -> list[tuple[str, str]]:
    """What runs here."""
    found = [("SphereCal", spherecal.__version__), ("Python", platform.python_version()), ("Qt, PySide6", qt_version)]
    for name in ("numpy", "scipy", "numba", "cv2", "pyqtgraph", "pyvista", "harvesters"):
        if (module := sys.modules.get(name)) is not None:
            found.append((name, str(getattr(module, "__version__", ""))))
    return [*found, ("System", platform.platform())]


def about_dialog(parent: QWidget) -> QDialog:
    """Versions and licence; the parts of others with theirs, and what the LGPL asks to be said about Qt."""
    rows = "".join(f"<tr><td>{name}&nbsp;&nbsp;</td><td>{version}</td></tr>" for name, version in versions())
    licence = translate("About", "Free software under the Apache License 2.0.")
    what = translate("About", "Calibration of multi-camera measuring rigs with an imperfect ball.")
    html = f"<h2>SphereCal</h2><p>{what}</p><table>{rows}</table><p>{licence}</p>"
    known = "".join(
        f"<tr><td>{escape(part.name)}&nbsp;&nbsp;</td><td>{escape(part.version)}&nbsp;&nbsp;</td>"
        f"<td>{escape(part.licence)}</td></tr>"
        for part in parts()  # reads some forty files
    )
    html += f"<hr><p>{escape(LGPL_NOTE)}</p><table>{known}</table>"
    html += "<p><code>spherecal licences --texts FILE</code></p>"  # all texts, the LGPL's and the GPL's among them
    return text_dialog(translate("About", "About SphereCal"), html, parent)
