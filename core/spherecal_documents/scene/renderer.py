"""The process that renders scenes by pyvista off the screen: VTK, which keeps Python's lock, holds up nobody."""

import contextlib
import multiprocessing
import os
from importlib.util import find_spec
from multiprocessing import shared_memory
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from spherecal_documents.scene.eye import Eye
from spherecal_documents.scene.model import SceneData
from spherecal_documents.scene.shapes import Lines, Mesh, Picture, SceneStyle, scene_shapes

_FAR = 6.0  # the eye's distance, in radii of the scene; a parallel projection does not depend on it
_PLAIN = ("painted", "2d")  # what SPHERECAL_3D asks for the painted view by
_END_S = 1.0
_PATIENCE_S = 60.0  # for one picture; the first on a new machine takes some seconds
_FINE = 2  # at rest a picture is rendered so many times larger and averaged, which smooths edges


class ScenePlotter:
    """One pyvista plotter with a scene; making it fails where OpenGL does not work."""

    def __init__(self) -> None:
        import pyvista

        pyvista.global_theme.multi_samples = 1  # ten times slower by llvmpipe; see _FINE
        self._pyvista: Any = pyvista
        self._plotter: Any = pyvista.Plotter(off_screen=True, window_size=[320, 240], lighting="none")
        self._plotter.enable_parallel_projection()
        self._radius = 1.0
        self._lines: list[tuple[Any, float]] = []
        key = pyvista.Light(light_type="camera light", position=(0.5, 0.8, 1.0), intensity=0.85)
        fill = pyvista.Light(light_type="camera light", position=(-0.9, -0.2, 0.6), intensity=0.35)
        for light in (key, fill):
            self._plotter.add_light(light)
        self._plotter.render()  # fails here and now where OpenGL does not work

    def show(self, data: SceneData, style: SceneStyle) -> None:
        """Show another scene, or the same in another style."""
        self._plotter.clear_actors()
        self._lines = []
        self._radius = data.radius
        shapes = scene_shapes(data, style)
        self._plotter.set_background([part / 255 for part in shapes.background])
        for mesh in shapes.meshes:
            self._add_mesh(mesh)
        for lines in shapes.lines:
            self._add_lines(lines)
        if shapes.picture is not None:
            self._add_picture(shapes.picture)

    def _add_mesh(self, mesh: Mesh) -> None:
        faces = np.column_stack([np.full(len(mesh.faces), 3), mesh.faces]).ravel()
        made = self._pyvista.PolyData(mesh.vertices.astype(np.float32), faces)
        made["tint"] = np.asarray(mesh.colours, dtype=np.uint8)
        self._plotter.add_mesh(
            made, scalars="tint", rgb=True, smooth_shading=mesh.smooth, show_scalar_bar=False, reset_camera=False,
            lighting=not mesh.plain, ambient=0.25, diffuse=0.85, specular=0.25 if mesh.smooth else 0.08,
            specular_power=20,
        )  # fmt: skip

    def _add_lines(self, lines: Lines) -> None:
        count = len(lines.ends)
        cells = np.column_stack([np.full(count, 2), np.arange(2 * count).reshape(-1, 2)]).ravel()
        made = self._pyvista.PolyData(lines.ends.reshape(-1, 3).astype(np.float32), lines=cells)
        made.cell_data["tint"] = np.asarray(lines.colours, dtype=np.uint8)
        actor = self._plotter.add_mesh(
            made, scalars="tint", rgb=True, line_width=lines.width, lighting=False, show_scalar_bar=False,
            reset_camera=False,
        )  # fmt: skip
        self._lines.append((actor, lines.width))

    def _add_picture(self, picture: Picture) -> None:
        count = len(picture.corners)
        faces = np.column_stack([np.full(count, 4), np.arange(4 * count).reshape(-1, 4)]).ravel()
        made = self._pyvista.PolyData(picture.corners.reshape(-1, 3).astype(np.float32), faces)
        uv = picture.uv.reshape(-1, 2) * np.array([1, -1]) + np.array([0, 1])  # a texture begins at its lower edge
        made.active_texture_coordinates = uv.astype(np.float32)
        texture = self._pyvista.Texture(np.repeat(picture.image[:, :, None], 3, axis=2))
        self._plotter.add_mesh(made, texture=texture, lighting=False, show_scalar_bar=False, reset_camera=False)

    def picture(self, eye: Eye, fine: bool) -> Any:
        """The picture, (height, width, 3) uint8."""
        factor = _FINE if fine else 1
        plotter = self._plotter
        size = [eye.width * factor, eye.height * factor]
        if list(plotter.window_size) != size:
            plotter.window_size = size
        for actor, width in self._lines:
            actor.prop.line_width = width * factor
        camera = plotter.camera
        camera.focal_point = eye.middle.tolist()
        camera.position = (eye.middle + _FAR * self._radius * eye.towards).tolist()
        camera.up = eye.up.tolist()
        camera.parallel_scale = eye.height / 2 / eye.scale
        plotter.renderer.ResetCameraClippingRange()
        plotter.render()
        pixels = np.asarray(plotter.screenshot(return_img=True))[:, :, :3]
        if factor == 1:
            return pixels
        h, w = eye.height, eye.width
        return pixels.reshape(h, factor, w, factor, 3).mean(axis=(1, 3), dtype=np.float32).round().astype(np.uint8)

    def close(self) -> None:
        """Close the renderer."""
        self._plotter.close()


