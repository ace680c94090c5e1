"""What other packages add to the program, found by their entry points (docs/plugins.md)."""

from importlib.metadata import EntryPoint, entry_points
from typing import Any

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase

EXPORTERS, IMPORTERS, CAMERA_SOURCES = "spherecal.exporters", "spherecal.importers", "spherecal.camera_sources"
METHODS = "spherecal.methods"  # of calibration: board and bar
_LONGEST = 200  # characters of what a package says
_KINDS = {EXPORTERS: Phrase("an-exporter"), IMPORTERS: Phrase("an-importer"), CAMERA_SOURCES: Phrase("a-camera-source")}


def names(group: str) -> tuple[str, ...]:
    """The names of a group's entry points in the packages that are installed; nothing is loaded."""
    return tuple(sorted({point.name for point in entry_points(group=group)}))


def load(group: str, name: str, kind: type | tuple[type, ...] | None = None) -> Any:
    """What an installed package gives under this name, None where there is none."""
    found = list(entry_points(group=group, name=name))
    if not found:
        return None
    if len(found) > 1:
        packages = ", ".join(sorted(_package(point) for point in found))
        raise InputError(Phrase("error-two-packages", {"name": name, "packages": packages}))
    try:
        made = found[0].load()
    except Exception as error:  # whatever a stranger's package raises when it is loaded
        what = f"{type(error).__name__}: {error}"[:_LONGEST]
        values = {"name": name, "package": _package(found[0]), "why": what}
        raise InputError(Phrase("error-package-broken", values)) from error
    if kind is not None and not isinstance(made, kind):
        values = {"name": name, "package": _package(found[0]), "kind": _KINDS[group]}
        raise InputError(Phrase("error-package-kind", values))
    return made


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.value.partition(":")[0]
