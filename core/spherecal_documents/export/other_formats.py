"""Formats that installed packages add (docs/plugins.md)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from spherecal.base.plugins import EXPORTERS, IMPORTERS, load
from spherecal_documents.export.file_cameras import FileCamera, Unit
from spherecal_documents.export.format import Format


@dataclass(frozen=True)
class ImportFormat:
    """A format that is only read: `read` gives the cameras of a file or folder, lengths in the first of `units`."""

    name: str
    title: str
    units: tuple[Unit, ...]
    read: Callable[[Path], Sequence[FileCamera]]


def exporter(name: str) -> Format | None:
    """The export format of an installed package; None where no package has this name."""
    return load(EXPORTERS, name, Format)


def importer(name: str) -> Format | ImportFormat | None:
    """The format of an installed package that can be read: an importer, else an exporter that reads back.

    None where no package has this name.
    """
    found = load(IMPORTERS, name, (Format, ImportFormat))
    return exporter(name) if found is None else found