def can_render() -> bool:
    """Whether pyvista is installed, and SPHERECAL_3D does not ask for the painted view."""
    return os.environ.get("SPHERECAL_3D") not in _PLAIN and find_spec("pyvista") is not None


def serve(pipe: Connection) -> None:
    """Answer until the other end closes: `ready`, then the number of pixels for each eye; `failed` with the reason."""
    try:
        # VTK would say on standard error that there is no screen, and then render without one
        from vtkmodules.vtkCommonCore import vtkLogger

        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
        stage = ScenePlotter()
    except Exception as error:
        with contextlib.suppress(OSError):
            pipe.send(("failed", f"{type(error).__name__}: {error}"))
        return
    memory: shared_memory.SharedMemory | None = None
    with contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
        pipe.send(("ready", ""))
        while True:
            word, given = pipe.recv()
            if word == "scene":
                stage.show(*given)
                continue
            name, eye, fine = given
            if memory is None or memory.name != name:
                if memory is not None:
                    memory.close()
                memory = shared_memory.SharedMemory(name=name)
            picture = stage.picture(eye, fine)
            np.ndarray(picture.shape, np.uint8, memory.buf)[:] = picture
            pipe.send(picture.size)
    if memory is not None:
        memory.close()
    stage.close()


class PictureProcess(contextlib.AbstractContextManager["PictureProcess"]):
    """A process that renders pictures. It loads VTK while its maker does something else; EOFError where it ends."""

    def __init__(self, patience_s: float | None = _PATIENCE_S) -> None:
        """`patience_s` None: as long as it takes."""
        context = multiprocessing.get_context("spawn")
        self._patience_s, self._shown = patience_s, object()
        self._memory: shared_memory.SharedMemory | None = None
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs,), daemon=True, name="spherecal-scene")
        self._process.start()
        self.pid = self._process.pid
        theirs.close()

    def __exit__(self, *_: object) -> None:
        self._pipe.close()
        self._free()
        self._process.join(_END_S)
        self._process.terminate()
        self._process.join()

    def _free(self) -> None:
        if self._memory is not None:
            self._memory.close()
            self._memory.unlink()
            self._memory = None

    def _answer(self) -> Any:
        if not self._pipe.poll(self._patience_s):
            raise EOFError("no answer")
        return self._pipe.recv()

    def trouble(self) -> str:
        """Why it cannot render, once that is known; empty where it can."""
        word, reason = self._answer()
        return "" if word == "ready" else reason or word

    def picture(self, data: SceneData, style: SceneStyle, eye: Eye, fine: bool = True, scene: object = None) -> Any:
        """The picture, (height, width, 3) uint8; data and style are sent only where `scene` is another than before."""
        if scene != self._shown:
            self._pipe.send(("scene", (data, style)))
            self._shown = scene
        size = 3 * eye.width * eye.height
        if self._memory is None or self._memory.size < size:
            self._free()
            self._memory = shared_memory.SharedMemory(create=True, size=size + size // 2)
        self._pipe.send(("eye", (self._memory.name, eye, fine)))
        self._answer()
        return np.ndarray((eye.height, eye.width, 3), np.uint8, self._memory.buf).copy()
