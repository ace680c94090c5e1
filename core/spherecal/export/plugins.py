"""Formats of other packages, found by their entry points (docs/plugins.md)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from spherecal.errors import InputError
from spherecal.export.cameras import FileCamera, Unit
from spherecal.export.format import Format

EXPORTERS, IMPORTERS = "spherecal.exporters", "spherecal.importers"


@dataclass(frozen=True)
class ImportFormat:
    """A format that is only read: `read` gives the cameras of a file or folder, lengths in the first of `units`."""

    name: str
    title: str
    units: tuple[Unit, ...]
    read: Callable[[Path], Sequence[FileCamera]]


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
        raise InputError(f'"{name}" of {_package(found[0])} is no {group.rpartition(".")[2][:-1]}.', _ASK)
    return made


_ASK = "Update that package, or ask its author."


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.value.partition(":")[0]


def exporter(name: str) -> Format | None:
    """The export format of an installed package."""
    return load(EXPORTERS, name, Format)


def importer(name: str) -> Format | ImportFormat | None:
    """The format of an installed package that can be read: an importer, else an exporter that reads back."""
    found = load(IMPORTERS, name, (Format, ImportFormat))
    return exporter(name) if found is None else found
