"""A scene with its buttons: what is shown, everything in sight, save as a picture or a 3-D model."""

from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction, QResizeEvent
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QMenu, QSplitter, QVBoxLayout, QWidget

from spherecal.base.errors import SpherecalError
from spherecal_documents.scene.model import SceneData
from spherecal_documents.scene.shapes import SHOWN_AT_FIRST
from spherecal_files.filesystem import write_whole
from spherecal_gui import theme
from spherecal_gui.languages import error_text
from spherecal_gui.presenters.gltf import scene_glb
from spherecal_gui.widgets.basic import add, bare, button, spaced
from spherecal_gui.widgets.icons import menu_icon
from spherecal_gui.widgets.scene_view import SceneView, png_of

_MODEL = ".glb"
_SHARE = 2 / 3  # of what a larger screen adds: the scene grows, lines of text need little more room


class SceneSplit(QSplitter):
    """A scene and what is said about it side by side, `least_px` wide in the smallest window."""

    def __init__(self, scene: QWidget, beside: QWidget, least_px: tuple[int, int]) -> None:
        super().__init__(Qt.Orientation.Horizontal)
        self._least_px, self._moved = least_px, False
        self.addWidget(scene)
        self.addWidget(beside)
        self.setSizes(list(least_px))
        self.splitterMoved.connect(self._keep)

    def _keep(self) -> None:
        self._moved = True

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Share out the room until somebody has moved the handle; after setSizes Qt ignores stretch factors."""
        super().resizeEvent(event)
        more = self.width() - self.handleWidth() - sum(self._least_px)
        if more > 0 and not self._moved:
            scene = self._least_px[0] + round(_SHARE * more)
            self.setSizes([scene, self.width() - self.handleWidth() - scene])


class ScenePanel(QWidget):
    """`said` (kind, text, hint) when a file was written or could not be."""

    said = Signal(str, str, str)

    def __init__(self) -> None:
        super().__init__()
        column = bare(QVBoxLayout(self), theme.SMALL)
        self.view = SceneView()
        column.addWidget(self.view, 1)
        self.show_what = button(self.tr("Show"), "scene-layers", icon="cube")
        menu = QMenu(self)
        self.layers: dict[str, QAction] = {}
        for layer, text in (
            ("dots", self.tr("Dots by their residuals")),
            ("images", self.tr("Images of the cameras")),
            ("map", self.tr("Uncertainty of a length")),
            ("ellipsoids", self.tr("Ellipsoids of uncertainty")),
            ("links", self.tr("Paths")),
        ):
            action = QAction(text, menu, checkable=True)
            action.setChecked(layer in SHOWN_AT_FIRST)
            action.toggled.connect(self._toggled)
            menu.addAction(action)
            self.layers[layer] = action
        self.show_what.setMenu(menu)
        self.whole = button(self.tr("Show all"), "scene-whole", icon="arrows-maximize")
        self.whole.clicked.connect(lambda: self.view.look_from("oblique"))
        self.save = button(self.tr("Save"), "scene-save", icon="photo-down")
        saving = QMenu(self)
        picture = partial(self._ask_and_save, self.tr("Save the picture"), ".png", "PNG")
        saving.addAction(menu_icon("photo-down"), self.tr("As a picture (PNG)"), picture)
        model = partial(self._ask_and_save, self.tr("Save the 3-D model"), _MODEL, "glTF")
        saving.addAction(menu_icon("cube"), self.tr("As a 3-D model (glTF)"), model)
        self.save.setMenu(saving)
        column.addLayout(add(spaced(QHBoxLayout(), theme.SMALL), self.show_what, self.whole, self.save, None))
        self._offer()

    def show_scene(self, data: SceneData | None) -> None:
        """Show a rig."""
        self.view.show_scene(data)
        self._offer()
        self._toggled()

    def _offer(self) -> None:
        """Only what there is can be shown."""
        data = self.view.data
        parts = {"dots": "points", "images": "images", "map": "map_mm", "links": "links", "ellipsoids": "ellipsoids"}
        for layer, action in self.layers.items():
            action.setEnabled(data is not None and len(getattr(data, parts[layer])) > 0)
        for one in (self.show_what, self.whole, self.save):
            one.setEnabled(data is not None)

    def _toggled(self) -> None:
        self.view.set_layers(
            frozenset(name for name, action in self.layers.items() if action.isChecked() and action.isEnabled())
        )

    def _ask_and_save(self, title: str, ending: str, form: str) -> None:
        """Ask for a file, and write what is seen or the scene as a model."""
        name, _ = QFileDialog.getSaveFileName(self, title, f"rig{ending}", f"{form} (*{ending})")
        if name:
            self.save_as(Path(name) if name.lower().endswith(ending) else Path(f"{name}{ending}"))

    def save_as(self, path: Path) -> None:
        """Write a picture or, by its ending .glb, a model; what came of it is said."""
        if self.view.data is None:
            return
        try:
            if path.suffix.lower() == _MODEL:
                write_whole(path, scene_glb(self.view.data, self.view.style_of_now()))
            else:
                write_whole(path, png_of(self.view.grab()))
        except SpherecalError as error:
            self.said.emit("bad", *error_text(error))
            return
        except OSError as error:
            self.said.emit("bad", self.tr("{path} could not be written.").format(path=path), str(error.strerror or ""))
            return
        self.said.emit("info", self.tr("Saved: {path}").format(path=path), "")
