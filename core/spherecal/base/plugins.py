"""What other packages add to the program, found by their entry points (docs/plugins.md)."""

from importlib.metadata import EntryPoint, entry_points
from typing import Any

from spherecal.base.errors import InputError

EXPORTERS, IMPORTERS, CAMERA_SOURCES = "spherecal.exporters", "spherecal.importers", "spherecal.camera_sources"
_KINDS = {EXPORTERS: "exporter", IMPORTERS: "importer", CAMERA_SOURCES: "camera source"}
_ASK = "Update that package, or ask its author."


def names(group: str) -> tuple[str, ...]:
    """The names of a group's entry points in the packages that are installed; nothing is loaded."""
    return tuple(sorted({point.name for point in entry_points(group=group)}))


def load(group: str, name: str, kind: type | tuple[type, ...] | None = None) -> Any:
    """What an installed package gives under this name, None where there is none.

    InputError where it cannot be loaded, is of another kind, or two packages give it.
    """
    found = list(entry_points(group=group, name=name))
    if not found:
        return None
    if len(found) > 1:
        packages = ", ".join(sorted(_package(point) for point in found))
        raise InputError(f'"{name}" is given by several packages: {packages}.', "Uninstall all but one.")
    try:
        made = found[0].load()
    except Exception as error:  # whatever a stranger's package raises when it is loaded
        what = f"{type(error).__name__}: {error}"
        raise InputError(f'"{name}" of {_package(found[0])} cannot be loaded ({what:.200}).', _ASK) from error
    if kind is not None and not isinstance(made, kind):
        raise InputError(f'"{name}" of {_package(found[0])} is no {_KINDS[group]}.', _ASK)
    return made


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.value.partition(":")[0]
