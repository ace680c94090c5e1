"""Help for the step, and about the program."""

import platform
import sys

from PySide6 import __version__ as qt_version
from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtWidgets import QDialog, QTextBrowser, QVBoxLayout, QWidget

import spherecal
from spherecal.resources import resource_path
from spherecal_gui import languages

translate = QCoreApplication.translate


def help_dialog(kind: str, parent: QWidget) -> QDialog:
    """Help for a kind of step, offline, in the language in use."""
    missing = translate("Help", "There is no help for this step.")
    path = resource_path("help", languages.now(), f"{kind}.html")
    if not path.is_file():
        path = resource_path("help", "en", f"{kind}.html")
    return text_dialog(
        translate("Help", "Help"), path.read_text(encoding="utf-8") if path.is_file() else missing, parent
    )


def text_dialog(title: str, html: str, parent: QWidget) -> QDialog:
    """A dialog with a text to read."""
    dialog = QDialog(parent)
    dialog.setWindowTitle(title)
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    text = QTextBrowser()
    text.setOpenExternalLinks(False)
    text.setHtml(html)
    column = QVBoxLayout(dialog)
    column.addWidget(text)
    dialog.resize(720, 560)
    dialog.show()
    return dialog


def versions() -> list[tuple[str, str]]:
    """What runs here."""
    found = [("SphereCal", spherecal.__version__), ("Python", platform.python_version()), ("Qt, PySide6", qt_version)]
    for name in ("numpy", "scipy", "numba", "cv2", "pyqtgraph", "pyvista", "harvesters"):
        module = sys.modules.get(name)
        if module is not None:
            found.append((name, str(getattr(module, "__version__", ""))))
    return [*found, ("System", platform.platform())]


def about_dialog(parent: QWidget) -> QDialog:
    """Versions and licence."""
    rows = "".join(f"<tr><td>{name}&nbsp;&nbsp;</td><td>{version}</td></tr>" for name, version in versions())
    licence = translate("About", "Free software under the Apache License 2.0.")
    what = translate("About", "Calibration of multi-camera measuring rigs with an imperfect ball.")
    html = f"<h2>SphereCal</h2><p>{what}</p><table>{rows}</table><p>{licence}</p>"
    return text_dialog(translate("About", "About SphereCal"), html, parent)
