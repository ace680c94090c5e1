"""Takes pyvista and VTK out of a bundle that was built with them, so that they are packed apart.

The bundle looks for them at the same place of its folder: where they are, it renders the 3-D view; else it paints it.
"""

import shutil
from pathlib import Path

INSIDE = "_internal"
_PARTS = (
    "pooch", "pooch-*.dist-info", "pyvista", "pyvista-*.dist-info", "pyvista_validation",
    "pyvista_validation-*.dist-info", "scooby",
    "scooby-*.dist-info", "vtkmodules", "vtk-*.dist-info", "vtk.libs", "libvtk*.so*",
)  # fmt: skip


def take_apart(bundle: Path, scene: Path) -> None:
    """Move the scene's part of a bundle into the folder `scene`, which has the bundle's layout."""
    shutil.rmtree(scene, ignore_errors=True)
    (scene / INSIDE).mkdir(parents=True)
    for one in sorted(path for part in _PARTS for path in (bundle / INSIDE).glob(part)):
        shutil.move(one, scene / INSIDE / one.name)
    if not (scene / INSIDE / "pyvista").is_dir() or not (scene / INSIDE / "vtkmodules").is_dir():
        raise FileNotFoundError(f"{bundle} was built without pyvista and VTK")
